//! Bounds the distance of a solution from the exact one: the condition number of A and a bound on the forward error.
//!
//! In: A, ways to apply A and A⁻¹, and a solution with its residual. Out: two numbers for the closing table and the
//! .green file. Both are estimated together, by three solves with four columns: these take little longer than as many with one,
//! since a solve reads the whole factor.

use super::error::SolveError;
use super::residual::Column;
use crate::base::random::Random;
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::DMatrix;

/// A⁻¹ on some columns.
pub type Inverse<'a> = &'a (dyn Fn(&NodeFields) -> Result<NodeFields, SolveError> + Sync);

/// Columns of each of the two estimates that are solved together.
const BLOCK: usize = 2;
/// Steps on A, with one column, after which its largest eigenvalue is known to about ten per cent, from below.
const STEPS: usize = 12;
/// Solves: steps on A⁻¹, and for the 1-norm estimator two rounds, of which the last needs one alone.
const SOLVES: usize = 3;
/// Unit roundoff of f64.
pub(super) const ROUNDOFF: f64 = 1.1e-16;

/// A system that was solved, as its estimates need it.
pub(super) struct Solved<'a> {
    /// A times a block.
    pub(super) multiply: &'a (dyn Fn(&NodeFields) -> NodeFields + Sync),
    pub(super) inverse: Inverse<'a>,
    /// The roots of A's diagonal.
    pub(super) scale: Vec<f64>,
    pub(super) x: &'a NodeFields,
    /// F of [`doubts`] for the column whose error is bounded, and its largest number.
    pub(super) doubts: Vec<f64>,
    pub(super) size: f64,
}

impl Solved<'_> {
    /// κ₂(S A S) with S = diag(A)^-1/2, and the bound of [`doubts`] on the forward error of one column of the solutions, with
    /// A alone on another thread.
    ///
    /// The condition number is found by Rayleigh and Ritz on Krylov spaces (Golub and Van Loan, Matrix Computations, 4th ed.,
    /// sections 10.1 and 10.3.6), an estimate from below. That of A⁻¹ begins with sums of the solutions, which are rich in the
    /// softest motions: A⁻¹ was applied to them already. Scaling by the diagonal takes out what materials and element sizes do
    /// alone, and loses no digit in Cholesky (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 10.1.1).
    pub(super) fn estimates(&self) -> Result<(f64, f64), SolveError> {
        let largest_of_a = || {
            let mut krylov = Krylov::new(random(self.x.nodes, 1));
            for _ in 0..STEPS {
                let Some(block) = krylov.next() else { break };
                let product = (self.multiply)(&scaled(block, &self.scale, -1));
                krylov.take(&scaled(product, &self.scale, -1));
            }
            krylov.largest()
        };
        let of_inverse = || {
            let mut krylov = Krylov::new(scaled(sums(self.x), &self.scale, 1));
            let mut norm = InverseNorm::new(self.doubts.clone());
            for _ in 0..SOLVES {
                let (steps, rounds) = (krylov.next(), norm.next());
                let split = steps.as_ref().map_or(0, |steps| steps.columns);
                let all = steps.map_or(Vec::new(), |steps| columns_of(&scaled(steps, &self.scale, 1)));
                let solved = columns_of(&(self.inverse)(&beside(&[all, columns_of(&rounds)].concat()))?);
                if split > 0 {
                    krylov.take(&scaled(beside(&solved[..split]), &self.scale, 1));
                }
                norm.take(beside(&solved[split..]));
            }
            Ok::<_, SolveError>((krylov.largest(), norm.best))
        };
        let (largest, of_inverse) = rayon::join(largest_of_a, of_inverse);
        let (inverse_smallest, error) = of_inverse?;
        Ok((largest * inverse_smallest, if self.size == 0.0 { 0.0 } else { error / self.size }))
    }
}

/// [`Solved::estimates`] of a sparse matrix.
pub fn estimates(
    a: &StiffnessMatrix,
    x: &NodeFields,
    column: &Column,
    inverse: Inverse<'_>,
) -> Result<(f64, f64), SolveError> {
    let multiply = |block: &NodeFields| {
        let mut product = NodeFields::zeros(block.nodes, block.columns);
        a.multiply(block, &mut product);
        product
    };
    let roots = |block: &nalgebra::Matrix3<f64>| block.diagonal().map(f64::sqrt);
    let scale = a.diagonal.iter().flat_map(|block| <[f64; 3]>::from(roots(block))).collect();
    let size = column.x.data.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    Solved { multiply: &multiply, inverse, scale, x, doubts: doubts(a, column), size }.estimates()
}

/// Rows of the fields times a power of the scale of each.
fn scaled(mut fields: NodeFields, scale: &[f64], power: i32) -> NodeFields {
    let columns = fields.columns.max(1);
    for (row, s) in fields.data.chunks_exact_mut(columns).zip(scale) {
        let factor = s.powi(power);
        row.iter_mut().for_each(|x| *x *= factor);
    }
    fields
}

