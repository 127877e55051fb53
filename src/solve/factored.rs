//! A tangent stiffness with its factor, kept for the states that follow.
//!
//! In: K of a state, and the solver. Out: A = L Lᵀ over the free nodes, together with the A that it factorises, and on demand the
//! [`Tangent`] of K with the border of what is pushed.

use super::error::SolveError;
use super::pushed::{Border, Tangent};
use super::solver::{Factor, LinearSolver};
use crate::base::progress::Silent;
use crate::fem::{Partition, StiffnessMatrix};

/// A positive definite tangent stiffness K, and the factor of its part A over the free nodes.
pub struct Factored<'s> {
    pub(super) k: StiffnessMatrix,
    free: FreePart<'s>,
}

/// A, and what factorises it.
struct Solvable<'s> {
    a: StiffnessMatrix,
    solver: &'s dyn LinearSolver,
}

type FreeFactor<'a> = Box<dyn Factor + 'a>;

self_cell::self_cell!(
    struct FreePart<'s> {
        owner: Solvable<'s>,
        #[covariant]
        dependent: FreeFactor,
    }
);

impl<'s> Factored<'s> {
    /// Errors where A is not positive definite.
    pub(super) fn new(
        k: StiffnessMatrix,
        partition: &Partition,
        solver: &'s dyn LinearSolver,
    ) -> Result<Factored<'s>, SolveError> {
        let own = Solvable { a: partition.a(&k), solver };
        Ok(Factored { free: FreePart::try_new(own, |own| own.solver.factor(&own.a, &Silent))?, k })
    }

    /// K with the border of what is pushed.
    pub(super) fn tangent<'t>(
        &'t self,
        partition: &'t Partition,
        border: &'t Border,
    ) -> Result<Tangent<'t>, SolveError> {
        Tangent::new(partition, &self.k, self.free.borrow_dependent().as_ref(), border)
    }
}
