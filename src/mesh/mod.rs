//! Tetrahedral meshes: read from a file or generated, checked, and their outer surface.
//!
//! In: file bytes or a generator's parameters. Out: a [`TetMesh`] with positively oriented tetrahedra and
//! every node used, notices of what was repaired, and its [`Surface`] with outward triangles. A file that holds only a
//! surface goes through [`surface_files`], [`surface_check`] and [`isosurface_stuffing`].

pub mod assemble;
pub mod blobs;
pub mod diagnostics;
mod error;
pub mod formats;
pub mod generate;
pub mod geodesic;
pub mod isosurface_stuffing;
pub mod length_unit;
pub mod near;
pub mod quadratic;
pub mod quality;
pub mod refine;
mod scalar;
mod shells;
pub mod split;
mod surface;
pub mod surface_body;
pub mod surface_check;
pub mod surface_files;
pub mod surface_intersect;
mod tet_mesh;
pub mod walls;

pub use assemble::Order;
pub use error::{FormatFault, MeshError, Place};
pub use formats::{Encoding, encode};
pub use generate::{Block, GenerateError, Tube, block, tube};
pub use quadratic::quadratic;
pub use surface::{Surface, outer_faces};
pub use tet_mesh::{EDGES, FACES, LoadedMesh, TetMesh, edges_of};

use crate::base::{input, output};
use formats::Part;
use std::path::{Path, PathBuf};

/// Reads the mesh file at `path`, in any format of [`formats::FORMATS`]; 10-node tetrahedra are reduced to their
/// corners.
pub fn load(path: &Path) -> Result<LoadedMesh, MeshError> {
    parse(path, &read(path)?)
}

/// [`load`] that keeps the nodes between the corners, where the file has them.
pub fn load_quadratic(path: &Path) -> Result<LoadedMesh, MeshError> {
    parse_as(path, &read(path)?, Order::Quadratic)
}

/// Every file of a mesh is read here.
fn read(path: &Path) -> Result<Vec<u8>, MeshError> {
    input::read(path).map_err(|source| MeshError::Read { path: path.to_owned(), source })
}

/// [`load`] from a file's `bytes`; `path` determines the format and is named in errors. Where a format uses several
/// files, the others are read from beside `path`.
///
/// Memory grows with the size of `bytes`, not with the counts that they claim.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<LoadedMesh, MeshError> {
    parse_as(path, bytes, Order::Linear)
}

/// [`parse`] with the nodes that `order` keeps.
pub fn parse_as(path: &Path, bytes: &[u8], order: Order) -> Result<LoadedMesh, MeshError> {
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
/// [`formats::writers`], else by the first for the extension. Returns what the format could not keep, one sentence
/// each. Either all files of the format are written completely, or none ([`output::put_all`]).
pub fn save(path: &Path, mesh: &TetMesh, encoding: Option<&str>) -> Result<Vec<String>, MeshError> {
    let writer = formats::writer_of(path, encoding)?;
    let encoded = (writer.encode)(mesh)?;
    let mut staged = Vec::new();
    for ((target, kind), bytes) in writer.targets(path).zip(&encoded.files) {
        staged.push(output::stage(&target, kind, |file| file.write_all(bytes))?);
    }
    output::put_all(staged, &[])?;
    Ok(encoded.lost)
}

/// Whether [`save`] may write at `path`, before anything is read: see [`output::try_path`]. `input` is what the mesh is
/// to come from.
pub fn try_save(path: &Path, encoding: Option<&str>, input: &Path) -> Result<(), MeshError> {
    let inputs = formats::files_of(input);
    for (target, kind) in formats::writer_of(path, encoding)?.targets(path) {
        output::try_path(&target, kind, &inputs)?;
    }
    Ok(())
}
