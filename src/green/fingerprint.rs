//! Whether a .green file still belongs to its scene.

use super::{GreenError, Needs};
use crate::scene::{Nodes, Scene};
use std::path::Path;

/// blake3 over all that body `name`'s numbers depend on: the bytes of its mesh and the cell it is filled with (or the
/// generator's parameters), materials, element, solver, control elements with the bytes of their tag files, what its model and effects need,
/// and the program's version.
pub fn fingerprint(scene: &Scene, name: &str, needs: Needs) -> Result<String, GreenError> {
    let body = &scene.body[name];
    let selections: Vec<_> = body.control.iter().map(|(control, c)| (control, &c.nodes)).collect();
    let asked = serde_json::json!({
        "program": env!("CARGO_PKG_VERSION"),
        "generate": body.generate,
        "tetrahedralise": body.tetrahedralise,
        "element": body.element,
        "material": body.material,
        "region": body.region,
        "solver": body.solver,
        "controls": selections,
        "needs": needs,
    });
    let mut hasher = blake3::Hasher::new();
    hasher.update(asked.to_string().as_bytes());
    let files = body.control.values().filter_map(|control| match &control.nodes {
        Nodes::File(path) => Some(path.as_path()),
        _ => None,
    });
    for file in body.mesh.as_deref().into_iter().chain(files) {
        hash_file(&mut hasher, &scene.resolve(file))?;
    }
    Ok(hasher.finalize().to_hex().to_string())
}

fn hash_file(hasher: &mut blake3::Hasher, path: &Path) -> Result<(), GreenError> {
    let failed = |source| GreenError::Io { path: path.to_owned(), source };
    let file = std::fs::File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    hasher.update(&length.to_le_bytes());
    hasher.update_reader(file).map_err(failed)?;
    Ok(())
}
