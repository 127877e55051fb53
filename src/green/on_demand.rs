//! Columns that are solved for when they are asked for, from a factor that a .green file holds.
//!
//! In: places among the nodes of a surface, from those who wait and from those who have a frame to draw. Out: their columns,
//! once they are solved for; those that were asked for last are kept, and the factor is once it was read.

use super::error::GreenError;
use crate::solve::LoadedFactor;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Displacements of all nodes of the surface for a force of 1 N at one of them along x, y and z: m/N, `[node][axis][force]`.
pub type Yield = Vec<[[f32; 3]; 3]>;

/// A compliance whose columns are solved for when they are asked for.
pub trait SolvedCompliance: Send + Sync + fmt::Debug {
    /// The nodes of the surface that take forces.
    fn nodes(&self) -> &[u32];

    /// Displacements of the whole surface for forces of 1 N at each of these nodes.
    fn columns(&self, nodes: &[u32]) -> Result<Vec<Yield>, String>;
}

/// Bytes of the columns that are kept, and how many are whatever they take: those of the corners of a few triangles.
const KEPT_BYTES: usize = 64 << 20;
const KEPT: usize = 12;

/// Columns that are solved for together: as many as a cut body solves for in the time of one.
const TOGETHER: usize = 4;

/// Columns of all bodies of a file.
#[derive(Debug, Default)]
pub struct OnDemand(Mutex<BTreeMap<String, Arc<OfBody>>>);

/// Columns of one body.
#[derive(Debug, Default)]
pub struct OfBody {
    factor: Mutex<Option<Arc<LoadedFactor>>>,
    state: Mutex<State>,
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Columns with their places, those that were asked for last in front.
    columns: VecDeque<(usize, Arc<Yield>)>,
    /// The thread's next places.
    wanted: Vec<usize>,
    /// Places that the thread, or somebody who waits, is solving for.
    solving: BTreeSet<usize>,
    is_at_work: bool,
    /// Error with which the thread failed: it would fail again.
    fault: Option<Arc<GreenError>>,
}

impl OnDemand {
    pub fn body(&self, body: &str) -> Arc<OfBody> {
        lock(&self.0).entry(body.to_owned()).or_default().clone()
    }
}

impl OfBody {
    /// The factor, read where it was not before.
    pub fn factor(
        &self,
        read: impl FnOnce() -> Result<LoadedFactor, GreenError>,
    ) -> Result<Arc<LoadedFactor>, GreenError> {
        let mut factor = lock(&self.factor);
        match &*factor {
            Some(factor) => Ok(factor.clone()),
            None => Ok(factor.insert(Arc::new(read()?)).clone()),
        }
    }

    /// The columns at these places; `solve` is asked for those that are not there and that nobody else is solving for, as many.
    pub fn columns(
        &self,
        places: &[usize],
        solve: impl Fn(&[usize]) -> Result<Vec<Yield>, GreenError>,
    ) -> Result<Vec<Arc<Yield>>, GreenError> {
        let mut found = BTreeMap::new();
        let mut state = lock(&self.state);
        loop {
            let open: Vec<usize> = places.iter().copied().filter(|at| !found.contains_key(at)).collect();
            found.extend(state.found(&open));
            let missing: BTreeSet<usize> = open.into_iter().filter(|at| !found.contains_key(at)).collect();
            if missing.is_empty() {
                break;
            }
            let mut own: Vec<usize> = missing.into_iter().filter(|at| !state.solving.contains(at)).collect();
            if own.is_empty() {
                state = self.arrived.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            }
            state.fill(&mut own);
            state.solving.extend(&own);
            drop(state);
            let solving = Solving { of: self, places: &own };
            let solved = solve(&own)?;
            let is_whole = solved.len() == own.len();
            state = lock(&self.state);
            for (place, column) in own.iter().zip(solved) {
                let column = Arc::new(column);
                found.insert(*place, column.clone());
                state.keep(*place, column);
            }
            drop(state);
            drop(solving);
            if !is_whole {
                break;
            }
            state = lock(&self.state);
        }
        Ok(places.iter().filter_map(|place| found.get(place).cloned()).collect())
    }

    /// Has the columns at `places` solved for by `work` on a thread, the first ones first, so that they are there when they are asked for.
    /// Places that were to come and are not among these are left out.
    pub fn prepare(
        self: &Arc<Self>,
        places: &[usize],
        work: impl Fn(&[usize]) -> Result<(), GreenError> + Send + 'static,
    ) -> Result<(), GreenError> {
        let mut state = lock(&self.state);
        let found = state.found(places);
        state.wanted = places.iter().copied().filter(|place| !found.contains_key(place)).collect();
        if state.wanted.is_empty() || state.fault.is_some() {
            return Ok(());
        }
        self.have_thread(&mut state, work)
    }

