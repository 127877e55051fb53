//! A thread that keeps a body in static equilibrium behind the hand that moves it.
//!
//! In: the newest poses of the control elements and loads, whenever they change. Out: the newest equilibrium, with its energy, the
//! slopes and the stiffness of the control elements there. Each is a full one ([`Settler`]); between two poses no element is
//! turned by more than 30° at once, and what lies on the way is an equilibrium, too. The factor of one tangent stiffness
//! serves many of them, and is made anew where the iterations grow.

use super::frames::PoseSlope;
use super::memory::{FoundMemory, HeldNodes, Warm};
use super::model::ControlRest;
use super::nearest::unwrapped;
use super::pose::{ControlPose, ControlPoses};
use super::screw::Way;
use super::static_forces::StaticForces;
use super::static_loads::NodalLoads;
use super::statics::load_steps;
use crate::fem::{Hyperelastic, Law, NodeFields, Partition, StiffnessMatrix};
use crate::green::{FIELDS, Volume};
use crate::mesh::quality;
use crate::solve::{
    Factor, LinearSolver, OldFactor, Settled, Settler, Silent, SolveError, Solver, Unsettled,
};
use nalgebra::{DMatrix, Matrix3, UnitQuaternion, Vector3};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Instant;

/// An equilibrium that took more solves than this with its factor asks for a new one.
const TIRED: usize = 18;
/// A step that fails with a new factor is halved so often before the equilibrium is called lost.
const HALVINGS: u32 = 6;

/// The thread, and what goes to it and comes from it; ends with the last of those who hold it.
pub struct Background {
    shared: Arc<Shared>,
}

struct Shared {
    asked: Mutex<Asked>,
    /// Number of the poses that were asked for last.
    number: AtomicU64,
    /// Something was asked.
    wake: Condvar,
    found: Mutex<Found>,
    /// Something was found.
    arrived: Condvar,
}

#[derive(Clone)]
struct Asked {
    /// Number of these poses, in the order in which poses are asked for.
    number: u64,
    poses: ControlPoses,
    loads: StaticForces,
    since: Instant,
    /// The way from rest to these poses, to be gone anew.
    anew: Option<VecDeque<ControlPoses>>,
    /// Warm start to go on from, whatever was found before, and how often one was set.
    restored: Option<(Arc<Warm>, u64)>,
    is_felt: bool,
    /// A force loop feels it, between the frames, too.
    is_in_loop: bool,
    /// Every equilibrium is waited for, so that no stiffness bridges the time until the next: without a force loop the thread
    /// rests when it has reached one, and what it finds depends on nothing but what was asked.
    is_awaited: bool,
    ended: bool,
}

/// The newest equilibrium.
#[derive(Clone)]
pub struct Found {
    /// Counts what was found.
    pub version: u64,
    /// The poses to which it belongs, or on the way to which it stands.
    number: u64,
    /// Whether they were reached, or no equilibrium was found beyond this one.
    pub is_reached: bool,
    pub is_lost: bool,
    /// Whether the thread has ended, so that no equilibrium comes any more.
    has_ended: bool,
    pub asked_at: Instant,
    /// Warm start of the next search, and how often it was set from outside.
    warm: Arc<Warm>,
    epoch: u64,
    /// The poses of this equilibrium.
    pub poses: ControlPoses,
    /// Displacements of the surface nodes, m.
    pub field: Vec<[f32; 3]>,
    /// Strain energy less the work of the loads, J.
    pub energy: f64,
    /// Derivatives of the energy by the poses, the loads that follow the body held.
    pub slopes: Vec<PoseSlope>,
    /// Second derivatives of the energy by the coefficients of the poses, at the equilibrium at which they were last made, and
    /// the version of that equilibrium.
    pub stiffness: DMatrix<f64>,
    pub stiffness_version: u64,
}

