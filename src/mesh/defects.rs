//! What no stiffness matrix tells: meshes that are wrong although every tetrahedron looks right.
//!
//! In: a [`TetMesh`]. Out: the places where it is folded onto itself or cracked open. A Cholesky factorization passes
//! both in silence.

use super::TetMesh;
use super::quality::bounding_box;
use super::surface::{FACES, sorted_faces};

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

/// Pairs of nodes nearer to each other than 10⁻⁹ of the body's extent, most often layers of a mesh that were never
/// merged: the body cracks open there. Each node is paired with the first at its place.
pub fn coincident_nodes(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let (low, high) = bounding_box(&mesh.nodes);
    let cell = 1e-9 * (high - low).amax();
    if cell.is_nan() || cell <= 0.0 {
        return Vec::new();
    }
    let mut pairs = std::collections::BTreeSet::new();
    // Two grids half a cell apart, so that no pair is split by both.
    for shift in [0.0, 0.5] {
        let place = |node: u32| {
            let offset = (mesh.nodes[node as usize] - low) / cell;
            [offset.x, offset.y, offset.z].map(|x| (x + shift).floor() as i64)
        };
        let mut nodes: Vec<([i64; 3], u32)> = (0..mesh.nodes.len() as u32).map(|n| (place(n), n)).collect();
        nodes.sort_unstable();
        for same in nodes.chunk_by(|a, b| a.0 == b.0) {
            pairs.extend(same[1..].iter().map(|(_, node)| [same[0].1, *node]));
        }
    }
    pairs.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::{Block, block};
    use nalgebra::Vector3;

    #[test]
    fn a_sound_mesh_has_no_defects() {
        let mesh = block(&Block { size: [1.0, 2.0, 3.0], cells: [3, 2, 4] }).unwrap();
        assert_eq!((folded_pairs(&mesh), coincident_nodes(&mesh)), (vec![], vec![]));
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

    #[test]
    fn a_layer_that_was_not_merged_is_found_in_any_unit() {
        for unit in [1e-9, 1.0, 1e6] {
            let mesh = block(&Block { size: [unit; 3], cells: [2, 3, 3] }).unwrap();
            let mut double = mesh.clone();
            let count = mesh.nodes.len() as u32;
            double.nodes.extend(mesh.nodes.iter().map(|x| x + Vector3::new(unit * (1.0 + 1e-13), 0.0, 0.0)));
            double.tets.extend(mesh.tets.iter().map(|tet| tet.map(|node| node + count)));
            assert_eq!(coincident_nodes(&double).len(), 16, "4 × 4 nodes of the shared face, unit {unit}");
        }
    }
}
