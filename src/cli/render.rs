//! `greenstage render`: the scripted scene as offscreen pictures.

use super::device;
use super::failure::Failure;
use super::picture::{DrawTimes, Pictures, Targets};
use super::playback::{Playback, Source};
use super::recording::{self, Origin, Recorder, Replay};
use super::session;
use super::table::seconds;
use super::view;
use super::world::World;
use crate::base::notice::notice;
use crate::base::output::{self, Kind};
use crate::green::GreenFile;
use crate::scene::Scene;
use crate::stage::{Stage, Stereo};
use crate::track::Script;
use image::{ImageFormat, RgbaImage, imageops};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Offscreen PNGs of the scripted scene: every frame, screen and eye, and a contact sheet
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
    #[arg(long, default_value_t = 20, value_parser = super::frames)]
    pub frames: usize,
    /// Key frames for head and stylus: bend, or a script file; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// A session recorded by --record: its poses and buttons instead of a script's, on its stage
    #[arg(long, conflicts_with_all = ["script", "record"])]
    pub replay: Option<PathBuf>,
    /// Write every step of the mechanics into this file, for --replay; overwrites a recording, and nothing else
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples a pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = super::samples)]
    pub samples: u32,
    /// Size of the pictures against the screens' own pixels, 0.01 to 4
    #[arg(long, default_value_t = 1.0, value_parser = super::scale)]
    pub scale: f64,
    /// Both eyes in one picture as a display wants them (`greenstage manual stages` lists the kinds), or one eye's;
    /// default: a picture per eye
    #[arg(long, value_parser = Stereo::named)]
    pub stereo: Option<Stereo>,
    /// A picture per window in place of one per screen and eye: as `view` presents it, with the stage file's windows,
    /// crops and stereo
    #[arg(long, conflicts_with = "stereo")]
    pub windows: bool,
    /// With the overlay on the screen that the viewer looks at
    #[arg(long)]
    pub overlay: bool,
    #[command(flatten)]
    pub device: device::Args,
}

impl Args {
    /// The same as `greenstage view` would show, without a display.
    pub fn of_view(args: &view::Args, frames: usize) -> Args {
        Args {
            scene: args.scene.clone(),
            stage: args.stage.clone(),
            output: args.offscreen.clone(),
            frames,
            script: args.script.clone(),
            replay: args.replay.clone(),
            record: args.record.clone(),
            green: args.green.clone(),
            samples: args.samples,
            scale: args.scale.unwrap_or(1.0),
            stereo: None,
            windows: false,
            overlay: args.overlay,
            device: args.device,
        }
    }
}

/// Width of one picture on the contact sheet.
const SHEET_PICTURE: u32 = 400;
const SHEET_GAP: u32 = 8;
const SHEET: &str = "contact-sheet.png";

pub const PNG: Kind = Kind { name: "a PNG file", recognizes: |head| head.starts_with(b"\x89PNG\r\n\x1a\n") };

pub fn run(args: &Args) -> Result<(), Failure> {
    args.device.for_session(args.replay.is_some() || args.record.is_some())?;
    let scene = Scene::load(&args.scene)?;
    try_outputs(args, &scene, true)?;
    let scene = super::plan::settled(scene, false, false)?;
    let script = script(&scene, args.script.as_deref())?;
    let mut show = Show::new(&scene, args.stage.as_deref(), args.green.as_deref(), args.replay.as_deref())?;
    let mut recorder = show.recorder(&scene, args.record.as_deref())?;
    pictures(args, &mut show, script.as_ref(), recorder.as_mut())
}

/// Whether all that `render` and `view` write can be written, before anything is solved.
pub fn try_outputs(args: &Args, scene: &Scene, has_pictures: bool) -> Result<(), Failure> {
    let stage = args.stage.as_deref().map(Path::new);
    let named = [stage, args.script.as_deref(), args.replay.as_deref(), args.green.as_deref()];
    let inputs = session::inputs_and(scene, named);
    if let Some(path) = &args.record {
        recording::try_path(path, &inputs)?;
    }
    if has_pictures {
        output::make_folder(&args.output)?;
        output::try_path(&args.output.join(SHEET), &PNG, &inputs)?;
        let pictures = std::fs::read_dir(&args.output).into_iter().flatten().flatten();
        let mut pictures = pictures.map(|entry| entry.path()).filter(|path| is_frame(path, args.frames));
        pictures.try_for_each(|path| output::may_replace(&path, &PNG, &inputs))?;
    }
    session::try_green(scene, args.green.as_deref())
}

