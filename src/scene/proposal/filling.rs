//! The cell with which a surface file is filled, so that the body has enough nodes to bend well, few enough to be solved soon,
//! two cells through its thinnest walls, and is not torn.
//!
//! In: a surface file. Out: its mesh, the cell, and the thickness of the walls.

use super::doubt::{ProposalError, plausible};
use super::wishes::Wishes;
use crate::base::extent::bounding_box;
use crate::base::table::count;
use crate::mesh::diagnostics::digits;
use crate::mesh::isosurface_stuffing::filled;
use crate::mesh::length_unit::Scale;
use crate::mesh::surface_check::{self, SurfaceReport};
use crate::mesh::surface_files::{self, LoadedSurface, TriangleSurface};
use crate::mesh::walls::wall_thickness;
use crate::mesh::{LoadedMesh, MeshError, TetMesh, quality};
use nalgebra::Vector3;
use std::path::Path;

/// A surface that was filled.
pub struct FilledSurface {
    pub loaded: LoadedMesh,
    pub cell: f64,
    /// Thickness of the thinnest walls, m, where there are any.
    pub wall: Option<f64>,
}

/// Nodes that are aimed at for shapes, and for forces, where each cell has ten nodes.
const NODES: [f64; 2] = [14_000.0, 2_500.0];
/// The part of the aim from which, and up to which, the number of nodes is good enough.
const ENOUGH: [f64; 2] = [0.7, 1.45];
/// Thin walls make more nodes, up to about so many, which are solved in a minute.
const MOST: f64 = 250_000.0;
/// Cells through the thinnest walls, which are those under this part of the surface.
const CELLS: f64 = 2.0;
const THINNEST: f64 = 0.05;
/// The part of the volume that a whole body has lost or gained at most.
const LOST: f64 = 0.05;
/// Factor by which the next cell is smaller than one that tore the body.
const FINER: f64 = 1.4;
/// Largest number of trials.
const TRIALS: usize = 8;

/// A surface that is filled by trial.
struct Trial<'a> {
    file: &'a Path,
    surface: TriangleSurface,
    report: SurfaceReport,
    notices: Vec<String>,
    wall: Option<f64>,
}

/// The body that one cell made.
struct FilledCell {
    cell: f64,
    loaded: LoadedMesh,
    /// Difference from the surface, in words, where the body is torn.
    tear: Option<String>,
}

/// Reads the surface at `file` and fills it; asks back which unit it is in where it would be more than `largest` m long. Errors
/// where the walls need too many nodes, and where the body is torn.
pub fn fill(file: &Path, largest: f64, wishes: &Wishes) -> Result<FilledSurface, ProposalError> {
    let LoadedSurface { mut surface, mut notices } = surface_files::load(file)?;
    let extent = |(low, high)| -> f64 { Vector3::amax(&(high - low)) };
    plausible(file, extent(bounding_box(&surface.vertices)), largest, wishes.asked_scale())?;
    wishes.asked_scale().unwrap_or(Scale::ONE).apply(&mut surface.vertices);
    let report = surface_check::check(&mut surface, &mut notices);
    let wall = wall_thickness(&surface, THINNEST);
    let trial = Trial { file, surface, report, notices, wall };
    let made = match wishes.cell {
        Some(cell) => trial.make(cell)?,
        None => trial.best(NODES[usize::from(wishes.pull_m.is_some())])?,
    };
    if let Some(tear) = &made.tear {
        return Err(trial.torn(made.cell, tear).into());
    }
    Ok(FilledSurface { loaded: made.loaded, cell: made.cell, wall })
}

