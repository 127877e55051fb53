//! Mouse and keyboard as head and stylus, for a desktop without trackers.
//!
//! In: events in no particular window system's terms (cursor on a screen, buttons, wheel, keys by their W3C names). Out: a
//! [`TrackerState`].
//!
//! | input | what it does |
//! |---|---|
//! | cursor | aims: the stylus' ray runs from midway between the eyes through the cursor |
//! | left button | grabs what the ray hits, until released |
//! | … and moved | carries it parallel to the screen, under the cursor |
//! | … and wheel | carries it away from the eye or towards it |
//! | … with right button or Ctrl, and moved | turns it about the grab point, across the screen and up |
//! | … with right button or Ctrl, and wheel | turns it about the screen's normal |
//! | … with Shift | the stylus' second button: the wheel scales it |
//! | middle button, and moved | the second button with nothing in the hand: turns the scene about the workspace's centre |
//! | … with Shift | carries the scene parallel to the screen |
//! | … and wheel | carries the scene away from the eye or towards it |
//! | W A S D, arrow keys | move the head forward, left, back, right |
//! | Q, E | move the head down, up |
//! | R | puts the head back where the stage has it |

use super::state::{StylusState, TrackerState};
use crate::stage::{Eye, MIN_EYE_DISTANCE_M, Stage, rotation_towards};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

/// The bindings, as `--help` and the window's overlay show them.
pub const BINDINGS: &[(&str, &str)] = &[
    ("left button", "grab what the cursor points at; moving carries it parallel to the screen"),
    ("wheel while grabbing", "carry it away from the eye or towards it"),
    ("right button or Ctrl while grabbing", "moving turns it, the wheel twists it about the screen's normal"),
    ("Shift and wheel while grabbing", "scale it"),
    ("F, T, G", "what is held moves freely, is moved only, is turned only"),
    ("X, Y, Z", "along and about that axis of the body; again: of the element; again: any"),
    ("Ctrl+Z, Ctrl+Y", "undo, redo"),
    ("Backspace", "everything goes back to rest"),
    ("middle button", "turn the scene; with Shift move it"),
    ("Ctrl and wheel", "scale the scene"),
    ("P", "put the body under the cursor aside, or back"),
    ("M", "set one end of a ruler, then the other, on what the cursor points at; again: take it away"),
    ("H", "with surface_compliance: pull points of the surface by a spring, hold them, neither, in turn"),
    ("C", "clear the force curve; reset the range of colours"),
    (
        "L",
        "release the control element under the cursor; beside all of them: it holds again (scenes with updates)",
    ),
    ("Home", "the scene and all bodies back to their places"),
    ("W A S D, arrow keys", "move the head forward, left, back, right"),
    ("Q, E", "move the head down, up"),
    ("R", "put the head back"),
    ("V", "with the effect stress: von Mises stress, largest strain, displacement in turn"),
    ("F1, F2, F3, F4", "overlay, room from outside, test pattern, eyes swapped; again: back"),
    ("Tab", "the panel: model, material, effects, stage, saving; again: closed"),
    ("K", "make control elements on the body with the mouse; again: back"),
    ("F8", "record the session into a file for --replay; again: end it"),
    ("F9, F11, F12", "write the bodies as .glb, record a video (again: end it), save a picture"),
    ("Escape", "quit"),
];

/// One event, independent of the window system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MouseInput<'a> {
    /// The cursor is on screen number `screen` at `ndc` (x right, y up, -1..1 over the screen).
    Cursor {
        screen: usize,
        ndc: [f64; 2],
    },
    Button {
        button: Button,
        pressed: bool,
    },
    /// Positive away from the user, in notches.
    Wheel {
        notches: f64,
    },
    /// A key by its W3C name, any case: `w`, `ArrowUp`, `Control`.
    Key {
        name: &'a str,
        pressed: bool,
    },
    /// The window lost the focus: all buttons and keys count as released.
    FocusLost,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    Left,
    Middle,
    Right,
}

/// Head and stylus, moved by mouse and keys.
#[derive(Clone, Debug)]
pub struct Mouse {
    /// Distance along the ray to what it hits now, which the caller sets after picking: the next grab takes hold there.
    /// `None` (nothing hit) lets the ray end at the distance of the workspace.
    pub hit_distance_m: Option<f64>,
    /// The head's pose by a tracker, where the ray then starts. `None`: mouse and keys move the head.
    pub tracked_head: Option<Isometry3<f64>>,
    stage: Stage,
    room_from_head: Isometry3<f64>,
    screen: usize,
    ndc: [f64; 2],
    grab: Option<Grab>,
    right_button: bool,
    /// Whether Ctrl and Shift are down.
    pub control: bool,
    shift: bool,
    /// Head movements of the keys that are down: right, up, back, and the opposite ones.
    forward_keys: [bool; 3],
    backward_keys: [bool; 3],
}

