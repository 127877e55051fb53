//! Static equilibrium at large strain, without Green's functions: the models that are solved anew for every pose.
//!
//! In: a body of a scene, a law ([`crate::fem::LAWS`]) and poses of its control elements. Out: displacements of all
//! nodes, the energy, and the wrenches that hold the control elements. The controlled nodes go the way of [`Screw`]
//! while [`Newton`] keeps the others in equilibrium. What the other models are measured against; too slow for a frame.
//! Where the equilibrium is lost on the way, [`CriticalPose`] says at which pose and how.

mod background;
pub mod critical;
pub mod equilibria;
pub mod freedom;
mod held_volume;

use super::loads::applied::StaticForces;
use super::loads::lumped::NodalLoads;
use super::model::{Bearing, ControlRest, Frame, Kind, ModelEntry};
use super::pose::follow::FollowedTurn;
use super::pose::frame::{ControlPose, ControlPoses, Wrench};
use super::pose::screw::{Screw, Way, part_of};
use super::pose::se3::long_turn;
use crate::fem::{Element, Hyperelastic, Lame, Law, NodeFields, Partition};
use crate::green::{self, ControlElement, GreenError, Prepared, VOLUME};
use crate::mesh::{TetMesh, quality};
use crate::scene::{Body, Scene, SceneError};
use crate::solve::{
    Counts, Equilibrium, LAST_STEP, LinearSolver, Loads, Newton, NewtonError, Progress, Setback, SolveError,
    Stability,
};
use critical::{CriticalPose, Ways};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// The model of bodies under `law`.
pub(super) const fn entry(law: &'static Law) -> ModelEntry {
    let (requirements, turn_limits_deg) = (&[VOLUME], [180.0; 2]);
    let (frame, kind) = (Frame::Solved, Kind::Background(law));
    ModelEntry {
        name: law.name,
        summary: law.summary,
        requirements,
        frame,
        energy: Some(&[]),
        turn_limits_deg,
        kind,
        loads: Bearing::Forces(&[]),
        fits: None,
    }
}

/// Largest turn of a control element in one load step, rad.
const TURN: f64 = std::f64::consts::PI / 6.0;
/// Largest stretch of a control element in one load step, and largest motion against another, in parts of the body's size.
const STRETCH: f64 = 0.25;
const MOST_STEPS: usize = 256;

/// A body ready to be held in any pose.
pub struct Statics {
    pub mesh: TetMesh,
    pub controls: Vec<ControlElement>,
    /// Findings of the check before it that are shown.
    pub notices: Vec<String>,
    body: Hyperelastic,
    element: &'static Element,
    lame: Vec<Lame>,
    loads: NodalLoads,
    acting: StaticForces,
    /// Factor by which warmth lengthens the body where it is free.
    stretch: f64,
    size: f64,
    partition: Partition,
    solver: Option<Box<dyn LinearSolver>>,
    /// The last pose that was solved from rest or from another such, each control element by its shorter turn.
    last: Option<(Vec<Screw>, HeldBody)>,
    /// The last pose that was solved.
    held: Option<HeldBody>,
}

/// A body held in a pose, from which another may go on; all but for the shift that its control elements have in common.
#[derive(Clone, Debug)]
pub struct HeldBody {
    poses: ControlPoses,
    /// Turn of each control element since rest, whole turns included.
    turns: Vec<FollowedTurn>,
    u: NodeFields,
    /// Forces on the nodes, N, and stretch by warmth, in this equilibrium.
    forces: NodeFields,
    stretch: f64,
}

/// A body held in a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct EquilibriumResult {
    /// Displacement of every node of the mesh, m.
    pub displacement: Vec<Vector3<f64>>,
    /// Wrench on every control element, about where its origin rested, with the lever arms of the deformed body.
    pub wrenches: Vec<Wrench>,
    /// Strain energy of the body less the work of its loads, J.
    pub energy: f64,
    /// Least det F at the points of integration, and the tetrahedron that has it.
    pub least_det: (f64, usize),
    /// Tetrahedra turned inside out, det F ≤ 0 at a point.
    pub inverted: Vec<usize>,
    /// ‖f‖₂ at the free nodes over that at the controlled ones.
    pub residual: f64,
    pub counts: Counts,
}

