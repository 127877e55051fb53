//! The family `updates`: what it takes to release control elements and to change the moduli of regions without factoring again.
//!
//! In: the affine fields, and solves with A. Out: the tables of [`Ports`]: for every degree of
//! freedom of a node that a change may concern, the field that it causes, on the surface and at those nodes; the reactions on
//! the control elements that may be released; and the stiffness of each region that may be changed, condensed onto the nodes
//! where the body feels it. The formulas stand in [`update`](super::super::update).

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::prepare::materials_of_tets;
use super::super::requirements::Family;
use super::super::solution::Solution;
use super::super::update::{Ports, Region, TABLES, Updates};
use super::affine::AFFINE;
use super::loads::{LOAD_FIELDS, LOAD_FORCES};
use super::stiffness::STIFFNESS;
use super::table;
use crate::base::machine;
use crate::fem::{Lame, NodeFields, Partition, StiffnessMatrix};
use crate::mesh::TetMesh;
use crate::solve::{Progress, Silent, SolveError, Solver};
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeSet;

pub const UPDATES: Family = Family { name: "updates", from: &[AFFINE, STIFFNESS] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: UPDATES,
    holds: "fields and reactions by which control elements are released and moduli changed while the body is shown",
    suits: None,
    compute: Some(compute),
    solves: true,
    write: |body, _| TABLES.iter().flat_map(|name| table::write(body, name)).collect(),
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |_| 0,
    is_derived: true,
    column_names: None,
};

/// Fields that are solved at a time.
const BATCH: usize = 96;

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let ports = ports(assembled, solution)?;
    let empty = DMatrix::zeros(3 * solution.mesh.nodes.len(), 0);
    let of_loads = |name: &str| solution.tables.get(name).unwrap_or(&empty);
    let (load_fields, load_forces) = (of_loads(LOAD_FIELDS), of_loads(LOAD_FORCES));
    let (nodes, affine) = (ports.nodes.len(), FIELDS * solution.controls.len());
    let known = affine + load_fields.ncols();
    let (released, all) = (3 * ports.released.len(), 3 * (ports.released.len() + ports.free.len()));
    let surface = &solution.surface.nodes;
    let numbers = all * (3 * surface.len() + 3 * nodes + released) + BATCH * 6 * solution.mesh.nodes.len();
    machine::expect("the fields of what may be changed", 8.0 * numbers as f64)
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;

    let controlled: Vec<usize> = {
        let place = |node: &u32| assembled.partition.controlled.binary_search(node).unwrap_or(0);
        ports.released.iter().map(|&[_, port]| place(&ports.nodes[port])).collect()
    };
    let mut values = DMatrix::zeros(3 * nodes, known + all);
    let mut reactions = DMatrix::zeros(released, known + all);
    let mut torques = DMatrix::zeros(3 * all, load_fields.ncols());
    let mut columns = DMatrix::zeros(3 * surface.len(), all);
    let keep =
        |fields: &NodeFields, first: usize, values: &mut DMatrix<f64>, reactions: &mut DMatrix<f64>| {
            copy(fields, &ports.nodes, first, values);
            let forces = assembled.partition.reaction(assembled.k, fields);
            for (at, &row) in controlled.iter().enumerate() {
                for axis in 0..3 {
                    for (column, force) in forces.row(3 * row + axis).iter().enumerate() {
                        reactions[(3 * at + axis, first + column)] = *force;
                    }
                }
            }
        };
    keep(&solution.fields, 0, &mut values, &mut reactions);
    let loaded = NodeFields {
        nodes: solution.mesh.nodes.len(),
        columns: load_fields.ncols(),
        data: load_fields.transpose().as_slice().to_vec(),
    };
    if loaded.columns > 0 {
        keep(&loaded, affine, &mut values, &mut reactions);
    }
    for (at, &[_, port]) in ports.released.iter().enumerate() {
        for axis in 0..3 {
            for load in 0..loaded.columns {
                let own = load_forces[(3 * ports.nodes[port] as usize + axis, load)];
                reactions[(3 * at + axis, affine + load)] -= own;
            }
        }
    }
    progress.begin("fields of what may be changed", all as u64);
    for first in (0..all).step_by(BATCH) {
        let count = BATCH.min(all - first);
        let mut fields = NodeFields::zeros(solution.mesh.nodes.len(), count);
        let mut loads = NodeFields::zeros(solution.mesh.nodes.len(), count);
        for column in 0..count {
            let (port, axis) = ((first + column) / 3, (first + column) % 3);
            match port.checked_sub(ports.released.len()) {
                None => {
                    let node = ports.nodes[ports.released[port][1]] as usize;
                    fields.row_mut(3 * node + axis)[column] = 1.0;
                }
                Some(free) => {
                    let node = ports.nodes[ports.free[free]] as usize;
                    loads.row_mut(3 * node + axis)[column] = 1.0;
                }
            }
        }
        let mut rhs = assembled.partition.minus_b_times(assembled.k, &fields);
        let loads = loads.at(&assembled.partition.free);
        rhs.data.iter_mut().zip(&loads.data).for_each(|(rhs, load)| *rhs += load);
        let free = (assembled.solve)(&rhs, &Silent)?;
        assembled.partition.insert_free(&free, &mut fields);
        keep(&fields, known + first, &mut values, &mut reactions);
        add_torques(&fields, load_forces, 3 * first, &mut torques);
        copy(&fields, surface, first, &mut columns);
        progress.advance(count as u64);
    }
    progress.end();
    solution.tables.extend(ports.tables(values, reactions, columns, torques));
    Ok(())
}