#[derive(Clone, Copy, Debug)]
struct Grab {
    /// Whether the scene is held, or what the cursor points at.
    is_scene: bool,
    point: Point3<f64>,
    room_from_stylus: Isometry3<f64>,
}

/// The turn for a cursor movement from one edge of the screen to the other, radians.
const TURN_PER_SCREEN: f64 = std::f64::consts::PI;
const TWIST_PER_NOTCH: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// One notch of the wheel moves a thing by this fraction of its distance to the eye.
const REACH_PER_NOTCH: f64 = 0.05;
const NEAREST_REACH_M: f64 = 0.02;
/// Head speed in workspace radii per second, so that crossing any stage takes the same time.
const HEAD_SPEED: f64 = 1.5;
const FARTHEST_HEAD_M: f64 = 3.0;
/// Longer frames count as this long, s, so that the head does not jump after a stall.
const LONGEST_STEP_S: f64 = 0.1;
const MOST_NOTCHES: f64 = 20.0;

impl Mouse {
    pub fn new(stage: Stage) -> Self {
        Self {
            hit_distance_m: None,
            tracked_head: None,
            room_from_head: stage.viewer.room_from_head,
            stage,
            screen: 0,
            ndc: [0.0, 0.0],
            grab: None,
            right_button: false,
            control: false,
            shift: false,
            forward_keys: [false; 3],
            backward_keys: [false; 3],
        }
    }

    /// Takes one event. Numbers that are not finite and screens that do not exist are ignored.
    pub fn handle(&mut self, input: MouseInput) {
        match input {
            MouseInput::Cursor { screen, ndc } => self.move_cursor(screen, ndc),
            MouseInput::Button { button: Button::Right, pressed } => self.right_button = pressed,
            MouseInput::Button { button, pressed: false } => {
                let is_scene = button == Button::Middle;
                self.grab = self.grab.filter(|grab| grab.is_scene != is_scene);
            }
            MouseInput::Button { button, pressed: true } => {
                if self.grab.is_none() {
                    self.grab = Some(self.grab_at_cursor(button == Button::Middle));
                }
            }
            MouseInput::Wheel { notches } if notches.is_finite() => {
                self.turn_wheel(notches.clamp(-MOST_NOTCHES, MOST_NOTCHES));
            }
            MouseInput::Wheel { .. } => {}
            MouseInput::Key { name, pressed } => self.press_key(name, pressed),
            MouseInput::FocusLost => {
                self.grab = None;
                (self.right_button, self.control, self.shift) = (false, false, false);
                (self.forward_keys, self.backward_keys) = ([false; 3], [false; 3]);
            }
        }
    }

    /// Moves the head for `step_s` seconds by the keys that are down.
    pub fn advance(&mut self, step_s: f64) {
        let step_s = if step_s.is_finite() { step_s.clamp(0.0, LONGEST_STEP_S) } else { 0.0 };
        let start = self.stage.viewer.room_from_head;
        let right = start.rotation * Vector3::x();
        let axes = [right, Vector3::y(), right.cross(&Vector3::y())];
        let mut velocity = Vector3::zeros();
        for (i, axis) in axes.iter().enumerate() {
            velocity += axis * (f64::from(self.forward_keys[i]) - f64::from(self.backward_keys[i]));
        }
        let step = velocity * (HEAD_SPEED * self.stage.workspace.radius_m * step_s);
        let moved = self.room_from_head.translation.vector - start.translation.vector + step;
        let place = start.translation.vector + moved.cap_magnitude(FARTHEST_HEAD_M);
        self.room_from_head.translation = Translation3::from(place);
    }

    /// Head and stylus as they are now.
    pub fn state(&self, time_s: f64) -> TrackerState {
        let room_from_stylus = self.grab.map_or_else(|| self.aim(), |grab| grab.room_from_stylus);
        let stylus = StylusState {
            room_from_stylus: room_from_stylus.cast(),
            pressed: self.grab.is_some_and(|grab| !grab.is_scene),
            second: self.grab.is_some_and(|grab| grab.is_scene || self.shift),
            from_eye: true,
            ..Default::default()
        };
        TrackerState { head: Some(self.room_from_head.cast()), styli: vec![stylus], time_s }
    }

    fn eye(&self) -> Point3<f64> {
        self.stage.viewer.eye_in_room(&self.tracked_head.unwrap_or(self.room_from_head), Eye::Centre)
    }

