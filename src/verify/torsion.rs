//! Saint-Venant's torsion of a square bar.
//!
//! Sections turn by θ z and warp freely, u = θ (-y z, x z, φ(x, y)), and the torque is G J θ with
//!
//! ```text
//! J = a⁴/3 (1 - 192/π⁵ Σ tanh(nπ/2)/n⁵), n = 1, 3, 5, …      = 0.1406 a⁴
//! ```
//!
//! (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 109). A bar of length a/4 is turned at both ends by
//! prescribed u_x and u_y with u_z left free, so this is the exact solution of the solid, to its ends. J is measured
//! by the energy G J θ² a / 8; its relative error is the square of the relative error in energy. At the edges φ has
//! terms r² log r, so that of quadratic elements falls with h⁴ |log h| instead of h⁴.

use super::body::Body;
use super::problem::{Problem, ProblemError};
use super::solution::{Bound, Measure};
use crate::fem::{Element, Lame};
use nalgebra::Vector3;
use std::f64::consts::PI;

pub const PROBLEM: Problem = Problem {
    name: "torsion",
    about: "square bar turned at both ends, free to warp: the torsion constant J/a⁴ from the energy",
    source: "exact (Saint-Venant's series; Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 109)",
    sizes: [4, 8, 16, 24],
    solve,
};

/// Least rates for h² and for h⁴ |log h|, which itself has 3.4 between the two coarsest meshes.
const LEAST_LINEAR: f64 = 1.8;
const LEAST_QUADRATIC: f64 = 3.4;

/// J/a⁴. The terms fall with n⁻⁵, so 1500 leave an error below 1e-15.
fn torsion_constant() -> f64 {
    let term = |n: f64| (n * PI / 2.0).tanh() / n.powi(5);
    let sum: f64 = (0..1500).rev().map(|i| term(f64::from(2 * i + 1))).sum();
    (1.0 - 192.0 / PI.powi(5) * sum) / 3.0
}

fn solve(element: &Element, size: u32, _: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    const TWIST: f64 = 1.0;
    const LENGTH: f64 = 0.25;
    let n = element.cells(size);
    let shape = |place: &Vector3<f64>| Vector3::new(place.x - 0.5, place.y - 0.5, LENGTH * place.z);
    let mut body = Body::new(element, [n, n, n / 4], shape)?;
    let is_end = |place: &Vector3<f64>| place.z == 0.0 || place.z == 1.0;
    body.fix(is_end, 0, |x| -TWIST * x.z * x.y);
    body.fix(is_end, 1, |x| TWIST * x.z * x.x);
    body.fix(|place| *place == Vector3::new(0.5, 0.5, 0.0), 2, |_| 0.0);
    let lame = Lame::from_young_poisson(1.0, 0.3);
    let solution = body.solve(element, lame)?;
    let value = 2.0 * solution.energy / (lame.mu * TWIST * TWIST * LENGTH);
    let bound = Bound::rate(if element.order == 2 { LEAST_QUADRATIC } else { LEAST_LINEAR });
    Ok(vec![solution.value("J/a⁴", value, torsion_constant(), 0.0, bound)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_has_its_published_sum() {
        assert!((torsion_constant() - 0.140_577_014_955_154).abs() < 1e-14);
    }
}
