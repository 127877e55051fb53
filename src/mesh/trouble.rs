//! What is wrong with a mesh, though it could be read.
//!
//! In: a [`TetMesh`]. Out: one sentence for each kind of trouble, the worst first, with the tags of some nodes. The
//! measures are relative: the same body in metres and nanometres gives the same sentences.

use super::TetMesh;
use super::assemble::first_few;
use super::quality::{Components, bounding_box, components, overlapping_faces, quality};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A tetrahedron of less [`quality()`] is a sliver.
pub const SLIVER: f64 = 1e-3;
/// A tetrahedron of less [`quality()`] has no volume.
pub const FLAT: f64 = 1e-10;
/// Nodes that are nearer, as a part of the body's extent, coincide.
pub const COINCIDENT: f64 = 1e-9;

/// All that is wrong; empty for a sound mesh.
pub fn find(mesh: &TetMesh) -> Vec<String> {
    let mut found = Vec::new();
    elements(mesh, &mut found);
    let overlapping = overlapping_faces(mesh);
    if !overlapping.is_empty() {
        let listed: Vec<String> =
            overlapping.iter().take(3).map(|face| format!("{:?}", tags(mesh, face))).collect();
        found.push(format!(
            "{} faces belong to three or more tetrahedra: the mesh overlaps itself (nodes {})",
            overlapping.len(),
            listed.join(", ")
        ));
    }
    let pieces = components(mesh);
    if pieces.nodes.len() > 1 {
        let mut sizes = vec![0usize; pieces.nodes.len()];
        pieces.of_tet.iter().for_each(|&piece| sizes[piece as usize] += 1);
        sizes.sort_unstable_by(|a, b| b.cmp(a));
        let listed: Vec<u64> = sizes.iter().map(|&size| size as u64).collect();
        found.push(format!(
            "{} pieces that share no face, of {} tetrahedra: hold each, or join them",
            sizes.len(),
            first_few(&listed)
        ));
    }
    let hinges = hinges(mesh, &pieces);
    if !hinges.is_empty() {
        let listed: Vec<u64> = hinges.iter().map(|&node| mesh.tags[node as usize]).collect();
        found.push(format!(
            "pieces touch in {} nodes without sharing a face there, which is a hinge (node {})",
            hinges.len(),
            first_few(&listed)
        ));
    }
    let coincident = coincident_nodes(mesh);
    if !coincident.is_empty() {
        let listed: Vec<String> =
            coincident.iter().take(3).map(|pair| format!("{:?}", tags(mesh, pair))).collect();
        found.push(format!(
            "{} nodes stand where another does: the body may be cracked open there (nodes {})",
            coincident.len(),
            listed.join(", ")
        ));
    }
    found
}

fn tags<const N: usize>(mesh: &TetMesh, nodes: &[u32; N]) -> [u64; N] {
    nodes.map(|node| mesh.tags[node as usize])
}

/// Tetrahedra without volume, and slivers.
fn elements(mesh: &TetMesh, found: &mut Vec<String>) {
    let mut poor: Vec<(f64, usize)> = (0..mesh.tets.len())
        .map(|tet| (quality(&mesh.corners(tet)), tet))
        .filter(|(quality, _)| *quality < SLIVER)
        .collect();
    poor.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (flat, slivers) = poor.split_at(poor.partition_point(|(quality, _)| *quality < FLAT));
    let mut say = |part: &[(f64, usize)], what: &str| {
        let Some(&(worst, _)) = part.first() else {
            return;
        };
        let listed: Vec<String> =
            part.iter().take(3).map(|&(_, tet)| format!("{:?}", tags(mesh, &mesh.tets[tet]))).collect();
        found.push(format!("{} {what}: the worst {worst:.1e} (nodes {})", part.len(), listed.join(", ")));
    };
    say(flat, "tetrahedra have no volume (quality below 1e-10) and will be refused");
    say(slivers, "tetrahedra are slivers (quality below 1e-3)");
}

/// Nodes of two or more pieces, ascending.
pub fn hinges(mesh: &TetMesh, pieces: &Components) -> Vec<u32> {
    let mut count = vec![0u32; mesh.nodes.len()];
    pieces.nodes.iter().flatten().for_each(|&node| count[node as usize] += 1);
    (0..).zip(count).filter(|(_, count)| *count > 1).map(|(node, _)| node).collect()
}

/// Nodes that stand within [`COINCIDENT`] times the extent of an earlier one: that one, and the node.
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

    /// A second body beside the first, with nodes of its own.
    fn with_second(mut mesh: TetMesh, shift: Vector3<f64>) -> TetMesh {
        let (second, nodes) = (mesh.clone(), mesh.nodes.len() as u32);
        mesh.nodes.extend(second.nodes.iter().map(|node| node + shift));
        mesh.tags.extend(second.tags.iter().map(|tag| tag + 1000));
        mesh.tets.extend(second.tets.iter().map(|tet| tet.map(|node| node + nodes)));
        mesh.regions.extend(&second.regions);
        mesh
    }

    #[test]
    fn a_sound_mesh_has_none_in_any_unit() {
        for scale in [1e-9, 1.0, 1e6] {
            let mut mesh = cube();
            mesh.nodes.iter_mut().for_each(|node| *node *= scale);
            assert_eq!(find(&mesh), [] as [&str; 0], "{scale}");
        }
    }

    #[test]
    fn unmerged_layers_are_pieces_and_coincident_nodes() {
        for scale in [1e-9, 1.0, 1e6] {
            let mut mesh = with_second(cube(), Vector3::new(1.0, 1e-10, -1e-10));
            mesh.nodes.iter_mut().for_each(|node| *node *= scale);
            assert_eq!(coincident_nodes(&mesh).len(), 9, "{scale}");
            let found = find(&mesh);
            assert!(found[0].starts_with("2 pieces that share no face, of 40, 40 tetrahedra"), "{found:?}");
            assert!(found[1].starts_with("9 nodes stand where another does"), "{found:?}");
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
        assert!(found.iter().any(|line| line.starts_with("pieces touch in 3 nodes")), "{found:?}");
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
        let found = find(&mesh);
        assert!(
            found[0].starts_with("1 tetrahedra are slivers") && found[0].ends_with("(nodes [7, 8, 9, 10])")
        );
        mesh.nodes[3].z = 0.0;
        assert!(find(&mesh)[0].starts_with("1 tetrahedra have no volume"));
    }
}
