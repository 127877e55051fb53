//! Products, solves and eigenvectors of dense matrices on the calling thread, so that their bits do not depend on the number of
//! threads.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::linalg::matmul::matmul;
use faer::perm::PermRef;
use faer::{Accum, Mat, MatRef, Par};

/// A B.
pub fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    matmul(out.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    out
}

/// The eigenvalues of a symmetric matrix, ascending, and its eigenvectors; `None` where they are not found.
pub fn symmetric_eigen(a: MatRef<'_, f64>) -> Option<(Vec<f64>, Mat<f64>)> {
    let n = a.nrows();
    let (mut values, mut vectors) = (Diag::<f64>::zeros(n), Mat::zeros(n, n));
    let scratch = self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let (into, stack) = (Some(vectors.as_mut()), MemStack::new(&mut memory));
    self_adjoint_evd(a, values.as_mut(), into, Par::Seq, stack, Default::default()).ok()?;
    Some((values.column_vector().iter().copied().collect(), vectors))
}

/// P A = L U with partial pivoting.
pub struct Lu {
    /// U, and below it L without its diagonal of ones.
    numbers: Mat<f64>,
    /// P and its inverse.
    rows: [Vec<usize>; 2],
}

impl Lu {
    /// The factors of a square matrix.
    pub fn new(mut a: Mat<f64>) -> Lu {
        let n = a.nrows();
        let mut rows = [vec![0; n], vec![0; n]];
        let [forward, inverse] = &mut rows;
        let scratch = factor::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        factor::lu_in_place(a.as_mut(), forward, inverse, Par::Seq, stack, Default::default());
        Lu { numbers: a, rows }
    }

    /// The magnitudes of the diagonal of U.
    pub fn pivots(&self) -> impl Iterator<Item = f64> {
        self.numbers.diagonal().column_vector().iter().map(|pivot| pivot.abs())
    }

    /// A⁻¹ B.
    pub fn solve(&self, b: MatRef<'_, f64>) -> Mat<f64> {
        let n = self.numbers.nrows();
        let mut x = b.to_owned();
        let scratch = solve::solve_in_place_scratch::<usize, f64>(n, b.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        let (lu, [forward, inverse]) = (self.numbers.as_ref(), &self.rows);
        let rows = PermRef::new_checked(forward, inverse, n);
        solve::solve_in_place(lu, lu, rows, x.as_mut(), Par::Seq, MemStack::new(&mut memory));
        x
    }
}
