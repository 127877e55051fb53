//! The cell with which a surface file is filled, so that the body has enough nodes to bend well and few enough to be
//! solved in seconds.
//!
//! In: a surface file. Out: its mesh, and the cell.

use super::doubt::{ProposalError, plausible};
use super::wishes::Wishes;
use crate::mesh::isosurface_stuffing::tetrahedralise;
use crate::mesh::length_unit::Scale;
use crate::mesh::surface_files::{self, LoadedSurface};
use crate::mesh::{Loaded, MeshError, TetMesh, quality, surface_check};
use std::path::Path;

/// A surface that was filled.
pub struct Filled {
    pub loaded: Loaded,
    pub cell: f64,
}

/// Nodes that are aimed at, and those that are good enough.
const NODES: f64 = 14_000.0;
const ENOUGH: std::ops::RangeInclusive<f64> = 10_000.0..=20_000.0;
/// Trials, after the first.
const TRIALS: usize = 3;

/// Reads the surface at `file` and fills it; asks back which unit it is in.
pub fn fill(file: &Path, wishes: &Wishes) -> Result<Filled, ProposalError> {
    let LoadedSurface { mut surface, mut notices } = surface_files::load(file)?;
    let (low, high) = quality::bounding_box(&surface.vertices);
    plausible(file, (high - low).amax(), wishes.asked_scale())?;
    wishes.asked_scale().unwrap_or(Scale::ONE).apply(&mut surface.vertices);
    let report = surface_check::check(&mut surface, &mut notices);
    let filled = |cell: f64| -> Result<(TetMesh, Vec<String>), MeshError> {
        let mut told = notices.clone();
        let mesh = tetrahedralise(&surface, &report, cell, &mut told)
            .map_err(|reason| MeshError::Refused { path: file.to_owned(), reason })?;
        Ok((mesh, told))
    };
    let mut cell =
        wishes.cell.unwrap_or_else(|| two_digits(first_cell(report.volume, report.area, &(high - low))));
    let (mut mesh, mut told) = filled(cell)?;
    for _ in 0..if wishes.cell.is_some() { 0 } else { TRIALS } {
        let nodes = mesh.nodes.len() as f64;
        if ENOUGH.contains(&nodes) {
            break;
        }
        let next = two_digits(cell * (nodes / NODES).cbrt());
        if next == cell {
            break;
        }
        cell = next;
        (mesh, told) = filled(cell)?;
    }
    Ok(Filled { loaded: Loaded { mesh, notices: told }, cell })
}

/// For about [`NODES`]: two nodes in each cell of the lattice inside, and about two on each cell of the surface. Of an open
/// surface any cell does, because it is refused.
fn first_cell(volume: f64, area: f64, sides: &nalgebra::Vector3<f64>) -> f64 {
    let nodes = |cell: f64| 2.0 * volume / cell.powi(3) + 2.0 * area / (cell * cell);
    let (mut fine, mut coarse) = (sides.amax() * 1e-4, sides.amax());
    for _ in 0..60 {
        let middle = (fine * coarse).sqrt();
        if nodes(middle) > NODES { fine = middle } else { coarse = middle }
    }
    coarse.min(sides.min() / 2.0).max(sides.amax() * 1e-4)
}

fn two_digits(cell: f64) -> f64 {
    format!("{cell:.1e}").parse().unwrap_or(cell)
}
