//! `greenstage render`: the scripted scene as offscreen pictures.

use super::device;
use super::failure::Failure;
use super::picture::{DrawTimes, Targets};
use super::session;
use super::table::seconds;
use super::world::{StepTimes, World};
use crate::scene::Scene;
use crate::stage::{Stage, Stereo};
use crate::track::Script;
use anyhow::Context;
use image::{RgbaImage, imageops};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Offscreen PNGs of the scripted scene: every frame, screen and eye, and a contact sheet
///
/// Head and stylus follow the scene's script (or --script); without one everything stands at rest.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Stage: workbench, workbench-one-sided, cyberstage, desktop, or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// Folder for the pictures
    #[arg(short, long)]
    pub output: PathBuf,
    /// Frames, evenly over the script
    #[arg(long, default_value_t = 20, value_parser = super::frames)]
    pub frames: usize,
    /// Key frames for head and stylus: bend, or a script file; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples a pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = super::samples)]
    pub samples: u32,
    /// Size of the pictures against the screens' own pixels, 0.01 to 8
    #[arg(long, default_value_t = 1.0, value_parser = super::scale)]
    pub scale: f64,
    /// Both eyes in one picture as a display wants them (`greenstage manual stages` lists the kinds), or one eye's;
    /// default: a picture per eye
    #[arg(long, value_parser = Stereo::named)]
    pub stereo: Option<Stereo>,
    #[command(flatten)]
    pub device: device::Args,
}

/// Width of one picture on the contact sheet.
const SHEET_PICTURE: u32 = 400;
const SHEET_GAP: u32 = 8;

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = super::plan::settled(Scene::load(&args.scene)?, false)?;
    let stage = stage(&scene, args.stage.as_deref())?;
    let script = script(&scene, args.script.as_deref())?;
    let file = session::green_file(&scene, args.green.as_deref())?;
    let mut world = World::new(&scene, &file, stage)?;
    pictures(args, &mut world, script.as_ref())
}

/// The stage that is asked for, else the scene's; a path in the scene file is relative to it.
pub fn stage(scene: &Scene, asked: Option<&str>) -> Result<Stage, Failure> {
    let name = match asked {
        Some(name) => name.to_owned(),
        None if scene.stage.ends_with(".toml") => {
            scene.resolve(Path::new(&scene.stage)).display().to_string()
        }
        None => scene.stage.clone(),
    };
    Stage::find(&name).map_err(|error| match asked {
        Some(_) => Failure::request(error),
        None => Failure::request(scene.invalid("stage", error.to_string())),
    })
}

/// The script that is asked for, else the scene's, if it has one; a path in the scene file is relative to it.
pub fn script(scene: &Scene, asked: Option<&Path>) -> Result<Option<Script>, Failure> {
    let of_scene = || match &scene.script {
        Some(path) if path.extension().is_some_and(|e| e == "toml") => Some(scene.resolve(path)),
        other => other.clone(),
    };
    asked
        .map(Path::to_owned)
        .or_else(of_scene)
        .map(|name| {
            Script::find(&name.display().to_string()).map_err(|error| match asked {
                Some(_) => Failure::request(error),
                None => Failure::request(scene.invalid("script", error.to_string())),
            })
        })
        .transpose()
}

/// A script played in a number of pictures, with fine steps between them that nobody sees: a grab needs the moment at
/// which the button goes down.
pub struct Playback<'a> {
    pub script: Option<&'a Script>,
    /// Pictures over the whole script, 1 or more.
    pub frames: usize,
    pub done: usize,
}

/// Fine steps over a whole script, at least.
const SCRIPT_STEPS: usize = 240;

impl Playback<'_> {
    /// Moves the world on to picture `frame`, counted from 0; returns what the mechanics of the last step took.
    pub fn step_to(&mut self, world: &mut World, frame: usize) -> StepTimes {
        let Some(script) = self.script else { return world.step(&Default::default()) };
        let between = SCRIPT_STEPS.div_ceil(self.frames);
        let last = ((self.frames - 1) * between).max(1);
        let mut times = StepTimes::default();
        while self.done <= frame * between {
            let time_s = script.duration_s * self.done as f64 / last as f64;
            let state = script.sample(&world.stage, time_s);
            times = world.step(&state);
            self.done += 1;
        }
        times
    }
}

