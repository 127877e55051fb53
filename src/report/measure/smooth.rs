//! A smooth problem on the body's own mesh, where the theory promises rates of convergence.
//!
//! The field of a point force beside the body (Kelvin's solution) is prescribed on its whole surface; inside the body the
//! exact solution is known.

use super::course::Course;
use super::names;
use super::request::MeasureError;
use crate::fem::{ELEMENTS, Lame, NodeFields};
use crate::mesh::{Surface, TetMesh, quality};
use crate::report::data::SmoothError;
use crate::verify::{Body, Element, Exact, Kelvin, Level, ProblemError, rate};
use nalgebra::{Matrix3, Vector3};

/// Poisson's ratio of the problem. Nothing locks at this value: the problem tests meshes and elements, not the material.
const POISSON: f64 = 0.3;

/// Kelvin's field in a body of another size and place: u(x) = u_K((x - origin) / size).
struct Placed {
    kelvin: Kelvin,
    origin: Vector3<f64>,
    size: f64,
}

impl Exact for Placed {
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.kelvin.displacement(&((x - self.origin) / self.size))
    }

    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        self.kelvin.gradient(&((x - self.origin) / self.size)) / self.size
    }
}

/// Errors of every element on each of `levels` refinements; none where a single one has no rate. `mesh_of` returns `None` where the
/// mesh would be too large.
pub fn measure(
    mesh_of: &dyn Fn(&'static Element, u32) -> Option<TetMesh>,
    levels: u32,
    course: &Course<'_>,
) -> Result<Vec<SmoothError>, MeasureError> {
    let mut rows = Vec::new();
    for &element in ELEMENTS.iter().filter(|_| levels > 1) {
        if !course.affords(&names::smooth(element)) {
            continue;
        }
        rows.append(&mut course.step_as_json(&names::smooth(element), |_| {
            let meshes = (0..levels).filter_map(|refine| Some((refine, mesh_of(element, refine)?)));
            let own = meshes.map(|(refine, mesh)| solve(element, refine, mesh));
            let mut own = own.collect::<Result<Vec<SmoothError>, ProblemError>>()?;
            let fitted = |error: fn(&SmoothError) -> f64| {
                let level = |row: &SmoothError| Level {
                    h: row.h,
                    nodes: 0,
                    value: 0.0,
                    error: error(row),
                    seconds: 0.0,
                };
                rate(&own.iter().map(level).collect::<Vec<_>>(), 0.0)
            };
            let rates = (fitted(|row| row.l2), fitted(|row| row.energy));
            own.iter_mut().for_each(|row| (row.l2_rate, row.energy_rate) = rates);
            Ok(own)
        })?);
    }
    Ok(rows)
}

fn solve(element: &Element, refine: u32, mesh: TetMesh) -> Result<SmoothError, ProblemError> {
    let (low, high) = quality::bounding_box(&mesh.nodes);
    let size = (high - low).amax();
    let lame = Lame::from_young_poisson(1.0, POISSON);
    let exact = Placed { kelvin: Kelvin::new(POISSON), origin: low, size };
    let nodes = mesh.nodes.len();
    let mut fixed = vec![None; 3 * nodes];
    for node in Surface::of(&mesh).nodes {
        let u = exact.displacement(&mesh.nodes[node as usize]);
        (0..3).for_each(|axis| fixed[3 * node as usize + axis] = Some(u[axis]));
    }
    let volume: f64 = (0..mesh.tets.len()).map(|tet| quality::signed_volume(&mesh.corners(tet))).sum();
    let h = (volume / mesh.tets.len() as f64).cbrt();
    let place = mesh.nodes.clone();
    let body = Body { place, force: NodeFields::zeros(nodes, 1), fixed, mesh };
    let solution = body.solve(element, lame)?;
    let norms = solution.norms(&body.mesh, element, lame, &exact);
    let order = f64::from(element.order);
    Ok(SmoothError {
        element: element.name.into(),
        refine,
        h,
        l2: norms.l2,
        energy: norms.energy,
        l2_rate: None,
        energy_rate: None,
        promised: [order + 1.0, order],
    })
}
