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
use std::collections::{BTreeSet, HashMap};

/// Where the middle of an edge between two points lies: on the body's curved wall, or half way.
pub type Curve<'a> = &'a dyn Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>;

/// The middle of a straight edge.
pub fn straight(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    a + (b - a) * 0.5
}

/// `mesh` with a node between every two corners that share an edge, placed by `curve`, its tag above all others;
/// groups are carried along ([`join_groups`]). A mesh that is quadratic already is returned as it is.
pub fn quadratic(mut mesh: TetMesh, curve: Curve<'_>) -> TetMesh {
    if mesh.mids.is_empty() {
        add_mids(&mut mesh, HashMap::new(), curve);
    }
    mesh
}

/// Gives `mesh` its mids: those of `known` edges (ascending corners), and new ones for all others.
pub(super) fn add_mids(mesh: &mut TetMesh, known: HashMap<[u32; 2], u32>, curve: Curve<'_>) {
    let surface_edges = surface_edges(mesh);
    let first = mesh.nodes.len();
    let mut mid_of = known;
    let mut parents = Vec::new();
    let mut tag = mesh.tags.iter().copied().max().unwrap_or(0);
    for tet in &mesh.tets {
        let mids = EDGES.map(|edge| {
            let [a, b] = edge.map(|corner| tet[corner]);
            *mid_of.entry([a.min(b), a.max(b)]).or_insert_with_key(|&[a, b]| {
                let middle = curve(&mesh.nodes[a as usize], &mesh.nodes[b as usize]);
                mesh.nodes.push(middle);
                tag = tag.wrapping_add(1);
                mesh.tags.push(tag);
                parents.push([a, b]);
                (mesh.nodes.len() - 1) as u32
            })
        });
        mesh.mids.push(mids);
    }
    join_groups(mesh, &surface_edges, first, &parents);
}

/// Adds nodes `first`.., each new between two `parents`, to the groups of both; to a group that lies on the surface
/// only along an edge of the surface, so that it does not grow inward.
pub fn join_groups(
    mesh: &mut TetMesh,
    surface_edges: &BTreeSet<[u32; 2]>,
    first: usize,
    parents: &[[u32; 2]],
) {
    let mut on_surface = vec![false; mesh.nodes.len()];
    surface_edges.iter().flatten().for_each(|&node| on_surface[node as usize] = true);
    for group in mesh.groups.values_mut() {
        let is_surface = group.iter().all(|&node| on_surface[node as usize]);
        let holds = |node: &u32| group.binary_search(node).is_ok();
        let joining: Vec<u32> = parents
            .iter()
            .zip(first as u32..)
            .filter(|(pair, _)| pair.iter().all(holds) && (!is_surface || surface_edges.contains(*pair)))
            .map(|(_, node)| node)
            .collect();
        group.extend(joining);
    }
}

/// Edges of the linear surface of `mesh`, by ascending mesh nodes.
pub fn surface_edges(mesh: &TetMesh) -> BTreeSet<[u32; 2]> {
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
        let edges: BTreeSet<[u32; 2]> = linear
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