impl Background {
    /// Starts the thread for a body under `law`, with its loads where it has some. Errors where this body cannot be solved.
    pub fn start(law: &'static Law, volume: Volume, loads: Option<NodalLoads>) -> Result<Background, String> {
        let elements = volume.held.len();
        let rest = at_rest(&volume);
        let found = Found {
            version: 0,
            number: 0,
            is_reached: true,
            is_lost: false,
            has_ended: false,
            asked_at: Instant::now(),
            warm: Arc::new(Warm { held: rest.clone(), factored: rest, is_new: true, halved: 0 }),
            epoch: 0,
            poses: vec![ControlPose::REST; elements],
            field: vec![[0.0; 3]; volume.surface.len()],
            energy: 0.0,
            slopes: vec![PoseSlope::default(); elements],
            stiffness: DMatrix::zeros(FIELDS * elements, FIELDS * elements),
            stiffness_version: 0,
        };
        let asked = Asked {
            number: 0,
            poses: found.poses.clone(),
            loads: StaticForces::default(),
            since: Instant::now(),
            anew: None,
            restored: None,
            is_felt: false,
            is_in_loop: false,
            is_awaited: false,
            ended: false,
        };
        let shared = Arc::new(Shared {
            asked: Mutex::new(asked),
            number: AtomicU64::new(0),
            wake: Condvar::new(),
            found: Mutex::new(found),
            arrived: Condvar::new(),
        });
        let body = HeldVolume::new(law, volume, loads)?;
        let of_thread = shared.clone();
        let thread = std::thread::Builder::new().name("equilibrium".into());
        let started = thread.spawn(move || {
            let _ending = Ending(&of_thread);
            body.run(&of_thread);
        });
        started.map_err(|error| format!("no thread for its equilibria can be started: {error}"))?;
        Ok(Background { shared })
    }

    /// Asks for the equilibrium of `poses` under `loads`; those asked for before and not yet found are left out. With `anew`,
    /// the body goes there from rest, through these poses.
    pub fn ask(&self, poses: &[ControlPose], loads: &StaticForces, anew: Option<VecDeque<ControlPoses>>) {
        let mut asked = lock(&self.shared.asked);
        if asked.poses == poses && asked.loads == *loads && anew.is_none() {
            return;
        }
        asked.poses.copy_from_slice(poses);
        asked.loads.clone_from(loads);
        asked.anew = anew.or(asked.anew.take());
        (asked.number, asked.since) = (asked.number + 1, Instant::now());
        self.shared.number.store(asked.number, Ordering::Release);
        self.shared.wake.notify_all();
    }

    /// Memory of the thread: the poses that were asked for, whether the newest equilibrium is theirs, and the warm start.
    pub fn keep(&self) -> (ControlPoses, bool, Arc<Warm>) {
        let (asked, found) = (lock(&self.shared.asked), lock(&self.shared.found));
        (asked.poses.clone(), self.is_up_to_date(&found), found.warm.clone())
    }

    /// Goes on from `memory`, as if its equilibrium had just been found for the poses `asked`; returns its version. The error
    /// says why it is not that of this body.
    pub fn restore(
        &self,
        memory: &FoundMemory,
        at: ControlPoses,
        (energy, slopes): (f64, Vec<PoseSlope>),
        stiffness: &DMatrix<f64>,
    ) -> Result<u64, String> {
        let mut asked = lock(&self.shared.asked);
        let mut found = lock(&self.shared.found);
        let (own, new) = (&found.warm, &memory.warm);
        let is_like = |own: &HeldNodes, new: &HeldNodes| {
            let nodes = new.u.len() / 3;
            (own.u.len(), own.poses.len()) == (new.u.len(), new.poses.len())
                && new.turns.len() == new.poses.len()
                && new.loads.at_nodes.iter().all(|(node, _)| (*node as usize) < nodes)
        };
        let fits = is_like(&own.held, &new.held)
            && is_like(&own.factored, &new.factored)
            && [at.len(), memory.poses.len(), slopes.len()] == [found.poses.len(); 3]
            && memory.field.len() == found.field.len();
        if !fits {
            return Err("a model's memory holds an equilibrium of another body".into());
        }
        let warm = Arc::new(new.clone());
        (asked.number, asked.since) = (asked.number + 1, Instant::now());
        (asked.poses, asked.anew, asked.restored) = (at, None, Some((warm.clone(), found.epoch + 1)));
        asked.loads.clone_from(&warm.held.loads);
        self.shared.number.store(asked.number, Ordering::Release);
        let version = found.version + 1;
        *found = Found {
            version,
            number: asked.number,
            is_reached: memory.is_reached,
            is_lost: memory.is_lost,
            has_ended: found.has_ended,
            asked_at: asked.since,
            warm,
            epoch: found.epoch + 1,
            poses: memory.poses.clone(),
            field: memory.field.clone(),
            energy,
            slopes,
            stiffness: stiffness.clone(),
            stiffness_version: version,
        };
        self.shared.wake.notify_all();
        Ok(version)
    }

