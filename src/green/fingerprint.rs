//! Whether a .green file still belongs to its scene.

use super::error::GreenError;
use super::requirements::Requirements;
use crate::base::input;
use crate::mesh::formats::files_of;
use crate::scene::{
    Body, Centrifugal, KeptForm, Load, LoadEntry, LoadSource, Material, Method, Scene, SurfaceCompliance,
};
use std::collections::BTreeMap;
use std::path::Path;

/// Raised where the program makes something else of the same scene than before, within one of its versions.
const STATE: u32 = 14;

/// blake3 over all that body `name`'s numbers depend on: the bytes of every file of its mesh ([`files_of`]), its scale and the
/// cell it is filled with (or the generator's parameters), how often it is refined, materials, element, solver, parts, control
/// elements and loads with the bytes of their tag files, what its model and effects require, settings of effects that precompute, and the program's version.
pub fn fingerprint(scene: &Scene, name: &str, requirements: &Requirements) -> Result<String, GreenError> {
    let body = &scene.body[name];
    // A limit changes what is said of a body, not the body.
    let bare = |material: &Material| Material { limit: None, ..*material };
    let regions: BTreeMap<_, _> = body.region.iter().map(|(name, region)| (name, bare(region))).collect();
    let selections: Vec<_> = body.control.iter().map(|(control, c)| (control, &c.nodes)).collect();
    let asked = serde_json::json!({
        "program": (env!("CARGO_PKG_VERSION"), STATE),
        "generate": body.generate,
        "scale": body.mesh_scale().0,
        "tetrahedralise": body.tetrahedralise,
        "refine": body.refine,
        "element": body.element,
        "storage": body.storage,
        "material": bare(&body.material),
        "region": regions,
        "solver": body.solver,
        "parts": body.parts,
        "controls": selections,
        "updates": body.updates.as_ref().map(|updates| (&updates.release, &updates.modulus)),
        "requirements": requirements,
    });
    let mut hasher = blake3::Hasher::new();
    hasher.update(asked.to_string().as_bytes());
    hasher.update(loads(body).as_bytes());
    if body.method == Method::Bem {
        hasher.update(format!("bem {:?}", body.longest_edge).as_bytes());
    }
    for (effect, settings) in requirements.sections().filter_map(|name| body.effect.get_key_value(name)) {
        hasher.update(format!("{effect} {settings}\n").as_bytes());
    }
    let read = |hasher: &mut blake3::Hasher, entity: String, path: &Path| {
        hash_file(hasher, path)
            .map_err(|error| scene.invalid(&entity, format!("{}: {error}", path.display())))
    };
    if let Some(named) = &body.mesh {
        for file in files_of(&scene.resolve(named)) {
            read(&mut hasher, format!("body.{name}.mesh"), &file)?;
        }
    }
    for (key, file) in body.files() {
        read(&mut hasher, format!("body.{name}.{key}"), &scene.resolve(file))?;
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Text of the data from which the columns of loads and the compliance are made; empty for a body without them. The size of
/// a load does not change its columns.
fn loads(body: &Body) -> String {
    let told = |load: &LoadEntry<'_>| match load.source {
        LoadSource::Gravity | LoadSource::Thermal => format!("{}\n", load.name),
        LoadSource::Centrifugal(Centrifugal { axis, point, .. }) => {
            format!("{} {axis:?} {point:?}\n", load.name)
        }
        LoadSource::Pattern(load_of) => {
            let Load { nodes, kind, axis, direction, .. } = load_of;
            let direction = direction.as_ref().map(|direction| format!(" {direction:?}"));
            format!("{:?} {nodes:?} {kind:?} {axis:?}{}\n", load.name, direction.unwrap_or_default())
        }
    };
    let kept = |of: &SurfaceCompliance| match of.kept {
        KeptForm::Inverse => String::new(),
        other => format!(" {other:?}"),
    };
    let compliance = body.surface_compliance.iter().map(|of| format!("{:?}{}\n", of.nodes, kept(of)));
    body.loads().iter().map(told).chain(compliance).collect()
}

fn hash_file(hasher: &mut blake3::Hasher, path: &Path) -> std::io::Result<()> {
    let file = input::open(path)?;
    hasher.update(&file.limit().to_le_bytes());
    hasher.update_reader(file)?;
    Ok(())
}
