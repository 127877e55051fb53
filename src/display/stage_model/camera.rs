//! The outside camera: an eye that orbits a point, its view through a screen that floats in the room, and the points that it
//! must keep in view.

use crate::render::View;
use crate::render::window::{Button, Input};
use crate::stage::{Screen, Stage, rotation_towards};
use nalgebra::{Point3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// An eye outside the stage, which orbits a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub target: Point3<f64>,
    /// Angles about the vertical, from +z towards +x, and above the horizon; rad.
    pub azimuth: f64,
    pub elevation: f64,
    pub distance_m: f64,
}

/// Vertical opening angle, rad.
const OPENING: f64 = 40.0 * TAU / 360.0;
/// Share of the picture that everything takes up at first, in pictures at least so wide against their height.
const MARGIN: f64 = 0.93;
const NARROWEST: f64 = 4.0 / 3.0;
const STEEPEST: f64 = FRAC_PI_2 - 1e-3;
/// Elevation above which a place is overhead, rad.
const OVERHEAD: f64 = 75.0 * TAU / 360.0;
/// Angle by which the first view is to the right of the viewer's, rad.
const ASIDE: f64 = 0.8;

impl Camera {
    /// A camera at the viewer's side, above and to the right, at the distance at which everything is in the picture.
    pub fn facing(stage: &Stage) -> Self {
        let points = outline(stage);
        let viewer = stage.viewer.room_from_head.translation.vector - stage.workspace.centre.coords;
        let behind = if viewer.xz().norm() > 1e-3 { viewer.x.atan2(viewer.z) } else { 0.0 };
        let (target, _) = ball_about(&points);
        let mut camera = Self { target, azimuth: behind + ASIDE, elevation: 0.42, distance_m: 1.0 };
        let away = camera.eye() - target;
        let right = Vector3::y().cross(&away).normalize();
        let up = away.cross(&right);
        let slope = MARGIN * (OPENING / 2.0).tan();
        let needed = |point: &Point3<f64>| {
            let offset = point - target;
            let aside = offset.dot(&up).abs().max(offset.dot(&right).abs() / NARROWEST);
            offset.dot(&away) + aside / slope
        };
        camera.distance_m = points.iter().map(needed).fold(0.0, f64::max);
        camera
    }

    /// Looks at the same target from another place; from a place on the target itself, from its side. From a place high above,
    /// straight down, with the viewer's side below, as a plan is drawn.
    pub fn from(stage: &Stage, place: Point3<f64>) -> Self {
        let camera = Self::facing(stage);
        let away = place - camera.target;
        let distance_m = away.norm();
        if distance_m < 1e-6 {
            return camera;
        }
        let behind = camera.azimuth - ASIDE;
        if away.y > OVERHEAD.sin() * distance_m {
            let target = Point3::new(place.x, camera.target.y, place.z)
                - Vector3::new(behind.sin(), 0.0, behind.cos()) * (away.y / STEEPEST.tan());
            return Self {
                target,
                azimuth: behind,
                elevation: STEEPEST,
                distance_m: (place - target).norm(),
            };
        }
        Self {
            azimuth: away.x.atan2(away.z),
            elevation: (away.y / distance_m).asin().clamp(-STEEPEST, STEEPEST),
            distance_m,
            ..camera
        }
    }

    /// Turns by a drag over parts of the picture's height: half a turn across it.
    pub fn turn(&mut self, [x, y]: [f64; 2]) {
        if x.is_finite() && y.is_finite() {
            self.azimuth = (self.azimuth - x * TAU / 2.0) % TAU;
            self.elevation = (self.elevation + y * TAU / 2.0).clamp(-STEEPEST, STEEPEST);
        }
    }

    /// Comes nearer by 10 % for each positive notch of the wheel.
    pub fn zoom(&mut self, notches: f64) {
        if notches.is_finite() {
            self.distance_m = (self.distance_m * 0.9f64.powf(notches.clamp(-50.0, 50.0))).clamp(0.05, 500.0);
        }
    }

    pub fn eye(&self) -> Point3<f64> {
        let Self { target, azimuth, elevation, distance_m } = self;
        let level = elevation.cos();
        let away = Vector3::new(level * azimuth.sin(), elevation.sin(), level * azimuth.cos());
        target + away * *distance_m
    }

    /// The view in pictures of this width to height, as they are seen; `None` where it is none.
    pub fn view(&self, aspect: f64) -> Option<View> {
        if !(aspect.is_finite() && aspect > 0.0) {
            return None;
        }
        let eye = self.eye();
        let rotation = rotation_towards(&(self.target - eye), 0.0)?;
        let half_height = self.distance_m * (OPENING / 2.0).tan();
        let up = rotation * Vector3::y() * half_height;
        let right = rotation * Vector3::x() * (half_height * aspect);
        let screen = Screen {
            name: "camera".to_owned(),
            lower_left: self.target - right - up,
            lower_right: self.target + right - up,
            upper_left: self.target - right + up,
            pixels: [1, 1],
        };
        let view = screen.view(&eye, 0.02).ok()?;
        Some(View { clip_from_room: view.clip_from_room, eye_in_room: view.eye_in_room })
    }
}

