//! `greenstage view`: the online stage in windows; where there is no display, as offscreen pictures.

use super::parsers;
use super::print::print;
use super::render;
use crate::base::failure::Failure;
use crate::display::application::{self, Finished, Options, Shows};
use crate::display::device;
use crate::display::offscreen::Pictures;
use crate::display::pictures::PictureRequest;
use crate::display::screen_windows::ScreenWindows;
use crate::render::window;
use crate::scene::Scene;
use crate::session::{Request, Session, keys, playback};
use std::path::PathBuf;

/// Show the scene and let you bend it, in windows; render it offscreen where there is no display
///
/// The scene's script moves head and styli, if it has one, until a tracker is seen or you press a mouse button or a key.
/// After that the stage's trackers move them, and mouse and keyboard move what the trackers do not (`greenstage manual
/// view` lists the bindings). Escape or closing a window quits.
#[derive(Debug, clap::Args)]
#[command(after_help = keys::bindings())]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// Key frames for head and stylus; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// Write the session into this file, for --replay; overwrites a recording, and nothing else
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Replay a session that --record wrote: its poses, buttons and commands, on its stage
    #[arg(long, conflicts_with_all = ["script", "record"])]
    pub replay: Option<PathBuf>,
    /// Play the recording, or the script, as fast as possible without a window or a graphics device; the status is 1 if a
    /// frame comes to another state than was recorded
    #[arg(long)]
    pub check: bool,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples per pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = parsers::samples)]
    pub samples: u32,
    /// Size of the windows against the screens' own pixels; default: 1 for a single window and where the stage file has
    /// windows of its own, else 0.5
    #[arg(long, value_parser = parsers::scale)]
    pub scale: Option<f64>,
    /// Present at once instead of waiting for the display's refresh
    #[arg(long)]
    pub no_vsync: bool,
    /// Show the overlay from the beginning, on the screen that the viewer looks at
    #[arg(long)]
    pub overlay: bool,
    /// Quit after so many seconds
    #[arg(long, value_parser = parsers::positive)]
    pub seconds: Option<f64>,
    /// Where the pictures go when there is no display; overwrites PNG files of their names, and nothing else
    #[arg(long, default_value = "out/demo")]
    pub offscreen: PathBuf,
    #[command(flatten)]
    pub device: device::Args,
}

impl Args {
    /// The demo: everything at its default.
    pub fn demo(scene: PathBuf) -> Args {
        Args {
            scene,
            stage: None,
            script: None,
            record: None,
            replay: None,
            check: false,
            green: None,
            samples: 4,
            scale: None,
            no_vsync: false,
            overlay: false,
            seconds: None,
            offscreen: "out/demo".into(),
            device: device::Args::default(),
        }
    }
}

/// Pictures of a script or a recording where there is no display.
const OFFSCREEN: usize = 20;

pub fn run(args: &Args) -> Result<(), Failure> {
    let device = args.device.for_session(args.record.is_some() || args.replay.is_some())?;
    let display = window::find_display();
    let scene = Scene::load(&args.scene)?;
    let request = Request {
        scene: &scene,
        stage: args.stage.as_deref(),
        script: args.script.as_deref(),
        green: args.green.as_deref(),
        replay: args.replay.as_deref(),
        record: args.record.as_deref(),
    };
    let pictures = PictureRequest {
        folder: args.offscreen.clone(),
        frames: OFFSCREEN,
        pictures: Pictures::Eyes,
        samples: args.samples,
        scale: args.scale.unwrap_or(1.0),
        overlay: args.overlay,
        device: args.device,
    };
    render::try_outputs(&request, Some(&pictures).filter(|_| display.is_err() && !args.check))?;
    let scene = super::plan::settled(scene.clone(), false, false)?;
    let mut session = Session::open(&Request { scene: &scene, ..request })?;
    if args.check {
        return print(&playback::check(&mut session)?);
    }
    if let Err(reason) = display {
        print(&format!("{reason}: rendering offscreen to {}\n", args.offscreen.display()))?;
        let moves = session.input.script.is_some() || args.replay.is_some();
        let pictures = PictureRequest { frames: if moves { OFFSCREEN } else { 1 }, ..pictures };
        print(&pictures.draw(&mut session)?)?;
        return print(&session.report()?);
    }
    // A recording has its own head and hands.
    if args.replay.is_none() {
        print(&format!("{}\n", keys::bindings()))?;
        session.attach_mouse();
        session.start_effects(&scene)?;
        session.start_trackers()?;
    }
    let stage = &session.world.stage;
    let screens = ScreenWindows::new(stage, args.scale);
    let screens = if args.overlay { screens.with_overlay(stage) } else { screens };
    let options = Options { samples: args.samples, vsync: !args.no_vsync, limit_s: args.seconds, device };
    let finished = application::run(session, Shows::Screens(screens), options)?;
    report(finished)
}

fn report(Finished { mut session, frames, lasted_s }: Finished) -> Result<(), Failure> {
    print(&session.effects.iter_mut().map(|effect| effect.summary()).collect::<String>())?;
    let rate = f64::from(frames) / lasted_s;
    print(&format!("{frames} frames in {lasted_s:.1} s: {rate:.1} frames/s\n"))?;
    print(&session.report()?)
}
