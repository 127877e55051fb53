//! Uniform refinement: cuts every tetrahedron into eight and keeps groups, regions and curved walls.
//!
//! In: a mesh, how often, and where the middle of an edge lies. Out: the finer mesh, whose old nodes keep index and
//! tag. Each tetrahedron x₀x₁x₂x₃ is cut into its four corners and the octahedron between them, and that into four
//! around the diagonal x₀₂x₁₃, with the children's corners in the order of Bey (Tetrahedral grid refinement, Computing
//! 55, 1995):
//!
//! ```text
//! x₀ x₀₁ x₀₂ x₀₃    x₀₁ x₁ x₁₂ x₁₃    x₀₂ x₁₂ x₂ x₂₃    x₀₃ x₁₃ x₂₃ x₃
//! x₀₁ x₀₂ x₀₃ x₁₃   x₀₁ x₀₂ x₁₂ x₁₃   x₀₂ x₀₃ x₁₃ x₂₃   x₀₂ x₁₂ x₁₃ x₂₃
//! ```
//!
//! In that order at most three shapes arise from a tetrahedron however often it is cut. The corners are first put in
//! an order in which x₀₂x₁₃ is the shortest of the three diagonals: on 300 random tetrahedra the least quality after
//! four cuts is then 0.92 of the first in the mean and 0.68 at worst, against 0.76 and 0.68 in any order; the lattice of
//! isosurface stuffing keeps 1.00 against 0.72. The shortest diagonal at every cut has the same least quality, but made
//! five shapes of some.

use super::diagnostics::{FLAT, place};
use super::generate::{MAX_TETRAHEDRA, MEMORY};
use super::quadratic::{self, Curve};
use super::quality::{quality, signed_volume};
use super::tet_mesh::{EDGES, TetMesh};
use crate::base::machine::{self, TooLarge};
use nalgebra::Vector3;
use std::collections::HashMap;

/// Largest number of refinements: this many make 4096 tetrahedra of each.
pub const MOST: u32 = 4;

/// The reason why a mesh could not be refined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RefineError {
    #[error(
        "{asked} refinements are more than {MOST}, which make 4096 tetrahedra of each: begin with a finer mesh"
    )]
    TooOften { asked: u32 },
    #[error(
        "{before} tetrahedra refined {times} times are {after}, more than {MAX_TETRAHEDRA}: refine less often, or \
         begin with fewer"
    )]
    TooMany { before: usize, times: u32, after: u128 },
    #[error("{0}: refine less often")]
    Memory(#[from] TooLarge),
    #[error(
        "the node tag {largest} leaves no tags for new nodes beyond it: number the nodes of the mesh from 1 on"
    )]
    Tags { largest: u64 },
    #[error(
        "tetrahedron {tet} at {} is folded by its curved edges when it is refined (volume {volume:.1e} m³): begin with \
         a finer mesh there", place(.at)
    )]
    Folded { tet: usize, at: Vector3<f64>, volume: f64 },
}

/// Bey's children by the parent's ten nodes: corners, then mids on [`EDGES`]; whether they are mirror images of it in
/// that order.
const CHILDREN: [([usize; 4], bool); 8] = [
    ([0, 4, 6, 7], false),
    ([4, 1, 5, 9], false),
    ([6, 5, 2, 8], false),
    ([7, 9, 8, 3], false),
    ([4, 6, 7, 9], false),
    ([4, 6, 5, 9], true),
    ([6, 7, 9, 8], false),
    ([6, 5, 9, 8], true),
];

/// Orders of the corners that make each of the three diagonals x₀₂x₁₃; whether they mirror.
const ORDERS: [([usize; 4], bool); 3] = [([0, 1, 2, 3], false), ([0, 2, 1, 3], true), ([1, 0, 2, 3], true)];

