//! The tetrahedral mesh that every other room works on.

use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A tetrahedral mesh. All indices are 0-based; lengths in metres.
///
/// Invariants kept by readers and generators: every tetrahedron has positive signed volume
/// (x₁-x₀)·((x₂-x₀)×(x₃-x₀))/6 unless it is degenerate, every node belongs to a tetrahedron, or to a triangle where there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    pub nodes: Vec<Vector3<f64>>,
    /// The node's number in its file, unique; 1-based for generated meshes.
    pub tags: Vec<u64>,
    pub tets: Vec<[u32; 4]>,
    /// The nodes between the corners of each tetrahedron of a quadratic mesh, on the edges of [`EDGES`]. Empty for a linear one.
    pub mids: Vec<[u32; 6]>,
    /// Triangles of a body that is known by its surface alone ([`super::surface_body`]), outward. Empty where there are
    /// tetrahedra.
    pub triangles: Vec<[u32; 3]>,
    /// Region (physical volume) per tetrahedron; 0 where the file names none.
    pub regions: Vec<u32>,
    pub region_names: BTreeMap<u32, String>,
    /// Named node groups: sorted, unique node indices. A named region read from a file is also a node group.
    pub groups: BTreeMap<String, Vec<u32>>,
}

impl TetMesh {
    /// The four corner positions of tetrahedron `tet`.
    pub fn corners(&self, tet: usize) -> [Vector3<f64>; 4] {
        self.tets[tet].map(|node| self.nodes[node as usize])
    }
}

/// The edges of a tetrahedron by its corners, in Gmsh's order of the nodes between them.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [2, 3], [1, 3]];

/// The faces of a positively oriented tetrahedron, counter-clockwise as seen from outside; face i lies opposite
/// corner 3 - i.
pub const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

/// The six edges of a tetrahedron in the order of [`EDGES`], each ascending.
pub fn edges_of(tet: &[u32; 4]) -> [[u32; 2]; 6] {
    EDGES.map(|edge| edge.map(|corner| tet[corner])).map(|[a, b]| [a.min(b), a.max(b)])
}

/// A mesh from a file, and what was repaired or left out on the way, one sentence each.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedMesh {
    pub mesh: TetMesh,
    pub notices: Vec<String>,
}
