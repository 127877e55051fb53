//! Opens a session from the options of a command: scene, stage, script, .green file, recordings.

use super::advance::Session;
use super::recording::{Origin, Recorder, Replay};
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::effect;
use crate::green::GreenFile;
use crate::prepare;
use crate::scene::Scene;
use crate::scene::proposal::relative;
use crate::stage::{self, Stage};
use crate::track::Script;
use crate::world::World;
use std::path::Path;
use std::sync::Arc;

/// The options with which a session is opened; what they leave out is taken from the scene.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    pub scene: &'a Scene,
    /// A built-in stage, or a stage file.
    pub stage: Option<&'a str>,
    pub script: Option<&'a Path>,
    /// A .green file that is only read.
    pub green: Option<&'a Path>,
    /// A session that moves everything, on its own stage unless another is named.
    pub replay: Option<&'a Path>,
    /// The recording into which every frame is written.
    pub record: Option<&'a Path>,
}

impl<'a> Request<'a> {
    /// With everything as the scene has it.
    pub fn of(scene: &'a Scene) -> Request<'a> {
        Request { scene, stage: None, script: None, green: None, replay: None, record: None }
    }
}

impl Session {
    /// Makes the .green file where it is missing or stale; the trackers and force devices are not started.
    pub fn open(request: &Request<'_>) -> Result<Session, Failure> {
        Session::open_with(request, || prepare::green_file(request.scene, request.green))
    }

    /// The same with a .green file that is asked for once all else is found right.
    pub fn open_with(
        request: &Request<'_>,
        file: impl FnOnce() -> Result<Arc<GreenFile>, Failure>,
    ) -> Result<Session, Failure> {
        let scene = request.scene;
        let script = script(scene, request.script)?;
        let mut replay = request.replay.map(Replay::open).transpose()?;
        let named = match (request.stage, &replay) {
            (Some(asked), _) => Some(asked.to_owned()),
            (None, Some(replay)) => Some(replay.stage()?),
            (None, None) => None,
        };
        let stage = stage(scene, named.as_deref())?;
        for error in stage::errors(&stage) {
            notice!("stage {}: {}; `greenstage check` says more", stage.name, error.message);
        }
        let file = file()?;
        let mut world = World::new(scene, &file, stage)?;
        let effects = effect::attach(effect::EFFECTS, scene, &file, &mut world)?;
        world.join(effects)?;
        let named = named.unwrap_or_else(|| stage_of_scene(scene));
        let origin = Origin { scene, file: &file, stage: &named };
        if let Some(replay) = &mut replay {
            replay.start(&origin, &mut world)?;
        }
        let recorder = request.record.map(|path| Recorder::create(path, &origin, &mut world)).transpose()?;
        let mut session = Session::new(world, script);
        (session.input.replay, session.recorder) = (replay, recorder);
        session.file = Some(file);
        session.scene = Some(Scene { stage: stage_from_scene(scene, &named), ..scene.clone() });
        Ok(session)
    }
}

/// The stage that is asked for, else the scene's; a path in the scene file is relative to it.
pub fn stage(scene: &Scene, asked: Option<&str>) -> Result<Stage, Failure> {
    let name = asked.map_or_else(|| stage_of_scene(scene), str::to_owned);
    crate::track::find_stage(&name).map_err(|error| match asked {
        Some(_) => Failure::request(error),
        None => Failure::request(scene.invalid("stage", error.to_string())),
    })
}

/// The scene's stage, as it is found from where the program runs.
fn stage_of_scene(scene: &Scene) -> String {
    if scene.stage.ends_with(".toml") {
        scene.resolve(Path::new(&scene.stage)).display().to_string()
    } else {
        scene.stage.clone()
    }
}

/// A stage as the scene would name it: a file by its path from the scene's folder.
fn stage_from_scene(scene: &Scene, named: &str) -> String {
    match named.ends_with(".toml") {
        true => relative(Path::new(named), &scene.path).display().to_string(),
        false => named.to_owned(),
    }
}

/// The script that is asked for, else the scene's, if it has one; a path in the scene file is relative to it.
pub fn script(scene: &Scene, asked: Option<&Path>) -> Result<Option<Script>, Failure> {
    let of_scene = || match &scene.script {
        Some(path) if path.extension().is_some_and(|e| e == "toml") => Some(scene.resolve(path)),
        other => other.clone(),
    };
    asked
        .map(Path::to_owned)
        .or_else(of_scene)
        .map(|name| {
            Script::find(&name.display().to_string()).map_err(|error| match asked {
                Some(_) => Failure::request(error),
                None => Failure::request(scene.invalid("script", error.to_string())),
            })
        })
        .transpose()
}
