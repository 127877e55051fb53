//! Parts of a mesh within a geodesic distance of one node, measured through the material.
//!
//! In: a [`TetMesh`], a node, a length. Out: the nodes within that length along the mesh's edges (Dijkstra,
//! Numerische Mathematik 1, 1959). The edges inside the body count too: the nodes around one on a wall then reach through
//! the wall, and never across a gap, because no edge crosses it.

use super::tet_mesh::{EDGES, TetMesh, edges_of};
use nalgebra::Vector3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Tolerance for rounding in a sum of lengths, relative to the radius: three edges of 0.1 m are within 0.3 m.
const ROUNDING: f64 = 1e-9;

/// The edges of all tetrahedra, or of all triangles where there is none, once each, the smaller node first, sorted. Between
/// corners only.
pub fn edges(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let of_triangle = |[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]].map(|[p, q]| [*p.min(q), *p.max(q)]);
    let mut edges: Vec<[u32; 2]> = mesh.tets.iter().flat_map(edges_of).collect();
    edges.extend(mesh.triangles.iter().flat_map(of_triangle));
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// The node among `nodes` nearest to `point` (the first of several), and its distance, m; `None` without nodes.
pub fn nearest(mesh: &TetMesh, nodes: &[u32], point: &Vector3<f64>) -> Option<(u32, f64)> {
    let distance = |&node: &u32| (node, (mesh.nodes[node as usize] - point).norm());
    nodes.iter().map(distance).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Ascending nodes whose shortest path to `start` is at most `radius` long, m: the sum of the lengths of the edges it
/// takes. In a quadratic mesh an edge is its two halves, from corner to mid-side node to corner.
pub fn within(mesh: &TetMesh, start: u32, radius: f64) -> Vec<u32> {
    let limit = radius * (1.0 + ROUNDING);
    let length = lengths(mesh, &[start], limit);
    (0..mesh.nodes.len() as u32).filter(|&node| length[node as usize] <= limit).collect()
}

/// The length of each node's shortest path to the nearest of `starts`, m; infinite beyond `limit` and where no path leads.
pub fn lengths(mesh: &TetMesh, starts: &[u32], limit: f64) -> Vec<f64> {
    let mut roads = match mesh.mids.is_empty() {
        true => edges(mesh),
        false => halves(mesh),
    };
    roads.extend_from_within(..);
    let half = roads.len() / 2;
    roads[half..].iter_mut().for_each(|road| road.reverse());
    roads.sort_unstable();
    let from = |node: u32| {
        let first = roads.partition_point(|road| road[0] < node);
        roads[first..].iter().take_while(move |road| road[0] == node).map(|road| road[1])
    };

    let mut length = vec![f64::INFINITY; mesh.nodes.len()];
    starts.iter().for_each(|&start| length[start as usize] = 0.0);
    // Bits of numbers that are not negative are in the numbers' order.
    let mut queue: BinaryHeap<_> = starts.iter().map(|&start| Reverse((0.0f64.to_bits(), start))).collect();
    while let Some(Reverse((bits, node))) = queue.pop() {
        let here = f64::from_bits(bits);
        if here > length[node as usize] {
            continue;
        }
        for next in from(node) {
            let there = here + (mesh.nodes[next as usize] - mesh.nodes[node as usize]).norm();
            if there <= limit && there < length[next as usize] {
                length[next as usize] = there;
                queue.push(Reverse((there.to_bits(), next)));
            }
        }
    }
    length
}

/// The halves of a quadratic mesh's edges once each, from corner to mid-side node.
fn halves(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let of = |(tet, mids): (&[u32; 4], &[u32; 6])| {
        let mut halves = [[0; 2]; 12];
        for (e, [a, b]) in EDGES.into_iter().enumerate() {
            (halves[2 * e], halves[2 * e + 1]) = ([tet[a], mids[e]], [tet[b], mids[e]]);
        }
        halves
    };
    let mut halves: Vec<[u32; 2]> = mesh.tets.iter().zip(&mesh.mids).flat_map(of).collect();
    halves.sort_unstable();
    halves.dedup();
    halves
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    fn node_at(mesh: &TetMesh, place: [f64; 3]) -> u32 {
        let all: Vec<u32> = (0..mesh.nodes.len() as u32).collect();
        let (node, distance) = nearest(mesh, &all, &place.into()).unwrap();
        assert!(distance < 1e-12, "no node at {place:?}");
        node
    }

    #[test]
    fn a_cell_has_the_edges_of_its_five_tetrahedra() {
        let mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
        let edges = edges(&mesh);
        assert_eq!(edges.len(), 12 + 6, "of the cube, and a diagonal of each face");
        assert!(edges.is_sorted() && edges.iter().all(|[a, b]| a < b));
    }

    /// Counts of nodes in cells of 0.1 m: 7 nodes within one axis edge, with 12 face diagonals 19 or, where they point away, 7.
    #[test]
    fn lengths_are_those_of_paths() {
        let mesh = block(&Block { size: [1.0; 3], cells: [10; 3] }).unwrap();
        let counts = |radius: f64| -> Vec<usize> {
            let starts = [[0.0; 3], [0.1, 0.0, 0.0]];
            starts.iter().map(|&at| within(&mesh, node_at(&mesh, at), radius).len()).collect()
        };
        assert_eq!(counts(0.0), [1, 1]);
        assert_eq!(counts(0.0999), [1, 1]);
        assert_eq!(counts(0.1), [7, 7]);
        let mut diagonal = counts(0.1 * 2f64.sqrt());
        diagonal.sort_unstable();
        assert_eq!(diagonal, [7, 19]);
        let along = within(&mesh, node_at(&mesh, [-0.5, 0.0, 0.0]), 0.3);
        assert!(along.contains(&node_at(&mesh, [-0.2, 0.0, 0.0])), "0.1 + 0.1 + 0.1 is within 0.3");
    }

    /// A path in a convex body of these cells is at most 1.4 times as long as the straight line.
    #[test]
    fn what_grows_lies_between_two_spheres() {
        let mesh = block(&Block { size: [1.0; 3], cells: [10; 3] }).unwrap();
        let start = node_at(&mesh, [0.5, 0.0, 0.0]);
        let distance = |node: u32| (mesh.nodes[node as usize] - mesh.nodes[start as usize]).norm();
        for radius in [0.2, 0.35, 0.61] {
            let grown = within(&mesh, start, radius);
            assert!(grown.iter().all(|&node| distance(node) <= radius * (1.0 + 1e-9)));
            let inside = (0..mesh.nodes.len() as u32).filter(|&node| distance(node) <= radius / 1.4);
            assert!(inside.into_iter().all(|node| grown.binary_search(&node).is_ok()), "{radius}");
        }
    }

    #[test]
    fn a_quadratic_mesh_grows_by_half_edges() {
        let mesh = TetMesh {
            nodes: [[0., 0., 0.], [2., 0., 0.], [0., 2., 0.], [0., 0., 2.], [1., 0., 0.], [1., 1., 0.]]
                .into_iter()
                .chain([[0., 1., 0.], [0., 0., 1.], [0., 1., 1.], [1., 0., 1.]])
                .map(Vector3::from)
                .collect(),
            tets: vec![[0, 1, 2, 3]],
            mids: vec![[4, 5, 6, 7, 8, 9]],
            ..TetMesh::default()
        };
        assert_eq!(within(&mesh, 0, 1.0), [0, 4, 6, 7]);
        assert_eq!(within(&mesh, 0, 2.0), [0, 1, 2, 3, 4, 6, 7]);
        assert_eq!(within(&mesh, 5, 1.5), [1, 2, 5]);
    }

    /// Three edges of 0.1 m, whose sum is 0.30000000000000004 m, and no way beside them.
    #[test]
    fn a_radius_bears_the_rounding_of_a_sum() {
        let way = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.1, 0.1, 0.1]];
        let aside = [[5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 5.0]];
        let mesh = TetMesh {
            nodes: way.into_iter().chain(aside).map(Vector3::from).collect(),
            triangles: vec![[0, 1, 4], [1, 2, 5], [2, 3, 6]],
            ..TetMesh::default()
        };
        assert_eq!(within(&mesh, 0, 0.3), [0, 1, 2, 3]);
        assert_eq!(within(&mesh, 0, 0.299), [0, 1, 2]);
    }
}