/// A camera that the mouse turns and zooms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    pub camera: Camera,
    /// The last place of the cursor, as a share of the window.
    cursor: Option<[f32; 2]>,
    dragging: bool,
}

impl Orbit {
    pub fn new(camera: Camera) -> Self {
        Self { camera, cursor: None, dragging: false }
    }

    /// Dragging with the left button turns, the wheel zooms.
    pub fn handle(&mut self, input: &Input) {
        match *input {
            Input::Cursor { position, .. } => {
                if let Some([x, y]) = self.cursor.filter(|_| self.dragging) {
                    self.camera.turn([position[0] - x, position[1] - y].map(f64::from));
                }
                self.cursor = Some(position);
            }
            Input::Button { button: Button::Left, pressed, .. } => self.dragging = pressed,
            Input::Wheel { lines, .. } => self.camera.zoom(lines.into()),
            Input::Focus { focused: false, .. } => self.dragging = false,
            _ => {}
        }
    }
}

/// Corners of all screens, and of boxes about the workspace and the viewer's head.
pub(super) fn outline(stage: &Stage) -> Vec<Point3<f64>> {
    let head = Point3::from(stage.viewer.room_from_head.translation.vector);
    let boxes = [(stage.workspace.centre, stage.workspace.radius_m), (head, 0.2)];
    let of_box = |(middle, half): (Point3<f64>, f64)| {
        (0..8)
            .map(move |k| middle + Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half } else { half }))
    };
    stage.screens.iter().flat_map(Screen::corners).chain(boxes.into_iter().flat_map(of_box)).collect()
}

pub(super) fn ball_about(points: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let first = points.first().copied().unwrap_or_else(Point3::origin);
    let (low, high) =
        points.iter().fold((first, first), |(low, high), point| (low.inf(point), high.sup(point)));
    let middle = nalgebra::center(&low, &high);
    (middle, points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::BUILT_IN;

    #[test]
    fn everything_is_in_the_first_picture_of_every_stage() {
        for (name, _) in BUILT_IN {
            let stage = Stage::find(name).unwrap();
            let view = Camera::facing(&stage).view(4.0 / 3.0).unwrap();
            let places = outline(&stage).into_iter().map(|point| {
                let clip = view.clip_from_room * point.cast::<f32>().to_homogeneous();
                assert!(clip.w > clip.z, "{name}: {point} is before the near plane");
                (clip.x / clip.w).abs().max((clip.y / clip.w).abs())
            });
            let outermost = places.fold(0.0, f32::max);
            assert!((0.6..=1.0).contains(&outermost), "{name}: {outermost}");
        }
    }

    #[test]
    fn a_drag_turns_half_round_and_never_over_the_top() {
        let mut orbit = Orbit::new(Camera::facing(&Stage::find("workbench").unwrap()));
        let before = orbit.camera;
        let cursor = |x, y| Input::Cursor { window: 0, position: [x, y] };
        let button = |pressed| Input::Button { window: 0, button: Button::Left, pressed };
        orbit.handle(&cursor(0.2, 0.5));
        assert_eq!(orbit.camera, before, "nothing is pressed");
        for input in [button(true), cursor(1.2, 0.5), button(false), cursor(0.0, 0.0)] {
            orbit.handle(&input);
        }
        let (was, now) = (before.eye() - before.target, orbit.camera.eye() - before.target);
        assert!((was.xz() + now.xz()).norm() < 1e-9 && (was.y - now.y).abs() < 1e-9, "{was} {now}");
        for input in [button(true), cursor(0.0, 40.0), cursor(f32::NAN, 0.0)] {
            orbit.handle(&input);
        }
        orbit.handle(&Input::Wheel { window: 0, lines: f32::INFINITY });
        assert!(orbit.camera.view(1.0).is_some(), "{orbit:?}");
    }

    #[test]
    fn a_plan_has_the_viewer_below() {
        let stage = Stage::find("workbench").unwrap();
        for place in [[0.05, 4.5, 0.2], [-0.05, 4.5, 0.9], [0.0, 4.5, 0.6]] {
            let camera = Camera::from(&stage, place.into());
            assert!((camera.eye() - Point3::from(place)).norm() < 1e-9, "{place:?}");
            let view = camera.view(1.0).unwrap();
            let height = |place: Point3<f64>| {
                let clip = view.clip_from_room * place.cast::<f32>().to_homogeneous();
                clip.y / clip.w
            };
            let viewer = Point3::from(stage.viewer.room_from_head.translation.vector);
            assert!(height(viewer) < height(stage.screens[1].lower_left), "{place:?}");
        }
    }

    #[test]
    fn the_same_place_gives_the_same_eye() {
        let stage = Stage::find("cyberstage").unwrap();
        for place in [[3.0, 2.0, 4.0], [-1.0, 0.5, -3.0], [0.0, 9.0, 0.0]] {
            let place = Point3::from(place);
            assert!((Camera::from(&stage, place).eye() - place).norm() < 0.02, "{place}");
        }
    }
}
