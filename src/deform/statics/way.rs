//! The way of a body from one equilibrium to a pose under loads.
//!
//! In: the body in the equilibrium where the way begins, the ways of its control elements, and the forces at both ends. Out: the
//! [`Newton`] problem of that way with its path, and the body at its end. Forces and warmth grow in proportion to the share of the way.

use super::critical::{CriticalPose, Ways};
use super::freedom::Freedom;
use super::outcome::Branch;
use super::pushed::{PushedControls, prescribe};
use crate::deform::pose::follow::FollowedTurn;
use crate::deform::pose::frame::{ControlPose, ControlPoses, Wrench};
use crate::fem::{Element, Hyperelastic, Lame, Law, NodeFields, Partition};
use crate::green::ControlElement;
use crate::mesh::TetMesh;
use crate::solve::{
    Equilibrium, LAST_STEP, LinearSolver, Loads, Newton, Passed, Path, Pushed, SolveError, WarmBody,
};
use nalgebra::Vector3;
use std::cell::RefCell;
use std::sync::Arc;

/// Steps in which the turn of a free control element is followed.
const TURNED_STEPS: usize = 12;

pub(super) const NO_WRENCH: Wrench =
    Wrench { force: Vector3::new(0.0, 0.0, 0.0), moment: Vector3::new(0.0, 0.0, 0.0) };

/// A body held in a pose, from which another may go on; all but for the shift that its control elements have in common.
#[derive(Clone, Debug)]
pub struct HeldBody {
    pub(super) poses: ControlPoses,
    /// Turn of each control element since rest, whole turns included.
    pub(super) turns: Vec<FollowedTurn>,
    pub(super) u: NodeFields,
    /// Forces on the nodes, N, and stretch by warmth, in this equilibrium.
    pub(super) forces: NodeFields,
    pub(super) stretch: f64,
    /// The wrench on every control element, about its place.
    pub(super) wrenches: Vec<Wrench>,
    pub(super) branch: Branch,
}

/// The parts of a body that its ways need.
#[derive(Clone, Copy)]
pub(super) struct StaticBody<'a> {
    pub mesh: &'a TetMesh,
    pub controls: &'a [ControlElement],
    /// The elements, as warm as at the end of the way.
    pub body: &'a Arc<Hyperelastic>,
    pub element: &'static Element,
    pub lame: &'a [Lame],
    /// Freedom of each control element; empty if nothing is free or pushed.
    pub freedom: &'a [Freedom],
    /// Factor by which warmth lengthens the body at the end of the way.
    pub stretch: f64,
    pub partition: &'a Partition,
    pub solver: Option<&'a dyn LinearSolver>,
}

/// The way of a body from one equilibrium to a pose under loads.
pub(super) struct BodyWay<'a> {
    pub body: StaticBody<'a>,
    pub start: &'a HeldBody,
    pub poses: &'a ControlPoses,
    pub told: Ways<'a>,
    pub steps: usize,
    /// Forces on the nodes at its end, N.
    pub forces: NodeFields,
}

/// The body that warmth lengthens by `stretch` where it is free.
pub(super) fn warmed(
    element: &Element,
    law: &'static Law,
    mesh: &TetMesh,
    lame: &[Lame],
    stretch: f64,
) -> Result<Arc<Hyperelastic>, SolveError> {
    let body = Hyperelastic::stretched(element, law, mesh, lame, stretch);
    body.map(Arc::new).map_err(|source| SolveError::Warmth { stretch, source: Box::new(source) })
}