/// Renders all frames into the folder, with a contact sheet of first, middle and last.
pub fn pictures(args: &Args, world: &mut World, script: Option<&Script>) -> Result<(), Failure> {
    let folder = &args.output;
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))
        .map_err(Failure::Request)?;
    let mut targets = Targets::new(world, args.stereo, args.samples, args.scale, args.device)?;
    eprintln!("{}: drawing on {}", world.stage.name, targets.gpu.describe());
    let shown = [0, args.frames / 2, args.frames - 1];
    let bar = indicatif::ProgressBar::new(args.frames as u64).with_message("frames");
    let mut sheet: Vec<Vec<RgbaImage>> = Vec::new();
    let (mut drawn_s, mut mechanics_s, mut count) = (0.0, 0.0, 0);
    let started = Instant::now();
    let mut playback = Playback { script, frames: args.frames, done: 0 };
    for frame in 0..args.frames {
        let times = playback.step_to(world, frame);
        let DrawTimes { upload_s, encode_s, draw_s } = targets.draw(world).map_err(Failure::work)?;
        drawn_s += upload_s + encode_s + draw_s;
        mechanics_s += times.interact_s + times.deform_s + times.normals_s;
        let (images, _) = targets.read().map_err(Failure::work)?;
        for (name, image) in &images {
            save(image, &folder.join(format!("frame{frame:04}-{name}.png")))?;
            count += 1;
        }
        if shown.contains(&frame) {
            sheet.push(images.into_iter().map(|(_, image)| small(&image)).collect());
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let path = folder.join("contact-sheet.png");
    save(&contact_sheet(&sheet, &world.stage.screens_from_top()), &path)?;
    let pairs = (args.frames * world.stage.screens.len()) as f64;
    super::print(&format!(
        "{count} pictures in {} (all steps, PNG files too: {})\n\
         drawing {:.1} {}/s, a frame of {} screen(s) {}; its mechanics {}\ncontact sheet {}\n",
        folder.display(),
        seconds(started.elapsed().as_secs_f64()),
        pairs / drawn_s,
        pictures_name(&world.stage),
        world.stage.screens.len(),
        seconds(drawn_s / args.frames as f64),
        seconds(mechanics_s / args.frames as f64),
        path.display()
    ))
}

/// What is counted as one: both eyes of a screen, or its one picture.
pub fn pictures_name(stage: &Stage) -> &'static str {
    if stage.stereo == Stereo::Mono { "pictures" } else { "stereo pairs" }
}

pub fn save(image: &RgbaImage, path: &Path) -> Result<(), Failure> {
    image.save(path).with_context(|| path.display().to_string()).map_err(Failure::Work)
}

fn small(image: &RgbaImage) -> RgbaImage {
    let width = SHEET_PICTURE.min(image.width());
    let height = (u64::from(image.height()) * u64::from(width) / u64::from(image.width())).max(1) as u32;
    imageops::resize(image, width, height, imageops::FilterType::Triangle)
}

/// Frames from left to right, in each one column per eye; a column shows the screens from the highest to the lowest,
/// so that a wall stands on the table before it.
fn contact_sheet(frames: &[Vec<RgbaImage>], from_top: &[usize]) -> RgbaImage {
    let screens = from_top.len();
    let pictures = frames.iter().map(Vec::len).max().unwrap_or(0);
    let eyes = pictures.checked_div(screens).unwrap_or(0).max(1);
    let size = |pick: fn(&RgbaImage) -> u32| frames.iter().flatten().map(pick).max().unwrap_or(1);
    let (width, height) = (size(RgbaImage::width), size(RgbaImage::height));
    let frame_width = eyes as u32 * (width + SHEET_GAP) + 2 * SHEET_GAP;
    let background = image::Rgba([24, 26, 30, 255]);
    let mut sheet = RgbaImage::from_pixel(
        frames.len() as u32 * frame_width + SHEET_GAP,
        screens as u32 * (height + 1) + 2 * SHEET_GAP,
        background,
    );
    for (f, frame) in frames.iter().enumerate() {
        for (p, image) in frame.iter().enumerate() {
            let (screen, eye) = (p / eyes, p % eyes);
            let x = 2 * SHEET_GAP + f as u32 * frame_width + eye as u32 * (width + SHEET_GAP);
            let row = from_top.iter().position(|&s| s == screen).unwrap_or(screen);
            let y = SHEET_GAP + row as u32 * (height + 1);
            imageops::replace(&mut sheet, image, i64::from(x), i64::from(y));
        }
    }
    sheet
}