impl EquilibriumResult {
    /// The wrenches, with the moments about where the elements are in these poses.
    pub fn balance(&self, poses: &[ControlPose]) -> Vec<Wrench> {
        self.wrenches.iter().zip(poses).map(|(wrench, pose)| wrench.about_the_place(pose)).collect()
    }
}

#[derive(Debug, thiserror::Error)]
pub enum StaticsError {
    #[error(transparent)]
    Green(#[from] GreenError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error(
        "no equilibrium beyond {:.1} % of the way from {from} to this pose: {}. {}",
        100.0 * share, explain(*why, critical), remedy(*why, critical, law, settled.least_det.0)
    )]
    Stopped {
        /// The last state that was found.
        settled: Box<EquilibriumResult>,
        share: f64,
        from: String,
        why: Setback,
        /// The pose in which the body gives way; `None` where it could not be found.
        critical: Option<Box<CriticalPose>>,
        law: &'static Law,
        /// Tags of the corners of the tetrahedron with the least det F.
        tags: [u64; 4],
        tets: usize,
    },
}

fn explain(why: Setback, critical: &Option<Box<CriticalPose>>) -> String {
    if let Some(critical) = critical {
        return critical.to_string();
    }
    match why {
        Setback::Unstable => "the tangent stiffness is no longer positive definite",
        Setback::NoDescent => "no step lowers the energy any more",
        Setback::Slow => "Newton's iteration does not converge",
    }
    .to_owned()
}

impl StaticsError {
    /// Figures of the end: the least eigenvalue and its mode, the least det F, tetrahedra turned inside out.
    pub fn details(&self) -> Option<String> {
        let StaticsError::Stopped { settled, critical, tags, tets, .. } = self else { return None };
        let (least, inverted) = (settled.least_det.0, settled.inverted.len());
        let mode = critical.as_ref().map_or_else(String::new, |critical| format!("{}. ", critical.details()));
        Some(format!(
            "{mode}Least det F: {least:.3} (nodes {tags:?}); {inverted} of {tets} tetrahedra are inverted"
        ))
    }
}

/// Least det F below which a body gives way because it is pressed together.
const PRESSED: f64 = 0.8;

