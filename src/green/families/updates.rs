//! The family `updates`: what it takes to release control elements and to change the moduli of regions without factoring again.
//!
//! In: the affine fields, those of loads, and solves with A. Out: the tables of [`Ports`]: for every degree of
//! freedom of a node that a change may concern, the field that it causes, on the surface and at those nodes; the reactions on
//! the control elements that may be released; the stiffness of each region that may be changed, condensed onto the nodes
//! where the body feels it; and what loads do inside of it. The formulas stand in [`update`](super::super::update).

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::prepare::materials_of_tets;
use super::super::requirements::Family;
use super::super::solution::Solution;
use super::super::update::{Ports, Region, TABLES, Updates};
use super::affine::AFFINE;
use super::loads::{LOAD_FIELDS, LOAD_FORCES, inner};
use super::stiffness::STIFFNESS;
use super::table;
use crate::base::machine;
use crate::fem::dense_fields::rows;
use crate::fem::{Lame, NodeFields, Partition, StiffnessMatrix, free_expansion};
use crate::mesh::TetMesh;
use crate::solve::{Progress, Silent, SolveError, Solver};
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeSet;
use std::ops::Range;

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
    let loads = Loads::from_solution(solution);
    let (ports, inside) = ports(assembled, solution, &loads.given)?;
    let mut made = FamilyTables::new(assembled, solution, &ports, &loads)?;
    made.keep(&solution.fields, 0);
    made.keep_loads(solution);
    made.keep_inside(&inside);
    progress.begin("fields of what may be changed", ports.fields() as u64);
    for first in (0..ports.fields()).step_by(BATCH) {
        let count = BATCH.min(ports.fields() - first);
        made.keep_units(first..first + count)?;
        progress.advance(count as u64);
    }
    progress.end();
    let FamilyTables { values, reactions, columns, torques, work, .. } = made;
    solution.tables.extend(ports.tables([values, reactions, columns, torques, work]));
    Ok(())
}

/// The loads of a body over all nodes, a column each.
struct Loads {
    fields: NodeFields,
    forces: DMatrix<f64>,
    /// The forces that no modulus changes: 0 of warmth.
    given: DMatrix<f64>,
    is_warmth: Vec<bool>,
}

impl Loads {
    fn from_solution(solution: &Solution) -> Loads {
        let nodes = solution.mesh.nodes.len();
        let table =
            |name: &str| solution.tables.get(name).cloned().unwrap_or_else(|| DMatrix::zeros(3 * nodes, 0));
        let (fields, forces, is_warmth) = (table(LOAD_FIELDS), table(LOAD_FORCES), inner(&solution.loads));
        let mut given = forces.clone();
        given
            .column_iter_mut()
            .zip(&is_warmth)
            .filter(|(_, is_warmth)| **is_warmth)
            .for_each(|(mut column, _)| column.fill(0.0));
        Loads { fields: by_nodes(&fields), forces, given, is_warmth }
    }
}

/// A matrix with a column for each field.
fn by_nodes(fields: &DMatrix<f64>) -> NodeFields {
    let data = fields.transpose().as_slice().to_vec();
    NodeFields { nodes: fields.nrows() / 3, columns: fields.ncols(), data }
}

/// The tables of the family, while they are made.
struct FamilyTables<'a> {
    assembled: &'a Assembled<'a>,
    ports: &'a Ports,
    loads: &'a Loads,
    surface: &'a [u32],
    /// Index among all controlled nodes of each node that may be released.
    controlled: Vec<usize>,
    affine: usize,
    values: DMatrix<f64>,
    reactions: DMatrix<f64>,
    columns: DMatrix<f64>,
    torques: DMatrix<f64>,
    work: DMatrix<f64>,
}