    /// The body is felt from now on: its stiffness is kept up to date.
    pub fn feel(&self) {
        lock(&self.shared.asked).is_felt = true;
        self.shared.wake.notify_all();
    }

    /// Keeps the stiffness up to date for a force loop, which feels the body between the frames, too.
    pub fn feel_in_loop(&self) {
        lock(&self.shared.asked).is_in_loop = true;
        self.feel();
    }

    /// Whether every equilibrium is waited for from now on.
    pub fn be_awaited(&self, is_awaited: bool) {
        lock(&self.shared.asked).is_awaited = is_awaited;
        self.shared.wake.notify_all();
    }

    /// The newest equilibrium.
    pub fn newest(&self) -> MutexGuard<'_, Found> {
        lock(&self.shared.found)
    }

    /// The newest equilibrium, or `None` while another thread holds it.
    pub fn newest_at_once(&self) -> Option<MutexGuard<'_, Found>> {
        match self.shared.found.try_lock() {
            Ok(found) => Some(found),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// The equilibrium of the poses that were asked for last, or the one at which it was lost.
    pub fn awaited(&self) -> MutexGuard<'_, Found> {
        let number = self.shared.number.load(Ordering::Acquire);
        let found = lock(&self.shared.found);
        let waits = |found: &mut Found| {
            !found.has_ended && (found.number < number || !(found.is_reached || found.is_lost))
        };
        self.shared.arrived.wait_while(found, waits).unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the newest equilibrium is that of the poses that were asked for last.
    pub fn is_up_to_date(&self, found: &Found) -> bool {
        found.is_reached && found.number == self.shared.number.load(Ordering::Acquire)
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        lock(&self.shared.asked).ended = true;
        self.shared.wake.notify_all();
    }
}

/// Guard that announces, however the thread ends, that no equilibrium comes any more.
struct Ending<'a>(&'a Shared);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        let mut found = lock(&self.0.found);
        (found.has_ended, found.is_lost) = (true, true);
        self.0.arrived.notify_all();
    }
}

/// Locks a mutex even after a panic: nothing is written in parts, so a thread that panicked left it whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The body as the thread holds it.
struct HeldVolume {
    volume: Volume,
    law: &'static Law,
    /// The body by how much warmth lengthens it where it is free, as it was needed last.
    body: RefCell<(f64, Arc<Hyperelastic>)>,
    /// `None` of a body without loads.
    loads: Option<NodalLoads>,
    controls: Vec<ControlRest>,
    partition: Partition,
    /// Centroids of the held nodes, m.
    origins: Vec<Vector3<f64>>,
    size: f64,
}

/// The next task of the thread.
enum Next {
    Poses(Asked),
    Restored((Arc<Warm>, u64)),
    /// The stiffness of the equilibrium at hand.
    Stiffness,
    End,
}

/// The reason why the factor is made anew.
enum Renewal {
    Tired,
    Anew(VecDeque<ControlPoses>),
    Restored((Arc<Warm>, u64)),
    End,
}

impl HeldVolume {
    fn new(law: &'static Law, volume: Volume, loads: Option<NodalLoads>) -> Result<HeldVolume, String> {
        let mesh = &volume.mesh;
        let body =
            Hyperelastic::new(volume.element, law, mesh, &volume.lame).map_err(|error| error.to_string())?;
        let partition = Partition::new(mesh.nodes.len(), volume.held.iter().flatten().copied());
        if partition.controlled.is_empty() {
            return Err("no control element holds a node of it: there is no equilibrium to find".into());
        }
        let mean = |held: &Vec<u32>| {
            let sum: Vector3<f64> = held.iter().map(|&node| mesh.nodes[node as usize]).sum();
            sum / held.len().max(1) as f64
        };
        let (low, high) = quality::bounding_box(&mesh.nodes);
        let origins: Vec<Vector3<f64>> = volume.held.iter().map(mean).collect();
        let control = |(held, origin): (&Vec<u32>, &Vector3<f64>)| ControlRest {
            name: String::new(),
            origin: *origin,
            nodes: held.len(),
        };
        Ok(HeldVolume {
            controls: volume.held.iter().zip(&origins).map(control).collect(),
            origins,
            size: (high - low).norm(),
            body: RefCell::new((1.0, Arc::new(body))),
            law,
            loads,
            partition,
            volume,
        })
    }

