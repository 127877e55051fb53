//! The force that the longest arrow stands for, per control element.

use crate::deform::Deformer;
use crate::effect::any_requires;
use crate::green::{FIELDS, GreenFile, STIFFNESS};
use crate::scene::Body;
use nalgebra::Matrix3;

/// An element that is carried by this part of the body's radius along its softest direction shows the longest arrow.
const FULL_AT: f64 = 0.25;

/// The force of the longest arrow.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceScale {
    /// N, per control element.
    pub full_n: Vec<f64>,
}

/// The scale of a body of which the scene wants forces: for a control element with the translational stiffness K (3 × 3
/// of S) and a body of radius r, 0.25 r times the least singular value of K.
pub fn scale(body: &Body, deformer: &Deformer, radius_m: f64, file: &GreenFile) -> Option<ForceScale> {
    if !any_requires(&body.effects, STIFFNESS) {
        return None;
    }
    let stiffness = file.stiffness(&deformer.body)?;
    let full_n = |e: usize| {
        let k: Matrix3<f64> = stiffness.fixed_view::<3, 3>(FIELDS * e, FIELDS * e).into_owned();
        FULL_AT * radius_m * k.singular_values().min()
    };
    Some(ForceScale { full_n: (0..deformer.controls.len()).map(full_n).collect() })
}
