//! The strain energy of one part by the coordinates of its ends: value, gradient, Hessian.
//!
//! In: y, the screws' coordinates first. Out, with the products p of the pairs of y (half of a square), z = Z p and e = y + S⁺z:
//!
//! ```text
//! V = V₀ f(Δ/V₀)    V₀ = ½ eᵀ S e    Δ = pᵀ D p    D = Q - ½ Zᵀ S⁺ Z
//! f(r) = 1/√(1 - 2 r) for r < 0, 1 + r + 3 r²/(2 + 6 r) for r ≥ 0
//! ```
//!
//! V₀ has the energy's terms to third order, V₀ + Δ those to fourth; Δ is of the screws alone, D reduced to their pairs. Thin walls give way (Brazier, Proc. R. Soc. Lond. A 116,
//! 1927), so that Δ is negative, and V₀ + Δ falls below 0 far out. V differs from it by terms of sixth order; those of f(r)
//! are near Brazier's own, 1 + r + 1.1 r², and leave V convex on a ray as far as r = -1. V is never negative. Nothing here
//! allocates.

use nalgebra::DMatrix;

/// The coefficients of a part's energy, and memory for its evaluation.
#[derive(Clone)]
pub struct PartEnergy {
    /// Coordinates.
    pub m: usize,
    /// S and S⁺, row by row.
    stiffness: Vec<f64>,
    inverse: Vec<f64>,
    /// Z_k,ij row by row, m² numbers for each k.
    quadratic: Vec<f64>,
    /// D row by row, and its pairs i ≤ j.
    quartic: Vec<f64>,
    pairs: Vec<(usize, usize)>,
    last: Value,
    z: Vec<f64>,
    e: Vec<f64>,
    /// p, D p, and D ∂p/∂y row by row.
    p: Vec<f64>,
    dp: Vec<f64>,
    quartic_slopes: Vec<f64>,
    /// ∂z/∂y and S⁺ ∂z/∂y, row by row.
    slopes: Vec<f64>,
    strain_slopes: Vec<f64>,
    /// ∂V₀ and ∂Δ, and the latter's Hessian.
    squares_gradient: Vec<f64>,
    quartic_gradient: Vec<f64>,
    quartic_hessian: Vec<f64>,
    pub gradient: Vec<f64>,
    pub hessian: Vec<f64>,
}

/// V₀ and Δ.
#[derive(Clone, Copy, Default)]
struct Value {
    squares: f64,
    quartic: f64,
}

impl Value {
    /// r, and f with its first two derivatives.
    fn bend(&self) -> [f64; 4] {
        if self.squares < f64::MIN_POSITIVE {
            return [0.0, 1.0, 1.0, 0.0];
        }
        let r = self.quartic / self.squares;
        if r < 0.0 {
            let f = (1.0 - 2.0 * r).sqrt().recip();
            let cube = f * f * f;
            return [r, f, cube, 3.0 * cube * f * f];
        }
        let q = (1.0 + 3.0 * r).recip();
        [r, 1.0 + r + 1.5 * r * r * q, 1.0 + 1.5 * r * (2.0 + 3.0 * r) * q * q, 3.0 * q * q * q]
    }

    /// ∂V/∂V₀ and ∂V/∂Δ.
    fn shares(&self) -> [f64; 2] {
        let [r, f, slope, _] = self.bend();
        [f - r * slope, slope]
    }
}

/// Eigenvalues of S below this part of the largest, S scaled by its diagonal, count as zero: fields that move nothing.
const RANK: f64 = 1e-11;

impl PartEnergy {
    /// The energy by S (m × m), Z (m rows, a column for each pair i ≤ j) and Q (of the pairs of the first coordinates alone).
    pub fn new(stiffness: &DMatrix<f64>, quadratic: &DMatrix<f64>, quartic: &DMatrix<f64>) -> PartEnergy {
        let m = stiffness.nrows();
        let pairs: Vec<(usize, usize)> = (0..m).flat_map(|i| (i..m).map(move |j| (i, j))).collect();
        let mut z = vec![0.0; m * m * m];
        for k in 0..m {
            for (&(i, j), value) in pairs.iter().zip(quadratic.row(k).iter()) {
                z[(k * m + i) * m + j] = *value;
                z[(k * m + j) * m + i] = *value;
            }
        }
        let inverse = inverse(stiffness);
        // The pairs of the first s coordinates, s (s + 1)/2 = rows of Q.
        let screws = (0..=m).find(|s| s * (s + 1) / 2 == quartic.nrows()).unwrap_or(0);
        let own: Vec<usize> = (0..pairs.len()).filter(|&pair| pairs[pair].1 < screws).collect();
        let of_screws = quadratic.select_columns(&own);
        let quartic = quartic - of_screws.transpose() * &inverse * &of_screws * 0.5;
        let pairs: Vec<(usize, usize)> = own.into_iter().map(|pair| pairs[pair]).collect();
        let of_pairs = || vec![0.0; pairs.len()];
        PartEnergy {
            m,
            stiffness: stiffness.as_slice().to_vec(),
            inverse: inverse.as_slice().to_vec(),
            quadratic: z,
            quartic: quartic.as_slice().to_vec(),
            last: Value::default(),
            z: vec![0.0; m],
            e: vec![0.0; m],
            p: of_pairs(),
            dp: of_pairs(),
            quartic_slopes: vec![0.0; pairs.len() * m],
            slopes: vec![0.0; m * m],
            strain_slopes: vec![0.0; m * m],
            squares_gradient: vec![0.0; m],
            quartic_gradient: vec![0.0; m],
            quartic_hessian: vec![0.0; m * m],
            gradient: vec![0.0; m],
            hessian: vec![0.0; m * m],
            pairs,
        }
    }

