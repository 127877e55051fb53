//! `greenstage view`: the online stage in windows; where there is no display, as offscreen pictures.

use super::aids::{Aids, Staged};
use super::device;
use super::failure::Failure;
use super::feel::{self, Feel};
use super::keys;
use super::overlay::{ACQUIRE, FrameTimes, Readings, SensorReading};
use super::panes;
use super::picture::{Bodies, contents};
use super::playback;
use super::recording::{Frame, Recorder, Replay};
use super::render::{self, Show};
use super::world::{StepTimes, World};
use crate::base::notice::notice;
use crate::interact::Action;
use crate::render::window::{self, AppError, Button, Flow, Input, Key, WindowApp, WindowOptions, Windows};
use crate::render::{Gpu, Tile};
use crate::scene::Scene;
use crate::stage::Window;
use crate::track::device::now_s;
use crate::track::mouse::Button as MouseButton;
use crate::track::{Mouse, MouseInput, Script, TrackerSet, TrackerState};
use std::path::PathBuf;
use std::time::Instant;

/// Online stage in windows, or offscreen where there is no display
///
/// The stage's trackers move head and styli; until one of them speaks, the scene's script does, where it has one, until
/// you press a mouse button or a key; then mouse and keyboard do (`greenstage manual view` lists the bindings). Escape or closing a window quits.
#[derive(Debug, clap::Args)]
#[command(after_help = keys::bindings())]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// Key frames for head and stylus; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// Write the session into this file, for --replay; overwrites a recording, and nothing else
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// A session recorded by --record: its poses, buttons and commands instead of yours, on its stage
    #[arg(long, conflicts_with_all = ["script", "record"])]
    pub replay: Option<PathBuf>,
    /// No window and no graphics device: plays the recording, or the script, as fast as it goes; status 1 where a frame
    /// comes to another state than was recorded
    #[arg(long)]
    pub check: bool,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples a pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = super::samples)]
    pub samples: u32,
    /// Size of the windows against the screens' own pixels; default: 1 for a single window and where the stage file has
    /// windows of its own, else 0.5
    #[arg(long, value_parser = super::scale)]
    pub scale: Option<f64>,
    /// Present at once instead of waiting for the display's refresh
    #[arg(long)]
    pub no_vsync: bool,
    /// Show the overlay from the beginning, on the screen that the viewer looks at
    #[arg(long)]
    pub overlay: bool,
    /// Quit after so many seconds
    #[arg(long, value_parser = super::positive)]
    pub seconds: Option<f64>,
    /// Where the pictures go when there is no display; overwrites PNG files of their names, and nothing else
    #[arg(long, default_value = "out/demo")]
    pub offscreen: PathBuf,
    #[command(flatten)]
    pub device: device::Args,
}

impl Args {
    /// The demo: everything at its default.
    pub fn demo(scene: PathBuf) -> Args {
        Args {
            scene,
            stage: None,
            script: None,
            record: None,
            replay: None,
            check: false,
            green: None,
            samples: 4,
            scale: None,
            no_vsync: false,
            overlay: false,
            seconds: None,
            offscreen: "out/demo".into(),
            device: device::Args::default(),
        }
    }
}

/// Pictures of a script or a recording where there is no display.
const OFFSCREEN: usize = 20;

