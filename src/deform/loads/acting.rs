//! Loads that act on a body now, for a model that has them as forces in its own equilibrium.
//!
//! In: the [`AppliedLoads`] as frames set them, and tables with a column of vectors for each of the loads' columns. Out: sums of
//! these columns. While a pose is settled all forces keep their directions: those that follow the body are turned beforehand.

use super::applied::{AppliedLoads, PointLoad, Pull, SharedLoads};
use crate::deform::model::LoadInput;
use crate::green::{LoadMeta, Turning};
use nalgebra::{DMatrix, Vector3};

type V3 = Vector3<f64>;

pub struct Acting {
    shared: SharedLoads,
    metas: Vec<LoadMeta>,
    /// The loads as they were read last.
    pub applied: AppliedLoads,
}

impl Acting {
    pub fn new(input: &LoadInput<'_>) -> Acting {
        let (shared, metas) = (input.shared.clone(), input.metas.to_vec());
        Acting { shared, metas, applied: AppliedLoads::default() }
    }

    /// Reads what is applied now, or keeps that of the last time where a frame is just setting it; whether it has changed.
    pub fn read(&mut self) -> bool {
        let Ok(shared) = self.shared.try_lock() else { return false };
        let has_changed = *shared != self.applied;
        if has_changed {
            self.applied.clone_from(&shared);
        }
        has_changed
    }

    /// Whether nothing acts.
    pub fn is_none(&self) -> bool {
        self.applied.points.is_empty() && self.applied.coefficients.iter().all(|c| *c == 0.0)
    }

    /// Number of columns of the loads.
    pub fn columns(&self) -> usize {
        self.metas.iter().map(|meta| meta.columns).sum()
    }

    /// Thermal strain: the relative elongation of the body where it is free.
    pub fn strain(&self) -> f64 {
        let inner = self.turnings().zip(&self.applied.coefficients);
        inner.filter(|(turning, _)| *turning == Turning::Inner).map(|(_, strain)| strain).sum()
    }

    /// Adds the columns of a table of vectors for the loads that turn like this.
    pub fn add(&self, table: &DMatrix<f64>, like: Turning, sums: &mut [V3]) {
        let all = self.turnings().zip(&self.applied.coefficients).zip(table.column_iter());
        for ((turning, c), column) in all {
            if turning == like && *c != 0.0 {
                for (sum, own) in sums.iter_mut().zip(column.as_slice().chunks_exact(3)) {
                    *sum += V3::from_column_slice(own) * *c;
                }
            }
        }
    }

    /// The points that forces are applied to, and these, N, along the body's axes.
    pub fn points(&self) -> impl Iterator<Item = (&PointLoad, V3)> {
        self.applied.points.iter().filter_map(|point| match point.pull {
            Pull::Force(force) => Some((point, force)),
            // A model without a compliance takes no springs.
            Pull::Towards { .. } => None,
        })
    }

    fn turnings(&self) -> impl Iterator<Item = Turning> {
        self.metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns))
    }
}
