//! The windows of a stage: the views of each eye on each screen, overlays, and mouse and keyboard.

use super::bodies::contents;
use super::overlay::{ACQUIRE, FrameSteps, Readings, SensorReading};
use super::overlays::{Overlays, StageFrame};
use super::plate_seats::keep_clear;
use super::view_source::{Screens, ViewSource};
use super::window_layout;
use super::window_layout::WindowFrame;
use crate::interact::PickRay;
use crate::render::Gpu;
use crate::render::window::{AppError, Button, Input, Key, WindowSpec};
use crate::session::Session;
use crate::stage::{Eye, Stage};
use crate::track::MouseInput;
use crate::track::mouse::Button as MouseButton;
use crate::world::StepTimes;

/// Windows that show the screens of a stage.
pub struct ScreenWindows {
    pub overlays: Overlays,
    screens: Screens,
    scale: f64,
    /// Size of each window now.
    sizes: Vec<[u32; 2]>,
    /// Whether the test pattern is shown instead of the scene.
    pattern_alone: bool,
    /// Times of the frame before, for the overlay.
    times: FrameSteps,
}

impl ScreenWindows {
    /// All windows of the stage, at `scale` times their sizes; without one, full size for a single window and for those
    /// of a stage file, else half.
    pub fn new(stage: &Stage, scale: Option<f64>) -> ScreenWindows {
        let layout = stage.layout();
        let is_usual = stage.windows.is_empty();
        let scale = scale.unwrap_or(if is_usual && layout.len() > 1 { 0.5 } else { 1.0 });
        ScreenWindows {
            overlays: Overlays::new(stage, &layout),
            scale,
            sizes: layout.iter().map(|window| window_layout::scaled(window.size, scale)).collect(),
            screens: Screens { layout, swapped: stage.swap_eyes },
            pattern_alone: false,
            times: FrameSteps::default(),
        }
    }

    /// Shows the overlay on the screen that the viewer looks at.
    pub fn with_overlay(mut self, stage: &Stage) -> ScreenWindows {
        self.overlays.panels[stage.faced_screen()] = true;
        self
    }

    /// Shows the test pattern on every screen; of the function keys only F2 (the stage from outside) and F4 (swap the eyes)
    /// act.
    pub fn of_pattern(stage: &Stage, scale: f64) -> ScreenWindows {
        let mut screens = ScreenWindows::new(stage, Some(scale));
        (screens.overlays.pattern, screens.pattern_alone) = (true, true);
        screens
    }

    pub fn specs(&self, stage: &Stage) -> Vec<WindowSpec> {
        window_layout::specs(stage, &self.screens.layout, self.scale)
    }

    pub fn input(&mut self, input: Input, session: &mut Session) {
        if let Input::Key { key: Key::Function(4), pressed: true, .. } = input {
            self.screens.swapped = !self.screens.swapped;
        }
        if self.pattern_alone && matches!(input, Input::Key { key: Key::Function(1 | 3), .. }) {
            return;
        }
        if self.overlays.input(&input, &session.world.assets.stage, &self.screens.layout) {
            return;
        }
        match input {
            Input::Cursor { window, position } => {
                let (stage, position) = (&session.world.assets.stage, position.map(f64::from));
                let (layout, size) = (&self.screens.layout[window], self.sizes[window]);
                if let Some((screen, ndc)) = window_layout::at_cursor(stage, layout, size, position) {
                    session.mouse(MouseInput::Cursor { screen, ndc });
                }
            }
            Input::Button { button, pressed, .. } => {
                let button = match button {
                    Button::Left => MouseButton::Left,
                    Button::Middle => MouseButton::Middle,
                    Button::Right => MouseButton::Right,
                    Button::Other(_) if pressed => return session.take_over(),
                    Button::Other(_) => return,
                };
                session.mouse(MouseInput::Button { button, pressed });
            }
            Input::Wheel { lines, .. } => session.mouse(MouseInput::Wheel { notches: lines.into() }),
            Input::Key { key, pressed, .. } => session.key(key, pressed),
            Input::Focus { focused: false, .. } => session.mouse(MouseInput::FocusLost),
            _ => {}
        }
    }

    pub fn draw(&mut self, frame: &mut WindowFrame<'_>) -> Result<(), AppError> {
        let WindowFrame { presenter, session, bodies, edited, covered, step_s, track_s } = frame;
        self.sizes = presenter.sizes();
        let tiles = match self.pattern_alone {
            true => vec![Vec::new(); self.sizes.len()],
            false => self.screens.tiles(&session.world, &self.sizes),
        };
        let StepTimes { interact_s, deform_s, normals_s } = session.world.frame.times;
        if self.overlays.has_panel() {
            self.times.steps[ACQUIRE] = presenter.waited().as_secs_f64();
            self.overlays.history.push(FrameSteps { whole_s: *step_s, ..self.times });
        }
        let upload_s = bodies.upload(presenter.gpu(), &session.world)?;
        let is_wanted = self.overlays.wants_reports();
        let reports = if is_wanted { session.input.tracker_reports() } else { Vec::new() };
        let effects = session.world.effects.iter_mut().filter(|_| self.overlays.has_panel());
        let devices = effects.flat_map(|effect| effect.readings()).collect();
        let world = &session.world;
        // What the plates tell belongs to the scene's bodies, not to one on which control elements are made.
        let plates = if edited.is_some() { Vec::new() } else { bodies.plates(world) };
        let is_written = !plates.is_empty() || self.overlays.has_panel();
        let clear = if is_written && edited.is_none() { keep_clear(world) } else { Vec::new() };
        let stage_frame = StageFrame {
            stage: &world.assets.stage,
            layout: &self.screens.layout,
            sizes: &self.sizes,
            swapped: self.screens.swapped,
            room_from_head: world.room_from_head,
            reports: &reports,
            plates: &plates,
            clear: &clear,
            covered: (covered.0, &covered.1),
            time_s: *world.graph.get(world.fields.time),
        };
        let (deformation, source) = (bodies.deformation(), session.input.describe());
        let readings = |gpu: &Gpu| Readings {
            device: gpu.adapter_name.clone(),
            deformation,
            source: source.to_owned(),
            warnings: world.warnings.clone(),
            sensors: SensorReading::list(&reports),
            devices,
            ..Readings::take(world)
        };
        let instances = edited.map_or_else(|| bodies.instances(world), |edited| vec![edited]);
        let mut contents = contents(world, &instances);
        if edited.is_some() {
            contents.drawables = [&[]; 2];
        }
        let drawn = self.overlays.draw(*presenter, &stage_frame, tiles, &contents, readings)?;
        let [encode_s, present_s] = [drawn.encode, drawn.present].map(|time| time.as_secs_f64());
        self.times.steps = [*track_s, interact_s, deform_s, normals_s, upload_s, encode_s, 0.0, present_s];
        Ok(())
    }

    /// The ray from the eye through a place of a window.
    pub(super) fn ray(&self, window: usize, position: [f32; 2], session: &Session) -> Option<PickRay> {
        let world = &session.world;
        let (layout, size) = (self.screens.layout.get(window)?, *self.sizes.get(window)?);
        let (screen, ndc) =
            window_layout::at_cursor(&world.assets.stage, layout, size, position.map(f64::from))?;
        let eye = world.assets.stage.viewer.eye_in_room(&world.room_from_head, Eye::Centre);
        let towards = (world.assets.stage.screens.get(screen)?.point(ndc) - eye).try_normalize(1e-9)?;
        Some(PickRay { origin_in_room: eye.cast(), direction_in_room: towards.cast() })
    }
}
