//! Solves L Lᵀ x = b, for all nodes or for what is asked.
//!
//! In: the numbers of L and a block of columns. Out: the block solved. Many columns are solved in blocks, one thread each; one block
//! alone in the branches of the tree side by side. A block is a matrix over all unknowns in the order
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
use std::ops::Range;

/// Columns that one thread solves together: fewer read the factor more often, more leave threads idle. The width depends
/// on the number of columns alone, so that the bits do not depend on the number of threads.
const BLOCK_COLUMNS: std::ops::RangeInclusive<usize> = 24..=128;

pub(super) fn block_width(columns: usize) -> usize {
    (columns / 8).clamp(*BLOCK_COLUMNS.start(), *BLOCK_COLUMNS.end())
}

/// Length of a block's scratch for `columns` columns.
pub(super) fn scratch(supernodes: &Supernodes, columns: usize) -> usize {
    3 * supernodes.widest() * columns
}

/// Zeros for a block of `columns` columns, `count` numbers.
fn zeros<T: Real>(count: usize, columns: usize) -> Result<Vec<T>, SolveError> {
    let mut numbers = Vec::new();
    numbers.try_reserve_exact(count).map_err(|_full| {
        let what = format!("a block of {columns} columns");
        SolveError::Memory(machine::refused(what, (size_of::<T>() * count) as f64))
    })?;
    numbers.resize(count, T::from_f64(0.0));
    Ok(numbers)
}

/// L with its pattern.
pub(super) struct Triangle<'a, T> {
    pub(super) supernodes: &'a Supernodes,
    pub(super) values: &'a [T],
    /// Subtrees, as ranges of supernodes, ascending: one block of columns is solved in them side by side.
    pub(super) branches: &'a [Range<usize>],
}

/// The rows of a block that belong to a branch of the tree, and those outside that it adds to or reads.
struct Rows<'a, T> {
    x: &'a mut [T],
    /// The node of the first row of `x`.
    first: usize,
    /// Nodes outside, ascending, and their rows.
    outside: &'a [u32],
    outer: &'a mut [T],
    /// Numbers of a node.
    node: usize,
}

impl<'a, T> Rows<'a, T> {
    fn all(x: &'a mut [T], columns: usize) -> Rows<'a, T> {
        Rows { x, first: 0, outside: &[], outer: &mut [], node: 3 * columns }
    }

    fn range(&mut self, nodes: Range<usize>) -> &mut [T] {
        &mut self.x[self.node * (nodes.start - self.first)..self.node * (nodes.end - self.first)]
    }

    fn at(&mut self, row: u32) -> &mut [T] {
        let place = row as usize - self.first;
        if self.node * place < self.x.len() {
            return &mut self.x[self.node * place..][..self.node];
        }
        let place = self.outside.partition_point(|other| *other < row);
        &mut self.outer[self.node * place..][..self.node]
    }
}

/// Nodes whose rows one thread makes where all share a supernode.
const PIECE: usize = 64;

/// Calls `make` with pieces of `rows` and the node at which each begins: always the same ones where they are shared.
fn in_pieces<T: Send>(rows: &mut [T], node: usize, shared: bool, make: &(dyn Fn(usize, &mut [T]) + Sync)) {
    if shared && rows.len() > PIECE * node {
        rows.par_chunks_mut(PIECE * node).enumerate().for_each(|(i, rows)| make(PIECE * i, rows));
    } else if !rows.is_empty() {
        make(0, rows);
    }
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
        self.forward_in(&mut Rows::all(x, columns), scratch, supernodes, false);
    }

    /// x ← L⁻ᵀ x at these supernodes, descending; all above them are among them or done.
    pub(super) fn backward(
        &self,
        x: &mut [T],
        columns: usize,
        scratch: &mut [T],
        supernodes: impl Iterator<Item = usize>,
    ) {
        self.backward_in(&mut Rows::all(x, columns), scratch, supernodes, false);
    }

    fn forward_in(
        &self,
        x: &mut Rows<'_, T>,
        scratch: &mut [T],
        supernodes: impl Iterator<Item = usize>,
        shared: bool,
    ) {
        let (node, columns) = (x.node, x.node / 3);
        for s in supernodes {
            let (top, bottom) = self.parts(s);
            let below = self.supernodes.below(s);
            let mut xs = rows_mut(x.range(self.supernodes.own(s)), columns);
            solve_lower_triangular_in_place(top, xs.as_mut(), Par::Seq);
            let rest = &mut scratch[..node * below.len()];
            let xs = xs.as_ref();
            in_pieces(rest, node, shared, &|at, rest| {
                let bottom = bottom.subrows(3 * at, rest.len() / columns);
                matmul(rows_mut(rest, columns), Accum::Replace, bottom, xs, T::from_f64(1.0), Par::Seq);
            });
            for (part, &row) in rest.chunks_exact(node).zip(below) {
                x.at(row).iter_mut().zip(part).for_each(|(out, part)| *out -= *part);
            }
        }
    }

