//! Distances along a surface: the lengths of paths of triangle edges (Dijkstra, Numerische Mathematik 1, 1959).
//!
//! In: vertices and triangles, once. Out: the vertices within a distance of others, as often as a brush moves. The nodes inside
//! the body play no part, so that a brush on one wall never reaches the other.

use nalgebra::Vector3;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

/// The edges of a surface, vertex by vertex.
pub struct Roads {
    /// Index at which each vertex' edges begin in `ends`.
    starts: Vec<u32>,
    /// Far end of each edge, and its length, m.
    ends: Vec<(u32, f64)>,
    /// Memory of a search: the length to each vertex, infinite between searches.
    lengths: Vec<f64>,
}

impl Roads {
    pub fn new(positions: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Roads {
        let mut edges: Vec<[u32; 2]> = triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let starts =
            (0..=positions.len() as u32).map(|v| edges.partition_point(|edge| edge[0] < v) as u32).collect();
        let length = |[a, b]: [u32; 2]| (b, (positions[b as usize] - positions[a as usize]).norm());
        Roads {
            starts,
            ends: edges.into_iter().map(length).collect(),
            lengths: vec![f64::INFINITY; positions.len()],
        }
    }

    /// Ascending vertices from which a path of at most `radius`, m, leads to one of `from`.
    pub fn within(&mut self, from: &BTreeSet<u32>, radius: f64) -> Vec<u32> {
        // Bits of numbers that are not negative are in the numbers' order.
        let mut queue: BinaryHeap<Reverse<(u64, u32)>> = from.iter().map(|&v| Reverse((0, v))).collect();
        let mut reached: Vec<u32> = from.iter().copied().collect();
        from.iter().for_each(|&v| self.lengths[v as usize] = 0.0);
        while let Some(Reverse((bits, vertex))) = queue.pop() {
            let here = f64::from_bits(bits);
            if here > self.lengths[vertex as usize] {
                continue;
            }
            let [first, last] = [vertex, vertex + 1].map(|v| self.starts[v as usize] as usize);
            for &(next, length) in &self.ends[first..last] {
                let there = here + length;
                let known = &mut self.lengths[next as usize];
                if there <= radius && there < *known {
                    if known.is_infinite() {
                        reached.push(next);
                    }
                    *known = there;
                    queue.push(Reverse((there.to_bits(), next)));
                }
            }
        }
        reached.iter().for_each(|&v| self.lengths[v as usize] = f64::INFINITY);
        reached.sort_unstable();
        reached
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, Surface, TetMesh, block, geodesic};

    /// A U of two fingers 0.2 m apart: along the surface the way from one tip to the other is long.
    fn fingers() -> (TetMesh, Surface) {
        let mut mesh = block(&Block { size: [1.0, 0.2, 1.0], cells: [10, 2, 10] }).unwrap();
        let is_gap = |x: Vector3<f64>| x.x.abs() < 0.1 && x.z > -0.3;
        let kept = |tet: &usize| !is_gap(mesh.corners(*tet).iter().sum::<Vector3<f64>>() / 4.0);
        mesh.tets = (0..mesh.tets.len()).filter(kept).map(|tet| mesh.tets[tet]).collect();
        let surface = Surface::from_mesh(&mesh);
        (mesh, surface)
    }

    #[test]
    fn a_brush_does_not_cross_a_gap_and_never_reaches_farther_than_through_the_body() {
        let (mesh, surface) = fingers();
        let places: Vec<_> = surface.nodes.iter().map(|&node| mesh.nodes[node as usize]).collect();
        let mut roads = Roads::new(&places, &surface.triangles);
        let at = |place: [f64; 3]| {
            places.iter().position(|x| (x - Vector3::from(place)).norm() < 1e-9).unwrap() as u32
        };
        let start = at([-0.1, 0.0, 0.5]);
        for radius in [0.0, 0.15, 0.5, 0.97] {
            let reached = roads.within(&BTreeSet::from([start]), radius);
            assert!(reached.iter().all(|&v| places[v as usize].x < 0.05), "{radius}");
            // Edges of the surface are edges of the mesh: what they reach, a path in the body reaches as well.
            let through = geodesic::within(&mesh, surface.nodes[start as usize], radius);
            assert!(
                reached.iter().all(|&v| through.binary_search(&surface.nodes[v as usize]).is_ok()),
                "{radius}"
            );
            assert!(radius == 0.0 || reached.len() > 1);
        }
        let across = roads.within(&BTreeSet::from([start]), 1.03);
        assert!(across.iter().any(|&v| places[v as usize].x > 0.05), "down 0.8 m, across 0.2 m");
        assert_eq!(roads.within(&BTreeSet::from([start]), 0.0), [start], "a search leaves nothing behind");
    }
}
