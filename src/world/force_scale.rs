//! The force that the longest arrow stands for, per control element.

use crate::green::FIELDS;
use nalgebra::{DMatrix, Matrix3};

/// An element that is carried by this part of the body's radius along its softest direction shows the longest arrow.
const FULL_AT: f64 = 0.25;

/// The force of the longest arrow.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceScale {
    /// N, per control element.
    pub full_n: Vec<f64>,
}

impl ForceScale {
    /// The scale of a body of the handle stiffness S and a ball of radius r about it: for a control element with the
    /// translational stiffness K (3 × 3 of S), 0.25 r times the least singular value of K.
    pub fn new(stiffness: &DMatrix<f64>, radius_m: f64) -> ForceScale {
        let full_n = |e: usize| {
            let k: Matrix3<f64> = stiffness.fixed_view::<3, 3>(FIELDS * e, FIELDS * e).into_owned();
            FULL_AT * radius_m * k.singular_values().min()
        };
        ForceScale { full_n: (0..stiffness.nrows() / FIELDS).map(full_n).collect() }
    }
}
