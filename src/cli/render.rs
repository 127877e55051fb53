//! `greenstage render`: the scripted scene as offscreen pictures.

use super::parsers;
use super::session_args::{SessionArgs, draw};
use crate::base::failure::Failure;
use crate::display::device;
use crate::display::offscreen::Pictures;
use crate::display::pictures::PictureRequest;
use crate::render::Samples;
use crate::stage::Stereo;
use std::path::PathBuf;

/// Render the scripted scene into PNG files: every frame, screen and eye, and a contact sheet
///
/// Head and stylus follow the scene's script (or --script), or a session that was recorded (--replay); without one
/// everything stands at rest.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub session: SessionArgs,
    /// Folder for the pictures; overwrites PNG files of these names, and nothing else
    #[arg(short, long)]
    pub output: PathBuf,
    /// Frames, evenly over the script or the recording
    #[arg(long, default_value_t = 20, value_parser = parsers::frames)]
    pub frames: usize,
    /// Samples per pixel, 1 or 4, which smooths edges; auto is 4, and 1 on a software device, where 4 take some three times as
    /// long
    #[arg(long, default_value = "auto", value_parser = parsers::samples)]
    pub samples: Samples,
    /// Size of the pictures against the screens' own pixels, 0.01 to 4
    #[arg(long, default_value_t = 1.0, value_parser = parsers::scale)]
    pub window_scale: f64,
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
    args.device.for_session(args.session.is_recorded())?;
    let pictures = PictureRequest {
        folder: args.output.clone(),
        frames: args.frames,
        pictures: match args.stereo {
            _ if args.windows => Pictures::Windows,
            Some(stereo) => Pictures::Joined(stereo),
            None => Pictures::Eyes,
        },
        samples: args.samples,
        scale: args.window_scale,
        overlay: args.overlay,
        device: args.device,
    };
    let scene = args.session.load_scene(Some(&pictures))?;
    draw(&pictures, &mut args.session.open(&scene)?)
}
