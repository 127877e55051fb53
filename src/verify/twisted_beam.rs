//! MacNeal and Harder's twisted beam.
//!
//! A cantilever along x, 12 long, whose section of 1.1 × 0.32 turns by 90° from root to tip; E = 29e6, ν = 0.22. A unit
//! force spread over the end section, along z or along y; the displacement of the section's middle in its direction. At
//! the root the section is 1.1 along y and 0.32 along z.

use super::body::Body;
use super::problem::{Problem, ProblemError};
use super::solution::{Bound, Measure};
use crate::fem::{Element, Lame};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::FRAC_PI_2;

pub const PROBLEM: Problem = Problem {
    name: "twisted-beam",
    about: "cantilever twisted by 90°, unit force at the end: displacement of the end's middle in its direction",
    source: "MacNeal and Harder, Finite Elem. Anal. Des. 1 (1985) 3-20: 0.005424 and 0.001754; more digits by beam \
             theory: Zupan and Saje, Finite Elem. Anal. Des. 40 (2004) 1445-1451",
    sizes: [1, 2, 3, 4],
    solve,
};

/// Reference displacements along the root's depth and along the root's width.
const ALONG_Z: f64 = 0.005_424_534_868_469;
const ALONG_Y: f64 = 0.001_753_248_285_256;
/// A beam's sections swell freely at the clamp, a solid's do not.
const KNOWN_TO: f64 = 0.001;
const WITHIN: f64 = 0.005;

const LENGTH: f64 = 12.0;
const WIDTH: f64 = 1.1;
const DEPTH: f64 = 0.32;

fn shape(place: &Vector3<f64>) -> Vector3<f64> {
    let section = Vector3::new(0.0, WIDTH * (place.y - 0.5), DEPTH * (place.z - 0.5));
    Rotation3::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2 * place.x) * section
        + Vector3::new(LENGTH * place.x, 0.0, 0.0)
}

fn solve(element: &Element, size: u32, _: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    let n = element.cells(size);
    let bound = if element.order == 2 { Bound::error(WITHIN) } else { Bound::NONE };
    let mut measures = Vec::new();
    for (quantity, axis, reference) in [("u_z for F_z", 2, ALONG_Z), ("u_y for F_y", 1, ALONG_Y)] {
        let mut body = Body::new(element, [12 * n, 2 * n, n], shape)?;
        for component in 0..3 {
            body.fix(|place| place.x == 0.0, component, |_| 0.0);
        }
        body.load(|place| place.x == 1.0, |_, _| Vector3::ith(axis, 1.0 / (WIDTH * DEPTH)));
        let solution = body.solve(element, Lame::from_young_poisson(29.0e6, 0.22))?;
        let tip = solution.displacement[body.node_at([1.0, 0.5, 0.5])?];
        measures.push(solution.value(quantity, tip[axis], reference, KNOWN_TO, bound));
    }
    Ok(measures)
}
