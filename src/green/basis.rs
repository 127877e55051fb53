//! From a scene's body to its Green's functions: assembly, partition, factorization, solves, surface rows.

use super::control::{ControlElement, FIELDS};
use super::error::GreenError;
use super::finding::Finding;
use super::judge;
use super::needs::Needs;
use super::prepare::Prepared;
use super::rigid::RigidMotion;
use crate::base::machine;
use crate::fem::{Element, NodeFields, Partition, StiffnessMatrix};
use crate::mesh::diagnostics::Severity;
use crate::mesh::{Surface, TetMesh};
use crate::scene::{Scene, Storage};
use crate::solve::{Progress, SolveStats};
use nalgebra::DMatrix;
use std::time::Instant;

/// Wall time of the steps outside the solver, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct StepTimes {
    pub mesh_s: f64,
    pub assembly_s: f64,
    pub stiffness_s: f64,
}

/// The full f64 solution of one body: every basis field over every node.
#[derive(Clone)]
pub struct Solution {
    pub element: &'static Element,
    pub mesh: TetMesh,
    pub surface: Surface,
    pub controls: Vec<ControlElement>,
    /// Column 12 e + k is u⁽ᵏ⁾ of control element e over all nodes, its own nodes included.
    pub fields: NodeFields,
    /// S, N/m and N and N·m by the fields' units; only where it is needed.
    pub stiffness: Option<DMatrix<f64>>,
    /// max |R - Rᵀ| / max |R| of the reactions' work R = Φᵀ f_b: Betti's reciprocity as the solver kept it.
    pub asymmetry: Option<f64>,
    pub rigid: RigidMotion,
    pub stats: SolveStats,
    pub times: StepTimes,
    /// Scalar entries of K.
    pub matrix_entries: usize,
    /// Warnings and notes of the check before it, and of the judgement after it.
    pub notices: Vec<Finding>,
}

impl Solution {
    /// Time of the whole offline stage of the body, s.
    pub fn offline_s(&self) -> f64 {
        let (times, stats) = (&self.times, &self.stats);
        let conditioning = stats.conditioning.map_or(0.0, |conditioning| conditioning.seconds);
        times.mesh_s
            + times.assembly_s
            + times.stiffness_s
            + stats.ordering_s
            + stats.symbolic_s
            + stats.factor_s
            + stats.solve_s
            + conditioning
    }
}

/// What goes into the .green file for one body.
pub struct Precomputed {
    pub name: String,
    pub storage: Storage,
    pub fingerprint: String,
    pub needs: Needs,
    /// What its knobs were chosen from; kept in the file.
    pub plan: Option<serde_json::Value>,
    pub solution: Solution,
}

/// Precomputes body `name` of the scene.
pub fn precompute(
    scene: &Scene,
    name: &str,
    needs: Needs,
    progress: &dyn Progress,
) -> Result<Precomputed, GreenError> {
    // Taken first: what changes while the body is solved makes the file stale, not silently wrong.
    let fingerprint = super::fingerprint(scene, name, needs)?;
    let solution = solve(scene, name, needs, progress)?;
    Ok(Precomputed {
        name: name.to_owned(),
        storage: scene.body[name].storage,
        fingerprint,
        needs,
        plan: scene.body[name].plan.clone(),
        solution,
    })
}

/// Solves all basis fields of body `name` over all nodes, in f64.
pub fn solve(
    scene: &Scene,
    name: &str,
    needs: Needs,
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    progress.begin("mesh", 0);
    let started = Instant::now();
    let prepared = super::prepare(scene, name)?;
    let mesh_s = started.elapsed().as_secs_f64();
    progress.end();
    let mut solution = solve_prepared(scene, name, prepared, needs, progress)?;
    solution.times.mesh_s += mesh_s;
    Ok(solution)
}