    fn backward_in(
        &self,
        x: &mut Rows<'_, T>,
        scratch: &mut [T],
        supernodes: impl Iterator<Item = usize>,
        shared: bool,
    ) {
        let (node, columns) = (x.node, x.node / 3);
        for s in supernodes {
            let (top, bottom) = self.parts(s);
            let below = self.supernodes.below(s);
            let rest = &mut scratch[..node * below.len()];
            for (part, &row) in rest.chunks_exact_mut(node).zip(below) {
                part.copy_from_slice(x.at(row));
            }
            let own = x.range(self.supernodes.own(s));
            if !below.is_empty() {
                in_pieces(own, node, shared, &|at, own| {
                    let bottom = bottom.subcols(3 * at, own.len() / columns).transpose();
                    matmul(
                        rows_mut(own, columns),
                        Accum::Add,
                        bottom,
                        rows(rest, columns),
                        T::from_f64(-1.0),
                        Par::Seq,
                    );
                });
            }
            solve_upper_triangular_in_place(top.transpose(), rows_mut(own, columns), Par::Seq);
        }
    }

    /// One block of columns, through the supernodes `up` and back through `down`: whole branches of the tree side by side, then
    /// what stands above them. The branches are those of the pattern, so that the bits do not depend on the number of threads.
    fn by_branches(
        &self,
        x: &mut [T],
        columns: usize,
        scratch: &mut [T],
        [up, down]: [&[usize]; 2],
    ) -> Result<(), SolveError> {
        let (fronts, node) = (self.supernodes, 3 * columns);
        let within = |list: &[usize], of: &Range<usize>| {
            list[list.partition_point(|s| *s < of.start)..list.partition_point(|s| *s < of.end)].to_vec()
        };
        let is_above = |s: &usize| !self.branches.iter().any(|of| of.contains(s));
        let outside = |of: &Range<usize>| fronts.below(of.end - 1);
        let mut outer = Vec::new();
        let mut own_scratch = Vec::new();
        for of in self.branches {
            outer.push(zeros(node * outside(of).len(), columns)?);
            let widest = of.clone().map(|s| fronts.below(s).len()).max().unwrap_or(0);
            own_scratch.push(zeros(node * widest, columns)?);
        }
        let work = |x: &mut [T], outer: &mut [Vec<T>], scratch: &mut [Vec<T>], is_up: bool| {
            let (mut left, mut done, mut parts) = (x, 0, Vec::new());
            for of in self.branches {
                let nodes = fronts.own(of.start).start..fronts.own(of.end - 1).end;
                let (_, rest) = left.split_at_mut(node * (nodes.start - done));
                let (own, rest) = rest.split_at_mut(node * nodes.len());
                (left, done) = (rest, nodes.end);
                parts.push((own, nodes.start));
            }
            let each = parts.into_par_iter().zip(self.branches).zip(outer).zip(scratch).with_max_len(1);
            each.for_each(|((((x, first), of), outer), scratch)| {
                let mut x = Rows { x, first, outside: outside(of), outer, node };
                if is_up {
                    self.forward_in(&mut x, scratch, within(up, of).into_iter(), false);
                } else {
                    self.backward_in(&mut x, scratch, within(down, of).into_iter().rev(), false);
                }
            });
        };
        work(x, &mut outer, &mut own_scratch, true);
        let row = |row: u32| node * row as usize..node * (row as usize + 1);
        for (of, outer) in self.branches.iter().zip(&outer) {
            for (part, &below) in outer.chunks_exact(node).zip(outside(of)) {
                x[row(below)].iter_mut().zip(part).for_each(|(x, part)| *x += *part);
            }
        }
        let mut whole = Rows::all(x, columns);
        self.forward_in(&mut whole, scratch, up.iter().copied().filter(is_above), true);
        self.backward_in(&mut whole, scratch, down.iter().rev().copied().filter(is_above), true);
        for (of, outer) in self.branches.iter().zip(&mut outer) {
            for (part, &below) in outer.chunks_exact_mut(node).zip(outside(of)) {
                part.copy_from_slice(&x[row(below)]);
            }
        }
        work(x, &mut outer, &mut own_scratch, false);
        Ok(())
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
                        to.iter_mut().zip(from).for_each(|(to, from)| *to = T::from_f64(*from));
                    }
                }
                if count == b.columns && !self.branches.is_empty() {
                    self.by_branches(&mut x, count, &mut scratch, [&up, &down])?;
                } else {
                    self.forward(&mut x, count, &mut scratch, up.iter().copied());
                    self.backward(&mut x, count, &mut scratch, down.iter().rev().copied());
                }
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

    /// A block of `columns` columns, zero, and its scratch.
    pub(super) fn block(&self, columns: usize) -> Result<(Vec<T>, Vec<T>), SolveError> {
        let whole = zeros(3 * self.supernodes.nodes() * columns, columns)?;
        Ok((whole, zeros(scratch(self.supernodes, columns), columns)?))
    }
}
