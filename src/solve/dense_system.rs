//! A dense symmetric system, some of whose unknowns are prescribed.
//!
//! In: the lower half of a symmetric matrix, its free unknowns first, and what the others are. Out: the free ones,
//! x = -A⁻¹ B b, with the figures that judge them. The factor takes the place of the lower half; the upper half keeps the matrix, so
//! that residuals are those of the matrix itself.

use super::condition::{ROUNDOFF, Solved};
use super::dense::{PANEL, factorize, update};
use super::error::SolveError;
use super::solver::{Conditioning, Method, SolveResult, SolveStats};
use crate::base::progress::Progress;
use crate::fem::NodeFields;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{MatMut, MatRef, Par};
use rayon::prelude::*;
use std::time::Instant;

/// Columns that are mirrored together.
const BLOCK: usize = 64;
/// Number of parts into which a product is cut, on however many threads.
const PARTS: usize = 16;

/// The first `eliminated` unknowns of a symmetric matrix, factorised: L, and below it what they take from the `kept` ones.
pub struct Elimination {
    eliminated: usize,
    kept: usize,
    /// Column after column; only the first `eliminated` ones are used.
    numbers: Vec<f64>,
}

impl Elimination {
    /// `numbers`: the lower half of at least the first `eliminated` columns, each of `eliminated + kept` rows. Errors where it is
    /// not positive definite.
    pub fn from_numbers(
        mut numbers: Vec<f64>,
        eliminated: usize,
        kept: usize,
    ) -> Result<Elimination, SolveError> {
        let own = &mut numbers[..eliminated * (eliminated + kept)];
        factorize(own, eliminated, kept, true)
            .map_err(|pivot| SolveError::NotPositiveDefinite { unknowns: eliminated, pivot })?;
        Ok(Elimination { eliminated, kept, numbers })
    }

    fn own(&self) -> &[f64] {
        &self.numbers[..self.eliminated * (self.eliminated + self.kept)]
    }

    /// The lower half of B L⁻ᵀ L⁻¹ Bᵀ over the kept unknowns, with B the rows below.
    pub fn taken(&self) -> Vec<f64> {
        let mut numbers = vec![0.0; self.kept * self.kept];
        update(self.own(), self.eliminated, self.kept, &mut numbers, true);
        numbers.par_iter_mut().for_each(|number| *number = -*number);
        numbers
    }

    fn lower(&self) -> MatRef<'_, f64> {
        let rows = self.eliminated + self.kept;
        MatRef::from_column_major_slice(self.own(), rows, self.eliminated).subrows(0, self.eliminated)
    }

    /// L⁻¹ Bᵀ x for x over the kept unknowns: `columns` of each in a row.
    pub fn carried(&self, x: &[f64], columns: usize) -> Vec<f64> {
        let rows = self.eliminated + self.kept;
        let of = |own: &[f64], out: &mut [f64]| {
            for (b, x) in own[self.eliminated..].iter().zip(x.chunks_exact(columns)) {
                out.iter_mut().zip(x).for_each(|(out, x)| *out += b * x);
            }
        };
        let mut out = vec![0.0; self.eliminated * columns];
        let own = self.own().par_chunks(rows);
        out.par_chunks_mut(columns).zip(own).for_each(|(out, own)| of(own, out));
        out
    }

    /// x becomes L⁻ᵀ x: `columns` of each unknown in a row.
    pub fn backward(&self, x: &mut [f64], columns: usize) {
        let x = MatMut::from_row_major_slice_mut(x, self.eliminated, columns);
        solve_upper_triangular_in_place(self.lower().transpose(), x, Par::Seq);
    }

    fn forward(&self, x: &mut [f64], columns: usize) {
        let x = MatMut::from_row_major_slice_mut(x, self.eliminated, columns);
        solve_lower_triangular_in_place(self.lower(), x, Par::Seq);
    }
}

/// A dense matrix with its factor.
pub struct DenseSystem {
    free: usize,
    size: usize,
    elimination: Elimination,
    diagonal: Vec<f64>,
    factor_s: f64,
}

impl DenseSystem {
    /// `matrix`: the lower half of all `size` columns, the `free` unknowns first.
    pub fn new(
        mut matrix: Vec<f64>,
        size: usize,
        free: usize,
        progress: &dyn Progress,
    ) -> Result<DenseSystem, SolveError> {
        progress.begin("factor", 0);
        let started = Instant::now();
        mirror(&mut matrix, size);
        let diagonal = (0..size).map(|i| matrix[i * size + i]).collect();
        // The kernel writes above the diagonal, too, within a panel.
        let panel = |j: usize| j * size + j / PANEL * PANEL..j * size + j;
        let above: Vec<f64> = (0..free).flat_map(|j| &matrix[panel(j)]).copied().collect();
        let mut elimination = Elimination::from_numbers(matrix, free, size - free)?;
        let mut above = above.as_slice();
        for j in 0..free {
            let own = &mut elimination.numbers[panel(j)];
            let (before, rest) = above.split_at(own.len());
            own.copy_from_slice(before);
            above = rest;
        }
        progress.end();
        Ok(DenseSystem { free, size, elimination, diagonal, factor_s: started.elapsed().as_secs_f64() })
    }

