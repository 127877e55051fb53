//! Static equilibrium at large strain, without Green's functions: the models that are solved anew for every pose.
//!
//! In: a body of a scene, a law ([`crate::fem::LAWS`]) and poses of its control elements. Out: displacements of all
//! nodes, the energy, and the wrenches that hold the control elements. The controlled nodes go the way of [`Screw`]
//! while [`Newton`] keeps the others in equilibrium. What the other models are measured against; too slow for a frame.

use super::force::Wrench;
use super::model::{Frame, Kind, ModelEntry};
use super::pose::{ControlPose, ControlPoses};
use super::screw::Screw;
use crate::fem::{Hyperelastic, Law, NodeFields, Partition};
use crate::green::{self, ControlElement, GreenError, Prepared};
use crate::mesh::{TetMesh, quality};
use crate::scene::{Body, Scene, SceneError};
use crate::solve::{Counts, Equilibrium, LinearSolver, Newton, NewtonError, Progress, Setback, SolveError};
use nalgebra::{Matrix3, Vector3};

/// The model of bodies under `law`.
pub(super) const fn entry(law: &'static Law) -> ModelEntry {
    let (requirements, turn_limits_deg) = (&[], [180.0; 2]);
    let (frame, kind) = (Frame::Solved, Kind::Static(law));
    ModelEntry {
        name: law.name,
        summary: law.summary,
        requirements,
        frame,
        energy: None,
        turn_limits_deg,
        kind,
    }
}

/// No load step turns a control element by more, rad, …
const TURN: f64 = std::f64::consts::PI / 6.0;
/// … stretches one by more, or moves one against another by more than this part of the body's size.
const STRETCH: f64 = 0.25;
const MOST_STEPS: usize = 256;

/// A body ready to be held in any pose.
pub struct Statics {
    pub mesh: TetMesh,
    pub controls: Vec<ControlElement>,
    /// Warnings and notes of the check before it.
    pub notices: Vec<String>,
    body: Hyperelastic,
    size: f64,
    partition: Partition,
    solver: Option<Box<dyn LinearSolver>>,
    /// The last pose that was solved, and its displacements, both but for what the control elements have in common.
    last: Option<(Vec<Screw>, NodeFields)>,
}

/// A body held in a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct EquilibriumResult {
    /// Of every node of the mesh, m.
    pub displacement: Vec<Vector3<f64>>,
    /// Of every control element, about where its origin rested, with the lever arms of the deformed body.
    pub wrenches: Vec<Wrench>,
    /// Strain energy of the body, J.
    pub energy: f64,
    /// Least det F at the points of integration, and the tetrahedron that has it.
    pub least_det: (f64, usize),
    /// Tetrahedra turned inside out, det F ≤ 0 at a point.
    pub inverted: Vec<usize>,
    /// ‖f‖₂ at the free nodes over that at the controlled ones.
    pub residual: f64,
    pub counts: Counts,
}

#[derive(Debug, thiserror::Error)]
pub enum StaticsError {
    #[error(transparent)]
    Green(#[from] GreenError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error(
        "no equilibrium beyond {:.1} % of the way from {from} to this pose: {}; there, the least det F is {:.3} (in the \
         tetrahedron with nodes {tags:?}) and {} of {tets} tetrahedra are inverted. {}",
        100.0 * share, explain(*why), settled.least_det.0, settled.inverted.len(), remedy(*why, law)
    )]
    Stopped {
        /// The last state that was found.
        settled: Box<EquilibriumResult>,
        share: f64,
        from: &'static str,
        why: Setback,
        law: &'static Law,
        /// Of the corners of the tetrahedron with the least det F.
        tags: [u64; 4],
        tets: usize,
    },
}

fn explain(why: Setback) -> &'static str {
    match why {
        Setback::Unstable => {
            "the tangent stiffness is no longer positive definite, the body snaps or buckles"
        }
        Setback::NoDescent => "no step lowers the energy any more",
        Setback::Slow => "Newton's iteration does not converge",
    }
}

