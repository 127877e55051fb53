//! Mesh file formats: one file each, and one line in [`FORMATS`].
//!
//! In: a file's bytes. Out: a [`RawMesh`], not yet checked, or the place and reason of
//! a fault.

mod abaqus;
mod abaqus_sets;
mod abaqus_write;
mod gmsh;
mod gmsh2;
mod gmsh4;
mod gmsh_scan;
mod gmsh_write;
mod medit;
mod tetgen;
mod vtk;
mod vtk_cells;
mod vtu;
mod vtu_array;
pub mod vtu_write;
mod words;
mod write;

pub use gmsh_write::{Encoding, encode};
pub use write::{Encoded, WRITERS, Writer, targets, writer_of};

use super::assemble::RawMesh;
use super::error::Fault;
use std::path::{Path, PathBuf};

/// How one file format is recognised and read.
pub struct Format {
    pub name: &'static str,
    /// In lower case, without the dot.
    pub extensions: &'static [&'static str],
    /// Whether these are the first bytes of such a file, whatever its name.
    pub recognizes: fn(&[u8]) -> bool,
    /// The files beside the one of this path over which such a mesh is spread, found by their names.
    pub others: fn(&Path) -> Vec<PathBuf>,
    /// From the bytes of the named file, and the others in their order. A reader opens no file itself: what it is given
    /// here is what the fingerprint of a precomputed body covers.
    pub read: fn(&[u8], &[Part]) -> Result<RawMesh, Fault>,
}

/// Another file of a mesh.
pub struct Part {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
}

/// Every format that can be read.
pub const FORMATS: &[Format] =
    &[gmsh::FORMAT, vtk::FORMAT, vtu::FORMAT, tetgen::FORMAT, abaqus::FORMAT, medit::FORMAT];

/// The format of a file: by its extension, else by its first bytes.
pub fn format_of(path: &Path, bytes: &[u8]) -> Result<&'static Format, Fault> {
    by_extension(path).or_else(|| FORMATS.iter().find(|format| (format.recognizes)(bytes))).ok_or_else(|| {
        let known: Vec<String> =
            FORMATS.iter().map(|f| format!("{} (.{})", f.name, f.extensions.join(", ."))).collect();
        Fault::whole(format!("not a mesh file that can be read; known are {}", known.join(", ")))
    })
}

fn by_extension(path: &Path) -> Option<&'static Format> {
    let extension = path.extension()?.to_string_lossy().to_lowercase();
    FORMATS.iter().find(|format| format.extensions.contains(&extension.as_str()))
}

/// All files that are read for the mesh or the surface at `path`, that one first.
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let others = by_extension(path).map_or_else(Vec::new, |format| (format.others)(path));
    std::iter::once(path.to_owned()).chain(others).collect()
}
