//! The data of a report: settings, what each of them costs, and how wrong it is.
//!
//! accuracy.json is a [`Report`] as JSON; the names of the fields are the names in the file.

use crate::deform::ModelEntry;
use crate::scene::{Storage, TOLERANCE};
use crate::solve::{ERROR_LIMITS, Solver};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Version of accuracy.json; the manual's chapter `errors` describes it.
pub const SCHEMA: u32 = 6;

/// All that was measured of one body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    pub schema: u32,
    pub program: String,
    /// Processor, cores, and how noisy it was: the spread of one and the same task.
    pub machine: String,
    pub scene: String,
    /// The command that writes this report again.
    pub command: String,
    pub body: String,
    /// Sentences about the body: mesh, material, control elements; one each.
    pub about: Vec<String>,
    /// Largest extent of the body, m.
    pub size: f64,
    /// Sentences about the references of the errors, one for each part.
    pub references: Vec<String>,
    /// Names of the poses, in their order, and where they come from.
    pub poses: Vec<String>,
    /// The poses that were compared with a finer equilibrium: of them are the errors of the rows. Without one, the rows have
    /// no error of the mesh.
    pub compared: Vec<String>,
    /// Sentences about the other poses, each with the reason.
    pub not_compared: Vec<String>,
    /// The error of the finer equilibrium itself, where two of its meshes were solved: relative, of shape and of wrench.
    pub doubt: Option<[f64; 2]>,
    pub pose_source: String,
    pub quick: bool,
    /// The setting that the scene itself asks for, with the storage and solver that it names.
    pub own: Setting,
    pub rows: Vec<Measurement>,
    /// The reliability of the rows' times.
    pub timing: Timing,
    /// Errors of the models alone, by the largest local rotation of the pose.
    pub models: Vec<ModelError>,
    /// Every model alone, by how far one control element turns.
    pub trials: ModelTrials,
    /// Errors of a smooth problem on the body's own mesh, where the theory promises rates of convergence.
    pub smooth: Vec<SmoothError>,
    /// The costs of each effect, whether the scene lists it or not.
    pub effects: Vec<EffectCost>,
    /// Sentences about what --quick left out for want of time.
    pub left_out: Vec<String>,
    /// The body as some of the settings bend it, for the page alone.
    #[serde(skip)]
    pub shapes: Option<Shapes>,
}

/// The load of the machine while evaluations were timed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Time of an evaluation in the busiest stretch of the measurement over that in the calmest: the median of all settings.
    pub scatter: f64,
    /// Programs that were running or waiting, the mean of the last minute, and processors for them.
    pub load: f64,
    pub processors: usize,
}

impl Timing {
    /// Scatter and load from which the machine counts as busy; an idle one has a scatter below 1.1, and the load of this program.
    const BUSY: [f64; 2] = [1.3, 1.5];

    /// A warning if the machine was too busy for the times to be used.
    pub fn warning(&self) -> Option<String> {
        let [scatter, load] = Timing::BUSY;
        let is_busy = self.scatter > scatter || self.load > load * self.processors as f64;
        is_busy.then(|| {
            format!(
                "The machine was busy: times varied by {}, and {:.1} programs shared {} processors. Do not use \
                 these times; errors and sizes hold.",
                super::units::times(self.scatter.max(1.0)),
                self.load,
                self.processors
            )
        })
    }
}

/// The body's surface in the pose in which the scene's own setting is most wrong.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shapes {
    pub pose: String,
    pub triangles: Vec<[u32; 3]>,
    /// Places of the surface nodes in equilibrium, m.
    pub equilibrium: Vec<Vector3<f64>>,
    /// Index of a row, and what its setting adds to the equilibrium at each surface node, m.
    pub errors: Vec<(usize, Vec<Vector3<f64>>)>,
}

/// A value for each parameter of a body ([`PARAMETERS`]).
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Setting {
    /// Uniform refinements of the scene's mesh.
    pub refine: u32,
    /// The name in scenes.
    pub element: String,
    /// Written as "cholesky", or as "pcg 1e-6" with its tolerance.
    #[serde(with = "crate::solve::solver_as_text")]
    pub solver: Solver,
    pub storage: String,
    pub model: &'static ModelEntry,
}

impl Setting {
    /// "tet10 h/2": the element on the scene's mesh, refined once.
    pub fn mesh(&self) -> String {
        Setting::mesh_name(&self.element, self.refine)
    }

    pub fn mesh_name(element: &str, refine: u32) -> String {
        match refine {
            0 => format!("{element} h"),
            n if n < 20 => format!("{element} h/{}", 1_u32 << n),
            n => format!("{element} h/2^{n}"),
        }
    }
}

