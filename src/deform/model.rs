//! The interface of deformation models: from control poses to the state of a body.

use super::loads::applied::SharedLoads;
use super::memory::ModelMemory;
use super::pose::frame::{ControlPose, PoseSlope};
use crate::base::parts::PartWeights;
use crate::fem::{FreeFace, Lame, Law, NEO_HOOKEAN, STVK, hooke_at_free_face};
use crate::green::{AFFINE, CUBIC, Family, Fits, LoadMeta, REDUCED, REDUCED_NEO_HOOKEAN, Requirements};
use nalgebra::{DMatrix, Isometry3, UnitQuaternion, Vector3};
use std::cmp::Ordering;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Turns the control poses of a body into its [`BodyState`]. Each body has one.
pub trait DeformationModel: Send {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState;

    /// The strain energy V of the poses, and its derivatives with respect to the pose of each control element. From these come
    /// all forces of the model; the deformer adds those of effects. `None` if the .green file lacks the numbers for it. Allocates
    /// nothing, for the force loop.
    fn respond(&mut self, _poses: &[ControlPose], _slopes: &mut [PoseSlope]) -> Option<Response> {
        None
    }

    /// Computes the second derivatives of V at the last response, which [`DeformationModel::respond_beside`] needs, in parts, one
    /// a call, so that each fits into a tick of the force loop; `anew` starts over. Returns true when done.
    fn prepare_beside(&mut self, _anew: bool) -> bool {
        true
    }

    /// First-order estimate of [`DeformationModel::respond`] at poses near the last ones; no equilibrium is solved. It is much
    /// cheaper and serves to find stiffnesses. `None` if the model has no such estimate, is not prepared for it, or has no
    /// equilibrium.
    fn respond_beside(&mut self, _poses: &[ControlPose], _slopes: &mut [PoseSlope]) -> Option<Response> {
        None
    }

    /// Whether the last response was slow, so that the force loop should ask for no second one in this tick.
    fn was_long(&self) -> bool {
        false
    }

    /// The memory of the model: all that it keeps from one frame to the next.
    fn memory(&self) -> ModelMemory {
        ModelMemory::default()
    }

    /// Goes on from the memory of a model of the same body. The error says why it cannot, and the model is as it was.
    fn set_memory(&mut self, _memory: &ModelMemory) -> Result<(), String> {
        Ok(())
    }

    /// Displacements that cannot be written as sums of columns, one for each surface node, m. They are added before the parts
    /// move. A model returns `Some` always or never.
    fn field(&self) -> Option<&[[f32; 3]]> {
        None
    }

    /// Places and forces at the loaded points in the last state.
    fn point_results(&self) -> &[PointResult] {
        &[]
    }

    /// Whether the background has a new state although no pose changed.
    fn has_news(&mut self) -> bool {
        false
    }

    /// The age of the state, if the model computes in the background.
    fn age(&self) -> Option<StateAge> {
        None
    }

    /// Whether the last state has parts that are turned inside out, as far as the model knows.
    fn is_inverted(&self) -> bool {
        false
    }

    /// Limits the time that a state waits for the background to `patience`. With [`Duration::MAX`] every state is exactly that of
    /// the poses asked for, as pictures and recordings need it.
    fn be_patient(&mut self, _patience: Duration) {}

    /// A second model of the same body for a force loop, which shares the computation in the background; `None` if the caller can
    /// simply make the model again.
    fn for_force_loop(&self) -> Option<Box<dyn DeformationModel>> {
        None
    }

    /// The weight with which each part moves each node of the rest surface; `None` for one part, whose motion is that of the
    /// whole body. Called once, when the deformer is made.
    fn part_weights(&self, _rest: &[[f32; 3]]) -> Option<PartWeights> {
        None
    }

    /// Asks for forces from now on: a background model must compute them.
    fn feel(&mut self) {}

    /// Forgets the poses seen so far: the next one stands alone, as in a batch.
    fn forget(&mut self) {}

    /// Sets the turn from which the next pose of `e` is followed. The sign of its quaternion distinguishes 200° from -160°.
    fn set_turn(&mut self, _e: usize, _turn: UnitQuaternion<f64>) {}
}

