//! Helpers of the hard cases: how a body is asked for, judged, solved and measured, and the row that comes of it.

use crate::base::diagnostic::{Diagnostic, Severity};
use crate::green::{self, GreenError, Requirements, STIFFNESS, Solution};
use crate::mesh::{Block, LoadedMesh, TetMesh, block};
use crate::scene::{Scene, SceneError};
use crate::solve::Silent;
use serde::Serialize;
use std::path::Path;

/// The outcome of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    Solved,
    Warned,
    Refused,
}

/// One case and its outcome.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseRow {
    /// The case's number in the manual's chapter `cases`.
    pub number: u32,
    pub case: String,
    pub required: Outcome,
    pub outcome: Outcome,
    /// Words that the message must contain, and the message.
    pub words: &'static str,
    pub said: String,
    /// The measured quantity, its relative error and the largest that is allowed; `None` if the case is refused.
    pub measured: &'static str,
    pub error: Option<f64>,
    pub bound: Option<f64>,
}

impl CaseRow {
    /// Whether the outcome is the required one, in the required words, and the error within its bound. NaN is not.
    pub fn holds(&self) -> bool {
        let within = match (self.error, self.bound) {
            (Some(error), Some(bound)) => error <= bound,
            (error, bound) => error.is_none() && bound.is_none(),
        };
        self.outcome == self.required && self.said.contains(self.words) && within
    }
}

pub type CaseRows = Result<Vec<CaseRow>, GreenError>;

pub const ENDS: &str = r#"
[body.b.control.low]
nodes = { group = "zmin" }
grab = "fixed"
[body.b.control.high]
nodes = { group = "zmax" }
grab = "dragger"
"#;

/// The mesh of the base case.
pub fn base() -> Result<TetMesh, GreenError> {
    cells([1.0, 1.0, 2.0], [5, 5, 10])
}

pub fn cells(size: [f64; 3], cells: [u32; 3]) -> Result<TetMesh, GreenError> {
    block(&Block { size, cells }).map_err(|source| {
        let (path, entity) = (Path::new("hard-cases.toml").to_owned(), "body.b.generate".into());
        SceneError::Generate { path, line: None, entity, source }.into()
    })
}

/// A body to be judged and solved.
pub struct Asked {
    pub mesh: LoadedMesh,
    /// TOML beside the mesh; without a material there, that of the base case.
    pub extra: String,
    /// TOML of the control elements.
    pub controls: String,
}

impl Asked {
    /// `mesh` of the base case's material, held at its ends.
    pub fn new(mesh: TetMesh) -> Asked {
        Asked { mesh: LoadedMesh { mesh, notices: Vec::new() }, extra: String::new(), controls: ENDS.into() }
    }

    pub fn with(self, extra: impl Into<String>) -> Asked {
        Asked { extra: extra.into(), ..self }
    }

    pub fn scene(&self) -> Result<Scene, SceneError> {
        let material = match self.extra.contains("material") {
            true => "",
            false => "material = { young = 1.0e6, poisson = 0.3 }\n",
        };
        let text = format!("[body.b]\nmesh = \"body.msh\"\n{material}{}{}", self.extra, self.controls);
        Scene::parse(&text, Path::new("hard-cases.toml"))
    }

    pub fn solve(&self) -> Result<Solution, GreenError> {
        self.judge_and_solve().map(|(_, solution)| solution)
    }

    pub fn judge_and_solve(&self) -> Result<(Vec<Diagnostic>, Solution), GreenError> {
        let scene = self.scene()?;
        let prepared = green::prepare_mesh(&scene, "b", self.mesh.clone())?;
        let solution =
            green::solve_prepared(&scene, "b", prepared, &Requirements::new(&[STIFFNESS]), &Silent)?;
        Ok((solution.notices.clone(), solution))
    }
}

/// The required outcome of a case.
pub struct Must {
    pub outcome: Outcome,
    pub words: &'static str,
    pub measured: &'static str,
    pub bound: f64,
}

