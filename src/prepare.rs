//! Makes a scene ready for the online stage: finds or makes its .green file.
//!
//! In: a scene whose names are [`Resolved`]. Out: the file, fresh for the scene as it is now.

use crate::base::diagnostic::{self, notice};
use crate::base::failure::Failure;
use crate::base::output::{self, OutputError};
pub use crate::base::progress::Teller;
use crate::base::progress::{Bars, Progress};
use crate::base::signal::{OnEnd, on_end};
use crate::deform::ExpectedErrors;
use crate::effect;
pub use crate::effect::Resolved;
use crate::green::{
    self, Caching, Changes, GreenError, GreenFile, Journal, KEPT_AFTER, Keeping, Precomputed, Requirements,
};
use crate::mesh::formats::files_of;
use crate::scene::{Body, Scene};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The scene with those of its bodies alone that `greenstage deform` sums from the .green file; maybe none.
pub fn summed_part(scene: &Resolved) -> Result<Resolved, Failure> {
    let mut summed = Vec::new();
    for name in scene.body.keys() {
        if scene.law(name)?.is_none() {
            summed.push(name.as_str());
        }
    }
    Ok(scene.with_bodies(|name| summed.contains(&name)))
}

/// The files that a run of the scene reads: itself, its stage and script, its meshes, lists of nodes and textures.
pub fn inputs(scene: &Scene) -> Vec<PathBuf> {
    let mut files = vec![scene.path.clone(), scene.resolve(Path::new(&scene.stage))];
    files.extend(scene.script.iter().map(|script| scene.resolve(script)));
    for body in scene.body.values() {
        files.extend(body.mesh.iter().flat_map(|mesh| files_of(&scene.resolve(mesh))));
        files.extend(body.files().into_iter().map(|(_, path)| scene.resolve(path)));
        files.extend(body.texture.iter().map(|texture| scene.resolve(&texture.image)));
    }
    files
}

/// [`inputs`], and other files that a command reads.
pub fn inputs_and<'a>(scene: &Scene, others: impl IntoIterator<Item = Option<&'a Path>>) -> Vec<PathBuf> {
    let mut files = inputs(scene);
    files.extend(others.into_iter().flatten().map(Path::to_owned));
    files
}

/// Whether the scene's .green file, where it is missing, can be written: before anything is measured or solved. One
/// that the user names is only read.
pub fn try_green(scene: &Scene, named: Option<&Path>) -> Result<(), Failure> {
    let path = green_path(scene);
    if named.is_some() {
        return Ok(());
    }
    let is_there = path.exists() || green::packed_path(&path).exists();
    let ask = if is_there { output::may_replace } else { output::try_path };
    ask(&path, &green::GREEN, &inputs(scene)).map_err(|error| unwritable(error.into(), &path))
}

/// The default place of a scene's .green file: beside the scene.
pub fn green_path(scene: &Scene) -> PathBuf {
    scene.path.with_extension("green")
}

/// The errors that the scene's .green file has measured of a body; fails where that file is not there or not fresh.
pub fn measured_errors(
    scene: &Scene,
    name: &str,
    requirements: &Requirements,
) -> Result<Option<ExpectedErrors>, GreenError> {
    let file = GreenFile::open(&green_path(scene))?;
    file.check_belongs(scene, name, requirements)?;
    effect::expected::read(&file, name)
}

/// The scene's .green file if it is there and belongs to the scene as it is now; why not, otherwise.
///
/// A damaged file is an error, not a reason: it is never replaced silently.
pub fn fresh(scene: &Resolved, path: &Path) -> Result<Result<GreenFile, GreenError>, Failure> {
    let scene = &scene.as_prepared();
    let file = match GreenFile::open(path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            return Ok(Err(GreenError::Io { path: path.to_owned(), source }));
        }
        other => other?,
    };
    for name in scene.body.keys() {
        match file.check_belongs(scene, name, &scene.requirements(name)?) {
            Err(stale @ GreenError::Stale { .. }) => return Ok(Err(stale)),
            other => other?,
        }
        effect::check_sections(scene, &file, name)?;
        diagnostic::report(&format!("{}: ", path.display()), &green::judge_file(&file, name)?);
    }
    Ok(Ok(file))
}