impl<'a> FamilyTables<'a> {
    fn new(
        assembled: &'a Assembled<'a>,
        solution: &'a Solution,
        ports: &'a Ports,
        loads: &'a Loads,
    ) -> Result<FamilyTables<'a>, GreenError> {
        let (surface, nodes) = (&solution.surface.nodes, ports.nodes.len());
        let (released, own, affine) =
            (3 * ports.released.len(), ports.fields(), FIELDS * solution.controls.len());
        let numbers =
            own * (3 * surface.len() + 3 * nodes + released) + BATCH * 6 * solution.mesh.nodes.len();
        machine::expect("the fields of what may be changed", 8.0 * numbers as f64)
            .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
        let place = |node: &u32| assembled.partition.controlled.binary_search(node).unwrap_or(0);
        let count = loads.fields.columns;
        let (all, inside) = (affine + count + own, count * ports.regions.len());
        Ok(FamilyTables {
            assembled,
            ports,
            loads,
            surface,
            controlled: ports.released.iter().map(|&[_, port]| place(&ports.nodes[port])).collect(),
            affine,
            values: DMatrix::zeros(3 * nodes, all),
            reactions: DMatrix::zeros(released, all),
            columns: DMatrix::zeros(3 * surface.len(), own + inside + count),
            torques: DMatrix::zeros(3 * (own + inside), count),
            work: DMatrix::zeros(count, inside),
        })
    }

    /// Displacements of the ports, and reactions, from a column on.
    fn keep(&mut self, fields: &NodeFields, first: usize) {
        copy(fields, &self.ports.nodes, first, &mut self.values);
        let forces = self.assembled.partition.reaction(self.assembled.k, fields);
        for (at, &row) in self.controlled.iter().enumerate() {
            for axis in 0..3 {
                for (column, force) in forces.row(3 * row + axis).iter().enumerate() {
                    self.reactions[(3 * at + axis, first + column)] = *force;
                }
            }
        }
    }

    /// The fields of loads: at the ports that of warmth less x, their reactions less their own forces.
    fn keep_loads(&mut self, solution: &Solution) {
        let (first, loads) = (self.affine, self.loads);
        if loads.fields.columns == 0 {
            return;
        }
        self.keep(&loads.fields, first);
        let behind = self.columns.ncols() - loads.fields.columns;
        copy(&loads.fields, self.surface, behind, &mut self.columns);
        for (at, &[_, port]) in self.ports.released.iter().enumerate() {
            let own = loads.forces.rows(3 * self.ports.nodes[port] as usize, 3);
            let mut reactions = self.reactions.view_mut((3 * at, first), (3, own.ncols()));
            reactions -= own;
        }
        let expansion = free_expansion(&solution.mesh);
        for load in (0..loads.fields.columns).filter(|&load| loads.is_warmth[load]) {
            for (port, &node) in self.ports.nodes.iter().enumerate() {
                for axis in 0..3 {
                    self.values[(3 * port + axis, first + load)] -=
                        expansion.row(3 * node as usize + axis)[0];
                }
            }
        }
    }

    /// p of every region.
    fn keep_inside(&mut self, inside: &[NodeFields]) {
        let own = self.ports.fields();
        for (region, p) in inside.iter().enumerate() {
            let first = p.columns * region;
            copy(p, self.surface, own + first, &mut self.columns);
            add_torques(p, &self.loads.given, 3 * (own + first), &mut self.torques);
            let work = self.loads.given.transpose() * rows(p).transpose();
            self.work.columns_mut(first, p.columns).copy_from(&work);
        }
    }

    /// Some of the fields g and h, solved for.
    fn keep_units(&mut self, of: Range<usize>) -> Result<(), GreenError> {
        let Assembled { k, partition, solve, .. } = *self.assembled;
        let (released, nodes) = (3 * self.ports.released.len(), k.nodes());
        let mut fields = NodeFields::zeros(nodes, of.len());
        let mut forces = NodeFields::zeros(nodes, of.len());
        for (column, unit) in of.clone().enumerate() {
            let (into, port) = match unit.checked_sub(released) {
                None => (&mut fields, self.ports.released[unit / 3][1]),
                Some(free) => (&mut forces, self.ports.free[free / 3]),
            };
            into.row_mut(3 * self.ports.nodes[port] as usize + unit % 3)[column] = 1.0;
        }
        let mut rhs = partition.minus_b_times(k, &fields);
        let forces = forces.at(&partition.free);
        rhs.data.iter_mut().zip(&forces.data).for_each(|(rhs, force)| *rhs += force);
        partition.insert_free(&solve(&rhs, &Silent)?, &mut fields);
        self.keep(&fields, self.affine + self.loads.fields.columns + of.start);
        add_torques(&fields, &self.loads.given, 3 * of.start, &mut self.torques);
        copy(&fields, self.surface, of.start, &mut self.columns);
        Ok(())
    }
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

/// The nodes that a change may concern, with the condensed stiffness of each region among it; and p of each region over all
/// nodes, a column for each of the forces `given`.
fn ports(
    assembled: &Assembled<'_>,
    solution: &Solution,
    given: &DMatrix<f64>,
) -> Result<(Ports, Vec<NodeFields>), GreenError> {
    let Assembled { scene, name, body, lame, partition, .. } = *assembled;
    let Solution { element, mesh, controls, .. } = solution;
    let mut asked = body.updates.clone().unwrap_or_default();
    if body.why_anew(true).is_some() {
        asked.modulus.clear();
    }
    let of_tets = materials_of_tets(scene, name, body, mesh)?;
    let is_free = |node: &u32| partition.free.binary_search(node).is_ok();
    let (mut parts, mut fields) = (Vec::new(), Vec::new());
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
        let (stiffness, p) = condensed(&body.solver, &k, (&shared, &inner), given).map_err(failed)?;
        parts.push((stiffness, shared));
        fields.push(p);
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
    let ports = Ports {
        released: release.iter().map(|(e, node)| [*e, port(node)]).collect(),
        free: (0..nodes.len()).filter(|&port| is_free(&nodes[port])).collect(),
        regions: parts.into_iter().map(region).collect(),
        nodes,
    };
    Ok((ports, fields))
}

/// S = K_QQ - K_QI K_II⁻¹ K_IQ and p = K_II⁻¹ F_I.
fn condensed(
    solver: &Solver,
    k: &StiffnessMatrix,
    (shared, inner): (&[u32], &[u32]),
    forces: &DMatrix<f64>,
) -> Result<(DMatrix<f64>, NodeFields), SolveError> {
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
    let mut p = NodeFields::zeros(k.nodes(), forces.ncols());
    if p.columns > 0 {
        part.insert_free(&factor.solve(&by_nodes(forces).at(&part.free), &Silent)?.0, &mut p);
    }
    Ok(((&s + s.transpose()) * 0.5, p))
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let counts = [body.controls.len(), body.surface_nodes, body.load_columns()];
    let updates = Updates::read(&|table| file.table(name, table), counts);
    updates.map(drop).map_err(|message| format!("{name}: {message}"))
}

impl GreenFile {
    /// The changes of a body that were prepared, with their fields, where its file has them.
    pub fn updates(&self, body: &str) -> Option<Updates> {
        let meta = self.meta.bodies.get(body).filter(|meta| meta.requirements.has(UPDATES))?;
        let counts = [meta.controls.len(), meta.surface_nodes, meta.load_columns()];
        Updates::read(&|table| self.table(body, table), counts).ok()
    }
}
