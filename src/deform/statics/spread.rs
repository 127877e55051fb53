//! Displacements of a whole mesh from those of some of its nodes.

use crate::fem::NodeFields;
use crate::mesh::TetMesh;

/// Times that every node is set to the mean of its neighbours.
const ROUNDS: usize = 500;

/// Sets each node that is not known to the mean of the others of its tetrahedra, over and over, which smooths what is known into the
/// body; nodes between corners are among the others.
pub(super) fn spread(mesh: &TetMesh, is_known: &[bool], u: &mut NodeFields) {
    let mut neighbours = vec![Vec::new(); mesh.nodes.len()];
    for (tet, corners) in mesh.tets.iter().enumerate() {
        let mids = mesh.mids.get(tet).map_or(&[][..], |mids| mids);
        let own = || corners.iter().chain(mids).copied();
        for node in own().filter(|node| !is_known[*node as usize]) {
            neighbours[node as usize].extend(own().filter(|other| *other != node));
        }
    }
    for _ in 0..ROUNDS {
        for (node, others) in neighbours.iter().enumerate().filter(|(_, others)| !others.is_empty()) {
            for axis in 0..3 {
                let sum: f64 = others.iter().map(|other| u.data[3 * *other as usize + axis]).sum();
                u.data[3 * node + axis] = sum / others.len() as f64;
            }
        }
    }
}
