//! Fills a closed triangle surface with tetrahedra.
//!
//! In: a surface file and the size of a cell. Out: a [`LoadedMesh`] tetrahedral mesh by isosurface stuffing
//! ([`core`]), with notices of what was repaired in the surface, of the volume lost, and of features that the cells
//! are too coarse for.

pub mod core;
pub mod lattice;

use super::diagnostics::{digits, place};
use super::error::MeshError;
use super::generate::MEMORY;
use super::length_unit::Scale;
use super::quality;
use super::surface::Surface;
use super::surface_check::{SurfaceReport, check};
use super::surface_files::{self, LoadedSurface, TriangleSurface};
use super::tet_mesh::{LoadedMesh, TetMesh};
use crate::base::extent::bounding_box;
use crate::base::machine;
use crate::base::table::count;
use lattice::{Depth, Distance, Lattice};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::path::Path;

/// Largest number of tetrahedra that is not refused.
pub const MAX_TETRAHEDRA: f64 = 20e6;
/// Largest number of lattice vertices, inside and outside, that is not refused.
pub(super) const MAX_VERTICES: usize = 40_000_000;
/// A piece with less than this part of the volume is a leftover of a thin place and is removed.
const CRUMB: f64 = 1e-3;

/// The cell that is suggested for a surface: a thirtieth of its longest extent, of two digits.
pub fn suggested_cell(surface: &TriangleSurface) -> f64 {
    let (low, high) = bounding_box(&surface.vertices);
    let cell = (high - low).amax() / 30.0;
    format!("{cell:.1e}").parse().unwrap_or(cell)
}

/// Reads the surface file at `path`, whose coordinates become metres by `scale`, and fills it with tetrahedra of `cell`
/// metres.
pub fn load(path: &Path, scale: Scale, cell: f64) -> Result<LoadedMesh, MeshError> {
    let LoadedSurface { mut surface, mut notices } = surface_files::load(path)?;
    scale.apply(&mut surface.vertices);
    let report = check(&mut surface, &mut notices);
    let refused = |reason| MeshError::Refused { path: path.to_owned(), reason };
    let mesh = tetrahedralise(&surface, &report, cell, &mut notices).map_err(refused)?;
    Ok(LoadedMesh { mesh, notices })
}

/// Fills a surface that was checked. The error says what to do instead.
pub fn tetrahedralise(
    surface: &TriangleSurface,
    report: &SurfaceReport,
    cell: f64,
    notices: &mut Vec<String>,
) -> Result<TetMesh, String> {
    let mesh = filled(surface, report, cell, notices)?;
    if mesh.tets.is_empty() {
        return Err(format!(
            "its walls are thinner than the cells of {cell} m. Take cell = {:.1e}",
            cell / 3.0
        ));
    }
    Ok(mesh)
}

/// Fills the surface; the mesh has no tetrahedron where all walls are thinner than the cells.
pub fn filled(
    surface: &TriangleSurface,
    report: &SurfaceReport,
    cell: f64,
    notices: &mut Vec<String>,
) -> Result<TetMesh, String> {
    let lattice = refuse(surface, report, cell)?;
    notices.extend(report.faults().into_iter().map(|fault| format!("the surface has a fault: {fault}")));
    let depth = Depth::new(surface).map_err(|reason| format!("the surface cannot be used: {reason}"))?;
    let mut values: Vec<f64> = (0..lattice.vertices())
        .into_par_iter()
        .with_min_len(256)
        .map(|vertex| depth.at(&lattice.position(lattice.coordinates(vertex))))
        .collect();
    notices.extend(core::agree(&lattice, &mut values)?);
    let mut mesh = fill(&lattice, &values, |at| depth.at(at));
    if mesh.tets.is_empty() {
        return Ok(mesh);
    }
    let pieces = drop_crumbs(&mut mesh, notices);
    told(surface, report, &mesh, cell, pieces, notices);
    Ok(mesh)
}