/// The costs of one setting, and its errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    pub setting: Setting,
    pub mesh_nodes: usize,
    pub surface_nodes: usize,
    /// The solver's own estimate of its relative error, where it made one.
    pub forward_error: Option<f64>,
    pub cost: Cost,
    pub error: Errors,
}

impl Measurement {
    /// Whether its discretisation is the one that all others are compared with. Its own error is not known, so it is
    /// never chosen or recommended.
    pub fn is_reference(&self) -> bool {
        self.error.discretisation.is_some_and(|part| part.worst == 0.0)
    }

    /// Whether what its mesh adds was measured, against a finer equilibrium in at least one pose.
    pub fn is_mesh_known(&self) -> bool {
        self.error.discretisation.is_some()
    }

    /// Whether the solver can be trusted in all poses, not only in those that were measured: its own estimate of the
    /// forward error is below the limit for a warning. Other settings are measured, to show what they would cost, and
    /// never chosen or recommended.
    pub fn is_trusted(&self) -> bool {
        self.forward_error.is_none_or(|error| error <= ERROR_LIMITS[0])
            && self.setting.solver.tolerance().is_none_or(|tolerance| tolerance <= *TOLERANCE.end())
    }

    /// Whether what its storage adds is known, or is below any error that could be asked for.
    pub fn is_storage_known(&self) -> bool {
        self.error.storage.is_some() || self.setting.storage == Storage::F32.name()
    }

    pub fn can_be_chosen(&self) -> bool {
        self.is_trusted() && self.is_mesh_known() && !self.is_reference() && self.is_storage_known()
    }

    /// Error of the shape in the worst pose.
    pub fn shape(&self) -> f64 {
        self.error.uncancelled.worst
    }

    /// The larger error of force and torque in the worst pose.
    pub fn held(&self) -> f64 {
        self.error.uncancelled_held.worst
    }

    /// The largest of all: the reliability in shape, force and torque together.
    pub fn worst(&self) -> f64 {
        self.held().max(self.shape())
    }
}

/// Times are those of the program's own code, in the calmest of several runs; bytes are counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    pub offline_s: f64,
    /// Factor, matrix and columns, which live at the same time.
    pub offline_bytes: f64,
    pub file_bytes: f64,
    /// The file packed for shipping, where that was measured.
    pub packed_bytes: Option<f64>,
    /// One evaluation with every control element moved: median of the calmest stretch, and 99th percentile of all.
    pub frame_p50_s: f64,
    pub frame_p99_s: f64,
    /// Median time of a frame with one control element moved, s: the others' sums are kept.
    pub frame_one_p50_s: f64,
    /// Bytes of columns that one evaluation reads; `None` if they were not counted.
    pub frame_bytes: Option<f64>,
}

/// Relative L2 errors over the body's volume, unless said otherwise. As vector fields the parts sum to the total.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// `None` where no pose has a finer equilibrium: all that follows is then without the part of the mesh.
    pub discretisation: Option<Spread>,
    /// The discretisation error in the energy norm; `None` too for models that move the surface alone.
    pub energy: Option<Spread>,
    pub solver: Spread,
    /// `None` for models whose displacements are more than a sum of stored columns.
    pub storage: Option<Spread>,
    pub model: Spread,
    pub total: Spread,
    /// Settings are chosen by this error: the total, or the root of the sum of the parts' squares where that is larger.
    /// Parts of opposite sign may cancel in the poses that were measured; in other poses they will not.
    pub uncancelled: Spread,
    /// Largest total displacement error, m.
    pub displacement_m: Spread,
    /// Largest difference of a control element's force and torque (about where its origin has come to): solver,
    /// discretisation and model; storage has no part in forces. Relative to the largest wrench of the pose's equilibrium,
    /// max(|f|, |m|/ℓ) with the body's extent ℓ, of torques that times ℓ.
    pub force: Spread,
    pub torque: Spread,
    /// The parts that the mesh and the model have in it: the larger of force and torque of each.
    pub mesh_held: Option<Spread>,
    pub model_held: Spread,
    /// The larger of force and torque, each uncancelled in the same way.
    pub uncancelled_held: Spread,
}

/// Median and worst over the poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    pub median: f64,
    pub worst: f64,
}

/// The error of a deformation model alone, in one pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelError {
    pub model: String,
    pub pose: String,
    /// Largest local rotation of the reference solution, rad.
    pub rotation: f64,
    /// Relative L2 against the converged nonlinear solution on the same mesh.
    pub error: f64,
    pub displacement_m: f64,
}