    /// The stylus at the eye, its -z axis through the cursor.
    fn aim(&self) -> Isometry3<f64> {
        let eye = self.eye();
        let through = self.stage.screens[self.screen].point(self.ndc);
        let rotation = rotation_towards(&(through - eye), 0.0).unwrap_or(self.room_from_head.rotation);
        Isometry3::from_parts(Translation3::from(eye.coords), rotation)
    }

    /// True while a wheel turns or carries what is held.
    pub fn is_grabbing(&self) -> bool {
        self.grab.is_some()
    }

    /// The scene is held at the centre of the workspace.
    fn grab_at_cursor(&self, is_scene: bool) -> Grab {
        let room_from_stylus = self.aim();
        if is_scene {
            return Grab { is_scene, point: self.stage.workspace.centre, room_from_stylus };
        }
        let to_workspace_m = (self.stage.workspace.centre - self.eye()).norm();
        let usable = |distance_m: &f64| distance_m.is_finite() && *distance_m > 0.0;
        let reach_m = self.hit_distance_m.filter(usable).unwrap_or(to_workspace_m);
        Grab { is_scene, point: room_from_stylus * Point3::new(0.0, 0.0, -reach_m), room_from_stylus }
    }

    fn move_cursor(&mut self, screen: usize, ndc: [f64; 2]) {
        // While a button is down, the cursor may be reported outside the window; ten screens away is a mistake.
        if screen >= self.stage.screens.len() || !ndc.iter().all(|x| x.abs() <= 10.0) {
            return;
        }
        let eye = self.eye();
        let before = (self.screen, self.ndc);
        (self.screen, self.ndc) = (screen, ndc);
        if before.0 != screen {
            return;
        }
        let shown_on = &self.stage.screens[screen];
        let [right, up, normal] = shown_on.axes();
        let Some(mut grab) = self.grab else { return };
        let is_turning = if grab.is_scene { !self.shift } else { self.right_button || self.control };
        if is_turning {
            let across = (ndc[0] - before.1[0]) / 2.0 * TURN_PER_SCREEN;
            let upward = (ndc[1] - before.1[1]) / 2.0 * TURN_PER_SCREEN;
            grab.turn(&UnitQuaternion::from_scaled_axis(up * across - right * upward));
            self.grab = Some(grab);
            return;
        }
        let eye_distance_m = shown_on.distance_m(&eye);
        if eye_distance_m >= MIN_EYE_DISTANCE_M {
            // Similar triangles: at twice the screen's distance a thing moves twice as far as the cursor.
            let depth = (eye - grab.point).dot(&normal).max(0.0) / eye_distance_m;
            grab.shift((shown_on.point(ndc) - shown_on.point(before.1)) * depth);
            self.grab = Some(grab);
        }
    }

    fn turn_wheel(&mut self, notches: f64) {
        let eye = self.eye();
        let normal = self.stage.screens[self.screen].axes()[2];
        let is_turning = self.right_button || self.control;
        let Some(grab) = &mut self.grab else { return };
        if is_turning {
            let axis = Unit::new_normalize(normal);
            grab.turn(&UnitQuaternion::from_axis_angle(&axis, notches * TWIST_PER_NOTCH));
            return;
        }
        let sight = grab.point - eye;
        let reach_m = sight.norm();
        if reach_m > 0.0 {
            let new_reach_m = (reach_m * (1.0 + REACH_PER_NOTCH).powf(notches)).clamp(NEAREST_REACH_M, 100.0);
            grab.shift(sight * (new_reach_m / reach_m - 1.0));
        }
    }

    fn press_key(&mut self, name: &str, pressed: bool) {
        match name.to_ascii_lowercase().as_str() {
            "control" => self.control = pressed,
            "shift" => self.shift = pressed,
            "d" | "arrowright" => self.forward_keys[0] = pressed,
            "a" | "arrowleft" => self.backward_keys[0] = pressed,
            "e" => self.forward_keys[1] = pressed,
            "q" => self.backward_keys[1] = pressed,
            "s" | "arrowdown" => self.forward_keys[2] = pressed,
            "w" | "arrowup" => self.backward_keys[2] = pressed,
            "r" if pressed => self.room_from_head = self.stage.viewer.room_from_head,
            _ => {}
        }
    }
}

impl Grab {
    fn shift(&mut self, by: Vector3<f64>) {
        self.point += by;
        self.room_from_stylus.translation.vector += by;
    }

    /// Turns the stylus about the grab point.
    fn turn(&mut self, rotation: &UnitQuaternion<f64>) {
        let arm = self.room_from_stylus.translation.vector - self.point.coords;
        self.room_from_stylus.translation.vector = self.point.coords + rotation * arm;
        let turned = rotation * self.room_from_stylus.rotation;
        self.room_from_stylus.rotation = UnitQuaternion::new_normalize(turned.into_inner());
    }
}

#[cfg(test)]
mod tests;
