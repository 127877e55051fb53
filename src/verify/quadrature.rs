//! Integration over tetrahedra and their faces, straight or curved.

use crate::fem::{tet4, tet10};
use crate::mesh::{EDGES, TetMesh, quadratic};
use nalgebra::Vector3;

/// Nodes r in (0, 1) and weights of the Gauss–Jacobi rules of four points for the means of 3 (1 - r)² f, 2 (1 - r) f and
/// f: each is exact to degree 7.
const GAUSS_JACOBI: [[[f64; 2]; 4]; 3] = [
    [
        [0.048_500_549_446_997_33, 0.332_665_246_833_833_97],
        [0.238_600_737_551_862_3, 0.430_376_369_397_642_6],
        [0.517_047_295_104_367_5, 0.205_901_661_518_769_24],
        [0.795_851_417_896_772_9, 0.031_056_722_249_754_195],
    ],
    [
        [0.057_104_196_114_517_68, 0.271_013_826_862_976_2],
        [0.276_843_013_638_123_86, 0.406_929_136_020_542_7],
        [0.583_590_432_368_916_8, 0.259_695_095_216_464_9],
        [0.860_240_135_656_219_4, 0.062_361_941_900_016_16],
    ],
    [
        [0.069_431_844_202_973_71, 0.173_927_422_568_726_92],
        [0.330_009_478_207_571_87, 0.326_072_577_431_273_05],
        [0.669_990_521_792_428_1, 0.326_072_577_431_273_05],
        [0.930_568_155_797_026_3, 0.173_927_422_568_726_92],
    ],
];

/// Barycentric coordinates and weights (their sum is 1) of a rule of degree 7 on the tetrahedron: the conical product
/// of three Gauss–Jacobi rules, 64 points, all weights positive (Stroud, Approximate Calculation of Multiple Integrals,
/// 1971, section 2.4).
///
/// The error of a quadratic element is cubic where the exact field is smooth, and its square has degree 6; a rule of
/// degree 5 makes it 5 % too small.
pub fn tetrahedron_rule() -> Vec<([f64; 4], f64)> {
    let [first, second, third] = GAUSS_JACOBI;
    let mut rule = Vec::with_capacity(64);
    for [r, by_r] in first {
        for [s, by_s] in second {
            for [t, by_t] in third {
                let (x, y) = (r, (1.0 - r) * s);
                let z = (1.0 - r) * (1.0 - s) * t;
                rule.push(([x, y, z, 1.0 - x - y - z], by_r * by_s * by_t));
            }
        }
    }
    rule
}

/// Barycentric coordinates and weights (their sum is 1) of Radon's rule of degree 5 on the triangle (Zienkiewicz and
/// Taylor, The Finite Element Method, vol. 1, 5th ed., table 9.2, septic).
pub fn triangle_rule() -> [([f64; 3], f64); 7] {
    let (a, wa) = (0.470_142_064_105_115_1, 0.132_394_152_788_506_2);
    let (b, wb) = (0.101_286_507_323_456_34, 0.125_939_180_544_827_15);
    let third = 1.0 / 3.0;
    [
        ([third; 3], 0.225),
        ([1.0 - 2.0 * a, a, a], wa),
        ([a, 1.0 - 2.0 * a, a], wa),
        ([a, a, 1.0 - 2.0 * a], wa),
        ([1.0 - 2.0 * b, b, b], wb),
        ([b, 1.0 - 2.0 * b, b], wb),
        ([b, b, 1.0 - 2.0 * b], wb),
    ]
}

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

/// The corners of a tetrahedron's faces, counter-clockwise as seen from outside.
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

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

#[cfg(test)]
mod tests {
    use super::*;

    fn factorial(n: u32) -> f64 {
        (1..=n).map(f64::from).product()
    }

    /// Mean of L₀^a L₁^b … over a simplex of dimension d: d! a! b! … / (d + a + b + …)!.
    #[test]
    fn rules_are_exact_to_degree_7_and_5() {
        for (a, b, c) in (0..=7_u32)
            .flat_map(|a| (0..=7 - a).map(move |b| (a, b)))
            .flat_map(|(a, b)| (0..=7 - a - b).map(move |c| (a, b, c)))
        {
            let product = |at: &[f64]| at[0].powi(a as i32) * at[1].powi(b as i32) * at[2].powi(c as i32);
            let powers = factorial(a) * factorial(b) * factorial(c);
            let solid: f64 = tetrahedron_rule().iter().map(|(at, w)| w * product(at)).sum();
            assert!((solid - 6.0 * powers / factorial(3 + a + b + c)).abs() < 1e-15, "{a} {b} {c}");
            if a + b + c <= 5 {
                let flat: f64 = triangle_rule().iter().map(|(at, w)| w * product(at)).sum();
                assert!((flat - 2.0 * powers / factorial(2 + a + b + c)).abs() < 1e-15, "{a} {b} {c}");
            }
        }
    }
}