/// Models tried on the body as a session would have it, by how far one control element turns against the others.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelTrials {
    /// Sentences about what moves and what it is compared with, and about what was left out, and why.
    pub about: Vec<String>,
    pub rows: Vec<ModelTrial>,
}

/// A model's errors for one place of the control element.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelTrial {
    pub model: String,
    pub motion: TrialMotion,
    /// Angle of the motion.
    pub degrees: f64,
    /// Root mean square of the surface nodes' errors, as a part of the distance between the control elements.
    pub displacement: f64,
    /// Largest errors of a control element's force, and of its torque over that distance, as parts of the equilibrium's largest
    /// force or torque over distance; `None` if the model has none.
    pub force: Option<f64>,
    pub torque: Option<f64>,
    /// Strain energy over that of the equilibrium.
    pub energy: Option<f64>,
    /// Median time from poses to the deformed surface with its forces.
    pub frame_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialMotion {
    Bend,
    Twist,
}

impl TrialMotion {
    pub const ALL: [TrialMotion; 2] = [TrialMotion::Bend, TrialMotion::Twist];

    /// The name in files and headings.
    pub fn name(self) -> &'static str {
        match self {
            TrialMotion::Bend => "bend",
            TrialMotion::Twist => "twist",
        }
    }
}

impl ModelTrial {
    /// The larger of the errors of force and torque.
    pub fn held(&self) -> Option<f64> {
        self.force.zip(self.torque).map(|(force, torque)| force.max(torque))
    }
}

/// The error of one element on one refinement in the smooth problem.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SmoothError {
    pub element: String,
    pub refine: u32,
    /// Cube root of the mean volume of a tetrahedron, m.
    pub h: f64,
    pub l2: f64,
    pub energy: f64,
    /// Slopes fitted over all refinements of this element, and what the theory promises.
    pub l2_rate: Option<f64>,
    pub energy_rate: Option<f64>,
    pub promised: [f64; 2],
}

impl EffectCost {
    pub fn is_free(&self) -> bool {
        [self.offline_s, self.file_bytes, self.memory_bytes, self.frame_s].iter().all(|cost| *cost == 0.0)
    }
}

/// The cost that an effect adds to a body without it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectCost {
    pub effect: String,
    pub listed: bool,
    pub offline_s: f64,
    pub file_bytes: f64,
    pub memory_bytes: f64,
    pub frame_s: f64,
}

/// A choice that can be made for a body.
pub struct Parameter {
    /// Heads its column in tables.
    pub name: &'static str,
    pub value: fn(&Setting) -> String,
    /// The part of the error that it makes.
    pub part: &'static str,
    /// `None` where it was not measured.
    pub error: fn(&Errors) -> Option<Spread>,
}

pub const MESH: Parameter = Parameter {
    name: "mesh and element",
    value: Setting::mesh,
    part: "discretisation",
    error: |error| error.discretisation,
};
pub const SOLVER: Parameter = Parameter {
    name: "solver",
    value: |setting| setting.solver.to_string(),
    part: "solver",
    error: |error| Some(error.solver),
};
pub const STORAGE: Parameter = Parameter {
    name: "storage",
    value: |setting| setting.storage.clone(),
    part: "storage",
    error: |error| error.storage,
};
pub const MODEL: Parameter = Parameter {
    name: "model",
    value: |setting| setting.model.name.to_owned(),
    part: "model",
    error: |error| Some(error.model),
};

/// The parts of the error are independent: each entry can be changed alone.
pub const PARAMETERS: [Parameter; 4] = [MESH, SOLVER, STORAGE, MODEL];

impl Setting {
    /// The value of each of [`PARAMETERS`].
    pub fn values(&self) -> [String; PARAMETERS.len()] {
        PARAMETERS.map(|parameter| (parameter.value)(self))
    }
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.values().join(" · "))
    }
}

impl Errors {
    /// The part that each of [`PARAMETERS`] makes.
    pub fn parts(&self) -> [Option<Spread>; PARAMETERS.len()] {
        PARAMETERS.map(|parameter| (parameter.error)(self))
    }

    /// Index into [`PARAMETERS`] of the one whose part has the largest median. `None` where all are zero.
    pub fn dominating(&self) -> Option<usize> {
        let medians = self.parts().map(|part| part.map_or(0.0, |part| part.median));
        (0..medians.len()).filter(|&i| medians[i] > 0.0).max_by(|&a, &b| medians[a].total_cmp(&medians[b]))
    }

    /// Name of the largest part.
    pub fn largest_part(&self) -> &'static str {
        self.dominating().map_or("none", |i| PARAMETERS[i].part)
    }
}
