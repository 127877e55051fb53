//! Quadratic tetrahedra: the nodes between the corners, and the map they span.
//!
//! In: a linear mesh, and where the middle of each edge is. Out: the mesh with [`TetMesh::mids`].
//!
//! ```text
//! N_i = L_i (2 L_i - 1)     N_ij = 4 L_i L_j     x(L) = Σ N_a(L) x_a
//! ```
//!
//! with barycentric coordinates L (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed., section 8.10).

use super::groups;
use super::tet_mesh::{EDGES, TetMesh, edges_of};
use nalgebra::{Matrix3, Vector3};
use std::collections::HashMap;

/// A function that places the middle of an edge between two points: on the body's curved wall, or half way.
pub type Curve<'a> = &'a dyn Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>;

/// A function that places the middle, from the ends of the edge (ascending) and all nodes.
pub(super) type Middle<'a> = &'a dyn Fn([u32; 2], &[Vector3<f64>]) -> Vector3<f64>;

/// The middle of a straight edge.
pub fn straight(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    a + (b - a) * 0.5
}

/// `mesh` with a node between every two corners that share an edge, placed by `curve`, its tag above all others. It
/// joins groups that hold both ends: of a volume along its tetrahedra, of a part of the surface along the surface, so
/// that a wall does not grow inward, else along every edge. A mesh that is quadratic already is returned as it is.
pub fn quadratic(mesh: TetMesh, curve: Curve<'_>) -> TetMesh {
    if !mesh.mids.is_empty() {
        return mesh;
    }
    with_mids(mesh, &|[a, b], x| curve(&x[a as usize], &x[b as usize]))
}

/// A linear `mesh` with a node at the `middle` of every edge.
pub(super) fn with_mids(mut mesh: TetMesh, middle: Middle<'_>) -> TetMesh {
    let first = mesh.nodes.len();
    let mut mid_of: HashMap<[u32; 2], u32> = HashMap::new();
    let mut ends = Vec::new();
    let mut tag = mesh.tags.iter().copied().max().unwrap_or(0);
    let mut mids = Vec::with_capacity(mesh.tets.len());
    for tet in &mesh.tets {
        mids.push(edges_of(tet).map(|edge| {
            *mid_of.entry(edge).or_insert_with(|| {
                mesh.nodes.push(middle(edge, &mesh.nodes));
                // `refine::check_tags` is asked where tags come from a file.
                tag = tag.saturating_add(1);
                mesh.tags.push(tag);
                ends.push(edge);
                (mesh.nodes.len() - 1) as u32
            })
        }));
    }
    groups::join(&mut mesh, first, &ends);
    mesh.mids = mids;
    mesh
}

/// The ten nodes of tetrahedron `tet` of a quadratic mesh: corners, then mids.
pub fn nodes(mesh: &TetMesh, tet: usize) -> [u32; 10] {
    let (corners, mids) = (mesh.tets[tet], mesh.mids[tet]);
    std::array::from_fn(|a| if a < 4 { corners[a] } else { mids[a - 4] })
}

/// Barycentric coordinates of the ten nodes: 1 at a corner, ½ and ½ between two.
pub fn barycentric(node: usize) -> [f64; 4] {
    match node {
        0..4 => std::array::from_fn(|i| if i == node { 1.0 } else { 0.0 }),
        _ => std::array::from_fn(|i| if EDGES[node - 4].contains(&i) { 0.5 } else { 0.0 }),
    }
}

/// N_a at barycentric coordinates `at`; Σ N_a = 1.
pub fn shapes(at: &[f64; 4]) -> [f64; 10] {
    std::array::from_fn(|a| match a {
        0..4 => at[a] * (2.0 * at[a] - 1.0),
        _ => 4.0 * at[EDGES[a - 4][0]] * at[EDGES[a - 4][1]],
    })
}

