//! A thread that keeps a body in static equilibrium behind the hand that moves it: what goes to it and comes from it.
//!
//! In: the newest poses of the control elements and loads, whenever they change. Out: the newest equilibrium, with its energy, the
//! slopes and the stiffness of the control elements there.

use crate::deform::loads::applied::StaticForces;
use crate::deform::memory::{FoundMemory, HeldNodes, Warm};
use crate::deform::pose::frame::{ControlPose, ControlPoses, PoseSlope};
use crate::green::FIELDS;
use nalgebra::DMatrix;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Instant;

/// The thread, and what goes to it and comes from it; ends with the last of those who hold it.
pub struct Background {
    shared: Arc<Shared>,
}

pub struct Shared {
    pub asked: Mutex<Asked>,
    /// Number of the poses that were asked for last.
    pub number: AtomicU64,
    /// Something was asked.
    pub wake: Condvar,
    pub found: Mutex<Found>,
    /// Something was found.
    pub arrived: Condvar,
}

#[derive(Clone)]
pub struct Asked {
    /// Number of these poses, in the order in which poses are asked for.
    pub number: u64,
    pub poses: ControlPoses,
    pub loads: StaticForces,
    pub since: Instant,
    /// The way from rest to these poses, to be gone anew.
    pub anew: Option<VecDeque<ControlPoses>>,
    /// Warm start to go on from, whatever was found before, and how often one was set.
    pub restored: Option<(Arc<Warm>, u64)>,
    pub is_felt: bool,
    /// A force loop feels it, between the frames, too.
    pub is_in_loop: bool,
    /// Every equilibrium is waited for, so that no stiffness bridges the time until the next: without a force loop the thread
    /// rests when it has reached one.
    pub is_awaited: bool,
    pub ended: bool,
}

/// The newest equilibrium.
#[derive(Clone)]
pub struct Found {
    /// Counts what was found.
    pub version: u64,
    /// The poses to which it belongs, or on the way to which it stands.
    pub number: u64,
    /// Whether they were reached, or no equilibrium was found beyond this one.
    pub is_reached: bool,
    pub is_lost: bool,
    /// Whether the thread has ended, so that no equilibrium comes any more.
    pub has_ended: bool,
    pub asked_at: Instant,
    /// Warm start of the next search, and how often it was set from outside.
    pub warm: Arc<Warm>,
    pub epoch: u64,
    /// The poses of this equilibrium.
    pub poses: ControlPoses,
    /// Displacements of the surface nodes, m.
    pub field: Vec<[f32; 3]>,
    /// Whether an element is turned inside out: det F ≤ 0.
    pub is_inverted: bool,
    /// Strain energy less the work of the loads, J.
    pub energy: f64,
    /// Derivatives of the energy by the poses, the loads that follow the body held.
    pub slopes: Vec<PoseSlope>,
    /// Second derivatives of the energy by the coefficients of the poses, at the stable equilibrium at which they were last made, and
    /// the version for which they were sought last.
    pub stiffness: DMatrix<f64>,
    pub stiffness_version: u64,
}

impl Background {
    /// Starts a thread that does `run`, for a body at `rest` with this number of surface nodes.
    pub fn start(
        rest: HeldNodes,
        surface: usize,
        run: impl FnOnce(&Shared) + Send + 'static,
    ) -> Result<Background, String> {
        let elements = rest.poses.len();
        let found = Found {
            version: 0,
            number: 0,
            is_reached: false,
            is_lost: false,
            has_ended: false,
            asked_at: Instant::now(),
            warm: Arc::new(Warm::at(rest)),
            epoch: 0,
            poses: vec![ControlPose::REST; elements],
            field: vec![[0.0; 3]; surface],
            is_inverted: false,
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
        let of_thread = shared.clone();
        let thread = std::thread::Builder::new().name("equilibrium".into());
        let started = thread.spawn(move || {
            let _ending = Ending(&of_thread);
            run(&of_thread);
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
            is_inverted: memory.is_inverted,
            energy,
            slopes,
            stiffness: found.stiffness.clone(),
            stiffness_version: found.stiffness_version,
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
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The next task of the thread.
pub enum Next {
    Poses(Asked),
    Restored((Arc<Warm>, u64)),
    /// The stiffness of the equilibrium at hand.
    Stiffness,
    End,
}

/// Records that no equilibrium was found beyond the newest, on the way to the poses with `number`.
pub fn lose(shared: &Shared, number: u64, (epoch, warm): (u64, &Warm)) {
    let mut found = lock(&shared.found);
    if found.epoch != epoch {
        return;
    }
    found.warm = Arc::new(warm.clone());
    (found.version, found.number) = (found.version + 1, number);
    (found.is_reached, found.is_lost) = (false, true);
    shared.arrived.notify_all();
}

/// Waits for what is to be done.
pub fn next(shared: &Shared) -> Next {
    let mut asked = lock(&shared.asked);
    loop {
        if asked.ended {
            return Next::End;
        }
        if let Some(restored) = asked.restored.take() {
            return Next::Restored(restored);
        }
        let (number, is_done, has_stiffness) = {
            let found = lock(&shared.found);
            (found.number, found.is_reached || found.is_lost, found.stiffness_version == found.version)
        };
        if asked.number != number || !is_done || asked.anew.is_some() {
            let taken = asked.clone();
            asked.anew = None;
            return Next::Poses(taken);
        }
        if asked.is_felt && (asked.is_in_loop || !asked.is_awaited) && !has_stiffness {
            return Next::Stiffness;
        }
        asked = shared.wake.wait(asked).unwrap_or_else(PoisonError::into_inner);
    }
}

impl Warm {
    /// A search with a factor that is made at the equilibrium at hand.
    pub fn at(held: HeldNodes) -> Warm {
        Warm { factored: held.clone(), held, is_new: true, halved: 0 }
    }
}