/// One entry of the list of models.
#[derive(Clone, Copy)]
pub struct ModelEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// Column families that must be precomputed for it.
    pub requirements: &'static [Family],
    /// The frame of its displacements.
    pub frame: Frame,
    /// Families that its strain energy needs beside those; `None`: it has no energy and cannot be felt.
    pub energy: Option<&'static [Family]>,
    /// Two limits in degrees: up to the first the model is good (off by about 0.2 % of the body's length), up to the second fair
    /// (2 %). The angle is that of a piece of the surface, or, where the model moves parts, between control elements.
    pub turn_limits_deg: [f64; 2],
    /// The way in which it is evaluated: online or in the background.
    pub kind: Kind,
    /// The way in which it bears loads.
    pub loads: Bearing,
    /// Checks, without solving, whether the body's shape suits the model.
    pub fits: Option<Fits>,
}

impl ModelEntry {
    /// Whether the columns of control elements are summed as in the theory of small strain, in a frame that may turn along; a
    /// model without these columns computes its shape in another way.
    pub fn is_of_small_strain(&self) -> bool {
        self.law().is_none() && self.needs(AFFINE) && !self.is_reduced()
    }

    /// Column families that it and its strain energy need.
    pub fn with_energy(&self) -> Requirements {
        Requirements::new(self.requirements).and(Requirements::new(self.energy.unwrap_or_default()))
    }

    /// The material law, if the model is solved in the background for every pose.
    pub fn law(&self) -> Option<&'static Law> {
        match self.kind {
            Kind::Background(law) => Some(law),
            Kind::Online(_) => None,
        }
    }

    /// The law whose equilibrium at large strain its errors are measured against.
    pub fn large_strain_law(&self) -> &'static Law {
        self.law().unwrap_or(if self.needs(REDUCED_NEO_HOOKEAN) { &NEO_HOOKEAN } else { &STVK })
    }

    /// Whether it uses the matrices of the poses linearly, without extracting rotations.
    pub fn is_linear(&self) -> bool {
        self.frame == Frame::Rest
    }

    /// Whether its forces near rest are those of the stiffness matrix: sums of columns in one frame.
    pub fn is_exact_near_rest(&self) -> bool {
        self.law().is_none() && self.needs(AFFINE) && !self.needs(CUBIC)
    }

    /// Whether it takes forces at points of the surface without columns of a compliance.
    pub fn takes_points(&self) -> bool {
        matches!(self.loads, Bearing::Forces(_))
    }

    fn needs(&self, wanted: Family) -> bool {
        self.requirements.iter().any(|family| family.name == wanted.name)
    }

    /// Whether its energy is that of a law at large strain, in a few fields.
    pub fn is_reduced(&self) -> bool {
        self.needs(REDUCED) || self.needs(REDUCED_NEO_HOOKEAN)
    }

    /// The law for stresses in a free face: that at large strain of a background model or in a few fields; otherwise Hooke's, in the
    /// frame that turns along.
    pub fn free_face(&self) -> fn([f64; 2], Lame) -> FreeFace {
        match self.kind {
            Kind::Online(_) if !self.is_reduced() => hooke_at_free_face,
            _ => self.large_strain_law().free_face,
        }
    }
}

/// The model's name.
impl fmt::Display for ModelEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl fmt::Debug for ModelEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Orders models by their names.
impl Ord for ModelEntry {
    fn cmp(&self, other: &ModelEntry) -> Ordering {
        self.name.cmp(other.name)
    }
}

impl PartialOrd for ModelEntry {
    fn partial_cmp(&self, other: &ModelEntry) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The way in which a model bears loads and forces at points.
#[derive(Clone, Copy)]
pub enum Bearing {
    /// Columns of the theory of small strain in the model's frame, and columns of the surface's compliance.
    Columns,
    /// Forces in the model's own equilibrium; a body with loads needs these families beside the model's own.
    Forces(&'static [Family]),
}

/// The coordinates of a model's displacements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// The frame of the body at rest.
    Rest,
    /// A frame that follows the mean motion of the control elements.
    MeanMotion,
    /// The frame of the body at rest. It differs from [`Frame::Rest`] only in how the displacements are found: solved for large
    /// rotations.
    Solved,
}

/// The energy that [`DeformationModel::respond`] found.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Response {
    /// J.
    #[serde(with = "crate::field::numbers")]
    pub energy: f64,
    /// False where the frame or the equilibrium of these poses was not found, and an earlier one was kept.
    pub is_defined: bool,
}