/// Σ u × f over the nodes, of every field u and every load f, into the rows from `first` on.
fn add_torques(fields: &NodeFields, forces: &DMatrix<f64>, first: usize, torques: &mut DMatrix<f64>) {
    let vector = |of: &dyn Fn(usize) -> f64| Vector3::new(of(0), of(1), of(2));
    for load in 0..forces.ncols() {
        for node in 0..fields.nodes {
            let force = vector(&|axis| forces[(3 * node + axis, load)]);
            if force == Vector3::zeros() {
                continue;
            }
            for column in 0..fields.columns {
                let torque = vector(&|axis| fields.row(3 * node + axis)[column]).cross(&force);
                (0..3).for_each(|axis| torques[(first + 3 * column + axis, load)] += torque[axis]);
            }
        }
    }
}

/// The rows of `fields` at `nodes`, into the columns of `into` from `first` on.
fn copy(fields: &NodeFields, nodes: &[u32], first: usize, into: &mut DMatrix<f64>) {
    for (at, &node) in nodes.iter().enumerate() {
        for axis in 0..3 {
            for (column, value) in fields.row(3 * node as usize + axis).iter().enumerate() {
                into[(3 * at + axis, first + column)] = *value;
            }
        }
    }
}

/// The nodes that a change may concern, and the condensed stiffness of each region among it.
fn ports(assembled: &Assembled<'_>, solution: &Solution) -> Result<Ports, GreenError> {
    let Assembled { scene, name, body, lame, partition, .. } = *assembled;
    let Solution { element, mesh, controls, .. } = solution;
    let asked = body.updates.clone().unwrap_or_default();
    let of_tets = materials_of_tets(scene, name, body, mesh)?;
    let is_free = |node: &u32| partition.free.binary_search(node).is_ok();
    let mut parts = Vec::new();
    for region in &asked.modulus {
        let number = 1 + body.region.keys().position(|key| key == region).unwrap_or(0);
        let inside: Vec<usize> = (0..mesh.tets.len()).filter(|&tet| of_tets[tet] == number).collect();
        let nodes = |is_meant: &dyn Fn(usize) -> bool| -> BTreeSet<u32> {
            let meant = (0..mesh.tets.len()).filter(|&tet| is_meant(of_tets[tet]));
            meant
                .flat_map(|tet| mesh.tets[tet].iter().chain(mesh.mids.get(tet).into_iter().flatten()))
                .copied()
                .collect()
        };
        let (own, others) = (nodes(&|of| of == number), nodes(&|of| of != number));
        let shared: Vec<u32> = own.iter().copied().filter(|n| others.contains(n) || !is_free(n)).collect();
        let inner: Vec<u32> = own.iter().copied().filter(|n| !others.contains(n) && is_free(n)).collect();
        let part = TetMesh {
            nodes: mesh.nodes.clone(),
            tets: inside.iter().map(|&tet| mesh.tets[tet]).collect(),
            mids: if mesh.mids.is_empty() {
                Vec::new()
            } else {
                inside.iter().map(|&tet| mesh.mids[tet]).collect()
            },
            regions: vec![0; inside.len()],
            ..TetMesh::default()
        };
        let own_lame: Vec<Lame> = inside.iter().map(|&tet| lame[tet]).collect();
        let numbers = 18 * shared.len() * shared.len() + BATCH * 9 * mesh.nodes.len();
        machine::expect("the condensed stiffness of a region", 8.0 * numbers as f64)
            .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
        let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
        let k = element.assemble(&part, &own_lame).map_err(unfit)?;
        let failed = |source| GreenError::Solve { body: assembled.place.to_owned(), source };
        parts.push((condensed(&body.solver, &k, &shared, &inner).map_err(failed)?, shared));
    }
    let release = controls.iter().enumerate().filter(|(_, control)| asked.release.contains(&control.name));
    let release: Vec<(usize, u32)> =
        release.flat_map(|(e, c)| c.nodes.iter().map(move |&node| (e, node))).collect();
    let of_regions = parts.iter().flat_map(|(_, nodes)| nodes);
    let nodes: BTreeSet<u32> = release.iter().map(|(_, node)| node).chain(of_regions).copied().collect();
    let nodes: Vec<u32> = nodes.into_iter().collect();
    let port = |node: &u32| nodes.partition_point(|other| other < node);
    let region = |(stiffness, shared): (DMatrix<f64>, Vec<u32>)| Region {
        ports: shared.iter().map(port).collect(),
        stiffness,
    };
    Ok(Ports {
        released: release.iter().map(|(e, node)| [*e, port(node)]).collect(),
        free: (0..nodes.len()).filter(|&port| is_free(&nodes[port])).collect(),
        regions: parts.into_iter().map(region).collect(),
        nodes,
    })
}

