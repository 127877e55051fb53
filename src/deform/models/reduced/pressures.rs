//! The neo-Hookean energy of a body that bends into few fields, its volume kept in the mean by few pressures.
//!
//! In: the forms g of the family `reduced_neo_hookean`, exact cubics in z, and z. Out, with λ = (1, g_1, … g_M),
//!
//! ```text
//! V = g_0 + ½ Σ_m g_m²     ∂V/∂z_i = Σ_m λ_m ∂g_m/∂z_i     ∂²V/∂z_i∂z_j = Σ_m λ_m ∂²g_m/∂z_i∂z_j + Σ_{m ≥ 1} ∂g_m/∂z_i ∂g_m/∂z_j
//! ```
//!
//! V is never below a bound: g_0 falls without one as ∫ μ (1 - J) alone, and that is a multiple of g_1. A coefficient of all forms
//! stands side by side, and is read once for the values and slopes, once more for second derivatives.
//!
//! A body that warmth makes s times as large has s³ V(z/s), where its last z is 1/s - 1: the field X, by which F/s - I is more than the
//! sum of the others. Allocates nothing once it is made.

use super::quartic::SIDE;
use crate::base::lanes::{self, Kernel, fused64};
use crate::fem::CubicShape;
use nalgebra::{DMatrix, Matrix3};

/// Parts in which second derivatives are made for the force loop.
const PARTS: usize = 6;
/// Entries of a gradient.
const ENTRIES: usize = 9;

/// [`SIDE`] forms.
type Lane = [f64; SIDE];

pub struct Pressures {
    /// Numbers z without that of warmth.
    variables: usize,
    /// Coefficients, `lanes` for each monomial in the order of [`CubicShape`].
    coefficients: Vec<Lane>,
    lanes: usize,
    here: Forms,
    /// For Newton's method, and those that are prepared in parts.
    newton: Second,
    second: Second,
    /// Gradients of the fields at the points that are pressed most, entry by entry, `variables - 1` numbers each.
    points: Vec<f64>,
}

/// The forms at one z.
#[derive(Clone, Debug)]
struct Forms {
    z: Vec<f64>,
    /// s.
    size: f64,
    /// Numbers z that may be other than 0.
    active: usize,
    /// g; with 1 in place of g_0, and 0 behind g_M, λ.
    values: Vec<Lane>,
    factors: Vec<Lane>,
    /// ∂g/∂z_i, `lanes` for each.
    slopes: Vec<Lane>,
    sums: Vec<Lane>,
}

/// Second derivatives while they are made.
struct Second {
    forms: Forms,
    /// Row by row of `variables` numbers and that of warmth, below the diagonal and on it.
    sums: Vec<f64>,
    /// ∂²V/∂z² of the last that were made, row by row.
    made: Vec<f64>,
    /// The next c; `None` before the first.
    next: Option<usize>,
}

impl Pressures {
    /// The energy of `variables` numbers z; `None` where the tables do not suit them.
    pub fn new(variables: usize, forms: &DMatrix<f64>, points: &DMatrix<f64>) -> Option<Pressures> {
        let all = [variables, variables + 1]
            .into_iter()
            .find(|n| CubicShape { variables: *n }.len() == forms.ncols())?;
        if forms.nrows() == 0 || points.nrows() != ENTRIES * (variables - 1) {
            return None;
        }
        let lanes = forms.nrows().div_ceil(SIDE);
        let mut coefficients = vec![[0.0; SIDE]; lanes * forms.ncols()];
        for (own, column) in coefficients.chunks_exact_mut(lanes).zip(forms.column_iter()) {
            for (lane, forms) in own.iter_mut().zip(column.as_slice().chunks(SIDE)) {
                lane[..forms.len()].copy_from_slice(forms);
            }
        }
        let none = vec![[0.0; SIDE]; lanes];
        let here = Forms {
            z: vec![0.0; all],
            size: 1.0,
            active: 0,
            values: none.clone(),
            factors: none.clone(),
            slopes: vec![[0.0; SIDE]; lanes * all],
            sums: none,
        };
        let second = || Second {
            forms: here.clone(),
            sums: vec![0.0; all * all],
            made: vec![0.0; variables * variables],
            next: None,
        };
        let (newton, second) = (second(), second());
        let points = points.as_slice().to_vec();
        Some(Pressures { variables, coefficients, lanes, here, newton, second, points })
    }

    /// ½ ∂²V/∂z_k² at rest.
    pub fn stiffness(&self, k: usize) -> f64 {
        let at = |monomial| {
            &self.coefficients[CubicShape { variables: self.variables }.at(monomial) * self.lanes..]
                [..self.lanes]
        };
        let linear = at([0, 0, k]).as_flattened();
        at([0, k, k])[0][0] + 0.5 * linear.iter().map(|slope| slope * slope).sum::<f64>()
    }

