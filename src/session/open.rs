//! Opens a session from the options of a command: scene, stage, script, .green file, recordings. [`Making`] finds or makes a
//! scene's .green file while windows are already open.

use super::advance::Session;
use super::change::Steps;
use super::recording::{Origin, Replay};
use super::sound_file::SoundFile;
use crate::base::diagnostic::notice;
use crate::base::failure::{self, Failure};
use crate::base::progress::{Bars, Progress};
use crate::green::GreenFile;
use crate::prepare::Resolved;
use crate::scene::Scene;
use crate::scene::proposal::stage_from_scene;
use crate::stage::Stage;
use crate::track::Script;
use crate::{effect, prepare, stage};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// The options with which a session is opened; what they leave out is taken from the scene.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    pub scene: &'a Resolved,
    /// A built-in stage, or a stage file.
    pub stage: Option<&'a str>,
    pub script: Option<&'a Path>,
    /// A .green file that is only read.
    pub green: Option<&'a Path>,
    /// A session that moves everything, on its own stage unless another is named.
    pub replay: Option<&'a Path>,
    /// The recording into which every frame is written.
    pub record: Option<&'a Path>,
    /// The table of what its effects have recorded.
    pub curve: Option<&'a Path>,
    /// The WAV file of what is heard.
    pub sound: Option<&'a Path>,
}

impl<'a> Request<'a> {
    /// A request with everything as the scene has it.
    pub fn new(scene: &'a Resolved) -> Request<'a> {
        Request {
            scene,
            stage: None,
            script: None,
            green: None,
            replay: None,
            record: None,
            curve: None,
            sound: None,
        }
    }

    /// The stage on which the session is.
    pub fn stage(&self) -> Result<Stage, Failure> {
        let replay = self.replay.map(Replay::open).transpose()?;
        stage(self.scene, self.named_stage(replay.as_ref())?.as_deref())
    }

    /// The stage that is asked for, or that of a recording; `None` for the scene's own.
    fn named_stage(&self, replay: Option<&Replay>) -> Result<Option<String>, Failure> {
        let asked = self.stage.map(|asked| Ok(asked.to_owned()));
        asked.or_else(|| replay.map(Replay::stage)).transpose()
    }
}

impl Session {
    /// Makes the .green file where it is missing or stale; the trackers and force devices are not started.
    pub fn open(request: &Request<'_>) -> Result<Session, Failure> {
        Session::open_with(request, || prepare::green_file(request.scene, request.green))
    }

    /// Opens a session, with a .green file that is asked for once all else is found right.
    pub fn open_with(
        request: &Request<'_>,
        file: impl FnOnce() -> Result<Arc<GreenFile>, Failure>,
    ) -> Result<Session, Failure> {
        let scene = request.scene;
        let script = script(scene, request.script)?;
        let mut replay = request.replay.map(Replay::open).transpose()?;
        let named = request.named_stage(replay.as_ref())?;
        let stage = stage(scene, named.as_deref())?;
        for error in stage::errors(&stage) {
            notice!("stage {}: {}; `greenstage check` says more", stage.name, error.message);
        }
        let file = file()?;
        let mut world = effect::world(effect::EFFECTS, scene, &file, stage)?;
        let named = named.unwrap_or_else(|| scene.stage_from_here());
        if let Some(replay) = &mut replay {
            replay.start(&Origin { scene, file: &file, stage: &named }, &mut world)?;
        }
        let mut session = Session::new(world, script);
        session.input.replay = replay;
        session.curve = request.curve.map(Path::to_owned);
        session.sound = request.sound.map(SoundFile::new);
        session.file = Some(file);
        session.scene = Some(scene.with_stage(stage_from_scene(&named, &scene.path)));
        request.record.map_or(Ok(()), |path| session.record(path))?;
        Ok(session)
    }
}

/// The stage that is asked for, else the scene's; a path in the scene file is relative to it.
pub fn stage(scene: &Scene, asked: Option<&str>) -> Result<Stage, Failure> {
    let name = asked.map_or_else(|| scene.stage_from_here(), str::to_owned);
    crate::track::find_stage(&name).map_err(|error| match asked {
        Some(_) => Failure::request(error),
        None => Failure::request(scene.invalid("stage", error.to_string())),
    })
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

/// A thread that finds or makes a scene's .green file, and the steps that the windows show meanwhile, as standard error
/// does.
pub struct Making {
    pub steps: Arc<Steps>,
    thread: JoinHandle<Result<Arc<GreenFile>, Failure>>,
}

/// Shows progress in the window as on standard error.
struct Both {
    body: String,
    bars: Bars,
    steps: Arc<Steps>,
}

impl Progress for Both {
    fn begin(&self, step: &str, units: u64) {
        self.bars.begin(step, units);
        self.steps.begin(&format!("{}, {step}", self.body), units);
    }

    fn advance(&self, units: u64) {
        self.bars.advance(units);
        self.steps.advance(units);
    }

    fn end(&self) {
        self.bars.end();
    }

    fn tell(&self, sentence: &str) {
        self.bars.tell(sentence);
    }
}

impl Making {
    /// Begins to find or make the file; `green` is one that is only read.
    ///
    /// # Errors
    /// What of the scene cannot be made.
    pub fn begin(scene: Resolved, green: Option<PathBuf>) -> Result<Making, Failure> {
        for name in scene.body.keys() {
            scene.requirements(name)?;
        }
        let steps = Arc::new(Steps::default());
        let told = steps.clone();
        let make = move || {
            let teller = |name: &str| -> Box<dyn Progress> {
                Box::new(Both { body: name.to_owned(), bars: Bars::new(name, false), steps: told.clone() })
            };
            prepare::green_file_telling(&scene, green.as_deref(), &teller)
        };
        let thread = std::thread::Builder::new().name("making".into()).spawn(make).map_err(Failure::work)?;
        Ok(Making { steps, thread })
    }

    pub fn is_done(&self) -> bool {
        self.thread.is_finished()
    }

    /// The file; waits for it.
    pub fn finish(self) -> Result<Arc<GreenFile>, Failure> {
        failure::join(self.thread, "precomputing")
    }
}
