//! Displacements of a cut body for forces at single nodes, those that were asked for last.
//!
//! In: free nodes of a base, and the displacements of all free nodes by unit forces there. Out: the same, as long as there is room.

use crate::green::Yield;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes of the fields that are kept, and the number that is kept whatever they take.
const KEPT_BYTES: usize = 256 << 20;
const KEPT: usize = 12;

/// Fields with their nodes, those that were asked for last in front.
#[derive(Default)]
pub struct PointFields(Mutex<VecDeque<(u32, Arc<Yield>)>>);

impl PointFields {
    /// Fields of these nodes that are there.
    pub fn known(&self, nodes: &BTreeSet<u32>) -> BTreeMap<u32, Arc<Yield>> {
        let mut kept = self.lock();
        let (asked, others): (VecDeque<_>, VecDeque<_>) =
            kept.drain(..).partition(|(node, _)| nodes.contains(node));
        let known = asked.iter().cloned().collect();
        *kept = asked;
        kept.extend(others);
        known
    }

    pub fn keep(&self, node: u32, field: Arc<Yield>) {
        let most = (KEPT_BYTES / size_of_val(field.as_slice()).max(1)).max(KEPT);
        let mut kept = self.lock();
        kept.retain(|(other, _)| *other != node);
        kept.truncate(most - 1);
        kept.push_front((node, field));
    }

    pub fn forget(&self) {
        self.lock().clear();
    }

    /// Fields are whole even if a thread has panicked between them.
    fn lock(&self) -> MutexGuard<'_, VecDeque<(u32, Arc<Yield>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
