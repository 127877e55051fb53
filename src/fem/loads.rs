//! Consistent nodal forces: f_a = ∫ N_a b dV of body forces, ∫ N_a t dA of tractions, and those of thermal expansion.
//!
//! In: a mesh, and the force at a place. Out: a force for each node. Shape functions are those of the elements (Zienkiewicz and
//! Taylor, The Finite Element Method, vol. 1, 5th ed., section 2.3), so that the forces do the work on every displacement of
//! the elements that the loads do.

use super::quadrature::{STRAIGHT, tetrahedron_rule, triangle_rule};
use super::stiffness::{NodeFields, StiffnessMatrix};
use crate::mesh::{TetMesh, quadratic};
use nalgebra::Vector3;
use rayon::prelude::*;

type V3 = Vector3<f64>;

/// ∫ N_a b dV of b(tetrahedron, place), N/m³. Exact for b linear in the place, of curved elements too.
pub fn body_force(mesh: &TetMesh, b: &(dyn Fn(usize, &V3) -> V3 + Sync)) -> Vec<V3> {
    let fine = tetrahedron_rule();
    let of_tet = |tet: usize| -> Vec<(u32, V3)> {
        if mesh.mids.is_empty() {
            let x = mesh.corners(tet);
            let volume = (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0])) / 6.0;
            let mut force = [V3::zeros(); 4];
            for (at, weight) in STRAIGHT {
                let place: V3 = x.iter().zip(at).map(|(x, l)| x * *l).sum();
                let own = b(tet, &place) * (weight * volume);
                force.iter_mut().zip(at).for_each(|(force, l)| *force += own * *l);
            }
            return mesh.tets[tet].into_iter().zip(force).collect();
        }
        let nodes = quadratic::nodes(mesh, tet);
        let x = nodes.map(|node| mesh.nodes[node as usize]);
        let mut force = [V3::zeros(); 10];
        for (at, weight) in &fine {
            let shapes = quadratic::shapes(at);
            let determinant = quadratic::jacobian(&x, &quadratic::local_gradients(at)).determinant();
            let place: V3 = x.iter().zip(&shapes).map(|(x, n)| x * *n).sum();
            let own = b(tet, &place) * (weight * determinant / 6.0);
            force.iter_mut().zip(&shapes).for_each(|(force, n)| *force += own * *n);
        }
        nodes.into_iter().zip(force).collect()
    };
    let parts: Vec<_> = (0..mesh.tets.len()).into_par_iter().map(of_tet).collect();
    gathered(mesh, parts)
}

/// A point of a face, at which a traction is asked for.
#[derive(Clone, Copy, Debug)]
pub struct FacePoint<'a> {
    /// m.
    pub place: V3,
    /// Outward, of length 1.
    pub normal: V3,
    /// Nodes of the face: its corners, and of a curved one the nodes between first and second, second and third, third and first.
    pub nodes: &'a [u32],
    /// The shape functions of these nodes there.
    pub shapes: &'a [f64],
}

/// ∫ N_a t dA over `faces` ([`crate::mesh::outer_faces`]) of the traction t at a point, N/m².
pub fn traction(mesh: &TetMesh, faces: &[Vec<u32>], t: &dyn Fn(&FacePoint) -> V3) -> Vec<V3> {
    let parts = faces.iter().map(|face| {
        let mut force = vec![V3::zeros(); face.len()];
        for point in points(mesh, face) {
            let size = point.area.norm();
            let at = FacePoint {
                place: point.place,
                normal: point.area / size,
                nodes: face,
                shapes: &point.shapes,
            };
            let own = t(&at) * size;
            force.iter_mut().zip(&point.shapes).for_each(|(force, n)| *force += own * *n);
        }
        face.iter().copied().zip(force).collect()
    });
    gathered(mesh, parts.collect())
}

/// Uniform expansion by a strain of 1, m: about the middle, for far from the origin digits would be lost.
pub fn free_expansion(mesh: &TetMesh) -> NodeFields {
    let middle = mesh.nodes.iter().sum::<V3>() / mesh.nodes.len().max(1) as f64;
    let mut expanded = NodeFields::zeros(mesh.nodes.len(), 1);
    for (value, x) in expanded.data.chunks_exact_mut(3).zip(&mesh.nodes) {
        value.copy_from_slice((x - middle).as_slice());
    }
    expanded
}

/// The forces with which uniform expansion by a strain of 1 loads a body that is held at its shape: K times the expansion
/// itself, since its strain is that which is then without stress, in every element and material.
pub fn expansion(mesh: &TetMesh, k: &StiffnessMatrix) -> Vec<V3> {
    let mut force = NodeFields::zeros(mesh.nodes.len(), 1);
    k.multiply(&free_expansion(mesh), &mut force);
    force.data.chunks_exact(3).map(V3::from_column_slice).collect()
}

/// Size, middle and normal of some faces, and their second moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// m².
    pub size: f64,
    /// m.
    pub middle: V3,
    /// ∫ n dA, m²; zero of a closed surface.
    pub normal: V3,
}

