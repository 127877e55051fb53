//! Results for one body: its f64 solution, and the part of it that goes into the .green file.

use super::bytes::Tensor;
use super::compressed::{Block, Compressed};
use super::control::ControlElement;
use super::file::LoadMeta;
use super::requirements::{Family, Requirements};
use super::rigid::RigidMotion;
use crate::base::columns::Storage;
use crate::base::diagnostic::Diagnostic;
use crate::fem::{Element, NodeFields};
use crate::mesh::{Surface, TetMesh};
use crate::scene::Method;
use crate::solve::{KeptFactor, SolveStats};
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Wall time of the steps outside the solver, s.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepTimes {
    pub mesh_s: f64,
    pub assembly_s: f64,
    /// Time of each family that is made from the solved fields, by its name; part of some is spent in the solver.
    pub families_s: BTreeMap<String, f64>,
}

impl StepTimes {
    /// Time of a family, s; 0 where it was not made.
    pub fn family_s(&self, family: Family) -> f64 {
        self.families_s.get(family.name).copied().unwrap_or(0.0)
    }
}

/// The full f64 solution of one body: every basis field over every node.
#[derive(Clone)]
pub struct Solution {
    pub element: &'static Element,
    /// Method of the solution; with boundary elements, the element means nothing.
    pub method: Method,
    pub mesh: TetMesh,
    pub surface: Surface,
    pub controls: Vec<ControlElement>,
    /// Column 12 e + k is u⁽ᵏ⁾ of control element e over all nodes, its own nodes included.
    pub fields: NodeFields,
    /// Tables of the other families, by family: a column of the matrix for each of their columns.
    pub tables: BTreeMap<&'static str, DMatrix<f64>>,
    /// Loads of the columns of the family `loads`.
    pub loads: Vec<LoadMeta>,
    /// Compliance of the surface, where it was required.
    pub compliance: Option<SurfaceInverse>,
    pub kept_factor: Option<SurfaceFactor>,
    pub compressed: Option<SurfaceCompressed>,
    /// max |R - Rᵀ| / max |R| of the reactions' work R = Φᵀ f_b: Betti's reciprocity as the solver kept it.
    pub asymmetry: Option<f64>,
    pub rigid: RigidMotion,
    pub stats: SolveStats,
    pub times: StepTimes,
    /// Scalar entries of K.
    pub matrix_entries: usize,
    /// Warnings and notes of the check before it, and of the judgement after it.
    pub notices: Vec<Diagnostic>,
}

impl Solution {
    /// Name of the element or method in .green files.
    pub fn element_name(&self) -> &'static str {
        match self.method {
            Method::Fem => self.element.name,
            Method::Bem => self.method.name(),
        }
    }

    /// Time of the whole offline stage of the body, s.
    pub fn offline_s(&self) -> f64 {
        let (times, stats) = (&self.times, &self.stats);
        let conditioning = stats.conditioning.map_or(0.0, |conditioning| conditioning.seconds);
        times.mesh_s
            + times.assembly_s
            + times.families_s.values().sum::<f64>()
            + stats.ordering_s
            + stats.symbolic_s
            + stats.factor_s
            + stats.solve_s
            + conditioning
    }
}

/// The compliance of the surface, as the family `compliance` lays it out.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceInverse {
    /// Number of nodes that take forces.
    pub nodes: usize,
    /// Indices into the surface's nodes.
    pub order: Vec<u32>,
    /// f32, little-endian.
    pub bytes: Vec<u8>,
}

/// The factor from which the compliance of the surface follows, as the family `kept_factor` has it.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceFactor {
    /// Number of nodes that take forces.
    pub nodes: usize,
    /// Indices into the surface's nodes.
    pub order: Vec<u32>,
    pub kept: KeptFactor,
}

/// The compliance of the surface within an error, as the family `compressed` has it.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceCompressed {
    /// Number of nodes that take forces.
    pub nodes: usize,
    /// Indices into the surface's nodes.
    pub order: Vec<u32>,
    pub blocks: Vec<Block>,
    /// The error that was asked for.
    pub asked: f64,
    pub compressed: Compressed,
}

/// The contents of the .green file for one body.
pub struct Precomputed {
    pub name: String,
    pub storage: Storage,
    pub fingerprint: String,
    pub requirements: Requirements,
    /// Measurements from which its settings were chosen; kept in the file.
    pub plan: Option<serde_json::Value>,
    pub solution: Solution,
    /// Tensors of effects that own some, by `EFFECT/TENSOR`.
    pub sections: BTreeMap<String, Tensor>,
}

impl Precomputed {
    /// A solution to be written with these families, and no more.
    pub fn from_solution(
        name: &str,
        storage: Storage,
        requirements: Requirements,
        solution: Solution,
    ) -> Precomputed {
        let (fingerprint, sections) = (String::new(), BTreeMap::new());
        Precomputed {
            name: name.to_owned(),
            storage,
            fingerprint,
            requirements,
            plan: None,
            solution,
            sections,
        }
    }
}
