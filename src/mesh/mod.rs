//! Tetrahedral meshes: read from a file or generated, checked, and their outer surface.
//!
//! In: file bytes or a generator's parameters. Out: a [`TetMesh`] with positively oriented tetrahedra and
//! every node used, notices of what was repaired, and its [`Surface`] with outward triangles.

use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A tetrahedral mesh. All indices are 0-based; lengths in metres.
///
/// Invariants kept by readers and generators: every tetrahedron has positive signed volume
/// (x₁-x₀)·((x₂-x₀)×(x₃-x₀))/6 unless it is degenerate, every node belongs to a tetrahedron.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    pub nodes: Vec<Vector3<f64>>,
    /// The node's number in its file, unique; 1-based for generated meshes.
    pub tags: Vec<u64>,
    pub tets: Vec<[u32; 4]>,
    /// Region (physical volume) per tetrahedron; 0 where the file names none.
    pub regions: Vec<u32>,
    pub region_names: BTreeMap<u32, String>,
    /// Named node groups: sorted, unique node indices.
    pub groups: BTreeMap<String, Vec<u32>>,
}

/// The outer surface of a [`TetMesh`]: triangles oriented outward over the surface nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Corners as indices into `nodes`.
    pub triangles: Vec<[u32; 3]>,
    /// Mesh node of each surface node, ascending.
    pub nodes: Vec<u32>,
}
