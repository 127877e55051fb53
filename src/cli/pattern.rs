//! `greenstage pattern`: shows the test pattern on every screen of a stage, or lets its loudspeakers sound, for installing a display.

use super::print::print;
use super::{parsers, pattern_sound};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output;
use crate::base::table::count;
use crate::display::application::{self, Options, Shows};
use crate::display::device;
use crate::display::pattern::Pattern;
use crate::display::pictures::{PNG, save};
use crate::display::screen_windows::ScreenWindows;
use crate::render::{COLOR_FORMAT, FrameContents, Gpu, Offscreen, Overlay, Renderer, Samples, Viewport};
use crate::session::Session;
use crate::stage::{Eye, Stage};
use crate::world::World;
use std::path::{Path, PathBuf};

/// Show a test pattern on every screen of a stage: grid and rulers in centimetres, border, corners, eyes
///
/// `greenstage manual stages` explains each part of the pattern. With `--sound` the loudspeakers sound one after the other instead.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file
    pub stage: String,
    /// Folder for PNGs instead of windows, one per screen and eye; overwrites PNG files of these names, and nothing else
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Size of the windows against the screens' own pixels
    #[arg(long, value_parser = parsers::scale, default_value_t = 1.0, conflicts_with_all = ["output", "wav"])]
    pub window_scale: f64,
    /// Close the windows, or end the tones, after so many seconds
    #[arg(long, value_parser = parsers::positive)]
    pub seconds: Option<f64>,
    /// Let each loudspeaker sound instead: loudspeaker k gives k short tones and a long one, and its name is printed
    #[arg(long, conflicts_with_all = ["output", "window_scale"])]
    pub sound: bool,
    /// WAV file with a channel for each loudspeaker, instead of the audio device; overwrites a WAV file of this name
    #[arg(long, value_name = "FILE")]
    pub wav: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let stage = crate::track::find_stage(&args.stage).map_err(Failure::request)?;
    if args.sound || args.wav.is_some() {
        return pattern_sound::run(&stage, args.wav.as_deref(), args.seconds);
    }
    if let Some(folder) = &args.output {
        return pictures(&stage, &args.stage, folder);
    }
    let screens = ScreenWindows::of_pattern(&stage, args.window_scale);
    let session = Session::new(World::of_stage(stage)?, None);
    let (limit_s, device) = (args.seconds, device::Args::default());
    let options = Options { samples: Samples::Exactly(1), vsync: true, limit_s, device };
    application::run(session, None, Shows::Screens(Box::new(screens)), options)?;
    Ok(())
}

/// One PNG per screen and eye, as many pixels as the screen has.
fn pictures(stage: &Stage, named: &str, folder: &Path) -> Result<(), Failure> {
    output::make_folder(folder)?;
    let path = |screen: &str, eye: Eye| folder.join(format!("{screen}-{}.png", eye.name()));
    for screen in &stage.screens {
        for &eye in stage.stereo.eyes() {
            output::try_path(&path(&screen.name, eye), &PNG, &[PathBuf::from(named)])?;
        }
    }
    let windows = stage.layout();
    let mut hidden: Vec<_> = windows.iter().flat_map(|window| &window.tiles).collect();
    hidden.retain(|tile| tile.overscan != [0; 4]);
    // A screen may have a tile for each eye.
    hidden.sort_by_key(|tile| tile.screen);
    hidden.dedup_by_key(|tile| (tile.screen, tile.overscan));
    for tile in hidden {
        let [left, right, top, bottom] = tile.overscan;
        notice!(
            "note: {}: `overscan` of its tile hides the {left}, {right}, {top}, {bottom} at the left, right, \
             top and bottom edge; the window shows what is seen",
            stage.screens[tile.screen].name
        );
    }
    let gpu = Gpu::headless().map_err(Failure::work)?;
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1)?;
    let mut overlay = Overlay::new(COLOR_FORMAT);
    let mut written = 0;
    for screen in &stage.screens {
        let target = Offscreen::new(&gpu, &renderer, screen.pixels)?;
        for &eye in stage.stereo.eyes() {
            renderer.draw(
                &gpu,
                &[target.picture(&Viewport::full(screen.pixels, None))],
                &FrameContents::default(),
            )?;
            overlay.paint(&gpu, &target.image.view, screen.pixels, |painter| {
                let (rect, on_screen) = (painter.clip_rect(), [-1.0, 1.0, -1.0, 1.0]);
                Pattern { painter, rect, on_screen, stage: &stage.name, screen, eye }.paint();
            })?;
            let (image, _) = target.read(&gpu)?;
            save(&image, &path(&screen.name, eye))?;
            written += 1;
        }
    }
    print(&format!("{} in {}\n", count(written, "picture"), folder.display()))
}