/// ∂N_a/∂ξ at barycentric coordinates `at`, with ξ = (L₁, L₂, L₃) and L₀ = 1 - ξ₁ - ξ₂ - ξ₃.
pub fn local_gradients(at: &[f64; 4]) -> [Vector3<f64>; 10] {
    let slope = [Vector3::new(-1.0, -1.0, -1.0), Vector3::x(), Vector3::y(), Vector3::z()];
    std::array::from_fn(|a| match a {
        0..4 => slope[a] * (4.0 * at[a] - 1.0),
        _ => {
            let [i, j] = EDGES[a - 4];
            (slope[j] * at[i] + slope[i] * at[j]) * 4.0
        }
    })
}

/// J = ∂x/∂ξ = Σ x_a ⊗ ∂N_a/∂ξ.
pub fn jacobian(x: &[Vector3<f64>; 10], local: &[Vector3<f64>; 10]) -> Matrix3<f64> {
    x.iter().zip(local).map(|(x, gradient)| x * gradient.transpose()).sum()
}

/// The least of det J over the ten nodes and the centre, as a part of that of the straight tetrahedron: 1 where all
/// edges are straight and halved, 0 or less where the element is folded.
pub fn least_jacobian(mesh: &TetMesh, tet: usize) -> f64 {
    let x = nodes(mesh, tet).map(|node| mesh.nodes[node as usize]);
    let straight = 6.0 * super::quality::signed_volume(&[x[0], x[1], x[2], x[3]]);
    let least = (0..10)
        .map(barycentric)
        .chain([[0.25; 4]])
        .map(|at| jacobian(&x, &local_gradients(&at)).determinant())
        .fold(f64::INFINITY, |least, value| if value < least || value.is_nan() { value } else { least });
    least / straight
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::RING;
    use crate::mesh::{Block, Surface, block, geodesic, quality, tube};

    #[test]
    fn shapes_are_one_at_their_own_node_and_sum_to_one() {
        for own in 0..10 {
            let n = shapes(&barycentric(own));
            assert!((0..10).all(|a| n[a] == f64::from(u8::from(a == own))), "{own}: {n:?}");
        }
        let at = [0.1, 0.2, 0.3, 0.4];
        assert!((shapes(&at).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        assert!(local_gradients(&at).iter().sum::<Vector3<f64>>().amax() < 1e-15);
    }

    #[test]
    fn a_straight_mesh_has_jacobian_one_and_one_node_an_edge() {
        let linear = block(&Block { size: [1.0, 2.0, 3.0], cells: [2, 3, 2] }).unwrap();
        let mesh = quadratic(linear.clone(), &straight);
        assert_eq!(mesh.nodes.len(), linear.nodes.len() + geodesic::edges(&linear).len());
        assert_eq!(mesh.tags.last(), Some(&(mesh.nodes.len() as u64)));
        for tet in 0..mesh.tets.len() {
            assert!((least_jacobian(&mesh, tet) - 1.0).abs() < 1e-12);
        }
        let (linear, surface) = (Surface::of(&linear), Surface::of(&mesh));
        assert_eq!(surface.triangles.len(), 4 * linear.triangles.len());
        assert!((surface.volume(&mesh) - 6.0).abs() < 1e-12);
        assert!((surface.area(&mesh) - 22.0).abs() < 1e-12);
    }

    #[test]
    fn a_ring_is_rounder_with_curved_edges() {
        let mesh = quadratic(tube(&RING).unwrap(), &|a, b| RING.curve(a, b));
        let exact = std::f64::consts::PI * 0.75;
        let error = |mesh: &TetMesh| (Surface::of(mesh).volume(mesh) - exact).abs() / exact;
        assert!(error(&mesh) < 0.03 && error(&tube(&RING).unwrap()) > 0.09);
        assert!((0..mesh.tets.len()).all(|tet| least_jacobian(&mesh, tet) > 0.3));
        assert_eq!(quality::components(&mesh).nodes[0].len(), mesh.nodes.len());
    }
}
