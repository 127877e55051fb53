//! The family `volume`: the mesh itself, for models that solve the body again while it is moved.
//!
//! In: mesh, elements, materials and loads as they were solved. Out: the tables of [`Volume`], and the [`Volume`] of a body again.
//! Every index stands as a number in f64, which holds it exactly.

use super::super::bytes::Tensor;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile, LoadMeta, Turning};
use super::super::prepare::densities_of_tets;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::loads::nodal_forces;
use super::table;
use crate::fem::{ELEMENTS, Element, Lame};
use crate::mesh::TetMesh;
use crate::scene::LoadSource;
use crate::solve::Progress;
use nalgebra::{DMatrix, Vector3};
use safetensors::tensor::Dtype;

pub const VOLUME: Family = Family { name: "volume", from: &[] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: VOLUME,
    holds: "the mesh with its materials, for models that find static equilibrium while the body is moved",
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

/// Nodes, m: 3 × N.
const NODES: &str = "volume/nodes";
/// The nodes of each tetrahedron: 4 × T, or with those between the corners 10 × T.
const TETS: &str = "volume/tets";
/// λ and μ of each, Pa: 2 × T.
const LAME: &str = "volume/lame";
/// Control element and node, of every held node: 2 × H.
const HELD: &str = "volume/held";
/// The mesh's node of every surface node: 1 × S.
const SURFACE: &str = "volume/surface";
/// Number of the element in the list of elements: 1 × 1.
const ELEMENT: &str = "volume/element";
const TABLES: [&str; 6] = [NODES, TETS, LAME, HELD, SURFACE, ELEMENT];
/// A force at each node for each column of the loads, 0 of warmth: 3 N × K, of a body with loads.
const FORCES: &str = "volume/forces";
/// Density of each tetrahedron, kg/m³: 1 × T, of a body with gravity.
const DENSITY: &str = "volume/density";

/// A body's mesh, as it was solved.
#[derive(Clone, Debug)]
pub struct Volume {
    pub element: &'static Element,
    /// Nodes, tetrahedra and tags from 1 alone.
    pub mesh: TetMesh,
    pub lame: Vec<Lame>,
    /// The nodes of every control element, ascending.
    pub held: Vec<Vec<u32>>,
    /// The node of every surface node.
    pub surface: Vec<u32>,
    /// A force at each node for each column of the body's loads, 0 of warmth: 3 N × K.
    pub forces: DMatrix<f64>,
    /// Density of each tetrahedron, kg/m³; none of a body without gravity.
    pub density: Vec<f64>,
}

impl Volume {
    /// The volume from the tables of a body with `control_elements` control elements; the error names the first fault.
    pub fn read(
        table: &dyn Fn(&str) -> Option<DMatrix<f64>>,
        control_elements: usize,
    ) -> Result<Volume, String> {
        let find = |name: &str, rows: &[usize]| {
            let found = table(name).ok_or_else(|| format!("table {name} is missing"))?;
            let is_fit = rows.contains(&found.nrows()) && found.iter().all(|value| value.is_finite());
            is_fit.then_some(found).ok_or_else(|| format!("table {name} has numbers that cannot be used"))
        };
        let index = |name: &str, value: f64, below: usize| {
            let number = value as usize;
            let is_fit = value >= 0.0 && number < below && number as f64 == value;
            is_fit.then_some(number as u32).ok_or_else(|| format!("table {name}: {value} is no index"))
        };
        let (nodes, tets, lame) = (find(NODES, &[3])?, find(TETS, &[4, 10])?, find(LAME, &[2])?);
        let (held, surface, element) = (find(HELD, &[2])?, find(SURFACE, &[1])?, find(ELEMENT, &[1])?);
        let count = nodes.ncols();
        let of_tets = |row: usize| {
            (0..tets.ncols())
                .map(move |tet| (tet, row))
                .map(|(tet, row)| index(TETS, tets[(row, tet)], count))
        };
        let rows: Vec<Vec<u32>> =
            (0..tets.nrows()).map(|row| of_tets(row).collect()).collect::<Result<_, _>>()?;
        if lame.ncols() != tets.ncols() {
            return Err(format!("table {LAME} has {} columns, table {TETS} {}", lame.ncols(), tets.ncols()));
        }
        let mut all = vec![Vec::new(); control_elements];
        for column in held.column_iter() {
            let control = index(HELD, column[0], control_elements)?;
            all[control as usize].push(index(HELD, column[1], count)?);
        }
        let mesh = TetMesh {
            nodes: nodes.column_iter().map(|x| Vector3::new(x[0], x[1], x[2])).collect(),
            tags: (1..=count as u64).collect(),
            tets: (0..tets.ncols()).map(|tet| [0, 1, 2, 3].map(|row| rows[row][tet])).collect(),
            mids: match rows.len() {
                10 => (0..tets.ncols()).map(|t| [4, 5, 6, 7, 8, 9].map(|row| rows[row][t])).collect(),
                _ => Vec::new(),
            },
            regions: vec![0; tets.ncols()],
            ..TetMesh::default()
        };
        let forces = match table(FORCES) {
            Some(_) => find(FORCES, &[3 * count])?,
            None => DMatrix::zeros(3 * count, 0),
        };
        let density = match table(DENSITY) {
            Some(_) => find(DENSITY, &[1])?.iter().copied().collect(),
            None => Vec::new(),
        };
        if !density.is_empty() && density.len() != tets.ncols() {
            return Err(format!(
                "table {DENSITY} has {} columns, table {TETS} {}",
                density.len(),
                tets.ncols()
            ));
        }
        let number = index(ELEMENT, element.iter().next().copied().unwrap_or(-1.0), ELEMENTS.len())?;
        Ok(Volume {
            element: ELEMENTS[number as usize],
            mesh,
            lame: lame.column_iter().map(|of| Lame { lambda: of[0], mu: of[1] }).collect(),
            held: all,
            surface: surface.iter().map(|&node| index(SURFACE, node, count)).collect::<Result<_, _>>()?,
            forces,
            density,
        })
    }
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    _progress: &dyn Progress,
) -> Result<(), GreenError> {
    let Solution { element, mesh, surface, controls, .. } = &*solution;
    let nodes = mesh.nodes.iter().flat_map(|x| [x.x, x.y, x.z]);
    let of_tet = |tet: usize| {
        let mids = mesh.mids.get(tet).into_iter().flatten();
        mesh.tets[tet].iter().chain(mids).map(|&node| f64::from(node)).collect::<Vec<_>>()
    };
    let rows = if mesh.mids.is_empty() { 4 } else { 10 };
    let held = controls.iter().enumerate();
    let held: Vec<f64> =
        held.flat_map(|(e, c)| c.nodes.iter().flat_map(move |&n| [e as f64, f64::from(n)])).collect();
    let number = ELEMENTS.iter().position(|known| known.name == element.name).unwrap_or(0);
    let made = [
        (NODES, DMatrix::from_iterator(3, mesh.nodes.len(), nodes)),
        (TETS, DMatrix::from_iterator(rows, mesh.tets.len(), (0..mesh.tets.len()).flat_map(of_tet))),
        (
            LAME,
            DMatrix::from_iterator(
                2,
                mesh.tets.len(),
                assembled.lame.iter().flat_map(|lame| [lame.lambda, lame.mu]),
            ),
        ),
        (HELD, DMatrix::from_vec(2, held.len() / 2, held)),
        (
            SURFACE,
            DMatrix::from_iterator(1, surface.nodes.len(), surface.nodes.iter().map(|&node| f64::from(node))),
        ),
        (ELEMENT, DMatrix::from_element(1, 1, number as f64)),
    ];
    let loads = assembled.body.loads();
    let mut columns = Vec::new();
    for load in &loads {
        match LoadMeta::new(load).turning {
            Turning::Inner => columns.push(vec![Vector3::zeros(); mesh.nodes.len()]),
            Turning::Fixed | Turning::Follows => {
                columns.extend(nodal_forces(assembled.scene, assembled.name, mesh, load)?);
            }
        }
    }
    let numbers = columns.iter().flatten().flat_map(|force| [force.x, force.y, force.z]);
    let forces = DMatrix::from_iterator(3 * mesh.nodes.len(), columns.len(), numbers);
    let density = match loads.iter().any(|load| load.source == LoadSource::Gravity) {
        true => Some(densities_of_tets(assembled.scene, assembled.name, mesh)?),
        false => None,
    };
    solution.tables.extend(made);
    if let Some(density) = density {
        solution.tables.insert(DENSITY, DMatrix::from_row_slice(1, density.len(), &density));
    }
    if !loads.is_empty() {
        solution.tables.insert(FORCES, forces);
        solution.loads = loads.iter().map(LoadMeta::new).collect();
    }
    Ok(())
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    meta.loads.clone_from(&body.solution.loads);
    TABLES.iter().chain([&FORCES, &DENSITY]).flat_map(|name| table::write(body, name)).collect()
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let forces = (!body.loads.is_empty()).then_some(FORCES);
    for table in TABLES.into_iter().chain(forces) {
        let tensor = format!("{name}/{table}");
        let shape = file.tensors.get(&tensor).map(|(_, shape, _)| shape.clone()).unwrap_or_default();
        file.expect(&tensor, Dtype::F64, &shape)?;
    }
    let volume = Volume::read(&|table| file.table(name, table), body.controls.len());
    let volume = volume.map_err(|message| format!("{name}: {message}"))?;
    if volume.forces.ncols() != body.load_columns() {
        let (found, columns) = (volume.forces.ncols(), body.load_columns());
        return Err(format!("{name}: table {FORCES} has {found} columns, the loads have {columns}"));
    }
    if volume.surface.len() != body.surface_nodes {
        let found = volume.surface.len();
        return Err(format!("{name}: table {SURFACE} names {found} nodes, not {}", body.surface_nodes));
    }
    Ok(())
}