/// `mesh` with every tetrahedron cut into 8^`times`. New nodes of a linear mesh stand where `curve` says, those of a
/// quadratic one on its own curved edges and faces.
pub fn refine(mesh: TetMesh, times: u32, curve: Curve<'_>) -> Result<TetMesh, RefineError> {
    let before = mesh.tets.len();
    if times > MOST {
        return Err(RefineError::TooOften { asked: times });
    }
    let after = before as u128 * 8u128.pow(times);
    if after > MAX_TETRAHEDRA {
        return Err(RefineError::TooMany { before, times, after });
    }
    machine::expect(format!("a mesh of {after} tetrahedra"), MEMORY * after as f64)?;
    check_tags(&mesh, after as u64)?;
    let sound: Vec<bool> = (0..before).map(|tet| quality(&mesh.corners(tet)) > FLAT).collect();
    let mut mesh = mesh;
    let mut mirrored = order(&mut mesh);
    for _ in 0..times {
        mesh = if mesh.mids.is_empty() { cut(&quadratic::quadratic(mesh, curve)) } else { cut_curved(&mesh) };
        mirrored = mirrored.iter().flat_map(|parent| CHILDREN.map(|(_, mirrors)| parent ^ mirrors)).collect();
    }
    mirrored
        .iter()
        .zip(0..)
        .filter(|(mirrored, _)| **mirrored)
        .for_each(|(_, tet)| turn(&mut mesh, tet, [0, 1, 3, 2]));
    let folded = |tet: &usize| {
        let volume = signed_volume(&mesh.corners(*tet));
        sound[tet >> (3 * times)] && (volume <= 0.0 || volume.is_nan())
    };
    match (0..mesh.tets.len()).find(folded) {
        Some(tet) => {
            let corners = mesh.corners(tet);
            let at = corners.iter().sum::<Vector3<f64>>() / 4.0;
            Err(RefineError::Folded { tet: tet >> (3 * times), at, volume: signed_volume(&corners) })
        }
        None => Ok(mesh),
    }
}

/// Errors where the nodes that `tets` tetrahedra bring, 25 each at most, would find no tags beyond the largest.
pub fn check_tags(mesh: &TetMesh, tets: u64) -> Result<(), RefineError> {
    let largest = mesh.tags.iter().copied().max().unwrap_or(0);
    match largest.checked_add(32 * tets) {
        Some(_) => Ok(()),
        None => Err(RefineError::Tags { largest }),
    }
}

/// Reorders every tetrahedron's corners so that it is cut along its shortest diagonal; returns which were mirrored.
fn order(mesh: &mut TetMesh) -> Vec<bool> {
    let choose = |tet: usize| {
        let x = mesh.corners(tet);
        // Twice the diagonal between the middles of x₀x₂ and x₁x₃.
        let length = |[a, b, c, d]: [usize; 4]| (x[a] + x[c] - x[b] - x[d]).norm_squared();
        // The first of lengths that are equal up to rounding.
        let shortest = ORDERS.iter().map(|(order, _)| length(*order)).fold(f64::INFINITY, f64::min);
        ORDERS.into_iter().find(|(order, _)| length(*order) <= shortest * (1.0 + 1e-9)).unwrap_or(ORDERS[0])
    };
    let chosen: Vec<([usize; 4], bool)> = (0..mesh.tets.len()).map(choose).collect();
    chosen.iter().zip(0..).for_each(|((order, _), tet)| turn(mesh, tet, *order));
    chosen.into_iter().map(|(_, mirrors)| mirrors).collect()
}

/// Tetrahedron `tet` with its corners in another order, and its mids with them.
fn turn(mesh: &mut TetMesh, tet: usize, order: [usize; 4]) {
    let corners = mesh.tets[tet];
    mesh.tets[tet] = order.map(|corner| corners[corner]);
    if let Some(mids) = mesh.mids.get_mut(tet) {
        let old = *mids;
        *mids = EDGES.map(|edge| {
            let [a, b] = edge.map(|corner| order[corner]);
            EDGES
                .iter()
                .zip(old)
                .find(|(edge, _)| edge.contains(&a) && edge.contains(&b))
                .map_or(0, |(_, mid)| mid)
        });
    }
}

/// The linear mesh of the eight children of every tetrahedron of a quadratic one, over the same nodes.
fn cut(mesh: &TetMesh) -> TetMesh {
    let children = |tet: usize| {
        let nodes = quadratic::nodes(mesh, tet);
        CHILDREN.map(|(corners, _)| corners.map(|node| nodes[node]))
    };
    TetMesh {
        tets: (0..mesh.tets.len()).flat_map(children).collect(),
        mids: Vec::new(),
        regions: mesh.regions.iter().flat_map(|region| [*region; 8]).collect(),
        ..mesh.clone()
    }
}

