//! The family `load_forces`: the forces of a body's loads at its nodes, for models whose shape is no sum of columns.
//!
//! In: the loads of a scene's body on its mesh. Out, for the N nodes that a force acts on and the K columns of the loads,
//!
//! ```text
//! load_forces/places   3 × N     where a node rests, m about the file's centre
//! load_forces/held     1 × N     0, or one more than the number of the control element that holds it
//! load_forces/forces   3 N × K   0 for warmth, by which such a model changes its lengths
//! ```

use super::super::bytes::Tensor;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile, LoadMeta, Turning};
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::loads::nodal_forces;
use super::table;
use crate::base::extent::bounding_box;
use crate::solve::Progress;
use nalgebra::{DMatrix, Vector3};

pub const LOAD_FORCES: Family = Family { name: "load_forces", from: &[] };

const PLACES: &str = "load_forces/places";
const HELD: &str = "load_forces/held";
const FORCES: &str = "load_forces/forces";

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: LOAD_FORCES,
    holds: "the forces of loads at the nodes, for models whose shape is no sum of columns",
    suits: None,
    compute: Some(compute),
    solves: false,
    write,
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |_| 0,
    is_derived: false,
    column_names: None,
};

type V3 = Vector3<f64>;

/// The nodes that loads act on.
#[derive(Clone, Debug)]
pub struct LoadForces {
    pub places: Vec<V3>,
    /// The control element that holds each.
    pub held: Vec<Option<usize>>,
    /// 3 N × K.
    pub forces: DMatrix<f64>,
}

impl LoadForces {
    /// The forces from the tables of a body with `control_elements` control elements and `columns` columns of loads; the error
    /// names the first fault.
    pub fn read(
        table: &dyn Fn(&str) -> Option<DMatrix<f64>>,
        control_elements: usize,
        columns: usize,
    ) -> Result<LoadForces, String> {
        if columns == 0 {
            let forces = DMatrix::zeros(0, 0);
            return Ok(LoadForces { places: Vec::new(), held: Vec::new(), forces });
        }
        let find = |name: &str| table(name).ok_or_else(|| format!("the table {name} is missing"));
        let (places, held, forces) = (find(PLACES)?, find(HELD)?, find(FORCES)?);
        let nodes = places.ncols();
        let shapes = [places.shape(), held.shape(), forces.shape()];
        if shapes != [(3, nodes), (1, nodes), (3 * nodes, columns)] {
            return Err(format!("the tables {PLACES}, {HELD} and {FORCES} have numbers of different nodes"));
        }
        let holder = |number: &f64| match *number as usize {
            0 => Ok(None),
            e if e <= control_elements && e as f64 == *number => Ok(Some(e - 1)),
            _ => Err(format!("table {HELD}: {number} is no control element")),
        };
        Ok(LoadForces {
            places: places.column_iter().map(|x| V3::new(x[0], x[1], x[2])).collect(),
            held: held.iter().map(holder).collect::<Result<_, _>>()?,
            forces,
        })
    }
}

fn compute(assembled: &Assembled<'_>, solution: &mut Solution, _: &dyn Progress) -> Result<(), GreenError> {
    let Solution { mesh, controls, .. } = &*solution;
    let loads = assembled.body.loads();
    let mut columns = Vec::new();
    for load in &loads {
        columns.extend(match LoadMeta::new(load).turning {
            Turning::Inner => vec![vec![V3::zeros(); mesh.nodes.len()]],
            Turning::Fixed | Turning::Follows => nodal_forces(assembled.scene, assembled.name, mesh, load)?,
        });
    }
    let (low, high) = bounding_box(&mesh.nodes);
    let centre = low + (high - low) * 0.5;
    let is_pushed = |node: &usize| columns.iter().any(|column| column[*node] != V3::zeros());
    let nodes: Vec<usize> = (0..mesh.nodes.len()).filter(is_pushed).collect();
    let holder = |&node: &usize| {
        let found = controls.iter().position(|control| control.nodes.binary_search(&(node as u32)).is_ok());
        found.map_or(0.0, |e| (e + 1) as f64)
    };
    let places = nodes.iter().flat_map(|&node| <[f64; 3]>::from(mesh.nodes[node] - centre));
    let places = DMatrix::from_iterator(3, nodes.len(), places);
    let held = DMatrix::from_iterator(1, nodes.len(), nodes.iter().map(holder));
    let numbers =
        columns.iter().flat_map(|column| nodes.iter().flat_map(|&node| <[f64; 3]>::from(column[node])));
    let forces = DMatrix::from_iterator(3 * nodes.len(), columns.len(), numbers);
    solution.tables.extend([(PLACES, places), (HELD, held), (FORCES, forces)]);
    solution.loads = loads.iter().map(LoadMeta::new).collect();
    Ok(())
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    meta.loads.clone_from(&body.solution.loads);
    [PLACES, HELD, FORCES].iter().flat_map(|name| table::write(body, name)).collect()
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let places = format!("{name}/{PLACES}");
    let nodes = file.tensors.get(&places).and_then(|(_, shape, _)| shape.first().copied()).unwrap_or(0);
    table::check(file, name, PLACES, [3, nodes])?;
    table::check(file, name, HELD, [1, nodes])?;
    table::check(file, name, FORCES, [nodes.saturating_mul(3), body.load_columns()])?;
    LoadForces::read(&|table| file.table(name, table), body.controls.len(), body.load_columns())
        .map(drop)
        .map_err(|message| format!("{name}: {message}"))
}
