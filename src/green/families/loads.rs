//! The family `loads`: what body loads and force patterns do to a body whose control elements are held.
//!
//! In: consistent nodal forces F of a scene's loads, a column each (three of gravity and of a shift). Out: `loads/basis`, the
//! columns G = A⁻¹F on the surface, and what the forces on control elements need of them, F taken over all nodes:
//!
//! ```text
//! loads/reaction    UᵀF      12 E × K      U: the affine fields; by reciprocity their reaction is -UᵀF λ
//! loads/compliance  FᵀG       K × K
//! loads/moments     Σ f, Σ f Xᵀ row by row              12 × K, X about the file's centre
//! loads/torques     Σ u × f for u of U, then of G       3 (12 E + K) × K
//! ```
//!
//! The last two are 0 of warmth, whose forces do no work where the body turns as a whole.

use super::super::bytes::Tensor;
use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::{Assembled, ColumnName, ColumnSource, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile, LoadMeta, Turning};
use super::super::numbers::numbers;
use super::super::prepare::densities_of_tets;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::affine::AFFINE;
use super::columns::{self, Names};
use super::table;
use super::tractions::Tractions;
use crate::base::columns::{ColumnGroup, Storage, StoredColumns};
use crate::base::extent::bounding_box;
use crate::fem::{NodeFields, body_force, expansion};
use crate::mesh::TetMesh;
use crate::scene::{Centrifugal, LoadEntry, LoadKind, LoadSource, Scene};
use crate::solve::Progress;
use nalgebra::{DMatrix, Vector3};

pub const LOADS: Family = Family { name: "loads", from: &[AFFINE] };

/// G over all nodes, in [`Solution::tables`].
pub const LOAD_FIELDS: &str = "loads/fields";
/// F over all nodes, there too.
pub const LOAD_FORCES: &str = "loads/forces";
pub const REACTION: &str = "loads/reaction";
pub const LOAD_COMPLIANCE: &str = "loads/compliance";
pub const MOMENTS: &str = "loads/moments";
pub const TORQUES: &str = "loads/torques";

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: LOADS,
    holds: "displacements of the surface for gravity, other body loads and force patterns, and their reactions",
    suits: None,
    compute: Some(compute),
    solves: true,
    write,
    check,
    groups: |file, body| vec![columns::group(file, body, &names())],
    fixed_bytes: |_| 0,
    is_derived: true,
    column_names: Some(|meta| column_names(&meta.loads)),
};

/// Names of the columns of these loads.
pub fn column_names(loads: &[LoadMeta]) -> Vec<ColumnName> {
    let named =
        |name: String, unit: &str| ColumnName { name, unit: unit.to_owned(), source: ColumnSource::Load };
    let of = |load: &LoadMeta| match load.columns {
        3 => ["x", "y", "z"].map(|axis| named(format!("{}.{axis}", load.name), &load.unit)).to_vec(),
        _ => vec![named(load.name.clone(), &load.unit)],
    };
    loads.iter().flat_map(of).collect()
}

fn names() -> Names {
    Names { basis: "loads/basis".into(), scale: "loads/scale".into() }
}

type V3 = Vector3<f64>;

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let mesh = &solution.mesh;
    let forces = column_forces(assembled, mesh)?;
    let (nodes, count) = (mesh.nodes.len(), forces.len());
    let [f, g] = answers(assembled, nodes, &forces, progress)?;

    let dense = |fields: &NodeFields| DMatrix::from_row_slice(3 * nodes, fields.columns, &fields.data);
    let (f, g, u) = (dense(&f), dense(&g), dense(&solution.fields));
    let (low, high) = bounding_box(&mesh.nodes);
    let centre = low + (high - low) * 0.5;
    let loads: Vec<LoadMeta> = assembled.body.loads().iter().map(LoadMeta::new).collect();
    let is_inner = inner(&loads);
    let outer = || forces.iter().enumerate().filter(|(k, _)| !is_inner[*k]);
    let mut moments = DMatrix::zeros(12, count);
    for (k, force) in outer() {
        for (force, x) in force.iter().zip(&mesh.nodes) {
            let moment = force * (x - centre).transpose();
            for i in 0..3 {
                moments[(i, k)] += force[i];
                (0..3).for_each(|j| moments[(3 + 3 * i + j, k)] += moment[(i, j)]);
            }
        }
    }
    let all = u.ncols() + count;
    let mut torques = DMatrix::zeros(3 * all, count);
    for (k, force) in outer() {
        for (node, force) in force.iter().enumerate().filter(|(_, force)| **force != V3::zeros()) {
            for column in 0..all {
                let of = |axis: usize| match column.checked_sub(u.ncols()) {
                    None => u[(3 * node + axis, column)],
                    Some(own) => g[(3 * node + axis, own)],
                };
                let torque = V3::new(of(0), of(1), of(2)).cross(force);
                (0..3).for_each(|axis| torques[(3 * column + axis, k)] += torque[axis]);
            }
        }
    }
    solution.tables.insert(REACTION, u.transpose() * &f);
    let compliance = f.transpose() * &g;
    let mut compliance = (&compliance + compliance.transpose()) * 0.5;
    // A held body stores the energy of the strain that warmth would have: ½ f·x of the strain's own forces, x its displacement.
    for (k, forces) in forces.iter().enumerate().filter(|(k, _)| is_inner[*k]) {
        let stored: f64 = forces.iter().zip(&mesh.nodes).map(|(force, x)| force.dot(&(x - centre))).sum();
        compliance[(k, k)] -= stored;
    }
    solution.tables.insert(LOAD_COMPLIANCE, compliance);
    solution.tables.insert(MOMENTS, moments);
    solution.tables.insert(TORQUES, torques);
    solution.tables.insert(LOAD_FIELDS, g);
    solution.tables.insert(LOAD_FORCES, f);
    solution.loads = loads;
    Ok(())
}

