//! A body solved with one discretisation and solver.

use super::names;
use super::of_models::is_common;
use crate::deform::ModelEntry;
use crate::fem::Element;
use crate::green::{CUBIC, Requirements, STIFFNESS, Solution};
use crate::solve::Solver;

/// One discretisation, solved.
pub struct Candidate {
    pub refine: u32,
    pub element: &'static Element,
    pub solver: Solver,
    /// The models that are measured with it.
    pub models: Vec<&'static ModelEntry>,
    pub solution: Solution,
}

impl Candidate {
    /// The name of the step that solved it.
    pub fn name(&self) -> String {
        let own = self.models.first().filter(|model| !is_common(model)).map(|model| model.name);
        names::solved(self.refine, self.element, self.solver, own)
    }

    /// Whether it is this discretisation, solved directly, and the model is measured with it.
    pub fn is_of(&self, refine: u32, element: &Element, model: &ModelEntry) -> bool {
        (self.refine, self.element) == (refine, element) && self.is_exact(model)
    }

    /// Orders discretisations: quadratic elements before all refinements.
    pub fn fineness(&self) -> (u32, u32) {
        (self.element.order, self.refine)
    }

    /// Whether it is solved directly, and the model is measured with it.
    pub fn is_exact(&self, model: &ModelEntry) -> bool {
        self.solver.method.is_direct && self.models.iter().any(|own| own.name == model.name)
    }

    /// Time of the whole offline stage with these families, s. Of the families that every candidate has, those for which a model
    /// has no use are no part of its cost.
    pub fn offline_s(&self, needed: &Requirements) -> f64 {
        let is_shared = self.models.iter().all(|model| is_common(model));
        let spared = [STIFFNESS, CUBIC].into_iter().filter(|family| is_shared && !needed.has(*family));
        self.solution.offline_s() - spared.map(|family| self.solution.times.of(family)).sum::<f64>()
    }

    /// The solver's estimate; finite.
    pub fn forward_error(&self) -> Option<f64> {
        // NaN and infinity become the largest number, which JSON can hold.
        Some(self.solution.stats.conditioning?.forward_error.min(f64::MAX))
    }
}
