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

use crate::base::{input, signal};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

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

fn read(path: &Path) -> Result<Vec<u8>, MeshError> {
    input::read(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })
}

/// [`load`] from a file's `bytes`; `path` tells the format and is named in errors.
///
/// Memory grows with `bytes`, whatever counts stand in them.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Loaded, MeshError> {
    parse_as(path, bytes, Order::Linear)
}

/// [`parse`] with the nodes that `order` keeps.
pub fn parse_as(path: &Path, bytes: &[u8], order: Order) -> Result<Loaded, MeshError> {
    let raw = formats::format_of(path, bytes).and_then(|format| (format.read)(path, bytes));
    let mut raw = raw.map_err(|fault| fault.in_file(path, bytes))?;
    let elements_in = raw.elements_in.take();
    assemble::assemble(raw, order).map_err(|fault| match elements_in {
        Some((path, bytes)) => fault.in_file(&path, &bytes),
        None => fault.in_file(path, bytes),
    })
}

/// Writes `mesh` to the file at `path`, in the format of its extension: by the writer of that name in
/// [`formats::WRITERS`], else by the first for the extension. Returns what the format could not keep, one sentence
/// each. Every file is written beside its place and renamed: it is there whole or not at all.
pub fn save(path: &Path, mesh: &TetMesh, encoding: Option<&str>) -> Result<Vec<String>, MeshError> {
    let encoded = (formats::writer_of(path, encoding)?.encode)(mesh)?;
    for (extension, bytes) in &encoded.files {
        let path = if encoded.files.len() > 1 { path.with_extension(extension) } else { path.to_owned() };
        write_atomically(&path, |file| file.write_all(bytes))
            .map_err(|source| MeshError::Write { path, source })?;
    }
    Ok(encoded.lost)
}

/// Writes a file beside its place, syncs and renames it: it is there whole or not at all, and a signal to end leaves
/// nothing beside it.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut std::fs::File) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.prefix(".greenstage-").tempfile_in(folder)?;
    let (beside, named) = (file.path().to_owned(), path.display().to_string());
    let unwritten = signal::on_end(move || {
        // It may be gone already.
        let _ = std::fs::remove_file(beside);
        Some(format!("{named} was not written"))
    });
    write(file.as_file_mut())?;
    file.as_file().sync_all()?;
    unwritten.settle(|| file.persist(path)).map_err(|error| error.error)?;
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
