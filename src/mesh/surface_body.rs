//! A body that is known by its surface alone.
//!
//! In: a surface file, or a mesh of tetrahedra. Out: a [`TetMesh`] without tetrahedra, whose triangles close it; cut finer where
//! asked for.

use super::error::MeshError;
use super::length_unit::Scale;
use super::surface::Surface;
use super::surface_check::{self, SurfaceReport};
use super::surface_files::{self, LoadedSurface, TriangleSurface};
use super::tet_mesh::{LoadedMesh, TetMesh};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Largest number of triangles of a surface that boundary elements can solve.
pub const MOST_TRIANGLES: usize = 2_000_000;

/// Reads the surface file at `path`, whose coordinates become metres by `scale`. Errors where it does not bound a body.
pub fn load(path: &Path, scale: Scale) -> Result<LoadedMesh, MeshError> {
    let LoadedSurface { mut surface, mut notices } = surface_files::load(path)?;
    scale.apply(&mut surface.vertices);
    let report = surface_check::check(&mut surface, &mut notices);
    refuse(&report).map_err(|reason| MeshError::Refused { path: path.to_owned(), reason })?;
    let TriangleSurface { vertices, triangles } = surface;
    let tags = (1..=vertices.len() as u64).collect();
    Ok(LoadedMesh { mesh: TetMesh { nodes: vertices, tags, triangles, ..TetMesh::default() }, notices })
}

/// The reason why boundary elements cannot have this surface.
fn refuse(report: &SurfaceReport) -> Result<(), String> {
    let faults = report.faults();
    if !faults.is_empty() {
        return Err(format!(
            "boundary elements need a closed surface that does not pass through itself: {}. Repair it, or \
             fill it: tetrahedralise = {{ cell = … }} without method",
            faults.join("; ")
        ));
    }
    if report.flat > 0 {
        return Err(format!(
            "{} triangles have no area: remove them, or mesh the surface anew (`greenstage manual meshes`)",
            report.flat
        ));
    }
    let [low, high] = report.bounding_box.map(Vector3::from);
    if report.volume <= 1e-12 * (high - low).product() {
        return Err(format!("the surface encloses no volume ({:e} m³)", report.volume));
    }
    Ok(())
}

/// The surface of a mesh of tetrahedra, with the groups' nodes on it.
pub fn of_tetrahedra(mesh: &TetMesh) -> TetMesh {
    let Surface { triangles, nodes } = Surface::from_mesh(mesh);
    let local = |node: &u32| nodes.binary_search(node).ok().map(|at| at as u32);
    let groups = mesh.groups.iter().map(|(name, own)| (name.clone(), own.iter().filter_map(local).collect()));
    TetMesh {
        nodes: nodes.iter().map(|&node| mesh.nodes[node as usize]).collect(),
        tags: nodes.iter().map(|&node| mesh.tags[node as usize]).collect(),
        groups: groups.collect(),
        triangles,
        ..TetMesh::default()
    }
}

/// Halves every edge `times` times: each triangle becomes four.
pub fn refine(mesh: &mut TetMesh, times: u32) -> Result<(), String> {
    (0..times).try_for_each(|_| split(mesh, &|_, _| true).map(|_| ()))
}

/// Halves edges until none is longer, m.
pub fn shorten(mesh: &mut TetMesh, longest: f64) -> Result<(), String> {
    let is_long = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm() > longest;
    while split(mesh, &is_long)? {}
    Ok(())
}

/// Halves the edges for which `is_halved` returns true, and cuts their triangles; false if there was none. A group holds the new
/// nodes between two of its own.
fn split(
    mesh: &mut TetMesh,
    is_halved: &dyn Fn(&Vector3<f64>, &Vector3<f64>) -> bool,
) -> Result<bool, String> {
    let edges_of = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)]);
    let nodes = &mesh.nodes;
    let halved = |[a, b]: &[u32; 2]| is_halved(&nodes[*a as usize], &nodes[*b as usize]);
    let edges: BTreeSet<[u32; 2]> = mesh.triangles.iter().flat_map(|t| edges_of(*t)).filter(halved).collect();
    if edges.is_empty() {
        return Ok(false);
    }
    let after = mesh.triangles.len() + 2 * edges.len();
    let last = mesh.tags.iter().copied().max().unwrap_or(0).checked_add(edges.len() as u64);
    if after > MOST_TRIANGLES || last.is_none() {
        return Err(format!(
            "the surface would have {after} triangles or more, and {MOST_TRIANGLES} are possible"
        ));
    }
    let first = mesh.nodes.len() as u32;
    let middle: BTreeMap<[u32; 2], u32> = edges.iter().copied().zip(first..).collect();
    let tag = last.unwrap_or(0) - edges.len() as u64;
    mesh.tags.extend((1..=edges.len() as u64).map(|more| tag + more));
    for &[a, b] in &edges {
        mesh.nodes.push((mesh.nodes[a as usize] + mesh.nodes[b as usize]) / 2.0);
    }
    for group in mesh.groups.values_mut() {
        let is_own = |node: &u32| group.binary_search(node).is_ok();
        let more: Vec<u32> =
            middle.iter().filter(|(ends, _)| ends.iter().all(is_own)).map(|(_, &node)| node).collect();
        group.extend(more);
    }
    let (nodes, of_edge) = (&mesh.nodes, |p: u32, q: u32| middle.get(&[p.min(q), p.max(q)]).copied());
    mesh.triangles = mesh.triangles.iter().flat_map(|t| cut(nodes, *t, &of_edge)).collect();
    Ok(true)
}

