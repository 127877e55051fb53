//! The coordinates z of all that nothing prescribes, for one set of released elements: their coefficients, then q.
//!
//! In: the tables of a body, and which elements are released. Out: the modes of z, and how z and the prescribed elements act on each
//! other, with K of the body at rest. In axes that turn a released element has three shifts and three turns, in `linear` all its fields.

use super::coupled::{Coupled, Damping};
use super::free_body::FreeBody;
use super::tables::Tables;
use crate::green::FIELDS;
use nalgebra::{DMatrix, Vector3};

/// The coordinates z for one set of released elements.
pub struct System {
    pub released: Vec<bool>,
    /// All coordinates from z.
    pub all_from_own: DMatrix<f64>,
    /// BᵀM and BᵀK, B = `all_from_own`.
    pub mass: DMatrix<f64>,
    pub stiffness: DMatrix<f64>,
    /// On all coordinates ([`Tables::centrifugal`]).
    pub centrifugal: DMatrix<f64>,
    pub coupled: Coupled,
    /// The split of a body that nothing holds and whose elements are rigid.
    pub whole: Option<FreeBody>,
}

/// Coefficients of an element that turns by 1 rad about an axis, or moves by 1 m along it: 12 × 6.
fn rigid_fields() -> DMatrix<f64> {
    let mut fields = DMatrix::zeros(FIELDS, 6);
    for axis in 0..3 {
        fields[(axis, axis)] = 1.0;
        let cross = Vector3::ith(axis, 1.0).cross_matrix();
        (0..9).for_each(|i| fields[(3 + i, 3 + axis)] = cross[(i / 3, i % 3)]);
    }
    fields
}

impl System {
    pub fn new(tables: &Tables, released: Vec<bool>, is_linear: bool, damping: Damping) -> System {
        let own = if is_linear { DMatrix::identity(FIELDS, FIELDS) } else { rigid_fields() };
        let count = released.iter().filter(|released| **released).count() * own.ncols();
        let (fields, modes) = (tables.fields(), tables.modes());
        let mut b = DMatrix::zeros(fields + modes, count + modes);
        let mut first = 0;
        for (e, _) in released.iter().enumerate().filter(|(_, released)| **released) {
            b.view_mut((FIELDS * e, first), own.shape()).copy_from(&own);
            first += own.ncols();
        }
        b.view_mut((fields, count), (modes, modes)).fill_with_identity();
        let (mass, stiffness) = (b.tr_mul(&tables.mass), b.tr_mul(&tables.stiffness));
        let own_mass = &mass * &b;
        let coupled = Coupled::new(&own_mass, &(&stiffness * &b), damping);
        let is_whole = !is_linear && released.iter().all(|released| *released);
        let whole = if is_whole { FreeBody::new(tables, &own_mass) } else { None };
        let centrifugal = tables.centrifugal(&released);
        System { released, all_from_own: b, mass, stiffness, centrifugal, coupled, whole }
    }
}