impl Must {
    pub const fn solve(measured: &'static str, bound: f64) -> Must {
        Must { outcome: Outcome::Solved, words: "", measured, bound }
    }

    pub const fn warn(words: &'static str, measured: &'static str, bound: f64) -> Must {
        Must { outcome: Outcome::Warned, words, measured, bound }
    }
}

/// Judges and solves a body that must not be refused, and measures its solution.
pub fn solved(
    number: u32,
    case: impl Into<String>,
    must: Must,
    asked: &Asked,
    measure: impl FnOnce(&Solution) -> Result<f64, GreenError>,
) -> Result<CaseRow, GreenError> {
    let Must { outcome: required, words, measured, bound } = must;
    let row = |outcome, said, error| CaseRow {
        number,
        case: case.into(),
        required,
        outcome,
        words,
        said,
        measured,
        error,
        bound: Some(bound),
    };
    let (findings, solution) = match asked.judge_and_solve() {
        Ok(done) => done,
        Err(error) => return Ok(row(Outcome::Refused, error.to_string(), None)),
    };
    let warning = |finding: &&Diagnostic| finding.severity == Severity::Warning;
    let outcome =
        if findings.iter().any(|finding| warning(&finding)) { Outcome::Warned } else { Outcome::Solved };
    // The sentence that is asked for, be it a note; else the first warning.
    let asked_for = findings.iter().find(|finding| !words.is_empty() && finding.message.contains(words));
    let said =
        asked_for.or(findings.iter().find(warning)).map_or(String::new(), |finding| finding.message.clone());
    Ok(row(outcome, said, Some(measure(&solution)?)))
}

/// Judges a body that must be refused, in these words.
pub fn refused(number: u32, case: impl Into<String>, words: &'static str, asked: &Asked) -> CaseRow {
    verdict(number, case, words, asked.solve().err().map(|error| error.to_string()))
}

/// The row of a case that must be refused: `said` is the refusal, if there was one.
pub fn verdict(number: u32, case: impl Into<String>, words: &'static str, said: Option<String>) -> CaseRow {
    let outcome = if said.is_some() { Outcome::Refused } else { Outcome::Solved };
    CaseRow {
        number,
        case: case.into(),
        required: Outcome::Refused,
        outcome,
        words,
        said: said.unwrap_or_default(),
        measured: "",
        error: None,
        bound: None,
    }
}

/// Worst relative difference of two solutions' fields, column by column, each against its own norm. Column c of `a` is
/// multiplied by `scale(c)`.
pub fn difference(a: &Solution, b: &Solution, scale: impl Fn(usize) -> f64) -> f64 {
    if (a.fields.columns, a.fields.nodes) != (b.fields.columns, b.fields.nodes) {
        return f64::NAN;
    }
    let rows = 3 * a.mesh.nodes.len();
    let of_column = |c: usize| {
        let pairs = (0..rows).map(|row| (a.fields.row(row)[c] * scale(c), b.fields.row(row)[c]));
        let (error, norm) =
            pairs.fold((0.0, 0.0), |(error, norm), (a, b)| (error + (a - b).powi(2), norm + b * b));
        if norm == 0.0 { error } else { (error / norm).sqrt() }
    };
    largest((0..a.fields.columns).map(of_column))
}

/// The largest value; NaN where one of them is NaN or where there are none, since nothing was measured then.
pub fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.reduce(|most, value| if value > most || value.is_nan() { value } else { most }).unwrap_or(f64::NAN)
}

/// The solver's worst relative residual.
pub fn residual(solution: &Solution) -> Result<f64, GreenError> {
    Ok(solution.stats.worst_residual())
}

/// Relative difference of two handle stiffnesses.
pub fn stiffness_difference(a: &Solution, b: &Solution) -> f64 {
    match (a.stiffness(), b.stiffness()) {
        (Some(a), Some(b)) if a.shape() == b.shape() => (a - b).amax() / b.amax(),
        _ => f64::NAN,
    }
}
