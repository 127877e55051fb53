//! The shells of a triangle surface, and which of them are one body.
//!
//! In: a [`TetMesh`] without tetrahedra. Out: the nodes of its pieces, of which a shell around a cavity is a part. Solid angles: Van
//! Oosterom and Strackee (IEEE Trans. Biomed. Eng. 30, 1983).

use super::tet_mesh::TetMesh;
use crate::base::disjoint::DisjointSets;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// The pieces of a body without tetrahedra: shells that are joined through edges, each around a cavity with the shell around it.
pub fn pieces(mesh: &TetMesh) -> Vec<Vec<u32>> {
    let count = mesh.triangles.len();
    let mut sets = DisjointSets::new(count);
    let mut edges = Vec::with_capacity(3 * count);
    for (t, [a, b, c]) in (0u32..).zip(&mesh.triangles) {
        edges.extend([[a, b], [b, c], [c, a]].map(|[p, q]| ([*p.min(q), *p.max(q)], t)));
    }
    edges.sort_unstable();
    edges
        .chunk_by(|a, b| a.0 == b.0)
        .flat_map(|same| same.windows(2))
        .for_each(|pair| sets.join(pair[0].1, pair[1].1));
    let roots: Vec<u32> = (0..count as u32).map(|t| sets.root(t)).collect();
    let mut shells: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    (0u32..).zip(&roots).for_each(|(t, root)| shells.entry(*root).or_default().push(t));
    let mut outer = Vec::new();
    let mut cavities = Vec::new();
    for triangles in shells.into_values() {
        let volume = volume(mesh, &triangles);
        if volume < 0.0 { cavities.push(triangles) } else { outer.push((volume, triangles)) }
    }
    let holders: Vec<Option<usize>> = cavities.iter().map(|cavity| holder(mesh, &outer, cavity)).collect();
    let mut nodes: Vec<Vec<u32>> =
        outer.into_iter().map(|(_, triangles)| nodes_of(mesh, &triangles)).collect();
    for (cavity, holder) in cavities.into_iter().zip(holders) {
        let own = nodes_of(mesh, &cavity);
        match holder {
            Some(holder) => nodes[holder].extend(own),
            None => nodes.push(own),
        }
    }
    nodes.iter_mut().for_each(|nodes| nodes.sort_unstable());
    nodes.sort_by_key(|nodes| nodes.first().copied());
    nodes
}

fn nodes_of(mesh: &TetMesh, triangles: &[u32]) -> Vec<u32> {
    let mut nodes: Vec<u32> = triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

fn corners(mesh: &TetMesh, t: u32) -> [Vector3<f64>; 3] {
    mesh.triangles[t as usize].map(|node| mesh.nodes[node as usize])
}

fn volume(mesh: &TetMesh, triangles: &[u32]) -> f64 {
    let Some(&first) = triangles.first() else { return 0.0 };
    let [origin, ..] = corners(mesh, first);
    let of = |&t: &u32| {
        let [a, b, c] = corners(mesh, t).map(|x| x - origin);
        a.dot(&b.cross(&c)) / 6.0
    };
    triangles.iter().map(of).sum()
}

/// The smallest shell of those whose boxes hold the cavity's, and which winds around its first node.
fn holder(mesh: &TetMesh, outer: &[(f64, Vec<u32>)], cavity: &[u32]) -> Option<usize> {
    let point = corners(mesh, *cavity.first()?)[0];
    let winds = |triangles: &[u32]| {
        let places = || triangles.iter().flat_map(|&t| corners(mesh, t));
        let low = places().fold(point, |low, x| low.inf(&x));
        let high = places().fold(point, |high, x| high.sup(&x));
        // Where the point is outside the box, it is now on its border.
        let is_near = (0..3).all(|axis| low[axis] < point[axis] && point[axis] < high[axis]);
        let angle = |&t: &u32| solid_angle(corners(mesh, t), &point);
        is_near && triangles.iter().map(angle).sum::<f64>() > std::f64::consts::TAU
    };
    let holding = outer.iter().enumerate().filter(|(_, (_, triangles))| winds(triangles));
    holding.min_by(|a, b| a.1.0.total_cmp(&b.1.0)).map(|(at, _)| at)
}

/// Solid angle under which a triangle is seen from `point`; negative from its front.
pub fn solid_angle(corners: [Vector3<f64>; 3], point: &Vector3<f64>) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - point);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * a.dot(&b.cross(&c)).atan2(below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block, surface_body};

    fn cube(side: f64, cells: u32) -> TetMesh {
        surface_body::of_tetrahedra(&block(&Block { size: [side; 3], cells: [cells; 3] }).unwrap())
    }

    /// A cube with a cavity, and another cube at a distance.
    #[test]
    fn a_cavity_belongs_to_the_shell_around_it() {
        let mut mesh = cube(2.0, 2);
        let mut add = |other: TetMesh, shift: f64, is_cavity: bool| {
            let first = mesh.nodes.len() as u32;
            mesh.nodes.extend(other.nodes.iter().map(|x| x + Vector3::new(shift, 0.0, 0.0)));
            mesh.triangles.extend(other.triangles.iter().map(|t| {
                let [a, b, c] = t.map(|node| node + first);
                if is_cavity { [a, c, b] } else { [a, b, c] }
            }));
            first..mesh.nodes.len() as u32
        };
        add(cube(1.0, 1), 5.0, false);
        let cavity = add(cube(1.0, 1), 0.0, true);
        let found = pieces(&mesh);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].len(), 26 + 8);
        assert!(cavity.into_iter().all(|node| found[0].binary_search(&node).is_ok()));
    }
}