fn remedy(why: Setback, critical: &Option<Box<CriticalPose>>, law: &Law, least_det: f64) -> &'static str {
    match critical {
        Some(critical) if critical.is_critical() && least_det > PRESSED => {
            "Turn or shear less, thicken the wall, or lead the body round this pose (`after`)"
        }
        None if why == Setback::Slow => {
            "Look for slivers and large contrasts of stiffness (`greenstage check`)"
        }
        Some(critical) if why == Setback::Slow && !critical.is_critical() => {
            "Look for slivers and large contrasts of stiffness (`greenstage check`)"
        }
        _ => law.remedy,
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
        let loads = NodalLoads::new(scene, name, &mesh)?;
        let mut statics = Statics {
            element: scene.body[name].element,
            lame,
            loads,
            acting: StaticForces::default(),
            stretch: 1.0,
            notices: findings.iter().filter(|finding| finding.is_shown()).map(|f| f.to_string()).collect(),
            size: (high - low).norm(),
            solver: None,
            last: None,
            held: None,
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

    pub fn law(&self) -> &'static Law {
        self.body.law
    }

    /// Sets the loads that act on the body; without a call none does.
    pub fn apply(&mut self, acting: &StaticForces) -> Result<(), StaticsError> {
        let stretch = self.loads.stretch(acting);
        if stretch != self.stretch {
            let law = self.body.law;
            let warm = Hyperelastic::stretched(self.element, law, &self.mesh, &self.lame, stretch);
            let body = format!("warmed to {stretch} of its length");
            self.body = warm.map_err(|source| GreenError::Assembly { body, source })?;
            self.stretch = stretch;
        }
        self.acting.clone_from(acting);
        Ok(())
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
        let (shift, poses) = unshifted(poses);
        let target: Vec<Screw> = poses.iter().map(Screw::from_pose).collect();
        let ways = |from: &[Screw]| -> Vec<Way> {
            from.iter().zip(&target).map(|(from, to)| Way::between(*from, *to)).collect()
        };
        let from_rest = ways(&vec![Screw::default(); poses.len()]);
        let last = self.last.take().map(|(screws, held)| (ways(&screws), held));
        let (from, ways, start) = match last {
            Some((ways, held)) if load_steps(&ways, self.size) < load_steps(&from_rest, self.size) => {
                ("the last pose", ways, held)
            }
            _ => ("rest", from_rest, self.at_rest()),
        };
        let settled = self.go(from, &ways, start, poses, shift, progress)?;
        self.last = self.held.clone().map(|held| (target, held));
        Ok(settled)
    }

    /// Solves `poses` from `before`, a pose called `name` that was solved earlier: each control element takes the shorter turn
    /// from there, so that turns add up.
    pub fn solve_after(
        &mut self,
        name: &str,
        before: &HeldBody,
        poses: &ControlPoses,
        progress: &dyn Progress,
    ) -> Result<EquilibriumResult, StaticsError> {
        let (shift, poses) = unshifted(poses);
        let ways: Vec<Way> =
            before.poses.iter().zip(&poses).map(|(from, to)| Way::onwards(from, to)).collect();
        self.go(&format!("pose \"{name}\""), &ways, before.clone(), poses, shift, progress)
    }

    /// Solves `poses` in which control elements may have turned by up to 360°, by the signs of the quaternions `turns`: where one
    /// has turned by more than 180°, the body goes there from rest in legs of 90° at most. `progress` is advanced by 1000 a leg.
    pub fn solve_turned(
        &mut self,
        poses: &ControlPoses,
        turns: &[UnitQuaternion<f64>],
        progress: &dyn Progress,
    ) -> Result<EquilibriumResult, StaticsError> {
        let legs = legs(turns);
        let of_leg = |leg: usize| -> ControlPoses {
            let share = leg as f64 / legs as f64;
            poses.iter().zip(turns).map(|(pose, turn)| part_of(pose, turn, share)).collect()
        };
        for leg in 1..legs {
            let at = of_leg(leg);
            match self.held().cloned().filter(|_| leg > 1) {
                Some(before) => self.solve_after("on the way", &before, &at, progress)?,
                None => self.solve(&at, progress)?,
            };
        }
        match self.held().cloned().filter(|_| legs > 1) {
            Some(before) => self.solve_after("on the way", &before, poses, progress),
            None => self.solve(poses, progress),
        }
    }

    /// Holds the body in `poses` next to the displacements `guess` of all nodes, those of a coarser mesh of the same body: a
    /// few iterations where the way from rest takes many. `None` where that leads to no equilibrium, or to one that is turned
    /// inside out.
    pub fn solve_near(
        &mut self,
        guess: &[Vector3<f64>],
        poses: &ControlPoses,
    ) -> Result<Option<EquilibriumResult>, StaticsError> {
        let (shift, held) = unshifted(poses);
        let ways: Vec<Way> =
            held.iter().map(|pose| Way::between(Screw::default(), Screw::from_pose(pose))).collect();
        let rest = self.at_rest();
        let turns = Ways { controls: &self.controls, ways: &ways, before: &rest.turns, steps: 1 }.turns(1.0);
        let forces = self.forces(&held, &turns);
        let data = guess.iter().flat_map(|u| <[f64; 3]>::from(u - shift)).collect();
        let mut start = NodeFields { nodes: guess.len(), columns: 1, data };
        for (control, pose) in self.controls.iter().zip(&held) {
            self.prescribe(control, pose, &mut start);
        }
        let at_the_end = |_: f64| forces.clone();
        let is_loaded = self.stretch != 1.0 || forces.data.iter().any(|force| *force != 0.0);
        let newton = Newton {
            body: &self.body,
            partition: &self.partition,
            solver: self.solver.as_deref(),
            loads: is_loaded.then_some(Loads { forces: &at_the_end, stretch_before: self.stretch }),
            last_step: LAST_STEP,
        };
        let Some(equilibrium) = newton.settle_near(start)? else { return Ok(None) };
        let settled = self.settled(&equilibrium, &forces, &shift);
        if !settled.inverted.is_empty() {
            return Ok(None);
        }
        self.last = None;
        self.held = Some(HeldBody { poses: held, turns, u: equilibrium.u, forces, stretch: self.stretch });
        Ok(Some(settled))
    }

    /// The last pose that was solved, for others to go on from; none after one without an equilibrium.
    pub fn held(&self) -> Option<&HeldBody> {
        self.held.as_ref()
    }

    fn at_rest(&self) -> HeldBody {
        HeldBody {
            poses: vec![ControlPose::REST; self.controls.len()],
            turns: vec![FollowedTurn::REST; self.controls.len()],
            u: NodeFields::zeros(self.mesh.nodes.len(), 1),
            forces: NodeFields::zeros(self.mesh.nodes.len(), 1),
            stretch: 1.0,
        }
    }

    /// Forces of the loads on the nodes in `poses`, which the control elements have reached by `turns`.
    fn forces(&self, poses: &ControlPoses, turns: &[FollowedTurn]) -> NodeFields {
        let rest = |control: &ControlElement| ControlRest {
            name: control.name.clone(),
            origin: control.origin,
            nodes: control.nodes.len(),
        };
        let controls: Vec<ControlRest> = self.controls.iter().map(rest).collect();
        let turns: Vec<_> = turns.iter().map(|turn| turn.quaternion).collect();
        self.loads.forces(&self.acting, self.mesh.nodes.len(), &controls, poses, &turns)
    }

    /// Goes `ways` from the equilibrium `start`, called `from`, to `poses`.
    fn go(
        &mut self,
        from: &str,
        ways: &[Way],
        start: HeldBody,
        poses: ControlPoses,
        shift: Vector3<f64>,
        progress: &dyn Progress,
    ) -> Result<EquilibriumResult, StaticsError> {
        self.held = None;
        let steps = load_steps(ways, self.size).clamp(1.0, MOST_STEPS as f64).ceil() as usize;
        let path = |share: f64, u: &mut NodeFields| {
            for (e, control) in self.controls.iter().enumerate() {
                let pose = if share == 1.0 { poses[e] } else { ways[e].pose(share) };
                self.prescribe(control, &pose, u);
            }
        };
        let told = Ways { controls: &self.controls, ways, before: &start.turns, steps };
        let turns = told.turns(1.0);
        let forces = self.forces(&poses, &turns);
        let on_the_way = |share: f64| {
            let both = start.forces.data.iter().zip(&forces.data);
            NodeFields { data: both.map(|(from, to)| from + share * (to - from)).collect(), ..forces }
        };
        let acts = |forces: &NodeFields| forces.data.iter().any(|force| *force != 0.0);
        let is_loaded = acts(&start.forces) || acts(&forces) || [start.stretch, self.stretch] != [1.0; 2];
        let newton = Newton {
            body: &self.body,
            partition: &self.partition,
            solver: self.solver.as_deref(),
            loads: is_loaded.then_some(Loads { forces: &on_the_way, stretch_before: start.stretch }),
            last_step: LAST_STEP,
        };
        match newton.follow(start.u.clone(), steps, &path, progress) {
            Ok(equilibrium) => {
                let settled = self.settled(&equilibrium, &forces, &shift);
                self.held = Some(HeldBody { poses, turns, u: equilibrium.u, forces, stretch: self.stretch });
                Ok(settled)
            }
            Err(NewtonError::Solve(error)) => Err(error.into()),
            Err(NewtonError::Stopped { at, share, why, stability }) => {
                let settled = Box::new(self.settled(&at, &on_the_way(share), &(shift * share)));
                let tags = self.mesh.tets[settled.least_det.1].map(|node| self.mesh.tags[node as usize]);
                let tets = self.mesh.tets.len();
                let tell = |found: Box<Stability>| {
                    told.critical(share, &found, &self.mesh, (&self.body.points, &at.gradients))
                };
                let critical = stability.map(tell).map(Box::new);
                let from = from.to_owned();
                Err(StaticsError::Stopped {
                    settled,
                    share,
                    from,
                    why,
                    critical,
                    law: self.body.law,
                    tags,
                    tets,
                })
            }
        }
    }

    /// u = T + (M - I)(X - o) on the element's nodes.
    fn prescribe(&self, control: &ControlElement, pose: &ControlPose, u: &mut NodeFields) {
        let gradient = pose.matrix - Matrix3::identity();
        for &node in &control.nodes {
            let moved = pose.translation + gradient * (self.mesh.nodes[node as usize] - control.origin);
            u.data[3 * node as usize..][..3].copy_from_slice(moved.as_slice());
        }
    }

    /// The result of an equilibrium under `forces` that is shifted as a whole.
    fn settled(
        &self,
        equilibrium: &Equilibrium,
        forces: &NodeFields,
        shift: &Vector3<f64>,
    ) -> EquilibriumResult {
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
        let whole: Vector3<f64> = (0..forces.nodes).map(|node| at(forces, node)).sum();
        let work = forces.dots(&equilibrium.u)[0] + whole.dot(shift);
        let dets: Vec<f64> =
            equilibrium.gradients.iter().map(|h| (Matrix3::identity() + h).determinant()).collect();
        let points = &self.body.points;
        let least = (0..dets.len()).min_by(|&a, &b| dets[a].total_cmp(&dets[b]));
        let is_inverted = |tet: &usize| points.points_of(*tet).any(|point| dets[point] <= 0.0);
        EquilibriumResult {
            wrenches: self.controls.iter().map(wrench).collect(),
            energy: equilibrium.energy - work,
            least_det: least.map_or((1.0, 0), |point| (dets[point], points.element_of(point))),
            inverted: (0..self.mesh.tets.len()).filter(is_inverted).collect(),
            residual: equilibrium.residual,
            counts: equilibrium.counts.clone(),
            displacement: displacement.into_iter().map(|u| u + shift).collect(),
        }
    }
}