/// [`cut`] with new mids where the parents' quadratic map x(L) = Σ N_a(L) x_a puts them.
fn cut_curved(mesh: &TetMesh) -> TetMesh {
    let mut places: HashMap<[u32; 2], Vector3<f64>> = HashMap::new();
    for tet in 0..mesh.tets.len() {
        let nodes = quadratic::nodes(mesh, tet);
        let x = nodes.map(|node| mesh.nodes[node as usize]);
        for edge in CHILDREN.iter().flat_map(|(corners, _)| EDGES.map(|edge| edge.map(|i| corners[i]))) {
            let [p, q] = edge.map(quadratic::barycentric);
            let [a, b] = edge.map(|node| nodes[node]);
            places.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let shapes = quadratic::shapes(&std::array::from_fn(|i| 0.5 * (p[i] + q[i])));
                shapes.iter().zip(&x).map(|(n, x)| x * *n).sum()
            });
        }
    }
    let middle = |edge: [u32; 2], x: &[Vector3<f64>]| {
        let [a, b] = edge.map(|node| &x[node as usize]);
        places.get(&edge).copied().unwrap_or_else(|| quadratic::straight(a, b))
    };
    quadratic::with_mids(cut(mesh), &middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    #[test]
    fn children_fill_their_parent_and_mirror_as_the_tables_say() {
        let corners = [[0.1, 0.0, 0.0], [1.0, 0.2, 0.0], [0.0, 1.0, 0.1], [0.3, 0.0, 1.0]];
        let parent = TetMesh {
            nodes: corners.map(Vector3::from).to_vec(),
            tags: vec![1, 2, 3, 4],
            tets: vec![[0, 1, 2, 3]],
            regions: vec![5],
            ..TetMesh::default()
        };
        let whole = signed_volume(&parent.corners(0));
        for (order, mirrors) in ORDERS {
            let volume = signed_volume(&order.map(|corner| parent.nodes[corner]));
            assert_eq!(volume < 0.0, mirrors, "{order:?}");
        }
        let fine = cut(&quadratic::quadratic(parent, &quadratic::straight));
        for (tet, (_, mirrors)) in CHILDREN.iter().enumerate() {
            let eighth = if *mirrors { -whole / 8.0 } else { whole / 8.0 };
            assert!((signed_volume(&fine.corners(tet)) - eighth).abs() < 1e-15, "child {tet}");
        }
        assert_eq!(fine.regions, [5; 8]);
    }

    #[test]
    fn mids_turn_with_their_corners() {
        let linear = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
        let mut mesh = quadratic::quadratic(linear, &quadratic::straight);
        for order in [[0, 1, 3, 2], [0, 2, 1, 3], [3, 1, 0, 2]] {
            turn(&mut mesh, 0, order);
            for ([a, b], mid) in EDGES.iter().zip(mesh.mids[0]) {
                let [a, b] = [a, b].map(|corner| mesh.nodes[mesh.tets[0][*corner] as usize]);
                assert!((mesh.nodes[mid as usize] - (a + b) * 0.5).norm() < 1e-15);
            }
        }
    }

    #[test]
    fn what_is_too_much_is_refused_with_its_count() {
        let mesh = block(&Block { size: [1.0; 3], cells: [10; 3] }).unwrap();
        let error = |mesh: &TetMesh, times: u32| {
            refine(mesh.clone(), times, &quadratic::straight).unwrap_err().to_string()
        };
        let text = error(&mesh, 4);
        assert!(
            text.starts_with("5000 tetrahedra refined 4 times are 20480000, more than 20000000"),
            "{text}"
        );
        assert!(error(&mesh, 5).starts_with("5 refinements are more than 4"));
        let tagged = TetMesh { tags: (0..1331).map(|i| u64::MAX - i).collect(), ..mesh };
        assert!(error(&tagged, 1).starts_with("the node tag 18446744073709551615 leaves no tags"));
    }

    /// The middles of opposite edges are √1.5, √3.5 and √4.5 apart.
    #[test]
    fn the_inner_octahedron_is_cut_along_its_shortest_diagonal() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [3.0, 2.0, 1.0]];
        for order in [[0, 1, 2, 3], [1, 2, 0, 3], [2, 0, 1, 3]] {
            let parent = TetMesh {
                nodes: order.map(|corner| Vector3::from(corners[corner])).to_vec(),
                tags: vec![1, 2, 3, 4],
                tets: vec![[0, 1, 2, 3]],
                regions: vec![0],
                ..TetMesh::default()
            };
            let fine = refine(parent, 1, &quadratic::straight).unwrap();
            let ends = [Vector3::new(1.5, 1.0, 0.5), Vector3::new(0.5, 0.5, 0.0)];
            let holds = |tet: usize| {
                ends.iter().all(|end| fine.corners(tet).iter().any(|x| (x - end).norm() < 1e-12))
            };
            assert_eq!((0..8).filter(|tet| holds(*tet)).count(), 4, "{order:?}");
        }
    }
}
