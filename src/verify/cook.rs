//! Cook's membrane: a tapered panel, clamped at one side and sheared at the other.
//!
//! The panel (0,0) (48,44) (48,60) (0,44), held at x = 0, with a vertical force F spread over x = 48; the vertical
//! displacement of that side's middle and of its upper corner. At (0, 44) the stress is singular, so rates are low for
//! every element (Cook, J. Struct. Div. ASCE 100, 1974, 1851-1863). Plane strain takes Kuhn's split, as the cylinder.

use super::body::Body;
use super::problem::{Problem, ProblemError};
use super::solution::{Bound, Measure};
use crate::fem::{Element, Lame};
use nalgebra::Vector3;

pub const PLANE_STRESS: Problem = Problem {
    name: "cook-plane-stress",
    about: "Cook's membrane, E 1, ν 1/3, F 1, thickness 1: half of a slab with a free face and a face of symmetry",
    source: "middle 23.966, corner 25.17: quadratic quadrilaterals on 64×64 cells, extrapolated; 23.96 to 23.97 in the \
             literature on Cook, J. Struct. Div. ASCE 100 (1974) 1851-1863",
    sizes: [12, 24, 48, 72],
    solve: plane_stress,
};

pub const PLANE_STRAIN: Problem = Problem {
    name: "cook-plane-strain",
    about: "Cook's membrane nearly incompressible, E 240.565, ν 0.4999, F 100: a slab between frictionless walls",
    source: "middle 7.69, corner 8.06: quadratic quadrilaterals on 64×64 cells, extrapolated",
    sizes: [12, 24, 48, 72],
    solve: plane_strain,
};

/// Vertical displacement of (48, 52) and of (48, 60).
const STRESS_VALUES: [f64; 2] = [23.966, 25.17];
const STRESS_KNOWN_TO: f64 = 0.001;
const STRAIN_VALUES: [f64; 2] = [7.69, 8.06];
const STRAIN_KNOWN_TO: f64 = 0.005;
const WITHIN: f64 = 0.02;
const SIDE: f64 = 16.0;

fn shape(place: &Vector3<f64>, thickness: f64) -> Vector3<f64> {
    Vector3::new(48.0 * place.x, 44.0 * place.x + place.y * (44.0 - 28.0 * place.x), thickness * place.z)
}

fn plane_stress(element: &Element, size: u32, _: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    const HALF: f64 = 0.5;
    let n = element.cells(size);
    let mut body = Body::new(element, [n, n, 1], |place| shape(place, HALF))?;
    body.fix(|place| place.z == 0.0, 2, |_| 0.0);
    clamp_and_load(&mut body, 1.0 / SIDE);
    measure(&body, element, Lame::from_young_poisson(1.0, 1.0 / 3.0), STRESS_VALUES, STRESS_KNOWN_TO)
}

fn plane_strain(element: &Element, size: u32, _: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    let n = element.cells(size);
    let height = 48.0 / f64::from(n);
    let mut body = Body::kuhn(element, [n, n, 1], |place| shape(place, height))?;
    body.fix(|place| place.z == 0.0 || place.z == 1.0, 2, |_| 0.0);
    clamp_and_load(&mut body, 100.0 / SIDE);
    measure(&body, element, Lame::from_young_poisson(240.565, 0.4999), STRAIN_VALUES, STRAIN_KNOWN_TO)
}

/// `shear` in N a unit of area.
fn clamp_and_load(body: &mut Body, shear: f64) {
    for axis in 0..2 {
        body.fix(|place| place.x == 0.0, axis, |_| 0.0);
    }
    body.load(|place| place.x == 1.0, |_, _| Vector3::new(0.0, shear, 0.0));
}

fn measure(
    body: &Body,
    element: &Element,
    lame: Lame,
    reference: [f64; 2],
    known_to: f64,
) -> Result<Vec<Measure>, ProblemError> {
    let solution = body.solve(element, lame)?;
    let bound = if element.order == 2 { Bound::error(WITHIN) } else { Bound::NONE };
    let vertical = |y: f64| Ok::<f64, ProblemError>(solution.displacement[body.node_at([1.0, y, 0.0])?].y);
    Ok(vec![
        solution.value("v(48, 52)", vertical(0.5)?, reference[0], known_to, bound),
        solution.value("v(48, 60)", vertical(1.0)?, reference[1], known_to, bound),
    ])
}
