//! Integration over tetrahedra and their faces, straight or curved.

use crate::fem::quadrature::triangle_rule;
use crate::fem::{tet4, tet10};
use crate::mesh::{EDGES, FACES, TetMesh, quadratic};
use nalgebra::Vector3;

/// One tetrahedron at one place.
pub struct Point {
    pub x: Vector3<f64>,
    /// det ∂x/∂ξ, six times a straight tetrahedron's volume.
    pub determinant: f64,
    /// Node, N_a, ∇N_a (1/m).
    pub shapes: Vec<(usize, f64, Vector3<f64>)>,
}

/// The four or ten nodes of tetrahedron `tet`.
pub fn nodes(mesh: &TetMesh, tet: usize) -> Vec<usize> {
    let mids = mesh.mids.get(tet).into_iter().flatten();
    mesh.tets[tet].iter().chain(mids).map(|&node| node as usize).collect()
}

/// Tetrahedron `tet` at barycentric coordinates `at`; `None` where it is folded.
pub fn point(mesh: &TetMesh, tet: usize, at: &[f64; 4]) -> Option<Point> {
    let (determinant, values, gradients) = if mesh.mids.is_empty() {
        let geometry = tet4::geometry(mesh.corners(tet))?;
        (6.0 * geometry.volume, at.to_vec(), geometry.gradients.to_vec())
    } else {
        let x = quadratic::nodes(mesh, tet).map(|node| mesh.nodes[node as usize]);
        let (determinant, gradients) = tet10::gradients_at(&x, at)?;
        (determinant, quadratic::shapes(at).to_vec(), gradients.to_vec())
    };
    let shapes: Vec<_> = nodes(mesh, tet)
        .into_iter()
        .zip(values)
        .zip(gradients)
        .map(|((node, value), gradient)| (node, value, gradient))
        .collect();
    let x = shapes.iter().map(|&(node, value, _)| mesh.nodes[node] * value).sum();
    Some(Point { x, determinant, shapes })
}

/// The faces whose nodes all are `on` a surface: three nodes each, or six, those between corners in the order 01, 12,
/// 20.
pub fn faces(mesh: &TetMesh, on: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let mut found = Vec::new();
    for tet in 0..mesh.tets.len() {
        let nodes = nodes(mesh, tet);
        for [a, b, c] in FACES {
            let mut face = vec![nodes[a], nodes[b], nodes[c]];
            if nodes.len() == 10 {
                let mid = |i: usize, j: usize| EDGES.iter().position(|edge| *edge == [i.min(j), i.max(j)]);
                face.extend(
                    [[a, b], [b, c], [c, a]].iter().filter_map(|&[i, j]| Some(nodes[4 + mid(i, j)?])),
                );
            }
            if face.iter().all(|&node| on(node)) {
                found.push(face);
            }
        }
    }
    found
}

/// Calls `visit` at the points of a face with position x, normal times area n dA (m²), and each node with its N_a.
///
/// n dA = ∂x/∂ξ × ∂x/∂η dξ dη over the triangle of area 1/2.
pub fn visit_face(
    mesh: &TetMesh,
    face: &[usize],
    mut visit: impl FnMut(Vector3<f64>, Vector3<f64>, &[(usize, f64)]),
) {
    for (at, weight) in triangle_rule() {
        let shapes = face_shapes(face.len(), &at);
        let sum = |part: fn(&(f64, f64, f64)) -> f64| -> Vector3<f64> {
            face.iter().zip(&shapes).map(|(&node, shape)| mesh.nodes[node] * part(shape)).sum()
        };
        let (x, along, across) = (sum(|shape| shape.0), sum(|shape| shape.1), sum(|shape| shape.2));
        let values: Vec<_> = face.iter().zip(&shapes).map(|(&node, shape)| (node, shape.0)).collect();
        visit(x, along.cross(&across) * (0.5 * weight), &values);
    }
}

/// N_a, ∂N_a/∂L₁ and ∂N_a/∂L₂ with L₀ = 1 - L₁ - L₂, of three or six nodes.
fn face_shapes(nodes: usize, at: &[f64; 3]) -> Vec<(f64, f64, f64)> {
    const SLOPES: [[f64; 2]; 3] = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
    if nodes == 3 {
        return (0..3).map(|i| (at[i], SLOPES[i][0], SLOPES[i][1])).collect();
    }
    let corner = |i: usize| {
        let slope = 4.0 * at[i] - 1.0;
        (at[i] * (2.0 * at[i] - 1.0), SLOPES[i][0] * slope, SLOPES[i][1] * slope)
    };
    let middle = |[i, j]: [usize; 2]| {
        let slope = |axis: usize| 4.0 * (SLOPES[i][axis] * at[j] + SLOPES[j][axis] * at[i]);
        (4.0 * at[i] * at[j], slope(0), slope(1))
    };
    (0..3).map(corner).chain([[0, 1], [1, 2], [2, 0]].map(middle)).collect()
}
