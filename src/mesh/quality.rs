//! Measures of a mesh: volumes, element quality, pieces, extent.
//!
//! In: a [`TetMesh`]. Out: numbers for `inspect` and for the checks before a factorization. The quality measure is
//! the volume over the cube of the root-mean-square edge (the inverse of Parthasarathy, Graichen and Hathaway, Finite
//! Elem. Anal. Des. 15, 1994, normalised), 1 for a regular tetrahedron and 0 for a flat one.

use super::shells;
use super::surface::{Surface, sorted_faces};
use super::tet_mesh::TetMesh;
use crate::base::disjoint::DisjointSets;
use crate::base::extent::bounding_box;
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::BTreeMap;

/// (x₁-x₀)·((x₂-x₀)×(x₃-x₀))/6, in m³.
pub fn signed_volume(corners: &[Vector3<f64>; 4]) -> f64 {
    let [a, b, c, d] = corners;
    (b - a).dot(&(c - a).cross(&(d - a))) / 6.0
}

/// q = 6·√2·V / l_rms³, with V the signed volume and l_rms the root mean square of the six edges; 0 where all
/// corners coincide. It does not depend on the unit of length.
pub fn quality(corners: &[Vector3<f64>; 4]) -> f64 {
    let [a, b, c, d] = corners;
    let edges = [b - a, c - a, d - a, c - b, d - b, d - c];
    let longest = edges.iter().map(|edge| edge.amax()).fold(0.0, f64::max);
    if longest == 0.0 {
        return 0.0;
    }
    let [ab, ac, ad, ..] = edges.map(|edge| edge / longest);
    let mean_square = edges.iter().map(|edge| (edge / longest).norm_squared()).sum::<f64>() / 6.0;
    std::f64::consts::SQRT_2 * ab.dot(&ac.cross(&ad)) / mean_square.powf(1.5)
}

/// Mean position of some nodes of `mesh`, such as a group's; `None` without nodes.
pub fn centroid(mesh: &TetMesh, nodes: &[u32]) -> Option<Vector3<f64>> {
    let &first = nodes.first()?;
    let origin = mesh.nodes[first as usize];
    let sum: Vector3<f64> = nodes.iter().map(|&node| mesh.nodes[node as usize] - origin).sum();
    Some(origin + sum / nodes.len() as f64)
}

/// The pieces of a mesh: tetrahedra that are joined through faces. Two pieces may share an edge or a node, which
/// is a hinge.
#[derive(Clone, Debug, PartialEq)]
pub struct Components {
    /// The piece of each tetrahedron, numbered from 0 in the order of their first tetrahedra.
    pub of_tet: Vec<u32>,
    /// Sorted, unique nodes of each piece.
    pub nodes: Vec<Vec<u32>>,
}

pub fn components(mesh: &TetMesh) -> Components {
    if !mesh.triangles.is_empty() {
        return Components { of_tet: Vec::new(), nodes: shells::pieces(mesh) };
    }
    let mut pieces = DisjointSets::new(mesh.tets.len());
    for same in sorted_faces(mesh).chunk_by(|a, b| a.0 == b.0) {
        for pair in same.windows(2) {
            pieces.join(pair[0].1 as u32 / 4, pair[1].1 as u32 / 4);
        }
    }
    let mut components = Components { of_tet: Vec::with_capacity(mesh.tets.len()), nodes: Vec::new() };
    for tet in 0..mesh.tets.len() {
        let first = pieces.root(tet as u32) as usize;
        if first == tet {
            components.of_tet.push(components.nodes.len() as u32);
            components.nodes.push(Vec::new());
        } else {
            components.of_tet.push(components.of_tet[first]);
        }
        let nodes = &mut components.nodes[components.of_tet[tet] as usize];
        nodes.extend(mesh.tets[tet]);
        nodes.extend(mesh.mids.get(tet).into_iter().flatten());
    }
    for nodes in &mut components.nodes {
        nodes.sort_unstable();
        nodes.dedup();
    }
    components
}

/// Faces of three or more tetrahedra, by their nodes: there the mesh overlaps itself, and its surface is not closed.
pub fn overlapping_faces(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let faces = sorted_faces(mesh);
    faces.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 2).map(|same| same[0].0).collect()
}

/// The report of `inspect` on a mesh; lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshReport {
    pub nodes: usize,
    pub tetrahedra: usize,
    pub surface_nodes: usize,
    pub surface_triangles: usize,
    pub components: usize,
    pub bounding_box: [[f64; 3]; 2],
    pub volume: f64,
    pub area: f64,
    pub regions: BTreeMap<u32, RegionReport>,
    /// Nodes of each group.
    pub groups: BTreeMap<String, usize>,
    pub quality: QualityReport,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RegionReport {
    pub name: Option<String>,
    pub tetrahedra: usize,
    pub volume: f64,
}

/// Distribution of [`quality()`] over the tetrahedra.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QualityReport {
    pub min: f64,
    pub mean: f64,
    /// Index of the tetrahedron of least quality.
    pub worst: usize,
    /// Tetrahedra with quality in [0, 0.1), [0.1, 0.2), …, [0.9, 1]; the first also counts those below 0.
    pub histogram: [usize; 10],
}

