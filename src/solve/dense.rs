//! Dense kernels of one front, by faer's, in tiles of our own.
//!
//! faer's own threads are not used: the tiles depend on sizes alone and each is the work of one thread, so that the bits do
//! not depend on the number of threads. Literature: Golub and Van Loan, Matrix Computations, 4th ed., section 4.2.6
//! (blocked Cholesky, looking left).

use bytemuck::Zeroable;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltError, LltParams, LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::traits::RealField;
use faer::{Accum, MatMut, MatRef, Par, Spec};
use rayon::prelude::*;
use std::ops::{AddAssign, SubAssign};

/// f64, and f32 for preconditioners.
pub(super) trait Real: RealField + Copy + AddAssign + SubAssign + Zeroable {
    fn from_f64(value: f64) -> Self;
    fn to_f64(self) -> f64;
}

impl Real for f64 {
    fn from_f64(value: f64) -> f64 {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
}

impl Real for f32 {
    fn from_f64(value: f64) -> f32 {
        value as f32
    }
    fn to_f64(self) -> f64 {
        self.into()
    }
}

/// Columns that are factorized together, and rows and columns of a tile.
pub(super) const PANEL: usize = 192;
const TILE_ROWS: usize = 512;
const TILE_COLUMNS: usize = 256;

/// Bytes of the scratch of one front.
pub(super) const SCRATCH: usize = 8 * PANEL + 256;

/// Does each piece of work, on all threads if it is worth it.
pub(super) fn each<I: Send>(shared: bool, pieces: Vec<I>, work: impl Fn(I) + Sync + Send) {
    if shared && pieces.len() > 1 {
        pieces.into_par_iter().with_max_len(1).for_each(work);
    } else {
        pieces.into_iter().for_each(work);
    }
}

/// Makes the first `n` columns of a symmetric front, `own` with n + m rows, those of its Cholesky factor. Errors with the
/// first column whose pivot is not positive.
pub(super) fn factorize<T: Real>(own: &mut [T], n: usize, m: usize, shared: bool) -> Result<(), usize> {
    let minus_one = T::from_f64(-1.0);
    let rows = n + m;
    let params: Spec<LltParams, T> = Default::default();
    let mut memory = MemBuffer::new(cholesky_in_place_scratch::<T>(PANEL.min(n), Par::Seq, params));
    let mut l = MatMut::from_column_major_slice_mut(own, rows, n);
    for at in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - at);
        let (left, right) = l.rb_mut().split_at_col_mut(at);
        let left = left.rb().subrows(at, rows - at);
        let panel = right.subrows_mut(at, rows - at).subcols_mut(0, width);
        let (mut top, bottom) = panel.split_at_row_mut(width);
        let pieces = tiles(bottom, width);
        if at > 0 {
            let across = left.subrows(0, width).transpose();
            matmul(top.rb_mut(), Accum::Add, left.subrows(0, width), across, minus_one, Par::Seq);
        }
        cholesky_in_place(
            top.rb_mut(),
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            params,
        )
        .map_err(|LltError::NonPositivePivot { index }| at + index)?;
        let top = top.rb();
        each(shared, pieces, |(first, mut tile)| {
            if at > 0 {
                let across = left.subrows(0, width).transpose();
                let of_tile = left.subrows(first, tile.nrows());
                matmul(tile.rb_mut(), Accum::Add, of_tile, across, minus_one, Par::Seq);
            }
            solve_lower_triangular_in_place(top, tile.transpose_mut(), Par::Seq);
        });
    }
    Ok(())
}

/// The lower half of what a factorized front takes from the unknowns below it: -B Bᵀ, B its last m rows.
pub(super) fn update<T: Real>(own: &[T], n: usize, m: usize, numbers: &mut [T], shared: bool) {
    let b = MatRef::from_column_major_slice(own, n + m, n).split_at_row(n).1;
    let pieces: Vec<(usize, &mut [T])> = numbers
        .chunks_mut((TILE_COLUMNS * m).max(1))
        .enumerate()
        .map(|(i, tile)| (i * TILE_COLUMNS, tile))
        .collect();
    each(shared, pieces, |(at, tile)| {
        let width = TILE_COLUMNS.min(m - at);
        let tile = MatMut::from_column_major_slice_mut(tile, m, width).subrows_mut(at, m - at);
        let (corner, rest) = tile.split_at_row_mut(width);
        let across = b.subrows(at, width).transpose();
        triangular::matmul(
            corner,
            BlockStructure::TriangularLower,
            Accum::Replace,
            b.subrows(at, width),
            BlockStructure::Rectangular,
            across,
            BlockStructure::Rectangular,
            T::from_f64(-1.0),
            Par::Seq,
        );
        if at + width < m {
            let below = b.subrows(at + width, m - at - width);
            matmul(rest, Accum::Replace, below, across, T::from_f64(-1.0), Par::Seq);
        }
    });
}

/// Tiles of a matrix, each with the number of its first row, which for the first tile is `first`.
fn tiles<T>(matrix: MatMut<'_, T>, first: usize) -> Vec<(usize, MatMut<'_, T>)> {
    let mut tiles = Vec::new();
    let (mut rest, mut at) = (matrix, first);
    while rest.nrows() > TILE_ROWS {
        let (tile, below) = rest.split_at_row_mut(TILE_ROWS);
        tiles.push((at, tile));
        (rest, at) = (below, at + TILE_ROWS);
    }
    if rest.nrows() > 0 {
        tiles.push((at, rest));
    }
    tiles
}
