//! What a deformation model is: control poses in, the state of a body out.

use super::frames::PoseSlope;
use super::loads::applied::SharedLoads;
use super::memory::ModelMemory;
use super::pose::ControlPose;
use crate::base::parts::PartWeights;
use crate::fem::{FreeFace, Lame, Law, STVK, hooke_at_free_face};
use crate::green::{AFFINE, CUBIC, Family, Fits, LoadMeta, REDUCED};
use nalgebra::{DMatrix, Isometry3, UnitQuaternion, Vector3};
use std::cmp::Ordering;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// How a body's control poses become its state. Exactly one per body.
pub trait DeformationModel: Send {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState;

    /// The strain energy V of the poses, and its derivatives by the pose of each control element: every force that the
    /// program shows, writes or lets a hand feel. `None` where the .green file lacks the numbers for it. Allocates
    /// nothing, for the force loop.
    fn respond(&mut self, _poses: &[ControlPose], _slopes: &mut [PoseSlope]) -> Option<Response> {
        None
    }

    /// Does a part of what [`DeformationModel::respond_beside`] needs, beginning anew where `anew`: the second derivatives of V at
    /// the last response. True when nothing is left to do; until then each tick of the force loop has time for one part.
    fn prepare_beside(&mut self, _anew: bool) -> bool {
        true
    }

    /// [`DeformationModel::respond`] a little beside the poses that were asked last, to first order of the way there, for
    /// stiffnesses: the equilibrium stays, and a call costs much less than a response. `None` of a model that has no such way,
    /// and where it is not prepared or has no equilibrium.
    fn respond_beside(&mut self, _poses: &[ControlPose], _slopes: &mut [PoseSlope]) -> Option<Response> {
        None
    }

    /// Whether the last response took so long that the force loop should ask for no other in the same tick.
    fn was_long(&self) -> bool {
        false
    }

    /// What the model keeps from one frame to the next.
    fn memory(&self) -> ModelMemory {
        ModelMemory::default()
    }

    /// Goes on from what a model of the same body kept. The error says why it cannot, and the model is as it was.
    fn set_memory(&mut self, _memory: &ModelMemory) -> Result<(), String> {
        Ok(())
    }

    /// Displacements of all surface nodes that are no sum of columns, m, before parts move; they are added to the sum.
    /// A model that has them has them from its making on.
    fn field(&self) -> Option<&[[f32; 3]]> {
        None
    }

    /// What the forces at single points came to in the last state.
    fn point_results(&self) -> &[PointResult] {
        &[]
    }

    /// Whether the state has changed though no pose has: what is computed in the background has arrived.
    fn has_news(&mut self) -> bool {
        false
    }

    /// How old the state is, of a model that computes in the background.
    fn age(&self) -> Option<StateAge> {
        None
    }

    /// From now on a state waits at most so long for what is computed in the background. With [`Duration::MAX`] every state is
    /// that of its own poses: for pictures and recordings.
    fn be_patient(&mut self, _patience: Duration) {}

    /// A second model of the same body for a force loop, where it shares what is computed in the background; `None` of a
    /// model that can be made twice.
    fn for_force_loop(&self) -> Option<Box<dyn DeformationModel>> {
        None
    }

    /// How much each part moves each node of the rest surface, of a model that has several; `None` of one part, whose
    /// motion is that of the whole body. Asked once.
    fn part_weights(&self, _rest: &[[f32; 3]]) -> Option<PartWeights> {
        None
    }

    /// Forces are shown from now on.
    fn feel(&mut self) {}

    /// Forgets the poses seen so far: the next one stands alone, as in a batch.
    fn forget(&mut self) {}

    /// The next pose of `e` continues this turn, whose sign tells 200° from -160°, in a model that follows turns.
    fn set_turn(&mut self, _e: usize, _turn: UnitQuaternion<f64>) {}
}

/// One entry of the list of models.
#[derive(Clone, Copy)]
pub struct ModelEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// Column families that must be precomputed for it.
    pub requirements: &'static [Family],
    pub frame: Frame,
    /// Families that its strain energy needs beside those; `None`: it has no energy and cannot be felt.
    pub energy: Option<&'static [Family]>,
    /// Largest turns of a piece of the surface, or of control elements against each other where the model moves parts, in
    /// degrees, up to which it is good and up to which it is fair: off by about 0.2 % and 2 % of the body's length.
    pub turn_limits_deg: [f64; 2],
    pub kind: Kind,
    pub loads: Bearing,
    /// Whether a body's shape is one for it, where that can be told without solving.
    pub fits: Option<Fits>,
}

impl ModelEntry {
    /// Whether the columns of control elements are summed as in the theory of small strain, in a frame that may turn along; a model
    /// without them has a shape of its own.
    pub fn is_of_small_strain(&self) -> bool {
        let has_columns = self.requirements.iter().any(|family| family.name == AFFINE.name);
        self.law().is_none() && has_columns && !self.is_quartic()
    }