    /// The body as warm as `loads` make it.
    fn body(&self, loads: &StaticForces) -> Result<Arc<Hyperelastic>, SolveError> {
        let stretch = self.loads.as_ref().map_or(1.0, |columns| columns.stretch(loads));
        let mut last = self.body.borrow_mut();
        if last.0 != stretch {
            let Volume { element, mesh, lame, .. } = &self.volume;
            let warm = Hyperelastic::stretched(element, self.law, mesh, lame, stretch);
            let warm = warm.map_err(|_source| SolveError::Inexact {
                figure: "the length of the warm body in parts of that at rest",
                value: stretch,
                remedy: "take less warmth",
            })?;
            *last = (stretch, Arc::new(warm));
        }
        Ok(last.1.clone())
    }

    /// Finds equilibria until nobody wants them any more. A body of which no factor can be made is lost where it is.
    fn run(&self, shared: &Shared) {
        let rest = Warm::at(at_rest(&self.volume));
        let body = self.body.borrow().1.clone();
        let k = body.tangent(&body.gradients(&self.fields(&rest.held)));
        let Ok(solver) = Solver::default().analyse(&self.partition.a(&k), &Silent) else {
            return lose(shared, shared.number.load(Ordering::Acquire), (0, &rest));
        };
        let (mut warm, mut stable, mut epoch) = (rest.clone(), rest.held.clone(), 0);
        let mut legs = VecDeque::new();
        loop {
            match self.follow(shared, solver.as_ref(), &mut warm, (&mut stable, epoch), &mut legs) {
                Ok(Renewal::Tired) => warm = Warm::at(warm.held),
                Ok(Renewal::Anew(way)) => (warm, legs) = (rest.clone(), way),
                Ok(Renewal::Restored((other, since))) => {
                    (warm, legs, epoch) = ((*other).clone(), VecDeque::new(), since);
                }
                Ok(Renewal::End) => return,
                Err(_) => {
                    // What was found last is no stable equilibrium: back to the one before, and on from there.
                    let is_first = warm.factored == stable;
                    (warm, legs) = (Warm::at(stable.clone()), VecDeque::new());
                    lose(shared, shared.number.load(Ordering::Acquire), (epoch, &warm));
                    if is_first {
                        return;
                    }
                }
            }
        }
    }

