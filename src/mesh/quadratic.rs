//! Quadratic tetrahedra: the nodes between the corners, and the map they span.
//!
//! In: a linear mesh, and where the middle of each edge is. Out: the mesh with [`TetMesh::mids`].
//!
//! ```text
//! N_i = L_i (2 L_i - 1)     N_ij = 4 L_i L_j     x(L) = Σ N_a(L) x_a
//! ```
//!
//! with barycentric coordinates L (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed., section 8.10).

use super::{EDGES, Surface, TetMesh};
use nalgebra::{Matrix3, Vector3};
use std::collections::{HashMap, HashSet};

/// Where the middle of an edge between two points lies: on the body's curved wall, or half way.
pub type Curve<'a> = &'a dyn Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>;

/// The middle of a straight edge.
pub fn straight(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    a + (b - a) * 0.5
}

/// `mesh` with a node between every two corners that share an edge, placed by `curve`, its tag above all others;
/// groups are carried along ([`grow_groups`]). A mesh that is quadratic already is returned as it is.
pub fn quadratic(mut mesh: TetMesh, curve: Curve<'_>) -> TetMesh {
    if !mesh.mids.is_empty() {
        return mesh;
    }
    let mut mid_of: HashMap<[u32; 2], u32> = HashMap::new();
    let mut ends = Vec::new();
    let mut tag = mesh.tags.iter().copied().max().unwrap_or(0);
    let mut mids = Vec::with_capacity(mesh.tets.len());
    for tet in &mesh.tets {
        mids.push(edges_of(tet).map(|edge| {
            *mid_of.entry(edge).or_insert_with(|| {
                let middle = curve(&mesh.nodes[edge[0] as usize], &mesh.nodes[edge[1] as usize]);
                mesh.nodes.push(middle);
                tag = tag.wrapping_add(1);
                mesh.tags.push(tag);
                ends.push(edge);
                (mesh.nodes.len() - 1) as u32
            })
        }));
    }
    grow_groups(&mut mesh, &ends);
    mesh.mids = mids;
    mesh
}

/// The six edges of a tetrahedron in the order of [`EDGES`], each ascending.
pub fn edges_of(tet: &[u32; 4]) -> [[u32; 2]; 6] {
    EDGES.map(|edge| edge.map(|corner| tet[corner])).map(|[a, b]| [a.min(b), a.max(b)])
}

/// Takes the last `ends.len()` nodes of a linear mesh, each new on the edge between two others (ascending), into the
/// groups of both its ends. Where a group is not a volume, that is where no tetrahedron around the edge has all its
/// corners in it, only along the surface: a group of a wall does not grow inward.
pub fn grow_groups(mesh: &mut TetMesh, ends: &[[u32; 2]]) {
    if mesh.groups.is_empty() {
        return;
    }
    let surface = surface_edges(mesh);
    let first = mesh.nodes.len() - ends.len();
    let mut is_member = vec![false; mesh.nodes.len()];
    for group in mesh.groups.values_mut() {
        group.iter().for_each(|&node| is_member[node as usize] = true);
        let inside: HashSet<[u32; 2]> = mesh
            .tets
            .iter()
            .filter(|tet| tet.iter().all(|&corner| is_member[corner as usize]))
            .flat_map(edges_of)
            .collect();
        let joins = |edge: &[u32; 2]| {
            edge.iter().all(|&end| is_member[end as usize])
                && (surface.contains(edge) || inside.contains(edge))
        };
        let joining = ends.iter().zip(first as u32..).filter(|(edge, _)| joins(edge)).map(|(_, node)| node);
        let joining: Vec<u32> = joining.collect();
        group.iter().for_each(|&node| is_member[node as usize] = false);
        group.extend(joining);
    }
}

/// Edges of the linear surface of `mesh`, by ascending mesh nodes.
fn surface_edges(mesh: &TetMesh) -> HashSet<[u32; 2]> {
    let surface = Surface::of(mesh);
    let edges = surface.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    edges
        .map(|edge| edge.map(|corner| surface.nodes[corner as usize]))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect()
}

