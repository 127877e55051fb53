//! Finds defects of a mesh that could be read. A Cholesky factorization would accept most of them silently.
//!
//! In: a [`TetMesh`]. Out: one [`Diagnostic`] for each kind of defect, the most severe first, with places, the tags of
//! some nodes, and what to do. All measures are relative: a body gives the same sentences in metres and in nanometres.

use super::quadratic;
use super::quality::{Components, components, overlapping_faces, quality};
use super::surface::sorted_faces;
use super::tet_mesh::{FACES, TetMesh};
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::extent::bounding_box;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// A tetrahedron whose [`quality()`] is less is a sliver.
pub const SLIVER: f64 = 1e-3;
/// A tetrahedron whose [`quality()`] is less is flat: rounding of its coordinates decides its stiffness.
pub const FLAT: f64 = 1e-10;
/// Nodes coincide where their distance is a smaller part of the body's extent.
pub const COINCIDENT: f64 = 1e-9;
/// Extent over distance from the origin below which the file's coordinates have lost digits.
pub const FAR: f64 = 1e-6;
/// Extents, m, whose areas and coefficients single precision can hold.
pub const EXTENT: [f64; 2] = [1e-14, 1e12];

/// Finds everything that is wrong, the most severe first; empty for a sound mesh.
pub fn find(mesh: &TetMesh) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    let mut say = |severity, message: String| found.push(Diagnostic::new(severity, "", message));
    elements(mesh, &mut say);
    curved(mesh, &mut say);
    overlaps(mesh, &mut say);
    joints(mesh, &mut say);
    let (low, high) = bounding_box(&mesh.nodes);
    let (extent, offset) = ((high - low).norm(), ((high + low) * 0.5).norm());
    if !(EXTENT[0]..=EXTENT[1]).contains(&extent) {
        let message = format!(
            "the body spans {extent:.1e} m, and only bodies of {:.0e} to {:.0e} m can be drawn; check the mesh's unit",
            EXTENT[0], EXTENT[1]
        );
        say(Severity::Error, message);
    }
    if extent < FAR * offset {
        let message = format!(
            "the body of {} m lies {} m from its origin: its coordinates have about {:.0} digits left. Move \
             it to the origin",
            digits(extent),
            digits(offset),
            (16.0 - (offset / extent).log10()).max(0.0)
        );
        say(Severity::Warning, message);
    }
    found.sort_by_key(|found| found.severity);
    found
}

/// Tetrahedra without volume, and slivers.
fn elements(mesh: &TetMesh, say: &mut impl FnMut(Severity, String)) {
    let mut poor: Vec<(f64, u32)> = (0..mesh.tets.len() as u32)
        .map(|tet| (quality(&mesh.corners(tet as usize)), tet))
        .filter(|(quality, _)| *quality < SLIVER)
        .collect();
    poor.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (flat, slivers) = poor.split_at(poor.partition_point(|(quality, _)| *quality < FLAT));
    let list = |part: &[(f64, u32)]| tetrahedra(mesh, &part.iter().map(|(_, tet)| *tet).collect::<Vec<_>>());
    if !flat.is_empty() {
        let message = format!(
            "{} tetrahedra have no volume (quality below {FLAT:e}): {}; remove them, or mesh this place anew",
            flat.len(),
            list(flat)
        );
        say(Severity::Error, message);
    }
    if let Some((worst, _)) = slivers.first() {
        let message = format!(
            "{} slivers (quality below {SLIVER}, the worst {worst:.1e}): {}. Their stresses mean nothing",
            slivers.len(),
            list(slivers)
        );
        say(Severity::Warning, message);
    }
}

/// Quadratic tetrahedra that are folded by their curved edges.
fn curved(mesh: &TetMesh, say: &mut impl FnMut(Severity, String)) {
    let is_folded = |tet: &u32| {
        let least = quadratic::least_jacobian(mesh, *tet as usize);
        least < FLAT || least.is_nan()
    };
    let folded: Vec<u32> = (0..mesh.mids.len() as u32).filter(is_folded).collect();
    if !folded.is_empty() {
        let message = format!(
            "{} quadratic tetrahedra are folded by their curved edges: {}. Move their mid-side nodes, or \
             take element = \"tet4\"",
            folded.len(),
            tetrahedra(mesh, &folded)
        );
        say(Severity::Error, message);
    }
}

/// Finds places where the mesh overlaps itself.
fn overlaps(mesh: &TetMesh, say: &mut impl FnMut(Severity, String)) {
    let folded: Vec<u32> =
        folded_pairs(mesh).into_iter().flatten().collect::<BTreeSet<u32>>().into_iter().collect();
    if !folded.is_empty() {
        let message = format!(
            "the mesh is folded: {} tetrahedra lie on the wrong side of a face they share: {}. Mesh this \
             place anew",
            folded.len(),
            tetrahedra(mesh, &folded)
        );
        say(Severity::Error, message);
    }
    let crowded = overlapping_faces(mesh);
    if let Some(face) = crowded.first() {
        let message = format!(
            "{} faces belong to three or more tetrahedra (the first has nodes with tags {:?}). Remove the \
             doubled elements",
            crowded.len(),
            tags(mesh, face)
        );
        say(Severity::Error, message);
    }
}

