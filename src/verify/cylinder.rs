//! The thick cylinder under inner pressure, in plane strain, towards incompressibility.
//!
//! Lamé (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 28), with radii a < b:
//!
//! ```text
//! u_r = (1+ν) p a² / (E (b²-a²)) ((1-2ν) r + b²/r)
//! ```
//!
//! The numbers of MacNeal and Harder (Finite Elem. Anal. Des. 1, 1985, 3-20): a = 3, b = 9, E = 1000, p = 1. A quarter,
//! one cell high between frictionless walls, with u_x = 0 on x = 0 and u_y = 0 on y = 0. Cells are split after Kuhn:
//! a single layer of the generator's five tetrahedra a cell is like crossed triangles, on which linear elements do not
//! lock (Nagtegaal, Parks and Rice, Comput. Meth. Appl. Mech. Engng. 4, 1974, 153-177); in several layers they do.

use super::body::Body;
use super::problem::{Problem, ProblemError};
use super::solution::{Bound, Exact, Measure};
use crate::fem::{Element, Lame};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

pub const PROBLEM: Problem = Problem {
    name: "cylinder",
    about: "thick cylinder under inner pressure, plane strain: u_r on the inner wall, errors in L2 and energy",
    source: "exact (Lamé; Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 28); the numbers of MacNeal \
             and Harder, Finite Elem. Anal. Des. 1 (1985) 3-20",
    sizes: [6, 12, 24, 36],
    solve,
};

const INNER: f64 = 3.0;
const OUTER: f64 = 9.0;
const YOUNG: f64 = 1000.0;
const PRESSURE: f64 = 1.0;

struct Cylinder {
    poisson: f64,
}

impl Cylinder {
    /// A and B of u_r = A r + B/r.
    fn factors(&self) -> (f64, f64) {
        let c = (1.0 + self.poisson) * PRESSURE * INNER.powi(2) / (YOUNG * (OUTER.powi(2) - INNER.powi(2)));
        (c * (1.0 - 2.0 * self.poisson), c * OUTER.powi(2))
    }
}

impl Exact for Cylinder {
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let (linear, inverse) = self.factors();
        let r = Vector3::new(x.x, x.y, 0.0);
        r * (linear + inverse / r.norm_squared())
    }

    /// (A + B/r²) P - 2B/r⁴ r⊗r with P the projector off the axis.
    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        let (linear, inverse) = self.factors();
        let r = Vector3::new(x.x, x.y, 0.0);
        let square = r.norm_squared();
        Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) * (linear + inverse / square)
            - r * r.transpose() * (2.0 * inverse / (square * square))
    }
}

fn solve(element: &Element, size: u32, ratios: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    let n = element.cells(size);
    let height = (OUTER - INNER) / f64::from(n);
    let mut body = Body::kuhn(element, [n, 2 * n, 1], |place| {
        let (sin, cos) = (FRAC_PI_2 * place.y).sin_cos();
        let radius = INNER + (OUTER - INNER) * place.x;
        Vector3::new(radius * cos, radius * sin, height * place.z)
    })?;
    body.fix(|place| place.y == 1.0, 0, |_| 0.0);
    body.fix(|place| place.y == 0.0, 1, |_| 0.0);
    body.fix(|place| place.z == 0.0 || place.z == 1.0, 2, |_| 0.0);
    body.load(|place| place.x == 0.0, |_, normal| normal * -PRESSURE);
    let inner = body.node_at([0.0, 0.0, 0.0])?;

    let mut measures = Vec::new();
    for &poisson in ratios {
        let exact = Cylinder { poisson };
        let lame = Lame::from_young_poisson(YOUNG, poisson);
        let solution = body.solve(element, lame)?;
        let norms = solution.norms(&body.mesh, element, lame, &exact);
        let reference = exact.displacement(&body.mesh.nodes[inner]).x;
        let value = solution.displacement[inner].x;
        let (l2, energy) = element.promised(poisson);
        measures.extend([
            solution.value(format!("u_r(a), ν {poisson}"), value, reference, 0.0, Bound::NONE),
            solution.norm(format!("L2, ν {poisson}"), norms.l2, l2),
            solution.norm(format!("energy, ν {poisson}"), norms.energy, energy),
        ]);
    }
    Ok(measures)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::problem::POISSON;

    /// The table of MacNeal and Harder, with more digits.
    #[test]
    fn displacements_are_the_published_ones() {
        let published = [0.004_582_5, 0.005_039_925, 0.005_060_249_25, 0.005_062_274_992_5];
        for (poisson, expected) in POISSON.into_iter().zip(published) {
            let found = Cylinder { poisson }.displacement(&Vector3::new(0.0, INNER, 7.0)).y;
            assert!((found / expected - 1.0).abs() < 1e-12, "ν {poisson}: {found}");
        }
    }

    #[test]
    fn walls_carry_the_pressure_and_nothing() {
        for poisson in POISSON {
            let lame = Lame::from_young_poisson(YOUNG, poisson);
            let direction = Vector3::new(0.6, 0.8, 0.0);
            for (radius, expected) in [(INNER, -PRESSURE), (OUTER, 0.0)] {
                let h = Cylinder { poisson }.gradient(&(direction * radius));
                let stress = Matrix3::from_diagonal_element(lame.lambda * h.trace()) + h * (2.0 * lame.mu);
                assert!((stress * direction - direction * expected).amax() < 1e-11, "{stress}");
            }
        }
    }
}
