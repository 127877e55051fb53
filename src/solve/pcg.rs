//! Conjugate gradients on the 3×3-block matrix, preconditioned by its diagonal blocks (block-Jacobi); all columns
//! are iterated together, so that one pass over the matrix multiplies all of them.

use super::error::SolveError;
use super::residual::residuals;
use super::solver::{Conditioning, Factor, LinearSolver, Method, SolveResult, SolveStats, Solver};
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::Matrix3;
use rayon::prelude::*;
use std::time::Instant;

pub const PCG: Method = Method {
    name: "pcg",
    is_direct: false,
    bounds_error: false,
    remedy: "lower solver.tolerance or write solver.method = \"cholesky\", and look for slivers, for thin parts and for \
             large contrasts of stiffness (`greenstage check`)",
    analyse: |solver, _, _| {
        let Solver { method, tolerance, max_iterations } = *solver;
        Ok(Box::new(Limits { method, tolerance, max_iterations }))
    },
};

/// When an iteration ends; the method needs to know nothing of the graph of A.
#[derive(Clone, Copy)]
struct Limits {
    method: &'static Method,
    /// On the true relative residual ‖b - A x‖₂ / ‖b‖₂ of every column.
    tolerance: f64,
    max_iterations: usize,
}

impl LinearSolver for Limits {
    /// x, r, z, p, A p and a true residual; the inverse blocks.
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        6.0 * 24.0 * (a.nodes() * columns) as f64 + 72.0 * a.nodes() as f64
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        Ok(machine::expect(format!("iterating {columns} columns together"), self.memory(a, columns))?)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        _: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        let started = Instant::now();
        let inverse = inverse_diagonal(a)?;
        Ok(Box::new(Pcg { a, inverse, limits: *self, factor_s: started.elapsed().as_secs_f64() }))
    }
}

/// A with the inverses of its diagonal blocks.
struct Pcg<'a> {
    a: &'a StiffnessMatrix,
    inverse: Vec<Matrix3<f64>>,
    limits: Limits,
    factor_s: f64,
}

/// By rounding the residual of the recurrence drifts away from the true one; the iteration is restarted from the true
/// residual at most this often before it is called stagnant.
const RESTARTS: usize = 8;

/// Relative residual to which the error of a solution is solved for.
const PROBE: f64 = 1e-4;

/// The result of an iteration that reached its tolerance.
struct Converged {
    x: NodeFields,
    /// True residuals.
    r: NodeFields,
    spectrum: Spectrum,
    stats: SolveStats,
}

impl Factor for Pcg<'_> {
    fn nodes(&self) -> usize {
        self.a.nodes()
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.converge(b, progress).map(|Converged { x, stats, .. }| (x, stats))
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        let Converged { x, r, mut spectrum, mut stats } = self.converge(b, progress)?;
        let started = Instant::now();
        let forward_error = self.energy_error(&x, b, &r, &mut spectrum);
        let seconds = started.elapsed().as_secs_f64();
        stats.conditioning = Some(Conditioning { scaled_condition: None, forward_error, seconds });
        Ok((x, stats))
    }
}

