//! Makes a scene ready for the online stage: checks its models and effects, and finds or makes its .green file.

use crate::base::bars::Bars;
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::base::output::{self, OutputError};
use crate::base::progress::Progress;
pub use crate::base::progress::Teller;
use crate::base::signal::{OnEnd, on_end};
use crate::deform::{Bearing, Kind, ModelEntry, Statics, find_model, load_refusal};
use crate::effect::{self, EffectEntry, expected, find_effect};
use crate::fem::{Dilatation, Law};
use crate::green::{
    self, AFFINE, COMPLIANCE, COMPRESSED, GreenError, GreenFile, Journal, KEPT_AFTER, KEPT_FACTOR, LOADS,
    Precomputed, Requirements, STIFFNESS, UPDATES,
};
use crate::mesh::formats::files_of;
use crate::scene::{Body, Kept, Method, Scene, SceneError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The law under which a body is in static equilibrium, found anew for every pose; `None` for a model that is summed from
/// the .green file. Errors name an unknown model or effect.
pub fn law(scene: &Scene, name: &str, body: &Body) -> Result<Option<&'static Law>, Failure> {
    unknown_names(scene, name, body)
        .into_iter()
        .next()
        .map_or(Ok(()), |unknown| Err(Failure::request(unknown)))?;
    let model = find_model(&body.model).map_err(|message| wrong(scene, name, "model", message))?;
    match model.kind {
        Kind::Background(law) if body.method == Method::Bem => {
            let message = format!(
                "\"{}\" finds equilibrium in tetrahedra, which boundary elements do not have: write model = \"linear\", or \
                 leave out method = \"bem\"",
                law.name
            );
            Err(wrong(scene, name, "model", message))
        }
        // Solved anew it has its loads whatever the columns are.
        Kind::Background(law) => Ok(Some(law)),
        Kind::Online(_) => loads_required(scene, name, body, model).map(|_| None),
    }
}

/// The effects and the model that a body names and that there are not, and settings that its effects do not have.
pub fn unknown_names(scene: &Scene, name: &str, body: &Body) -> Vec<SceneError> {
    let effects = body.effects.iter().filter_map(|effect| Some(("effects", find_effect(effect).err()?)));
    let model = find_model(&body.model).err().map(|message| ("model", message));
    let unknown = |(key, message): (&str, String)| scene.invalid(&format!("body.{name}.{key}"), message);
    effects.chain(model).map(unknown).chain(settings_faults(scene, name, body)).collect()
}

/// What is wrong with the settings of a body's effects.
fn settings_faults(scene: &Scene, name: &str, body: &Body) -> Vec<SceneError> {
    let check = |effect: &str| {
        let check_settings = find_effect(effect)?.check_settings;
        if !body.effects.iter().any(|listed| listed == effect) {
            return Err(format!(
                "the body does not list this effect: add \"{effect}\" to effects, or leave this out"
            ));
        }
        check_settings.map_or_else(|| Err("this effect has no settings".to_owned()), |check| check(body))
    };
    let fault = |effect: &String| {
        let message = check(effect).err()?;
        Some(scene.invalid(&format!("body.{name}.effect.{effect}"), message))
    };
    body.effect.keys().filter_map(fault).collect()
}