/// The parts of a triangle, some of whose edges are halved.
fn cut(
    nodes: &[Vector3<f64>],
    [a, b, c]: [u32; 3],
    middle: &dyn Fn(u32, u32) -> Option<u32>,
) -> Vec<[u32; 3]> {
    let length = |p: u32, q: u32| (nodes[p as usize] - nodes[q as usize]).norm_squared();
    match [middle(a, b), middle(b, c), middle(c, a)] {
        [None, None, None] => vec![[a, b, c]],
        [Some(m), None, None] => vec![[a, m, c], [m, b, c]],
        // Turned so that ab is whole or, where all are halved, as they are.
        [None, Some(m), None] => vec![[b, m, a], [m, c, a]],
        [None, None, Some(m)] => vec![[c, m, b], [m, a, b]],
        [Some(ab), Some(bc), Some(ca)] => vec![[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]],
        [None, Some(bc), Some(ca)] => quarter([a, b, c], bc, ca, &length),
        [Some(ab), None, Some(ca)] => quarter([b, c, a], ca, ab, &length),
        [Some(ab), Some(bc), None] => quarter([c, a, b], ab, bc, &length),
    }
}

/// Cuts a triangle whose edge from the first to the second corner is whole; the four corners behind are cut along the shorter
/// diagonal.
fn quarter([a, b, c]: [u32; 3], bc: u32, ca: u32, length: &dyn Fn(u32, u32) -> f64) -> Vec<[u32; 3]> {
    let tip = [ca, bc, c];
    if length(a, bc) <= length(b, ca) {
        vec![tip, [a, b, bc], [a, bc, ca]]
    } else {
        vec![tip, [a, b, ca], [b, bc, ca]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    fn cube(side: f64, cells: u32) -> TetMesh {
        of_tetrahedra(&block(&Block { size: [side; 3], cells: [cells; 3] }).unwrap())
    }

    fn area_and_volume(mesh: &TetMesh) -> [f64; 2] {
        let surface = Surface::from_mesh(mesh);
        [surface.area(mesh), surface.volume(mesh)]
    }

    #[test]
    fn the_surface_of_a_cube_keeps_its_area_volume_and_groups_when_it_is_cut() {
        let mut mesh = cube(2.0, 3);
        assert_eq!((mesh.nodes.len(), mesh.triangles.len(), mesh.groups["xmin"].len()), (56, 108, 16));
        refine(&mut mesh, 1).unwrap();
        assert_eq!((mesh.nodes.len(), mesh.triangles.len(), mesh.groups["xmin"].len()), (218, 432, 49));
        let longest = |mesh: &TetMesh| {
            let lengths = mesh.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
            lengths.map(|[a, b]| (mesh.nodes[a as usize] - mesh.nodes[b as usize]).norm()).fold(0.0, f64::max)
        };
        shorten(&mut mesh, 0.4).unwrap();
        assert!(longest(&mesh) <= 0.4 && mesh.triangles.len() < 4 * 432);
        let [area, volume] = area_and_volume(&mesh);
        assert!((area - 24.0).abs() < 1e-12 && (volume - 8.0).abs() < 1e-12, "{area} {volume}");
        let mut tags = mesh.tags.clone();
        tags.sort_unstable();
        tags.dedup();
        assert_eq!(tags.len(), mesh.nodes.len());
        let low = |node: &u32| mesh.nodes[*node as usize].x < -1.0 + 1e-12;
        assert_eq!(mesh.groups["xmin"], (0..mesh.nodes.len() as u32).filter(low).collect::<Vec<_>>());
    }
}