    /// The numbers of column `j` above the diagonal.
    fn above(&self, j: usize) -> &[f64] {
        &self.elimination.numbers[j * self.size..][..j]
    }

    /// The matrix, each of its numbers mapped, times x with `columns` of each unknown in a row: one pass over the numbers, in parts
    /// whose results are added in their order.
    fn product(&self, x: &[f64], columns: usize, map: impl Fn(f64) -> f64 + Sync) -> Vec<f64> {
        let start = |part: usize| (self.size as f64 * (part as f64 / PARTS as f64).sqrt()) as usize;
        let of = |part: usize| {
            let (first, end) = (start(part), if part + 1 == PARTS { self.size } else { start(part + 1) });
            let mut out = vec![0.0; end * columns];
            for j in first..end {
                let (before, rest) = out.split_at_mut(j * columns);
                let (own, above) = (&mut rest[..columns], self.above(j));
                let (at, diagonal) = (&x[j * columns..][..columns], map(self.diagonal[j]));
                own.iter_mut().zip(at).for_each(|(own, x)| *own += diagonal * x);
                if columns == 1 {
                    own[0] += row_and_column(above, x, at[0], before, &map);
                    continue;
                }
                for ((a, x), out) in
                    above.iter().zip(x.chunks_exact(columns)).zip(before.chunks_exact_mut(columns))
                {
                    let a = map(*a);
                    own.iter_mut().zip(x).for_each(|(own, x)| *own += a * x);
                    out.iter_mut().zip(at).for_each(|(out, at)| *out += a * at);
                }
            }
            out
        };
        let parts: Vec<Vec<f64>> = (0..PARTS).into_par_iter().map(of).collect();
        let mut out = vec![0.0; self.size * columns];
        for part in parts {
            out.iter_mut().zip(part).for_each(|(out, part)| *out += part);
        }
        out
    }

    /// The matrix times `x`.
    pub fn multiply(&self, x: &NodeFields) -> NodeFields {
        NodeFields { data: self.product(&x.data, x.columns, |a| a), ..x.clone() }
    }

    /// The free rows of `fields`, which are ignored, become those that leave no force on them; the others stay. How exact they
    /// are is in the figures.
    pub fn solve_and_judge(&self, mut fields: NodeFields, progress: &dyn Progress) -> SolveResult {
        let started = Instant::now();
        let (columns, own) = (fields.columns, self.free * fields.columns);
        progress.begin("solves", 0);
        fields.data[..own].fill(0.0);
        let mut right = self.multiply(&fields).data;
        right.truncate(own);
        right.iter_mut().for_each(|value| *value = -*value);
        let mut left = right.clone();
        // The second pass takes the rounding of the first away.
        for _ in 0..2 {
            self.elimination.forward(&mut left, columns);
            self.elimination.backward(&mut left, columns);
            fields.data.iter_mut().zip(&left).for_each(|(value, more)| *value += more);
            left = self.multiply(&fields).data;
            left.truncate(own);
            left.iter_mut().for_each(|value| *value = -*value);
        }
        let norms = |data: Vec<f64>| NodeFields { nodes: self.free / 3, columns, data }.norms();
        let (rest, whole) = (norms(left.clone()), norms(right));
        let part = |(rest, whole): (&f64, &f64)| if *whole == 0.0 { 0.0 } else { rest / whole };
        let residuals: Vec<f64> = rest.iter().zip(&whole).map(part).collect();
        progress.end();
        let mut stats = SolveStats {
            method: &DENSE,
            unknowns: self.free,
            columns,
            factor_s: self.factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            factor_entries: self.free * (self.free + 1) / 2,
            residuals,
            ..SolveStats::default()
        };
        if self.free > 0 {
            stats.conditioning = Some(self.judge(&fields, &left, &stats.residuals)?);
        }
        Ok((fields, stats))
    }

    /// Judges a solution like those of sparse matrices: the condition of A scaled by its diagonal, and a bound on the error of
    /// the column with the largest residual.
    fn judge(
        &self,
        fields: &NodeFields,
        rest: &[f64],
        residuals: &[f64],
    ) -> Result<Conditioning, SolveError> {
        let started = Instant::now();
        let columns = fields.columns;
        let inverse = |b: &NodeFields| {
            let mut x = b.clone();
            self.elimination.forward(&mut x.data, b.columns);
            self.elimination.backward(&mut x.data, b.columns);
            Ok(x)
        };
        let multiply = |block: &NodeFields| {
            let mut all = block.data.clone();
            all.resize(self.size, 0.0);
            let mut data = self.product(&all, 1, |a| a);
            data.truncate(self.free);
            NodeFields { data, ..*block }
        };
        let (nodes, own) = (self.free / 3, &fields.data[..self.free * columns]);
        let free = NodeFields { nodes, columns, data: own.to_vec() };
        let worst = (0..columns).fold(0, |worst, c| if residuals[c] > residuals[worst] { c } else { worst });
        let column: Vec<f64> = fields.data.iter().skip(worst).step_by(columns).copied().collect();
        let sizes = self.product(&column.iter().map(|x| x.abs()).collect::<Vec<_>>(), 1, f64::abs);
        let gamma = (self.size as f64 + 1.0) * ROUNDOFF;
        let rest = rest.iter().skip(worst).step_by(columns.max(1));
        let solved = Solved {
            multiply: &multiply,
            inverse: &inverse,
            scale: self.diagonal[..self.free].iter().map(|d| d.sqrt()).collect(),
            x: &free,
            doubts: rest.zip(&sizes).map(|(r, size)| r.abs() + gamma * size).collect(),
            size: column.iter().fold(0.0, |most: f64, x| most.max(x.abs())),
        };
        let (condition, forward_error) = solved.estimates()?;
        Ok(Conditioning {
            scaled_condition: Some(condition),
            forward_error,
            seconds: started.elapsed().as_secs_f64(),
        })
    }
}

