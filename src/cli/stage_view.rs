//! `greenstage stage-view`: the room from outside, in a window of its own or as a picture.

use super::device;
use super::failure::Failure;
use super::picture::{Bodies, contents};
use super::render;
use super::room::{Camera, Orbit, Room, write_names};
use super::session;
use super::world::{World, shape};
use crate::base::output;
use crate::interact::Action;
use crate::render::window::{self, AppError, Flow, Input, WindowApp, WindowOptions, WindowSpec, Windows};
use crate::render::{
    COLOR_FORMAT, EyePicture, FrameContents, Gpu, Offscreen, Overlay, Renderer, Show, StylusShape, Tile,
    Viewport,
};
use crate::scene::Scene;
use crate::stage::Stage;
use crate::track::device::now_s;
use crate::track::tracker_set::TrackerReport;
use crate::track::{Script, Signal, StylusState, TrackerSet, TrackerState, usable};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The room from outside: screens, eyes and what they see, head, stylus, bodies, trackers
///
/// In a window the stage's trackers move head and styli, and every sensor that they speak of is shown where the
/// calibration puts it; until one of them speaks, the scene's script does. Dragging turns, the wheel zooms, Escape or closing it quits.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML), or a stage: a built-in one (workbench, cyberstage, cave6, …), or a stage file
    pub scene_or_stage: PathBuf,
    /// Stage on which a scene is shown; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// A PNG file instead of a window; overwrites a PNG file, and nothing else
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Where to look from, metres in the room: x,y,z; default: behind the viewer, above and to the right
    #[arg(long, value_parser = place, allow_hyphen_values = true)]
    pub from: Option<[f64; 3]>,
    /// Width and height of the picture or the window: 1280x960
    #[arg(long, value_parser = size, default_value = "1280x960")]
    pub size: [u32; 2],
    /// Moment of the scene's script in the picture, s
    #[arg(long, default_value_t = 0.0)]
    pub time: f64,
    /// Close the window after so many seconds
    #[arg(long, value_parser = super::positive)]
    pub seconds: Option<f64>,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples a pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = super::samples)]
    pub samples: u32,
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
        output::try_path(path, &render::PNG, &inputs)?;
    }
    let seen = Seen::load(args)?;
    let camera = match args.from {
        Some(place) => Camera::from(seen.stage(), place.into()),
        None => Camera::of(seen.stage()),
    };
    match &args.output {
        Some(path) => picture(args, seen, camera, path),
        None => show(args, seen, camera),
    }
}

/// The room in a window, live: the stage's trackers move head and styli, else the scene's script.
fn show(args: &Args, seen: Seen, camera: Camera) -> Result<(), Failure> {
    let rig = super::track::start(seen.stage(), None)?;
    let spec = WindowSpec {
        title: format!("greenstage – {} – room", seen.stage().name),
        monitor: None,
        position: None,
        size: args.size,
        fills: false,
        decorated: true,
        fullscreen: false,
        unmanaged: false,
    };
    let mut app = Outside {
        rig,
        seen,
        bodies: None,
        orbit: Orbit::new(camera),
        overlay: None,
        started: Instant::now(),
        round: 0,
        limit_s: args.seconds,
    };
    let options = WindowOptions { samples: args.samples, vsync: true };
    window::run(&[spec], options, &mut app).map_err(Failure::work)
}

struct Outside {
    rig: Option<TrackerSet>,
    seen: Seen,
    bodies: Option<Bodies>,
    orbit: Orbit,
    overlay: Option<Overlay>,
    started: Instant,
    /// How often the script has begun anew.
    round: u32,
    limit_s: Option<f64>,
}

impl WindowApp for Outside {
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError> {
        if let Seen::Scene(world, _) = &mut self.seen {
            self.bodies = Some(Bodies::new(gpu, world, device::Args::default())?);
        }
        self.started = Instant::now();
        Ok(())
    }