    /// V, and its slopes against the first `active` of z; the others of z must be 0.
    pub fn slopes(&mut self, z: &[f64], active: usize, size: f64, slopes: &mut [f64]) -> f64 {
        self.here.take(z, active, size);
        lanes::run(Evaluate { coefficients: &self.coefficients, forms: &mut self.here });
        for (k, slope) in slopes.iter_mut().enumerate().take(active) {
            *slope = self.here.slope(k);
        }
        self.here.energy()
    }

    /// The slopes against the z behind the first `active`, where [`Pressures::slopes`] was asked last.
    pub fn slopes_beyond(&mut self, active: usize, slopes: &mut [f64]) {
        if self.here.active == active {
            lanes::run(Beyond {
                coefficients: &self.coefficients,
                forms: &mut self.here,
                until: self.variables,
            });
        }
        for (k, slope) in (active..).zip(slopes) {
            *slope = self.here.slope(k);
        }
    }

    /// The second derivatives against the first `active` of z, row by row.
    pub fn second(&mut self, z: &[f64], active: usize, size: f64) -> &mut [f64] {
        self.newton.begin(&self.coefficients, z, active, size);
        self.newton.go_on(&self.coefficients, usize::MAX);
        self.newton.finish(active)
    }

    /// Does the next part of the second derivatives against all of z, where no warmth acts; true when all are made.
    pub fn prepare(&mut self, z: &[f64]) -> bool {
        match self.second.next {
            None => self.second.begin(&self.coefficients, z, self.variables, 1.0),
            Some(_) if self.is_prepared() => return true,
            Some(_) => {
                let count = CubicShape { variables: self.variables }.len();
                self.second.go_on(&self.coefficients, count.div_ceil(PARTS));
                if self.is_prepared() {
                    self.second.finish(self.variables);
                }
            }
        }
        self.is_prepared()
    }

    pub fn is_prepared(&self) -> bool {
        self.second.next.is_some_and(|next| next >= self.second.forms.active)
    }

    /// What was prepared.
    pub fn prepared(&self) -> &[f64] {
        &self.second.made
    }

    /// Drops the second derivatives.
    pub fn forget(&mut self) {
        self.second.next = None;
    }

    /// Whether the body is inside out at one of the points that are pressed most.
    pub fn is_inverted(&self, z: &[f64]) -> bool {
        let fields = self.variables - 1;
        self.points.chunks_exact((ENTRIES * fields).max(1)).any(|rows| {
            let entry = |row: &[f64]| row.iter().zip(&z[1..]).map(|(h, z)| h * z).sum::<f64>();
            let h = Matrix3::from_iterator(rows.chunks_exact(fields).map(entry));
            (h + Matrix3::identity()).determinant() <= 0.0
        })
    }
}

impl Forms {
    /// Takes the first `active` of z, or all of them and that of warmth.
    fn take(&mut self, z: &[f64], active: usize, size: f64) {
        let all = self.z.len();
        self.size = size;
        self.active = if size == 1.0 { active } else { all };
        self.z[active..].fill(0.0);
        for (own, z) in self.z.iter_mut().zip(&z[..active]) {
            *own = z / size;
        }
        self.z[0] = 1.0;
        if size != 1.0 {
            self.z[all - 1] = size.recip() - 1.0;
        }
    }

    fn energy(&self) -> f64 {
        let values = self.values.as_flattened();
        let squares: f64 = values[1..].iter().map(|g| g * g).sum();
        self.size.powi(3) * (values[0] + 0.5 * squares)
    }

    fn slope(&self, k: usize) -> f64 {
        let own = self.slopes[k * self.factors.len()..][..self.factors.len()].as_flattened();
        self.size.powi(2)
            * own.iter().zip(self.factors.as_flattened()).map(|(slope, factor)| slope * factor).sum::<f64>()
    }
}

/// sum += by · own.
#[inline(always)]
fn add<const FUSED: bool>(by: f64, own: &[Lane], sum: &mut [Lane]) {
    for (sum, own) in sum.iter_mut().zip(own) {
        for i in 0..SIDE {
            sum[i] = fused64::<FUSED>(by, own[i], sum[i]);
        }
    }
}

/// g, ∂g/∂z and λ.
struct Evaluate<'a> {
    coefficients: &'a [Lane],
    forms: &'a mut Forms,
}