/// Pieces, hinges between them, and layers of nodes that were never merged.
fn joints(mesh: &TetMesh, say: &mut impl FnMut(Severity, String)) {
    let coincident = coincident_nodes(mesh);
    if let Some(pair) = coincident.first() {
        let [a, b] = tags(mesh, pair);
        let message = format!(
            "{} pairs of nodes lie at the same place (the first: tags {a} and {b} at {}), and the body gapes \
             there. Merge them (gmsh: Coherence Mesh)",
            coincident.len(),
            place(&mesh.nodes[pair[0] as usize])
        );
        say(Severity::Warning, message);
    }
    let pieces = components(mesh);
    if pieces.nodes.len() > 1 {
        let message = format!("{} pieces that share no face: hold each, or join them", pieces.nodes.len());
        say(Severity::Note, message);
    }
    let hinges = hinges(mesh, &pieces);
    if let Some(&first) = hinges.first() {
        let message = format!(
            "pieces touch in {} nodes without sharing a face there, which is a hinge (the first has tag {})",
            hinges.len(),
            mesh.tags[first as usize]
        );
        say(Severity::Warning, message);
    }
}

fn tags<const N: usize>(mesh: &TetMesh, nodes: &[u32; N]) -> [u64; N] {
    nodes.map(|node| mesh.tags[node as usize])
}

/// Names the first few of the tetrahedra `tets` by the tags of their nodes and their place.
fn tetrahedra(mesh: &TetMesh, tets: &[u32]) -> String {
    let name = |&tet: &u32| {
        let centre: Vector3<f64> = mesh.corners(tet as usize).iter().sum::<Vector3<f64>>() / 4.0;
        format!("nodes {:?} near {}", tags(mesh, &mesh.tets[tet as usize]), place(&centre))
    };
    let mut list: Vec<String> = tets.iter().take(3).map(name).collect();
    if tets.len() > 3 {
        list.push("…".into());
    }
    list.join("; ")
}

/// A point, as messages write it.
pub fn place(x: &Vector3<f64>) -> String {
    format!("({}, {}, {}) m", digits(x.x), digits(x.y), digits(x.z))
}

/// A number with four digits, without an exponent where its size allows that.
pub fn digits(x: f64) -> String {
    match x.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e5).contains(&size) => {
            let after_point = (3.0 - size.log10().floor()).max(0.0) as usize;
            format!("{x:.after_point$}")
        }
        _ => format!("{x:.3e}"),
    }
}

/// Pairs of tetrahedra that lie on the same side of the face they share: one of them was pushed through it, so the
/// mesh overlaps itself there. Ascending.
pub fn folded_pairs(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let faces = sorted_faces(mesh);
    let mut pairs: Vec<[u32; 2]> = faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|same| same.len() == 2 && is_even(mesh, same[0].1) == is_even(mesh, same[1].1))
        .map(|same| [same[0].1, same[1].1].map(|id| (id / 4) as u32))
        .collect();
    pairs.sort_unstable();
    pairs
}

/// Whether the outward order of a face's nodes is an even permutation of their ascending order.
fn is_even(mesh: &TetMesh, id: usize) -> bool {
    let [a, b, c] = FACES[id % 4].map(|corner| mesh.tets[id / 4][corner]);
    [a < b, b < c, c < a].iter().filter(|ascends| **ascends).count() == 2
}

/// Nodes of two or more pieces, ascending.
pub fn hinges(mesh: &TetMesh, pieces: &Components) -> Vec<u32> {
    let mut count = vec![0u32; mesh.nodes.len()];
    pieces.nodes.iter().flatten().for_each(|&node| count[node as usize] += 1);
    (0..).zip(count).filter(|(_, count)| *count > 1).map(|(node, _)| node).collect()
}

