//! `greenstage view`: the online stage in windows; where there is no display, as offscreen pictures.

use super::failure::Failure;
use super::picture::{Bodies, Layout, contents};
use super::render;
use super::session;
use super::world::World;
use crate::render::window::{
    self, AppError, Button, Flow, Input, Key, WindowApp, WindowOptions, WindowSpec, Windows,
};
use crate::render::{Gpu, RenderError, Viewport};
use crate::scene::Scene;
use crate::stage::{Eye, Stage, Stereo};
use crate::track::mouse::{BINDINGS, Button as MouseButton};
use crate::track::{Mouse, MouseInput, Script, TrackerState};
use std::path::PathBuf;
use std::time::Instant;

/// Online stage in windows, or offscreen where there is no display
///
/// The scene's script, where it has one, moves head and stylus until you press a mouse button or a key; then mouse
/// and keyboard do (`greenstage manual view` lists the bindings). Escape or closing a window quits.
#[derive(Debug, clap::Args)]
#[command(after_help = bindings())]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Stage: workbench, workbench-one-sided, cyberstage, desktop, or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// Key frames for head and stylus; default: the scene's
    #[arg(long)]
    pub script: Option<PathBuf>,
    /// A .green file that is only read; default: beside the scene, made anew where it is missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// Samples a pixel, 1 or 4
    #[arg(long, default_value_t = 4, value_parser = super::samples)]
    pub samples: u32,
    /// Size of the windows against the screens' own pixels; default: 1 for a single window, else 0.5
    #[arg(long, value_parser = super::scale)]
    pub scale: Option<f64>,
    /// Present at once instead of waiting for the display's refresh
    #[arg(long)]
    pub no_vsync: bool,
    /// Quit after so many seconds
    #[arg(long, value_parser = super::positive)]
    pub seconds: Option<f64>,
    /// Where the pictures go when there is no display
    #[arg(long, default_value = "out/demo")]
    pub offscreen: PathBuf,
}

impl Args {
    /// The demo: everything at its default.
    pub fn demo(scene: PathBuf) -> Args {
        Args {
            scene,
            stage: None,
            script: None,
            green: None,
            samples: 4,
            scale: None,
            no_vsync: false,
            seconds: None,
            offscreen: "out/demo".into(),
        }
    }
}

fn bindings() -> String {
    let rows: Vec<String> = BINDINGS.iter().map(|(input, what)| format!("  {input:<36} {what}")).collect();
    format!("Mouse and keyboard:\n{}", rows.join("\n"))
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = super::plan::settled(Scene::load(&args.scene)?, false)?;
    let stage = render::stage(&scene, args.stage.as_deref())?;
    let script = render::script(&scene, args.script.as_deref())?;
    let file = session::green_file(&scene, args.green.as_deref())?;
    let mut world = World::new(&scene, &file, stage)?;
    if let Err(reason) = window::find_display() {
        super::print(&format!("{reason}: rendering offscreen to {}\n", args.offscreen.display()))?;
        let frames = if script.is_some() { 20 } else { 1 };
        return render::pictures(&offscreen(args, frames), &mut world, script.as_ref());
    }
    super::print(&format!("{}\n", bindings()))?;
    let panes = panes(&world.stage);
    let specs = windows(&world.stage, &panes, args.scale.unwrap_or(if panes.len() > 1 { 0.5 } else { 1.0 }));
    let mut app = Viewer {
        mouse: Mouse::new(world.stage.clone()),
        world,
        script,
        panes,
        bodies: None,
        started: Instant::now(),
        last: Instant::now(),
        frames: 0,
        round: 0,
        limit_s: args.seconds,
    };
    let options = WindowOptions { samples: args.samples, vsync: !args.no_vsync };
    window::run(&specs, options, &mut app).map_err(Failure::work)?;
    let seconds = app.started.elapsed().as_secs_f64();
    let rate = f64::from(app.frames) / seconds;
    super::print(&format!("{} frames in {seconds:.1} s: {rate:.1} frames/s\n", app.frames))
}

/// The same view as `greenstage render` would make it.
fn offscreen(args: &Args, frames: usize) -> render::Args {
    render::Args {
        scene: args.scene.clone(),
        stage: args.stage.clone(),
        output: args.offscreen.clone(),
        frames,
        script: args.script.clone(),
        green: args.green.clone(),
        samples: args.samples,
        scale: args.scale.unwrap_or(1.0),
        layout: Layout::Eyes,
    }
}

/// A window shows one screen for one eye, or for both side by side.
struct Pane {
    screen: usize,
    eyes: Vec<Eye>,
}

fn panes(stage: &Stage) -> Vec<Pane> {
    let of = |screen: usize| match stage.stereo {
        Stereo::Separate => stage.eyes().iter().map(|eye| Pane { screen, eyes: vec![*eye] }).collect(),
        Stereo::SideBySide | Stereo::Mono => vec![Pane { screen, eyes: stage.eyes().to_vec() }],
    };
    (0..stage.screens.len()).flat_map(of).collect()
}