    fn input(&mut self, input: Input) {
        self.orbit.handle(&input);
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        let time_s = self.started.elapsed().as_secs_f64();
        let reports = self.seen.step(self.rig.as_mut(), time_s, &mut self.round);
        if let (Seen::Scene(world, _), Some(bodies)) = (&mut self.seen, &mut self.bodies) {
            bodies.upload(&windows.gpu, world)?;
        }
        let mut room = self.seen.room(&self.orbit.camera);
        room.add_sensors(&reports);
        let styli = self.seen.styli();
        let instances = match (&self.bodies, &self.seen) {
            (Some(bodies), Seen::Scene(world, _)) => bodies.instances(world),
            _ => Vec::new(),
        };
        let inner = match &self.seen {
            Seen::Scene(world, _) => contents(world, &instances),
            Seen::Stage(..) => FrameContents { styli: &styli, ..FrameContents::default() },
        };
        let contents = room.contents(inner);
        let size = windows.sizes().next().unwrap_or([0, 0]);
        let view = self.orbit.camera.view(f64::from(size[0]) / f64::from(size[1].max(1)));
        let tile = Tile { rect: [0, 0, size[0], size[1]], show: Show::One(Viewport::full(size, view)[0]) };
        let tiles = if size.contains(&0) { vec![] } else { vec![tile] };
        let overlay = &mut self.overlay;
        let mut paint = |gpu: &Gpu, picture: &EyePicture<'_>| {
            let overlay = overlay.get_or_insert_with(|| Overlay::new(picture.format));
            let sheet = overlay.lay_out(picture.texture_size, |painter| {
                view.iter().for_each(|view| write_names(painter, painter.clip_rect(), view, &room));
            });
            overlay.draw(gpu, [(picture.texture, &sheet)])
        };
        windows.draw(&[tiles], |_| &contents, Some(&mut paint))?;
        let is_over = self.limit_s.is_some_and(|limit_s| time_s >= limit_s);
        Ok(if is_over { Flow::Quit } else { Flow::Continue })
    }
}

/// One moment of a script that begins anew a second after its end.
fn scripted(world: &mut World, script: &Script, time_s: f64, round: &mut u32) -> TrackerState {
    let round_s = script.duration_s + 1.0;
    let now = (time_s / round_s) as u32;
    if std::mem::replace(round, now) != now {
        world.act(Action::Reset);
    }
    script.sample(&world.stage, time_s % round_s)
}

/// A scene on its stage, or a stage alone with who is in it.
enum Seen {
    Scene(Box<World>, Option<Script>),
    Stage(Box<Stage>, TrackerState),
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
            let stage = Stage::find(&path.display().to_string())
                .and_then(crate::track::checked)
                .map_err(Failure::request)?;
            return Ok(Seen::Stage(Box::new(stage), TrackerState::default()));
        }
        let scene = Scene::load(path)?;
        session::try_green(&scene, args.green.as_deref())?;
        let scene = super::plan::settled(scene, false, false)?;
        let stage = render::stage(&scene, args.stage.as_deref())?;
        let script = render::script(&scene, None)?;
        let file = session::green_file(&scene, args.green.as_deref())?;
        Ok(Seen::Scene(Box::new(World::new(&scene, &file, stage)?), script))
    }

    fn stage(&self) -> &Stage {
        match self {
            Seen::Scene(world, _) => &world.stage,
            Seen::Stage(stage, _) => stage,
        }
    }

    /// Moves everything to what the trackers say now, as long as none has spoken to what the script does; tells of all
    /// sensors.
    fn step(&mut self, rig: Option<&mut TrackerSet>, time_s: f64, round: &mut u32) -> Vec<TrackerReport> {
        let mut state = match self {
            Seen::Scene(world, Some(script)) => scripted(world, script, time_s, round),
            _ => TrackerState { time_s, ..TrackerState::default() },
        };
        let mut reports = Vec::new();
        if let Some(rig) = rig {
            state = super::track::merge(rig, state);
            reports = rig.report(now_s());
            if let Seen::Scene(world, script) = self
                && rig.is_speaking()
                && script.take().is_some()
            {
                world.act(Action::LetGo);
            }
        }
        match self {
            Seen::Scene(world, _) => {
                world.step(&state);
            }
            Seen::Stage(_, last) => *last = state,
        }
        reports
    }

    /// The styli of a stage without a scene, their rays as long as they are where nothing is hit.
    fn styli(&self) -> Vec<StylusShape> {
        let Seen::Stage(stage, state) = self else { return Vec::new() };
        let seen = state.styli.iter().filter(|stylus| !matches!(stylus.signal, Signal::Lost { .. }));
        let shape = |stylus: &StylusState| {
            Some(shape(stylus, usable(&stylus.room_from_stylus)?, None, None, &stage.workspace))
        };
        seen.filter_map(shape).collect()
    }

    fn room(&self, camera: &Camera) -> Room {
        let room_from_head = match self {
            Seen::Scene(world, _) => world.room_from_head,
            Seen::Stage(stage, state) => {
                state.head.as_ref().and_then(usable).unwrap_or(stage.viewer.room_from_head)
            }
        };
        Room::new(self.stage(), &room_from_head, &camera.eye())
    }
}

