//! Conjugate gradients on the 3×3-block matrix, preconditioned by multigrid ([`super::multigrid`]). Several columns are
//! iterated together, so that one pass over the matrix multiplies all of them.
//!
//! In: A, its levels, and columns of b. Out: columns of x with their true residuals, or the first that stays above the
//! tolerance; a bound of their error in the norm of the energy; and the least and the largest eigenvalue of the
//! preconditioned matrix, as the iteration sees them ([`Spectrum`]).

use super::error::SolveError;
use super::multigrid::{Multigrid, Workspace};
use super::residual::Column;
use crate::base::lanes::padded;
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use rayon::prelude::*;
use std::ops::Range;

/// Largest number of restarts from the true residual, from which that of the recurrence drifts away by rounding; they are made
/// while they help, before the iteration is called stagnant.
const RESTARTS: usize = 8;

/// Residual in parts of ‖|A| |x| + |b|‖₂ that rounding leaves where no iteration can lower it: some units of roundoff.
const ROUNDING: f64 = 2e-15;

/// Relative residual to which the error of a solution is solved for.
const PROBE: f64 = 1e-2;
/// Iterations that the probe may take of a solution that took fewer.
const PROBE_ITERATIONS: usize = 50;

/// A with its multigrid levels, and when an iteration ends.
#[derive(Clone, Copy)]
pub struct System<'a> {
    pub a: &'a StiffnessMatrix,
    pub multigrid: &'a Multigrid,
    /// Bound on the true relative residual ‖b - A x‖₂ / ‖b‖₂ of every column.
    pub tolerance: f64,
    pub max_iterations: usize,
    /// Iterations after which it ends as soon as it foresees more than `max_iterations`.
    pub sight: usize,
}

/// Columns that are iterated together, in all their vectors, with columns of zeros behind them up to a multiple of four.
pub struct Batch<'a> {
    system: System<'a>,
    b: &'a NodeFields,
    /// Columns of `b` that are solved.
    columns: Range<usize>,
    x: NodeFields,
    r: NodeFields,
    p: NodeFields,
    /// A p.
    q: NodeFields,
    workspace: Workspace,
    spectrum: Spectrum,
    iterations: usize,
    /// The column for which the iteration was given up, its relative residual, and the iterations that it would take.
    slow: Option<(usize, f64, f64)>,
    /// True residuals ‖b - A x‖₂ / ‖b‖₂.
    relative: Vec<f64>,
}

/// Conditions of an iteration's start and end.
struct Run<'a> {
    /// Norms that residuals are compared with.
    norms: &'a [f64],
    tolerance: f64,
    most: usize,
    /// The column whose spectrum is taken; that with the most to do, if none is named.
    watched: Option<usize>,
    /// Whether it ends as soon as it foresees more iterations than `most`, by the residual reached.
    foresees: bool,
}