fn remedy(why: Setback, law: &Law) -> &'static str {
    match why {
        Setback::Slow => "Look for slivers and large contrasts of stiffness (`greenstage check`)",
        Setback::Unstable | Setback::NoDescent => law.remedy,
    }
}

impl Statics {
    /// Refuses what these models do not have.
    pub fn suits(scene: &Scene, name: &str, law: &Law) -> Result<(), SceneError> {
        let Body { solver, .. } = &scene.body[name];
        let wrong = |key: &str, message: String| Err(scene.invalid(&format!("body.{name}.{key}"), message));
        if !solver.method.is_direct {
            let message =
                format!("model \"{}\" factorises its tangent: write method = \"cholesky\"", law.name);
            return wrong("solver", message);
        }
        Ok(())
    }

    /// Body `name` of the scene under `law`, whatever the scene's own model is. Errors where the scene is refused, or
    /// asks for what these models do not have.
    pub fn new(
        scene: &Scene,
        name: &str,
        law: &'static Law,
        progress: &dyn Progress,
    ) -> Result<Statics, StaticsError> {
        Statics::suits(scene, name, law).map_err(GreenError::Scene)?;
        let prepared = green::prepare(scene, name)?;
        green::refuse(scene, &prepared.findings)?;
        let Prepared { mesh, controls, lame, findings } = prepared;
        let place = format!("{}: body.{name}", scene.path.display());
        let body = Hyperelastic::new(scene.body[name].element, law, &mesh, &lame)
            .map_err(|source| GreenError::Assembly { body: place, source })?;
        let partition =
            Partition::new(mesh.nodes.len(), controls.iter().flat_map(|c| c.nodes.iter().copied()));
        let (low, high) = quality::bounding_box(&mesh.nodes);
        let mut statics = Statics {
            notices: findings.into_iter().map(|finding| finding.to_string()).collect(),
            size: (high - low).norm(),
            solver: None,
            last: None,
            body,
            partition,
            controls,
            mesh,
        };
        if !statics.partition.free.is_empty() {
            let rest = NodeFields::zeros(statics.mesh.nodes.len(), 1);
            let k = statics.body.tangent(&statics.body.gradients(&rest));
            let a = statics.partition.a(&k);
            statics.solver = Some(scene.body[name].solver.analyse(&a, progress)?);
        }
        Ok(statics)
    }

    /// Holds the body in `poses`, one for each control element in the scene's order.
    ///
    /// Starts from the last pose that was solved where that is nearer than rest; each control element takes the
    /// shorter turn from rest either way, so that beyond a loss of stability alone the order of the poses matters.
    /// `progress` is advanced by 1000 in all.
    pub fn solve(
        &mut self,
        poses: &ControlPoses,
        progress: &dyn Progress,
    ) -> Result<EquilibriumResult, StaticsError> {
        // No law feels a common shift. With it, screw motions by different turns would tear the body on the way, and a small
        // strain would drown in the rounding of large displacements.
        let least =
            |a: &&ControlPose, b: &&ControlPose| a.translation.norm().total_cmp(&b.translation.norm());
        let shift = poses.iter().min_by(least).map_or_else(Vector3::zeros, |pose| pose.translation);
        let unshifted = |pose: &ControlPose| ControlPose { translation: pose.translation - shift, ..*pose };
        let poses: ControlPoses = poses.iter().map(unshifted).collect();
        let target: Vec<Screw> = poses.iter().map(Screw::of).collect();
        let rest = (vec![Screw::default(); poses.len()], NodeFields::zeros(self.mesh.nodes.len(), 1));
        let from_rest = self.steps(&rest.0, &target);
        let (from, (start, u)) = match self.last.take() {
            Some(last) if self.steps(&last.0, &target) < from_rest => ("the last pose", last),
            _ => ("rest", rest),
        };
        let steps = self.steps(&start, &target).clamp(1.0, MOST_STEPS as f64).ceil() as usize;
        let path = |share: f64, u: &mut NodeFields| {
            for (e, control) in self.controls.iter().enumerate() {
                let pose = if share < 1.0 { start[e].towards(&target[e], share).pose() } else { poses[e] };
                self.prescribe(control, &pose, u);
            }
        };
        let newton = Newton { body: &self.body, partition: &self.partition, solver: self.solver.as_deref() };
        match newton.follow(u, steps, &path, progress) {
            Ok(equilibrium) => {
                let settled = self.settled(&equilibrium, &shift);
                self.last = Some((target, equilibrium.u));
                Ok(settled)
            }
            Err(NewtonError::Solve(error)) => Err(error.into()),
            Err(NewtonError::Stopped { at, share, why }) => {
                let settled = Box::new(self.settled(&at, &(shift * share)));
                let tags = self.mesh.tets[settled.least_det.1].map(|node| self.mesh.tags[node as usize]);
                let tets = self.mesh.tets.len();
                Err(StaticsError::Stopped { settled, share, from, why, law: self.body.law, tags, tets })
            }
        }
    }

