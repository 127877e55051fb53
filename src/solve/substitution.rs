//! Solves L Lᵀ x = b, for all nodes or for what is asked.
//!
//! In: the numbers of L and a block of columns. Out: the block solved. A block is a matrix over all unknowns in the order
//! of elimination, row after row, so that what stands at a node stands together. A right-hand side at few nodes passes only
//! the supernodes between them and the root of the tree, and so do the rows that are asked (Gilbert and Peierls, SIAM J.
//! Sci. Stat. Comput. 9 (1988), 862-874).

use super::dense::Real;
use super::fronts::Fronts;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Accum, MatMut, MatRef, Par};

/// A block's scratch: numbers for so many columns.
pub(super) fn scratch(fronts: &Fronts, columns: usize) -> usize {
    3 * fronts.widest() * columns
}

/// L with its pattern.
pub(super) struct Triangle<'a, T> {
    pub(super) fronts: &'a Fronts,
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
        let (n, m) = (3 * self.fronts.own(s).len(), 3 * self.fronts.below(s).len());
        MatRef::from_column_major_slice(&self.values[self.fronts.values(s)], n + m, n).split_at_row(n)
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
            let (own, below) = (self.fronts.own(s), self.fronts.below(s));
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
            let (own, below) = (self.fronts.own(s), self.fronts.below(s));
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
}
