//! `greenstage pattern`: the test pattern on every screen of a stage, for installing a display.

mod paint;

pub use paint::Pattern;

use super::aids::{Aids, Staged};
use super::failure::Failure;
use super::overlay::Readings;
use super::panes;
use super::render::{PNG, save};
use crate::base::output;
use crate::render::window::{self, AppError, Flow, Input, Key, WindowApp, WindowOptions, Windows};
use crate::render::{COLOR_FORMAT, FrameContents, Gpu, Offscreen, Overlay, Renderer, Viewport};
use crate::stage::{Eye, Stage, Window};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Test pattern on every screen of a stage: grid and rulers in centimetres, border, corners, eyes
///
/// `greenstage manual stages` tells what each part of the pattern shows.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file
    pub stage: String,
    /// Folder for PNGs instead of windows, one per screen and eye; overwrites PNG files of these names, and nothing else
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Size of the windows against the screens' own pixels
    #[arg(long, value_parser = super::scale, default_value_t = 1.0)]
    pub scale: f64,
    /// Close the windows after so many seconds
    #[arg(long, value_parser = super::positive)]
    pub seconds: Option<f64>,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let stage = Stage::find(&args.stage).and_then(crate::track::checked).map_err(Failure::request)?;
    if let Some(folder) = &args.output {
        return pictures(&stage, &args.stage, folder);
    }
    let layout = stage.layout();
    let specs = panes::specs(&stage, &layout, args.scale);
    let mut aids = Aids::new(&stage, &layout);
    aids.pattern = true;
    let swapped = stage.swap_eyes;
    let (started, limit_s) = (Instant::now(), args.seconds);
    let mut app = Shown { stage, layout, aids, swapped, started, limit_s };
    window::run(&specs, WindowOptions { samples: 1, vsync: true }, &mut app).map_err(Failure::work)
}

/// The stage's windows with the pattern in them; F2 shows the room, F4 swaps the eyes.
struct Shown {
    stage: Stage,
    layout: Vec<Window>,
    aids: Aids,
    swapped: bool,
    /// Of what the window system does not do.
    started: Instant,
    limit_s: Option<f64>,
}

impl WindowApp for Shown {
    fn start(&mut self, _: &Gpu) -> Result<(), AppError> {
        Ok(())
    }

    fn input(&mut self, input: Input) {
        match input {
            Input::Key { key: Key::Function(4), pressed: true, .. } => self.swapped = !self.swapped,
            Input::Key { key: Key::Function(1 | 3), .. } => {}
            _ => {
                self.aids.input(&input, &self.stage, &self.layout);
            }
        }
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        let sizes: Vec<[u32; 2]> = windows.sizes().collect();
        let staged = Staged {
            stage: &self.stage,
            layout: &self.layout,
            sizes: &sizes,
            swapped: self.swapped,
            room_from_head: self.stage.viewer.room_from_head,
            reports: &[],
        };
        let tiles = vec![Vec::new(); sizes.len()];
        self.aids.draw(windows, &staged, tiles, &FrameContents::default(), |_| Readings::default())?;
        let is_over = self.limit_s.is_some_and(|limit_s| self.started.elapsed().as_secs_f64() >= limit_s);
        Ok(if is_over { Flow::Quit } else { Flow::Continue })
    }
}

/// One PNG per screen and eye, as many pixels as the screen has.
fn pictures(stage: &Stage, named: &str, folder: &Path) -> Result<(), Failure> {
    output::make_folder(folder)?;
    let path = |screen: &str, eye: Eye| folder.join(format!("{screen}-{}.png", eye.name()));
    for screen in &stage.screens {
        for &eye in stage.eyes() {
            output::try_path(&path(&screen.name, eye), &PNG, &[PathBuf::from(named)])?;
        }
    }
    let gpu = Gpu::headless().map_err(Failure::work)?;
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 1)?;
    let mut overlay = Overlay::new(COLOR_FORMAT);
    let mut count = 0;
    for screen in &stage.screens {
        let target = Offscreen::new(&gpu, &renderer, screen.pixels)?;
        for &eye in stage.eyes() {
            renderer.draw(
                &gpu,
                &[target.picture(&Viewport::full(screen.pixels, None))],
                &FrameContents::default(),
            )?;
            let sheet = overlay.lay_out(screen.pixels, |painter| {
                let (rect, on_screen) = (painter.clip_rect(), [-1.0, 1.0, -1.0, 1.0]);
                Pattern { painter, rect, on_screen, stage: &stage.name, screen, eye }.paint();
            });
            overlay.draw(&gpu, [(&target.image.view, &sheet)])?;
            let (image, _) = target.read(&gpu)?;
            save(&image, &path(&screen.name, eye))?;
            count += 1;
        }
    }
    super::print(&format!("{count} pictures in {}\n", folder.display()))
}