/// Precomputes every body of the scene.
pub fn precompute(scene: &Resolved, quiet: bool) -> Result<Vec<Precomputed>, Failure> {
    precompute_telling(&scene.as_prepared(), Keeping::default(), &|name| Box::new(Bars::new(name, quiet)))
}

/// Precomputes every body and writes the .green file, whose size it returns with the time of writing, s. A run that is ended
/// leaves what it has finished in a journal, which the next one takes up, and removes when the file is there. Equilibria stay in the
/// cache folder; with `is_anew` those that are there are replaced.
pub fn make(
    scene: &Resolved,
    path: &Path,
    (kept_after, is_anew): (Duration, bool),
    teller: Teller<'_>,
) -> Result<(Vec<Precomputed>, u64, f64), Failure> {
    let scene = &scene.as_prepared();
    let identity = || {
        let mut hasher = blake3::Hasher::new();
        for name in scene.body.keys() {
            hasher.update(green::fingerprint(scene, name, &scene.requirements(name).ok()?).ok()?.as_bytes());
        }
        Some(hasher.finalize().into())
    };
    let journal = Journal::new(path, kept_after, &identity);
    let unwritten = unwritten(path);
    let keeping = Keeping { journal: Some(&journal), caching: Some(Caching { kept_after, is_anew }) };
    let bodies = precompute_telling(scene, keeping, teller)?;
    drop(unwritten);
    let writing = Instant::now();
    let size = green::write(path, &bodies).map_err(|error| unwritable(error, path))?;
    journal.remove();
    Ok((bodies, size, writing.elapsed().as_secs_f64()))
}

fn precompute_telling(
    scene: &Resolved,
    keeping: Keeping<'_>,
    teller: Teller<'_>,
) -> Result<Vec<Precomputed>, Failure> {
    scene
        .bodies
        .keys()
        .map(|name| {
            let (requirements, progress) = (scene.requirements(name)?, teller(name));
            let precomputed = effect::precompute(scene, name, &requirements, keeping, &*progress)?;
            diagnostic::report("", &precomputed.solution.notices);
            Ok(precomputed)
        })
        .collect()
}

/// The scene's .green file, made now where it is missing or stale. A file named by the user is only read.
pub fn green_file(scene: &Resolved, named: Option<&Path>) -> Result<Arc<GreenFile>, Failure> {
    green_file_telling(scene, named, &|name| Box::new(Bars::new(name, false)))
}

/// [`green_file`], with the progress reported to `teller`.
pub fn green_file_telling(
    scene: &Resolved,
    named: Option<&Path>,
    teller: Teller<'_>,
) -> Result<Arc<GreenFile>, Failure> {
    updated(prepared_file(scene, named, teller)?, scene, teller)
}

/// The file of a scene after what is released and changed of it now.
fn updated(base: Arc<GreenFile>, scene: &Resolved, teller: Teller<'_>) -> Result<Arc<GreenFile>, Failure> {
    if !scene.body.values().any(Body::is_updated) {
        return Ok(base);
    }
    let sections = |file: &GreenFile, name: &str| effect::sections_after_change(scene, file, name);
    let changes = Changes { sections: &sections, fits: &|name| scene.bodies[name].model.fits };
    let (file, notices) = green::derive(base, scene, &changes, teller)?;
    diagnostic::report("", &notices);
    Ok(Arc::new(file))
}

fn prepared_file(
    scene: &Resolved,
    named: Option<&Path>,
    teller: Teller<'_>,
) -> Result<Arc<GreenFile>, Failure> {
    if let Some(path) = named {
        return Ok(Arc::new(fresh(scene, path)??));
    }
    for name in scene.body.keys() {
        scene.requirements(name)?;
    }
    let path = green_path(scene);
    unpack_shipped(&path)?;
    let reason = match fresh(scene, &path)? {
        Ok(file) => {
            green::drop_journal(&path, None);
            return Ok(Arc::new(file));
        }
        Err(GreenError::Stale { .. }) => "is stale (the scene, its mesh or the program changed)",
        Err(_) => "is not there yet",
    };
    notice!("{} {reason}: precomputing", path.display());
    let tried = output::try_path(&path, &green::GREEN, &inputs(scene));
    tried.map_err(|error: OutputError| unwritable(error.into(), &path))?;
    make(scene, &path, (KEPT_AFTER, false), teller)?;
    Ok(Arc::new(GreenFile::open(&path)?))
}

