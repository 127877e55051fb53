//! Tetrahedral meshes: read from a file or generated, checked, and their outer surface.
//!
//! In: file bytes or a generator's parameters. Out: a [`TetMesh`] with positively oriented tetrahedra and
//! every node used, notices of what was repaired, and its [`Surface`] with outward triangles. A file that holds only a
//! surface goes through [`surface_files`], [`surface_check`] and [`stuffing`].

pub mod assemble;
mod error;
pub mod formats;
pub mod generate;
mod groups;
pub mod grow;
pub mod near;
pub mod quadratic;
pub mod quality;
pub mod refine;
pub mod stuffing;
mod surface;
pub mod surface_check;
pub mod surface_files;
pub mod surface_intersect;
pub mod trouble;

pub use assemble::Order;
pub use error::{Fault, MeshError, Place};
pub use formats::{Encoding, encode};
pub use generate::{Block, GenerateError, Tube, block, tube};
pub use quadratic::quadratic;

use crate::base::{input, output};
use formats::Part;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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
    /// Of a quadratic mesh: per tetrahedron the nodes between its corners, on the edges of [`EDGES`]. Empty for a
    /// linear one.
    pub mids: Vec<[u32; 6]>,
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

/// A mesh from a file, and what was repaired or left out on the way, one sentence each.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    pub mesh: TetMesh,
    pub notices: Vec<String>,
}

/// Reads the mesh file at `path`, of any format in [`formats::FORMATS`]; of 10-node tetrahedra the corners.
pub fn load(path: &Path) -> Result<Loaded, MeshError> {
    parse(path, &read(path)?)
}

/// [`load`] that keeps the nodes between the corners, where the file has them.
pub fn load_quadratic(path: &Path) -> Result<Loaded, MeshError> {
    parse_as(path, &read(path)?, Order::Quadratic)
}

/// Every file of a mesh is read here.
fn read(path: &Path) -> Result<Vec<u8>, MeshError> {
    input::read(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })
}

/// [`load`] from a file's `bytes`; `path` tells the format and is named in errors. The other files of a format that is
/// spread over several are read from beside it.
///
/// Memory grows with `bytes`, whatever counts stand in them.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Loaded, MeshError> {
    parse_as(path, bytes, Order::Linear)
}

/// [`parse`] with the nodes that `order` keeps.
pub fn parse_as(path: &Path, bytes: &[u8], order: Order) -> Result<Loaded, MeshError> {
    let part = |path: PathBuf| read(&path).map(|bytes| Part { path, bytes });
    let others: Result<Vec<Part>, _> = formats::files_of(path).into_iter().skip(1).map(part).collect();
    let others = others.map_err(|error| MeshError::Refused {
        path: path.to_owned(),
        reason: format!("holds a part of the mesh alone, and {error}"),
    })?;
    let raw = formats::format_of(path, bytes).and_then(|format| (format.read)(bytes, &others));
    let raw = raw.map_err(|fault| fault.in_file(path, bytes))?;
    let elements_in = raw.elements_in.and_then(|other| others.get(other));
    assemble::assemble(raw, order).map_err(|fault| match elements_in {
        Some(other) => fault.in_file(&other.path, &other.bytes),
        None => fault.in_file(path, bytes),
    })
}

/// Writes `mesh` to the file at `path`, in the format of its extension: by the writer of that name in
/// [`formats::WRITERS`], else by the first for the extension. Returns what the format could not keep, one sentence
/// each. All files of the format are there whole, or none is ([`output::stage`]).
pub fn save(path: &Path, mesh: &TetMesh, encoding: Option<&str>) -> Result<Vec<String>, MeshError> {
    let writer = formats::writer_of(path, encoding)?;
    let encoded = (writer.encode)(mesh)?;
    let mut staged = Vec::new();
    for ((target, kind), (_, bytes)) in formats::targets(writer, path).iter().zip(&encoded.files) {
        staged.push(output::stage(target, kind, |file| file.write_all(bytes))?);
    }
    staged.into_iter().try_for_each(output::Staged::put)?;
    Ok(encoded.lost)
}

/// Whether [`save`] may write at `path`, before anything is read: see [`output::try_path`]. `input` is what the mesh is
/// to come from.
pub fn try_save(path: &Path, encoding: Option<&str>, input: &Path) -> Result<(), MeshError> {
    let inputs = formats::files_of(input);
    for (target, kind) in formats::targets(formats::writer_of(path, encoding)?, path) {
        output::try_path(&target, kind, &inputs)?;
    }
    Ok(())
}

/// The outer surface of a [`TetMesh`]: triangles oriented outward over the surface nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Corners as indices into `nodes`.
    pub triangles: Vec<[u32; 3]>,
    /// Mesh node of each surface node, ascending.
    pub nodes: Vec<u32>,
}