    /// Load steps that the way between two poses wants, not rounded.
    fn steps(&self, from: &[Screw], to: &[Screw]) -> f64 {
        let slide = |e: usize| to[e].slide - from[e].slide;
        let of = |e: usize| {
            let turn = (to[e].turn - from[e].turn).norm() / TURN;
            let stretch = (to[e].stretch - from[e].stretch).norm() / STRETCH;
            turn.max(stretch).max((slide(e) - slide(0)).norm() / (STRETCH * self.size))
        };
        (0..to.len()).map(of).fold(0.0, f64::max)
    }

    /// u = T + (M - I)(X - o) on the element's nodes.
    fn prescribe(&self, control: &ControlElement, pose: &ControlPose, u: &mut NodeFields) {
        let gradient = pose.matrix - Matrix3::identity();
        for &node in &control.nodes {
            let moved = pose.translation + gradient * (self.mesh.nodes[node as usize] - control.origin);
            u.data[3 * node as usize..][..3].copy_from_slice(moved.as_slice());
        }
    }

    /// What is told of an equilibrium that is shifted as a whole.
    fn settled(&self, equilibrium: &Equilibrium, shift: &Vector3<f64>) -> EquilibriumResult {
        let at = |fields: &NodeFields, node: usize| Vector3::from_column_slice(&fields.data[3 * node..][..3]);
        let displacement: Vec<_> = (0..self.mesh.nodes.len()).map(|node| at(&equilibrium.u, node)).collect();
        let wrench = |control: &ControlElement| {
            let mut wrench = Wrench { force: Vector3::zeros(), moment: Vector3::zeros() };
            for node in control.nodes.iter().map(|&node| node as usize) {
                let force = at(&equilibrium.forces, node);
                wrench.force += force;
                wrench.moment += (self.mesh.nodes[node] + displacement[node] - control.origin).cross(&force);
            }
            wrench.moment += shift.cross(&wrench.force);
            wrench
        };
        let dets: Vec<f64> =
            equilibrium.gradients.iter().map(|h| (Matrix3::identity() + h).determinant()).collect();
        let points = &self.body.points;
        let least = (0..dets.len()).min_by(|&a, &b| dets[a].total_cmp(&dets[b]));
        let is_inverted = |tet: &usize| points.points_of(*tet).any(|point| dets[point] <= 0.0);
        EquilibriumResult {
            wrenches: self.controls.iter().map(wrench).collect(),
            energy: equilibrium.energy,
            least_det: least.map_or((1.0, 0), |point| (dets[point], points.element_of(point))),
            inverted: (0..self.mesh.tets.len()).filter(is_inverted).collect(),
            residual: equilibrium.residual,
            counts: equilibrium.counts.clone(),
            displacement: displacement.into_iter().map(|u| u + shift).collect(),
        }
    }
}
