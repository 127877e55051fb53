//! Mesh file formats: one file each, and one line in [`FORMATS`].
//!
//! In: a path with its bytes, or a path and a mesh. Out: the format's entry, whose functions read and write.

mod abaqus;
mod abaqus_sets;
mod format;
mod gid;
mod gmsh;
mod gmsh4;
mod gmsh_scan;
mod gmsh_write;
mod medit;
mod tetgen;
mod vega;
mod vtk;
mod vtu;
mod vtu_array;
pub mod vtu_write;
mod write;

pub use format::{Encoded, Format, Part, Writer};
pub use gmsh_write::{Encoding, encode};
pub use vtu::{PlacedVectors, point_vectors};
pub use write::advice;

use super::error::{FormatFault, MeshError};
use std::path::{Path, PathBuf};

/// Every format.
pub const FORMATS: &[Format] = &[
    gmsh::FORMAT,
    vtk::FORMAT,
    vtu::FORMAT,
    tetgen::FORMAT,
    abaqus::FORMAT,
    medit::FORMAT,
    vega::FORMAT,
    gid::FORMAT,
];

/// The format of a file: by its extension, among those that share one by its first bytes, and by these alone where the extension
/// is unknown.
pub fn format_of(path: &Path, bytes: &[u8]) -> Result<&'static Format, FormatFault> {
    let recognized = || FORMATS.iter().find(|format| (format.recognizes)(bytes));
    let shared =
        with_extension(path).nth(1).and_then(|_| with_extension(path).find(|f| (f.recognizes)(bytes)));
    shared.or_else(|| by_extension(path)).or_else(recognized).ok_or_else(|| {
        if let Some(advice) = advice(path, bytes) {
            return FormatFault::whole(advice);
        }
        let known: Vec<String> =
            FORMATS.iter().map(|f| format!("{} (.{})", f.name, f.extensions.join(", ."))).collect();
        FormatFault::whole(format!("not a mesh file that can be read; known are {}", known.join(", ")))
    })
}

/// Whether the file is called like one of a format.
pub fn has_extension(path: &Path) -> bool {
    by_extension(path).is_some()
}

fn with_extension(path: &Path) -> impl Iterator<Item = &'static Format> {
    let extension = format::extension(path);
    FORMATS.iter().filter(move |format| format.extensions.contains(&extension.as_str()))
}

fn by_extension(path: &Path) -> Option<&'static Format> {
    with_extension(path).next()
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