/// A block of sums of all columns with random factors.
fn sums(fields: &NodeFields) -> NodeFields {
    let mut sums = NodeFields::zeros(fields.nodes, BLOCK);
    let norms = fields.norms();
    let mut random = Random::default();
    let factors: Vec<[f64; BLOCK]> = norms
        .iter()
        .map(|norm| std::array::from_fn(|_| random.draw() / norm.max(f64::MIN_POSITIVE)))
        .collect();
    let rows = sums.data.chunks_exact_mut(BLOCK).zip(fields.data.chunks_exact(fields.columns.max(1)));
    for (sum, row) in rows {
        for (value, factors) in row.iter().zip(&factors) {
            sum.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor * value);
        }
    }
    sums
}

/// The Krylov space of a symmetric matrix from a block of columns, as it grows: an orthonormal basis, and what the matrix makes
/// of it.
struct Krylov {
    basis: Vec<Vec<f64>>,
    images: Vec<Vec<f64>>,
    block: Vec<Vec<f64>>,
}

impl Krylov {
    fn new(start: NodeFields) -> Krylov {
        Krylov { basis: Vec::new(), images: Vec::new(), block: columns_of(&start) }
    }

    /// The columns by which the space grows, to be multiplied; `None` where it is invariant.
    fn next(&mut self) -> Option<NodeFields> {
        let first = self.basis.len();
        for mut column in std::mem::take(&mut self.block) {
            let (before, rows) = (norm(&column), column.len());
            // Twice, for the digits that cancel.
            for old in self.basis.iter().chain(&self.basis) {
                let along = dot(&column, old);
                column.iter_mut().zip(old).for_each(|(value, old)| *value -= along * old);
            }
            let rest = norm(&column);
            // What is left of a column that depends on the others is rounding.
            if rest > 1e-10 * before && self.basis.len() < rows {
                column.iter_mut().for_each(|value| *value /= rest);
                self.basis.push(column);
            }
        }
        (self.basis.len() > first).then(|| beside(&self.basis[first..]))
    }

    fn take(&mut self, images: &NodeFields) {
        self.block = columns_of(images);
        self.images.extend(self.block.iter().cloned());
    }

    /// The largest eigenvalue on the space.
    fn largest(&self) -> f64 {
        let size = self.images.len();
        if size == 0 {
            return 0.0;
        }
        let form = DMatrix::from_fn(size, size, |i, j| dot(&self.basis[i], &self.images[j]));
        ((&form + form.transpose()) * 0.5).symmetric_eigenvalues().max()
    }
}

/// The columns, one by one.
fn columns_of(fields: &NodeFields) -> Vec<Vec<f64>> {
    let column = |c: usize| fields.data.iter().skip(c).step_by(fields.columns).copied().collect();
    (0..fields.columns).map(column).collect()
}

/// Fields with these columns beside each other.
fn beside(columns: &[Vec<f64>]) -> NodeFields {
    let rows = columns.first().map_or(0, Vec::len);
    let data = (0..rows).flat_map(|row| columns.iter().map(move |column| column[row])).collect();
    NodeFields { nodes: rows / 3, columns: columns.len(), data }
}

fn random(nodes: usize, columns: usize) -> NodeFields {
    let mut random = Random::default();
    NodeFields { nodes, columns, data: (0..3 * nodes * columns).map(|_| random.draw()).collect() }
}

/// F of a bound on max |x̂ - x| for one column x̂ with residual r = b - A x̂:
///
/// ```text
/// ‖x̂ - x‖∞ ≤ ‖ |A⁻¹| F ‖∞      F = |r| + γ (|A| |x̂| + |b|)      γ = (n + 1) 1.1e-16, n the numbers in a row of A
/// ```
///
/// (Higham, section 7.1, equation 7.31, as LAPACK's xPORFS has it): a bound that is seldom missed and mostly a hundred times too
/// large.
fn doubts(a: &StiffnessMatrix, column: &Column) -> Vec<f64> {
    let row = |node: usize| 3.0 * (1 + a.neighbours(node).count()) as f64;
    (0..3 * a.nodes())
        .map(|i| column.r.data[i].abs() + (row(i / 3) + 1.0) * ROUNDOFF * column.sizes.data[i])
        .collect()
}

/// Estimates ‖A⁻¹ F‖∞ = ‖F A⁻¹‖₁ for F = diag(`weights`) ≥ 0 and symmetric A, from below, by Hager's estimator on a block of
/// columns (Higham and Tisseur, SIAM J. Matrix Anal. Appl. 21, 2000, 1185-1201, algorithm 2.4), two rounds of it: the largest
/// of F A⁻¹ x in the 1-norm, first for x of equal and of random signs, then for the unit vectors on which the signs of the first
/// depend most.
struct InverseNorm {
    weights: Vec<f64>,
    /// The block to be multiplied with A⁻¹ next.
    x: NodeFields,
    solves: usize,
    best: f64,
}