impl Area {
    pub fn new(mesh: &TetMesh, faces: &[Vec<u32>]) -> Area {
        let all = || faces.iter().flat_map(|face| points(mesh, face));
        let size: f64 = all().map(|point| point.area.norm()).sum();
        let middle = all().map(|point| point.place * point.area.norm()).sum::<V3>() / size;
        Area { size, middle, normal: all().map(|point| point.area).sum() }
    }
}

/// One point of a face: where it is, its share of the area with the normal, m², and the shape functions there.
struct Point {
    place: V3,
    area: V3,
    shapes: Vec<f64>,
}

fn points(mesh: &TetMesh, face: &[u32]) -> Vec<Point> {
    let x: Vec<V3> = face.iter().map(|&node| mesh.nodes[node as usize]).collect();
    let point = |(l, weight): ([f64; 3], f64)| {
        let [a, b, c] = l;
        // Shape functions, and their slopes by b and c with a = 1 - b - c.
        let (shapes, by_b, by_c) = match x.len() {
            3 => (l.to_vec(), vec![-1.0, 1.0, 0.0], vec![-1.0, 0.0, 1.0]),
            _ => (
                vec![
                    a * (2.0 * a - 1.0),
                    b * (2.0 * b - 1.0),
                    c * (2.0 * c - 1.0),
                    4.0 * a * b,
                    4.0 * b * c,
                    4.0 * c * a,
                ],
                vec![1.0 - 4.0 * a, 4.0 * b - 1.0, 0.0, 4.0 * (a - b), 4.0 * c, -4.0 * c],
                vec![1.0 - 4.0 * a, 0.0, 4.0 * c - 1.0, -4.0 * b, 4.0 * b, 4.0 * (a - c)],
            ),
        };
        let sum = |weights: &[f64]| x.iter().zip(weights).map(|(x, w)| x * *w).sum::<V3>();
        Point { place: sum(&shapes), area: sum(&by_b).cross(&sum(&by_c)) * (0.5 * weight), shapes }
    };
    triangle_rule().into_iter().map(point).collect()
}

fn gathered(mesh: &TetMesh, parts: Vec<Vec<(u32, V3)>>) -> Vec<V3> {
    let mut all = vec![V3::zeros(); mesh.nodes.len()];
    for (node, force) in parts.into_iter().flatten() {
        all[node as usize] += force;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::Tube;
    use crate::mesh::{Block, block, generate, outer_faces};

    /// Moments of a body force that is linear in the place, against integrals over a block by hand.
    #[test]
    fn body_forces_have_the_moments_of_the_body() {
        let linear = block(&Block { size: [2.0, 1.0, 3.0], cells: [3, 2, 4] }).unwrap();
        let quadratic = quadratic::quadratic(linear.clone(), &quadratic::straight);
        for mesh in [linear, quadratic] {
            // b = (x, 0, 0): ∫ b = 0, ∫ x b_x = ∫ x² dV = 2³/12 · 1 · 3.
            let force = body_force(&mesh, &|_, x| V3::new(x.x, 0.0, 0.0));
            let total: V3 = force.iter().sum();
            let moment: f64 = force.iter().zip(&mesh.nodes).map(|(f, x)| f.x * x.x).sum();
            assert!(total.norm() < 1e-13, "{total}");
            // Linear elements see x² through its nodal interpolation, which for b·x is exact all the same.
            assert!((moment - 2.0).abs() < 1e-12, "{moment}");
        }
    }

    /// Pressure over a closed surface has no resultant; on the inner wall of a curved tube its work on a radial
    /// displacement is that of the cylinder.
    #[test]
    fn tractions_have_the_area_and_normals_of_the_faces() {
        let tube = Tube {
            inner_radius: 0.5,
            outer_radius: 1.0,
            length: 2.0,
            radial: 2,
            around: 24,
            along: 4,
            control_length: 0.0,
        };
        let mesh = quadratic::quadratic(generate::tube(&tube).unwrap(), &|a, b| tube.curve(a, b));
        let faces = outer_faces(&mesh);
        assert!(Area::new(&mesh, &faces).normal.norm() < 1e-12);
        let pressure = traction(&mesh, &faces, &|at| -at.normal);
        assert!(pressure.iter().sum::<V3>().norm() < 1e-12);
        let radius = |node: u32| mesh.nodes[node as usize].yz().norm();
        let inner: Vec<Vec<u32>> =
            faces.into_iter().filter(|face| face.iter().all(|&n| radius(n) < 0.51)).collect();
        let area = Area::new(&mesh, &inner);
        let exact = std::f64::consts::TAU * 0.5 * 2.0;
        assert!((area.size / exact - 1.0).abs() < 1e-4, "{} {exact}", area.size);
        let outward = traction(&mesh, &inner, &|at| -at.normal);
        let work: f64 = outward.iter().zip(&mesh.nodes).map(|(f, x)| f.yz().dot(&x.yz()) / 0.5).sum();
        assert!((work / exact - 1.0).abs() < 1e-3, "{work} {exact}");
    }
}