impl<'a> Batch<'a> {
    /// x = 0.
    pub fn new(system: System<'a>, b: &'a NodeFields, columns: Range<usize>) -> Batch<'a> {
        let zeros = || NodeFields::zeros(b.nodes, padded(columns.len()));
        let mut r = zeros();
        take(b, &columns, &mut r);
        Batch {
            system,
            b,
            x: zeros(),
            r,
            p: zeros(),
            q: zeros(),
            workspace: system.multigrid.workspace(padded(columns.len())),
            spectrum: Spectrum::default(),
            iterations: 0,
            slow: None,
            relative: Vec::new(),
            columns,
        }
    }

    /// The number of iterations since the start.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// True residuals ‖b - A x‖₂ / ‖b‖₂ of its columns.
    pub fn relative_residuals(&self) -> &[f64] {
        &self.relative[..self.columns.len()]
    }

    /// x, with the columns of zeros.
    pub fn solution(&self) -> &NodeFields {
        &self.x
    }

    /// Iterates to the tolerance. Errors where a column's true residual stays above it.
    pub fn converge(&mut self, progress: &dyn Progress) -> Result<(), SolveError> {
        let System { tolerance, max_iterations, .. } = self.system;
        let mut done = 0;
        let norms = self.r.norms();
        let mut before = f64::INFINITY;
        for _ in 0..=RESTARTS {
            let run = Run {
                norms: &norms,
                tolerance,
                most: max_iterations - self.iterations,
                watched: None,
                foresees: true,
            };
            self.iterations += self.iterate(&run, &mut |worst| {
                let way = (1000.0 * (worst.max(tolerance).ln() / tolerance.ln())) as u64;
                progress.advance(way.saturating_sub(done));
                done = done.max(way);
            });
            if let Some((number, residual, expected)) = self.slow {
                let (column, iterations) = (self.columns.start + number, self.iterations);
                return Err(SolveError::Slow { column, residual, limit: tolerance, iterations, expected });
            }
            self.system.a.multiply(&self.x, &mut self.q);
            take(self.b, &self.columns, &mut self.r);
            self.r.data.par_iter_mut().zip(&self.q.data).with_min_len(4096).for_each(|(r, q)| *r -= q);
            let left = self.r.norms();
            self.relative =
                left.iter().zip(&norms).map(|(r, b)| if *b == 0.0 { 0.0 } else { r / b }).collect();
            let worst = self.relative.iter().copied().fold(0.0, f64::max);
            if worst <= tolerance || worst > 0.5 * before || self.iterations >= max_iterations {
                break;
            }
            before = worst;
        }
        let is_above = |residual: &f64| *residual > tolerance || residual.is_nan();
        if !self.relative.iter().any(is_above) {
            return Ok(());
        }
        // Where a stiff part floats, rounding alone leaves a large residual on it, which moves it by nothing; the forward
        // error is judged afterwards.
        let errors = self.estimated_errors();
        take(self.b, &self.columns, &mut self.p);
        let is_refused = |&c: &usize| {
            is_above(&self.relative[c])
                && is_above(&errors[c])
                && Column::new(self.system.a, &self.x, &self.p, &self.r, c).normwise_error() > ROUNDING
        };
        let refused = (0..self.columns.len()).find(is_refused);
        refused.map_or(Ok(()), |number| {
            let (column, residual) = (self.columns.start + number, self.relative[number]);
            Err(SolveError::Residual { column, residual, limit: tolerance, iterations: self.iterations })
        })
    }

    /// Estimate of ‖x̂ - x‖_A / ‖x̂‖_A of every column, from rᵀM⁻¹r.
    fn estimated_errors(&mut self) -> Vec<f64> {
        let norms = self.r.norms();
        let squares = self.preconditioned_squares(&norms);
        let least = self.least();
        let error =
            |(square, energy): (f64, f64)| if square == 0.0 { 0.0 } else { (square / least / energy).sqrt() };
        squares.into_iter().zip(self.energies()).map(error).collect()
    }

    /// The least eigenvalue of M⁻¹A, as far as it was seen.
    fn least(&self) -> f64 {
        self.spectrum.ends.map_or(1.0, |[low, _]| low.min(1.0))
    }

    /// The largest ‖x̂ - x‖_A / ‖x̂‖_A of all columns. The residual r = b - A x̂ is no measure where A is ill-conditioned,
    /// and the least eigenvalue λ of M⁻¹A, with M the multigrid preconditioner, is seen only once the iteration has
    /// converged; so the errors d are solved for, A d = r, to a part of [`PROBE`], and what is left, ρ = r - A d, is
    /// bounded:
    ///
    /// ```text
    /// ‖x̂ - x‖_A ≤ ‖d‖_A + (ρᵀM⁻¹ρ / λ)^½
    /// ```
    ///
    /// (Axelsson and Kaporin, Numer. Linear Algebra Appl. 8, 2001, 265-286: ρᵀA⁻¹ρ ≤ ρᵀM⁻¹ρ / λ.) λ is an estimate from
    /// above, which these iterations improve. The batch is of no use afterwards: x is the error then.
    pub fn energy_error(&mut self) -> f64 {
        let norms = self.r.norms();
        if norms.iter().all(|norm| *norm == 0.0) {
            return 0.0;
        }
        let energies = self.energies();
        let parts = self.preconditioned_squares(&norms).into_iter().zip(&energies);
        let parts = parts.map(|(rz, energy)| rz / energy).enumerate();
        let (watched, _) =
            parts.fold((0, 0.0), |most, (c, part)| if part > most.1 { (c, part) } else { most });
        self.x.data.fill(0.0);
        // Two digits take fewer iterations than all; where they do not, the bound says so.
        let most = self.iterations.max(PROBE_ITERATIONS);
        self.iterate(
            &Run { norms: &norms, tolerance: PROBE, most, watched: Some(watched), foresees: false },
            &mut |_| {},
        );
        let known = self.energies();
        let left = self.r.norms();
        let unknown = self.preconditioned_squares(&left);
        let least = self.least();
        let mut worst = 0.0;
        for c in (0..norms.len()).filter(|&c| norms[c] > 0.0) {
            let error = (known[c].sqrt() + (unknown[c] / least).sqrt()) / energies[c].sqrt();
            if error > worst || error.is_nan() {
                worst = error;
            }
        }
        worst
    }

    /// xᵀA x of every column.
    fn energies(&mut self) -> Vec<f64> {
        self.system.a.multiply(&self.x, &mut self.q);
        self.x.dots(&self.q)
    }

    /// rᵀM⁻¹r of every column, whose norms of r are these.
    fn preconditioned_squares(&mut self, norms: &[f64]) -> Vec<f64> {
        self.precondition(norms);
        self.dots_with_z(norms).0
    }

    /// z = M⁻¹ r, in parts of the norms of r, left in the workspace.
    fn precondition(&mut self, norms: &[f64]) {
        let m = self.r.columns;
        let parts: Vec<f64> = norms.iter().map(|norm| if *norm > 0.0 { 1.0 / norm } else { 0.0 }).collect();
        let rows = self.workspace.fine.b.par_chunks_exact_mut(m).zip(self.r.data.par_chunks_exact(m));
        rows.with_min_len(1024).for_each(|(b, r)| {
            for ((b, r), part) in b.iter_mut().zip(r).zip(&parts) {
                *b = (r * part) as f32;
            }
        });
        self.system.multigrid.apply(&mut self.workspace);
    }

    /// rᵀz and qᵀz of every column.
    fn dots_with_z(&self, norms: &[f64]) -> (Vec<f64>, Vec<f64>) {
        const ROWS: usize = 4096;
        let m = self.r.columns;
        let sums: Vec<[Vec<f64>; 2]> = self
            .r
            .data
            .par_chunks(ROWS * m)
            .zip(self.q.data.par_chunks(ROWS * m))
            .zip(self.workspace.fine.x.par_chunks(ROWS * m))
            .map(|((r, q), z)| {
                let mut sums = [vec![0.0; m], vec![0.0; m]];
                for ((r, q), z) in r.chunks_exact(m).zip(q.chunks_exact(m)).zip(z.chunks_exact(m)) {
                    let [rz, qz] = &mut sums;
                    for c in 0..m {
                        let z = f64::from(z[c]);
                        rz[c] += r[c] * z;
                        qz[c] += q[c] * z;
                    }
                }
                sums
            })
            .collect();
        let total = |which: usize| -> Vec<f64> {
            let scale = self.system.multigrid.scale();
            (0..m).map(|c| scale * norms[c] * sums.iter().map(|sums| sums[which][c]).sum::<f64>()).collect()
        };
        (total(0), total(1))
    }

    /// Iterates until the recurrence's residual of every column is below half the tolerance, and returns the number of
    /// iterations. A column that has converged is no longer changed. β is that of Polak and Ribière, since the
    /// preconditioner is rounded to f32 (Notay, SIAM J. Sci. Comput. 22, 2000, 1444-1460).
    fn iterate(&mut self, run: &Run<'_>, told: &mut dyn FnMut(f64)) -> usize {
        let m = self.r.columns;
        let scale = self.system.multigrid.scale();
        let mut before: Option<(Vec<f64>, Vec<f64>)> = None;
        let mut coefficients: Vec<[f64; 2]> = Vec::new();
        let mut watched = run.watched;
        let mut norms = self.r.norms();
        let mut iteration = 0;
        loop {
            let relative: Vec<f64> =
                norms.iter().zip(run.norms).map(|(r, b)| if *b == 0.0 { 0.0 } else { r / b }).collect();
            let active: Vec<bool> = relative.iter().map(|r| *r > 0.5 * run.tolerance).collect();
            told(relative.iter().copied().fold(0.0, f64::max));
            if !active.contains(&true) || iteration == run.most {
                break;
            }
            if run.foresees && iteration >= self.system.sight {
                let column = (0..m).fold(0, |worst, c| if relative[c] > relative[worst] { c } else { worst });
                let rate = -relative[column].ln() / iteration as f64;
                let expected = if rate > 0.0 { -(0.5 * run.tolerance).ln() / rate } else { f64::INFINITY };
                if expected > run.most as f64 {
                    self.slow = Some((column, relative[column], expected));
                    break;
                }
            }
            self.precondition(&norms);
            let (rz, qz) = self.dots_with_z(&norms);
            let slowest = *watched
                .get_or_insert_with(|| (0..m).fold(0, |most, c| if rz[c] > rz[most] { c } else { most }));
            let beta: Vec<f64> = match &before {
                // pᵀr = 0, so that zᵀ(r - r_before) = -α zᵀq.
                Some((rz, alpha)) => (0..m)
                    .map(|c| if rz[c] > 0.0 { (-alpha[c] * qz[c] / rz[c]).max(0.0) } else { 0.0 })
                    .collect(),
                None => vec![0.0; m],
            };
            if let (Some(last), true) = (coefficients.last_mut(), active[slowest]) {
                last[1] = beta[slowest];
            }
            let parts: Vec<f64> = norms.iter().map(|norm| scale * norm).collect();
            let rows = self.p.data.par_chunks_exact_mut(m).zip(self.workspace.fine.x.par_chunks_exact(m));
            rows.with_min_len(1024).for_each(|(p, z)| {
                for c in 0..m {
                    p[c] = parts[c] * f64::from(z[c]) + beta[c] * p[c];
                }
            });
            self.system.a.multiply(&self.p, &mut self.q);
            let pq = self.p.dots(&self.q);
            let alpha: Vec<f64> =
                (0..m).map(|c| if active[c] && pq[c] > 0.0 { rz[c] / pq[c] } else { 0.0 }).collect();
            norms = self.advance(&alpha);
            // Once the column is left as it is, it tells nothing more.
            if alpha[slowest] > 0.0 && coefficients.len() == iteration {
                coefficients.push([alpha[slowest], 0.0]);
            }
            before = Some((rz, alpha));
            iteration += 1;
        }
        self.spectrum.widen(&coefficients);
        iteration
    }

    /// x += α p, r -= α q; the norms of r.
    fn advance(&mut self, alpha: &[f64]) -> Vec<f64> {
        const ROWS: usize = 4096;
        let m = alpha.len();
        let length = ROWS * m;
        let squares: Vec<Vec<f64>> =
            (self.x.data.par_chunks_mut(length).zip(self.r.data.par_chunks_mut(length)))
                .zip(self.p.data.par_chunks(length).zip(self.q.data.par_chunks(length)))
                .map(|((x, r), (p, q))| {
                    let mut squares = vec![0.0; m];
                    let rows = x.chunks_exact_mut(m).zip(r.chunks_exact_mut(m));
                    for ((x, r), (p, q)) in rows.zip(p.chunks_exact(m).zip(q.chunks_exact(m))) {
                        for c in 0..m {
                            x[c] += alpha[c] * p[c];
                            r[c] -= alpha[c] * q[c];
                            squares[c] += r[c] * r[c];
                        }
                    }
                    squares
                })
                .collect();
        (0..m).map(|c| squares.iter().map(|squares| squares[c]).sum::<f64>().sqrt()).collect()
    }
}

/// Takes some columns of `fields`.
fn take(fields: &NodeFields, columns: &Range<usize>, part: &mut NodeFields) {
    let rows = part.data.par_chunks_exact_mut(part.columns).zip(fields.data.par_chunks_exact(fields.columns));
    rows.with_min_len(1024)
        .for_each(|(to, from)| to[..columns.len()].copy_from_slice(&from[columns.clone()]));
}

/// The ends of the preconditioned matrix' spectrum as the iterations saw them, from inside.
#[derive(Clone, Copy, Default)]
pub struct Spectrum {
    pub ends: Option<[f64; 2]>,
}

impl Spectrum {
    /// Takes the coefficients α, β of one run of iterations: conjugate gradients are Lanczos in disguise, and those of one
    /// run make one tridiagonal matrix T (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., section 6.7.3).
    pub fn widen(&mut self, coefficients: &[[f64; 2]]) {
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
