//! Displacements of the whole body for forces at single free nodes.
//!
//! In: free nodes. Out: A⁻¹ of unit forces there, over all free nodes. They do not depend on cuts; those that were asked for last are
//! kept.

use super::solves::{PointField, Solves};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Mutex, PoisonError};

/// Bytes of the fields that are kept, and the number that is kept whatever they take.
const KEPT_BYTES: usize = 256 << 20;
const KEPT: usize = 12;

pub struct PointFields {
    pub solves: Solves,
    /// Number of free nodes.
    free: usize,
    /// Fields with their nodes, those that were asked for last in front.
    kept: Mutex<VecDeque<(u32, PointField)>>,
}

impl PointFields {
    pub fn new(solves: Solves, free: usize) -> PointFields {
        PointFields { solves, free, kept: Mutex::default() }
    }

    /// The fields of these free nodes.
    pub fn at(&self, nodes: impl IntoIterator<Item = u32>) -> Result<BTreeMap<u32, PointField>, String> {
        // Fields are whole even if a thread has panicked between them.
        let lock = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let nodes: BTreeSet<u32> = nodes.into_iter().collect();
        let mut kept = lock();
        let (asked, others): (VecDeque<_>, VecDeque<_>) =
            kept.drain(..).partition(|(node, _)| nodes.contains(node));
        let mut found: BTreeMap<u32, PointField> = asked.iter().cloned().collect();
        *kept = asked;
        kept.extend(others);
        drop(kept);
        let missing: Vec<u32> = nodes.into_iter().filter(|node| !found.contains_key(node)).collect();
        if missing.is_empty() {
            return Ok(found);
        }
        let fields = self.solves.points(missing.clone())?;
        let most = (KEPT_BYTES / (72 * self.free).max(1)).max(KEPT);
        let mut kept = lock();
        for (node, field) in missing.into_iter().zip(fields) {
            kept.push_front((node, field.clone()));
            found.insert(node, field);
        }
        kept.truncate(most);
        Ok(found)
    }
}
