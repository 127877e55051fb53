//! `greenstage view`: the online stage in windows; where there is no display, as offscreen pictures.

use super::parsers;
use super::print::print;
use super::session_args::{SessionArgs, draw};
use super::track::Redirects;
use crate::base::failure::Failure;
use crate::display::application::{self, FinishedSession, Opening, Options, Shows};
use crate::display::device;
use crate::display::offscreen::Pictures;
use crate::display::pictures::PictureRequest;
use crate::display::screen_windows::ScreenWindows;
use crate::prepare::Resolved;
use crate::render::{RenderError, Samples, window};
use crate::session::{Leader, Making, Session, keys, playback};
use crate::world::World;
use std::path::PathBuf;
use std::sync::Arc;

/// Show the scene and let you bend it, in windows; render it offscreen where there is no display
///
/// The scene's script moves head and styli, if it has one, until a tracker is seen or you press a mouse button or a key.
/// After that the stage's trackers move them, and mouse and keyboard move what the trackers do not (`greenstage manual
/// view` lists the bindings). Escape or closing a window quits.
#[derive(Debug, clap::Args)]
#[command(after_help = keys::bindings())]
pub struct Args {
    #[command(flatten)]
    pub session: SessionArgs,
    /// Play the recording, or the script, as fast as possible without a window or a graphics device; the status is 1 if a
    /// frame comes to another state than was recorded
    #[arg(long, conflicts_with_all = ["samples", "window_scale", "no_vsync", "overlay", "seconds", "offscreen"])]
    pub check: bool,
    /// Samples per pixel, 1 or 4, which smooths edges; auto is 4, and 1 on a software device, where 4 take some three times as
    /// long
    #[arg(long, default_value = "auto", value_parser = parsers::samples)]
    pub samples: Samples,
    /// Size of the windows against the screens' own pixels; default: 1 for a single window and where the stage file has
    /// windows of its own, else 0.5
    #[arg(long, value_parser = parsers::scale)]
    pub window_scale: Option<f64>,
    /// Present at once instead of waiting for the display's refresh
    #[arg(long)]
    pub no_vsync: bool,
    /// Show the overlay from the beginning, on the screen that the viewer looks at
    #[arg(long)]
    pub overlay: bool,
    /// Quit after so many seconds
    #[arg(long, value_parser = parsers::positive)]
    pub seconds: Option<f64>,
    /// Folder of the pictures when there is no display; overwrites PNG files of their names, and nothing else
    #[arg(long, default_value = "out/demo")]
    pub offscreen: PathBuf,
    #[command(flatten)]
    pub redirects: Redirects,
    #[command(flatten)]
    pub device: device::Args,
}

/// Pictures of a script or a recording where there is no display.
const OFFSCREEN: usize = 20;

pub fn run(args: &Args) -> Result<(), Failure> {
    let device = args.device.for_session(args.session.is_recorded())?;
    match window::find_display() {
        _ if args.check => check(args),
        Ok(()) => in_windows(args, device),
        Err(reason) => in_pictures(args, &reason),
    }
}

fn check(args: &Args) -> Result<(), Failure> {
    let scene = args.session.load_scene(None)?;
    print(&playback::check(&mut args.session.open(&scene)?)?)
}

/// Opens the windows at once, on the stage alone; the scene is put into them when it is ready.
fn in_windows(args: &Args, device: device::Args) -> Result<(), Failure> {
    let scene = args.session.load_scene(None)?;
    let request = args.session.request(&scene);
    let stage = request.stage()?;
    let mut screens = ScreenWindows::new(&stage, args.window_scale);
    if args.overlay {
        screens = screens.with_overlay(&stage);
    }
    let options = Options { samples: args.samples, vsync: !args.no_vsync, limit_s: args.seconds, device };
    let opening = Opening {
        making: Making::begin(scene.clone(), args.session.green.clone())?,
        open: Box::new(|file| {
            let mut session = Session::open_with(&request, || Ok(file))?;
            // A recording has its own head and hands.
            if session.input.replay.is_none() {
                start(args, &scene, &mut session)?;
            }
            Ok(session)
        }),
    };
    let empty = Session::new(World::of_stage(stage)?, None);
    let shows = Shows::Screens(Box::new(screens));
    let FinishedSession { mut session, frames, lasted_s } =
        application::run(empty, Some(opening), shows, options)?;
    let rate = f64::from(frames) / lasted_s;
    print(&format!("{}{frames} frames in {lasted_s:.1} s: {rate:.1} frames/s\n", session.summary()))?;
    print(&session.report()?)
}

/// Lets a person and the devices of the stage move what they can.
fn start(args: &Args, scene: &Resolved, session: &mut Session) -> Result<(), Failure> {
    print(&format!("{}\n", keys::bindings()))?;
    args.redirects.apply(&mut Arc::make_mut(&mut session.world.assets).stage)?;
    session.attach_mouse();
    session.start_effects(scene)?;
    session.start_trackers()
}

fn in_pictures(args: &Args, reason: &RenderError) -> Result<(), Failure> {
    let mut pictures = PictureRequest {
        folder: args.offscreen.clone(),
        frames: OFFSCREEN,
        pictures: Pictures::Eyes,
        samples: args.samples,
        scale: args.window_scale.unwrap_or(1.0),
        overlay: args.overlay,
        device: args.device,
    };
    let scene = args.session.load_scene(Some(&pictures))?;
    let mut session = args.session.open(&scene)?;
    print(&format!("{reason}: rendering offscreen to {}\n", args.offscreen.display()))?;
    if session.input.leader() == Leader::Nobody {
        pictures.frames = 1;
    }
    draw(&pictures, &mut session)
}