pub fn report(mesh: &TetMesh, surface: &Surface) -> MeshReport {
    let (min, max) = bounding_box(&mesh.nodes);
    let mut regions: BTreeMap<u32, RegionReport> = BTreeMap::new();
    for (tet, region) in mesh.regions.iter().enumerate() {
        let entry = regions.entry(*region).or_insert_with(|| RegionReport {
            name: mesh.region_names.get(region).cloned(),
            ..RegionReport::default()
        });
        entry.tetrahedra += 1;
        entry.volume += signed_volume(&mesh.corners(tet));
    }
    MeshReport {
        nodes: mesh.nodes.len(),
        tetrahedra: mesh.tets.len(),
        surface_nodes: surface.nodes.len(),
        surface_triangles: surface.triangles.len(),
        components: components(mesh).nodes.len(),
        bounding_box: [min.into(), max.into()],
        volume: regions.values().map(|region| region.volume).sum(),
        area: surface.area(mesh),
        regions,
        groups: mesh.groups.iter().map(|(name, nodes)| (name.clone(), nodes.len())).collect(),
        quality: quality_report(mesh),
    }
}

/// The quality of all tetrahedra; all zero for a mesh without any.
pub fn quality_report(mesh: &TetMesh) -> QualityReport {
    let mut report = QualityReport { min: f64::INFINITY, mean: 0.0, worst: 0, histogram: [0; 10] };
    for tet in 0..mesh.tets.len() {
        let q = quality(&mesh.corners(tet));
        report.histogram[((q * 10.0) as usize).min(9)] += 1;
        report.mean += q / mesh.tets.len() as f64;
        if q < report.min {
            (report.min, report.worst) = (q, tet);
        }
    }
    if mesh.tets.is_empty() {
        report.min = 0.0;
    }
    report
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    fn tetrahedron(corners: [[f64; 3]; 4]) -> [Vector3<f64>; 4] {
        corners.map(Vector3::from)
    }

    #[test]
    fn quality_of_regular_right_and_flat_tetrahedra() {
        let regular = [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]];
        assert!((quality(&tetrahedron(regular)) - 1.0).abs() < 1e-15);
        let right = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let by_hand = 6.0 * 2f64.sqrt() * (1.0 / 6.0) / 1.5f64.powf(1.5);
        assert!((quality(&tetrahedron(right)) - by_hand).abs() < 1e-15);
        let tiny = right.map(|corner| corner.map(|x| x * 1e-120));
        assert!((quality(&tetrahedron(tiny)) - by_hand).abs() < 1e-15);
        let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        assert_eq!(quality(&tetrahedron(flat)), 0.0);
        assert_eq!(quality(&[Vector3::zeros(); 4]), 0.0);
    }

    #[test]
    fn two_cubes_that_share_an_edge_are_two_components() {
        let one = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
        let mut two = one.clone();
        let shift = |node: u32| {
            let at = one.nodes[node as usize] + Vector3::new(1.0, 1.0, 0.0);
            one.nodes.iter().position(|other| (other - at).norm() < 1e-12)
        };
        let mut index: Vec<u32> = Vec::new();
        for node in 0..8 {
            index.push(shift(node).map_or(two.nodes.len() as u32, |shared| shared as u32));
            if shift(node).is_none() {
                two.nodes.push(one.nodes[node as usize] + Vector3::new(1.0, 1.0, 0.0));
            }
        }
        two.tets.extend(one.tets.iter().map(|tet| tet.map(|node| index[node as usize])));
        assert_eq!(two.nodes.len(), 14);
        let components = components(&two);
        assert_eq!(components.of_tet, [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
        assert_eq!(components.nodes[0], (0..8).collect::<Vec<u32>>());
        assert_eq!(components.nodes[1].len(), 8);
    }

    #[test]
    fn centroid_is_exact_far_from_the_origin() {
        let mut mesh = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
        mesh.nodes.iter_mut().for_each(|node| node.x += 1e9);
        let all: Vec<u32> = (0..27).collect();
        assert_eq!(centroid(&mesh, &all), Some(Vector3::new(1e9, 0.0, 0.0)));
        assert_eq!(centroid(&mesh, &[]), None);
    }

    #[test]
    fn report_of_a_block() {
        let mut mesh = block(&Block { size: [2.0, 1.0, 1.0], cells: [2, 1, 1] }).unwrap();
        mesh.regions[5..].fill(7);
        mesh.region_names.insert(7, "stiff".to_owned());
        let report = report(&mesh, &Surface::from_mesh(&mesh));
        assert_eq!((report.nodes, report.tetrahedra, report.components), (12, 10, 1));
        assert_eq!((report.surface_nodes, report.surface_triangles), (12, 20));
        assert_eq!(report.bounding_box, [[-1.0, -0.5, -0.5], [1.0, 0.5, 0.5]]);
        assert!((report.volume - 2.0).abs() < 1e-15 && (report.area - 10.0).abs() < 1e-14);
        assert_eq!(report.regions[&7].name.as_deref(), Some("stiff"));
        assert_eq!((report.regions[&0].tetrahedra, report.regions[&7].tetrahedra), (5, 5));
        assert!((report.regions[&7].volume - 1.0).abs() < 1e-15);
        assert_eq!(report.groups["xmin"], 4);
        assert_eq!(report.quality.histogram.iter().sum::<usize>(), 10);
        assert!((report.quality.min - 0.7698).abs() < 1e-4, "{}", report.quality.min);
    }

    #[test]
    fn a_face_of_three_tetrahedra_is_an_overlap() {
        let mut mesh = TetMesh { tets: vec![[0, 1, 2, 3], [0, 2, 1, 4]], ..TetMesh::default() };
        assert!(overlapping_faces(&mesh).is_empty());
        mesh.tets.push([0, 1, 2, 5]);
        assert_eq!(overlapping_faces(&mesh), [[0, 1, 2]]);
    }
}
