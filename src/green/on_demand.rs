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

    /// The columns at these places; `solve` is asked for those that are not there, as many.
    pub fn columns(
        &self,
        places: &[usize],
        solve: impl FnOnce(&[usize]) -> Result<Vec<Yield>, GreenError>,
    ) -> Result<Vec<Arc<Yield>>, GreenError> {
        let mut found = lock(&self.state).found(places);
        let missing: BTreeSet<usize> = places.iter().copied().filter(|at| !found.contains_key(at)).collect();
        if !missing.is_empty() {
            let missing: Vec<usize> = missing.into_iter().collect();
            let solved = solve(&missing)?;
            let mut state = lock(&self.state);
            for (place, column) in missing.into_iter().zip(solved) {
                let column = Arc::new(column);
                found.insert(place, column.clone());
                state.keep(place, column);
            }
        }
        Ok(places.iter().filter_map(|place| found.get(place).cloned()).collect())
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
        if !std::mem::replace(&mut state.is_at_work, true) {
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
            if let Err(source) = started {
                state.is_at_work = false;
                return Err(GreenError::Io { path: "a thread for columns of the compliance".into(), source });
            }
        }
        let waits = |state: &mut State| state.is_at_work && state.known(places).is_none();
        let waited = self.arrived.wait_timeout_while(state, patience, waits);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match (state.known(places), &state.fault) {
            (None, Some(fault)) => Err(GreenError::InBackground(fault.clone())),
            (known, _) => Ok(known),
        }
    }

    /// The next places of the thread; with none it ends.
    fn next(&self) -> Option<Vec<usize>> {
        let mut state = lock(&self.state);
        let wanted = std::mem::take(&mut state.wanted);
        let found = state.found(&wanted);
        let missing: Vec<usize> = wanted.into_iter().filter(|place| !found.contains_key(place)).collect();
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
