//! The coordinates of a body that nothing holds, split into its motion as a whole and what deforms it.
//!
//! In: the mass matrix M of the coordinates z = (shift and turn of each element, q), and where the elements rest. Out: with the rates r
//! of z in the six rigid motions about the centre of mass, w = (rᵀMr)⁻¹ rᵀM ż and ż - r w; of forces rᵀf and f - M r (rᵀMr)⁻¹ rᵀf,
//! which deforms the body and moves its centre no more.

use super::tables::Tables;
use crate::world::flight::{RigidInertia, Twist};
use nalgebra::{DMatrix, DVector, Vector3};

#[derive(Clone, Debug, PartialEq)]
pub struct FreeBody {
    pub inertia: RigidInertia,
    /// r.
    rigid: DMatrix<f64>,
    /// (rᵀMr)⁻¹ rᵀM.
    twist: DMatrix<f64>,
}

impl FreeBody {
    /// `mass` is M of z; `None` of a body without mass.
    pub fn new(tables: &Tables, mass: &DMatrix<f64>) -> Option<FreeBody> {
        let inertia = RigidInertia::of_whole(&tables.whole)?;
        let mut rigid = DMatrix::zeros(mass.nrows(), 6);
        for (e, origin) in tables.origins.iter().enumerate() {
            let arm = origin - inertia.centre;
            for axis in 0..3 {
                let unit = Vector3::ith(axis, 1.0);
                rigid[(6 * e + axis, axis)] = 1.0;
                rigid[(6 * e + 3 + axis, 3 + axis)] = 1.0;
                rigid.view_mut((6 * e, 3 + axis), (3, 1)).copy_from(&unit.cross(&arm));
            }
        }
        let by_mass = rigid.tr_mul(mass);
        let inverse = (&by_mass * &rigid).try_inverse()?;
        Some(FreeBody { inertia, twist: inverse * by_mass, rigid })
    }

    /// The velocity as a whole, and the rest of ż.
    pub fn split(&self, rates: &DVector<f64>) -> (Twist, DVector<f64>) {
        let whole = &self.twist * rates;
        let rest = rates - &self.rigid * &whole;
        (Twist { velocity: whole.fixed_rows::<3>(0).into(), spin: whole.fixed_rows::<3>(3).into() }, rest)
    }

    /// Force and torque about the centre of mass, and the rest of f.
    pub fn split_force(&self, force: &DVector<f64>) -> ([Vector3<f64>; 2], DVector<f64>) {
        let whole = self.rigid.tr_mul(force);
        let rest = force - self.twist.tr_mul(&whole);
        ([whole.fixed_rows::<3>(0).into(), whole.fixed_rows::<3>(3).into()], rest)
    }
}