impl Kernel for Evaluate<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Forms { z, active, values, factors, slopes, sums, .. } = self.forms;
        let lanes = values.len();
        let mut rest = self.coefficients;
        values.fill([0.0; SIDE]);
        slopes.fill([0.0; SIDE]);
        for c in 0..*active {
            for b in 0..=c {
                let row;
                (row, rest) = rest.split_at((b + 1) * lanes);
                let both = z[b] * z[c];
                // Σ w_abc z_a.
                sums.fill([0.0; SIDE]);
                for ((own, slopes), za) in
                    row.chunks_exact(lanes).zip(slopes.chunks_exact_mut(lanes)).zip(&*z)
                {
                    for ((own, slope), sum) in own.iter().zip(slopes).zip(&mut *sums) {
                        for i in 0..SIDE {
                            slope[i] = fused64::<FUSED>(both, own[i], slope[i]);
                            sum[i] = fused64::<FUSED>(*za, own[i], sum[i]);
                        }
                    }
                }
                add::<FUSED>(both, sums, values);
                add::<FUSED>(z[c], sums, &mut slopes[b * lanes..(b + 1) * lanes]);
                add::<FUSED>(z[b], sums, &mut slopes[c * lanes..(c + 1) * lanes]);
            }
        }
        factors.copy_from_slice(values);
        factors[0][0] = 1.0;
    }
}

/// ∂g/∂z of the z that are 0, up to `until`.
struct Beyond<'a> {
    coefficients: &'a [Lane],
    forms: &'a mut Forms,
    until: usize,
}

impl Kernel for Beyond<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Forms { z, active, slopes, values, sums, .. } = self.forms;
        let lanes = values.len();
        for c in *active..self.until {
            let first = CubicShape { variables: c }.len() * lanes;
            let mut rest = &self.coefficients[first..];
            let own = &mut slopes[c * lanes..(c + 1) * lanes];
            own.fill([0.0; SIDE]);
            for b in 0..*active {
                let row;
                (row, rest) = rest.split_at((b + 1) * lanes);
                sums.fill([0.0; SIDE]);
                for (of_a, za) in row.chunks_exact(lanes).zip(&*z) {
                    add::<FUSED>(*za, of_a, sums);
                }
                add::<FUSED>(z[b], sums, own);
            }
        }
    }
}

/// The part Σ λ ∂²g of the second derivatives.
struct SumSecond<'a> {
    coefficients: &'a [Lane],
    second: &'a mut Second,
    /// Coefficients that are read, up to the end of a c.
    count: usize,
}

impl Kernel for SumSecond<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Second { forms, sums, next, .. } = self.second;
        let Forms { z, active, factors, .. } = forms;
        let (lanes, n) = (factors.len(), z.len());
        let mut c = next.unwrap_or(0);
        let mut rest = &self.coefficients[CubicShape { variables: c }.len() * lanes..];
        let mut read = 0;
        while c < *active && read < self.count {
            for b in 0..=c {
                let row;
                (row, rest) = rest.split_at((b + 1) * lanes);
                read += b + 1;
                let mut by_a = 0.0;
                let (of_b, of_c) = sums.split_at_mut(c * n);
                let of_b = if b == c { None } else { Some(&mut of_b[b * n..]) };
                let mut total = |a: usize, own: &[Lane]| {
                    let mut sum = [0.0; SIDE];
                    for (own, factor) in own.iter().zip(&*factors) {
                        for i in 0..SIDE {
                            sum[i] = fused64::<FUSED>(own[i], factor[i], sum[i]);
                        }
                    }
                    let whole: f64 = sum.iter().sum();
                    by_a = fused64::<FUSED>(whole, z[a], by_a);
                    whole
                };
                match of_b {
                    Some(of_b) => {
                        for (a, own) in row.chunks_exact(lanes).enumerate() {
                            let whole = total(a, own);
                            of_b[a] = fused64::<FUSED>(whole, z[c], of_b[a]);
                            of_c[a] = fused64::<FUSED>(whole, z[b], of_c[a]);
                        }
                    }
                    None => {
                        for (a, own) in row.chunks_exact(lanes).enumerate() {
                            of_c[a] = fused64::<FUSED>(total(a, own), z[b] + z[c], of_c[a]);
                        }
                    }
                }
                of_c[b] += by_a;
            }
            c += 1;
        }
        *next = Some(c);
    }
}

impl Second {
    fn begin(&mut self, coefficients: &[Lane], z: &[f64], active: usize, size: f64) {
        self.forms.take(z, active, size);
        lanes::run(Evaluate { coefficients, forms: &mut self.forms });
        self.sums.fill(0.0);
        self.next = Some(0);
    }

    fn go_on(&mut self, coefficients: &[Lane], count: usize) {
        lanes::run(SumSecond { coefficients, second: self, count });
    }

