//! Assembly of the stiffness matrix from its tetrahedra.

use super::{Lame, StiffnessMatrix, tet4};
use crate::mesh::trouble::FLAT;
use crate::mesh::{TetMesh, quality};
use nalgebra::Matrix3;
use rayon::prelude::*;

#[derive(Debug, thiserror::Error)]
pub enum AssemblyError {
    #[error(
        "tetrahedron {index} (nodes with tags {tags:?}) has volume {volume:.3e} m³, relative volume {relative:.1e}; \
         remove it or move a node: its stiffness would be infinite or wrong"
    )]
    Degenerate { index: usize, tags: [u64; 4], volume: f64, relative: f64 },
}

/// K = Σ_e K_e, with Lamé's constants `lame[e]` per tetrahedron.
///
/// Parallel over nodes: every node sums the blocks of its own row over its tetrahedra in ascending order, so the
/// result has the same bits on every thread count. Errors where a tetrahedron is flat or inverted.
pub fn assemble(mesh: &TetMesh, lame: &[Lame]) -> Result<StiffnessMatrix, AssemblyError> {
    let elements = geometries(mesh)?;
    let incident = incidence(mesh);
    let mut matrix = StiffnessMatrix::zeros(mesh.nodes.len(), edges(mesh, &incident));

    let rows: Vec<(Matrix3<f64>, Vec<Matrix3<f64>>)> = (0..mesh.nodes.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|node| {
            let edges = &matrix.edges[matrix.edge_start[node]..matrix.edge_start[node + 1]];
            let mut diagonal = Matrix3::zeros();
            let mut blocks = vec![Matrix3::zeros(); edges.len()];
            for &tet in incident.of(node) {
                let corners = mesh.tets[tet as usize];
                let (element, lame) = (&elements[tet as usize], lame[tet as usize]);
                let Some(a) = corners.iter().position(|&corner| corner as usize == node) else {
                    continue;
                };
                diagonal += tet4::stiffness_block(element, lame, a, a);
                for (b, &corner) in corners.iter().enumerate().filter(|(_, corner)| **corner as usize > node)
                {
                    if let Ok(slot) = edges.binary_search_by_key(&corner, |edge| edge[1]) {
                        blocks[slot] += tet4::stiffness_block(element, lame, a, b);
                    }
                }
            }
            (diagonal, blocks)
        })
        .collect();
    for (node, (diagonal, blocks)) in rows.into_iter().enumerate() {
        matrix.diagonal[node] = diagonal;
        let start = matrix.edge_start[node];
        matrix.blocks[start..start + blocks.len()].copy_from_slice(&blocks);
    }
    Ok(matrix)
}

fn geometries(mesh: &TetMesh) -> Result<Vec<tet4::Geometry>, AssemblyError> {
    (0..mesh.tets.len())
        .into_par_iter()
        .map(|index| {
            let corners = mesh.tets[index];
            let x = corners.map(|node| mesh.nodes[node as usize]);
            let relative = quality::quality(&x);
            // Written so that a NaN is refused too.
            match tet4::geometry(x) {
                Some(element) if relative >= FLAT => Ok(element),
                element => Err(AssemblyError::Degenerate {
                    index,
                    tags: corners.map(|node| mesh.tags[node as usize]),
                    volume: element.map_or(0.0, |element| element.volume),
                    relative,
                }),
            }
        })
        .collect()
}

/// The tetrahedra around every node, ascending.
struct Incidence {
    start: Vec<usize>,
    tets: Vec<u32>,
}

impl Incidence {
    fn of(&self, node: usize) -> &[u32] {
        &self.tets[self.start[node]..self.start[node + 1]]
    }
}

fn incidence(mesh: &TetMesh) -> Incidence {
    let mut start = vec![0; mesh.nodes.len() + 1];
    for &corner in mesh.tets.iter().flatten() {
        start[corner as usize + 1] += 1;
    }
    for i in 0..mesh.nodes.len() {
        start[i + 1] += start[i];
    }
    let mut next = start.clone();
    let mut tets = vec![0; 4 * mesh.tets.len()];
    for (tet, corners) in mesh.tets.iter().enumerate() {
        for &corner in corners {
            tets[next[corner as usize]] = tet as u32;
            next[corner as usize] += 1;
        }
    }
    Incidence { start, tets }
}

/// All edges i < j, sorted.
fn edges(mesh: &TetMesh, incident: &Incidence) -> Vec<[u32; 2]> {
    let per_node: Vec<Vec<[u32; 2]>> = (0..mesh.nodes.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|node| {
            let mut above: Vec<u32> = incident
                .of(node)
                .iter()
                .flat_map(|&tet| mesh.tets[tet as usize])
                .filter(|&corner| corner as usize > node)
                .collect();
            above.sort_unstable();
            above.dedup();
            above.into_iter().map(|other| [node as u32, other]).collect()
        })
        .collect();
    per_node.concat()
}