/// Σ map(a) x, eight sums side by side, while `out` gets map(a) `own` added.
fn row_and_column(a: &[f64], x: &[f64], own: f64, out: &mut [f64], map: impl Fn(f64) -> f64) -> f64 {
    let mut sums = [0.0; 8];
    for ((a, x), out) in a.chunks(8).zip(x.chunks(8)).zip(out.chunks_mut(8)) {
        for (((sum, a), x), out) in sums.iter_mut().zip(a).zip(x).zip(out) {
            let a = map(*a);
            *sum += a * x;
            *out += a * own;
        }
    }
    sums.iter().sum()
}

/// Copies the lower half of a square matrix to the upper one.
fn mirror(matrix: &mut [f64], size: usize) {
    for first in (0..size).step_by(BLOCK) {
        let end = (first + BLOCK).min(size);
        let (left, right) = matrix.split_at_mut(end * size);
        for j in first..end {
            for i in first..j {
                left[j * size + i] = left[i * size + j];
            }
        }
        let left = &*left;
        right.par_chunks_mut(size.max(1)).enumerate().for_each(|(at, column)| {
            let row = end + at;
            for (i, value) in (first..end).zip(&mut column[first..end]) {
                *value = left[i * size + row];
            }
        });
    }
}

/// The method of such a system, for tables.
pub const DENSE: Method = Method {
    name: "dense cholesky",
    is_direct: true,
    keeps_factor: false,
    bounds_error: true,
    remedy: "look for slivers and for parts of the surface that nearly touch (`greenstage check`)",
    factor_number: 8,
    least_seconds: None,
    analyse: super::cholesky::CHOLESKY.analyse,
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;

    /// (i, j) of a matrix that is positive definite, with 5 unknowns that are prescribed.
    fn entry(i: usize, j: usize) -> f64 {
        let away = i.abs_diff(j) as f64;
        (-(0.3 * away)).exp() * (1.0 + 0.2 * ((i + j) as f64).sin()) + if i == j { 2.0 } else { 0.0 }
    }

    /// The remainder is that of the matrix itself, whose upper half the factor must not touch.
    #[test]
    fn free_unknowns_are_without_force_and_others_as_they_were() {
        let (size, free, columns) = (501, 486, 4);
        let lower =
            (0..size * size).map(|k| if k % size >= k / size { entry(k % size, k / size) } else { 0.0 });
        let system = DenseSystem::new(lower.collect(), size, free, &Silent).unwrap();
        for j in (0..size).step_by(7) {
            for (i, value) in system.above(j).iter().enumerate() {
                assert_eq!(*value, entry(j, i), "{i}, {j}");
            }
        }
        let data: Vec<f64> = (0..size * columns).map(|k| (k as f64 * 0.37).cos()).collect();
        let given = NodeFields { nodes: size / 3, columns, data };
        let (solved, stats) = system.solve_and_judge(given.clone(), &Silent).unwrap();
        assert_eq!(solved.data[free * columns..], given.data[free * columns..]);
        for i in 0..free {
            for c in 0..columns {
                let force: f64 = (0..size).map(|j| entry(i.max(j), i.min(j)) * solved.row(j)[c]).sum();
                assert!(force.abs() < 1e-12, "{i}, {c}: {force:e}");
            }
        }
        // One column has loops of its own.
        let (all, one) = (system.product(&solved.data, columns, f64::abs), |c: usize| {
            let column: Vec<f64> = solved.data.iter().skip(c).step_by(columns).copied().collect();
            system.product(&column, 1, f64::abs)
        });
        for (row, value) in one(2).iter().enumerate() {
            assert!((all[row * columns + 2] - value).abs() < 1e-12, "{row}");
        }
        let conditioning = stats.conditioning.unwrap();
        assert!(stats.worst_residual() < 1e-14 && conditioning.forward_error < 1e-10, "{conditioning:?}");
        assert!((2.0..30.0).contains(&conditioning.scaled_condition.unwrap()), "{conditioning:?}");
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_is_refused() {
        let lower = vec![1.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let error = DenseSystem::new(lower, 3, 3, &Silent).err().unwrap().to_string();
        assert!(error.contains("3 unknowns is not positive definite (pivot 1)"), "{error}");
    }
}
