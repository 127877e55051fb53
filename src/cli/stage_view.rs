//! `greenstage stage-view`: the room from outside, in a window of its own or as a picture.

use super::failure::Failure;
use super::picture::{Bodies, contents};
use super::render;
use super::room::{Camera, Room, write_names};
use super::session;
use super::world::World;
use crate::render::{COLOR_FORMAT, FrameContents, Gpu, Offscreen, Overlay, Renderer, Viewport};
use crate::scene::Scene;
use crate::stage::Stage;
use crate::track::Script;
use std::path::{Path, PathBuf};

/// The room from outside: screens, eyes and what they see, head, stylus, bodies, trackers
///
/// In the window dragging turns, the wheel zooms, Escape or closing it quits.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML), or a stage: workbench, workbench-one-sided, cyberstage, desktop, or a stage file
    pub scene_or_stage: PathBuf,
    /// Stage on which a scene is shown; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// A PNG file instead of a window
    #[arg(short, long)]
    pub output: PathBuf,
    /// Where to look from, metres in the room: x,y,z; default: behind the viewer, above and to the right
    #[arg(long, value_parser = place, allow_hyphen_values = true)]
    pub from: Option<[f64; 3]>,
    /// Width and height of the picture or the window: 1280x960
    #[arg(long, value_parser = size, default_value = "1280x960")]
    pub size: [u32; 2],
    /// Moment of the scene's script in the picture, s
    #[arg(long, default_value_t = 0.0)]
    pub time: f64,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples a pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = super::samples)]
    pub samples: u32,
}

fn place(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|word| word.trim().parse().ok()).collect();
    <[f64; 3]>::try_from(numbers)
        .ok()
        .filter(|place| place.iter().all(|x| x.abs() <= 1000.0))
        .ok_or("three numbers of metres up to 1000, as 2.5,1.8,3".into())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides: Vec<u32> = text.split('x').filter_map(|word| word.parse().ok()).collect();
    <[u32; 2]>::try_from(sides)
        .ok()
        .filter(|sides| sides.iter().all(|side| (16..=16384).contains(side)))
        .ok_or("width and height in pixels from 16 to 16384, as 1280x960".into())
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let seen = Seen::load(args)?;
    let camera = match args.from {
        Some(place) => Camera::from(seen.stage(), place.into()),
        None => Camera::of(seen.stage()),
    };
    picture(args, seen, camera, &args.output)
}

/// A scene on its stage, or a stage alone.
enum Seen {
    Scene(Box<World>, Option<Script>),
    Stage(Box<Stage>),
}

impl Seen {
    fn load(args: &Args) -> Result<Seen, Failure> {
        let path = &args.scene_or_stage;
        let is_scene = path.extension().is_some_and(|e| e == "toml") && !super::inspect::is_stage(path)?;
        if !is_scene {
            if let Some(stage) = &args.stage {
                let text = format!("{} is a stage itself: leave --stage {stage} away", path.display());
                return Err(Failure::wrong(text));
            }
            let stage = Stage::find(&path.display().to_string()).map_err(Failure::request)?;
            return Ok(Seen::Stage(Box::new(stage)));
        }
        let scene = super::plan::settled(Scene::load(path)?, false)?;
        let stage = render::stage(&scene, args.stage.as_deref())?;
        let script = render::script(&scene, None)?;
        let file = session::green_file(&scene, args.green.as_deref())?;
        Ok(Seen::Scene(Box::new(World::new(&scene, &file, stage)?), script))
    }

    fn stage(&self) -> &Stage {
        match self {
            Seen::Scene(world, _) => &world.stage,
            Seen::Stage(stage) => stage,
        }
    }
}

fn picture(args: &Args, seen: Seen, camera: Camera, path: &Path) -> Result<(), Failure> {
    let gpu = Gpu::headless().map_err(Failure::work)?;
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, args.samples)?;
    let target = Offscreen::new(&gpu, &renderer, args.size)?;
    let view = camera.view(args.size);
    let viewports = Viewport::full(args.size, view);
    let room = match seen {
        Seen::Stage(stage) => {
            let room = Room::new(&stage, &stage.viewer.room_from_head, &camera.eye());
            renderer.draw(&gpu, &[target.picture(&viewports)], &room.contents(FrameContents::default()))?;
            room
        }
        Seen::Scene(mut world, script) => {
            play(&mut world, script.as_ref(), args.time);
            let mut bodies = Bodies::new(&gpu, &world)?;
            bodies.upload(&gpu, &mut world)?;
            let room = Room::new(&world.stage, &world.room_from_head, &camera.eye());
            let instances = bodies.instances(&world);
            let contents = room.contents(contents(&world, &instances));
            renderer.draw(&gpu, &[target.picture(&viewports)], &contents)?;
            room
        }
    };
    if let Some(view) = &view {
        let mut overlay = Overlay::new(COLOR_FORMAT);
        let sheet =
            overlay.lay_out(args.size, |painter| write_names(painter, painter.clip_rect(), view, &room));
        overlay.draw(&gpu, [(&target.image.view, &sheet)])?;
    }
    render::save(&target.read(&gpu)?.0, path)?;
    super::print(&format!("{}\n", path.display()))
}

/// The script from its beginning to `time_s`, in steps as fine as a hand's.
fn play(world: &mut World, script: Option<&Script>, time_s: f64) {
    let Some(script) = script else {
        world.step(&Default::default());
        return;
    };
    let end_s = time_s.clamp(0.0, script.duration_s);
    let steps = (end_s * 60.0).ceil().max(1.0);
    for k in 0..=steps as u32 {
        let state = script.sample(&world.stage, end_s * f64::from(k) / steps);
        world.step(&state);
    }
}