pub fn run(args: &Args) -> Result<(), Failure> {
    let device = args.device.for_session(args.record.is_some() || args.replay.is_some())?;
    let display = window::find_display();
    let scene = Scene::load(&args.scene)?;
    render::try_outputs(&render::Args::of_view(args, OFFSCREEN), &scene, display.is_err() && !args.check)?;
    let scene = super::plan::settled(scene, false, false)?;
    let script = render::script(&scene, args.script.as_deref())?;
    let mut show = Show::new(&scene, args.stage.as_deref(), args.green.as_deref(), args.replay.as_deref())?;
    let mut recorder = show.recorder(&scene, args.record.as_deref())?;
    if args.check {
        return playback::check(&mut show, script.as_ref(), recorder.as_mut());
    }
    if let Err(reason) = display {
        super::print(&format!("{reason}: rendering offscreen to {}\n", args.offscreen.display()))?;
        let frames = if script.is_some() || args.replay.is_some() { OFFSCREEN } else { 1 };
        return render::pictures(
            &render::Args::of_view(args, frames),
            &mut show,
            script.as_ref(),
            recorder.as_mut(),
        );
    }
    // A recording has its own head and hands.
    let is_live = show.replay.is_none();
    if is_live {
        super::print(&format!("{}\n", keys::bindings()))?;
    }
    let mut feel = if is_live { Feel::start(&scene, &show.file, &show.world)? } else { None };
    let rig = if is_live { super::track::start(&show.world.stage, feel.as_mut())? } else { None };
    let world = show.world;
    let layout = world.stage.layout();
    let is_usual = world.stage.windows.is_empty();
    let scale = args.scale.unwrap_or(if is_usual && layout.len() > 1 { 0.5 } else { 1.0 });
    let specs = panes::specs(&world.stage, &layout, scale);
    let mut aids = Aids::new(&world.stage, &layout);
    if args.overlay {
        aids.panels[world.stage.faced_screen()] = true;
    }
    let swapped = world.stage.swap_eyes;
    let mut app = Viewer {
        feel,
        aids,
        times: FrameTimes::default(),
        warnings: Vec::new(),
        mouse: Mouse::new(world.stage.clone()),
        world,
        script,
        replay: show.replay.take(),
        next: None,
        first_s: None,
        recorder,
        failure: None,
        sizes: specs.iter().map(|spec| spec.size).collect(),
        layout,
        swapped,
        bodies: None,
        started: Instant::now(),
        last: Instant::now(),
        frames: 0,
        round: 0,
        limit_s: args.seconds,
        device,
        rig,
    };
    let options = WindowOptions { samples: args.samples, vsync: !args.no_vsync };
    window::run(&specs, options, &mut app).map_err(Failure::work)?;
    if let Some(failure) = app.failure {
        return Err(failure);
    }
    let lasted_s = app.started.elapsed().as_secs_f64();
    let rate = f64::from(app.frames) / lasted_s;
    super::print(&app.feel.as_mut().map(Feel::summary).unwrap_or_default())?;
    super::print(&format!("{} frames in {lasted_s:.1} s: {rate:.1} frames/s\n", app.frames))?;
    render::report(app.replay.as_ref(), app.recorder.as_mut())
}

struct Viewer {
    world: World,
    /// Force-feedback devices, where the stage has some and a body asks for it.
    feel: Option<Feel>,
    /// Moves head and stylus until the user presses a mouse button or a key.
    script: Option<Script>,
    /// Moves everything instead of the user, and its next frame.
    replay: Option<Replay>,
    next: Option<Frame>,
    /// When its first frame was.
    first_s: Option<f64>,
    recorder: Option<Recorder>,
    failure: Option<Failure>,
    mouse: Mouse,
    layout: Vec<Window>,
    /// Of each window, now.
    sizes: Vec<[u32; 2]>,
    /// Each eye is shown what the other should see.
    swapped: bool,
    aids: Aids,
    /// Of the frame before, for the overlay.
    times: FrameTimes,
    /// The world's, with their seconds since the start: a script's own time begins anew with every round.
    warnings: Vec<(f64, String)>,
    bodies: Option<Bodies>,
    started: Instant,
    last: Instant,
    frames: u32,
    /// How often the script has begun anew.
    round: u32,
    limit_s: Option<f64>,
    device: device::Args,
    /// What follows head and hands, where the stage names something.
    rig: Option<TrackerSet>,
}

impl WindowApp for Viewer {
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError> {
        notice!("{}: drawing on {}", self.world.stage.name, gpu.describe());
        self.bodies = Some(Bodies::new(gpu, &mut self.world, self.device)?);
        (self.started, self.last) = (Instant::now(), Instant::now());
        Ok(())
    }

