//! What a deformation model is: control poses in, coefficients of the columns out.

use super::pose::ControlPose;
use crate::fem::Law;
use crate::green::{FIELDS, Needs};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// How a body's control poses become coefficients of its columns. Exactly one per body.
pub trait DeformationModel: Send {
    fn coefficients(&mut self, poses: &[ControlPose]) -> Coefficients;

    /// Forgets the poses seen so far: the next one stands alone, as in a batch.
    fn forget(&mut self) {}

    /// The next pose of `e` continues this turn, whose sign tells 200° from -160°, in a model that follows turns.
    fn set_turn(&mut self, _e: usize, _turn: UnitQuaternion<f64>) {}
}

/// One entry of the list of models.
pub struct ModelEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// What must be precomputed for it beside the basis.
    pub needs: Needs,
    pub kind: Kind,
}

/// How a model is evaluated.
pub enum Kind {
    /// In every frame, from the columns of the .green file: makes the model for a body with control origins o_e and
    /// surface node counts of its control elements.
    Online(fn(&[ControlRest]) -> Box<dyn DeformationModel>),
    /// Pose by pose by [`super::Statics`]; the body has no part in the .green file.
    Static(&'static Law),
}

/// A control element at rest, as the models see it.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlRest {
    pub name: String,
    /// o_e about the body's centre, m.
    pub origin: Vector3<f64>,
    /// Nodes it holds.
    pub nodes: usize,
}

/// What a model makes of the poses of one body.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coefficients {
    /// cₖ, 12 a control element, in the surface's frame.
    // Derived code has a FIELDS of its own.
    pub c: Vec<[f64; crate::green::FIELDS]>,
    /// Rigid motion that the model took out of the poses; the identity for `linear`.
    #[serde(with = "crate::field::numbers")]
    pub body_from_surface: Isometry3<f64>,
    /// The mean rotation is not defined for these poses: an earlier one was kept, the picture is not to be trusted.
    pub rotation_undefined: bool,
}

impl Coefficients {
    pub fn at_rest(controls: usize) -> Coefficients {
        Coefficients {
            c: vec![[0.0; FIELDS]; controls],
            body_from_surface: Isometry3::identity(),
            rotation_undefined: false,
        }
    }
}