/// The data from which a model is made. Places are relative to the body's centre, m.
pub struct ModelInput<'a> {
    pub controls: &'a [ControlRest],
    /// Surface nodes and triangles at rest.
    pub rest: &'a [[f32; 3]],
    pub triangles: &'a [[u32; 3]],
    /// Surface nodes of a control element.
    pub control_nodes: &'a dyn Fn(usize) -> Vec<u32>,
    /// A table of the body by its name, such as `stiffness`, where it was precomputed; `affine` are the columns of all control
    /// elements, a row for each axis of each surface node.
    pub table: &'a dyn Fn(&str) -> Option<DMatrix<f64>>,
    /// `None` if nothing may act on the body.
    pub loads: Option<LoadInput<'a>>,
}

/// The loads on a body beside its control elements, for a model that bears them as forces in its equilibrium.
#[derive(Clone, Copy)]
pub struct LoadInput<'a> {
    /// The loads that the body's file has, and what is applied as frames set it.
    pub metas: &'a [LoadMeta],
    pub shared: &'a SharedLoads,
    pub surface: &'a ColumnsAt,
}

/// Place of a node of the surface at rest, and the displacements of all columns of the file there.
pub type ColumnsAt = Arc<dyn Fn(u32) -> (Vector3<f64>, Vec<Vector3<f64>>) + Send + Sync>;

/// Makes a model; the error says why this body cannot have it.
pub type MakeModel = fn(&ModelInput<'_>) -> Result<Box<dyn DeformationModel>, String>;

/// The way in which a model is evaluated.
#[derive(Clone, Copy)]
pub enum Kind {
    /// Evaluation in every frame, from the .green file.
    Online(MakeModel),
    /// Static equilibrium under a law, found in the background; by [`super::Statics`] in a batch.
    Background(&'static Law),
}

/// Place and force at a loaded point, as the model found them, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointResult {
    /// The place of the point relative to the body's centre, m.
    pub place: Vector3<f64>,
    /// The force on the body, N.
    pub force: Vector3<f64>,
}

/// The age of a state that was computed in the background.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StateAge {
    /// The state is that of the newest poses.
    Current,
    /// The state is that of poses that were asked for `seconds` ago.
    Old { seconds: f64 },
    /// No equilibrium was found on the way to the newest poses.
    Lost,
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

/// The state from which a body's surface is computed: x_i = Σ_p w_ip (R_p (X_i + Σ_k c_k u_i⁽ᵏ⁾) + t_p).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyState {
    /// R_p and t_p of each rigid part. For a single part it is the motion that the model extracted from the poses: the identity
    /// for `linear`.
    #[serde(with = "crate::field::numbers::list")]
    pub parts: Vec<Isometry3<f64>>,
    /// c_k in the order of the body's columns. Trailing ones that a model leaves out count as 0.
    #[serde(with = "crate::field::numbers::flat")]
    pub coefficients: Vec<f64>,
    /// The mean rotation is undefined for these poses; the previous one was kept, so do not trust the picture.
    pub rotation_undefined: bool,
    /// Counts changes that the other members do not show: of the model's [`field`](DeformationModel::field), and of the
    /// triangles.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub field_version: u64,
}

fn is_zero(version: &u64) -> bool {
    *version == 0
}

impl BodyState {
    /// One part in its original place, and `columns` coefficients that are all zero.
    pub fn at_rest(columns: usize) -> BodyState {
        BodyState {
            parts: vec![Isometry3::identity()],
            coefficients: vec![0.0; columns],
            rotation_undefined: false,
            field_version: 0,
        }
    }

    /// The motion of the first part: that of the whole body, if it is the only one.
    pub fn body_from_surface(&self) -> Isometry3<f64> {
        self.parts.first().copied().unwrap_or_else(Isometry3::identity)
    }
}
