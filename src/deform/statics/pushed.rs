//! Control elements that are free in some directions, on the way of a body that is solved anew: their motions are unknowns of its
//! equilibrium.
//!
//! In: the poses as they are asked for at a share of the way, which directions are free, and what pushes along them where the way
//! begins and ends. Out: the nodes' places, their motions and the forces along them. With q = (q_T, q_ω) an element stands at
//! T + q_T and exp(\[q_ω\]) M; its nodes at x move by e_k and by (V(q_ω) e_k) × (x - o - T - q_T), V being that of [`slide_matrix`],
//! and its moment m about its place does the work V(q_ω)ᵀ m along q_ω.

use super::freedom::Freedom;
use crate::deform::pose::frame::{ControlPose, ControlPoses, Wrench};
use crate::deform::pose::se3::slide_matrix;
use crate::fem::NodeFields;
use crate::green::ControlElement;
use crate::mesh::TetMesh;
use crate::solve::Pushed;
use nalgebra::{Matrix3, Rotation3, Vector3};

pub(super) struct PushedControls<'a> {
    pub controls: &'a [ControlElement],
    pub mesh: &'a TetMesh,
    pub freedom: &'a [Freedom],
    /// The poses without the motions, at a share of the way.
    pub poses: &'a dyn Fn(f64) -> ControlPoses,
    /// The wrenches that hold the control elements where the way begins, about their places.
    pub start: &'a [Wrench],
}

impl PushedControls<'_> {
    /// Element and component of each motion.
    pub fn unknowns(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let of = |(e, of): (usize, &Freedom)| {
            let free = of.free;
            (0..6).filter(move |&k| free[k]).map(move |k| (e, k))
        };
        self.freedom.iter().enumerate().flat_map(of)
    }

    /// The turn vector of each element's motions.
    fn turns(&self, q: &[f64]) -> Vec<Vector3<f64>> {
        let mut turns = vec![Vector3::zeros(); self.controls.len()];
        for ((e, k), q) in self.unknowns().zip(q).filter(|((_, k), _)| *k >= 3) {
            turns[e][k - 3] = *q;
        }
        turns
    }

    /// The poses after the motions `q`.
    pub fn moved(&self, share: f64, q: &[f64]) -> ControlPoses {
        let mut poses = (self.poses)(share);
        for ((e, k), q) in self.unknowns().zip(q).filter(|((_, k), _)| *k < 3) {
            poses[e].translation[k] += q;
        }
        for (pose, turn) in poses.iter_mut().zip(self.turns(q)) {
            pose.matrix = Rotation3::from_scaled_axis(turn).matrix() * pose.matrix;
        }
        poses
    }
}

/// u = T + (M - I)(X - o) on the element's nodes.
pub(super) fn prescribe(control: &ControlElement, mesh: &TetMesh, pose: &ControlPose, u: &mut NodeFields) {
    let gradient = pose.matrix - Matrix3::identity();
    for &node in &control.nodes {
        let moved = pose.translation + gradient * (mesh.nodes[node as usize] - control.origin);
        u.data[3 * node as usize..][..3].copy_from_slice(moved.as_slice());
    }
}

impl Pushed for PushedControls<'_> {
    fn count(&self) -> usize {
        self.unknowns().count()
    }

    fn place(&self, share: f64, q: &[f64], u: &mut NodeFields) {
        let poses = self.moved(share, q);
        for ((control, pose), freedom) in self.controls.iter().zip(&poses).zip(self.freedom) {
            if freedom.is_any() {
                prescribe(control, self.mesh, pose, u);
            }
        }
    }

    fn motions(&self, share: f64, q: &[f64]) -> NodeFields {
        let (poses, turns) = (self.moved(share, q), self.turns(q));
        let mut motions = NodeFields::zeros(self.mesh.nodes.len(), q.len());
        for (column, (e, k)) in self.unknowns().enumerate() {
            let control = &self.controls[e];
            let spin =
                if k < 3 { Vector3::zeros() } else { slide_matrix(&turns[e]) * Vector3::ith(k - 3, 1.0) };
            for &node in &control.nodes {
                let arm = poses[e].matrix * (self.mesh.nodes[node as usize] - control.origin);
                let moved = if k < 3 { Vector3::ith(k, 1.0) } else { spin.cross(&arm) };
                for axis in 0..3 {
                    motions.row_mut(3 * node as usize + axis)[column] = moved[axis];
                }
            }
        }
        motions
    }

    fn forces(&self, share: f64, q: &[f64]) -> Vec<f64> {
        let load = |e: usize, k: usize| {
            let held = self.start[e];
            let before = if k < 3 { held.force[k] } else { held.moment[k - 3] };
            before + share * (self.freedom[e].load[k] - before)
        };
        let turns = self.turns(q);
        let along = |(e, k): (usize, usize)| {
            if k < 3 {
                return load(e, k);
            }
            let free = self.freedom[e].free;
            let moment = Vector3::from_fn(|axis, _| if free[3 + axis] { load(e, 3 + axis) } else { 0.0 });
            (slide_matrix(&turns[e]) * Vector3::ith(k - 3, 1.0)).dot(&moment)
        };
        self.unknowns().map(along).collect()
    }
}
