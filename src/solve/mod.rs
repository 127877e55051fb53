//! Solving A x = b for many right-hand sides: A in 3×3 blocks and its right-hand sides in, solutions and the
//! figures that judge them out.
//!
//! The methods of [`SOLVERS`] are Cholesky (nested dissection, then a multifrontal LLᵀ), the same in f32 with conjugate gradients
//! in f64 around it, conjugate gradients preconditioned by multigrid, the paper's solver, and the choice between them; all stand
//! behind [`LinearSolver`] and measure the true residual of every column afterwards. [`minimise`](minimise()) leads any energy to its
//! least. [`Newton`] finds static equilibrium at large
//! strain, with some factors for each load step, and leads on beyond the critical states that [`Stability`] describes; [`Settler`]
//! keeps a body in equilibrium that moves, with one factor for many steps. [`cone`] finds the forces of contacts with friction.

mod analysis;
mod arc;
mod auto;
mod branch;
mod cholesky;
mod condition;
pub mod cone;
mod conjugate_gradients;
mod dense;
mod dense_system;
pub mod envelope;
mod error;
mod factored;
mod faer_cholesky;
mod fronts;
mod kept_factor;
mod llt;
mod load_step;
pub mod minimise;
mod mixed;
mod modes;
mod multifrontal;
mod multigrid;
mod newton;
mod pcg;
mod pushed;
mod refinement;
mod residual;
mod settle;
mod solver;
pub mod solver_as_text;
mod solvers;
mod stability;
mod substitution;
mod supernodes;

pub use crate::base::progress::{Progress, Silent};
pub use analysis::{Ordering, nested_dissection};
pub use arc::ArcPoint;
pub use auto::AUTO;
pub use branch::{Followed, NewtonError, Passed};
pub use dense_system::{DENSE, DenseSystem, Elimination};
pub use error::{ERROR_LIMITS, SolveError};
pub use factored::Factored;
pub use kept_factor::{KeptFactor, LoadedFactor, NUMBER, kept_bytes};
pub use minimise::{Minimum, Setback, minimise};
pub use modes::{MODE_RESIDUAL, Modes, lowest_modes};
pub use newton::{Counts, Equilibrium, LAST_STEP, Loads, Newton, Path, Point, WarmBody};
pub use pushed::Pushed;
pub use residual::residuals;
pub use settle::{OldFactor, Settled, Settler, TOLERANCE, Unsettled};
pub use solver::{
    AnalysisInput, Conditioning, Factor, InverseStrip, Job, LinearSolver, Method, NO_UNKNOWNS, SolveResult,
    SolveStats, Solver,
};
pub use solvers::{SOLVERS, find_method, without_factor};
pub use stability::Stability;
