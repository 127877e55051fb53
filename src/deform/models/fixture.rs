//! Bodies that tests deform with one model, and the checks that every model with an energy passes.

use crate::base::parts::PartShare;
use crate::base::progress::Silent;
use crate::deform::model::{DeformationModel, ModelEntry};
use crate::deform::models::model_of;
use crate::deform::pose::frame::{ControlPose, PoseSlope};
use crate::deform::pose::se3::exp;
use crate::green::{self, Requirements, Solution};
use crate::scene::Scene;
use nalgebra::{Matrix3, Point3, Rotation3, Vector3, Vector6};

/// A body with a model of it.
pub struct Body {
    pub solution: Solution,
    pub model: Box<dyn DeformationModel>,
    centre: Vector3<f64>,
}

impl Body {
    /// The scene's body "b".
    pub fn new(scene: &Scene, entry: &ModelEntry) -> Body {
        let solution = green::solve(scene, "b", &Requirements::new(entry.requirements), &Silent).unwrap();
        let (model, centre) = model_of(entry, &solution).unwrap();
        Body { solution, model, centre }
    }

    pub fn respond<const N: usize>(&mut self, poses: &[ControlPose]) -> (f64, [PoseSlope; N]) {
        let mut slopes = [PoseSlope::default(); N];
        let response = self.model.respond(poses, &mut slopes).unwrap();
        assert!(response.is_defined);
        (response.energy, slopes)
    }

    /// Displacements of the surface nodes, m.
    pub fn shape(&mut self, poses: &[ControlPose]) -> Vec<Vector3<f64>> {
        let nodes = &self.solution.surface.nodes;
        let rest: Vec<Vector3<f64>> =
            nodes.iter().map(|&node| self.solution.mesh.nodes[node as usize] - self.centre).collect();
        let single: Vec<[f32; 3]> = rest.iter().map(|x| x.cast::<f32>().into()).collect();
        let state = self.model.state(poses);
        let weights = self.model.part_weights(&single);
        let field = self.model.field().unwrap();
        let place = |i: usize| -> Vector3<f64> {
            let y = Point3::from(rest[i] + Vector3::from(field[i]).cast());
            let share =
                |share: &PartShare| (state.parts[share.part as usize] * y).coords * f64::from(share.weight);
            let moved = match &weights {
                Some(weights) => weights.at(i).iter().map(share).sum::<Vector3<f64>>(),
                None => (state.parts[0] * y).coords,
            };
            moved - rest[i]
        };
        (0..rest.len()).map(place).collect()
    }

    /// The nodes of control elements go exactly where these are held.
    pub fn assert_held_nodes_follow(&mut self, poses: &[ControlPose]) {
        let shape = self.shape(poses);
        let nodes = &self.solution.surface.nodes;
        for (control, pose) in self.solution.controls.iter().zip(poses) {
            for (i, node) in nodes.iter().enumerate().filter(|(_, node)| control.nodes.contains(node)) {
                let arm = self.solution.mesh.nodes[*node as usize] - control.origin;
                let expected = pose.translation + (pose.matrix - Matrix3::identity()) * arm;
                assert!((shape[i] - expected).amax() < 1e-6, "{} {expected}", shape[i]);
            }
        }
    }
}

/// The last of two elements turned about its own place, and moved.
pub fn pose(turn: Vector3<f64>, shift: Vector3<f64>) -> [ControlPose; 2] {
    let matrix = *Rotation3::from_scaled_axis(turn).matrix();
    [ControlPose::REST, ControlPose { translation: shift, matrix }]
}

/// The end of an arc of a line along x, in the plane of x and y.
pub fn bend(degrees: f64, length: f64) -> [ControlPose; 2] {
    let angle = degrees.to_radians();
    let end = exp(&Vector6::new(length, 0.0, 0.0, 0.0, 0.0, angle)).translation.vector;
    pose(Vector3::z() * angle, end - Vector3::x() * length)
}

pub fn twist(degrees: f64) -> [ControlPose; 2] {
    pose(Vector3::x() * degrees.to_radians(), Vector3::zeros())
}

/// The slopes by all twelve numbers of every pose are within `bound` of central differences of the energy over `step`.
pub fn assert_slopes(model: &mut dyn DeformationModel, poses: &[ControlPose], step: f64, bound: f64) {
    let mut respond = |poses: &[ControlPose], slopes: &mut [PoseSlope]| {
        let response = model.respond(poses, slopes).unwrap();
        assert!(response.is_defined);
        response.energy
    };
    let mut slopes = vec![PoseSlope::default(); poses.len()];
    respond(poses, &mut slopes);
    let mut others = slopes.clone();
    for (e, k) in (0..poses.len()).flat_map(|e| (0..12).map(move |k| (e, k))) {
        let mut energy = |by: f64| {
            let mut moved = poses.to_vec();
            match k {
                0..3 => moved[e].translation[k] += by,
                _ => moved[e].matrix[(k / 3 - 1, k % 3)] += by,
            }
            respond(&moved, &mut others)
        };
        let expected = (energy(step) - energy(-step)) / (2.0 * step);
        let found = match k {
            0..3 => slopes[e].translation[k],
            _ => slopes[e].matrix[(k / 3 - 1, k % 3)],
        };
        assert!((found - expected).abs() < bound, "element {e}, {k}: {found} {expected} within {bound}");
    }
}
