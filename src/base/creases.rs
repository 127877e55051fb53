//! Sharp edges of a surface: a node on such an edge is drawn once for each of its sides, so that each side keeps its normal.
//!
//! In: triangles and the surface at rest. Out: the triangles as they are drawn, over the nodes and, after these, copies of
//! some of them. Only the drawn surface has copies; picking, control elements and results know nodes alone.

use super::disjoint::DisjointSets;

/// Nodes that are drawn more than once.
#[derive(Clone, Debug, PartialEq)]
pub struct Creases {
    /// Triangles in the order of the surface's, over nodes and copies.
    pub triangles: Vec<[u32; 3]>,
    /// The node of each vertex after the last node.
    pub copies: Vec<u32>,
}

impl Creases {
    /// The sharp edges of a surface: those whose two triangles have normals more than `angle` (rad) apart at rest.
    /// Triangles around a node that hang together over other edges share a vertex. `None` where no node has two sides.
    pub fn new(triangles: &[[u32; 3]], rest: &[[f32; 3]], angle: f64) -> Option<Creases> {
        let normals: Vec<[f64; 3]> = triangles.iter().map(|triangle| normal(triangle, rest)).collect();
        let least = angle.cos();
        let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
        for (t, &[a, b, c]) in (0..).zip(triangles) {
            let edge = |a: u32, b: u32| ([a.min(b), a.max(b)], t);
            edges.extend([edge(a, b), edge(b, c), edge(c, a)]);
        }
        edges.sort_unstable();
        // Corner k of triangle t is number 3 t + k.
        let corner = |t: u32, node: u32| {
            let k = triangles[t as usize].iter().position(|&known| known == node).unwrap_or(0);
            3 * t + k as u32
        };
        let mut sides = DisjointSets::new(3 * triangles.len());
        for same in edges.chunk_by(|a, b| a.0 == b.0) {
            for (k, &(nodes, t)) in same.iter().enumerate() {
                for &(_, other) in &same[..k] {
                    if dot(&normals[t as usize], &normals[other as usize]) >= least {
                        nodes.iter().for_each(|&node| sides.join(corner(t, node), corner(other, node)));
                    }
                }
            }
        }
        let mut side_of: Vec<Option<u32>> = vec![None; rest.len()];
        let mut vertex_of = vec![0; 3 * triangles.len()];
        let mut copies = Vec::new();
        let mut drawn = triangles.to_vec();
        for (k, vertex) in (0u32..).zip(drawn.as_flattened_mut()) {
            let (root, node) = (sides.root(k), *vertex);
            if root == k {
                // The first side of a node is the node itself.
                let is_first = side_of[node as usize].replace(k).is_none();
                vertex_of[k as usize] = if is_first {
                    node
                } else {
                    copies.push(node);
                    (rest.len() + copies.len() - 1) as u32
                };
            }
            *vertex = vertex_of[root as usize];
        }
        (!copies.is_empty()).then_some(Creases { triangles: drawn, copies })
    }

    /// Appends the copies' values: each is that of its node.
    pub fn extend<T: Copy>(&self, nodes: &mut Vec<T>) {
        for &node in &self.copies {
            nodes.push(nodes[node as usize]);
        }
    }
}

/// The unit normal; zero where the triangle vanishes, which is then sharp on all sides and never shown.
fn normal(triangle: &[u32; 3], rest: &[[f32; 3]]) -> [f64; 3] {
    let [a, b, c] = triangle.map(|node| rest[node as usize].map(f64::from));
    let [u, v] = [b, c].map(|end| [0, 1, 2].map(|axis| end[axis] - a[axis]));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let length = dot(&cross, &cross).sqrt();
    cross.map(|x| if length > 0.0 { x / length } else { 0.0 })
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Corners and faces of a cube, two triangles each.
    fn cube() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let rest = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2].map(|bit| bit as f32 - 0.5)).collect();
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        (rest, faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
    }

    #[test]
    fn a_cubes_corner_is_drawn_with_three_normals_that_are_the_axes() {
        let (rest, triangles) = cube();
        let creases = Creases::new(&triangles, &rest, 40f64.to_radians()).unwrap();
        assert_eq!(creases.copies.len(), 2 * 8);
        let mut drawn = rest.clone();
        creases.extend(&mut drawn);
        assert_eq!(drawn.len(), 24);
        let mut sides = vec![None; 24];
        for (old, new) in triangles.iter().zip(&creases.triangles) {
            assert_eq!(
                old.map(|k| rest[k as usize]),
                new.map(|k| drawn[k as usize]),
                "copies lie on their nodes"
            );
            let normal = normal(new, &drawn);
            assert_eq!(normal.iter().filter(|x| x.abs() == 1.0).count(), 1, "{normal:?} is an axis");
            for vertex in new {
                assert!(sides[*vertex as usize].replace(normal).is_none_or(|known| known == normal));
            }
        }
        assert_eq!(Creases::new(&triangles, &rest, 91f64.to_radians()), None, "all of it is smooth");
    }

    /// A prism of 20 sides, 18° from each to the next, closed at one end: the wall stays smooth, the rim is sharp.
    #[test]
    fn a_tubes_wall_stays_smooth_and_its_rim_is_sharp() {
        let n = 20u32;
        let ring = |x: f32| {
            (0..n).map(move |k| {
                let (sin, cos) = (TAU * f64::from(k) / f64::from(n)).sin_cos();
                [x, cos as f32, sin as f32]
            })
        };
        let rest: Vec<[f32; 3]> = ring(0.0).chain(ring(1.0)).chain([[1.0, 0.0, 0.0]]).collect();
        let side = |k: u32| {
            let next = (k + 1) % n;
            [[k, next, n + k], [next, n + next, n + k], [n + k, n + next, 2 * n]]
        };
        let triangles: Vec<[u32; 3]> = (0..n).flat_map(side).collect();
        let creases = Creases::new(&triangles, &rest, 40f64.to_radians()).unwrap();
        let mut copies = creases.copies.clone();
        copies.sort_unstable();
        assert_eq!(copies, (n..2 * n).collect::<Vec<u32>>(), "each node of the rim once more");
        let all = Creases::new(&triangles, &rest, 10f64.to_radians()).unwrap();
        assert_eq!(all.copies.len(), 3 * n as usize, "below 18° every side stands alone");
    }
}