/// Number of legs in which a body goes from rest to turns, as in [`Statics::solve_turned`].
pub fn legs(turns: &[UnitQuaternion<f64>]) -> usize {
    let largest = turns.iter().map(|turn| long_turn(turn).norm()).fold(0.0, f64::max);
    if largest > PI { (largest / FRAC_PI_2).ceil() as usize } else { 1 }
}

/// The shift that is taken out of poses, that of the element that moves least, and what is left.
///
/// No law feels a common shift. With it, screw motions by different turns would tear the body on the way, and a small
/// strain would drown in the rounding of large displacements.
fn unshifted(poses: &ControlPoses) -> (Vector3<f64>, ControlPoses) {
    let least = |a: &&ControlPose, b: &&ControlPose| a.translation.norm().total_cmp(&b.translation.norm());
    let shift = poses.iter().min_by(least).map_or_else(Vector3::zeros, |pose| pose.translation);
    let back = |pose: &ControlPose| ControlPose { translation: pose.translation - shift, ..*pose };
    (shift, poses.iter().map(back).collect())
}

/// Load steps that the ways of the control elements of a body of this size want, not rounded.
pub(super) fn load_steps(ways: &[Way], size: f64) -> f64 {
    let first = ways.first().map_or_else(Vector3::zeros, |way| way.length().1);
    let of = |way: &Way| {
        let (turn, slide, stretch) = way.length();
        (turn / TURN).max(stretch / STRETCH).max((slide - first).norm() / (STRETCH * size))
    };
    ways.iter().map(of).fold(0.0, f64::max)
}