impl Trial<'_> {
    /// The coarsest cell that resolves the walls and comes near `aim` nodes, or a finer one where that tears the body.
    fn best(&self, aim: f64) -> Result<FilledCell, MeshError> {
        let (finest, coarsest) = (self.cell_for(MOST), self.coarsest());
        if self.report.is_closed() && coarsest > 0.0 && CELLS * coarsest < finest {
            return Err(self.too_thin(coarsest));
        }
        let mut best = self.make(two_digits(self.cell_for(aim).min(coarsest).max(finest)))?;
        for _ in 1..TRIALS {
            let nodes = best.loaded.mesh.nodes.len() as f64;
            let next = match best.tear {
                Some(_) => (best.cell / FINER).max(finest),
                None if (ENOUGH[0] * aim..=ENOUGH[1] * aim).contains(&nodes) => break,
                None => (best.cell * (nodes / aim).cbrt()).min(coarsest).max(finest),
            };
            let next = two_digits(next);
            if next == best.cell {
                break;
            }
            let made = self.make(next)?;
            if best.tear.is_none() && made.tear.is_some() {
                break;
            }
            best = made;
        }
        Ok(best)
    }

    fn make(&self, cell: f64) -> Result<FilledCell, MeshError> {
        let mut notices = self.notices.clone();
        let mesh =
            filled(&self.surface, &self.report, cell, &mut notices).map_err(|reason| self.refused(reason))?;
        let tear = self.tear(&mesh);
        Ok(FilledCell { cell, loaded: LoadedMesh { mesh, notices }, tear })
    }

    /// A whole body has no more pieces than the surface, and its volume; what overlaps is counted twice in the surface's.
    fn tear(&self, mesh: &TetMesh) -> Option<String> {
        let bodies = self.report.shells.iter().filter(|shell| !shell.is_cavity).count();
        let pieces = quality::components(mesh).nodes.len();
        let volume: f64 = (0..mesh.tets.len()).map(|tet| quality::signed_volume(&mesh.corners(tet))).sum();
        let off = volume / self.report.volume - 1.0;
        let is_off = off.abs() > LOST && self.report.intersections.pairs == 0;
        (pieces > bodies || is_off)
            .then(|| format!("{}, {:.0} % of its volume", count(pieces, "piece"), 100.0 * (1.0 + off)))
    }

    /// The error of a torn body, with the cell that is worth a try.
    fn torn(&self, cell: f64, tear: &str) -> MeshError {
        let finer = two_digits(self.coarsest().min(cell / FINER));
        let thin = |wall: f64| format!("; its thinnest walls are {} m", digits(wall));
        let walls = self.wall.map_or_else(String::new, thin);
        let nodes = about(self.nodes_for(finer));
        self.refused(format!(
            "cells of {cell} m tear it: {tear}{walls}. Retry with --cell {finer:.1e} (about {nodes} nodes)"
        ))
    }

    /// The error of walls that need this cell, which makes too many nodes.
    fn too_thin(&self, cell: f64) -> MeshError {
        let (nodes, most) = (about(self.nodes_for(cell)), about(MOST));
        self.refused(format!(
            "its thinnest walls ({} m) need cells of {cell:.1e} m and about {nodes} nodes, at most {most} \
             are made. Thicken them, or give a larger --cell",
            digits(CELLS * cell)
        ))
    }

    fn refused(&self, reason: String) -> MeshError {
        MeshError::Refused { path: self.file.to_owned(), reason }
    }

    /// Estimates the number of nodes that a cell makes: two in each cell of the lattice inside, and two on each cell of the surface.
    fn nodes_for(&self, cell: f64) -> f64 {
        2.0 * self.report.volume / cell.powi(3) + 2.0 * self.report.area / (cell * cell)
    }

    /// The cell for about so many nodes.
    fn cell_for(&self, nodes: f64) -> f64 {
        let longest = self.sides().amax();
        let (mut fine, mut coarse) = (longest * 1e-4, longest);
        for _ in 0..60 {
            let middle = (fine * coarse).sqrt();
            if self.nodes_for(middle) > nodes { fine = middle } else { coarse = middle }
        }
        coarse
    }

    /// The coarsest cell that resolves the walls, or the body where it has none.
    fn coarsest(&self) -> f64 {
        self.wall.unwrap_or(f64::INFINITY).min(self.sides().min()) / CELLS
    }

    fn sides(&self) -> Vector3<f64> {
        let (low, high) = bounding_box(&self.surface.vertices);
        high - low
    }
}

/// A number of nodes in words.
pub fn about(nodes: f64) -> String {
    match nodes {
        few if few < 1e6 => format!("{:.0} thousand", 1e-3 * few),
        many => format!("{:.0} million", 1e-6 * many),
    }
}

fn two_digits(cell: f64) -> f64 {
    format!("{cell:.1e}").parse().unwrap_or(cell)
}
