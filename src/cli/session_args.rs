//! Arguments that `view` and `render` share: the session that they open, and their checks before anything is solved.

use super::opening::Guess;
use super::print::print;
use crate::audio::WAV;
use crate::base::failure::Failure;
use crate::base::output::{self, Kind};
use crate::display::pictures::PictureRequest;
use crate::effect::{ListedEffect, name_of};
use crate::prepare::{self, Resolved};
use crate::session::{Request, Session, recording};
use crate::tuning;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct SessionArgs {
    /// Scene file (TOML); or a built-in scene: liver, tube, hose, bar, bear, models, stylus; or a mesh or surface file, for which a scene is proposed
    pub scene: PathBuf,
    #[command(flatten)]
    pub guess: Guess,
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// Key frames for head and stylus: bend, or a script file; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// Write the session into this file, for --replay; overwrites a recording, and nothing else
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Replay a session that --record wrote: its poses, buttons and commands, on its stage
    #[arg(long, conflicts_with_all = ["script", "record"])]
    pub replay: Option<PathBuf>,
    /// Write the last hold's force and displacement into this CSV file at the end, of bodies with the effect force_curve
    #[arg(long)]
    pub curve: Option<PathBuf>,
    /// Write what is heard of bodies with the effect sound into this WAV file, with a channel for each loudspeaker of the stage
    #[arg(long)]
    pub sound: Option<PathBuf>,
    /// Use this .green file, never rewrite it; default: the scene's own, rebuilt if missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
}

impl SessionArgs {
    /// Whether the session's states are compared, so that its bodies deform on the CPU.
    pub fn is_recorded(&self) -> bool {
        self.record.is_some() || self.replay.is_some()
    }

    /// The scene, found or proposed, ready to be solved. Whatever the run writes, `pictures` included, is tried before.
    pub fn load_scene(&self, pictures: Option<&PictureRequest>) -> Result<Resolved, Failure> {
        let scene = Resolved::load(&self.scene)?;
        self.try_outputs(&scene, pictures)?;
        tuning::settle(scene, false, false)
    }

    pub fn open(&self, scene: &Resolved) -> Result<Session, Failure> {
        Session::open(&self.request(scene))
    }

    pub fn request<'a>(&'a self, scene: &'a Resolved) -> Request<'a> {
        Request {
            scene,
            stage: self.stage.as_deref(),
            script: self.script.as_deref(),
            green: self.green.as_deref(),
            replay: self.replay.as_deref(),
            record: self.record.as_deref(),
            curve: self.curve.as_deref(),
            sound: self.sound.as_deref(),
        }
    }

    /// Whether everything can be written, before anything is solved.
    fn try_outputs(&self, scene: &Resolved, pictures: Option<&PictureRequest>) -> Result<(), Failure> {
        let stage = self.stage.as_deref().map(Path::new);
        let named = [stage, self.script.as_deref(), self.replay.as_deref(), self.green.as_deref()];
        let inputs = prepare::inputs_and(scene, named);
        prepare::try_green(scene, self.green.as_deref())?;
        if let Some(path) = &self.curve {
            output::try_path(path, curve_kind(scene)?, &inputs)?;
        }
        if let Some(path) = &self.sound {
            try_sound(scene)?;
            output::try_path(path, &WAV, &inputs)?;
        }
        if let Some(path) = &self.record {
            recording::try_path(path, &inputs)?;
        }
        pictures.map_or(Ok(()), |pictures| pictures.try_folder(&inputs))
    }
}

/// The kind of table that an effect of the scene records.
fn curve_kind(scene: &Resolved) -> Result<&'static Kind, Failure> {
    let mut listed = scene.bodies.values().flat_map(|body| &body.effects);
    listed.find_map(|ListedEffect { entry, .. }| entry.table).ok_or_else(|| {
        let (path, name) = (scene.path.display(), name_of(|effect| effect.table.is_some()));
        Failure::wrong(format!(
            "--curve: no body of {path} lists the effect \"{name}\": write effects = [\"{name}\"] in the body whose curve you want"
        ))
    })
}

/// Refuses a scene of which nothing is heard.
fn try_sound(scene: &Resolved) -> Result<(), Failure> {
    if scene.bodies.values().any(|body| body.entries().any(|effect| effect.is_heard)) {
        return Ok(());
    }
    let path = scene.path.display();
    let [needed, heard] = [name_of(|effect| effect.vibrates), name_of(|effect| effect.is_heard)];
    Err(Failure::wrong(format!(
        "--sound: no body of {path} lists the effect \"{heard}\": add \"{needed}\" and \"{heard}\" to the effects of the body that you \
         want to hear"
    )))
}

/// Draws pictures of a session, and prints how it went.
pub fn draw(pictures: &PictureRequest, session: &mut Session) -> Result<(), Failure> {
    let drawn = pictures.draw(session)?;
    print(&(drawn + &session.summary()))?;
    print(&session.report()?)
}
