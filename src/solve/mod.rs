//! Solving A x = b for many right-hand sides: A in 3×3 blocks and its right-hand sides in, solutions and the
//! figures that judge them out.
//!
//! Two ways: [`Cholesky`] (nested dissection, then a supernodal LLᵀ) and [`Pcg`] (block-Jacobi preconditioned
//! conjugate gradients, the paper's solver). Each measures the true residual of every column afterwards. [`Newton`] finds
//! static equilibrium at large strain, by a factor for each of its iterations.

mod cholesky;
mod condition;
mod error;
mod newton;
mod ordering;
mod pcg;
mod residual;
mod stats;

pub use crate::base::progress::{Progress, Silent};
pub use cholesky::{Cholesky, Symbolic};
pub use error::SolveError;
pub use newton::{Counts, Equilibrium, Newton, NewtonError, Setback};
pub use ordering::{Ordering, nested_dissection};
pub use pcg::Pcg;
pub use residual::residuals;
pub use stats::{Conditioning, ERROR_LIMITS, SolveStats};