/// What must be precomputed for the model and the effects of a body. Errors name an unknown one, and what a model of
/// large strain does not have.
pub fn requirements(scene: &Scene, name: &str, body: &Body) -> Result<Requirements, Failure> {
    if let Some(law) = law(scene, name, body)? {
        Statics::suits(scene, name, law).map_err(Failure::request)?;
    }
    let model = find_model(&body.model).map_err(|message| wrong(scene, name, "model", message))?;
    let loads = loads_required(scene, name, body, model)?;
    let required = effect::requirements(model, effects(body)).and(loads);
    check_method(scene, name, body, &required)?;
    if body.updates.is_none() {
        return Ok(required);
    }
    if let Some(family) = required.families().find(|family| !green::is_derived(family)) {
        let message = format!(
            "model = \"{}\" with these effects needs the columns called {family}, which cannot be found again when a control \
             element is released or a modulus changed: write model = \"linear\", or leave updates out",
            body.model
        );
        return Err(wrong(scene, name, "updates", message));
    }
    if !body.updates.iter().all(|updates| updates.modulus.is_empty())
        && body.element.dilatation == Dilatation::Nodal
    {
        let message = format!(
            "element = \"{}\" averages the pressure across the border of regions, so that the modulus of one cannot be \
             changed by itself: write element = \"tet4\" or \"tet10\"",
            body.element.name
        );
        return Err(wrong(scene, name, "updates.modulus", message));
    }
    let changes_modulus = body.updates.iter().any(|updates| !updates.modulus.is_empty());
    if changes_modulus && (required.has(LOADS) || body.surface_compliance.is_some()) {
        let message = "a region's modulus is changed from its border, which does not know of forces inside: leave out modulus, \
                       or the body's loads and surface_compliance; release goes with both";
        return Err(wrong(scene, name, "updates.modulus", message.to_owned()));
    }
    Ok(required.and(Requirements::of(&[UPDATES])))
}

/// Errors name what a body of boundary elements cannot have.
fn check_method(scene: &Scene, name: &str, body: &Body, required: &Requirements) -> Result<(), Failure> {
    if body.method == Method::Fem {
        return Ok(());
    }
    let remedy = "leave out method = \"bem\", and fill a surface by tetrahedralise = { cell = … }";
    if let Some(effect) = effects(body).find(|effect| effect.needs_inside) {
        let message = format!(
            "\"{}\" looks inside the body, of which boundary elements know the surface alone: leave the effect out, or {remedy}",
            effect.name
        );
        return Err(wrong(scene, name, "effects", message));
    }
    let is_known = |family: &&str| [AFFINE.name, STIFFNESS.name].contains(family);
    let Some(family) = required.families().find(|family| !is_known(family)) else { return Ok(()) };
    let message = format!(
        "\"{}\" with these effects needs the family {family}, which is made from tetrahedra: write model = \"linear\", for \
         pictures without forces also \"rotation\", or {remedy}",
        body.model
    );
    Err(wrong(scene, name, "model", message))
}

/// The families of a body's loads; errors name what cannot be together with them.
fn loads_required(
    scene: &Scene,
    name: &str,
    body: &Body,
    model: &ModelEntry,
) -> Result<Requirements, Failure> {
    let (loads, compliance) = (!body.loads().is_empty(), body.surface_compliance.is_some());
    if let Some(message) = load_refusal(model, compliance) {
        return Err(wrong(scene, name, "model", message));
    }
    if let Bearing::Forces(families) = model.loads {
        return Ok(if loads { Requirements::of(families) } else { Requirements::default() });
    }
    let of_surface = body.surface_compliance.as_ref().map(|of| match of.kept {
        Kept::Inverse => COMPLIANCE,
        Kept::Compressed(_) => COMPRESSED,
        Kept::Factor => KEPT_FACTOR,
    });
    let families: Vec<_> = loads.then_some(LOADS).into_iter().chain(of_surface).collect();
    Ok(Requirements::of(&families))
}

/// The same of a body that is measured; refuses the models that others are measured against.
pub fn measured_requirements(scene: &Scene, name: &str, body: &Body) -> Result<Requirements, Failure> {
    match law(scene, name, body)? {
        None if body.method == Method::Bem => {
            let message =
                "what accuracy costs is measured among elements of tetrahedra: leave out method = \"bem\"";
            Err(wrong(scene, name, "method", message.to_owned()))
        }
        None => requirements(scene, name, body),
        Some(law) => {
            let message = format!(
                "\"{}\" is static equilibrium itself, which other models are measured against: write model = \
                 \"rotation\" or \"linear\" to have an accuracy measured",
                law.name
            );
            Err(wrong(scene, name, "model", message))
        }
    }
}

/// The entries of the effects that a body lists.
fn effects(body: &Body) -> impl Iterator<Item = &'static EffectEntry> {
    body.effects.iter().filter_map(|effect| find_effect(effect).ok())
}