    /// V(y) in J; leaves behind what the derivatives need.
    pub fn value(&mut self, y: &[f64]) -> f64 {
        let m = self.m;
        if m == 0 {
            return 0.0;
        }
        for ((z, row), of_k) in
            self.z.iter_mut().zip(self.slopes.chunks_exact_mut(m)).zip(self.quadratic.chunks_exact(m * m))
        {
            for (slope, line) in row.iter_mut().zip(of_k.chunks_exact(m)) {
                *slope = dot(line, y);
            }
            *z = 0.5 * dot(row, y);
        }
        for ((e, row), y) in self.e.iter_mut().zip(self.inverse.chunks_exact(m)).zip(y) {
            *e = y + dot(row, &self.z);
        }
        for (p, &(i, j)) in self.p.iter_mut().zip(&self.pairs) {
            *p = y[i] * y[j] * if i == j { 0.5 } else { 1.0 };
        }
        for (dp, row) in self.dp.iter_mut().zip(self.quartic.chunks_exact(self.p.len().max(1))) {
            *dp = dot(row, &self.p);
        }
        let rows = self.stiffness.chunks_exact(m);
        let squares = 0.5 * self.e.iter().zip(rows).map(|(e, row)| e * dot(row, &self.e)).sum::<f64>();
        let quartic = dot(&self.p, &self.dp);
        self.last = Value { squares, quartic };
        let [_, f, _, _] = self.last.bend();
        squares * f
    }

    /// ∂V/∂y of the last value, taken at `y`.
    pub fn differentiate(&mut self, y: &[f64]) {
        let m = self.m;
        if m == 0 {
            return;
        }
        for (g, row) in self.squares_gradient.iter_mut().zip(self.stiffness.chunks_exact(m)) {
            *g = dot(row, &self.e);
        }
        for (e, row) in self.e.iter().zip(self.slopes.chunks_exact(m)) {
            self.squares_gradient.iter_mut().zip(row).for_each(|(g, slope)| *g += e * slope);
        }
        self.quartic_gradient.fill(0.0);
        for (dp, &(i, j)) in self.dp.iter().zip(&self.pairs) {
            // ∂p = y_j dy_i + y_i dy_j, of a square half of it twice.
            if i == j {
                self.quartic_gradient[i] += 2.0 * dp * y[i];
            } else {
                self.quartic_gradient[i] += 2.0 * dp * y[j];
                self.quartic_gradient[j] += 2.0 * dp * y[i];
            }
        }
        let [a, b] = self.last.shares();
        for ((g, squares), quartic) in
            self.gradient.iter_mut().zip(&self.squares_gradient).zip(&self.quartic_gradient)
        {
            *g = a * squares + b * quartic;
        }
    }

    /// ∂²V/∂y² of the last value and gradient.
    pub fn differentiate_twice(&mut self, y: &[f64]) {
        let m = self.m;
        if m == 0 {
            return;
        }
        self.differentiate_squares();
        self.differentiate_quartic(y);
        let ([a, b], [r, _, _, curvature]) = (self.last.shares(), self.last.bend());
        // V₀ is 0 at rest alone, where f's curvature has no part in the Hessian.
        let weight = if curvature > 0.0 { curvature / self.last.squares } else { 0.0 };
        let bend = |i: usize| self.quartic_gradient[i] - r * self.squares_gradient[i];
        for i in 0..m {
            let of_row = weight * bend(i);
            for j in 0..m {
                let at = i * m + j;
                self.hessian[at] = a * self.hessian[at] + b * self.quartic_hessian[at] + of_row * bend(j);
            }
        }
    }

    /// ∂²V₀ = S + J + Jᵀ + Jᵀ S⁺ J + Σ_k e_k Z_k, J = ∂z/∂y.
    fn differentiate_squares(&mut self) {
        let m = self.m;
        for (row, line) in self.strain_slopes.chunks_exact_mut(m).zip(self.inverse.chunks_exact(m)) {
            row.fill(0.0);
            for (weight, slopes) in line.iter().zip(self.slopes.chunks_exact(m)) {
                row.iter_mut().zip(slopes).for_each(|(to, slope)| *to += weight * slope);
            }
        }
        self.hessian.copy_from_slice(&self.stiffness);
        for (e, of_k) in self.e.iter().zip(self.quadratic.chunks_exact(m * m)) {
            self.hessian.iter_mut().zip(of_k).for_each(|(h, z)| *h += e * z);
        }
        for i in 0..m {
            for j in 0..m {
                self.hessian[i * m + j] += self.slopes[i * m + j] + self.slopes[j * m + i];
            }
        }
        for (slopes, strains) in self.slopes.chunks_exact(m).zip(self.strain_slopes.chunks_exact(m)) {
            for (slope, row) in slopes.iter().zip(self.hessian.chunks_exact_mut(m)) {
                row.iter_mut().zip(strains).for_each(|(h, strain)| *h += slope * strain);
            }
        }
    }

