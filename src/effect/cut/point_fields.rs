//! Displacements of the whole body for forces at single free nodes.
//!
//! In: free nodes. Out: A⁻¹ of unit forces there, over all free nodes. They do not depend on cuts; those that were asked for last are
//! kept. Each node is solved for alone, so that its bits do not depend on what else is asked for.

use super::solves::Solves;
use crate::fem::NodeFields;
use nalgebra::DMatrix;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of the fields that are kept, and the number that is kept whatever they take.
const KEPT_BYTES: usize = 256 << 20;
const KEPT: usize = 12;

/// Displacements of all free nodes for a force of 1 N along each axis: 3 free nodes × 3, m/N.
pub type PointField = Arc<DMatrix<f32>>;

pub struct PointFields {
    solves: Solves,
    /// Number of free nodes.
    free: usize,
    /// Fields with their nodes, those that were asked for last in front.
    kept: Mutex<VecDeque<(u32, PointField)>>,
}

impl PointFields {
    pub fn new(solves: Solves, free: usize) -> PointFields {
        PointFields { solves, free, kept: Mutex::default() }
    }

    /// A⁻¹ b.
    pub fn solve(&self, b: NodeFields) -> Result<NodeFields, String> {
        self.solves.solve(b)
    }

    /// The field of a free node.
    pub fn at(&self, node: u32) -> Result<PointField, String> {
        // Fields are whole even if a thread has panicked between them.
        let lock = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let mut kept = lock();
        if let Some(place) = kept.iter().position(|(of, _)| *of == node)
            && let Some(found) = kept.remove(place)
        {
            let field = found.1.clone();
            kept.push_front(found);
            return Ok(field);
        }
        drop(kept);
        let mut b = NodeFields::zeros(self.free, 3);
        (0..3).for_each(|axis| b.row_mut(3 * node as usize + axis)[axis] = 1.0);
        let x = self.solves.solve(b)?;
        let field = Arc::new(DMatrix::from_fn(3 * self.free, 3, |row, axis| x.row(row)[axis] as f32));
        let most = (KEPT_BYTES / (36 * self.free).max(1)).max(KEPT);
        let mut kept = lock();
        kept.truncate(most - 1);
        kept.push_front((node, field.clone()));
        Ok(field)
    }
}
