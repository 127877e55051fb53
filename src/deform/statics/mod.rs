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
mod outcome;
mod pushed;
mod spread;
mod way;

use super::loads::applied::StaticForces;
use super::loads::lumped::NodalLoads;
use super::model::{Bearing, ControlRest, Frame, Kind, ModelEntry};
use super::pose::follow::FollowedTurn;
use super::pose::frame::{ControlPose, ControlPoses, Wrench};
use super::pose::screw::{Screw, Way, part_of};
use super::pose::se3::long_turn;
use crate::base::extent::bounding_box;
use crate::base::machine;
use crate::fem::{Element, Hyperelastic, Lame, Law, NodeFields, Partition, nearest_turn};
use crate::green::{self, ControlElement, GreenError, Prepared, VOLUME};
use crate::mesh::TetMesh;
use crate::scene::{Body, Scene, SceneError};
use crate::solve::{
    Counts, Equilibrium, Followed, LinearSolver, Loads, Newton, NewtonError, Point, Progress, Pushed, Silent,
    SolveError, Stability,
};
use critical::{CriticalPose, Ways};
use freedom::{COMPONENTS, Freedom, LOOSE};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
pub use outcome::{Branch, EquilibriumResult, LeastMode, StaticsError, TangentState};
use pushed::prescribe;
use spread::spread;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
pub use way::HeldBody;
use way::{BodyWay, NO_WRENCH, StaticBody};

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
/// Times that loads which follow a free control element are turned after it, and the part of a force that counts as none.
const MOST_TURNED: usize = 30;
const SAME_FORCES: f64 = 1e-9;