/// [`solve`] of a body that was prepared, as it is in `prepared`.
pub fn solve_prepared(
    scene: &Scene,
    name: &str,
    prepared: Prepared,
    needs: Needs,
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    let body = &scene.body[name];
    let place = format!("{}: body.{name}", scene.path.display());
    let started = Instant::now();
    let Prepared { mesh, controls, lame, findings: mut notices } = prepared;
    refuse(scene, &notices)?;
    let surface = Surface::of(&mesh);
    let mut times = StepTimes { mesh_s: started.elapsed().as_secs_f64(), ..Default::default() };

    let memory = |source| GreenError::Memory { body: place.clone(), source };
    let need = assembly_memory(body.element, &mesh, &surface, FIELDS * controls.len());
    machine::expect("the stiffness matrix with the columns", need).map_err(memory)?;
    progress.begin("assembly", 0);
    let started = Instant::now();
    let unfit = |source| GreenError::Assembly { body: place.clone(), source };
    let k = body.element.assemble(&mesh, &lame).map_err(unfit)?;
    let partition = Partition::new(mesh.nodes.len(), controls.iter().flat_map(|c| c.nodes.iter().copied()));
    let a = partition.a(&k);
    times.assembly_s = started.elapsed().as_secs_f64();
    progress.end();

    let mut fields = NodeFields::zeros(mesh.nodes.len(), FIELDS * controls.len());
    for (e, control) in controls.iter().enumerate() {
        control.prescribe(&mesh.nodes, FIELDS * e, &mut fields);
    }
    let rhs = partition.minus_b_times(&k, &fields);
    let solve_free = || {
        let solver = body.solver.analyse(&a, progress)?;
        solver.fits(&a, rhs.columns)?;
        solver.factor(&a, progress)?.solve_and_judge(&rhs, progress)
    };
    let (free, stats) = solve_free().map_err(|source| GreenError::Solve { body: place.clone(), source })?;
    partition.insert_free(&free, &mut fields);

    let (mut stiffness, mut asymmetry) = (None, None);
    if needs.stiffness {
        progress.begin("handle stiffness", 0);
        let started = Instant::now();
        // S_ij = a(u⁽ⁱ⁾, u⁽ʲ⁾), the generalised force on field i for a unit of field j. It equals the reactions' work Φᵀ f_b
        // with f_b = Bᵀ u + C b, but where a held part is stiff, f_b is left over of sums that are larger by its contrast;
        // strains of a rigid motion are 0 there.
        stiffness = Some(body.element.energies(&mesh, &lame, &fields).map_err(unfit)?);
        asymmetry = Some(reciprocity(&k, &partition, &fields));
        times.stiffness_s = started.elapsed().as_secs_f64();
        progress.end();
    }
    let rigid = RigidMotion::of(&mesh, &controls, &fields, stiffness.as_ref());
    let judged = judge::judge(&format!("body.{name}"), &stats, &rigid)
        .map_err(|source| GreenError::Solve { body: place.clone(), source })?;
    notices.extend(judged);
    notices.sort_by_key(|finding| finding.severity);
    let matrix_entries = k.scalar_entries();
    Ok(Solution {
        element: body.element,
        mesh,
        surface,
        controls,
        fields,
        stiffness,
        asymmetry,
        rigid,
        stats,
        times,
        matrix_entries,
        notices,
    })
}

/// Bytes that assembly takes at its peak, with the prescribed columns and the right-hand sides: 184 for each pair of
/// nodes that have an element in common, in K and A or in K and its rows, 170 for each tetrahedron, 400 for each node.
///
/// With V nodes at corners, T tetrahedra and B triangles of the surface there are F = 2 T + B/2 faces and, by Euler's
/// formula for one piece without holes, V + F - T - 1 edges. Nodes between the corners make three pairs on an edge, six
/// more on a face and three more inside ([`Element::pairs`]).
fn assembly_memory(element: &Element, mesh: &TetMesh, surface: &Surface, columns: usize) -> f64 {
    let (nodes, tets) = (mesh.nodes.len() as f64, mesh.tets.len() as f64);
    // Of a curved triangle, the mesh's surface has four.
    let triangles = surface.triangles.len() as f64;
    let (corners, triangles) = match element.order {
        1 => (nodes, triangles),
        _ => (nodes / 8.0, triangles / 4.0),
    };
    let faces = 2.0 * tets + 0.5 * triangles;
    let edges = corners + faces - tets;
    let [on_edge, on_face, inside] = element.pairs;
    let pairs = on_edge * edges + on_face * faces + inside * tets;
    184.0 * pairs + 170.0 * tets + 400.0 * nodes + 2.0 * 24.0 * nodes * columns as f64
}

/// How far the reactions' work Φᵀ f_b is from symmetric, relative to its largest number.
fn reciprocity(k: &StiffnessMatrix, partition: &Partition, fields: &NodeFields) -> f64 {
    let reaction = partition.reaction(k, fields);
    let m = fields.columns;
    let mut work = DMatrix::<f64>::zeros(m, m);
    for (row, &node) in partition.controlled.iter().enumerate() {
        for axis in 0..3 {
            // On controlled nodes the fields are what was prescribed, Φ.
            let phi = fields.row(3 * node as usize + axis);
            let force = reaction.row(3 * row + axis);
            for (i, phi) in phi.iter().enumerate().filter(|(_, phi)| **phi != 0.0) {
                for (j, force) in force.iter().enumerate() {
                    work[(i, j)] += phi * force;
                }
            }
        }
    }
    let difference = (&work - work.transpose()).amax();
    if difference == 0.0 { 0.0 } else { difference / work.amax() }
}

/// The first error among the findings, if there is one.
pub fn refuse(scene: &Scene, findings: &[Finding]) -> Result<(), GreenError> {
    let mut errors = findings.iter().filter(|finding| finding.severity == Severity::Error);
    let Some(first) = errors.next() else { return Ok(()) };
    let more = match errors.count() {
        0 => String::new(),
        count => format!(" ({count} more: `greenstage check {}`)", scene.path.display()),
    };
    Err(scene.invalid(&first.entity, format!("{}{more}", first.message)).into())
}
