//! The q at which a quartic V(1, y, q) is least for given y.
//!
//! In: y. Out: q with ∂V/∂q = 0, by Newton's method from the last q, predicted along the tangent. The factored second
//! derivatives are kept while they serve: then a step costs one evaluation of the slopes. Each step is shortened until V
//! falls (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithms 3.1 and 3.2). Allocates nothing.

use super::quartic::Quartic;

/// The iteration ends where Newton's step promises to lower V by less than this part of it: the error of q is about the
/// root of it, in energy.
const DECREASE: f64 = 1e-14;
/// A step with old second derivatives that leaves more than this part of the promised decrease is the last.
const SERVES: f64 = 0.01;
const MOST_STEPS: usize = 60;
const SHORTEST: f64 = 1e-3;
/// Rounding errors of V, as a part of it.
const ROUNDING: f64 = 1e-12;
/// y beyond those of undeformed elements count as 0 below this.
const NOTHING: f64 = 1e-9;

/// The quartic with where it was last in equilibrium.
pub struct ReducedBody {
    quartic: Quartic,
    /// Coordinates y of undeformed elements, then the q, then the other y.
    rigid: usize,
    fields: usize,
    z: Vec<f64>,
    trial: Vec<f64>,
    pub slopes: Vec<f64>,
    row: Vec<f64>,
    second: Vec<f64>,
    /// Cholesky's factor of ∂²V/∂q², row by row, and ∂²V/∂q∂z of all active z; of how many: 0 where there is none.
    factor: Vec<f64>,
    cross: Vec<f64>,
    factored: usize,
    step: Vec<f64>,
}

impl ReducedBody {
    /// `None` where the coefficients are not those of so many coordinates.
    pub fn new(rigid: usize, others: usize, fields: usize, coefficients: Vec<f64>) -> Option<ReducedBody> {
        let n = 1 + rigid + fields + others;
        let mut z = vec![0.0; n];
        z[0] = 1.0;
        Some(ReducedBody {
            quartic: Quartic::new(n, coefficients)?,
            rigid,
            fields,
            trial: z.clone(),
            z,
            slopes: vec![0.0; n],
            row: vec![0.0; n],
            second: vec![0.0; n * n],
            factor: vec![0.0; fields * fields],
            cross: vec![0.0; fields * n],
            factored: 0,
            step: vec![0.0; fields],
        })
    }

    /// q, as it was last found.
    pub fn q(&self) -> &[f64] {
        &self.z[1 + self.rigid..][..self.fields]
    }

    /// ∂V/∂y of the k-th y.
    pub fn slope(&self, k: usize) -> f64 {
        self.slopes[if k < self.rigid { 1 + k } else { 1 + self.fields + k }]
    }

    /// From now on the search begins at q = 0.
    pub fn forget(&mut self) {
        self.z[1..].fill(0.0);
        self.factored = 0;
    }

    /// V at its least over q, and its slopes; the flag is false where no q was found, and an earlier one was kept.
    pub fn settle(&mut self, y: &[f64]) -> (f64, bool) {
        let (q, others) = (1 + self.rigid, 1 + self.rigid + self.fields);
        let is_deformed = y[self.rigid..].iter().any(|y| y.abs() > NOTHING);
        let active = if is_deformed { self.z.len() } else { others };
        let before = self.factored == active;
        self.trial.copy_from_slice(&self.z);
        for (k, y) in y.iter().enumerate() {
            let at = if k < self.rigid { 1 + k } else { 1 + self.fields + k };
            self.z[at] = if at < active { *y } else { 0.0 };
        }
        if before {
            self.predict();
        }
        let found = self.iterate(active);
        let value = self.quartic.slopes(&self.z, active, &mut self.slopes);
        if !found {
            // Nothing of the q that were tried is kept.
            self.z[q..others].copy_from_slice(&self.trial[q..others]);
            self.factored = 0;
        }
        (value, found && value.is_finite())
    }

