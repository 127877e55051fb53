//! `greenstage pattern`: the test pattern on every screen of a stage, for installing a display.

mod paint;

pub use paint::Pattern;

use super::failure::Failure;
use super::render::save;
use crate::render::{COLOR_FORMAT, FrameContents, Gpu, Offscreen, Overlay, Renderer, Viewport};
use crate::stage::Stage;
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Test pattern on every screen of a stage: grid and rulers in centimetres, border, corners, eyes
///
/// `greenstage manual stages` tells what each part of the pattern shows.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file
    pub stage: String,
    /// Folder for PNGs instead of windows, one per screen and eye
    #[arg(short, long)]
    pub output: PathBuf,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let stage = Stage::find(&args.stage).map_err(Failure::request)?;
    pictures(&stage, &args.output)
}

/// One PNG per screen and eye, as many pixels as the screen has.
fn pictures(stage: &Stage, folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))
        .map_err(Failure::Request)?;
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
                Pattern { painter, rect: painter.clip_rect(), stage: &stage.name, screen, eye }.paint();
            });
            overlay.draw(&gpu, [(&target.image.view, &sheet)])?;
            let (image, _) = target.read(&gpu)?;
            save(&image, &folder.join(format!("{}-{}.png", screen.name, eye.name())))?;
            count += 1;
        }
    }
    super::print(&format!("{count} pictures in {}\n", folder.display()))
}