impl Pcg<'_> {
    /// Solves A x = b from x = 0. Errors where a column's true residual stays above the tolerance.
    fn converge(&self, b: &NodeFields, progress: &dyn Progress) -> Result<Converged, SolveError> {
        let Limits { tolerance, max_iterations, .. } = self.limits;
        // One unit a thousandth of the way down to the tolerance on a logarithmic scale.
        progress.begin("conjugate gradients", 1000);
        let started = Instant::now();
        let mut x = NodeFields::zeros(b.nodes, b.columns);
        let mut iterations = 0;
        let mut spectrum = Spectrum::default();
        let mut done = 0;
        let (mut relative, mut r) = residuals(self.a, &x, b);
        for _ in 0..=RESTARTS {
            if relative.iter().all(|&r| r <= tolerance) || iterations >= max_iterations {
                break;
            }
            let limits = Limits { max_iterations: max_iterations - iterations, ..self.limits };
            iterations += self.iterate(limits, &mut x, r, &b.norms(), None, &mut spectrum, &mut |worst| {
                let way = (1000.0 * (worst.max(tolerance).ln() / tolerance.ln())) as u64;
                progress.advance(way.saturating_sub(done));
                done = done.max(way);
            });
            (relative, r) = residuals(self.a, &x, b);
        }
        progress.end();
        for (column, &residual) in relative.iter().enumerate() {
            if residual > tolerance || residual.is_nan() {
                return Err(SolveError::Residual { column, residual, limit: tolerance, iterations });
            }
        }
        let stats = SolveStats {
            method: self.limits.method,
            unknowns: 3 * b.nodes,
            columns: b.columns,
            factor_s: self.factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            iterations,
            residuals: relative,
            ..Default::default()
        };
        Ok(Converged { x, r, spectrum, stats })
    }

    /// The largest ‖x̂ - x‖_A / ‖x̂‖_A of all columns. The residual r = b - A x̂ is no measure where A is ill-conditioned,
    /// and the least eigenvalue λ of D⁻¹A, with D the diagonal blocks, is seen only once the iteration has converged; so
    /// the errors d are solved for, A d = r, to a part of [`PROBE`], and what is left, ρ = r - A d, is bounded:
    ///
    /// ```text
    /// ‖x̂ - x‖_A ≤ ‖d‖_A + (ρᵀD⁻¹ρ / λ)^½
    /// ```
    ///
    /// (Axelsson and Kaporin, Numer. Linear Algebra Appl. 8, 2001, 265-286: ρᵀA⁻¹ρ ≤ ρᵀD⁻¹ρ / λ.) λ is an estimate from
    /// above, which these iterations improve.
    fn energy_error(&self, x: &NodeFields, b: &NodeFields, r: &NodeFields, spectrum: &mut Spectrum) -> f64 {
        let norms = r.norms();
        if norms.iter().all(|norm| *norm == 0.0) {
            return 0.0;
        }
        let energies: Vec<f64> = x.dots(b).iter().zip(x.dots(r)).map(|(xb, xr)| xb - xr).collect();
        let mut z = NodeFields::zeros(r.nodes, r.columns);
        precondition(&self.inverse, r, &mut z);
        let parts = r.dots(&z).into_iter().zip(&energies).map(|(rz, energy)| rz / energy);
        let (watched, _) =
            parts.enumerate().fold((0, 0.0), |most, (c, part)| if part > most.1 { (c, part) } else { most });
        let mut d = NodeFields::zeros(r.nodes, r.columns);
        let probe = Limits { tolerance: PROBE, ..self.limits };
        self.iterate(probe, &mut d, r.clone(), &norms, Some(watched), spectrum, &mut |_| {});
        let (_, left) = residuals(self.a, &d, r);
        precondition(&self.inverse, &left, &mut z);
        let least = spectrum.ends.map_or(1.0, |[low, _]| low);
        let known = d.dots(r).into_iter().zip(d.dots(&left)).map(|(dr, dl)| (dr - dl).abs().sqrt());
        let unknown = left.dots(&z).into_iter().map(|rest| (rest / least).sqrt());
        known
            .zip(unknown)
            .zip(&energies)
            .map(|((known, unknown), energy)| match known + unknown {
                0.0 => 0.0,
                error => error / energy.sqrt(),
            })
            .fold(0.0, |worst: f64, error| if error > worst || error.is_nan() { error } else { worst })
    }

    /// Iterates until the recurrence's residual of every column is below half the tolerance; the spectrum is taken from
    /// the `watched` column, or from that with the largest residual. Returns the number of
    /// iterations. A column that has converged is no longer changed.
    #[allow(clippy::too_many_arguments, reason = "the state of one iteration, used nowhere else")]
    fn iterate(
        &self,
        limits: Limits,
        x: &mut NodeFields,
        mut r: NodeFields,
        b_norms: &[f64],
        watched: Option<usize>,
        spectrum: &mut Spectrum,
        told: &mut dyn FnMut(f64),
    ) -> usize {
        let m = r.columns;
        let mut z = NodeFields::zeros(r.nodes, m);
        precondition(&self.inverse, &r, &mut z);
        let mut p = z.clone();
        let mut ap = NodeFields::zeros(r.nodes, m);
        let mut rz = r.dots(&z);
        // The column with the most to do sees most of the spectrum.
        let slowest =
            watched.unwrap_or_else(|| (0..m).fold(0, |most, c| if rz[c] > rz[most] { c } else { most }));
        // A restart begins another Krylov space: its coefficients make a tridiagonal of their own.
        let mut coefficients = Vec::new();
        for iteration in 0..limits.max_iterations {
            let relative: Vec<f64> =
                r.norms().iter().zip(b_norms).map(|(r, b)| if *b == 0.0 { 0.0 } else { r / b }).collect();
            let active: Vec<bool> = relative.iter().map(|r| *r > 0.5 * limits.tolerance).collect();
            told(relative.iter().copied().fold(0.0, f64::max));
            if !active.contains(&true) {
                spectrum.widen(&coefficients);
                return iteration;
            }
            self.a.multiply(&p, &mut ap);
            let pap = p.dots(&ap);
            let alpha: Vec<f64> =
                (0..m).map(|c| if active[c] && pap[c] > 0.0 { rz[c] / pap[c] } else { 0.0 }).collect();
            add_scaled(x, &alpha, &p);
            let minus: Vec<f64> = alpha.iter().map(|a| -a).collect();
            add_scaled(&mut r, &minus, &ap);
            precondition(&self.inverse, &r, &mut z);
            let new_rz = r.dots(&z);
            let beta: Vec<f64> = (0..m).map(|c| if rz[c] > 0.0 { new_rz[c] / rz[c] } else { 0.0 }).collect();
            p.data.par_chunks_mut(m).zip(z.data.par_chunks(m)).with_min_len(1024).for_each(|(p, z)| {
                for c in 0..m {
                    p[c] = z[c] + beta[c] * p[c];
                }
            });
            rz = new_rz;
            // Once the column is left as it is, it tells nothing more.
            if alpha[slowest] > 0.0 && coefficients.len() == iteration {
                coefficients.push([alpha[slowest], beta[slowest]]);
            }
        }
        spectrum.widen(&coefficients);
        limits.max_iterations
    }
}