/// Tetrahedra where `depth` is positive; `values` are the depths of the lattice's vertices.
pub fn fill(lattice: &Lattice, values: &[f64], depth: impl Fn(&Vector3<f64>) -> f64 + Sync) -> TetMesh {
    let cut = |from: [i64; 3], to: [i64; 3]| {
        let (from, to) = (lattice.position(from), lattice.position(to));
        root(|t| depth(&from.lerp(&to, t)))
    };
    let (nodes, tets) = core::stuff(lattice, values, cut);
    TetMesh {
        tags: (1..=nodes.len() as u64).collect(),
        regions: vec![0; tets.len()],
        nodes,
        tets,
        ..TetMesh::default()
    }
}

/// The lattice, or why the surface cannot be filled.
fn refuse(surface: &TriangleSurface, report: &SurfaceReport, cell: f64) -> Result<Lattice, String> {
    let suggested = suggested_cell(surface);
    if !(cell > 0.0 && cell.is_finite()) {
        return Err(format!("cell is {cell} m: a positive length is needed, such as {suggested:e}"));
    }
    if !report.is_closed() {
        return Err(format!(
            "the surface is not closed: {}. Close it where it was made, or repair it (`greenstage manual \
             meshes`)",
            report.faults().join("; ")
        ));
    }
    let (low, high) = bounding_box(&surface.vertices);
    let extent = high - low;
    if report.volume <= 1e-12 * extent.product() {
        return Err(format!("the surface encloses no volume ({:e} m³)", report.volume));
    }
    if cell > extent.min() {
        return Err(format!(
            "a cell of {cell} m is larger than the body, {} m × {} m × {} m: take cell = {:.1e} or less",
            extent.x,
            extent.y,
            extent.z,
            suggested.min(extent.min() / 3.0)
        ));
    }
    let tetrahedra = 12.0 * report.volume / cell.powi(3);
    let least = |most: f64, volume: f64| (volume * 12.0 / most).cbrt();
    if tetrahedra > MAX_TETRAHEDRA {
        return Err(format!(
            "cell = {cell} makes about {tetrahedra:.1e} tetrahedra, more than {MAX_TETRAHEDRA:.0e}: take {:.1e} or more",
            1.05 * least(MAX_TETRAHEDRA, report.volume)
        ));
    }
    machine::expect(format!("a mesh of about {tetrahedra:.1e} tetrahedra"), MEMORY * tetrahedra)
        .map_err(|refusal| format!("{refusal}: take a larger cell"))?;
    Lattice::around(&low, &high, cell, MAX_VERTICES).ok_or_else(|| {
        format!(
            "the lattice of cell {cell} m about the body has more than {MAX_VERTICES} vertices: take cell = {:.1e} or \
             more",
            1.1 * (2.0 * extent.product() / MAX_VERTICES as f64).cbrt().max(extent.amax() / 1e6)
        )
    })
}

/// A zero between 0, where `f` is positive, and 1, where it is negative: false position with the Illinois weights
/// (Dowell and Jarratt, BIT 11, 1971), to 1e-9.
fn root(f: impl Fn(f64) -> f64) -> f64 {
    let (mut a, mut b) = (0.0, 1.0);
    let (mut fa, mut fb) = (f(a), f(b));
    for _ in 0..40 {
        if !(fa > 0.0 && fb < 0.0) || b - a < 1e-9 {
            break;
        }
        let t = (a * fb - b * fa) / (fb - fa);
        let ft = f(t);
        if ft == 0.0 {
            return t;
        } else if ft > 0.0 {
            (a, fa) = (t, ft);
            fb /= 2.0;
        } else {
            (b, fb) = (t, ft);
            fa /= 2.0;
        }
        if ft.abs() < 1e-12 * (fa - fb) {
            return t;
        }
    }
    (a + b) / 2.0
}

