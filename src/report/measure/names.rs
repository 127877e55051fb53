//! The names of the steps of a measurement.

use crate::fem::Element;
use crate::report::data::Setting;
use crate::solve::Solver;

pub const EQUILIBRIA: &str = "equilibria of the poses";
pub const TRIALS: &str = "models by bends and twists";
pub const TIMES: &str = "times of an evaluation";
pub const EFFECTS: &str = "effects";

/// "tet10 h · cholesky", "tet4 h · reduced".
pub fn solved(refine: u32, element: &Element, solver: Solver, model: Option<&str>) -> String {
    let what = model.map_or_else(|| solver.to_string(), str::to_owned);
    format!("{} · {what}", Setting::mesh_name(element.name, refine))
}

/// The name of the step that measures the errors of a solved one.
pub fn errors(solved: &str) -> String {
    format!("errors of {solved}")
}

pub fn smooth(element: &Element) -> String {
    format!("smooth problem, {}", element.name)
}
