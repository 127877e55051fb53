//! Solves L Lᵀ x = b, for all nodes or for what is asked.
//!
//! In: the numbers of L and a block of columns. Out: the block solved. A block is a matrix over all unknowns in the order
//! of elimination, row after row, so that what stands at a node stands together. A right-hand side at few nodes passes only
//! the supernodes between them and the root of the tree, and so do the rows that are asked (Gilbert and Peierls, SIAM J.
//! Sci. Stat. Comput. 9 (1988), 862-874).

use super::dense::Real;
use super::error::SolveError;
use super::supernodes::Supernodes;
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::NodeFields;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

/// Columns that one thread solves together: fewer read the factor more often, more leave threads idle. The width depends
/// on the number of columns alone, so that the bits do not depend on the number of threads.
const BLOCK_COLUMNS: std::ops::RangeInclusive<usize> = 24..=128;

pub(super) fn block_width(columns: usize) -> usize {
    (columns / 8).clamp(*BLOCK_COLUMNS.start(), *BLOCK_COLUMNS.end())
}

/// A block's scratch: numbers for so many columns.
pub(super) fn scratch(supernodes: &Supernodes, columns: usize) -> usize {
    3 * supernodes.widest() * columns
}

/// L with its pattern.
pub(super) struct Triangle<'a, T> {
    pub(super) supernodes: &'a Supernodes,
    pub(super) values: &'a [T],
}

/// Rows of a block.
fn rows<T>(numbers: &[T], columns: usize) -> MatRef<'_, T> {
    let count = numbers.len() / columns;
    if columns == 1 {
        MatRef::from_column_major_slice(numbers, count, columns)
    } else {
        MatRef::from_row_major_slice(numbers, count, columns)
    }
}

fn rows_mut<T>(numbers: &mut [T], columns: usize) -> MatMut<'_, T> {
    let count = numbers.len() / columns;
    if columns == 1 {
        MatMut::from_column_major_slice_mut(numbers, count, columns)
    } else {
        MatMut::from_row_major_slice_mut(numbers, count, columns)
    }
}

impl<T: Real> Triangle<'_, T> {
    /// The square part and the part below it of a supernode's columns.
    fn parts(&self, s: usize) -> (MatRef<'_, T>, MatRef<'_, T>) {
        let (n, m) = (3 * self.supernodes.own(s).len(), 3 * self.supernodes.below(s).len());
        MatRef::from_column_major_slice(&self.values[self.supernodes.values(s)], n + m, n).split_at_row(n)
    }

    /// x ← L⁻¹ x, through these supernodes, ascending; x is zero at all others.
    pub(super) fn forward(
        &self,
        x: &mut [T],
        columns: usize,
        scratch: &mut [T],
        supernodes: impl Iterator<Item = usize>,
    ) {
        let node = 3 * columns;
        for s in supernodes {
            let (top, bottom) = self.parts(s);
            let (own, below) = (self.supernodes.own(s), self.supernodes.below(s));
            let mut xs = rows_mut(&mut x[node * own.start..node * own.end], columns);
            solve_lower_triangular_in_place(top, xs.as_mut(), Par::Seq);
            let rest = &mut scratch[..node * below.len()];
            if !below.is_empty() {
                matmul(rows_mut(rest, columns), Accum::Replace, bottom, xs.as_ref(), T::of(1.0), Par::Seq);
            }
            for (part, &row) in rest.chunks_exact(node).zip(below) {
                let out = &mut x[node * row as usize..][..node];
                out.iter_mut().zip(part).for_each(|(out, part)| *out -= *part);
            }
        }
    }

    /// x ← L⁻ᵀ x at these supernodes, descending; all above them are among them or done.
    pub(super) fn backward(
        &self,
        x: &mut [T],
        columns: usize,
        scratch: &mut [T],
        supernodes: impl Iterator<Item = usize>,
    ) {
        let node = 3 * columns;
        for s in supernodes {
            let (top, bottom) = self.parts(s);
            let (own, below) = (self.supernodes.own(s), self.supernodes.below(s));
            let rest = &mut scratch[..node * below.len()];
            for (part, &row) in rest.chunks_exact_mut(node).zip(below) {
                part.copy_from_slice(&x[node * row as usize..][..node]);
            }
            let mut xs = rows_mut(&mut x[node * own.start..node * own.end], columns);
            if !below.is_empty() {
                matmul(
                    xs.as_mut(),
                    Accum::Add,
                    bottom.transpose(),
                    rows(rest, columns),
                    T::of(-1.0),
                    Par::Seq,
                );
            }
            solve_upper_triangular_in_place(top.transpose(), xs, Par::Seq);
        }
    }
    /// The nodes `asked` of A⁻¹ b, with b given at the nodes `loaded`.
    pub(super) fn between(
        &self,
        loaded: &[u32],
        b: &NodeFields,
        asked: &[u32],
        progress: &dyn Progress,
    ) -> Result<NodeFields, SolveError> {
        let fronts = self.supernodes;
        let up = fronts.with_ancestors(loaded);
        let down = fronts.with_ancestors(asked);
        let width = block_width(b.columns);
        let blocks = (0..b.columns.div_ceil(width))
            .into_par_iter()
            .map(|block| {
                let first = block * width;
                let count = width.min(b.columns - first);
                let (mut x, mut scratch) = self.block(count)?;
                for (i, &node) in loaded.iter().enumerate() {
                    let at = 3 * fronts.inverse[node as usize] as usize;
                    for axis in 0..3 {
                        let from = &b.row(3 * i + axis)[first..][..count];
                        let to = &mut x[(at + axis) * count..][..count];
                        to.iter_mut().zip(from).for_each(|(to, from)| *to = T::of(*from));
                    }
                }
                self.forward(&mut x, count, &mut scratch, up.iter().copied());
                self.backward(&mut x, count, &mut scratch, down.iter().rev().copied());
                progress.advance(count as u64);
                Ok(x)
            })
            .collect::<Result<Vec<Vec<T>>, SolveError>>()?;
        let mut x = NodeFields::zeros(asked.len(), b.columns);
        let row = 3 * b.columns.max(1);
        x.data.par_chunks_mut(row).zip(asked).with_min_len(256).for_each(|(out, &node)| {
            let at = 3 * fronts.inverse[node as usize] as usize;
            for (k, out) in out.chunks_mut(b.columns).enumerate() {
                for (block, out) in blocks.iter().zip(out.chunks_mut(width)) {
                    let from = &block[(at + k) * out.len()..][..out.len()];
                    out.iter_mut().zip(from).for_each(|(out, from)| *out = from.to_f64());
                }
            }
        });
        Ok(x)
    }

    /// A block of so many columns, zero, and its scratch.
    pub(super) fn block(&self, columns: usize) -> Result<(Vec<T>, Vec<T>), SolveError> {
        let zeros = |count: usize| {
            let mut numbers = Vec::new();
            numbers.try_reserve_exact(count).map_err(|_full| {
                let what = format!("a block of {columns} columns");
                SolveError::Memory(machine::refused(what, (size_of::<T>() * count) as f64))
            })?;
            numbers.resize(count, T::of(0.0));
            Ok::<_, SolveError>(numbers)
        };
        Ok((zeros(3 * self.supernodes.nodes() * columns)?, zeros(scratch(self.supernodes, columns))?))
    }
}