fn wrong(scene: &Scene, name: &str, key: &str, message: String) -> Failure {
    Failure::request(scene.invalid(&format!("body.{name}.{key}"), message))
}

/// The scene with those of its bodies alone that `greenstage deform` sums from the .green file; maybe none.
pub fn summed_part(scene: &Scene) -> Result<Scene, Failure> {
    let mut part = scene.clone();
    part.body.clear();
    for (name, body) in &scene.body {
        if law(scene, name, body)?.is_none() {
            part.body.insert(name.clone(), body.clone());
        }
    }
    Ok(part)
}

/// The files that a run of the scene reads: itself, its stage and script, its meshes and lists of nodes.
pub fn inputs(scene: &Scene) -> Vec<PathBuf> {
    let mut files = vec![scene.path.clone(), scene.resolve(Path::new(&scene.stage))];
    files.extend(scene.script.iter().map(|script| scene.resolve(script)));
    for body in scene.body.values() {
        files.extend(body.mesh.iter().flat_map(|mesh| files_of(&scene.resolve(mesh))));
        files.extend(body.files().into_iter().map(|(_, path)| scene.resolve(path)));
    }
    files
}

/// [`inputs`], and what else a command was told to read.
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

/// Where the .green file of a scene stands unless told otherwise: beside the scene.
pub fn green_path(scene: &Scene) -> PathBuf {
    scene.path.with_extension("green")
}

/// The scene's .green file if it is there and belongs to the scene as it is now; why not, otherwise.
///
/// A damaged file is an error, not a reason: it is never replaced without a word.
pub fn fresh(scene: &Scene, path: &Path) -> Result<Result<GreenFile, GreenError>, Failure> {
    let scene = &scene.as_prepared();
    let file = match GreenFile::open(path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            return Ok(Err(GreenError::Io { path: path.to_owned(), source }));
        }
        other => other?,
    };
    for (name, body) in &scene.body {
        match file.check_belongs(scene, name, &requirements(scene, name, body)?) {
            Err(stale @ GreenError::Stale { .. }) => return Ok(Err(stale)),
            other => other?,
        }
        expected::read(&file, name)?;
        for warning in green::judge_file(&file, name)? {
            notice!("{}: {warning}", path.display());
        }
    }
    Ok(Ok(file))
}

/// Precomputes every body of the scene.
pub fn precompute(scene: &Scene, quiet: bool) -> Result<Vec<Precomputed>, Failure> {
    precompute_telling(&scene.as_prepared(), None, &|name| Box::new(Bars::new(name, quiet)))
}

/// Precomputes every body and writes the .green file, whose size it returns with the time of writing, s. A run that is ended
/// leaves what it has finished in a journal, which the next one takes up, and removes when the file is there.
pub fn make(
    scene: &Scene,
    path: &Path,
    kept_after: Duration,
    teller: Teller<'_>,
) -> Result<(Vec<Precomputed>, u64, f64), Failure> {
    let scene = &scene.as_prepared();
    let identity = || {
        let mut hasher = blake3::Hasher::new();
        for (name, body) in &scene.body {
            let requirements = requirements(scene, name, body).ok()?;
            hasher.update(green::fingerprint(scene, name, &requirements).ok()?.as_bytes());
        }
        Some(hasher.finalize().into())
    };
    let journal = Journal::of(path, kept_after, &identity);
    let unwritten = unwritten(path);
    let bodies = precompute_telling(scene, Some(&journal), teller)?;
    drop(unwritten);
    let writing = Instant::now();
    let size = green::write(path, &bodies).map_err(|error| unwritable(error, path))?;
    journal.remove();
    Ok((bodies, size, writing.elapsed().as_secs_f64()))
}

