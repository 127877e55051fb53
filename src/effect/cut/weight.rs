//! Gravity on a body that has lost parts of itself.
//!
//! In: the columns and tables of gravity of a base, and the masses m at its nodes that it has lost. Out: those of what is left, before it
//! is cut: with the forces Δ = m e of gravity e there,
//!
//! ```text
//! G' = G - A⁻¹ Δ        UᵀF' = UᵀF - UᵀΔ        F'ᵀG' = FᵀG - GᵀΔ - ΔᵀG'
//! ```

use super::base::Base;
use super::loose::{Masses, moments_of};
use crate::fem::NodeFields;
use nalgebra::{DMatrix, Vector3};
use std::sync::Arc;

impl Base {
    /// [`Base::whole`] without these masses at nodes.
    pub(super) fn whole_without(&self, lost: &Masses) -> Result<Arc<NodeFields>, String> {
        let whole = self.whole()?.clone();
        let affine = self.tables.stiffness.nrows();
        let free_at = |(node, mass): (&u32, &f64)| Some((self.free_at[*node as usize]?, *mass));
        let mut loaded: Vec<(u32, f64)> = lost.iter().filter_map(free_at).collect();
        loaded.sort_by_key(|(free, _)| *free);
        if loaded.is_empty() {
            return Ok(whole);
        }
        let mut b = NodeFields::zeros(loaded.len(), 3);
        for (at, (_, mass)) in loaded.iter().enumerate() {
            (0..3).for_each(|axis| b.row_mut(3 * at + axis)[axis] = *mass);
        }
        let x = self.solves.solve_at(loaded.into_iter().map(|(free, _)| free).collect(), b, None)?;
        let mut fields = NodeFields::clone(&whole);
        for (at, node) in self.partition.free.iter().enumerate() {
            for axis in 0..3 {
                let own = &mut fields.row_mut(3 * *node as usize + axis)[affine..];
                own.iter_mut().zip(x.row(3 * at + axis)).for_each(|(own, x)| *own -= x);
            }
        }
        Ok(Arc::new(fields))
    }

    /// Tables of gravity without these masses at nodes, and what all is lost: UᵀF, FᵀG and 12 × 3. In: the place of a node about the body's
    /// centre, and the fields with and without them.
    pub(super) fn weight_without(
        &self,
        lost: &Masses,
        place: impl Fn(u32) -> Vector3<f64>,
        [whole, without]: [&NodeFields; 2],
    ) -> Option<[DMatrix<f64>; 3]> {
        let [mut reaction, mut compliance] = self.tables.weight.clone()?;
        let (affine, mut moments) = (reaction.nrows(), self.lost.clone());
        for (node, mass) in lost {
            for axis in 0..3 {
                let row = 3 * *node as usize + axis;
                for (k, u) in whole.row(row)[..affine].iter().enumerate() {
                    reaction[(k, axis)] -= mass * u;
                }
                for k in 0..3 {
                    compliance[(k, axis)] -= mass * whole.row(row)[affine + k];
                    compliance[(axis, k)] -= mass * without.row(row)[affine + k];
                }
            }
            moments += moments_of(*mass, &place(*node));
        }
        Some([reaction, compliance, moments])
    }
}