/// Pairs of nodes within [`COINCIDENT`] times the extent of each other, the earlier node first.
pub fn coincident_nodes(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let (low, high) = bounding_box(&mesh.nodes);
    let near = COINCIDENT * (high - low).amax();
    // Of a body without extent, all nodes are in one cell.
    let cell = if near > 0.0 { 2.0 * near } else { 1.0 };
    let mut first_in: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let mut pairs = Vec::new();
    for (node, position) in (0u32..).zip(&mesh.nodes) {
        let scaled: Vector3<f64> = (position - low) / cell;
        let own = <[f64; 3]>::from(scaled).map(|x| x.floor() as i64);
        // A neighbour within half a cell is in this cell or in the next one on the nearer side.
        let side = <[f64; 3]>::from(scaled).map(|x| if x - x.floor() < 0.5 { -1 } else { 1 });
        let twin = (0..8).find_map(|corner: i64| {
            let key: [i64; 3] = std::array::from_fn(|axis| own[axis] + side[axis] * (corner >> axis & 1));
            let there = first_in.get(&key)?;
            there.iter().copied().find(|&other| (mesh.nodes[other as usize] - position).norm() <= near)
        });
        match twin {
            Some(other) => pairs.push([other, node]),
            None => first_in.entry(own).or_default().push(node),
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    fn cube() -> TetMesh {
        block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap()
    }

    /// Adds a second body with separate nodes, shifted from the first.
    fn with_second(mut mesh: TetMesh, shift: Vector3<f64>) -> TetMesh {
        let (second, nodes) = (mesh.clone(), mesh.nodes.len() as u32);
        mesh.nodes.extend(second.nodes.iter().map(|node| node + shift));
        mesh.tags.extend(second.tags.iter().map(|tag| tag + 1000));
        mesh.tets.extend(second.tets.iter().map(|tet| tet.map(|node| node + nodes)));
        mesh.regions.extend(&second.regions);
        mesh
    }

    #[test]
    fn numbers_are_told_in_four_digits_without_exponent_where_it_goes() {
        let told = [0.0, 0.54019, -8.37712, 10.0, 92.94, 12345.6, 0.0012346, 1.23456e-7, -3e9].map(digits);
        let wanted = ["0", "0.5402", "-8.377", "10.00", "92.94", "12346", "0.001235", "1.235e-7", "-3.000e9"];
        assert_eq!(told, wanted);
    }

    #[test]
    fn a_sound_mesh_has_none_in_any_unit() {
        for scale in [1e-9, 1.0, 1e6] {
            let mut mesh = cube();
            mesh.nodes.iter_mut().for_each(|node| *node *= scale);
            assert_eq!(find(&mesh), [], "{scale}");
        }
    }

    #[test]
    fn unmerged_layers_are_pieces_and_coincident_nodes() {
        for scale in [1e-9, 1.0, 1e6] {
            let mut mesh = with_second(cube(), Vector3::new(1.0, 1e-10, -1e-10));
            mesh.nodes.iter_mut().for_each(|node| *node *= scale);
            assert_eq!(coincident_nodes(&mesh).len(), 9, "{scale}");
            let found = find(&mesh);
            assert!(found[0].message.starts_with("9 pairs of nodes lie at the same place"), "{found:?}");
            assert!(found[1].message.starts_with("2 pieces that share no face"), "{found:?}");
            assert_eq!(found.len(), 2);
        }
        assert_eq!(coincident_nodes(&with_second(cube(), Vector3::new(1.0 + 1e-8, 0.0, 0.0))).len(), 0);
        assert_eq!(
            coincident_nodes(&TetMesh { nodes: vec![Vector3::zeros(); 5], ..TetMesh::default() }).len(),
            4
        );
    }

    #[test]
    fn a_shared_edge_is_a_hinge() {
        let mut mesh = with_second(cube(), Vector3::new(1.0, 1.0, 0.0));
        for [first, twin] in coincident_nodes(&mesh) {
            mesh.tets.iter_mut().flatten().filter(|node| **node == twin).for_each(|node| *node = first);
        }
        let found = find(&mesh);
        assert!(found.iter().any(|line| line.message.starts_with("pieces touch in 3 nodes")), "{found:?}");
    }

    #[test]
    fn slivers_and_flat_tetrahedra_name_their_nodes() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.3, 1e-5]];
        let mut mesh = TetMesh {
            nodes: corners.map(Vector3::from).to_vec(),
            tags: vec![7, 8, 9, 10],
            tets: vec![[0, 1, 2, 3]],
            regions: vec![0],
            ..TetMesh::default()
        };
        assert!(
            find(&mesh)[0].message.starts_with("1 slivers")
                && find(&mesh)[0].message.contains("[7, 8, 9, 10]")
        );
        mesh.nodes[3].z = 0.0;
        assert!(find(&mesh)[0].message.starts_with("1 tetrahedra have no volume"));
    }

    #[test]
    fn a_node_pushed_through_a_face_folds_the_mesh() {
        let mut mesh = block(&Block { size: [1.0; 3], cells: [4; 3] }).unwrap();
        let middle = mesh.nodes.iter().position(|x| x.norm() < 1e-12).unwrap();
        mesh.nodes[middle] = Vector3::new(0.9, 0.0, 0.0);
        for tet in 0..mesh.tets.len() {
            if crate::mesh::quality::signed_volume(&mesh.corners(tet)) < 0.0 {
                mesh.tets[tet].swap(2, 3);
            }
        }
        let folded = folded_pairs(&mesh);
        assert!(!folded.is_empty());
        assert!(folded.iter().flatten().all(|&tet| {
            let near = mesh.tets[tet as usize].contains(&(middle as u32));
            near || mesh.tets[tet as usize].iter().any(|&node| mesh.nodes[node as usize].norm() < 0.5)
        }));
    }
}