/// Whether a file has the name of a picture of one of the first `frames` frames.
fn is_frame(path: &Path, frames: usize) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    let number = name.and_then(|name| {
        name.strip_prefix("frame")?.strip_suffix(".png")?.split_once('-')?.0.parse::<usize>().ok()
    });
    number.is_some_and(|number| number < frames)
}

/// A world, and the recording that moves it, where one does.
pub struct Show {
    pub world: World,
    pub replay: Option<Replay>,
    pub file: Arc<GreenFile>,
    /// A built-in stage, or the path of a stage file from where the program runs.
    stage: String,
}

impl Show {
    /// The stage is the one that is asked for, else the recording's, else the scene's.
    pub fn new(
        scene: &Scene,
        asked: Option<&str>,
        green: Option<&Path>,
        replay: Option<&Path>,
    ) -> Result<Show, Failure> {
        let mut replay = replay.map(Replay::open).transpose()?;
        let named = match (asked, &replay) {
            (Some(asked), _) => Some(asked.to_owned()),
            (None, Some(replay)) => Some(replay.stage()?),
            (None, None) => None,
        };
        let stage = stage(scene, named.as_deref())?;
        let file = session::green_file(scene, green)?;
        let mut world = World::new(scene, &file, stage)?;
        let stage = named.unwrap_or_else(|| stage_of_scene(scene));
        if let Some(replay) = &mut replay {
            replay.start(&Origin { scene, file: &file, stage: &stage }, &mut world)?;
        }
        Ok(Show { world, replay, file, stage })
    }

    /// A recorder of this world from now on, where a file is named.
    pub fn recorder(&self, scene: &Scene, path: Option<&Path>) -> Result<Option<Recorder>, Failure> {
        let origin = Origin { scene, file: &self.file, stage: &self.stage };
        path.map(|path| Recorder::create(path, &origin, &self.world)).transpose()
    }
}

/// How a replay went, or what was recorded.
pub fn report(replay: Option<&Replay>, recorder: Option<&mut Recorder>) -> Result<(), Failure> {
    let recorded = recorder.map_or(Ok(String::new()), Recorder::report)?;
    let replayed = replay.map_or(Ok(String::new()), Replay::report)?;
    super::print(&format!("{replayed}{recorded}"))
}

/// The stage that is asked for, else the scene's; a path in the scene file is relative to it.
pub fn stage(scene: &Scene, asked: Option<&str>) -> Result<Stage, Failure> {
    let name = asked.map_or_else(|| stage_of_scene(scene), str::to_owned);
    Stage::find(&name).and_then(crate::track::checked).map_err(|error| match asked {
        Some(_) => Failure::request(error),
        None => Failure::request(scene.invalid("stage", error.to_string())),
    })
}

