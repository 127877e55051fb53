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
    /// The path serves formats that spread over several files.
    pub read: fn(&Path, &[u8]) -> Result<RawMesh, Fault>,
}

/// Every format that can be read.
pub const FORMATS: &[Format] =
    &[gmsh::FORMAT, vtk::FORMAT, vtu::FORMAT, tetgen::FORMAT, abaqus::FORMAT, medit::FORMAT];

/// The format of a file: by its extension, else by its first bytes.
pub fn format_of(path: &Path, bytes: &[u8]) -> Result<&'static Format, Fault> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let by_name = FORMATS.iter().find(|format| format.extensions.contains(&extension.as_str()));
    by_name.or_else(|| FORMATS.iter().find(|format| (format.recognizes)(bytes))).ok_or_else(|| {
        let known: Vec<String> =
            FORMATS.iter().map(|f| format!("{} (.{})", f.name, f.extensions.join(", ."))).collect();
        Fault::whole(format!("not a mesh file that can be read; known are {}", known.join(", ")))
    })
}

/// The files that the reader of the mesh at `path` opens.
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let mut files = vec![path.to_owned()];
    if tetgen::FORMAT.extensions.contains(&extension.as_str()) {
        files.push(tetgen::other_file(path));
    }
    files
}