/// The .green file of a scene that is changed while it is shown. Bodies that one of `known` holds as they are now are taken
/// from there; the others are precomputed, and the file is made at `path`. It is one of `known` where that holds them all.
pub fn changed_file(
    scene: &Resolved,
    path: &Path,
    known: &[Arc<GreenFile>],
    progress: &dyn Progress,
) -> Result<Arc<GreenFile>, Failure> {
    let known: Vec<_> =
        known.iter().flat_map(|file| [Some(file), file.base.as_ref()]).flatten().cloned().collect();
    updated(changed_base(&scene.as_prepared(), path, &known, progress)?, scene, &|_| Box::new(progress))
}

fn changed_base(
    scene: &Resolved,
    path: &Path,
    known: &[Arc<GreenFile>],
    progress: &dyn Progress,
) -> Result<Arc<GreenFile>, Failure> {
    let required = scene.body.keys().map(|name| Ok((name.as_str(), scene.requirements(name)?)));
    let required: Vec<(&str, Requirements)> = required.collect::<Result<_, Failure>>()?;
    let holds = |file: &GreenFile, (name, required): &(&str, Requirements)| {
        file.check_belongs(scene, name, required).is_ok() && effect::check_sections(scene, file, name).is_ok()
    };
    let of_all = known.iter().find(|file| {
        file.meta.bodies.len() == required.len() && required.iter().all(|body| holds(file, body))
    });
    if let Some(file) = of_all {
        return Ok(file.clone());
    }
    let (mut kept, mut made) = (Vec::new(), Vec::new());
    for body @ (name, required) in &required {
        match known.iter().find(|file| holds(file, body)) {
            Some(file) => kept.push((file.as_ref(), *name)),
            None => {
                let keeping = Keeping {
                    journal: None,
                    caching: Some(Caching { kept_after: KEPT_AFTER, is_anew: false }),
                };
                let precomputed = effect::precompute(scene, name, required, keeping, progress)?;
                diagnostic::report("", &precomputed.solution.notices);
                made.push(precomputed);
            }
        }
    }
    green::write_with(path, &made, &kept).map_err(|error| unwritable(error, path))?;
    Ok(Arc::new(GreenFile::open(path)?))
}

/// Announces, on a signal to end, what that costs before `path` is written.
pub fn unwritten(path: &Path) -> OnEnd {
    let (named, was_there) = (path.display().to_string(), path.exists());
    let journal = green::journal_path(path);
    on_end(move || {
        let told =
            if was_there { format!("{named} is as it was") } else { format!("{named} was not written") };
        let is_kept = journal.exists();
        let kept = || format!("; what is finished of it waits in {} for the next run", journal.display());
        Some(if is_kept { told + &kept() } else { told })
    })
}

/// Unpacks the packed file beside `path` where the .green file itself is missing.
pub fn unpack_shipped(path: &Path) -> Result<(), Failure> {
    let shipped = green::packed_path(path);
    if !path.exists() && shipped.exists() {
        notice!("{} is unpacked", shipped.display());
        green::unpack(&shipped, path).map_err(|error| unwritable(error, path))?;
    }
    Ok(())
}

/// An error about the .green file; one in writing it with the remedy.
pub fn unwritable(error: GreenError, path: &Path) -> Failure {
    if !matches!(error, GreenError::Output(_)) {
        return error.into();
    }
    let advice = format!(
        "cannot write {}; name another place: `greenstage precompute SCENE -o FILE`, then `--green FILE`",
        path.display()
    );
    let is_request = error.is_request();
    let advised = anyhow::Error::from(error).context(advice);
    if is_request { Failure::Request(advised) } else { Failure::Work(advised) }
}
