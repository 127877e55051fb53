//! Distinguishes mesh and surface files from scene files.

use crate::base::{input, output};
use crate::mesh::{formats, surface_files};
use std::io::Read;
use std::path::Path;

/// Whether the file is one of [`formats::FORMATS`] or [`surface_files`], or of a format that can be converted to one: by its
/// extension; of any other but TOML, by its first bytes.
pub fn is_mesh_or_surface(path: &Path) -> bool {
    let is_text = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let begins = || {
        let mut head = Vec::new();
        let read = input::open(path).and_then(|file| file.take(output::HEAD).read_to_end(&mut head));
        let is_known = formats::FORMATS.iter().any(|format| (format.recognizes)(&head));
        read.is_ok() && (is_known || formats::advice(path, &head).is_some())
    };
    let is_known = surface_files::is_surface_file(path) || formats::has_extension(path);
    is_known || !is_text && path.is_file() && begins()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_are_known_by_their_names_or_beginnings() {
        let folder = tempfile::tempdir().unwrap();
        let is = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            is_mesh_or_surface(&path)
        };
        assert!(is("part.msh", "") && is("part.STL", "") && is("part.veg", "") && is("part.step", ""));
        assert!(
            is("part", "$MeshFormat\n")
                && is("part.txt", "MESH dimension 3\n")
                && is("part.x", "ISO-10303-21;")
        );
        assert!(
            !is("part.toml", "$MeshFormat\n")
                && !is("part.txt", "hello")
                && !is_mesh_or_surface(Path::new("none"))
        );
    }
}