fn precompute_telling(
    scene: &Scene,
    journal: Option<&Journal<'_>>,
    teller: Teller<'_>,
) -> Result<Vec<Precomputed>, Failure> {
    scene
        .body
        .iter()
        .map(|(name, body)| {
            let requirements = requirements(scene, name, body)?;
            let progress = teller(name);
            let fits = find_model(&body.model).ok().and_then(|model| model.fits);
            let mut precomputed =
                green::precompute_kept(scene, name, &requirements, fits, journal, &*progress)?;
            effect::add_sections(scene, effects(body), &mut precomputed, &*progress)?;
            for notice in &precomputed.solution.notices {
                notice!("{notice}");
            }
            Ok(precomputed)
        })
        .collect()
}

/// The scene's .green file, made now where it is missing or stale. A file named by the user is only read.
pub fn green_file(scene: &Scene, named: Option<&Path>) -> Result<Arc<GreenFile>, Failure> {
    green_file_telling(scene, named, &|name| Box::new(Bars::new(name, false)))
}

/// The same, with the progress told elsewhere.
pub fn green_file_telling(
    scene: &Scene,
    named: Option<&Path>,
    teller: Teller<'_>,
) -> Result<Arc<GreenFile>, Failure> {
    updated(prepared_file(scene, named, teller)?, scene, teller)
}

/// The file of a scene after what is released and changed of it now.
fn updated(base: Arc<GreenFile>, scene: &Scene, teller: Teller<'_>) -> Result<Arc<GreenFile>, Failure> {
    if !scene.body.values().any(Body::is_updated) {
        return Ok(base);
    }
    let sections =
        |file: &GreenFile, name: &str| effect::sections_after_change(file, name, &scene.body[name]);
    let (file, notices) = green::derive(base, scene, &sections, teller)?;
    for notice in notices {
        notice!("{notice}");
    }
    Ok(Arc::new(file))
}

fn prepared_file(scene: &Scene, named: Option<&Path>, teller: Teller<'_>) -> Result<Arc<GreenFile>, Failure> {
    if let Some(path) = named {
        return Ok(Arc::new(fresh(scene, path)??));
    }
    for (name, body) in &scene.body {
        requirements(scene, name, body)?;
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
    make(scene, &path, KEPT_AFTER, teller)?;
    Ok(Arc::new(GreenFile::open(&path)?))
}

/// The .green file of a scene that is changed while it is shown. Bodies that one of `known` holds as they are now are taken
/// from there; the others are precomputed, and the file is made at `path`. It is one of `known` where that holds them all.
pub fn changed_file(
    scene: &Scene,
    path: &Path,
    known: &[Arc<GreenFile>],
    progress: &dyn Progress,
) -> Result<Arc<GreenFile>, Failure> {
    let known: Vec<_> =
        known.iter().flat_map(|file| [Some(file), file.base.as_ref()]).flatten().cloned().collect();
    updated(changed_base(&scene.as_prepared(), path, &known, progress)?, scene, &|_| Box::new(progress))
}

fn changed_base(
    scene: &Scene,
    path: &Path,
    known: &[Arc<GreenFile>],
    progress: &dyn Progress,
) -> Result<Arc<GreenFile>, Failure> {
    let names = scene.body.iter();
    let required = names.map(|(name, body)| Ok((name.as_str(), requirements(scene, name, body)?)));
    let required: Vec<(&str, Requirements)> = required.collect::<Result<_, Failure>>()?;
    let holds = |file: &GreenFile, (name, required): &(&str, Requirements)| {
        file.check_belongs(scene, name, required).is_ok() && expected::read(file, name).is_ok()
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
                let body = &scene.body[*name];
                let fits = find_model(&body.model).ok().and_then(|model| model.fits);
                let mut precomputed = green::precompute_kept(scene, name, required, fits, None, progress)?;
                effect::add_sections(scene, effects(body), &mut precomputed, progress)?;
                for notice in &precomputed.solution.notices {
                    notice!("{notice}");
                }
                made.push(precomputed);
            }
        }
    }
    green::write_with(path, &made, &kept).map_err(|error| unwritable(error, path))?;
    Ok(Arc::new(GreenFile::open(path)?))
}

/// Tells what a signal to end costs before `path` is written.
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
