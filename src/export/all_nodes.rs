//! Bodies that are solved anew over all their nodes, by the linear theory in f64.
//!
//! In: a scene, and what is summed over the surface from a .green file that is gone afterwards. Out: u = Σ c_k u⁽ᵏ⁾ + Σ λ_j u_j at every
//! node of the mesh; forces, stress and warnings are those of the surface, as without it.

use super::asked::PoseRequest;
use super::result_set::{PoseResult, StressResult};
use crate::base::diagnostic;
use crate::base::failure::Failure;
use crate::deform::ControlPose;
use crate::green::{self, GreenFile, LOAD_FIELDS, Precomputed, Solution, UPDATES};
use crate::prepare::Resolved;
use crate::scene::Storage;
use crate::solve::Silent;
use nalgebra::Vector3;
use std::sync::Arc;

/// Bodies with their solutions.
pub(super) struct AllNodes {
    bodies: Vec<Precomputed>,
    pub(super) file: Arc<GreenFile>,
}

impl AllNodes {
    /// Solves the bodies of a scene; fails for models other than the linear theory, and for poses with forces at points.
    pub(super) fn solve(scene: &Resolved, asked: &[PoseRequest<'_>]) -> Result<AllNodes, Failure> {
        if let Some((name, body)) = scene.bodies.iter().find(|(_, body)| !body.model.is_linear()) {
            let message =
                format!("--all-nodes solves the linear theory, not the model \"{}\"", body.model.name);
            return Err(Failure::request(scene.invalid(&format!("body.{name}.model"), message)));
        }
        let has_forces = |asked: &&PoseRequest<'_>| {
            scene.bodies.contains_key(asked.body) && !asked.loads.forces.is_empty()
        };
        if let Some(asked) = asked.iter().find(has_forces) {
            let message = "forces at points are summed from the .green file: leave --all-nodes out";
            return Err(Failure::wrong(format!("{}: {message}", asked.place())));
        }
        let solved = |name: &String| -> Result<Precomputed, Failure> {
            let requirements = scene.requirements(name)?.without(UPDATES).only_families();
            let solution = green::solve(scene, name, &requirements, &Silent)?;
            diagnostic::report("", &solution.notices);
            Ok(Precomputed::from_solution(name, Storage::F32, requirements, solution))
        };
        let bodies: Vec<Precomputed> = scene.body.keys().map(solved).collect::<Result<_, _>>()?;
        let file = green::opened(&bodies)?;
        Ok(AllNodes { bodies, file })
    }

    pub(super) fn solution(&self, name: &str) -> Option<&Solution> {
        self.bodies.iter().find(|body| body.name == name).map(|body| &body.solution)
    }
}

/// A result over the surface as one over all nodes.
pub(super) fn spread(result: PoseResult, solution: &Solution) -> PoseResult {
    let c: Vec<f64> = result.told.control.iter().flat_map(ControlPose::coefficients).collect();
    let loads = solution.tables.get(LOAD_FIELDS);
    let loaded = |row: usize| {
        let columns = loads.into_iter().flat_map(|fields| (0..fields.ncols()).map(move |k| fields[(row, k)]));
        columns.zip(&result.told.loads.coefficients).map(|(u, c)| u * c).sum::<f64>()
    };
    let value =
        |row: usize| solution.fields.row(row).iter().zip(&c).map(|(u, c)| u * c).sum::<f64>() + loaded(row);
    let nodes = solution.mesh.nodes.len();
    let displacement = (0..nodes).map(|node| Vector3::from_fn(|axis, _| value(3 * node + axis))).collect();
    let stress = result.stress.map(|stress| stress.spread(&solution.surface.nodes, nodes));
    PoseResult { displacement, stress, ..result }
}

impl StressResult {
    /// Stress of a surface as one of all nodes of its mesh, `nodes` naming those of the surface.
    pub(super) fn spread(self, nodes: &[u32], all: usize) -> StressResult {
        let mut spread = StressResult { nodes: vec![None; all], reached: self.reached };
        for node in [&mut spread.reached.von_mises.1, &mut spread.reached.strain.1] {
            *node = nodes.get(*node).map_or(0, |&node| node as usize);
        }
        for (&node, at) in nodes.iter().zip(self.nodes) {
            spread.nodes[node as usize] = at;
        }
        spread
    }
}