impl BodyWay<'_> {
    /// Forces on the nodes at a share of the way.
    pub fn forces_at(&self, share: f64) -> NodeFields {
        let both = self.start.forces.data.iter().zip(&self.forces.data);
        NodeFields { data: both.map(|(from, to)| from + share * (to - from)).collect(), ..self.forces }
    }

    /// Runs `then` with the problem of this way, its path and what is pushed.
    pub fn lead<T>(&self, then: impl FnOnce(&Newton<'_>, &Path<'_>, &PushedControls<'_>) -> T) -> T {
        let StaticBody { mesh, controls, body, element, lame, freedom, stretch, partition, solver } =
            self.body;
        let poses = |share: f64| -> ControlPoses {
            if share == 1.0 {
                self.poses.clone()
            } else {
                self.told.ways.iter().map(|way| way.pose(share)).collect()
            }
        };
        let path = |share: f64, u: &mut NodeFields| {
            for (control, pose) in controls.iter().zip(poses(share)) {
                prescribe(control, mesh, &pose, u);
            }
        };
        let start = &self.start.wrenches;
        let pushed = PushedControls { controls, mesh, freedom, poses: &poses, start };
        let forces = |share: f64| self.forces_at(share);
        // The bodies at the beginning and at the end of a step.
        let made: RefCell<Vec<(f64, Arc<Hyperelastic>)>> = RefCell::new(Vec::new());
        let warm = |share: f64| -> Result<Arc<Hyperelastic>, SolveError> {
            let now = self.start.stretch + share * (stretch - self.start.stretch);
            if now == stretch {
                return Ok(body.clone());
            }
            let mut made = made.borrow_mut();
            if let Some((_, known)) = made.iter().find(|(of, _)| *of == now) {
                return Ok(known.clone());
            }
            let warmed = warmed(element, body.law, mesh, lame, now)?;
            if made.len() == 2 {
                made.remove(0);
            }
            made.push((now, warmed.clone()));
            Ok(warmed)
        };
        let acts = |forces: &NodeFields| forces.data.iter().any(|force| *force != 0.0);
        let is_warmed = self.start.stretch != stretch;
        let is_loaded = acts(&self.start.forces) || acts(&self.forces) || is_warmed || stretch != 1.0;
        let loads = Loads {
            forces: &forces,
            warm: is_warmed.then_some(&warm as &WarmBody<'_>),
            pushed: (!freedom.is_empty()).then_some(&pushed as &dyn Pushed),
        };
        let newton = Newton {
            body,
            partition,
            solver,
            loads: (is_loaded || !freedom.is_empty()).then_some(loads),
            last_step: LAST_STEP,
        };
        then(&newton, &path, &pushed)
    }

    /// The turns of the control elements at the end of the way, after the motions of what is pushed.
    pub fn turned(&self, pushed: &PushedControls<'_>, q: &[f64]) -> Vec<FollowedTurn> {
        let mut turns = self.told.turns(1.0);
        for step in 1..=TURNED_STEPS {
            let part = step as f64 / TURNED_STEPS as f64;
            let q: Vec<f64> = q.iter().map(|q| q * part).collect();
            for (turn, pose) in turns.iter_mut().zip(pushed.moved(1.0, &q)) {
                *turn = turn.follow(&pose);
            }
        }
        turns
    }

    pub fn critical(&self, passed: &Passed) -> CriticalPose {
        let strained = (&self.body.body.points, &passed.gradients[..]);
        self.told.critical(passed.share, &passed.stability, self.body.mesh, strained)
    }

    /// The body at the end of the way.
    pub fn held(
        &self,
        at: &Equilibrium,
        poses: ControlPoses,
        turns: Vec<FollowedTurn>,
        branch: Branch,
    ) -> HeldBody {
        let StaticBody { controls, mesh, stretch, .. } = self.body;
        let of = |fields: &NodeFields, node: usize| Vector3::from_column_slice(&fields.data[3 * node..][..3]);
        let wrench = |(control, pose): (&ControlElement, &ControlPose)| {
            let mut wrench = NO_WRENCH;
            let place = control.origin + pose.translation;
            for node in control.nodes.iter().map(|&node| node as usize) {
                let force = of(&at.forces, node);
                wrench.force += force;
                wrench.moment += (mesh.nodes[node] + of(&at.u, node) - place).cross(&force);
            }
            wrench
        };
        let wrenches = controls.iter().zip(&poses).map(wrench).collect();
        let (u, forces, stretch) = (at.u.clone(), self.forces.clone(), stretch);
        HeldBody { poses, turns, u, forces, stretch, wrenches, branch }
    }
}
