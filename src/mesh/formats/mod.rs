//! Mesh file formats: one file each, and one line in [`FORMATS`].
//!
//! In: a path with its bytes, or a path and a mesh. Out: the format's entry, whose functions read and write.

mod abaqus;
mod abaqus_lines;
mod abaqus_sets;
mod abaqus_write;
mod format;
mod gmsh;
mod gmsh2;
mod gmsh4;
mod gmsh_scan;
mod gmsh_types;
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

pub use format::{Encoded, Format, Part, Writer};
pub use gmsh_write::{Encoding, encode};

use super::error::{FormatFault, MeshError};
use std::path::{Path, PathBuf};

/// Every format.
pub const FORMATS: &[Format] =
    &[gmsh::FORMAT, vtk::FORMAT, vtu::FORMAT, tetgen::FORMAT, abaqus::FORMAT, medit::FORMAT];

/// The format of a file: by its extension, else by its first bytes.
pub fn format_of(path: &Path, bytes: &[u8]) -> Result<&'static Format, FormatFault> {
    by_extension(path).or_else(|| FORMATS.iter().find(|format| (format.recognizes)(bytes))).ok_or_else(|| {
        let known: Vec<String> =
            FORMATS.iter().map(|f| format!("{} (.{})", f.name, f.extensions.join(", ."))).collect();
        FormatFault::whole(format!("not a mesh file that can be read; known are {}", known.join(", ")))
    })
}

fn by_extension(path: &Path) -> Option<&'static Format> {
    let extension = format::extension(path);
    FORMATS.iter().find(|format| format.extensions.contains(&extension.as_str()))
}

/// Every way to write a mesh; the first for an extension is the one that is taken when none is named.
pub fn writers() -> impl Iterator<Item = &'static Writer> + Clone {
    FORMATS.iter().flat_map(|format| format.writers)
}

/// The writer for the extension of `path`, or the one called `name` if it has that extension.
pub fn writer_of(path: &Path, name: Option<&str>) -> Result<&'static Writer, MeshError> {
    format::find_writer(writers(), path, name)
}

/// All files that are read for the mesh or the surface at `path`, that one first.
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let others = by_extension(path).map_or_else(Vec::new, |format| (format.others)(path));
    std::iter::once(path.to_owned()).chain(others).collect()
}