/// S = K_QQ - K_QI K_II⁻¹ K_IQ.
fn condensed(
    solver: &Solver,
    k: &StiffnessMatrix,
    shared: &[u32],
    inner: &[u32],
) -> Result<DMatrix<f64>, SolveError> {
    let part = Partition { free: inner.to_vec(), controlled: shared.to_vec() };
    let a = part.a(k);
    let analysed = solver.analyse(&a, &Silent)?;
    let factor = analysed.factor(&a, &Silent)?;
    let mut s = DMatrix::zeros(3 * shared.len(), 3 * shared.len());
    for first in (0..3 * shared.len()).step_by(BATCH) {
        let count = BATCH.min(3 * shared.len() - first);
        let mut fields = NodeFields::zeros(k.nodes(), count);
        for column in 0..count {
            let (node, axis) = (shared[(first + column) / 3] as usize, (first + column) % 3);
            fields.row_mut(3 * node + axis)[column] = 1.0;
        }
        let (free, _) = factor.solve(&part.minus_b_times(k, &fields), &Silent)?;
        part.insert_free(&free, &mut fields);
        let forces = part.reaction(k, &fields);
        for row in 0..3 * shared.len() {
            for (column, force) in forces.row(row).iter().enumerate() {
                s[(row, first + column)] = *force;
            }
        }
    }
    Ok((&s + s.transpose()) * 0.5)
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let counts = [body.controls.len(), body.surface_nodes, body.load_columns()];
    let updates = Updates::of(&|table| file.table(name, table), counts);
    updates.map(drop).map_err(|message| format!("{name}: {message}"))
}

impl GreenFile {
    /// What a body can be changed by, where it was precomputed.
    pub fn updates(&self, body: &str) -> Option<Updates> {
        let meta = self.meta.bodies.get(body).filter(|meta| meta.requirements.has(UPDATES))?;
        let counts = [meta.controls.len(), meta.surface_nodes, meta.load_columns()];
        Updates::of(&|table| self.table(body, table), counts).ok()
    }
}
