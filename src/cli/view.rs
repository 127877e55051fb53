//! `greenstage view`: the online stage in windows; where there is no display, as offscreen pictures.

use super::opening;
use super::parsers;
use super::print::print;
use super::session_args::SessionArgs;
use super::track::Redirects;
use crate::base::failure::Failure;
use crate::display::application::{self, Finished, Opening, Options, Shows};
use crate::display::device;
use crate::display::offscreen::Pictures;
use crate::display::pictures::PictureRequest;
use crate::display::screen_windows::ScreenWindows;
use crate::prepare::Resolved;
use crate::render::{Samples, window};
use crate::session::{Making, Session, keys, open, playback};
use crate::tuning;
use crate::world::World;
use std::path::PathBuf;

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
    #[arg(long)]
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
    /// Where the pictures go when there is no display; overwrites PNG files of their names, and nothing else
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
    let display = window::find_display();
    let scene = opening::scene(&args.session.scene, &args.session.guess)?;
    let pictures = PictureRequest {
        folder: args.offscreen.clone(),
        frames: OFFSCREEN,
        pictures: Pictures::Eyes,
        samples: args.samples,
        scale: args.window_scale.unwrap_or(1.0),
        overlay: args.overlay,
        device: args.device,
    };
    let shown = Some(&pictures).filter(|_| display.is_err() && !args.check);
    args.session.try_outputs(&scene, shown)?;
    let scene = tuning::settle(scene, false, false)?;
    if display.is_ok() && !args.check && !args.session.is_recorded() {
        return show(args, &scene, device);
    }
    let mut session = Session::open(&args.session.request(&scene))?;
    session.curve.clone_from(&args.session.curve);
    if args.check {
        return print(&playback::check(&mut session)?);
    }
    if let Err(reason) = display {
        print(&format!("{reason}: rendering offscreen to {}\n", args.offscreen.display()))?;
        let moves = session.input.script.is_some() || args.session.replay.is_some();
        let pictures = PictureRequest { frames: if moves { OFFSCREEN } else { 1 }, ..pictures };
        print(&pictures.draw(&mut session)?)?;
        print(&session.world.effects.iter_mut().map(|effect| effect.summary()).collect::<String>())?;
        return print(&session.report()?);
    }
    // A recording has its own head and hands.
    if args.session.replay.is_none() {
        start(args, &scene, &mut session)?;
    }
    let (shows, options) = windows(args, &session, device);
    report(application::run(session, None, shows, options)?)
}

/// Opens the windows at once; the scene is put into them when it is ready.
fn show(args: &Args, scene: &Resolved, device: device::Args) -> Result<(), Failure> {
    let request = args.session.request(scene);
    let stage = open::stage(scene, request.stage)?;
    let making = Making::begin(scene.clone(), args.session.green.clone())?;
    let open = move |file| {
        let mut session = Session::open_with(&request, || Ok(file))?;
        session.curve.clone_from(&args.session.curve);
        start(args, scene, &mut session)?;
        Ok(session)
    };
    let session = Session::new(World::of_stage(stage)?, None);
    let (shows, options) = windows(args, &session, device);
    let opening = Opening { making, open: Box::new(open) };
    report(application::run(session, Some(opening), shows, options)?)
}

fn start(args: &Args, scene: &Resolved, session: &mut Session) -> Result<(), Failure> {
    print(&format!("{}\n", keys::bindings()))?;
    session.attach_mouse();
    session.start_effects(scene)?;
    let mut stage = session.world.assets.stage.clone();
    args.redirects.apply(&mut stage)?;
    session.start_trackers(&stage)
}

fn windows(args: &Args, session: &Session, device: device::Args) -> (Shows, Options) {
    let stage = &session.world.assets.stage;
    let screens = ScreenWindows::new(stage, args.window_scale);
    let screens = if args.overlay { screens.with_overlay(stage) } else { screens };
    let options = Options { samples: args.samples, vsync: !args.no_vsync, limit_s: args.seconds, device };
    (Shows::Screens(Box::new(screens)), options)
}

fn report(Finished { mut session, frames, lasted_s }: Finished) -> Result<(), Failure> {
    print(&session.world.effects.iter_mut().map(|effect| effect.summary()).collect::<String>())?;
    let rate = f64::from(frames) / lasted_s;
    print(&format!("{frames} frames in {lasted_s:.1} s: {rate:.1} frames/s\n"))?;
    print(&session.report()?)
}
