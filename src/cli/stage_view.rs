//! `greenstage stage-view`: shows the room from outside, in a window or as a picture.

use super::inspect::{is_built_in_scene, is_stage};
use super::parsers;
use super::print::print;
use super::track::Redirects;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output;
use crate::display::application::{self, Options, Shows};
use crate::display::device;
use crate::display::model_window::{ModelWindow, picture};
use crate::display::pictures::{PNG, save};
use crate::display::stage_model::Camera;
use crate::prepare::{self, Resolved};
use crate::render::Samples;
use crate::session::{Request, Session};
use crate::tuning;
use crate::world::World;
use std::path::PathBuf;
use std::sync::Arc;

/// Show the room from outside: screens, eyes and what they see, head, stylus, bodies, trackers
///
/// In a window the stage's trackers move head and styli, and every sensor that they report is shown where the
/// calibration puts it; until a sensor is tracked, the scene's script moves them. Dragging turns the view, the wheel
/// zooms, and Escape or closing the window quits.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML), or a built-in scene (tube, bear, …); or a stage: a built-in one (workbench, cyberstage, cave6, …), or a
    /// stage file
    pub scene_or_stage: PathBuf,
    /// Stage on which a scene is shown; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// A PNG file instead of a window, of the stage as its file has it, without live trackers; overwrites a PNG file, and
    /// nothing else
    #[arg(short, long, conflicts_with_all = ["seconds", "redirects"])]
    pub output: Option<PathBuf>,
    /// Place of the camera, metres in the room: x,y,z; default: behind the viewer, above and to the right
    #[arg(long, value_parser = place, allow_hyphen_values = true)]
    pub from: Option<[f64; 3]>,
    /// Width and height of the picture or the window: 1280x960
    #[arg(long, value_parser = size, default_value = "1280x960")]
    pub size: [u32; 2],
    /// Time in the scene's script that the picture shows, s
    #[arg(long, default_value_t = 0.0, requires = "output")]
    pub time: f64,
    /// Close the window after so many seconds
    #[arg(long, value_parser = parsers::positive)]
    pub seconds: Option<f64>,
    /// Use this .green file, never rewrite it; default: the scene's own, rebuilt if missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples per pixel, 1 or 4, which smooths edges; auto is 4, and 1 on a software device, where 4 take some three times as
    /// long
    #[arg(long, default_value = "auto", value_parser = parsers::samples)]
    pub samples: Samples,
    #[command(flatten)]
    pub redirects: Redirects,
}

fn place(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 3]>::try_from(numbers).ok())
        .filter(|place| place.iter().all(|x| x.abs() <= 1000.0))
        .ok_or("three numbers of metres up to 1000, as 2.5,1.8,3".into())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides: Option<Vec<u32>> = text.split('x').map(|word| word.trim().parse().ok()).collect();
    sides
        .and_then(|sides| <[u32; 2]>::try_from(sides).ok())
        .filter(|sides| sides.iter().all(|side| (16..=16384).contains(side)))
        .ok_or("width and height in pixels from 16 to 16384, as 1280x960".into())
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(path) = &args.output {
        let named = [args.stage.as_ref().map(PathBuf::from), args.green.clone()];
        let inputs: Vec<PathBuf> = named.into_iter().flatten().chain([args.scene_or_stage.clone()]).collect();
        if path.extension().is_none_or(|end| !end.eq_ignore_ascii_case("png")) {
            let (shown, png) = (path.display(), path.with_extension("png"));
            let text = format!("-o {shown}: the picture is a PNG file: write -o {}", png.display());
            return Err(Failure::wrong(text));
        }
        output::try_path(path, &PNG, &inputs)?;
    }
    let mut session = open(args)?;
    let stage = &session.world.assets.stage;
    let camera = match args.from {
        Some(place) => Camera::from(stage, place.into()),
        None => Camera::facing(stage),
    };
    if let Some(path) = &args.output {
        if !session.world.assets.stage.tracking.trackers.is_empty() {
            notice!(
                "note: the picture shows head and stylus as the files have them; without -o a window shows the trackers live"
            );
        }
        play(&mut session, args.time)?;
        save(&picture(&mut session, &camera, args.size, args.samples, device::Args::default())?, path)?;
        return print(&format!("{}\n", path.display()));
    }
    args.redirects.apply(&mut Arc::make_mut(&mut session.world.assets).stage)?;
    session.start_trackers()?;
    let shows = Shows::Model(Box::new(ModelWindow::new(camera, args.size)));
    let options = Options {
        samples: args.samples,
        vsync: true,
        limit_s: args.seconds,
        device: device::Args::default(),
    };
    application::run(session, None, shows, options)?;
    Ok(())
}

/// A scene on its stage, or a stage alone.
fn open(args: &Args) -> Result<Session, Failure> {
    let path = &args.scene_or_stage;
    let is_scene = is_built_in_scene(path)
        || path.extension().is_some_and(|extension| extension == "toml") && !is_stage(path)?;
    if !is_scene {
        if let Some(stage) = &args.stage {
            let text = format!("{} is a stage itself: leave out --stage {stage}", path.display());
            return Err(Failure::wrong(text));
        }
        if args.green.is_some() || args.time != 0.0 {
            let text = format!("{} is a stage: --green and --time are for a scene", path.display());
            return Err(Failure::wrong(text));
        }
        let stage = crate::track::find_stage(&path.display().to_string()).map_err(Failure::request)?;
        return Ok(Session::new(World::of_stage(stage)?, None));
    }
    let scene = Resolved::load(path)?;
    prepare::try_green(&scene, args.green.as_deref())?;
    let scene = tuning::settle(scene, false, false)?;
    Session::open(&Request {
        stage: args.stage.as_deref(),
        green: args.green.as_deref(),
        ..Request::new(&scene)
    })
}

/// The script from its beginning to `time_s`, in steps as fine as a hand's.
fn play(session: &mut Session, time_s: f64) -> Result<(), Failure> {
    let duration_s = session.input.script.as_ref().map_or(0.0, |script| script.duration_s);
    let end_s = time_s.clamp(0.0, duration_s);
    let steps = (end_s * 60.0).ceil().max(1.0);
    for k in 0..=steps as u32 {
        session.advance(end_s * f64::from(k) / steps)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_that_is_no_number_is_refused_wherever_it_stands() {
        assert_eq!(place("2.5, 1.8,3"), Ok([2.5, 1.8, 3.0]));
        assert_eq!(size("1280x960"), Ok([1280, 960]));
        for wrong in ["1,abc,2,3", "1,2", "1,2,3,4", "1,2,inf", "1,,2,3", ""] {
            assert!(place(wrong).is_err(), "{wrong}");
        }
        for wrong in ["1280xfoox960", "1280", "x1280x960", "8x960", "1280x960x2", "-1280x960"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
