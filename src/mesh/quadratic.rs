//! Quadratic tetrahedra: the nodes between the corners, the map they span, and the node groups that the new nodes join.
//!
//! In: a linear mesh, and where the middle of each edge is. Out: the mesh with [`TetMesh::mids`].
//!
//! ```text
//! N_i = L_i (2 L_i - 1)     N_ij = 4 L_i L_j     x(L) = Σ N_a(L) x_a
//! ```
//!
//! with barycentric coordinates L (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed., section 8.10).

use super::surface::surface_edges;
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
    join(&mut mesh, first, &ends);
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

/// Adds node `first` + i, which stands on the edge `ends[i]` (ascending) of a linear mesh, to the groups of `mesh` to which
/// it belongs. A group is a set of nodes, and no file says whether it means a volume, a part of the surface or a line, so
/// its nodes decide:
///
/// 1. each is a corner of a tetrahedron that lies in the group with all corners: a volume; the edges of those
///    tetrahedra belong to it;
/// 2. else, all are on the surface: a part of it; edges of the surface between two of its nodes belong to it, but no edge
///    that runs through the body, so that a wall does not grow inward;
/// 3. else every edge between two of its nodes belongs to it.
pub(super) fn join(mesh: &mut TetMesh, first: usize, ends: &[[u32; 2]]) {
    let outer = surface_edges(mesh);
    let mut is_outer = vec![false; mesh.nodes.len()];
    outer.iter().flatten().for_each(|&node| is_outer[node as usize] = true);
    let tets = ByLeast::new(mesh.tets.iter().map(|tet| tet.iter().copied().min().unwrap_or(0)));
    let edges = ByLeast::new(ends.iter().map(|[a, _]| *a));

    for group in mesh.groups.values_mut() {
        let mut joining = Vec::new();
        let holds = |node: &u32| group.binary_search(node).is_ok();
        let (mut solid, mut covered) = (Vec::new(), Vec::new());
        for tet in group.iter().flat_map(|&node| tets.starting_at(node)).map(|tet| mesh.tets[tet as usize]) {
            if tet.iter().all(holds) {
                solid.extend(edges_of(&tet));
                covered.extend(tet);
            }
        }
        solid.sort_unstable();
        covered.sort_unstable();
        covered.dedup();
        let is_volume = covered.len() == group.len();
        let is_surface = group.iter().all(|node| is_outer[*node as usize]);
        for i in group.iter().flat_map(|&node| edges.starting_at(node)) {
            let edge = ends[i as usize];
            let belongs = match (is_volume, is_surface) {
                (true, _) => solid.binary_search(&edge).is_ok(),
                (false, true) => outer.binary_search(&edge).is_ok(),
                (false, false) => true,
            };
            if belongs && holds(&edge[1]) {
                joining.push(first as u32 + i);
            }
        }
        group.append(&mut joining);
        group.sort_unstable();
    }
}

/// Looks up tetrahedra or edges by the least of their nodes.
struct ByLeast {
    /// (least node, number of the thing), sorted.
    sorted: Vec<(u32, u32)>,
}

impl ByLeast {
    fn new(least: impl Iterator<Item = u32>) -> ByLeast {
        let mut sorted: Vec<(u32, u32)> = least.zip(0..).collect();
        sorted.sort_unstable();
        ByLeast { sorted }
    }

    fn starting_at(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.sorted.partition_point(|(least, _)| *least < node);
        self.sorted[first..].iter().take_while(move |(least, _)| *least == node).map(|(_, thing)| *thing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::RING;
    use crate::mesh::{Block, Surface, block, geodesic, quadratic, quality, tube};
    use nalgebra::Vector3;

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
        let (linear, surface) = (Surface::from_mesh(&linear), Surface::from_mesh(&mesh));
        assert_eq!(surface.triangles.len(), 4 * linear.triangles.len());
        assert!((surface.volume(&mesh) - 6.0).abs() < 1e-12);
        assert!((surface.area(&mesh) - 22.0).abs() < 1e-12);
    }

    #[test]
    fn a_ring_is_rounder_with_curved_edges() {
        let mesh = quadratic(tube(&RING).unwrap(), &|a, b| RING.curve(a, b));
        let exact = std::f64::consts::PI * 0.75;
        let error = |mesh: &TetMesh| (Surface::from_mesh(mesh).volume(mesh) - exact).abs() / exact;
        assert!(error(&mesh) < 0.03 && error(&tube(&RING).unwrap()) > 0.09);
        assert!((0..mesh.tets.len()).all(|tet| least_jacobian(&mesh, tet) > 0.3));
        assert_eq!(quality::components(&mesh).nodes[0].len(), mesh.nodes.len());
    }

    /// The group's nodes are those for which `lies_in` holds.
    #[track_caller]
    fn assert_group(mesh: &TetMesh, name: &str, lies_in: impl Fn(&Vector3<f64>) -> bool) {
        let there: Vec<u32> =
            (0..mesh.nodes.len() as u32).filter(|&node| lies_in(&mesh.nodes[node as usize])).collect();
        assert_eq!(mesh.groups[name], there, "{name}");
    }

    #[test]
    fn faces_take_what_lies_on_them_and_no_more() {
        for cells in [[1, 1, 1], [3, 2, 1]] {
            let mesh = quadratic(block(&Block { size: [1.0; 3], cells }).unwrap(), &quadratic::straight);
            assert_group(&mesh, "xmin", |x| x.x < -0.5 + 1e-12);
            assert_group(&mesh, "zmax", |x| x.z > 0.5 - 1e-12);
        }
    }

    /// A wall of one layer: all its nodes are on the surface, whether a group means its skin or its thickness.
    #[test]
    fn skin_and_thickness_of_a_thin_wall_are_told_apart() {
        let mesh = quadratic(tube(&RING).unwrap(), &|a, b| RING.curve(a, b));
        assert_group(&mesh, "left", |x| x.x < -0.25 + 1e-12);
        assert_group(&mesh, "inner", |x| x.yz().norm() < 0.5 + 1e-12);
        assert_group(&mesh, "outer", |x| x.yz().norm() > 1.0 - 1e-12);
    }

    /// Inside the body: a layer of nodes that is neither a volume nor on the surface; a skin, which holds no whole cell.
    #[test]
    fn inner_layers_and_whole_skins_stay_what_they_are() {
        let mut mesh = block(&Block { size: [1.0; 3], cells: [4; 3] }).unwrap();
        let chosen = |inside: &dyn Fn(&Vector3<f64>) -> bool| -> Vec<u32> {
            (0..mesh.nodes.len() as u32).filter(|&node| inside(&mesh.nodes[node as usize])).collect()
        };
        let skin = |x: &Vector3<f64>| x.amax() > 0.5 - 1e-12;
        let (layer, outside) = (chosen(&|x| x.z.abs() < 1e-12), chosen(&skin));
        let (core, one) = (chosen(&|x| x.amax() < 0.26), chosen(&|x| x.amin() > 0.49 && x.min() > 0.0));
        mesh.groups = [("layer", layer), ("skin", outside), ("core", core), ("one", one.clone())]
            .map(|(name, nodes)| (name.to_owned(), nodes))
            .into();
        let mesh = quadratic(mesh, &quadratic::straight);
        assert_group(&mesh, "layer", |x| x.z.abs() < 1e-12);
        assert_group(&mesh, "skin", skin);
        assert_group(&mesh, "core", |x| x.amax() < 0.26);
        assert_eq!((one.len(), &mesh.groups["one"]), (1, &one));
    }
}
