//! A smooth problem on the body's own mesh, where the theory promises rates of convergence.
//!
//! The field of a point force beside the body (Kelvin's solution) is prescribed on its whole surface; inside the body the
//! exact solution is known. With r from the source, G the shear modulus:
//!
//! ```text
//! u = ((3-4ν) F + r (r·F)/r²) / (16π G (1-ν) r)
//! ```
//!
//! (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 135).

use super::body::{Body, ProblemError};
use super::course::{Course, Step};
use super::data::SmoothError;
use super::exact::{Exact, Level, rate};
use super::request::MeasureError;
use crate::base::extent::bounding_box;
use crate::fem::{ELEMENTS, Element, Lame, NodeFields};
use crate::mesh::{Surface, TetMesh, quality};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

/// Poisson's ratio of the problem. Nothing locks at this value: the problem tests meshes and elements, not the material.
const POISSON: f64 = 0.3;

/// The field of the force (0.3, -0.7, 1) at (1.6, 1.3, -0.4), E = 1.
pub struct Kelvin {
    poisson: f64,
    pub lame: Lame,
}

impl Kelvin {
    const FORCE: [f64; 3] = [0.3, -0.7, 1.0];
    const SOURCE: [f64; 3] = [1.6, 1.3, -0.4];

    pub fn new(poisson: f64) -> Kelvin {
        Kelvin { poisson, lame: Lame::from_young_poisson(1.0, poisson) }
    }

    fn scale(&self) -> f64 {
        1.0 / (16.0 * PI * self.lame.mu * (1.0 - self.poisson))
    }
}

impl Exact for Kelvin {
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let (r, force) = (x - Vector3::from(Self::SOURCE), Vector3::from(Self::FORCE));
        let distance = r.norm();
        let along = r * (r.dot(&force) / distance.powi(2));
        (force * (3.0 - 4.0 * self.poisson) + along) * (self.scale() / distance)
    }

    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        let (r, force) = (x - Vector3::from(Self::SOURCE), Vector3::from(Self::FORCE));
        let (distance, along) = (r.norm(), r.dot(&force));
        let turned = r * force.transpose() - force * r.transpose() * (3.0 - 4.0 * self.poisson);
        let radial = r * r.transpose() * (3.0 * along / distance.powi(2));
        (turned + Matrix3::from_diagonal_element(along) - radial) * (self.scale() / distance.powi(3))
    }
}

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
        if !course.affords(&Step::smooth(element)) {
            continue;
        }
        rows.append(&mut course.step_as_json(&Step::smooth(element), |_| {
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
    let (low, high) = bounding_box(&mesh.nodes);
    let size = (high - low).amax();
    let lame = Lame::from_young_poisson(1.0, POISSON);
    let exact = Placed { kelvin: Kelvin::new(POISSON), origin: low, size };
    let nodes = mesh.nodes.len();
    let mut fixed = vec![None; 3 * nodes];
    for node in Surface::from_mesh(&mesh).nodes {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// u_zz(1, 0, 0) and u_zz(0, 0, 1) of a unit force along z at the origin, E = 1, ν = 0.3.
    #[test]
    fn displacements_have_their_published_values() {
        let kelvin = Kelvin::new(0.3);
        let (force, source) = (Vector3::from(Kelvin::FORCE), Vector3::from(Kelvin::SOURCE));
        // Across and along the force, u · F̂ of a unit force is 3-4ν and 4-4ν by the same factor.
        let along = force.normalize();
        let across = along.cross(&Vector3::x()).normalize();
        for (direction, expected) in [(across, 0.133_008_059_584), (along, 0.206_901_426_019)] {
            let found = kelvin.displacement(&(source + direction)).dot(&along) / force.norm();
            assert!((found - expected).abs() < 1e-11, "{found}");
        }
    }

    #[test]
    fn the_gradient_is_the_fields_and_its_stress_is_in_equilibrium() {
        let step = 1e-4;
        let x = Vector3::new(0.3, 0.8, 0.4);
        for poisson in [0.3, 0.49, 0.499, 0.4999] {
            let kelvin = Kelvin::new(poisson);
            let stress = |x: &Vector3<f64>| {
                let h = kelvin.gradient(x);
                let pressure = Matrix3::from_diagonal_element(kelvin.lame.lambda * h.trace());
                pressure + (h + h.transpose()) * kelvin.lame.mu
            };
            let mut force = Vector3::zeros();
            for axis in 0..3 {
                let (before, after) = (x - Vector3::ith(axis, step), x + Vector3::ith(axis, step));
                let slope = (kelvin.displacement(&after) - kelvin.displacement(&before)) / (2.0 * step);
                assert!((slope - kelvin.gradient(&x).column(axis)).amax() < 1e-8, "ν {poisson}");
                force += (stress(&after) - stress(&before)).column(axis) / (2.0 * step);
            }
            assert!(force.amax() < 1e-6 * stress(&x).amax(), "ν {poisson}: {force}");
        }
    }
}