/// Whether each column of these loads is a force of the body on itself.
pub(super) fn inner(loads: &[LoadMeta]) -> Vec<bool> {
    loads.iter().flat_map(|load| std::iter::repeat_n(load.turning == Turning::Inner, load.columns)).collect()
}

/// A force for each node, for each column of a body's loads; those of warmth by the stiffness.
pub(super) fn column_forces(assembled: &Assembled<'_>, mesh: &TetMesh) -> Result<Vec<Vec<V3>>, GreenError> {
    let mut forces = Vec::new();
    for load in assembled.body.loads() {
        forces.extend(match load.source {
            LoadSource::Thermal => vec![expansion(mesh, assembled.k)],
            _ => nodal_forces(assembled.scene, assembled.name, mesh, &load)?,
        });
    }
    Ok(forces)
}

/// Forces F of the loads over all nodes, and the displacements G that they cause while all control elements rest.
pub(super) fn answers(
    assembled: &Assembled<'_>,
    nodes: usize,
    forces: &[Vec<V3>],
    progress: &dyn Progress,
) -> Result<[NodeFields; 2], GreenError> {
    let mut f = NodeFields::zeros(nodes, forces.len());
    for (column, force) in forces.iter().enumerate() {
        for (row, value) in force.iter().flat_map(|force| force.iter()).enumerate() {
            f.row_mut(row)[column] = *value;
        }
    }
    let mut g = NodeFields::zeros(nodes, forces.len());
    let free = (assembled.solve)(&f.at(&assembled.partition.free), progress)?;
    assembled.partition.insert_free(&free, &mut g);
    Ok([f, g])
}

/// A force for each node, for each of a load's columns; nothing of warmth, whose forces are those of the stiffness.
pub fn nodal_forces(
    scene: &Scene,
    name: &str,
    mesh: &TetMesh,
    load: &LoadEntry<'_>,
) -> Result<Vec<Vec<V3>>, GreenError> {
    let density = || densities_of_tets(scene, name, mesh);
    Ok(match load.source {
        LoadSource::Gravity => {
            let density = density()?;
            let along = |axis| body_force(mesh, &|tet, _| V3::ith(axis, density[tet]));
            (0..3).map(along).collect()
        }
        LoadSource::Centrifugal(Centrifugal { axis, point, .. }) => {
            let (density, axis, point) = (density()?, V3::from(*axis).normalize(), V3::from(*point));
            let outward = |tet: usize, x: &V3| {
                let from = x - point;
                (from - axis * axis.dot(&from)) * density[tet]
            };
            vec![body_force(mesh, &outward)]
        }
        LoadSource::Thermal => Vec::new(),
        LoadSource::Pattern(pattern) => Tractions::new(scene, mesh, pattern)
            .map_err(|message| scene.invalid(&format!("body.{name}.load.{}", load.name), message))?
            .nodal_forces(mesh),
    })
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let Some(fields) = body.solution.tables.get(LOAD_FIELDS) else { return Vec::new() };
    let stored = columns::stored(body, fields.ncols(), &|row, column| fields[(row, column)]);
    meta.accuracy.storage_error = meta.accuracy.storage_error.max(stored.relative_error());
    meta.loads.clone_from(&body.solution.loads);
    let mut tensors = load_tensors(body.solution.surface.nodes.len(), body.storage, stored);
    for name in [REACTION, LOAD_COMPLIANCE, MOMENTS, TORQUES] {
        tensors.extend(table::write(body, name));
    }
    tensors
}

/// The tensors of the columns.
pub fn load_tensors(surface_nodes: usize, storage: Storage, stored: StoredColumns) -> Vec<(String, Tensor)> {
    columns::write(storage, surface_nodes, names(), stored)
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let count = body.load_columns();
    if body.loads.iter().any(|load| load.columns != 1 && load.columns != 3) {
        return Err(format!("bodies.{name}.loads: a load has neither one nor three columns"));
    }
    columns::check(file, name, &names(), count)?;
    let fields = FIELDS * body.controls.len();
    table::check(file, name, REACTION, [fields, count])?;
    table::check(file, name, LOAD_COMPLIANCE, [count, count])?;
    table::check(file, name, MOMENTS, [12, count])?;
    table::check(file, name, TORQUES, [3 * (fields + count), count])?;
    numbers(&format!("bodies.{name}.loads"), body.loads.iter().map(|load| load.columns as f64), 3.0)
}

impl LoadMeta {
    /// The entry of a load in the file.
    pub fn new(load: &LoadEntry<'_>) -> LoadMeta {
        let (turning, unit) = match load.source {
            LoadSource::Gravity => (Turning::Fixed, "m/s²"),
            LoadSource::Centrifugal(_) => (Turning::Follows, "(rad/s)²"),
            LoadSource::Thermal => (Turning::Inner, "strain"),
            LoadSource::Pattern(pattern) => match pattern.kind {
                LoadKind::Shift => (Turning::Fixed, "N"),
                LoadKind::Stretch | LoadKind::Direction => (Turning::Follows, "N"),
                LoadKind::Twist => (Turning::Follows, "N·m"),
                LoadKind::Pressure => (Turning::Follows, "Pa"),
            },
        };
        let (name, unit) = (load.name.to_owned(), unit.to_owned());
        LoadMeta { name, columns: load.source.columns(), turning, unit }
    }
}

impl GreenFile {
    /// The columns of all loads of a body.
    pub fn load_columns(&self, body: &str) -> ColumnGroup<'_> {
        columns::group(self, body, &names())
    }
}