/// The ten nodes of tetrahedron `tet` of a quadratic mesh: corners, then mids.
pub fn nodes(mesh: &TetMesh, tet: usize) -> [u32; 10] {
    let (corners, mids) = (mesh.tets[tet], mesh.mids[tet]);
    std::array::from_fn(|a| if a < 4 { corners[a] } else { mids[a - 4] })
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
    let corners = (0..4).map(|corner| std::array::from_fn(|i| f64::from(u8::from(i == corner))));
    let middles = EDGES.map(|edge| std::array::from_fn(|i| if edge.contains(&i) { 0.5 } else { 0.0 }));
    let least = corners
        .chain(middles)
        .chain([[0.25; 4]])
        .map(|at| jacobian(&x, &local_gradients(&at)).determinant())
        .fold(f64::INFINITY, |least, value| if value < least || value.is_nan() { value } else { least });
    least / straight
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, Tube, block, quality, tube};

    #[test]
    fn shapes_are_one_at_their_own_node_and_sum_to_one() {
        for own in 0..10 {
            let at: [f64; 4] = std::array::from_fn(|i| match own {
                0..4 => f64::from(u8::from(i == own)),
                _ => {
                    if EDGES[own - 4].contains(&i) {
                        0.5
                    } else {
                        0.0
                    }
                }
            });
            let n = shapes(&at);
            assert!((0..10).all(|a| n[a] == f64::from(u8::from(a == own))), "{own}: {n:?}");
        }
        let at = [0.1, 0.2, 0.3, 0.4];
        assert!((shapes(&at).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        assert!(local_gradients(&at).iter().sum::<Vector3<f64>>().amax() < 1e-15);
    }

    #[test]
    fn a_straight_mesh_has_jacobian_one_and_one_node_an_edge() {
        let linear = block(&Block { size: [1.0, 2.0, 3.0], cells: [2, 3, 2] }).unwrap();
        let edges: HashSet<[u32; 2]> = linear
            .tets
            .iter()
            .flat_map(|tet| EDGES.map(|edge| edge.map(|corner| tet[corner])))
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        let mesh = quadratic(linear.clone(), &straight);
        assert_eq!(mesh.nodes.len(), linear.nodes.len() + edges.len());
        assert_eq!(mesh.tags.last(), Some(&(mesh.nodes.len() as u64)));
        for tet in 0..mesh.tets.len() {
            assert!((least_jacobian(&mesh, tet) - 1.0).abs() < 1e-12);
        }
        let (linear, surface) = (Surface::of(&linear), Surface::of(&mesh));
        assert_eq!(surface.triangles.len(), 4 * linear.triangles.len());
        assert!((surface.volume(&mesh) - 6.0).abs() < 1e-12);
        assert!((surface.area(&mesh) - 22.0).abs() < 1e-12);
    }

    /// The groups of a face hold what lies on the face and no more, in one layer of cells too.
    #[test]
    fn groups_take_the_nodes_between_but_do_not_grow_inward() {
        for cells in [[1, 1, 1], [3, 2, 1]] {
            let mesh = quadratic(block(&Block { size: [1.0; 3], cells }).unwrap(), &straight);
            for (name, axis, end) in [("xmin", 0, -0.5), ("zmax", 2, 0.5)] {
                let there: Vec<u32> = (0..mesh.nodes.len() as u32)
                    .filter(|&node| (mesh.nodes[node as usize][axis] - end).abs() < 1e-12)
                    .collect();
                assert_eq!(mesh.groups[name], there, "{name} of {cells:?}");
            }
        }
        let ring = Tube {
            inner_radius: 0.5,
            outer_radius: 1.0,
            length: 1.0,
            radial: 1,
            around: 8,
            along: 4,
            control_length: 0.0,
        };
        let mesh = quadratic(tube(&ring).unwrap(), &|a, b| ring.curve(a, b));
        for (name, radius) in [("inner", 0.5), ("outer", 1.0)] {
            let there: Vec<u32> = (0..mesh.nodes.len() as u32)
                .filter(|&node| (mesh.nodes[node as usize].yz().norm() - radius).abs() < 1e-12)
                .collect();
            assert_eq!(mesh.groups[name], there, "{name}");
        }
        let exact = std::f64::consts::PI * 0.75;
        let error = |mesh: &TetMesh| (Surface::of(mesh).volume(mesh) - exact).abs() / exact;
        assert!(error(&mesh) < 0.03 && error(&tube(&ring).unwrap()) > 0.09);
        assert!((0..mesh.tets.len()).all(|tet| least_jacobian(&mesh, tet) > 0.3));
        assert_eq!(quality::components(&mesh).nodes[0].len(), mesh.nodes.len());
    }
}