    /// The second derivatives against the first `count` of z: what was summed, with its other half, and the products of the slopes.
    fn finish(&mut self, count: usize) -> &mut [f64] {
        let Second { forms, sums, made, .. } = self;
        let (lanes, n) = (forms.factors.len(), forms.z.len());
        let own = |k: usize| forms.slopes[k * lanes..(k + 1) * lanes].as_flattened();
        for i in 0..count {
            for j in 0..=i {
                let products: f64 = own(i)[1..].iter().zip(&own(j)[1..]).map(|(a, b)| a * b).sum();
                let sum = sums[i * n + j] * if i == j { 2.0 } else { 1.0 };
                let whole = forms.size * (sum + products);
                (made[i * count + j], made[j * count + i]) = (whole, whole);
            }
        }
        &mut made[..count * count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(variables: usize, forms: usize, is_warm: bool) -> Pressures {
        let all = CubicShape { variables: variables + usize::from(is_warm) }.len();
        let forms = DMatrix::from_fn(forms, all, |form, at| (1.3 * at as f64 + 0.7 * form as f64).sin());
        let points = DMatrix::from_fn(ENTRIES * (variables - 1), 2, |row, point| (row + point) as f64);
        Pressures::new(variables, &forms, &points).unwrap()
    }

    fn value(body: &Pressures, z: &[f64]) -> f64 {
        let forms = body.lanes * SIDE;
        let mut g = vec![0.0; forms];
        let mut at = 0;
        for c in 0..z.len() {
            for b in 0..=c {
                for a in 0..=b {
                    let own = body.coefficients[at * body.lanes..(at + 1) * body.lanes].as_flattened();
                    g.iter_mut().zip(own).for_each(|(g, w)| *g += w * z[a] * z[b] * z[c]);
                    at += 1;
                }
            }
        }
        g[0] + 0.5 * g[1..].iter().map(|g| g * g).sum::<f64>()
    }

    /// Values against sums over all coefficients, slopes and second derivatives against central differences; those of inactive z too, and
    /// with warmth.
    #[test]
    fn slopes_and_second_derivatives_are_those_of_the_sum() {
        let n = 6;
        for (active, size) in [(n, 1.0), (4, 1.0), (n, 1.03), (4, 0.9)] {
            let mut body = body(n, 11, size != 1.0);
            let mut z: Vec<f64> =
                (0..n).map(|i| if i < active { 0.4 * (0.7 * i as f64).cos() } else { 0.0 }).collect();
            z[0] = 1.0;
            let of = |body: &Pressures, z: &[f64]| {
                let mut all: Vec<f64> = z.iter().map(|z| z / size).collect();
                all[0] = 1.0;
                if size != 1.0 {
                    all.push(1.0 / size - 1.0);
                }
                size.powi(3) * value(body, &all)
            };
            let mut slopes = vec![0.0; n];
            let found = body.slopes(&z, active, size, &mut slopes[..active]);
            body.slopes_beyond(active, &mut slopes[active..]);
            assert!((found - of(&body, &z)).abs() < 1e-12 * found.abs(), "{found} {}", of(&body, &z));
            let second = body.second(&z, active, size).to_vec();
            let moved = |i: usize, by: f64| {
                let mut z = z.clone();
                z[i] += by;
                z
            };
            for i in 1..n {
                let slope = (of(&body, &moved(i, 1e-5)) - of(&body, &moved(i, -1e-5))) / 2e-5;
                assert!((slopes[i] - slope).abs() < 1e-7, "{active} {size} {i}: {} {slope}", slopes[i]);
                let (mut plus, mut minus) = (vec![0.0; active], vec![0.0; active]);
                if i < active {
                    body.slopes(&moved(i, 1e-5), active, size, &mut plus);
                    body.slopes(&moved(i, -1e-5), active, size, &mut minus);
                }
                for j in (1..active).filter(|_| i < active) {
                    let expected = (plus[j] - minus[j]) / 2e-5;
                    let found = second[i * active + j];
                    assert!((found - expected).abs() < 1e-6, "{active} {size} {i} {j}: {found} {expected}");
                }
            }
        }
    }

    /// The derivatives that are made in parts are those that are made at once.
    #[test]
    fn parts_make_the_whole() {
        let n = 9;
        let mut body = body(n, 7, false);
        let z: Vec<f64> = (0..n).map(|i| if i == 0 { 1.0 } else { 0.3 * (i as f64).sin() }).collect();
        let whole = body.second(&z, n, 1.0).to_vec();
        let calls = (1..).find(|_| body.prepare(&z)).unwrap();
        assert!((3..=PARTS + 2).contains(&calls), "{calls}");
        assert_eq!(whole, body.prepared());
    }

    #[test]
    fn a_point_that_is_pressed_flat_is_inside_out() {
        let forms = DMatrix::zeros(1, CubicShape { variables: 2 }.len());
        let flat = DMatrix::from_column_slice(9, 1, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let body = Pressures::new(2, &forms, &flat).unwrap();
        assert!(body.is_inverted(&[1.0, -1.01]) && !body.is_inverted(&[1.0, -0.99]));
    }
}