impl InverseNorm {
    fn new(weights: Vec<f64>) -> InverseNorm {
        let rows = weights.len();
        let mut x = random(rows / 3, BLOCK);
        for row in x.data.chunks_exact_mut(BLOCK) {
            row.iter_mut().for_each(|value| *value = value.signum() / rows as f64);
            row[0] = 1.0 / rows as f64;
        }
        InverseNorm { weights, x, solves: 0, best: 0.0 }
    }

    fn next(&self) -> NodeFields {
        self.x.clone()
    }

    fn take(&mut self, solved: NodeFields) {
        self.solves += 1;
        if self.solves == 2 {
            return self.take_heights(&solved);
        }
        let mut y = solved;
        self.weigh(&mut y);
        for sum in columns_of(&y).iter().map(|column| column.iter().map(|y| y.abs()).sum::<f64>()) {
            if sum > self.best || sum.is_nan() {
                self.best = sum;
            }
        }
        y.data.iter_mut().for_each(|y| *y = 1f64.copysign(*y));
        self.weigh(&mut y);
        self.x = y;
    }

    /// Unit vectors of the rows where `z` is largest.
    fn take_heights(&mut self, z: &NodeFields) {
        let heights: Vec<f64> = z
            .data
            .chunks_exact(BLOCK)
            .map(|row| row.iter().fold(0.0, |most: f64, z| most.max(z.abs())))
            .collect();
        let mut order: Vec<usize> = (0..heights.len()).collect();
        order.select_nth_unstable_by(BLOCK, |&i, &j| heights[j].total_cmp(&heights[i]).then(i.cmp(&j)));
        self.x.data.fill(0.0);
        for (column, &row) in order[..BLOCK].iter().enumerate() {
            self.x.data[row * BLOCK + column] = 1.0;
        }
    }

    fn weigh(&self, fields: &mut NodeFields) {
        for (row, weight) in fields.data.chunks_exact_mut(BLOCK).zip(&self.weights) {
            row.iter_mut().for_each(|value| *value *= weight);
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A diagonal matrix knows its eigenvalues and its inverse.
    #[test]
    fn lanczos_finds_the_ends_of_a_known_spectrum() {
        for size in [3, 6, 30, 300] {
            let value = |i: usize| 1.0 + 99.0 * (i as f64 / (size - 1).max(1) as f64).powi(2);
            let apply = |x: NodeFields| {
                let data = x.data.iter().zip(0..).map(|(x, i)| value(i) * x).collect();
                NodeFields { data, ..x }
            };
            let mut krylov = Krylov::new(random(size / 3, 1));
            for _ in 0..STEPS {
                let Some(block) = krylov.next() else { break };
                krylov.take(&apply(block));
            }
            let largest = krylov.largest();
            let exact = value(size - 1);
            assert!(
                largest <= exact * (1.0 + 1e-12) && largest > 0.95 * exact,
                "{size}: {largest} of {exact}"
            );
        }
    }

    fn inverse_norm(inverse: &dyn Fn(&NodeFields) -> NodeFields, weights: &[f64]) -> f64 {
        let mut norm = InverseNorm::new(weights.to_vec());
        (0..SOLVES).for_each(|_| norm.take(inverse(&norm.next())));
        norm.best
    }

    #[test]
    fn the_norm_of_a_known_inverse_is_found() {
        // A⁻¹ = diag(1, 2, 3) on one node, F = diag(5, 1, 1): the largest row sum is 5.
        let inverse = |b: &NodeFields| {
            let rows = b.data.chunks(b.columns).zip([1.0, 2.0, 3.0]);
            let data = rows.flat_map(|(row, d)| row.iter().map(move |b| b * d)).collect();
            NodeFields { data, ..b.clone() }
        };
        assert_eq!(inverse_norm(&inverse, &[5.0, 1.0, 1.0]), 5.0);
    }

    /// The estimate is nearly always the norm itself, and never below half of it, for 40 matrices A = G Gᵀ with random G.
    #[test]
    fn estimates_of_norms_are_the_norms_nearly_always() {
        let (nodes, mut numbers, mut exact_ones) = (12, Random::default(), 0);
        for _ in 0..40 {
            let g = DMatrix::from_fn(3 * nodes, 3 * nodes, |_, _| numbers.draw());
            let matrix = (&g * g.transpose()).try_inverse().unwrap();
            let weights: Vec<f64> = (0..3 * nodes).map(|_| numbers.draw() + 0.6).collect();
            let inverse = |b: &NodeFields| {
                let x = &matrix * DMatrix::from_row_slice(3 * nodes, b.columns, &b.data);
                NodeFields { data: x.transpose().as_slice().to_vec(), ..b.clone() }
            };
            let row = |i: usize| -> f64 { (0..3 * nodes).map(|j| matrix[(i, j)].abs() * weights[j]).sum() };
            let exact = (0..3 * nodes).map(row).fold(0.0, f64::max);
            let estimate = inverse_norm(&inverse, &weights);
            assert!(estimate <= exact * (1.0 + 1e-9) && estimate > 0.5 * exact, "{estimate} of {exact}");
            exact_ones += usize::from(estimate > exact * (1.0 - 1e-9));
        }
        assert!(exact_ones >= 36, "{exact_ones} of 40");
    }
}