/// The scene's stage, as it is found from where the program runs.
fn stage_of_scene(scene: &Scene) -> String {
    if scene.stage.ends_with(".toml") {
        scene.resolve(Path::new(&scene.stage)).display().to_string()
    } else {
        scene.stage.clone()
    }
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

/// Renders all frames into the folder, with a contact sheet of first, middle and last; tells how a replay went.
pub fn pictures(
    args: &Args,
    show: &mut Show,
    script: Option<&Script>,
    mut recorder: Option<&mut Recorder>,
) -> Result<(), Failure> {
    let world = &mut show.world;
    let folder = &args.output;
    output::make_folder(folder)?;
    let device = args.device.for_session(args.replay.is_some() || recorder.is_some())?;
    let asked_for = match args.stereo {
        _ if args.windows => Pictures::Windows,
        Some(stereo) => Pictures::Joined(stereo),
        None => Pictures::Eyes,
    };
    let mut targets = Targets::new(world, asked_for, args.samples, args.scale, device)?;
    if args.overlay {
        targets = targets.with_overlay();
    }
    notice!("{}: drawing on {}", world.stage.name, targets.gpu.describe());
    let shown = [0, args.frames / 2, args.frames - 1];
    let bar = indicatif::ProgressBar::new(args.frames as u64).with_message("frames");
    let mut sheet: Vec<Vec<RgbaImage>> = Vec::new();
    let (mut drawn_s, mut mechanics_s, mut count) = (0.0, 0.0, 0);
    let started = Instant::now();
    let mut playback = Playback::new(Source::new(script, show.replay.as_mut())?, args.frames);
    playback.recorder = recorder.as_deref_mut();
    for frame in 0..args.frames {
        let times = playback.step_to(world, frame)?;
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
    let path = folder.join(SHEET);
    let screens = world.stage.screens.len();
    // Windows lie as they are listed.
    let (count_of_frame, name, from_top) = match asked_for {
        Pictures::Windows => (targets.count(), "windows", (0..targets.count()).collect()),
        _ => (screens, pictures_name(&world.stage), world.stage.screens_from_top()),
    };
    save(&contact_sheet(&sheet, &from_top), &path)?;
    super::print(&format!(
        "{count} pictures in {} (all steps, PNG files too: {})\n\
         drawing {:.1} {name}/s, a frame of {screens} screen(s) {}; its mechanics {}\ncontact sheet {}\n",
        folder.display(),
        seconds(started.elapsed().as_secs_f64()),
        (args.frames * count_of_frame) as f64 / drawn_s,
        seconds(drawn_s / args.frames as f64),
        seconds(mechanics_s / args.frames as f64),
        path.display()
    ))?;
    report(show.replay.as_ref(), recorder)
}

/// What is counted as one: both eyes of a screen, or its one picture.
pub fn pictures_name(stage: &Stage) -> &'static str {
    if stage.stereo == Stereo::Mono { "pictures" } else { "stereo pairs" }
}

pub fn save(image: &RgbaImage, path: &Path) -> Result<(), Failure> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).map_err(Failure::work)?;
    Ok(output::write(path, &PNG, |file| file.write_all(bytes.get_ref()))?)
}

fn small(image: &RgbaImage) -> RgbaImage {
    let width = SHEET_PICTURE.min(image.width());
    let height = (u64::from(image.height()) * u64::from(width) / u64::from(image.width())).max(1) as u32;
    imageops::resize(image, width, height, imageops::FilterType::Triangle)
}

/// Frames from left to right, in each one column per eye; a column shows the screens from the highest to the lowest,
/// so that a wall stands on the table before it. Each row is as high as its highest picture.
fn contact_sheet(frames: &[Vec<RgbaImage>], from_top: &[usize]) -> RgbaImage {
    let screens = from_top.len();
    let pictures = frames.iter().map(Vec::len).max().unwrap_or(0);
    let eyes = pictures.checked_div(screens).unwrap_or(0).max(1);
    let width = frames.iter().flatten().map(RgbaImage::width).max().unwrap_or(1);
    let heights: Vec<u32> = from_top
        .iter()
        .map(|&screen| {
            let row = frames.iter().flat_map(|frame| frame.iter().skip(screen * eyes).take(eyes));
            row.map(RgbaImage::height).max().unwrap_or(0) + 1
        })
        .collect();
    let frame_width = eyes as u32 * (width + SHEET_GAP) + 2 * SHEET_GAP;
    let background = image::Rgba([24, 26, 30, 255]);
    let mut sheet = RgbaImage::from_pixel(
        frames.len() as u32 * frame_width + SHEET_GAP,
        heights.iter().sum::<u32>() + 2 * SHEET_GAP,
        background,
    );
    for (f, frame) in frames.iter().enumerate() {
        for (p, image) in frame.iter().enumerate() {
            let (screen, eye) = (p / eyes, p % eyes);
            let x = 2 * SHEET_GAP + f as u32 * frame_width + eye as u32 * (width + SHEET_GAP);
            let row = from_top.iter().position(|&s| s == screen).unwrap_or(screen);
            let y = SHEET_GAP + heights.iter().take(row).sum::<u32>();
            imageops::replace(&mut sheet, image, i64::from(x), i64::from(y));
        }
    }
    sheet
}