    /// Moves q with y as the last second derivatives say; `trial` holds the z before.
    fn predict(&mut self) {
        let (n, q) = (self.factored, 1 + self.rigid);
        for i in 0..self.fields {
            let cross = &self.cross[i * n..(i + 1) * n];
            let moved = cross.iter().zip(self.z.iter().zip(&self.trial));
            self.step[i] = moved.map(|(second, (now, before))| second * (now - before)).sum();
        }
        self.solve();
        for (q, step) in self.z[q..].iter_mut().zip(&self.step) {
            *q -= step;
        }
    }

    fn iterate(&mut self, active: usize) -> bool {
        let q = 1 + self.rigid;
        let mut value = self.quartic.slopes(&self.z, active, &mut self.slopes[..active]);
        let mut last = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let mut is_new = false;
            let mut promised = if self.factored == active { self.direction() } else { f64::INFINITY };
            if promised > SERVES * last || self.factored != active {
                if !self.factorize(active) {
                    return false;
                }
                is_new = true;
                promised = self.direction();
            }
            if !promised.is_finite() {
                return false;
            }
            if promised <= DECREASE * value.abs() {
                return true;
            }
            // After a new factor, the next step is judged by what is left of this one.
            last = promised;
            let mut share = 1.0;
            loop {
                self.trial.copy_from_slice(&self.z);
                for (q, step) in self.trial[q..].iter_mut().zip(&self.step) {
                    *q -= share * step;
                }
                let moved = self.quartic.slopes(&self.trial, active, &mut self.slopes[..active]);
                if moved <= value - 1e-4 * share * promised + ROUNDING * value.abs() {
                    self.z.copy_from_slice(&self.trial);
                    value = moved;
                    break;
                }
                share *= 0.5;
                if share < SHORTEST {
                    if is_new {
                        return false;
                    }
                    // The old second derivatives are no use here.
                    value = self.quartic.slopes(&self.z, active, &mut self.slopes[..active]);
                    last = 0.0;
                    break;
                }
            }
        }
        false
    }

    /// Newton's step from the slopes, and how much of V it promises to take away, twice.
    fn direction(&mut self) -> f64 {
        let q = 1 + self.rigid;
        self.step.copy_from_slice(&self.slopes[q..q + self.fields]);
        self.solve();
        self.step.iter().zip(&self.slopes[q..]).map(|(step, slope)| step * slope).sum()
    }

    /// Factors ∂²V/∂q² at z, with so much added to its diagonal that it is positive definite.
    fn factorize(&mut self, active: usize) -> bool {
        let (n, q, fields) = (active, 1 + self.rigid, self.fields);
        self.quartic.second(&self.z, n, &mut self.row, &mut self.second);
        for i in 0..fields {
            self.cross[i * n..(i + 1) * n].copy_from_slice(&self.second[(q + i) * n..(q + i + 1) * n]);
        }
        let largest = (0..fields).map(|i| self.second[(q + i) * (n + 1)].abs()).fold(0.0, f64::max);
        let mut shift = 0.0;
        for _ in 0..12 {
            for i in 0..fields {
                for j in 0..fields {
                    self.factor[i * fields + j] = self.second[(q + i) * n + q + j];
                }
                self.factor[i * fields + i] += shift;
            }
            if cholesky(&mut self.factor, fields) {
                self.factored = n;
                return true;
            }
            shift = (10.0 * shift).max(1e-4 * largest);
        }
        self.factored = 0;
        false
    }

    /// Solves with the factor, in `step`.
    fn solve(&mut self) {
        let (n, l, x) = (self.fields, &self.factor, &mut self.step);
        for i in 0..n {
            let known: f64 = (0..i).map(|j| l[i * n + j] * x[j]).sum();
            x[i] = (x[i] - known) / l[i * n + i];
        }
        for i in (0..n).rev() {
            x[i] /= l[i * n + i];
            let value = x[i];
            for j in 0..i {
                x[j] -= l[i * n + j] * value;
            }
        }
    }
}

/// A = L Lᵀ in place, row by row in the lower triangle; false where A is not positive definite.
fn cholesky(a: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
            let rest = a[i * n + j] - sum;
            if i == j {
                if !(rest > 1e-12 * a[i * n + i].abs()) {
                    return false;
                }
                a[i * n + i] = rest.sqrt();
            } else {
                a[i * n + j] = rest / a[j * n + j];
            }
        }
    }
    true
}
