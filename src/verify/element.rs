//! Properties of the elements that are compared.

use super::solution::Bound;
use crate::fem::Element;

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
