//! Online deformation: control poses in, displacements, positions and normals of the surface out.
//!
//! One [`DeformationModel`] per body turns poses into coefficients (the paper's `fieldHasChanged`), [`Deformer`] sums
//! u = Σ cₖ u⁽ᵏ⁾ over the columns of the .green file (its `evaluate`) and adds the rest surface and the normals. [`Statics`] stands apart: it solves a body anew for every pose.

mod deformer;
mod followed;
mod force;
mod guard;
mod linear;
mod normals;
mod partial;
mod pose;
mod rotation;
mod screw;
mod statics;
mod superposition;
mod turn;

pub use deformer::{Deformer, FrameTimes};
pub use followed::FollowedTurn;
pub use force::{Wrench, wrenches};
pub use guard::{CATCH_UP, JUMP, PoseFault, PoseGuard, STRETCH};
pub use linear::Linear;
pub use normals::vertex_normals;
pub use pose::{ControlPose, ControlPoses};
pub use rotation::{Rotation, is_mean_defined, mean_rotation, unwrapped};
pub use screw::Screw;
pub use statics::{Settled, Statics, StaticsError};
pub use superposition::{BYTES_PER_THREAD, Columns, Superposition};
pub use turn::local_turn;

use crate::fem::Law;
use crate::green::{FIELDS, Needs};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// Displacements of the surface nodes: the point X of the body comes to
/// x = body_from_surface · (X + u), both about the body's centre.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceDisplacements {
    pub u: Vec<[f32; 3]>,
    /// Rigid motion that the model took out of the poses; the identity for `linear`.
    pub body_from_surface: Isometry3<f64>,
}

impl SurfaceDisplacements {
    pub fn zeros(nodes: usize) -> SurfaceDisplacements {
        SurfaceDisplacements { u: vec![[0.0; 3]; nodes], body_from_surface: Isometry3::identity() }
    }
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

/// What one sum cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SumStats {
    /// Control elements whose columns were summed again.
    pub elements_summed: usize,
    /// Columns read for them.
    pub columns_read: usize,
}

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
    /// Pose by pose by [`Statics`]; the body has no part in the .green file.
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

/// All models; a new one is one file and one line here.
pub const MODELS: &[ModelEntry] = &[
    linear::ENTRY,
    rotation::ENTRY,
    statics::STVK_ENTRY,
    statics::NEO_HOOKEAN_ENTRY,
    statics::COROTATIONAL_ENTRY,
];

/// The model called `name`, or what there is instead.
pub fn find_model(name: &str) -> Result<&'static ModelEntry, String> {
    MODELS
        .iter()
        .find(|entry| entry.name == name)
        .ok_or_else(|| crate::config::unknown_name("model", name, MODELS.iter().map(|entry| entry.name)))
}

/// Why a model of [`Kind::Static`] cannot be shown, and the remedy.
pub fn not_online(model: &str) -> String {
    format!(
        "\"{model}\" is solved anew for every pose, which takes longer than a frame: `greenstage deform` alone takes it; \
         write model = \"rotation\" or \"linear\" to see and move the body"
    )
}