/// A body ready to be held in any pose.
pub struct Statics {
    pub mesh: TetMesh,
    pub controls: Vec<ControlElement>,
    /// Findings of the check before it that are shown.
    pub notices: Vec<String>,
    body: Arc<Hyperelastic>,
    element: &'static Element,
    lame: Vec<Lame>,
    loads: NodalLoads,
    acting: StaticForces,
    /// Freedom of each control element; empty if nothing is free or pushed.
    freedom: Vec<Freedom>,
    /// Factor by which warmth lengthens the body where it is free.
    stretch: f64,
    size: f64,
    partition: Partition,
    solver: Option<Box<dyn LinearSolver>>,
    /// Whether the least eigenvalue of each equilibrium is found, which takes a factorization more.
    judges_stability: bool,
    /// The least eigenvalue of the tangent at rest, N/m, of what is free now.
    at_rest: Option<f64>,
    /// The last pose that was solved from rest or from another such, each control element by its shorter turn.
    last: Option<HeldBody>,
    /// The last pose that was solved.
    held: Option<HeldBody>,
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
        let (low, high) = bounding_box(&mesh.nodes);
        let loads = NodalLoads::new(scene, name, &mesh)?;
        let mut statics = Statics {
            element: scene.body[name].element,
            lame,
            loads,
            acting: StaticForces::default(),
            freedom: Vec::new(),
            stretch: 1.0,
            notices: findings.iter().filter(|finding| finding.is_shown()).map(|f| f.to_string()).collect(),
            size: (high - low).norm(),
            solver: None,
            judges_stability: false,
            at_rest: None,
            last: None,
            held: None,
            body: Arc::new(body),
            partition,
            controls,
            mesh,
        };
        if !statics.partition.free.is_empty() {
            let rest = NodeFields::zeros(statics.mesh.nodes.len(), 1);
            let k = statics.body.tangent(&statics.body.gradients(&rest));
            let a = statics.partition.a(&k);
            let solver = scene.body[name].solver.analyse(&a, progress)?;
            // Two tangents, each with its part over the free nodes and the factor of that: of the state before a load step, and of the
            // last one in it.
            let need = 2.0 * solver.memory(&a, 1) + 32.0 * k.scalar_entries() as f64;
            machine::expect("static equilibrium at large strain", need)
                .map_err(|source| GreenError::Memory { body: format!("body.{name}"), source })?;
            statics.solver = Some(solver);
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
            self.body = Arc::new(warm.map_err(|source| GreenError::Assembly { body, source })?);
            self.stretch = stretch;
        }
        self.acting.clone_from(acting);
        Ok(())
    }

    /// Finds the least eigenvalue and its mode of every equilibrium from now on.
    pub fn judge_stability(&mut self) {
        self.judges_stability = true;
    }

    /// Sets which directions of each control element are free, and what pushes along them; without a call none is. Their poses are
    /// found: shifts along free directions and turns about them come on top of those of a pose.
    pub fn push(&mut self, freedom: &[Freedom]) {
        let is_any = freedom.iter().any(Freedom::is_any);
        let freedom = if is_any { freedom } else { &[] };
        if self.freedom != freedom {
            (self.freedom, self.at_rest) = (freedom.to_vec(), None);
        }
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
        let screws = |poses: &[ControlPose]| -> Vec<Screw> { poses.iter().map(Screw::from_pose).collect() };
        let ways = |start: &HeldBody| -> (Vec<Way>, ControlPoses) {
            let target = self.aim(&start.poses, &poses);
            let both = screws(&start.poses).into_iter().zip(screws(&target));
            (both.map(|(from, to)| Way::between(from, to)).collect(), target)
        };
        let rest = self.at_rest();
        let (from_rest, target) = ways(&rest);
        let last = self.last.clone().map(|held| (ways(&held), held));
        let (from, (ways, target), start) = match last {
            Some((own, held)) if load_steps(&own.0, self.size) < load_steps(&from_rest, self.size) => {
                ("the last pose", own, held)
            }
            _ => ("rest", (from_rest, target), rest),
        };
        self.last = None;
        let settled = self.go(from, &ways, start, target, shift, progress)?;
        self.last = self.held.clone();
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
        let poses = self.aim(&before.poses, &poses);
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
        let rest = self.at_rest();
        let ways: Vec<Way> =
            held.iter().map(|pose| Way::between(Screw::default(), Screw::from_pose(pose))).collect();
        let way = self.way(&ways, &rest, &held);
        let data = guess.iter().flat_map(|u| <[f64; 3]>::from(u - shift)).collect();
        let mut start = NodeFields { nodes: guess.len(), columns: 1, data };
        for (control, pose) in self.controls.iter().zip(&held) {
            prescribe(control, &self.mesh, pose, &mut start);
        }
        // The guess is as warm as the end of the way.
        let near = way.lead(|newton, _, _| {
            let loads = newton.loads.map(|loads| Loads { warm: None, pushed: None, ..loads });
            let newton = Newton { loads, ..*newton };
            let Some(found) = newton.settle_near(start)? else { return Ok(None) };
            match self.mode_of(&newton, &found) {
                Ok(mode) => Ok(Some((mode, found))),
                Err(NewtonError::Stopped { .. }) => Ok(None),
                Err(NewtonError::Solve(error)) => Err(error),
            }
        });
        let Some((mode, found)) = near? else {
            return Ok(None);
        };
        let turns = way.told.turns(1.0);
        let mut settled = self.settled(&found, &way.forces_at(1.0), &shift, held.clone());
        if !settled.inverted.is_empty() {
            return Ok(None);
        }
        let held = way.held(&found, held.clone(), turns, Branch::Stable);
        settled.stability.least = self.least(mode)?;
        self.last = None;
        self.held = Some(held);
        Ok(Some(settled))
    }

    /// Holds the body in `poses` next to the displacements of some of its nodes, those of its surface say, as [`Statics::solve_near`]
    /// does; the other nodes begin between them.
    pub fn solve_near_some(
        &mut self,
        nodes: &[usize],
        displacements: &[Vector3<f64>],
        poses: &ControlPoses,
    ) -> Result<Option<EquilibriumResult>, StaticsError> {
        let mut u = NodeFields::zeros(self.mesh.nodes.len(), 1);
        let mut is_known = vec![false; self.mesh.nodes.len()];
        for (node, own) in nodes.iter().zip(displacements) {
            u.data[3 * node..][..3].copy_from_slice(own.as_slice());
            is_known[*node] = true;
        }
        for (control, pose) in self.controls.iter().zip(poses) {
            prescribe(control, &self.mesh, pose, &mut u);
            control.nodes.iter().for_each(|node| is_known[*node as usize] = true);
        }
        spread(&self.mesh, &is_known, &mut u);
        let guess: Vec<_> = u.data.chunks_exact(3).map(Vector3::from_column_slice).collect();
        self.solve_near(&guess, poses)
    }

    /// The last pose that was solved, for others to go on from; none after one without an equilibrium.
    pub fn held(&self) -> Option<&HeldBody> {
        self.held.as_ref()
    }

    /// Follows the curve of equilibria from rest towards `poses` and the loads, through limit points and stable and unstable states, by arc
    /// length: at first by about the share `first` of the way, and by steps in which no node moves by more than `longest`, m. `visit` gets the share and the equilibrium, and returns whether to go
    /// on; the state at share 1 is one of them, and the curve goes on beyond. Ends where no step leads on.
    pub fn trace(
        &mut self,
        poses: &ControlPoses,
        (first, longest): (f64, f64),
        visit: &mut dyn FnMut(f64, &EquilibriumResult) -> bool,
    ) -> Result<(), StaticsError> {
        let (shift, poses) = unshifted(poses);
        let rest = self.at_rest();
        let target = self.aim(&rest.poses, &poses);
        let ways: Vec<Way> =
            target.iter().map(|pose| Way::between(Screw::default(), Screw::from_pose(pose))).collect();
        let way = self.way(&ways, &rest, &target);
        let traced: Result<(), SolveError> = way.lead(|newton, path, pushed| {
            let point = Point { u: rest.u.clone(), q: vec![0.0; pushed.count()] };
            let mut counts = Counts::default();
            newton.trace((point, 0.0), (first, longest), path, &mut counts, &mut |at| {
                let found = newton.judge(at.point.clone(), at.share, Counts::default())?;
                let poses = pushed.moved(at.share, &found.q);
                let mut settled = self.settled(&found, &way.forces_at(at.share), &(shift * at.share), poses);
                settled.stability.negative = at.negative;
                if at.negative > 0 {
                    settled.stability.branch = Branch::Unstable;
                }
                Ok(visit(at.share, &settled))
            })
        });
        Ok(traced?)
    }

    fn at_rest(&self) -> HeldBody {
        HeldBody {
            poses: vec![ControlPose::REST; self.controls.len()],
            turns: vec![FollowedTurn::REST; self.controls.len()],
            u: NodeFields::zeros(self.mesh.nodes.len(), 1),
            forces: NodeFields::zeros(self.mesh.nodes.len(), 1),
            stretch: 1.0,
            wrenches: vec![NO_WRENCH; self.controls.len()],
            branch: Branch::Stable,
        }
    }

    /// The poses to go to from others: free shifts, and turns that are free altogether, stay as they are on the way.
    fn aim(&self, from: &[ControlPose], to: &[ControlPose]) -> ControlPoses {
        let aim = |(e, to): (usize, &ControlPose)| {
            let (mut pose, Some(freedom)) = (*to, self.freedom.get(e)) else { return *to };
            for k in (0..3).filter(|&k| freedom.free[k]) {
                pose.translation[k] = from[e].translation[k];
            }
            if freedom.free[3..] == [true; 3] {
                let turn = |pose: &ControlPose| nearest_turn(&pose.matrix).to_rotation_matrix();
                pose.matrix = turn(&from[e]) * turn(to).inverse() * pose.matrix;
            }
            pose
        };
        to.iter().enumerate().map(aim).collect()
    }

    /// The way from `start` to `poses`.
    fn way<'a>(&'a self, ways: &'a [Way], start: &'a HeldBody, poses: &'a ControlPoses) -> BodyWay<'a> {
        let steps = step_count(ways, self.size);
        let told = Ways { controls: &self.controls, ways, before: &start.turns, steps };
        let forces = self.forces(poses, &told.turns(1.0));
        let body = StaticBody {
            mesh: &self.mesh,
            controls: &self.controls,
            body: &self.body,
            element: self.element,
            lame: &self.lame,
            freedom: &self.freedom,
            stretch: self.stretch,
            partition: &self.partition,
            solver: self.solver.as_deref(),
        };
        BodyWay { body, start, poses, told, steps, forces }
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

    /// The least eigenvalue at the end of a way, N/m, with its mode, where it is asked for.
    fn mode_of(
        &self,
        newton: &Newton<'_>,
        at: &Equilibrium,
    ) -> Result<Option<(f64, NodeFields)>, NewtonError> {
        if !self.judges_stability {
            return Ok(None);
        }
        newton.least_mode(&Point { u: at.u.clone(), q: at.q.clone() }, 1.0)
    }

    /// A least eigenvalue in parts of that at rest, with its mode.
    fn least(&mut self, found: Option<(f64, NodeFields)>) -> Result<Option<LeastMode>, StaticsError> {
        let Some((value, mode)) = found else { return Ok(None) };
        let at_rest = match self.at_rest {
            Some(at_rest) => at_rest,
            None => {
                let rest = self.at_rest();
                let ways: Vec<Way> =
                    rest.poses.iter().map(|_| Way::between(Screw::default(), Screw::default())).collect();
                let found = self.way(&ways, &rest, &rest.poses).lead(|newton, _, pushed| {
                    let mut u = rest.u.clone();
                    // The natural shape of a warm body.
                    for (u, x) in u.data.chunks_exact_mut(3).zip(&self.mesh.nodes) {
                        u.copy_from_slice((x * (self.stretch - 1.0)).as_slice());
                    }
                    let nothing = |_: f64| NodeFields::zeros(u.nodes, 1);
                    let loads = newton.loads.map(|loads| Loads { forces: &nothing, ..loads });
                    let point = Point { u: u.clone(), q: vec![0.0; pushed.count()] };
                    Newton { loads, ..*newton }.least_mode(&point, 1.0)
                });
                match found {
                    Ok(found) => found.map_or(value, |(least, _)| least),
                    Err(NewtonError::Solve(error)) => return Err(error.into()),
                    // A body that is not stable at rest has no eigenvalue there to compare with.
                    Err(NewtonError::Stopped { .. }) => return Ok(None),
                }
            }
        };
        self.at_rest = Some(at_rest);
        let mode = mode.data.chunks_exact(3).map(Vector3::from_column_slice).collect();
        Ok(Some((value / at_rest, mode)))
    }

    /// Goes `ways` from the equilibrium `start`, called `from`, to `poses`. Loads that follow what is pushed are turned until they
    /// fit where it is found.
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
        let (mut settled, mut held) = self.go_once(from, ways, &start, &poses, &shift, progress)?;
        let mut turned = 0;
        while !self.freedom.is_empty() {
            let forces = self.forces(&held.poses, &held.turns);
            let apart = forces.data.iter().zip(&held.forces.data).map(|(a, b)| (a - b).abs());
            let largest = forces.data.iter().map(|force| force.abs()).fold(0.0, f64::max);
            let apart = apart.fold(0.0, f64::max);
            if apart <= SAME_FORCES * largest {
                break;
            }
            if turned == MOST_TURNED {
                return Err(StaticsError::StillTurning { searches: turned, part: apart / largest });
            }
            let stays: Vec<Way> = held.poses.iter().map(|pose| Way::onwards(pose, pose)).collect();
            let poses = held.poses.clone();
            let (passed, counts) = (settled.stability.passed, settled.counts);
            (settled, held) = self.go_once("the same pose", &stays, &held, &poses, &shift, &Silent)?;
            settled.stability.passed.splice(0..0, passed);
            settled.counts.add(&counts);
            turned += 1;
        }
        self.held = Some(held);
        Ok(settled)
    }

    fn go_once(
        &mut self,
        from: &str,
        ways: &[Way],
        start: &HeldBody,
        poses: &ControlPoses,
        shift: &Vector3<f64>,
        progress: &dyn Progress,
    ) -> Result<(EquilibriumResult, HeldBody), StaticsError> {
        let way = self.way(ways, start, poses);
        let followed = way.lead(|newton, path, pushed| {
            let begin = Point { u: start.u.clone(), q: vec![0.0; pushed.count()] };
            let loose = newton.loosest(&begin, 0.0)?.filter(|(_, stiffness)| *stiffness <= LOOSE);
            if let Some((element, k)) = loose.and_then(|(motion, _)| pushed.unknowns().nth(motion)) {
                return Ok(Err((element, COMPONENTS[k])));
            }
            let followed = newton.follow(start.u.clone(), way.steps, path, progress)?;
            let at = &followed.equilibrium;
            let mode = self.mode_of(newton, at)?;
            Ok(Ok((pushed.moved(1.0, &at.q), way.turned(pushed, &at.q), mode, followed)))
        });
        match followed {
            Ok(Ok((poses, turns, mode, Followed { equilibrium, passed }))) => {
                let critical: Vec<CriticalPose> = passed.iter().map(|passed| way.critical(passed)).collect();
                let branch = passed.iter().fold(start.branch, Branch::beyond);
                let mut settled = self.settled(&equilibrium, &way.forces, shift, poses.clone());
                let held = way.held(&equilibrium, poses, turns, branch);
                settled.stability = TangentState { branch, negative: 0, least: None, passed: critical };
                settled.stability.least = self.least(mode)?;
                Ok((settled, held))
            }
            Ok(Err((element, component))) => Err(StaticsError::Loose { element, component }),
            Err(NewtonError::Solve(error)) => Err(error.into()),
            Err(NewtonError::Stopped { at, share, why, stability }) => {
                let reached = way.lead(|_, _, pushed| pushed.moved(share, &at.q));
                let settled = self.settled(&at, &way.forces_at(share), &(shift * share), reached);
                let settled = Box::new(settled);
                let tags = self.mesh.tets[settled.least_det.1].map(|node| self.mesh.tags[node as usize]);
                let tell = |found: Box<Stability>| {
                    way.told.critical(share, &found, &self.mesh, (&self.body.points, &at.gradients))
                };
                let critical = stability.map(tell).map(Box::new);
                let (law, tets, from) = (self.body.law, self.mesh.tets.len(), from.to_owned());
                Err(StaticsError::Stopped { settled, share, from, why, critical, law, tags, tets })
            }
        }
    }

    /// The result of an equilibrium under `forces` that is shifted as a whole.
    fn settled(
        &self,
        equilibrium: &Equilibrium,
        forces: &NodeFields,
        shift: &Vector3<f64>,
        poses: ControlPoses,
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
        let place = |pose: ControlPose| ControlPose { translation: pose.translation + shift, ..pose };
        let stability = TangentState { branch: Branch::Stable, negative: 0, least: None, passed: Vec::new() };
        EquilibriumResult {
            poses: poses.into_iter().map(place).collect(),
            stability,
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

/// Load steps on the ways of the control elements of a body of this size.
fn step_count(ways: &[Way], size: f64) -> usize {
    load_steps(ways, size).clamp(1.0, MOST_STEPS as f64).ceil() as usize
}

/// Load steps that the ways want, not rounded.
fn load_steps(ways: &[Way], size: f64) -> f64 {
    let first = ways.first().map_or_else(Vector3::zeros, |way| way.length().1);
    let of = |way: &Way| {
        let (turn, slide, stretch) = way.length();
        (turn / TURN).max(stretch / STRETCH).max((slide - first).norm() / (STRETCH * size))
    };
    ways.iter().map(of).fold(0.0, f64::max)
}