fn picture(args: &Args, mut seen: Seen, camera: Camera, path: &Path) -> Result<(), Failure> {
    let gpu = Gpu::headless().map_err(Failure::work)?;
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, args.samples)?;
    let target = Offscreen::new(&gpu, &renderer, args.size)?;
    let view = camera.view(f64::from(args.size[0]) / f64::from(args.size[1]));
    let viewports = Viewport::full(args.size, view);
    if let Seen::Scene(world, script) = &mut seen {
        play(world, script.as_ref(), args.time);
    }
    let room = seen.room(&camera);
    match &mut seen {
        Seen::Stage(..) => {
            renderer.draw(&gpu, &[target.picture(&viewports)], &room.contents(FrameContents::default()))?;
        }
        Seen::Scene(world, _) => {
            let mut bodies = Bodies::new(&gpu, world, device::Args::default())?;
            bodies.upload(&gpu, world)?;
            let instances = bodies.instances(world);
            let contents = room.contents(contents(world, &instances));
            renderer.draw(&gpu, &[target.picture(&viewports)], &contents)?;
        }
    }
    let mut overlay = Overlay::new(COLOR_FORMAT);
    let sheet = overlay.lay_out(args.size, |painter| {
        view.iter().for_each(|view| write_names(painter, painter.clip_rect(), view, &room));
    });
    overlay.draw(&gpu, [(&target.image.view, &sheet)])?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::BUILT_IN;
    use crate::track::FakeSource;
    use nalgebra::{Isometry3, Point3};

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

    const TRACKING: &str = "
[tracker.lab]
dtrack = \"0\"
room_from_tracker = { position = [0.0, 1.0, 0.0] }
[sensor.head]
tracker = \"lab\"
id = 0
[sensor.wand]
tracker = \"lab\"
id = 1
[stylus.right]
sensor = \"wand\"
";

    #[test]
    fn an_installer_sees_head_stylus_and_every_sensor_where_the_calibration_puts_them() {
        let text = BUILT_IN[0].1.replacen("[viewer]", "[viewer]\nhead = \"head\"", 1) + TRACKING;
        let stage = Stage::parse(&text, Path::new("lab.toml")).unwrap();
        let puppet = FakeSource::default();
        let mut rig = TrackerSet::with_sources(&stage.tracking, vec![Box::new(puppet.clone())], now_s());
        let viewer = stage.viewer.room_from_head;
        let mut seen = Seen::Stage(Box::new(stage), TrackerState::default());
        let drawn = |seen: &mut Seen, rig: &mut TrackerSet| {
            let reports = seen.step(Some(rig), 0.0, &mut 0);
            let mut room = seen.room(&Camera::of(seen.stage()));
            room.add_sensors(&reports);
            let said = |room: &Room, of: &str| {
                room.labels.iter().find(|label| label.text.starts_with(of)).map(|label| label.place)
            };
            (seen.styli(), said(&room, "head"), said(&room, "wand"), said(&room, "7 of lab"), room)
        };
        let (styli, head, wand, seventh, room) = drawn(&mut seen, &mut rig);
        assert!(styli.is_empty() && [head, wand, seventh] == [None; 3], "nobody has spoken");
        let eyes = |room: &Room| room.balls.iter().filter(|ball| ball.radius_m == 0.016).count();
        assert_eq!(eyes(&room), 2);
        for (sensor, place) in [(0, [0.2, 0.6, 1.2]), (1, [0.3, 0.2, 0.5]), (7, [1.0, 0.0, 0.0])] {
            let [x, y, z] = place;
            puppet.change(|state| state.take_pose(sensor, Isometry3::translation(x, y, z), None, 1.0));
        }
        let (styli, head, wand, seventh, _) = drawn(&mut seen, &mut rig);
        let off = |found: Option<Point3<f64>>, x: f64, y: f64, z: f64| {
            (found.unwrap() - Point3::new(x, y, z)).norm()
        };
        assert!(off(head, 0.2, 1.6, 1.2) < 1e-6 && off(wand, 0.3, 1.2, 0.5) < 1e-6);
        assert!(off(seventh, 1.0, 1.0, 0.0) < 1e-6, "one that the stage does not name");
        let tip = styli[0].room_from_stylus.fixed_view::<3, 1>(0, 3).into_owned();
        assert!((tip - nalgebra::Vector3::new(0.3, 1.2, 0.5)).norm() < 1e-6, "{tip}");
        let Seen::Stage(_, state) = &seen else { panic!("a stage") };
        assert!(state.head.is_some_and(|head| (head.translation.vector.cast() - viewer.translation.vector).norm() > 0.1));
    }
}
