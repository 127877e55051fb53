//! The cell with which a surface file is filled, so that the body has enough nodes to bend well, few enough to be solved in
//! seconds, and two cells through its thinnest walls.
//!
//! In: a surface file. Out: its mesh, the cell, and the thickness of the walls.

use super::doubt::{ProposalError, plausible};
use super::wishes::Wishes;
use crate::mesh::isosurface_stuffing::tetrahedralise;
use crate::mesh::length_unit::Scale;
use crate::mesh::surface_files::{self, LoadedSurface};
use crate::mesh::walls::wall_thickness;
use crate::mesh::{Loaded, MeshError, TetMesh, quality, surface_check};
use std::path::Path;

/// A surface that was filled.
pub struct Filled {
    pub loaded: Loaded,
    pub cell: f64,
    /// Of the thinnest walls, m, where there are any.
    pub wall: Option<f64>,
}

/// Nodes that are aimed at for shapes, and for forces, where each cell has ten nodes.
const NODES: [f64; 2] = [14_000.0, 2_500.0];
/// The part of the aim from which, and up to which, the number of nodes is good enough.
const ENOUGH: [f64; 2] = [0.7, 1.45];
/// Thin walls make more nodes, up to this many times the aim.
const MOST: f64 = 4.0;
/// Cells through the thinnest walls, which are those under this part of the surface.
const CELLS: f64 = 2.0;
const THINNEST: f64 = 0.05;
/// Trials.
const TRIALS: usize = 6;

/// Reads the surface at `file` and fills it; asks back which unit it is in where it would be more than `largest` m long.
pub fn fill(file: &Path, largest: f64, wishes: &Wishes) -> Result<Filled, ProposalError> {
    let LoadedSurface { mut surface, mut notices } = surface_files::load(file)?;
    let extent = |(low, high)| -> f64 { nalgebra::Vector3::amax(&(high - low)) };
    plausible(file, extent(quality::bounding_box(&surface.vertices)), largest, wishes.asked_scale())?;
    wishes.asked_scale().unwrap_or(Scale::ONE).apply(&mut surface.vertices);
    let report = surface_check::check(&mut surface, &mut notices);
    let filled = |cell: f64| -> Result<(TetMesh, Vec<String>), MeshError> {
        let mut told = notices.clone();
        let mesh = tetrahedralise(&surface, &report, cell, &mut told)
            .map_err(|reason| MeshError::Refused { path: file.to_owned(), reason })?;
        Ok((mesh, told))
    };
    let wall = wall_thickness(&surface, THINNEST);
    let result = |cell, (mesh, notices)| Filled { loaded: Loaded { mesh, notices }, cell, wall };
    if let Some(cell) = wishes.cell {
        return Ok(result(cell, filled(cell)?));
    }
    let (low, high) = quality::bounding_box(&surface.vertices);
    let of = |nodes: f64| cell_for(nodes, report.volume, report.area, &(high - low));
    let aim = NODES[usize::from(wishes.pull_m.is_some())];
    let coarsest = wall.map_or(f64::INFINITY, |wall| wall / CELLS).max(of(MOST * aim));
    let mut cell = two_digits(of(aim).min(coarsest));
    let mut best = filled(cell);
    for _ in 1..TRIALS {
        let next = match &best {
            Ok((mesh, _)) => {
                let nodes = mesh.nodes.len() as f64;
                if (ENOUGH[0] * aim..=ENOUGH[1] * aim).contains(&nodes) {
                    break;
                }
                two_digits((cell * (nodes / aim).cbrt()).min(coarsest))
            }
            Err(_) => two_digits(cell / 2.0),
        };
        if next == cell {
            break;
        }
        match filled(next) {
            // What was filled once is better than nothing.
            Err(_) if best.is_ok() => break,
            Err(_) => {}
            filled => best = filled,
        }
        cell = next;
    }
    Ok(result(cell, best?))
}

/// The cell for about so many nodes: two nodes in each cell of the lattice inside, and about two on each cell of the surface. Of
/// an open surface any cell does, because it is refused.
fn cell_for(wanted: f64, volume: f64, area: f64, sides: &nalgebra::Vector3<f64>) -> f64 {
    let nodes = |cell: f64| 2.0 * volume / cell.powi(3) + 2.0 * area / (cell * cell);
    let (mut fine, mut coarse) = (sides.amax() * 1e-4, sides.amax());
    for _ in 0..60 {
        let middle = (fine * coarse).sqrt();
        if nodes(middle) > wanted { fine = middle } else { coarse = middle }
    }
    coarse.min(sides.min() / 2.0).max(sides.amax() * 1e-4)
}

fn two_digits(cell: f64) -> f64 {
    format!("{cell:.1e}").parse().unwrap_or(cell)
}