    /// Follows the poses that are asked for, with one factor: that of `warm.factored`.
    fn follow(
        &self,
        shared: &Shared,
        solver: &dyn LinearSolver,
        warm: &mut Warm,
        (stable, epoch): (&mut HeldNodes, u64),
        legs: &mut VecDeque<ControlPoses>,
    ) -> Result<Renewal, SolveError> {
        let body = self.body(&warm.factored.loads)?;
        let gradients = body.gradients(&self.fields(&warm.factored));
        let k = body.tangent(&gradients);
        let a = self.partition.a(&k);
        let factor = solver.factor(&a, &Silent)?;
        stable.clone_from(&warm.factored);
        if (lock(&shared.asked).is_felt && warm.is_new) || lock(&shared.found).version == 0 {
            self.tell_stiffness(shared, &k, factor.as_ref(), (epoch, warm))?;
        }
        let old = OldFactor { factor: factor.as_ref(), gradients: &gradients };
        loop {
            let mut asked = match next(shared, warm.is_new) {
                Next::End => return Ok(Renewal::End),
                Next::Restored(other) => return Ok(Renewal::Restored(other)),
                Next::Stiffness => return Ok(Renewal::Tired),
                Next::Poses(asked) => asked,
            };
            if let Some(way) = asked.anew.take() {
                return Ok(Renewal::Anew(way));
            }
            let aim = legs.front().unwrap_or(&asked.poses);
            let ways: Vec<Way> =
                warm.held.poses.iter().zip(aim).map(|(from, to)| Way::onwards(from, to)).collect();
            let share = 0.5f64.powi(warm.halved as i32) / load_steps(&ways, self.size).ceil().max(1.0);
            let poses = match share {
                1.0 => aim.clone(),
                share => ways.iter().map(|way| way.pose(share)).collect(),
            };
            let loads = warm.held.loads.towards(&asked.loads, share);
            let turns = unwrapped(Some(&warm.held.turns), &poses);
            match self.step(&old, &warm.held, &poses, &turns, &loads)? {
                Ok(settled) => {
                    let is_reached = share == 1.0 && legs.pop_front().is_none();
                    let is_tired = settled.solves > TIRED && !warm.is_new;
                    warm.held = HeldNodes { poses, u: settled.u.data.clone(), turns, loads };
                    warm.halved = warm.halved.saturating_sub(1);
                    warm.is_new = false;
                    if is_tired {
                        *warm = Warm::at(warm.held.clone());
                    }
                    self.tell(shared, &asked, is_reached, &settled, (epoch, warm));
                    if is_tired {
                        return Ok(Renewal::Tired);
                    }
                }
                Err(_) if !warm.is_new => return Ok(Renewal::Tired),
                Err(_) if warm.halved < HALVINGS => warm.halved += 1,
                Err(_) => {
                    (warm.halved, *legs) = (0, VecDeque::new());
                    lose(shared, asked.number, (epoch, warm));
                }
            }
        }
    }

    /// The equilibrium of `poses`, to which the control elements have turned so, under `loads`.
    fn step(
        &self,
        old: &OldFactor<'_>,
        from: &HeldNodes,
        poses: &[ControlPose],
        turns: &[UnitQuaternion<f64>],
        loads: &StaticForces,
    ) -> Result<Result<Settled, Unsettled>, SolveError> {
        let Ok(body) = self.body(loads) else { return Ok(Err(Unsettled)) };
        let u = self.fields(from);
        let moved = self.moved(&u, poses);
        let forces = self.loads.as_ref().map(|columns| {
            let nodes = self.volume.mesh.nodes.len();
            columns.forces(loads, nodes, &self.controls, poses, turns)
        });
        Settler { body: &body, partition: &self.partition, loads: forces.as_ref() }.step(old, &u, &moved)
    }

    fn fields(&self, held: &HeldNodes) -> NodeFields {
        NodeFields { data: held.u.clone(), ..NodeFields::zeros(self.volume.mesh.nodes.len(), 1) }
    }

    /// `u` with the held nodes where `poses` have them.
    fn moved(&self, u: &NodeFields, poses: &[ControlPose]) -> NodeFields {
        let mut moved = u.clone();
        for ((held, origin), pose) in self.volume.held.iter().zip(&self.origins).zip(poses) {
            let gradient = pose.matrix - Matrix3::identity();
            for &node in held {
                let at = pose.translation + gradient * (self.volume.mesh.nodes[node as usize] - origin);
                moved.data[3 * node as usize..][..3].copy_from_slice(at.as_slice());
            }
        }
        moved
    }

    fn tell(
        &self,
        shared: &Shared,
        asked: &Asked,
        is_reached: bool,
        at: &Settled,
        (epoch, warm): (u64, &Warm),
    ) {
        let of = |fields: &NodeFields, node: u32| {
            Vector3::from_column_slice(&fields.data[3 * node as usize..][..3])
        };
        let field = self.volume.surface.iter().map(|&node| of(&at.u, node).cast::<f32>().into()).collect();
        let slope = |(held, origin): (&Vec<u32>, &Vector3<f64>)| {
            let mut slope = PoseSlope::default();
            for &node in held {
                let force = of(&at.forces, node);
                slope.translation += force;
                slope.matrix += force * (self.volume.mesh.nodes[node as usize] - origin).transpose();
            }
            slope
        };
        let slopes = self.volume.held.iter().zip(&self.origins).map(slope).collect();
        let mut found = lock(&shared.found);
        if found.epoch != epoch {
            return;
        }
        let Found { version, stiffness_version, .. } = *found;
        let stiffness = std::mem::replace(&mut found.stiffness, DMatrix::zeros(0, 0));
        let new = Found {
            version: version + 1,
            number: asked.number,
            is_reached,
            is_lost: false,
            has_ended: false,
            asked_at: asked.since,
            warm: Arc::new(warm.clone()),
            epoch,
            poses: warm.held.poses.clone(),
            field,
            energy: at.energy,
            slopes,
            stiffness,
            stiffness_version,
        };
        let before = std::mem::replace(&mut *found, new);
        drop(found);
        shared.arrived.notify_all();
        drop(before);
    }