/// Removes isolated pieces with almost no volume. Returns how many pieces stay.
pub(super) fn drop_crumbs(mesh: &mut TetMesh, notices: &mut Vec<String>) -> usize {
    let components = quality::components(mesh);
    let mut volumes = vec![0.0; components.nodes.len()];
    for (tet, &piece) in components.of_tet.iter().enumerate() {
        volumes[piece as usize] += quality::signed_volume(&mesh.corners(tet));
    }
    let all: f64 = volumes.iter().sum();
    let is_crumb = |piece: u32| volumes[piece as usize] < CRUMB * all;
    let crumbs = (0..volumes.len() as u32).filter(|&piece| is_crumb(piece)).count();
    if crumbs == 0 {
        return volumes.len();
    }
    let lost: f64 = volumes.iter().filter(|volume| **volume < CRUMB * all).sum();
    notices.push(format!(
        "{crumbs} pieces that hang on nothing, {:.2e} of the volume together, were left out: the body is thinner than \
         a cell there",
        lost / all
    ));
    let mut kept = components.of_tet.iter().map(|&piece| !is_crumb(piece));
    mesh.tets.retain(|_| kept.next().unwrap_or(true));
    mesh.regions.truncate(mesh.tets.len());
    let mut index = vec![u32::MAX; mesh.nodes.len()];
    mesh.tets.iter().flatten().for_each(|&node| index[node as usize] = 0);
    let mut nodes = Vec::new();
    for (node, index) in mesh.nodes.iter().zip(&mut index).filter(|(_, index)| **index == 0) {
        *index = nodes.len() as u32;
        nodes.push(*node);
    }
    mesh.tets.iter_mut().flatten().for_each(|node| *node = index[*node as usize]);
    mesh.tags.truncate(nodes.len());
    mesh.nodes = nodes;
    volumes.len() - crumbs
}

/// Notices on how the mesh differs from the surface.
fn told(
    surface: &TriangleSurface,
    report: &SurfaceReport,
    mesh: &TetMesh,
    cell: f64,
    pieces: usize,
    notices: &mut Vec<String>,
) {
    let boundary = Surface::from_mesh(mesh);
    let volume = boundary.volume(mesh);
    notices.push(format!(
        "{} tetrahedra of cell {cell} m; volume {volume:.6e} m³ against {:.6e} m³ of the surface ({:+.2} %)",
        mesh.tets.len(),
        report.volume,
        100.0 * (volume / report.volume - 1.0)
    ));
    let bodies = report.shells.iter().filter(|shell| !shell.is_cavity).count();
    if pieces != bodies {
        notices.push(format!(
            "the surface has {}, the mesh {}: where they are joined or torn, it is thinner than a cell",
            if bodies == 1 { "one body".to_owned() } else { format!("{bodies} bodies") },
            count(pieces, "piece")
        ));
    }
    if let Some((distance, at, count)) = deviation(surface, mesh, &boundary, cell / 2.0) {
        notices.push(format!(
            "{count} vertices of the surface are off the mesh by over half a cell, at most {} m at {}: fine \
             features are lost",
            digits(distance),
            place(&at)
        ));
    }
}

/// The vertex of the surface that is furthest from the mesh, how far, and how many are further than `bound`.
fn deviation(
    surface: &TriangleSurface,
    mesh: &TetMesh,
    boundary: &Surface,
    bound: f64,
) -> Option<(f64, Vector3<f64>, usize)> {
    let nodes: Vec<_> = boundary.nodes.iter().map(|&node| mesh.nodes[node as usize]).collect();
    let distance = Distance::new(&nodes, boundary.triangles.clone()).ok()?;
    let distances: Vec<f64> = surface.vertices.par_iter().map(|vertex| distance.at(vertex)).collect();
    let count = distances.iter().filter(|&&d| d > bound).count();
    let furthest = (0..distances.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b]))?;
    (count > 0).then(|| (distances[furthest], surface.vertices[furthest], count))
}
