//! A solved body as bytes, to be taken over by a later run: the solution, without the mesh, which is made again.

use super::candidate::Candidate;
use crate::deform::ModelEntry;
use crate::fem::NodeFields;
use crate::green::{
    self, CUBIC, QUARTIC, RADIUS, REDUCED_FIELDS, RigidMotion, SERIES, STIFFNESS, Solution, StepTimes,
    substructure,
};
use crate::mesh::Surface;
use crate::scene::Scene;
use crate::solve::{Conditioning, NO_UNKNOWNS, SolveStats};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The tables that a solution may hold.
fn known_tables() -> impl Iterator<Item = &'static str> {
    let own = [STIFFNESS.name, CUBIC.name, QUARTIC, REDUCED_FIELDS, SERIES, RADIUS];
    own.into_iter().chain(substructure::TABLES)
}

/// All but the numbers.
#[derive(Serialize, Deserialize)]
struct Head {
    columns: usize,
    /// Name, rows, columns.
    tables: Vec<(String, usize, usize)>,
    asymmetry: Option<f64>,
    rigid: RigidMotion,
    times: StepTimes,
    matrix_entries: usize,
    is_without_unknowns: bool,
    unknowns: usize,
    solved_columns: usize,
    factor_entries: usize,
    iterations: usize,
    residuals: Vec<f64>,
    conditioning: Option<Conditioning>,
    seconds: [f64; 4],
}

/// `None` where a table is not known here.
pub fn write(candidate: &Candidate) -> Option<Vec<u8>> {
    let Solution { fields, tables, stats, .. } = &candidate.solution;
    if tables.keys().any(|name| !known_tables().any(|known| known == *name)) {
        return None;
    }
    let head = Head {
        columns: fields.columns,
        tables: tables
            .iter()
            .map(|(name, table)| ((*name).to_owned(), table.nrows(), table.ncols()))
            .collect(),
        asymmetry: candidate.solution.asymmetry,
        rigid: candidate.solution.rigid,
        times: candidate.solution.times.clone(),
        matrix_entries: candidate.solution.matrix_entries,
        is_without_unknowns: stats.method.name == NO_UNKNOWNS.name,
        unknowns: stats.unknowns,
        solved_columns: stats.columns,
        factor_entries: stats.factor_entries,
        iterations: stats.iterations,
        residuals: stats.residuals.clone(),
        conditioning: stats.conditioning,
        seconds: [stats.ordering_s, stats.symbolic_s, stats.factor_s, stats.solve_s],
    };
    let head = serde_json::to_vec(&head).ok()?;
    let mut bytes = (head.len() as u64).to_le_bytes().to_vec();
    bytes.extend(head);
    let numbers = fields.data.iter().chain(tables.values().flat_map(|table| table.iter()));
    bytes.extend(numbers.flat_map(|number| number.to_le_bytes()));
    Some(bytes)
}

/// `None` where the bytes are not of this body.
pub fn read(scene: &Scene, body: &str, models: &[&'static ModelEntry], bytes: &[u8]) -> Option<Candidate> {
    let (length, rest) = bytes.split_at_checked(8)?;
    let length = usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?;
    let (head, rest) = rest.split_at_checked(length)?;
    let head: Head = serde_json::from_slice(head).ok()?;
    let prepared = green::prepare(scene, body).ok()?;
    let nodes = prepared.mesh.nodes.len();
    let mut numbers =
        rest.chunks_exact(8).map(|number| f64::from_le_bytes(number.try_into().unwrap_or_default()));
    let mut take = |count: usize| -> Option<Vec<f64>> {
        let taken: Vec<f64> = numbers.by_ref().take(count).collect();
        (taken.len() == count).then_some(taken)
    };
    let fields = NodeFields { nodes, columns: head.columns, data: take(3 * nodes * head.columns)? };
    let mut tables = BTreeMap::new();
    for (name, rows, columns) in &head.tables {
        let name = known_tables().find(|known| known == name)?;
        tables.insert(name, DMatrix::from_vec(*rows, *columns, take(rows * columns)?));
    }
    if take(1).is_some() {
        return None;
    }
    let own = &scene.body[body];
    let [ordering_s, symbolic_s, factor_s, solve_s] = head.seconds;
    let stats = SolveStats {
        method: if head.is_without_unknowns { &NO_UNKNOWNS } else { own.solver.method },
        chosen: None,
        unknowns: head.unknowns,
        columns: head.solved_columns,
        ordering_s,
        symbolic_s,
        factor_s,
        solve_s,
        factor_entries: head.factor_entries,
        iterations: head.iterations,
        residuals: head.residuals,
        conditioning: head.conditioning,
    };
    let solution = Solution {
        element: own.element,
        method: own.method,
        surface: Surface::of(&prepared.mesh),
        mesh: prepared.mesh,
        controls: prepared.controls,
        fields,
        tables,
        loads: Vec::new(),
        compliance: None,
        kept_factor: None,
        compressed: None,
        asymmetry: head.asymmetry,
        rigid: head.rigid,
        stats,
        times: head.times,
        matrix_entries: head.matrix_entries,
        notices: Vec::new(),
    };
    Some(Candidate { refine: 0, element: own.element, solver: own.solver, models: models.to_vec(), solution })
}