    /// ∂²V/∂c² = Φᵀ K Φ by the coefficients c of the poses, Φ being the fields that keep the free nodes in balance.
    fn tell_stiffness(
        &self,
        shared: &Shared,
        k: &StiffnessMatrix,
        factor: &dyn Factor,
        (epoch, warm): (u64, &Warm),
    ) -> Result<(), SolveError> {
        let columns = FIELDS * self.volume.held.len();
        let mut fields = NodeFields::zeros(self.volume.mesh.nodes.len(), columns);
        for (e, (held, origin)) in self.volume.held.iter().zip(&self.origins).enumerate() {
            for &node in held {
                let arm = self.volume.mesh.nodes[node as usize] - origin;
                for axis in 0..3 {
                    let row = &mut fields.row_mut(3 * node as usize + axis)[FIELDS * e..][..FIELDS];
                    row[axis] = 1.0;
                    row[3 + 3 * axis..][..3].copy_from_slice(arm.as_slice());
                }
            }
        }
        let (free, _) = factor.solve(&self.partition.minus_b_times(k, &fields), &Silent)?;
        self.partition.insert_free(&free, &mut fields);
        let mut product = NodeFields::zeros(fields.nodes, columns);
        k.multiply(&fields, &mut product);
        let rows = 3 * fields.nodes;
        let phi = DMatrix::from_row_slice(rows, columns, &fields.data);
        let stiffness = phi.transpose() * DMatrix::from_row_slice(rows, columns, &product.data);
        let mut found = lock(&shared.found);
        if found.epoch != epoch {
            return Ok(());
        }
        found.warm = Arc::new(warm.clone());
        found.stiffness = (&stiffness + stiffness.transpose()) * 0.5;
        found.version += 1;
        found.stiffness_version = found.version;
        Ok(())
    }
}

fn at_rest(volume: &Volume) -> HeldNodes {
    let elements = volume.held.len();
    HeldNodes {
        poses: vec![ControlPose::REST; elements],
        u: vec![0.0; 3 * volume.mesh.nodes.len()],
        turns: vec![UnitQuaternion::identity(); elements],
        loads: StaticForces::default(),
    }
}

impl Warm {
    /// A search with a factor that is made at the equilibrium at hand.
    fn at(held: HeldNodes) -> Warm {
        Warm { factored: held.clone(), held, is_new: true, halved: 0 }
    }
}

/// Records that no equilibrium was found beyond the newest, on the way to the poses with `number`.
fn lose(shared: &Shared, number: u64, (epoch, warm): (u64, &Warm)) {
    let mut found = lock(&shared.found);
    if found.epoch != epoch {
        return;
    }
    found.warm = Arc::new(warm.clone());
    (found.version, found.number) = (found.version + 1, number);
    (found.is_reached, found.is_lost) = (false, true);
    shared.arrived.notify_all();
}

/// Waits for what is to be done. With a factor that `is_new`, the stiffness is that of the equilibrium at hand.
fn next(shared: &Shared, is_new: bool) -> Next {
    let mut asked = lock(&shared.asked);
    loop {
        if asked.ended {
            return Next::End;
        }
        if let Some(restored) = asked.restored.take() {
            return Next::Restored(restored);
        }
        let (number, is_done) = {
            let found = lock(&shared.found);
            (found.number, found.is_reached || found.is_lost)
        };
        if asked.number != number || !is_done || asked.anew.is_some() {
            let taken = asked.clone();
            asked.anew = None;
            return Next::Poses(taken);
        }
        if asked.is_felt && (asked.is_in_loop || !asked.is_awaited) && !is_new {
            return Next::Stiffness;
        }
        asked = shared.wake.wait(asked).unwrap_or_else(PoisonError::into_inner);
    }
}
