//! An entry of the list of problems.

use super::solution::Measure;
use crate::fem::{AssemblyError, Element};
use crate::mesh::GenerateError;
use crate::solve::SolveError;

/// The measures of a problem with an element, on a mesh so fine, at Poisson's ratios.
pub type Solve = fn(&Element, u32, &[f64]) -> Result<Vec<Measure>, ProblemError>;

/// A problem with a known answer.
pub struct Problem {
    pub name: &'static str,
    /// One sentence: body, supports, loads, what is compared.
    pub about: &'static str,
    /// Source of the answer.
    pub source: &'static str,
    /// Sizes of the meshes from coarse to fine, see [`Element::cells`]; effort chooses how many are solved.
    pub sizes: [u32; 4],
    /// Solves with an element on a mesh, for these Poisson's ratios where the problem has several (`POISSON`).
    pub solve: Solve,
}

/// Poisson's ratios on the way to incompressible.
pub const POISSON: [f64; 4] = [0.3, 0.49, 0.499, 0.4999];

/// The reason why one mesh could not be solved.
#[derive(Debug, thiserror::Error)]
pub enum ProblemError {
    #[error(transparent)]
    Mesh(#[from] GenerateError),
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error("no node lies at ({0}, {1}, {2}) of the unit block")]
    NoNode(f64, f64, f64),
}