    /// ∂²Δ = 2 (∂p)ᵀ D ∂p + 2 Σ (D p) ∂²p.
    fn differentiate_quartic(&mut self, y: &[f64]) {
        let m = self.m;
        let rows = self.quartic.chunks_exact(self.p.len().max(1));
        for (to, row) in self.quartic_slopes.chunks_exact_mut(m).zip(rows) {
            to.fill(0.0);
            for (d, &(i, j)) in row.iter().zip(&self.pairs) {
                if i == j {
                    to[i] += d * y[i];
                } else {
                    to[i] += d * y[j];
                    to[j] += d * y[i];
                }
            }
        }
        self.quartic_hessian.fill(0.0);
        for ((row, dp), &(i, j)) in self.quartic_slopes.chunks_exact(m).zip(&self.dp).zip(&self.pairs) {
            for (k, slope) in row.iter().enumerate() {
                self.quartic_hessian[i * m + k] += 2.0 * slope * y[j];
                if i != j {
                    self.quartic_hessian[j * m + k] += 2.0 * slope * y[i];
                }
            }
            self.quartic_hessian[i * m + j] += 2.0 * dp;
            if i != j {
                self.quartic_hessian[j * m + i] += 2.0 * dp;
            }
        }
    }
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The pseudo-inverse; units differ, so that S is scaled by its diagonal first.
fn inverse(s: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = s.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(s.nrows(), s.ncols(), |i, j| s[(i, j)] * scale[i] * scale[j]);
    if scaled.is_empty() {
        return scaled;
    }
    let eigen = ((&scaled + scaled.transpose()) * 0.5).symmetric_eigen();
    let least = RANK * eigen.eigenvalues.max();
    let inverted = eigen.eigenvalues.map(|value| if value > least { 1.0 / value } else { 0.0 });
    let inverse = &eigen.eigenvectors * DMatrix::from_diagonal(&inverted) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(s.nrows(), s.ncols(), |i, j| inverse[(i, j)] * scale[i] * scale[j])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_differences() {
        let m = 7;
        let number = |i: usize| ((i * 2_654_435_761 % 1000) as f64 - 500.0) * 1e-3;
        let root = DMatrix::from_fn(m, m, |i, j| number(7 * i + j + 1));
        let s = &root * root.transpose() + DMatrix::identity(m, m);
        let z = DMatrix::from_fn(m, m * (m + 1) / 2, |i, j| number(31 * i + j + 5));
        let q = DMatrix::from_fn(21, 21, |i, j| number(29 * i.min(j) + i.max(j) + 11) * 2.0);
        let mut part = PartEnergy::new(&s, &z, &q);
        let y: Vec<f64> = (0..m).map(|i| number(3 * i + 2)).collect();
        part.value(&y);
        part.differentiate(&y);
        part.differentiate_twice(&y);
        let (gradient, hessian) = (part.gradient.clone(), part.hessian.clone());
        let h = 1e-5;
        for i in 0..m {
            let mut at = |step: f64| {
                let mut y = y.clone();
                y[i] += step;
                let value = part.value(&y);
                part.differentiate(&y);
                (value, part.gradient.clone())
            };
            let ((high, above), (low, below)) = (at(h), at(-h));
            let (found, largest) = (gradient[i], gradient.iter().fold(0.0, |a: f64, b| a.max(b.abs())));
            let difference = (high - low) / (2.0 * h);
            assert!((difference - found).abs() < 1e-7 * largest, "{i}: {difference} {found}");
            let largest = hessian.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            for j in 0..m {
                let (difference, found) = ((above[j] - below[j]) / (2.0 * h), hessian[i * m + j]);
                assert!((difference - found).abs() < 1e-7 * largest, "{i} {j}: {difference} {found}");
            }
        }
    }

    /// However negative the fourth order is, the energy is not.
    #[test]
    fn energy_is_never_negative() {
        let m = 2;
        let (s, z) = (DMatrix::identity(m, m), DMatrix::zeros(m, 3));
        let mut part = PartEnergy::new(&s, &z, &DMatrix::from_diagonal_element(3, 3, -5.0));
        for far in [0.0, 1e-200, 1e-3, 0.3, 2.0, 1e3] {
            let y = [far, -0.5 * far];
            let value = part.value(&y);
            part.differentiate(&y);
            part.differentiate_twice(&y);
            assert!(value >= 0.0 && part.hessian.iter().all(|h| h.is_finite()), "{far}: {value}");
        }
    }
}