    fn input(&mut self, input: Input) {
        if self.aids.input(&input, &self.world.stage, &self.layout) {
            return;
        }
        if self.replay.is_some() && !matches!(input, Input::Key { key: Key::Function(_), .. }) {
            return;
        }
        let takes_over = match input {
            Input::Button { pressed, .. } => pressed,
            Input::Key { key: Key::Function(_) | Key::Shift | Key::Control | Key::Alt, .. } => false,
            Input::Key { pressed, .. } => pressed,
            _ => false,
        };
        if takes_over && self.script.take().is_some() {
            self.world.act(Action::LetGo);
        }
        match input {
            Input::Cursor { window, position } => {
                let position = position.map(f64::from);
                let stage = &self.world.stage;
                let under = panes::at_cursor(stage, &self.layout[window], self.sizes[window], position);
                if let Some((screen, ndc)) = under {
                    self.mouse.handle(MouseInput::Cursor { screen, ndc });
                }
            }
            Input::Key { key: Key::Function(4), pressed: true, .. } => self.swapped = !self.swapped,
            Input::Button { button, pressed, .. } => {
                let button = match button {
                    Button::Left => MouseButton::Left,
                    Button::Middle => MouseButton::Middle,
                    Button::Right => MouseButton::Right,
                    Button::Other(_) => return,
                };
                self.mouse.handle(MouseInput::Button { button, pressed });
            }
            Input::Wheel { lines, .. } if self.mouse.control && !self.mouse.is_grabbing() => {
                self.world.act(keys::scale(lines));
            }
            Input::Wheel { lines, .. } => self.mouse.handle(MouseInput::Wheel { notches: lines.into() }),
            Input::Key { key, pressed, .. } => {
                let command = keys::action(key, self.mouse.control, &self.world).filter(|_| pressed);
                if let Some(action) = command {
                    self.world.act(action);
                }
                let mut typed = [0; 4];
                let Some(name) = keys::name(key, &mut typed) else { return };
                self.mouse.handle(MouseInput::Key { name, pressed });
            }
            Input::Focus { focused: false, .. } => self.mouse.handle(MouseInput::FocusLost),
            _ => {}
        }
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        let step_s = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        if self.frames == 0 {
            self.device.multiview.apply(&windows.gpu, &mut windows.renderer)?;
        }
        match self.advance(step_s) {
            Ok(Flow::Continue) => {}
            Ok(Flow::Quit) => return Ok(Flow::Quit),
            Err(failure) => {
                self.failure = Some(failure);
                return Ok(Flow::Quit);
            }
        }
        let StepTimes { interact_s, deform_s, normals_s } = self.world.times;
        let track_s = (self.last.elapsed().as_secs_f64() - interact_s - deform_s - normals_s).max(0.0);
        self.mouse.hit_distance_m = self.world.hit_distance_m();
        let tiles = self.tiles(windows);
        self.note_warnings();
        if self.aids.has_panel() {
            self.times.steps[ACQUIRE] = windows.waited.as_secs_f64();
            self.aids.history.push(FrameTimes { whole_s: step_s, ..self.times });
        }
        if let Some(bodies) = &mut self.bodies {
            let upload_s = bodies.upload(&windows.gpu, &mut self.world)?;
            let instances = bodies.instances(&self.world);
            let reports = self.rig.as_mut().filter(|_| self.aids.wants_reports());
            let reports = reports.map(|rig| rig.report(now_s())).unwrap_or_default();
            let staged = Staged {
                stage: &self.world.stage,
                layout: &self.layout,
                sizes: &self.sizes,
                swapped: self.swapped,
                room_from_head: self.world.room_from_head,
                reports: &reports,
            };
            let deformation = bodies.deformation();
            let source = match (&self.replay, &self.script) {
                (Some(_), _) => "moved by a recording",
                (None, Some(_)) => "moved by the script",
                (None, None) => super::track::mover(self.rig.as_ref()),
            };
            let felt = self.feel.as_mut().filter(|_| self.aids.has_panel());
            let felt = felt.map(Feel::readings).unwrap_or_default();
            let readings = |gpu: &Gpu| Readings {
                device: gpu.adapter_name.clone(),
                deformation: deformation.clone(),
                source: source.to_owned(),
                warnings: self.warnings.clone(),
                sensors: SensorReading::of(&reports),
                felt,
                ..Readings::of(&self.world)
            };
            let contents = contents(&self.world, &instances);
            let drawn = self.aids.draw(windows, &staged, tiles, &contents, readings)?;
            let [encode_s, present_s] = [drawn.encode, drawn.present].map(|time| time.as_secs_f64());
            self.times.steps = [track_s, interact_s, deform_s, normals_s, upload_s, encode_s, 0.0, present_s];
        }
        self.frames += 1;
        let is_over = self.limit_s.is_some_and(|limit_s| self.started.elapsed().as_secs_f64() >= limit_s);
        Ok(if is_over { Flow::Quit } else { Flow::Continue })
    }
}

