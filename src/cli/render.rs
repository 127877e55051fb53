//! `greenstage render`: the scripted scene as offscreen pictures.

use super::parsers;
use super::print::print;
use crate::base::failure::Failure;
use crate::display::device;
use crate::display::offscreen::Pictures;
use crate::display::pictures::PictureRequest;
use crate::prepare;
use crate::scene::Scene;
use crate::session::{Request, Session, recording};
use crate::stage::Stereo;
use std::path::{Path, PathBuf};

/// Render the scripted scene into PNG files: every frame, screen and eye, and a contact sheet
///
/// Head and stylus follow the scene's script (or --script), or a session that was recorded (--replay); without one
/// everything stands at rest.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// Folder for the pictures; overwrites PNG files of these names, and nothing else
    #[arg(short, long)]
    pub output: PathBuf,
    /// Frames, evenly over the script or the recording
    #[arg(long, default_value_t = 20, value_parser = parsers::frames)]
    pub frames: usize,
    /// Key frames for head and stylus: bend, or a script file; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// Replay a session that --record wrote, on its stage, instead of a script
    #[arg(long, conflicts_with_all = ["script", "record"])]
    pub replay: Option<PathBuf>,
    /// Write every step of the mechanics into this file, for --replay; overwrites a recording, and nothing else
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples per pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = parsers::samples)]
    pub samples: u32,
    /// Size of the pictures against the screens' own pixels, 0.01 to 4
    #[arg(long, default_value_t = 1.0, value_parser = parsers::scale)]
    pub scale: f64,
    /// Both eyes in one picture as a display wants them (`greenstage manual stages` lists the kinds), or one eye's;
    /// default: a picture per eye
    #[arg(long, value_parser = Stereo::named)]
    pub stereo: Option<Stereo>,
    /// A picture per window in place of one per screen and eye: as `view` presents it, with the stage file's windows,
    /// crops and stereo
    #[arg(long, conflicts_with = "stereo")]
    pub windows: bool,
    /// Draw the overlay on the screen that the viewer looks at
    #[arg(long)]
    pub overlay: bool,
    #[command(flatten)]
    pub device: device::Args,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    args.device.for_session(args.replay.is_some() || args.record.is_some())?;
    let scene = Scene::load(&args.scene)?;
    let pictures = PictureRequest {
        folder: args.output.clone(),
        frames: args.frames,
        pictures: match args.stereo {
            _ if args.windows => Pictures::Windows,
            Some(stereo) => Pictures::Joined(stereo),
            None => Pictures::Eyes,
        },
        samples: args.samples,
        scale: args.scale,
        overlay: args.overlay,
        device: args.device,
    };
    let request = Request {
        scene: &scene,
        stage: args.stage.as_deref(),
        script: args.script.as_deref(),
        green: args.green.as_deref(),
        replay: args.replay.as_deref(),
        record: args.record.as_deref(),
    };
    try_outputs(&request, Some(&pictures))?;
    let scene = super::plan::settled(scene.clone(), false, false)?;
    let mut session = Session::open(&Request { scene: &scene, ..request })?;
    print(&pictures.draw(&mut session)?)?;
    print(&session.report()?)
}

/// Whether everything that `render` and `view` write can be written, before anything is solved.
pub fn try_outputs(request: &Request<'_>, pictures: Option<&PictureRequest>) -> Result<(), Failure> {
    let named = [request.stage.map(Path::new), request.script, request.replay, request.green];
    let inputs = prepare::inputs_and(request.scene, named);
    if let Some(path) = request.record {
        recording::try_path(path, &inputs)?;
    }
    pictures.map_or(Ok(()), |pictures| pictures.try_folder(&inputs))?;
    prepare::try_green(request.scene, request.green)
}