    /// The law whose static equilibrium it is, found anew for every pose; `None` of a model that is computed in every frame from
    /// what the .green file holds.
    pub fn law(&self) -> Option<&'static Law> {
        match self.kind {
            Kind::Background(law) => Some(law),
            Kind::Online(_) => None,
        }
    }

    /// Whether it is linear in the matrices of the poses, and takes them as they are, not as turns.
    pub fn is_linear(&self) -> bool {
        self.frame == Frame::Rest
    }

    /// Whether its forces near rest are those of the stiffness matrix: sums of columns in one frame.
    pub fn is_exact_near_rest(&self) -> bool {
        let has = |wanted: Family| self.requirements.iter().any(|family| family.name == wanted.name);
        self.law().is_none() && has(AFFINE) && !has(CUBIC)
    }

    /// Whether it takes forces at points of the surface without columns of a compliance.
    pub fn takes_points(&self) -> bool {
        matches!(self.loads, Bearing::Forces(_))
    }

    fn is_quartic(&self) -> bool {
        self.requirements.iter().any(|family| family.name == REDUCED.name)
    }

    /// What the model's own law makes of the stretches in a free face: St. Venant–Kirchhoff's where its energy is quartic, that
    /// of a background model, else Hooke's law of small strain in the frame that turns along.
    pub fn free_face(&self) -> fn([f64; 2], Lame) -> FreeFace {
        match self.kind {
            Kind::Background(law) => law.free_face,
            Kind::Online(_) if self.is_quartic() => STVK.free_face,
            Kind::Online(_) => hooke_at_free_face,
        }
    }
}

/// Its name.
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

impl PartialEq for ModelEntry {
    fn eq(&self, other: &ModelEntry) -> bool {
        self.name == other.name
    }
}

impl Eq for ModelEntry {}

/// In the order of their names.
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

/// How a model bears loads and forces at points.
#[derive(Clone, Copy)]
pub enum Bearing {
    /// By columns of the theory of small strain in its frame, and those of a compliance of its surface.
    Columns,
    /// As forces in its own equilibrium; a body with loads needs these families beside the model's own.
    Forces(&'static [Family]),
}

/// In which frame a model's displacements stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// In that of the body at rest.
    Rest,
    /// In one that follows the mean motion of the control elements.
    MeanMotion,
    /// In that of the body at rest, solved for large rotations.
    Solved,
}

/// A strain energy, by [`DeformationModel::respond`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Response {
    /// J.
    #[serde(with = "crate::field::numbers")]
    pub energy: f64,
    /// False where the frame or the equilibrium of these poses was not found, and an earlier one was kept.
    pub is_defined: bool,
}

/// What a model is made from. Lengths are about the body's centre, m.
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
    /// `None` of a body on which nothing may act.
    pub loads: Option<LoadInput<'a>>,
}

/// What acts on a body beside its control elements, for a model that has it as forces in its equilibrium.
#[derive(Clone, Copy)]
pub struct LoadInput<'a> {
    /// The loads that the body's file has, and what is applied as frames set it.
    pub metas: &'a [LoadMeta],
    pub shared: &'a SharedLoads,
    pub surface: &'a ColumnsAt,
}

/// Where a node of the surface is at rest, and the displacements of all columns of the file there.
pub type ColumnsAt = Arc<dyn Fn(u32) -> (Vector3<f64>, Vec<Vector3<f64>>) + Send + Sync>;

/// Makes a model; the error says why this body cannot have it.
pub type MakeModel = fn(&ModelInput<'_>) -> Result<Box<dyn DeformationModel>, String>;

/// How a model is evaluated.
#[derive(Clone, Copy)]
pub enum Kind {
    /// In every frame, from what the .green file holds.
    Online(MakeModel),
    /// As static equilibrium under a law, found in the background; by [`super::Statics`] in a batch.
    Background(&'static Law),
}

/// What a force at a single point came to, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointResult {
    /// Where the point is, m about the body's centre.
    pub place: Vector3<f64>,
    /// On the body, N.
    pub force: Vector3<f64>,
}

/// How old a state is that was computed in the background.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StateAge {
    /// It is that of the newest poses.
    Current,
    /// It is that of poses that were asked for so long ago.
    Old { seconds: f64 },
    /// There is no state beyond it on the way to the newest poses.
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

/// All that a body's surface is computed from: x_i = Σ_p w_ip (R_p (X_i + Σ_k c_k u_i⁽ᵏ⁾) + t_p).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyState {
    /// R_p and t_p of each rigid part. That of a single part is what the model took out of the poses: the identity for
    /// `linear`.
    #[serde(with = "crate::field::numbers::list")]
    pub parts: Vec<Isometry3<f64>>,
    /// c_k, group after group as the body's columns stand; a model may leave out those behind its own, which are then 0.
    #[serde(with = "crate::field::numbers::flat")]
    pub coefficients: Vec<f64>,
    /// The mean rotation is not defined for these poses: an earlier one was kept, the picture is not to be trusted.
    pub rotation_undefined: bool,
    /// Counts the changes of a field of the model's own ([`DeformationModel::field`]), and of the surface's triangles, which are no
    /// change of the above.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub field_version: u64,
}

fn is_zero(version: &u64) -> bool {
    *version == 0
}

impl BodyState {
    /// One part where it was made, and so many columns without a coefficient.
    pub fn at_rest(columns: usize) -> BodyState {
        BodyState {
            parts: vec![Isometry3::identity()],
            coefficients: vec![0.0; columns],
            rotation_undefined: false,
            field_version: 0,
        }
    }

    /// The motion of the first part: of the whole body, where it has one part alone.
    pub fn body_from_surface(&self) -> Isometry3<f64> {
        self.parts.first().copied().unwrap_or_else(Isometry3::identity)
    }
}
