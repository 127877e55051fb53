//! A scene made ready for the online stage: its .green file found fresh or made, its models and effects known.

use super::failure::Failure;
use super::progress::Bars;
use crate::deform::{Deformer, Kind, find_model, not_online};
use crate::effect::find_effect;
use crate::fem::Law;
use crate::green::{self, GreenError, GreenFile, Needs, Precomputed};
use crate::scene::{Body, Scene};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The law under which `greenstage deform` solves a body anew for every pose; `None` for a model that is shown from the
/// .green file. Errors name an unknown model or effect.
pub fn law(scene: &Scene, name: &str, body: &Body) -> Result<Option<&'static Law>, Failure> {
    for effect in &body.effects {
        find_effect(effect).map_err(|message| wrong(scene, name, "effects", message))?;
    }
    match find_model(&body.model).map_err(|message| wrong(scene, name, "model", message))?.kind {
        Kind::Static(law) => Ok(Some(law)),
        Kind::Online(_) => Ok(None),
    }
}

/// What the model and the effects of a body need beside the basis columns. Errors name an unknown one, and refuse a
/// model that has no part in the .green file.
pub fn needs(scene: &Scene, name: &str, body: &Body) -> Result<Needs, Failure> {
    if law(scene, name, body)?.is_some() {
        return Err(wrong(scene, name, "model", not_online(&body.model)));
    }
    let effects = body.effects.iter().filter_map(|effect| find_effect(effect).ok());
    let model = find_model(&body.model).map_err(|message| wrong(scene, name, "model", message))?;
    Ok(effects.fold(model.needs, |needs, effect| needs.and(effect.needs)))
}

fn wrong(scene: &Scene, name: &str, key: &str, message: String) -> Failure {
    Failure::request(scene.invalid(&format!("body.{name}.{key}"), message))
}

/// The scene with those of its bodies alone that are shown from the .green file; maybe none.
pub fn online_part(scene: &Scene) -> Result<Scene, Failure> {
    let mut part = scene.clone();
    part.body.clear();
    for (name, body) in &scene.body {
        if law(scene, name, body)?.is_none() {
            part.body.insert(name.clone(), body.clone());
        }
    }
    Ok(part)
}

/// Where the .green file of a scene stands unless told otherwise: beside the scene.
pub fn green_path(scene: &Scene) -> PathBuf {
    scene.path.with_extension("green")
}

/// The scene's .green file if it is there and belongs to the scene as it is now; why not, otherwise.
///
/// A damaged file is an error, not a reason: it is never replaced without a word.
pub fn fresh(scene: &Scene, path: &Path) -> Result<Result<GreenFile, GreenError>, Failure> {
    let file = match GreenFile::open(path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            return Ok(Err(GreenError::Io { path: path.to_owned(), source }));
        }
        other => other?,
    };
    for (name, body) in &scene.body {
        let expected = green::fingerprint(scene, name, needs(scene, name, body)?)?;
        if let Err(stale) = file.check_fresh(name, &expected) {
            return Ok(Err(stale));
        }
        let Some(meta) = file.meta.bodies.get(name) else { continue };
        let failed = |source| GreenError::Solve { body: format!("{}: body.{name}", path.display()), source };
        if let Some(warning) = green::judge_file(&format!("body.{name}"), meta).map_err(failed)? {
            eprintln!("{}: {warning}", path.display());
        }
    }
    Ok(Ok(file))
}

/// Precomputes every body of the scene.
pub fn precompute(scene: &Scene, quiet: bool) -> Result<Vec<Precomputed>, Failure> {
    scene
        .body
        .iter()
        .map(|(name, body)| {
            let needs = needs(scene, name, body)?;
            let precomputed = green::precompute(scene, name, needs, &Bars::new(name, quiet))?;
            for notice in &precomputed.solution.notices {
                eprintln!("{notice}");
            }
            Ok(precomputed)
        })
        .collect()
}

/// The scene's .green file, made now where it is missing or stale. A file named by the user is only read.
pub fn green_file(scene: &Scene, named: Option<&Path>) -> Result<Arc<GreenFile>, Failure> {
    if let Some(path) = named {
        return Ok(Arc::new(fresh(scene, path)??));
    }
    for (name, body) in &scene.body {
        needs(scene, name, body)?;
    }
    let path = green_path(scene);
    unpack_shipped(&path)?;
    let reason = match fresh(scene, &path)? {
        Ok(file) => return Ok(Arc::new(file)),
        Err(GreenError::Stale { .. }) => "is stale (the scene, its mesh or the program changed)",
        Err(_) => "is not there yet",
    };
    eprintln!("{} {reason}: precomputing", path.display());
    green::write(&path, &precompute(scene, false)?).map_err(|error| unwritable(error, &path))?;
    Ok(Arc::new(GreenFile::open(&path)?))
}

/// Unpacks the packed file beside `path` where the .green file itself is missing.
pub fn unpack_shipped(path: &Path) -> Result<(), Failure> {
    let shipped = green::packed_path(path);
    if !path.exists() && shipped.exists() {
        eprintln!("{} is unpacked", shipped.display());
        green::unpack(&shipped, path).map_err(|error| unwritable(error, path))?;
    }
    Ok(())
}

/// An error in writing the .green file, with the remedy.
pub fn unwritable(error: GreenError, path: &Path) -> Failure {
    let advice = format!(
        "cannot write {}; name another place: `greenstage precompute SCENE -o FILE`, then `--green FILE`",
        path.display()
    );
    Failure::Request(anyhow::Error::from(error).context(advice))
}

/// A deformer for every body of the scene, in the scene's order.
pub fn deformers(scene: &Scene, file: &Arc<GreenFile>) -> Result<Vec<Deformer>, Failure> {
    scene
        .body
        .iter()
        .map(|(name, body)| Deformer::new(file.clone(), name, &body.model).map_err(Failure::wrong))
        .collect()
}
