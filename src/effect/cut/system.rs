//! The equations of the copies, H - G X, symmetric and positive definite.
//!
//! In: the matrix, and motions that it maps to 0. Out: solutions, and by how much they miss their equations. With an orthonormal basis Q of
//! these motions, scaled as the matrix, Q Qᵀ is added to it: of all solutions one without them is found.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::cholesky::llt::solve::{solve_in_place, solve_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par, Spec};
use nalgebra::{DMatrix, DVector};

/// A motion of which less than this part is left beside the others is one of them.
const DEPENDENT: f64 = 1e-8;
/// A pivot of the scaled matrix below which it holds no digits.
const SINGULAR: f64 = 1e-11;

pub struct System {
    scaled: Mat<f64>,
    factor: Mat<f64>,
    scale: DVector<f64>,
}

impl System {
    /// The error says that the cut body moves freely somewhere, beyond these motions.
    pub fn new(matrix: &DMatrix<f64>, free: Vec<DVector<f64>>) -> Result<System, String> {
        let n = matrix.nrows();
        let loose = || {
            "a part of the body would hang on a single node or edge, about which it could turn freely"
                .to_owned()
        };
        let scale = matrix.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
        let entry = |i: usize, j: usize| 0.5 * (matrix[(i, j)] + matrix[(j, i)]) * scale[i] * scale[j];
        let mut scaled = Mat::from_fn(n, n, entry);
        for motion in orthonormal(free, &scale) {
            for (j, along) in motion.iter().enumerate().filter(|(_, along)| **along != 0.0) {
                scaled.col_as_slice_mut(j).iter_mut().zip(&motion).for_each(|(entry, q)| *entry += q * along);
            }
        }
        let mut factor = scaled.clone();
        let mut memory = MemBuffer::new(cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default()));
        let stack = MemStack::new(&mut memory);
        let regularisation = LltRegularization::default();
        cholesky_in_place(factor.as_mut(), regularisation, Par::Seq, stack, Spec::default())
            .map_err(|_not_definite| loose())?;
        if (0..n).any(|i| factor[(i, i)].powi(2) < SINGULAR) {
            return Err(loose());
        }
        Ok(System { scaled, factor, scale })
    }

    /// The solutions, and the largest part of the largest number of a column of `b` by which one misses its equations.
    pub fn solve(&self, b: &DMatrix<f64>) -> (DMatrix<f64>, f64) {
        let (n, columns) = b.shape();
        if n == 0 {
            return (b.clone(), 0.0);
        }
        let b = Mat::from_fn(n, columns, |i, j| b[(i, j)] * self.scale[i]);
        let mut memory = MemBuffer::new(solve_in_place_scratch::<f64>(n, columns, Par::Seq));
        let mut found = b.clone();
        solve_in_place(self.factor.as_ref(), found.as_mut(), Par::Seq, MemStack::new(&mut memory));
        let mut misses = b.clone();
        matmul(misses.as_mut(), Accum::Add, self.scaled.as_ref(), found.as_ref(), -1.0, Par::Seq);
        let parts = (0..columns).map(|j| {
            let largest = b.col(j).norm_max();
            if largest > 0.0 { misses.col(j).norm_max() / largest } else { 0.0 }
        });
        let missed = parts.fold(0.0, f64::max);
        (DMatrix::from_fn(n, columns, |i, j| found[(i, j)] * self.scale[i]), missed)
    }
}

/// An orthonormal basis of motions in the unknowns of the scaled matrix.
fn orthonormal(motions: Vec<DVector<f64>>, scale: &DVector<f64>) -> Vec<DVector<f64>> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for mut motion in motions {
        motion.zip_apply(scale, |x, scale| *x = if scale > 0.0 { *x / scale } else { 0.0 });
        let length = motion.norm();
        // Twice, for rounding.
        for _ in 0..2 {
            for other in &basis {
                let along = other.dot(&motion);
                motion.axpy(-along, other, 1.0);
            }
        }
        if motion.norm() > DEPENDENT * length {
            basis.push(motion.normalize());
        }
    }
    basis
}
