//! Problems with published or analytic answers, and how near the elements come to them.
//!
//! In: [`PROBLEMS`] and [`Element::ALL`], a line each. Every problem is solved with every element on a sequence of uniformly
//! refined meshes. Out: [`Row`]s, one for each quantity and element, with the error on every mesh, the fitted rate and
//! whether it keeps what theory promises.
//!
//! ```text
//! Problem × Element × mesh → Body (mesh, loads, supports) → Solution → Measures → Row
//! ```
//!
//! What scenes do not know is in [`body`]: tractions on curved faces, and supports of single components. They are for
//! judging elements; nothing here is called on the way to a .green file.

pub mod body;
mod cook;
mod cylinder;
mod element;
mod fit;
pub mod hard_cases;
mod kelvin;
mod le10;
pub mod quadrature;
mod solution;
mod torsion;
mod twisted_beam;

pub use crate::scene::Element;
pub use body::Body;
pub use fit::rate;
pub use kelvin::Kelvin;
pub use solution::{Bound, Exact, Measure, Solution};

use crate::fem::AssemblyError;
use crate::mesh::GenerateError;
use crate::solve::SolveError;
use serde::Serialize;

/// A problem with a known answer.
pub struct Problem {
    pub name: &'static str,
    /// One sentence: body, supports, loads, what is compared.
    pub about: &'static str,
    /// Where the answer is from.
    pub source: &'static str,
    /// Of the meshes from coarse to fine, see [`Element::cells`]; effort chooses how many are solved.
    pub sizes: [u32; 4],
    pub solve: fn(Element, u32) -> Result<Vec<Measure>, Fault>,
}

pub const PROBLEMS: &[Problem] = &[
    le10::PROBLEM,
    twisted_beam::PROBLEM,
    cylinder::PROBLEM,
    cook::PLANE_STRESS,
    cook::PLANE_STRAIN,
    torsion::PROBLEM,
    kelvin::PROBLEM,
];

/// Poisson's ratios on the way to incompressible.
const POISSON: [f64; 4] = [0.3, 0.49, 0.499, 0.4999];

/// How many of a problem's meshes are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// Two: seconds, for tests.
    Coarse,
    /// Three: about a minute for all problems.
    Usual,
    /// All four: some minutes.
    Fine,
}

/// One quantity of one problem by one element.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    pub problem: String,
    pub quantity: String,
    pub element: String,
    /// What the value should be; 0 where the value is an error itself.
    pub reference: f64,
    /// From coarse to fine; at least one.
    pub levels: Vec<Level>,
    /// How well the reference is known, relatively; 0 where it is exact.
    pub known_to: f64,
    /// Order of convergence p of error = c h^p, where two or more levels tell one.
    pub rate: Option<f64>,
    pub bound: Bound,
}

/// One mesh of a [`Row`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Size of a cell as a part of the body's.
    pub h: f64,
    pub nodes: usize,
    pub value: f64,
    /// Relative.
    pub error: f64,
    /// From assembly to displacements.
    pub seconds: f64,
}

impl Row {
    /// Whether the finest error and the rate keep their bounds. NaN keeps none.
    pub fn holds(&self) -> bool {
        let error = self.levels.last().map_or(f64::NAN, |level| level.error);
        self.bound.error.is_none_or(|most| error <= most)
            && self.bound.rate.is_none_or(|least| self.rate.is_some_and(|rate| rate >= least))
    }
}

/// Why one mesh could not be solved.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    #[error(transparent)]
    Mesh(#[from] GenerateError),
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error("no node lies at ({0}, {1}, {2}) of the unit block")]
    NoNode(f64, f64, f64),
}

/// A [`Fault`] and where it happened.
#[derive(Debug, thiserror::Error)]
#[error("{problem}, {element}, mesh of size {size}: {fault}")]
pub struct VerifyError {
    pub problem: &'static str,
    pub element: &'static str,
    pub size: u32,
    pub fault: Box<Fault>,
}

/// The rows of one problem: quantity by quantity, and in each the elements in their order.
pub fn run(problem: &Problem, effort: Effort) -> Result<Vec<Row>, VerifyError> {
    let sizes = match effort {
        Effort::Coarse => &problem.sizes[..2],
        Effort::Usual => &problem.sizes[..3],
        Effort::Fine => &problem.sizes[..],
    };
    let mut table = Table::default();
    for element in Element::ALL {
        for &size in sizes {
            let measures = (problem.solve)(element, size).map_err(|fault| VerifyError {
                problem: problem.name,
                element: element.name(),
                size,
                fault: Box::new(fault),
            })?;
            for measure in measures {
                table.add(problem, element, size, measure);
            }
        }
    }
    Ok(table.finish())
}

/// Rows in the making.
#[derive(Default)]
struct Table {
    rows: Vec<Row>,
}

impl Table {
    fn add(&mut self, problem: &Problem, element: Element, size: u32, measure: Measure) {
        let Measure { quantity, nodes, seconds, value, reference, error, known_to, bound } = measure;
        let level = Level { h: 1.0 / f64::from(element.cells(size)), nodes, value, error, seconds };
        let same = |row: &Row| row.quantity == quantity && row.element == element.name();
        match self.rows.iter_mut().find(|row| same(row)) {
            // What is required is so on the finest mesh.
            Some(row) => {
                row.levels.push(level);
                row.bound = bound;
            }
            None => {
                let after = self.rows.iter().rposition(|row| row.quantity == quantity);
                let row = Row {
                    problem: problem.name.into(),
                    quantity,
                    element: element.name().into(),
                    reference,
                    levels: vec![level],
                    known_to,
                    rate: None,
                    bound,
                };
                self.rows.insert(after.map_or(self.rows.len(), |at| at + 1), row);
            }
        }
    }

    fn finish(self) -> Vec<Row> {
        let rated = |row: Row| Row { rate: rate(&row.levels, row.known_to), ..row };
        self.rows.into_iter().map(rated).collect()
    }
}
