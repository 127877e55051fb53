//! What accuracy costs in time: a body computed with every setting of every knob, each with its costs and its error.
//!
//! In: a scene's body and a set of poses. Out: a [`Report`], written as JSON, CSV, work-precision plots (SVG) and one
//! self-contained page (HTML).

pub mod measure;
pub mod plan;

pub use measure::{Limits, MeasureError, Request, measure};

mod answer;
mod axis;
mod csv;
mod digest;
mod files;
mod labels;
mod markup;
mod page;
mod panels;
mod pareto;
mod plot;
mod says;
mod smooth_panels;
mod split;
mod summary;
pub mod table;
mod tables;
mod units;

pub use answer::{CURRENCIES, Currency, FILE, OFFLINE, ONLINE, answers, cheapest, ladder};
pub use digest::digest;
pub use files::{ReportError, read, try_folder, write};
pub use page::page;
pub use panels::panels;
pub use plot::Picture;
pub use summary::summary;

use crate::scene::TOLERANCE;
use crate::solve::ERROR_LIMITS;
use crate::solve::Solver;
use serde::{Deserialize, Serialize};

/// Version of accuracy.json; the manual's chapter `accuracy` describes it.
pub const SCHEMA: u32 = 2;

/// All that was measured of one body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    pub schema: u32,
    pub program: String,
    /// Processor, cores, and how noisy it was: the spread of one and the same task.
    pub machine: String,
    pub scene: String,
    /// The command that writes this report again.
    pub command: String,
    pub body: String,
    /// What the body is: mesh, material, control elements; one sentence each.
    pub about: Vec<String>,
    /// Largest extent of the body, m.
    pub size: f64,
    /// What the errors are taken against, one sentence for each part.
    pub references: Vec<String>,
    /// Names of the poses, in their order, and where they come from.
    pub poses: Vec<String>,
    pub pose_source: String,
    pub quick: bool,
    pub rows: Vec<Row>,
    /// Errors of the models alone, by the largest local rotation of the pose.
    pub models: Vec<ModelError>,
    /// The smooth problem on the body's own mesh: what the theory promises there is tested.
    pub smooth: Vec<SmoothRow>,
    /// What effects cost, those that the scene does not list too.
    pub effects: Vec<EffectCost>,
}

/// One setting of every knob.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Setting {
    /// Uniform refinements of the scene's mesh.
    pub refine: u32,
    /// As scenes name them.
    pub element: String,
    /// In files "cholesky", or "pcg 1e-6" with its tolerance.
    #[serde(with = "crate::solve::solver_as_text")]
    pub solver: Solver,
    pub storage: String,
    pub model: String,
}

impl Setting {
    /// "tet10 h/2": the element on the scene's mesh, refined once.
    pub fn mesh(&self) -> String {
        match self.refine {
            0 => format!("{} h", self.element),
            n if n < 20 => format!("{} h/{}", self.element, 1_u32 << n),
            n => format!("{} h/2^{n}", self.element),
        }
    }

    /// Its knobs in words, in the order of [`KNOBS`].
    pub fn knobs(&self) -> [String; 4] {
        [self.mesh(), self.solver.to_string(), self.storage.clone(), self.model.clone()]
    }
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.knobs().join(" · "))
    }
}

/// What can be chosen, and which part of the error each choice makes.
pub const KNOBS: [&str; 4] = ["mesh and element", "solver", "storage", "model"];
pub const PARTS: [&str; 4] = ["discretisation", "solver", "storage", "model"];

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub setting: Setting,
    pub mesh_nodes: usize,
    pub surface_nodes: usize,
    /// The solver's own estimate of its relative error, where it made one.
    pub forward_error: Option<f64>,
    pub cost: Cost,
    pub error: Errors,
}

impl Row {
    /// Whether its discretisation is the one that all are measured against: its own error is not known, and it is never
    /// chosen or recommended.
    pub fn is_reference(&self) -> bool {
        self.error.discretisation.worst == 0.0
    }

    /// Whether its solver is accurate for certain, not in the measured poses alone: its estimate of its forward error is
    /// none to warn of. Other rows are measured, to show what they would cost, and never chosen or recommended.
    pub fn is_trusted(&self) -> bool {
        self.forward_error.is_none_or(|error| error <= ERROR_LIMITS[0])
            && self.setting.solver.tolerance().is_none_or(|tolerance| tolerance <= *TOLERANCE.end())
    }

    pub fn can_be_chosen(&self) -> bool {
        self.is_trusted() && !self.is_reference()
    }
}

/// Times are medians of what the program itself ran; bytes are counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    pub offline_s: f64,
    /// Factor, matrix and columns, which live at the same time.
    pub offline_bytes: f64,
    pub file_bytes: f64,
    /// The file packed for shipping.
    pub packed_bytes: f64,
    /// One evaluation with every control element moved: median and 99th percentile.
    pub frame_p50_s: f64,
    pub frame_p99_s: f64,
    /// The same with one control element moved: the others' sums are kept.
    pub frame_one_p50_s: f64,
    /// Bytes of columns that one evaluation reads.
    pub frame_bytes: f64,
}

/// Relative L2 over the body's volume, unless said otherwise; the parts' vector sum is the total.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    pub discretisation: Spread,
    /// The same in the energy norm.
    pub energy: Spread,
    pub solver: Spread,
    pub storage: Spread,
    pub model: Spread,
    pub total: Spread,
    /// What settings are chosen by: the total, or the root of the sum of the parts' squares where that is larger. In the
    /// poses that were measured parts of opposite sign may cancel; in others they will not.
    pub uncancelled: Spread,
    /// Largest total displacement error, m.
    pub displacement_m: Spread,
    /// Largest difference of a control element's force and torque (about where its origin has come to): solver,
    /// discretisation and model; storage has no part in forces. Relative to the largest wrench of the pose's equilibrium,
    /// max(|f|, |m|/ℓ) with the body's extent ℓ, of torques that times ℓ.
    pub force: Option<Spread>,
    pub torque: Option<Spread>,
    /// The larger of force and torque, each uncancelled in the same way.
    pub uncancelled_held: Option<Spread>,
}

impl Errors {
    /// Those of [`PARTS`], in that order.
    pub fn parts(&self) -> [Spread; 4] {
        [self.discretisation, self.solver, self.storage, self.model]
    }

    /// Index into [`PARTS`] of the largest median: the knob that limits. `None` where all are zero.
    pub fn dominating(&self) -> Option<usize> {
        let medians = self.parts().map(|part| part.median);
        (0..4).filter(|&i| medians[i] > 0.0).max_by(|&a, &b| medians[a].total_cmp(&medians[b]))
    }
}

/// Over the poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    pub median: f64,
    pub worst: f64,
}

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

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SmoothRow {
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

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectCost {
    pub effect: String,
    pub listed: bool,
    pub offline_s: f64,
    pub file_bytes: f64,
    pub memory_bytes: f64,
    pub frame_s: f64,
}
