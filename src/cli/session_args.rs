//! What `view` and `render` have in common: the session that they open, and what they look at before anything is solved.

use super::opening::Guess;
use crate::base::failure::Failure;
use crate::base::output;
use crate::display::pictures::PictureRequest;
use crate::effect::force_curve;
use crate::prepare;
use crate::scene::{Body, Scene};
use crate::session::{Request, recording};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct SessionArgs {
    /// Scene file (TOML); or a built-in scene: tube, hose, bar, bear, models, stylus; or a mesh or surface file, for which a scene is proposed
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
    /// Use this .green file, never rewrite it; default: the scene's own, rebuilt if missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
}

impl SessionArgs {
    /// Whether the session's states are compared, so that its bodies deform on the CPU.
    pub fn is_recorded(&self) -> bool {
        self.record.is_some() || self.replay.is_some()
    }

    pub fn request<'a>(&'a self, scene: &'a Scene) -> Request<'a> {
        Request {
            scene,
            stage: self.stage.as_deref(),
            script: self.script.as_deref(),
            green: self.green.as_deref(),
            replay: self.replay.as_deref(),
            record: self.record.as_deref(),
        }
    }

    fn try_curve(&self, scene: &Scene, path: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
        let lists = |body: &Body| body.effects.iter().any(|effect| effect == force_curve::NAME);
        if !scene.body.values().any(lists) {
            let (path, name) = (scene.path.display(), force_curve::NAME);
            return Err(Failure::wrong(format!(
                "--curve: no body of {path} lists the effect \"{name}\": write effects = [\"{name}\"] in the body whose \
                 curve you want"
            )));
        }
        Ok(output::try_path(path, &force_curve::TABLE, inputs)?)
    }

    /// Whether everything can be written, before anything is solved.
    pub fn try_outputs(&self, scene: &Scene, pictures: Option<&PictureRequest>) -> Result<(), Failure> {
        let stage = self.stage.as_deref().map(Path::new);
        let named = [stage, self.script.as_deref(), self.replay.as_deref(), self.green.as_deref()];
        let inputs = prepare::inputs_and(scene, named);
        if let Some(path) = &self.record {
            recording::try_path(path, &inputs)?;
        }
        if let Some(path) = &self.curve {
            self.try_curve(scene, path, &inputs)?;
        }
        pictures.map_or(Ok(()), |pictures| pictures.try_folder(&inputs))?;
        prepare::try_green(scene, self.green.as_deref())
    }
}