/// Several windows are laid out side by side: a column per eye, the screens from the highest to the lowest.
fn windows(stage: &Stage, panes: &[Pane], scale: f64) -> Vec<WindowSpec> {
    let from_top = stage.screens_from_top();
    let spec = |pane: &Pane| {
        let column = u32::from(pane.eyes == [Eye::Right]);
        let row = from_top.iter().position(|&screen| screen == pane.screen).unwrap_or(0);
        let screen = &stage.screens[pane.screen];
        let size = screen.pixels.map(|pixels| ((f64::from(pixels) * scale).round() as u32).max(1));
        let eyes: Vec<&str> = pane.eyes.iter().map(|eye| eye.name()).collect();
        WindowSpec {
            title: format!("greenstage – {} – {} – {}", stage.name, screen.name, eyes.join(" and ")),
            position: (panes.len() > 1).then_some([(column * size[0]) as i32, (row as u32 * size[1]) as i32]),
            size: [size[0] * pane.eyes.len() as u32, size[1]],
            decorated: true,
            fullscreen: false,
        }
    };
    panes.iter().map(spec).collect()
}

struct Viewer {
    world: World,
    /// Moves head and stylus until the user presses a mouse button or a key.
    script: Option<Script>,
    mouse: Mouse,
    panes: Vec<Pane>,
    bodies: Option<Bodies>,
    started: Instant,
    last: Instant,
    frames: u32,
    /// How often the script has begun anew.
    round: u32,
    limit_s: Option<f64>,
}

impl WindowApp for Viewer {
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError> {
        eprintln!("{}: drawing on {}", self.world.stage.name, gpu.describe());
        self.bodies = Some(Bodies::new(gpu, &self.world)?);
        (self.started, self.last) = (Instant::now(), Instant::now());
        Ok(())
    }

    fn input(&mut self, input: Input) {
        let takes_over =
            matches!(input, Input::Button { pressed: true, .. } | Input::Key { pressed: true, .. });
        if takes_over && self.script.take().is_some() {
            self.world.let_go();
        }
        match input {
            Input::Cursor { window, position } => {
                let pane = &self.panes[window];
                let [x, y] = position.map(f64::from);
                // Side by side, each half of the window is the whole screen.
                let x = x * pane.eyes.len() as f64;
                let x = if (0.0..pane.eyes.len() as f64).contains(&x) { x.fract() } else { x };
                let ndc = [2.0 * x - 1.0, 1.0 - 2.0 * y];
                self.mouse.handle(MouseInput::Cursor { screen: pane.screen, ndc });
            }
            Input::Button { button: Button::Left, pressed, .. } => {
                self.mouse.handle(MouseInput::Button { button: MouseButton::Left, pressed });
            }
            Input::Button { button: Button::Right, pressed, .. } => {
                self.mouse.handle(MouseInput::Button { button: MouseButton::Right, pressed });
            }
            Input::Wheel { lines, .. } => self.mouse.handle(MouseInput::Wheel { notches: lines.into() }),
            Input::Key { key, pressed, .. } => {
                let mut typed = [0; 4];
                let name = match key {
                    Key::Char(c) => c.encode_utf8(&mut typed),
                    Key::Left => "ArrowLeft",
                    Key::Right => "ArrowRight",
                    Key::Up => "ArrowUp",
                    Key::Down => "ArrowDown",
                    Key::Control => "Control",
                    _ => return,
                };
                self.mouse.handle(MouseInput::Key { name, pressed });
            }
            Input::Focus { focused: false, .. } => self.mouse.handle(MouseInput::FocusLost),
            _ => {}
        }
    }

    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError> {
        let step_s = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        let state = self.state(step_s);
        self.world.step(&state);
        self.mouse.hit_distance_m = self.world.hit_distance_m();
        let viewports: Vec<Vec<Viewport>> = self.viewports(windows);
        if let Some(bodies) = &mut self.bodies {
            bodies.upload(&windows.gpu, &mut self.world)?;
            let instances = bodies.instances(&self.world);
            windows.draw(&viewports, &contents(&self.world, &instances))?;
        }
        self.frames += 1;
        let is_over = self.limit_s.is_some_and(|limit_s| self.started.elapsed().as_secs_f64() >= limit_s);
        Ok(if is_over { Flow::Quit } else { Flow::Continue })
    }
}

impl Viewer {
    fn state(&mut self, step_s: f64) -> TrackerState {
        let time_s = self.started.elapsed().as_secs_f64();
        match &self.script {
            Some(script) => {
                // A pause of a second between two rounds, each of which starts at rest.
                let round_s = script.duration_s + 1.0;
                let round = (time_s / round_s) as u32;
                if std::mem::replace(&mut self.round, round) != round {
                    self.world.reset();
                }
                script.sample(&self.world.stage, time_s % round_s)
            }
            None => {
                self.mouse.advance(step_s);
                self.mouse.state(time_s)
            }
        }
    }

    fn viewports(&mut self, windows: &Windows) -> Vec<Vec<Viewport>> {
        let sizes: Vec<[u32; 2]> = windows.sizes().collect();
        let mut viewports = Vec::new();
        for (pane, [width, height]) in self.panes.iter().zip(sizes) {
            let part = width / pane.eyes.len() as u32;
            let mut row = Vec::new();
            for (i, eye) in pane.eyes.iter().enumerate().filter(|_| part > 0) {
                let view = self.world.view(pane.screen, *eye);
                row.push(Viewport { rect: [i as u32 * part, 0, part, height], view });
            }
            viewports.push(row);
        }
        viewports
    }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Failure {
        match error {
            RenderError::PictureSize { .. } | RenderError::BufferSize { .. } => Failure::request(error),
            _ => Failure::work(error),
        }
    }
}
