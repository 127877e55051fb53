//! An entry of the list of problems, what it measures, and what theory promises of it.

use crate::fem::Element;
use crate::measure::body::ProblemError;
use crate::measure::exact::Solution;
use serde::Serialize;

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

/// One quantity on one mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    pub quantity: String,
    pub nodes: usize,
    pub seconds: f64,
    pub value: f64,
    pub reference: f64,
    /// |value - reference| / |reference|, or a relative norm.
    pub error: f64,
    /// The relative accuracy of the reference; 0 where it is exact.
    pub known_to: f64,
    pub bound: Bound,
}

/// The requirement on the finest mesh; none where theory promises nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bound {
    /// Largest relative error.
    pub error: Option<f64>,
    /// Least rate.
    pub rate: Option<f64>,
}

impl Bound {
    pub const NONE: Bound = Bound { error: None, rate: None };

    pub const fn error(most: f64) -> Bound {
        Bound { error: Some(most), rate: None }
    }

    pub const fn rate(least: f64) -> Bound {
        Bound { error: None, rate: Some(least) }
    }
}

impl Solution {
    /// A value beside its reference, which is `known_to` a relative accuracy.
    pub fn value(
        &self,
        quantity: impl Into<String>,
        value: f64,
        reference: f64,
        known_to: f64,
        bound: Bound,
    ) -> Measure {
        let error = (value - reference).abs() / reference.abs();
        let quantity = quantity.into();
        let (nodes, seconds) = (self.displacement.len(), self.seconds);
        Measure { quantity, nodes, seconds, value, reference, error, known_to, bound }
    }

    /// A relative error in some norm, whose reference is 0.
    pub fn norm(&self, quantity: impl Into<String>, error: f64, bound: Bound) -> Measure {
        Measure { error, ..self.value(quantity, error, 0.0, 0.0, bound) }
    }
}

impl Element {
    /// Cells for a problem's `size`: that many of quadratic elements, twice as many of linear ones, so that both have
    /// about as many nodes.
    pub fn cells(&self, size: u32) -> u32 {
        2 * size / self.order
    }

    /// The least rates in L2 and in energy that theory promises where the solution is smooth, less 0.3: what a rate
    /// fitted to two to four meshes may be short of the limit.
    ///
    /// Well below ν = 1/2, elements of order p have h^(p+1) in L2 and h^p in energy. Near it linear ones lock: theirs is
    /// the same on meshes finer than any that can be afforded. Of quadratic ones one order is left less for all ν alike
    /// (Babuška and Suri, Numer. Math. 62, 1992, 439-463, on triangles): h² in L2, h in energy; only where h is small
    /// against √(μ/λ), on finer meshes than here, the h² of a constant that grows as √λ is less. For mean pressures
    /// nothing is proven there.
    pub fn promised(&self, poisson: f64) -> (Bound, Bound) {
        const SHORT: f64 = 0.3;
        let order = f64::from(self.order);
        let is_near_half = poisson > 0.4;
        if is_near_half && self.order == 1 {
            return (Bound::NONE, Bound::NONE);
        }
        let lost = if is_near_half { 1.0 } else { 0.0 };
        (Bound::rate(order + 1.0 - lost - SHORT), Bound::rate(order - lost - SHORT))
    }
}