/// The ends of the preconditioned matrix' spectrum as the iterations saw them, from inside.
#[derive(Default)]
struct Spectrum {
    ends: Option<[f64; 2]>,
}

impl Spectrum {
    /// Takes the coefficients α, β of one run of iterations: conjugate gradients are Lanczos in disguise, and those of one
    /// run make one tridiagonal matrix T (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., section 6.7.3).
    fn widen(&mut self, coefficients: &[[f64; 2]]) {
        let mut diagonal = Vec::with_capacity(coefficients.len());
        // Square of the number beside the diagonal, in the row after it.
        let mut beside = Vec::with_capacity(coefficients.len());
        let mut before = None;
        for &[alpha, beta] in coefficients {
            let (shift, square) =
                before.map_or((0.0, 0.0), |[alpha, beta]: [f64; 2]| (beta / alpha, beta / (alpha * alpha)));
            diagonal.push(1.0 / alpha + shift);
            beside.push(square);
            before = Some([alpha, beta]);
        }
        let Some([low, high]) = ends(&diagonal, &beside) else { return };
        let known = self.ends.unwrap_or([low, high]);
        self.ends = Some([known[0].min(low), known[1].max(high)]);
    }
}

/// The least and the largest eigenvalue of a symmetric tridiagonal matrix, by bisection with Sturm sequences (Golub and
/// Van Loan, Matrix Computations, 4th ed., section 8.4.1); `None` where it has no row.
fn ends(diagonal: &[f64], beside: &[f64]) -> Option<[f64; 2]> {
    let size = diagonal.len();
    let reach = |row: usize| beside[row].sqrt() + beside.get(row + 1).map_or(0.0, |square| square.sqrt());
    let rows = || (0..size).map(|row| (diagonal[row] - reach(row), diagonal[row] + reach(row)));
    let high = rows().map(|(_, high)| high).reduce(f64::max)?;
    let low = rows().map(|(low, _)| low).reduce(f64::min)?.max(0.0);
    // Eigenvalues below `at`: negative pivots of T - at.
    let below = |at: f64| {
        let mut pivot = 1.0;
        let count = |row: usize| {
            pivot = diagonal[row] - at - if row == 0 { 0.0 } else { beside[row] / pivot };
            if pivot == 0.0 {
                pivot = f64::MIN_POSITIVE;
            }
            pivot < 0.0
        };
        (0..size).map(count).filter(|negative| *negative).count()
    };
    let end = |least: bool| {
        let (mut low, mut high) = (low, high);
        // Towards 0 the logarithm is halved first: the least may be many powers of ten below the largest.
        for _ in 0..200 {
            let middle = if low > 0.0 && high > 2.0 * low { (low * high).sqrt() } else { 0.5 * (low + high) };
            if middle <= low || middle >= high {
                break;
            }
            let most = if least { 0 } else { size - 1 };
            if below(middle) > most {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    };
    Some([end(true), end(false)])
}

fn inverse_diagonal(a: &StiffnessMatrix) -> Result<Vec<Matrix3<f64>>, SolveError> {
    a.diagonal
        .iter()
        .enumerate()
        .map(|(node, block)| match block.cholesky() {
            Some(factor) => Ok(factor.inverse()),
            None => Err(SolveError::NotPositiveDefinite { unknowns: 3 * a.nodes(), pivot: 3 * node }),
        })
        .collect()
}

/// z = D⁻¹ r with D the diagonal blocks.
fn precondition(inverse: &[Matrix3<f64>], r: &NodeFields, z: &mut NodeFields) {
    let m = r.columns;
    z.data.par_chunks_mut(3 * m).zip(r.data.par_chunks(3 * m)).zip(inverse).with_min_len(512).for_each(
        |((z, r), inverse)| {
            for row in 0..3 {
                let (i0, i1, i2) = (inverse[(row, 0)], inverse[(row, 1)], inverse[(row, 2)]);
                for c in 0..m {
                    z[row * m + c] = i0 * r[c] + i1 * r[m + c] + i2 * r[2 * m + c];
                }
            }
        },
    );
}

/// x += s_c p for every column c.
fn add_scaled(x: &mut NodeFields, scale: &[f64], p: &NodeFields) {
    let m = x.columns;
    x.data.par_chunks_mut(m).zip(p.data.par_chunks(m)).with_min_len(1024).for_each(|(x, p)| {
        for c in 0..m {
            x[c] += scale[c] * p[c];
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// -u'' on n points: eigenvalues 2 - 2 cos(k π / (n + 1)).
    #[test]
    fn bisection_finds_the_ends_of_a_known_spectrum() {
        for size in [1, 2, 7, 1000] {
            let mut beside = vec![1.0; size];
            beside[0] = 0.0;
            let [low, high] = ends(&vec![2.0; size], &beside).unwrap();
            let exact = |k: f64| 2.0 - 2.0 * (k * std::f64::consts::PI / (size as f64 + 1.0)).cos();
            assert!((low / exact(1.0) - 1.0).abs() < 1e-9, "{size}: {low} of {}", exact(1.0));
            assert!((high / exact(size as f64) - 1.0).abs() < 1e-9, "{size}: {high}");
        }
        assert_eq!(ends(&[], &[]), None);
    }

    /// Runs of α = 1/2, β = 0 see the eigenvalue 2 and nothing else, however many there are.
    #[test]
    fn every_run_has_a_spectrum_of_its_own() {
        let mut spectrum = Spectrum::default();
        spectrum.widen(&[]);
        assert_eq!(spectrum.ends, None);
        let is = |spectrum: &Spectrum, ends: [f64; 2]| {
            let found = spectrum.ends.unwrap();
            assert!((0..2).all(|end| (found[end] - ends[end]).abs() < 1e-12), "{found:?}");
        };
        spectrum.widen(&[[0.5, 3.0]]);
        spectrum.widen(&[[0.5, 3.0]]);
        is(&spectrum, [2.0, 2.0]);
        spectrum.widen(&[[0.25, 3.0]]);
        is(&spectrum, [2.0, 4.0]);
    }
}