impl Viewer {
    /// The mechanics of a frame: the recording's, or what mouse or script say.
    fn advance(&mut self, step_s: f64) -> Result<Flow, Failure> {
        if self.replay.is_some() {
            let is_over = self.replay_until(self.started.elapsed().as_secs_f64())?;
            return Ok(if is_over { Flow::Quit } else { Flow::Continue });
        }
        if let Some(rig) = &mut self.rig {
            self.mouse.tracked_head = rig.state(now_s()).head.map(|head| head.cast());
        }
        let mut state = self.state(step_s);
        if let Some(rig) = &mut self.rig {
            state = super::track::merge(rig, state);
            if rig.is_speaking() && self.script.take().is_some() {
                self.world.act(Action::LetGo);
            }
        }
        feel::step(self.feel.as_mut(), &mut self.world, &mut state);
        if let Some(recorder) = &mut self.recorder {
            recorder.frame(&mut self.world, &state)?;
        }
        Ok(Flow::Continue)
    }

    /// Plays all frames of the recording up to `time_s` after its first; true when there are no more.
    fn replay_until(&mut self, time_s: f64) -> Result<bool, Failure> {
        let Some(replay) = &mut self.replay else { return Ok(false) };
        loop {
            if self.next.is_none() {
                self.next = replay.next_frame()?;
            }
            let Some(frame) = &self.next else { return Ok(true) };
            let first_s = *self.first_s.get_or_insert(frame.state.time_s);
            if frame.state.time_s - first_s > time_s {
                return Ok(false);
            }
            if let Some(frame) = self.next.take() {
                replay.play(&mut self.world, frame);
            }
        }
    }

    fn state(&mut self, step_s: f64) -> TrackerState {
        let time_s = self.started.elapsed().as_secs_f64();
        match &self.script {
            Some(script) => {
                // A pause of a second between two rounds, each of which starts at rest.
                let round_s = script.duration_s + 1.0;
                let round = (time_s / round_s) as u32;
                if std::mem::replace(&mut self.round, round) != round {
                    self.world.act(Action::Reset);
                }
                script.sample(&self.world.stage, time_s % round_s)
            }
            None => {
                self.mouse.advance(step_s);
                self.mouse.state(time_s)
            }
        }
    }

    /// Takes over what the world has warned of since the last frame.
    fn note_warnings(&mut self) {
        let time_s = self.started.elapsed().as_secs_f64();
        let new = self.world.warnings.iter().skip(self.warnings.len());
        self.warnings.extend(new.map(|(_, text)| (time_s, text.clone())));
    }

    fn tiles(&mut self, windows: &Windows) -> Vec<Vec<Tile>> {
        self.sizes = windows.sizes().collect();
        let of =
            |(window, size): (&Window, &[u32; 2])| panes::tiles(&mut self.world, window, *size, self.swapped);
        self.layout.iter().zip(&self.sizes).map(of).collect()
    }
}
