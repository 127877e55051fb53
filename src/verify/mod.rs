//! Problems with published or analytic answers, and how near the elements come to them.
//!
//! In: [`PROBLEMS`] and [`ELEMENTS`], a line each. Every problem is solved with every element on a sequence of
//! uniformly refined meshes. Out: [`ConvergenceRow`]s, one for each quantity and element, with the error on every mesh,
//! the fitted rate and whether it keeps what theory promises.
//!
//! ```text
//! Problem × Element × mesh → Body (mesh, loads, supports) → Solution → Measures → ConvergenceRow
//! ```
//!
//! What scenes do not know is in [`body`](crate::measure::body): tractions on curved faces, and supports of single components.
//! They are for judging elements; nothing here is called on the way to a .green file.

mod analytic;
pub mod frame_sizes;
pub mod haptic_tick;
pub mod hard_cases;
pub mod large_rotation;
mod problem;
mod published;
pub mod studies;
pub mod together;
pub mod truth;

pub use problem::{Bound, Measure, Problem};

use crate::fem::{ELEMENTS, Element};
use crate::measure::body::ProblemError;
use crate::measure::exact::{Level, rate};
use problem::POISSON;
use serde::Serialize;

pub const PROBLEMS: &[Problem] = &[
    published::LE10,
    published::TWISTED_BEAM,
    analytic::CYLINDER,
    published::PLANE_STRESS,
    published::PLANE_STRAIN,
    analytic::TORSION,
    analytic::KELVIN,
];

/// The number of a problem's meshes that are solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// Two: seconds, for tests.
    Coarse,
    /// Three, and of several Poisson's ratios the first alone, at which nothing locks: rates for tests.
    Smooth,
    /// Three: about a minute for all problems.
    Usual,
    /// All four: some minutes.
    Fine,
}

/// One quantity of one problem by one element.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConvergenceRow {
    pub problem: String,
    pub quantity: String,
    pub element: String,
    /// The expected value; 0 where the value is an error itself.
    pub reference: f64,
    /// Levels from coarse to fine; at least one.
    pub levels: Vec<Level>,
    /// The relative accuracy of the reference; 0 where it is exact.
    pub known_to: f64,
    /// Order of convergence p of error = c h^p, fitted to two or more levels.
    pub rate: Option<f64>,
    pub bound: Bound,
}

impl ConvergenceRow {
    /// Whether the finest error and the rate keep their bounds. NaN keeps none.
    pub fn holds(&self) -> bool {
        let error = self.levels.last().map_or(f64::NAN, |level| level.error);
        self.bound.error.is_none_or(|most| error <= most)
            && self.bound.rate.is_none_or(|least| self.rate.is_some_and(|rate| rate >= least))
    }
}

/// A [`ProblemError`] and where it happened.
#[derive(Debug, thiserror::Error)]
#[error("{problem}, {element}, mesh of size {size}: {fault}")]
pub struct VerifyError {
    pub problem: &'static str,
    pub element: &'static str,
    pub size: u32,
    pub fault: Box<ProblemError>,
}

/// The rows of one problem: quantity by quantity, and in each the elements in their order.
pub fn run(problem: &Problem, effort: Effort) -> Result<Vec<ConvergenceRow>, VerifyError> {
    let sizes = match effort {
        Effort::Coarse => &problem.sizes[..2],
        Effort::Smooth | Effort::Usual => &problem.sizes[..3],
        Effort::Fine => &problem.sizes[..],
    };
    let ratios = if effort == Effort::Smooth { &POISSON[..1] } else { &POISSON[..] };
    let mut rows = Vec::new();
    for &element in ELEMENTS {
        for &size in sizes {
            let measures = (problem.solve)(element, size, ratios).map_err(|fault| VerifyError {
                problem: problem.name,
                element: element.name,
                size,
                fault: Box::new(fault),
            })?;
            measures.into_iter().for_each(|measure| add(&mut rows, problem, element, size, measure));
        }
    }
    rows.iter_mut().for_each(|row| row.rate = rate(&row.levels, row.known_to));
    Ok(rows)
}

/// Adds a measure to the row of its quantity and element, or a row behind those of the quantity.
fn add(rows: &mut Vec<ConvergenceRow>, problem: &Problem, element: &Element, size: u32, measure: Measure) {
    let Measure { quantity, nodes, seconds, value, reference, error, known_to, bound } = measure;
    let level = Level { h: 1.0 / f64::from(element.cells(size)), nodes, value, error, seconds };
    if let Some(row) = rows.iter_mut().find(|row| row.quantity == quantity && row.element == element.name) {
        row.levels.push(level);
        // What is required is so on the finest mesh.
        row.bound = bound;
        return;
    }
    let after = rows.iter().rposition(|row| row.quantity == quantity);
    let (problem, element, levels) = (problem.name.into(), element.name.into(), vec![level]);
    let row = ConvergenceRow { problem, quantity, element, reference, levels, known_to, rate: None, bound };
    rows.insert(after.map_or(rows.len(), |at| at + 1), row);
}