    /// The columns at `places`, or `None` where they are not there within `patience`: they come later, by `work` on a thread,
    /// which leaves them here.
    pub fn columns_within(
        self: &Arc<Self>,
        places: &[usize],
        patience: Duration,
        work: impl Fn(&[usize]) -> Result<(), GreenError> + Send + 'static,
    ) -> Result<Option<Vec<Arc<Yield>>>, GreenError> {
        let mut state = lock(&self.state);
        if let Some(known) = state.known(places) {
            return Ok(Some(known));
        }
        if let Some(fault) = &state.fault {
            return Err(GreenError::InBackground(fault.clone()));
        }
        for place in places {
            if !state.wanted.contains(place) {
                state.wanted.push(*place);
            }
        }
        self.have_thread(&mut state, work)?;
        let waits = |state: &mut State| state.is_at_work && state.known(places).is_none();
        let waited = self.arrived.wait_timeout_while(state, patience, waits);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match (state.known(places), &state.fault) {
            (None, Some(fault)) => Err(GreenError::InBackground(fault.clone())),
            (known, _) => Ok(known),
        }
    }

    /// Drops all columns.
    pub fn forget(&self) {
        let mut state = lock(&self.state);
        (state.columns, state.wanted) = (VecDeque::new(), Vec::new());
    }

    /// Starts the thread, unless it is at work.
    fn have_thread(
        self: &Arc<Self>,
        state: &mut State,
        work: impl Fn(&[usize]) -> Result<(), GreenError> + Send + 'static,
    ) -> Result<(), GreenError> {
        if std::mem::replace(&mut state.is_at_work, true) {
            return Ok(());
        }
        let of_thread = self.clone();
        let started = std::thread::Builder::new().name("columns".into()).spawn(move || {
            let _ending = Ending(&of_thread);
            while let Some(places) = of_thread.next() {
                if let Err(error) = work(&places) {
                    lock(&of_thread.state).fault = Some(Arc::new(error));
                    return;
                }
                of_thread.arrived.notify_all();
            }
        });
        started.map(drop).map_err(|source| {
            state.is_at_work = false;
            GreenError::Io { path: "a thread for columns of the compliance".into(), source }
        })
    }

    /// The next places of the thread; with none it ends.
    fn next(&self) -> Option<Vec<usize>> {
        let mut state = lock(&self.state);
        let mut missing = Vec::new();
        while missing.is_empty() && !state.wanted.is_empty() {
            let count = state.wanted.len().min(TOGETHER);
            let wanted: Vec<usize> = state.wanted.drain(..count).collect();
            let found = state.found(&wanted);
            let is_missing = |place: &usize| !found.contains_key(place) && !state.solving.contains(place);
            missing = wanted.into_iter().filter(is_missing).collect();
        }
        state.is_at_work = !missing.is_empty();
        state.is_at_work.then_some(missing)
    }
}

impl State {
    fn found(&mut self, places: &[usize]) -> BTreeMap<usize, Arc<Yield>> {
        let (asked, others) = self.columns.drain(..).partition(|(place, _)| places.contains(place));
        self.columns = asked;
        let found = self.columns.iter().cloned().collect();
        self.columns.extend::<VecDeque<_>>(others);
        found
    }

    /// Adds so many of the thread's next places that no solve is for fewer than [`TOGETHER`].
    fn fill(&mut self, places: &mut Vec<usize>) {
        let mut room = places.len().next_multiple_of(TOGETHER) - places.len();
        let State { columns, wanted, solving, .. } = self;
        wanted.retain(|place| {
            let is_open = !solving.contains(place) && columns.iter().all(|(kept, _)| kept != place);
            let is_added = room > 0 && is_open && !places.contains(place);
            if is_added {
                places.push(*place);
                room -= 1;
            }
            !is_added
        });
    }

    fn known(&mut self, places: &[usize]) -> Option<Vec<Arc<Yield>>> {
        let found = self.found(places);
        places.iter().map(|place| found.get(place).cloned()).collect()
    }

    fn keep(&mut self, place: usize, column: Arc<Yield>) {
        let most = (KEPT_BYTES / size_of_val(column.as_slice()).max(1)).max(KEPT);
        self.columns.retain(|(kept, _)| *kept != place);
        self.columns.truncate(most - 1);
        self.columns.push_front((place, column));
    }
}

/// Guard of places that are being solved for, however that ends.
struct Solving<'a> {
    of: &'a OfBody,
    places: &'a [usize],
}

impl Drop for Solving<'_> {
    fn drop(&mut self) {
        lock(&self.of.state).solving.retain(|place| !self.places.contains(place));
        self.of.arrived.notify_all();
    }
}

/// Guard that announces the end of the thread, however it ended.
struct Ending<'a>(&'a OfBody);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        lock(&self.0.state).is_at_work = false;
        self.0.arrived.notify_all();
    }
}

/// Locks a mutex even after a panic: nothing is written in parts, so a thread that panicked left it whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
