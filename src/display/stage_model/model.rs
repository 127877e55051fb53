//! The room seen from outside: screens, eyes with their lines of sight to the screens, head, workspace and trackers.
//!
//! In: a stage and where the head is now. Out: [`Drawable`]s in the room, and the names to be written beside
//! them. The caller adds bodies and styli; a [`Camera`](super::Camera) looks at the whole.

use super::camera::{ball_about, outline};
use crate::display::caption::{DARK, INK, LEFT, Lettering, QUIET, RIGHT, wrapped};
use crate::render::{Ball, Drawable, FrameContents, Grid, Line, Quad, View};
use crate::stage::{Eye, Screen, Stage};
use crate::track::Signal;
use crate::track::tracker_set::TrackerReport;
use egui::{Align2, Color32, Painter, Rect, Stroke, Vec2, pos2, vec2};
use nalgebra::{Isometry3, Point3, Vector3};
use std::f64::consts::TAU;

/// Linear RGB and opacity.
type Colour = [f32; 4];

const OUTLINE: Colour = [0.55, 0.68, 0.85, 1.0];
const FRONT: Colour = [0.10, 0.26, 0.55, 0.20];
const BACK: Colour = [0.20, 0.14, 0.10, 0.42];
const FAINT: Colour = [0.42, 0.50, 0.60, 0.28];
const GLASSES: Colour = [0.75, 0.78, 0.82, 1.0];
const AXES: [Colour; 3] = [[0.85, 0.10, 0.07, 1.0], [0.12, 0.60, 0.10, 1.0], [0.08, 0.25, 0.95, 1.0]];
/// Colour of balls, without transparency, since the pieces of a circle overlap.
const BALL: Colour = [0.20, 0.25, 0.31, 1.0];
/// Length of a sensor's axes, m.
const SENSOR_M: f64 = 0.08;
/// Length of a tracker's axes against the room's.
const TRACKER_LENGTHS: f64 = 2.2;
/// Sides of the polygon that stands for a circle.
const CIRCLE: u32 = 64;

/// Everything about a stage that can be drawn, except what moves in it beside the head.
#[derive(Clone, Debug, Default)]
pub struct StageModel {
    pub drawables: Vec<Drawable>,
    pub labels: Vec<Label>,
    pub floor: Option<Grid>,
    /// Words for the picture's corner.
    pub note: String,
}

/// Words at a place in the room.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    pub place: Point3<f64>,
    pub text: String,
    pub ink: Color32,
    /// Letters' height against the usual.
    pub size: f32,
}

impl StageModel {
    /// The stage with its viewer's head at `room_from_head`, for an eye outside at `camera`.
    pub fn new(stage: &Stage, room_from_head: &Isometry3<f64>, camera: &Point3<f64>) -> Self {
        let mut room = Self::default();
        let (_, radius) = ball_about(&outline(stage));
        let heights = stage.screens.iter().flat_map(Screen::corners).map(|corner| corner.y);
        let floor_m = heights.fold(0.0, f64::min);
        room.add_floor(stage, floor_m, radius);
        room.add_screens(stage, floor_m, camera);
        room.add_workspace(stage);
        room.add_sights(stage, room_from_head);
        room.add_head(stage, room_from_head, floor_m);
        let length_m = 0.08 * radius;
        room.add_axes(&Isometry3::identity(), length_m);
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let mut end = Point3::origin();
            end[axis] = 1.15 * length_m;
            room.label(end, letter, QUIET, 0.85);
        }
        for (name, tracker) in &stage.tracking.trackers {
            // Longer than the room's, so that both are seen where they have one origin.
            let room_from_tracker = tracker.frame.room_from_tracker.isometry;
            room.add_axes(&room_from_tracker, TRACKER_LENGTHS * length_m);
            for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
                let mut end = Point3::origin();
                end[axis] = (TRACKER_LENGTHS + 0.3) * length_m;
                room.label(room_from_tracker * end, &format!("{name} {letter}"), QUIET, 0.85);
            }
        }
        room
    }

    /// Adds the dimensions of each screen: sides, tilt and heights.
    pub fn add_measures(&mut self, stage: &Stage) {
        for screen in &stage.screens {
            let sides = format!("{:.3} × {:.3} m\n{}", screen.width_m(), screen.height_m(), screen.posture());
            self.label(screen.point([0.0, 0.1]), &sides, QUIET, 0.85);
            for edge in [-1.0, 1.0] {
                let place = screen.point([0.0, 0.9 * edge]);
                let height = format!("{:.3} m high", screen.point([0.0, edge]).y);
                self.label(place, &height, QUIET, 0.85);
            }
        }
    }

    /// Adds sentences to the note in the corner.
    pub fn add_notes(&mut self, notes: impl IntoIterator<Item = String>) {
        for note in notes {
            self.note = format!("{note}\n{}", self.note);
        }
    }

    /// Adds every sensor that ever reported a pose, at its place, with the stage's name for it or its number.
    pub fn add_sensors(&mut self, reports: &[TrackerReport]) {
        for (tracker, sensor) in reports.iter().flat_map(|r| r.sensors.iter().map(move |s| (&r.name, s))) {
            let Some(room_from_sensor) = sensor.in_room else { continue };
            let name = sensor.name.clone().unwrap_or_else(|| format!("{} of {tracker}", sensor.id));
            let (state, ink) = match sensor.signal {
                Signal::Live => (String::new(), INK),
                Signal::Held { age_s } => (format!(" held for {age_s:.1} s"), QUIET),
                Signal::Lost { age_s } => (format!(" lost for {age_s:.0} s"), QUIET),
            };
            self.add_axes(&room_from_sensor, SENSOR_M);
            let place = Point3::from(room_from_sensor.translation.vector);
            self.label(place, &format!("{name}{state}"), ink, 0.85);
        }
    }

    /// The drawables, with those of `contents`; its floor becomes the room's.
    pub fn contents<'a>(&'a self, contents: FrameContents<'a>) -> FrameContents<'a> {
        let [frame, _] = contents.drawables;
        FrameContents { drawables: [frame, &self.drawables], grid: self.floor, ..contents }
    }

    fn line(&mut self, from: Point3<f64>, to: Point3<f64>, colour: Colour, width_px: f32) {
        let line = Line::new(from, to, colour, width_px);
        match self.drawables.last_mut() {
            Some(Drawable::Lines(lines)) => lines.push(line),
            _ => self.drawables.push(Drawable::Lines(vec![line])),
        }
    }

    fn label(&mut self, place: Point3<f64>, text: &str, ink: Color32, size: f32) {
        self.labels.push(Label { place, text: text.to_owned(), ink, size });
    }

    fn add_floor(&mut self, stage: &Stage, floor_m: f64, radius: f64) {
        let spacing = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0].into_iter().find(|s| s * 12.0 >= radius);
        let spacing = spacing.unwrap_or(2.0);
        // A strong line runs through the room's origin.
        let [x, z] = [stage.workspace.centre.x, stage.workspace.centre.z]
            .map(|at: f64| (at / (5.0 * spacing)).round() * 5.0 * spacing);
        let half = (2.2 * radius) as f32;
        let center = Point3::new(x, floor_m, z).cast();
        self.floor = Some(Grid::new(center, [half, half], spacing as f32));
        let centimetres = (spacing * 100.0).round();
        self.note = format!("{}: floor in cells of {centimetres} cm, strong lines every fifth", stage.name);
    }

    fn add_screens(&mut self, stage: &Stage, floor_m: f64, camera: &Point3<f64>) {
        let mut from_far: Vec<&Screen> = stage.screens.iter().collect();
        let away = |screen: &Screen| (screen.point([0.0, 0.0]) - camera).norm();
        from_far.sort_by(|a, b| away(b).total_cmp(&away(a)));
        for screen in from_far {
            let all = screen.corners();
            let [right, up] =
                [screen.lower_right, screen.upper_left].map(|corner| corner - screen.lower_left);
            self.drawables.push(Drawable::Quad(Quad {
                corner: screen.lower_left.cast().into(),
                right: right.cast().into(),
                up: up.cast().into(),
                front: FRONT,
                back: BACK,
            }));
            for k in 0..4 {
                self.line(all[k], all[(k + 1) % 4], OUTLINE, 2.0);
                if all[k].y > floor_m + 0.02 && all[k].y <= all[(k + 2) % 4].y {
                    let foot = Point3::new(all[k].x, floor_m, all[k].z);
                    self.line(foot, all[k], FAINT, 1.0);
                }
            }
            let middle = screen.point([0.0, 0.0]);
            let normal = screen.axes()[2];
            self.line(middle, middle + normal * 0.12 * right.norm().min(up.norm()), OUTLINE, 1.5);
            let is_front = screen.distance_m(camera) > 0.0;
            let (text, ink) = match is_front {
                true => (screen.name.clone(), INK),
                false => (format!("{}, from behind", screen.name), QUIET),
            };
            self.label(screen.point([0.0, 0.55]), &text, ink, if is_front { 1.25 } else { 1.0 });
        }
    }

    /// Three great circles of the ball in which bodies are handled.
    fn add_workspace(&mut self, stage: &Stage) {
        let ball = stage.workspace;
        for axis in 0..3 {
            let at = |k: u32| {
                let (sin, cos) = (TAU * f64::from(k) / f64::from(CIRCLE)).sin_cos();
                let mut offset = Vector3::zeros();
                (offset[(axis + 1) % 3], offset[(axis + 2) % 3]) = (cos, sin);
                ball.centre + offset * ball.radius_m
            };
            for k in 0..CIRCLE {
                self.line(at(k), at(k + 1), BALL, 1.0);
            }
        }
    }

    /// Adds lines from each eye to the corners of each screen that it sees.
    fn add_sights(&mut self, stage: &Stage, room_from_head: &Isometry3<f64>) {
        for &eye in stage.stereo.eyes() {
            let place = stage.viewer.eye_in_room(room_from_head, eye);
            let mut colour = linear(eye_ink(eye));
            colour[3] = 0.5;
            for screen in stage.screens.iter().filter(|screen| screen.distance_m(&place) > 0.0) {
                for corner in screen.corners() {
                    self.line(place, corner, colour, 1.0);
                }
            }
        }
    }

    /// A head of natural size with glasses; the eyes at the stage's inter-pupillary distance.
    fn add_head(&mut self, stage: &Stage, room_from_head: &Isometry3<f64>, floor_m: f64) {
        let at = |x: f64, y: f64, z: f64| room_from_head * Point3::new(x, y, z);
        let mut ball = |center: Point3<f64>, radius_m, color| {
            self.drawables.push(Drawable::Ball(Ball { center: center.cast(), radius_m, color }));
        };
        const SKIN: [f32; 3] = [0.42, 0.44, 0.47];
        ball(at(0.0, 0.02, 0.100), 0.092, SKIN);
        ball(at(0.0, -0.045, 0.070), 0.066, SKIN);
        ball(at(0.0, -0.035, -0.004), 0.015, SKIN);
        for eye in [Eye::Left, Eye::Right] {
            let [r, g, b, _] = linear(eye_ink(eye));
            ball(stage.viewer.eye_in_room(room_from_head, eye), 0.016, [r, g, b]);
        }
        for side in [-1.0, 1.0] {
            let x = side * stage.viewer.ipd_m.max(0.05) / 2.0;
            let frame = [[-0.027, -0.022], [0.027, -0.022], [0.027, 0.020], [-0.027, 0.020]];
            let frame = frame.map(|[dx, dy]| at(x + dx, dy, -0.022));
            for k in 0..4 {
                self.line(frame[k], frame[(k + 1) % 4], GLASSES, 2.0);
            }
            self.line(at(x + side * 0.027, 0.012, -0.022), at(side * 0.085, 0.012, 0.09), GLASSES, 2.0);
        }
        self.line(at(0.0, 0.0, -0.022), at(0.0, 0.0, -0.20), GLASSES, 1.5);
        let head = at(0.0, -0.1, 0.07);
        self.line(Point3::new(head.x, floor_m, head.z), head, FAINT, 1.0);
    }

    /// The axes of a frame in red, green and blue, as long as that.
    fn add_axes(&mut self, room_from_frame: &Isometry3<f64>, length_m: f64) {
        let origin = room_from_frame * Point3::origin();
        for (axis, colour) in AXES.into_iter().enumerate() {
            let mut end = Point3::origin();
            end[axis] = length_m;
            self.line(origin, room_from_frame * end, colour, 2.0);
        }
    }
}

/// Writes the room's names into `rect`, the part of the picture that shows `view`, and its note in the corner, above what is
/// `taken` there.
pub fn write_names(painter: &Painter, rect: Rect, view: &View, room: &StageModel, taken: &[Rect]) {
    let size = (rect.height() / 60.0).clamp(9.0, 26.0);
    let mut written: Vec<Rect> = taken.to_vec();
    // The largest are the most important.
    let mut labels: Vec<&Label> = room.labels.iter().collect();
    labels.sort_by(|a, b| b.size.total_cmp(&a.size));
    for label in labels {
        let clip = view.clip_from_room * label.place.cast::<f32>().to_homogeneous();
        if clip.w <= clip.z {
            continue;
        }
        let share = vec2(0.5 + 0.5 * clip.x / clip.w, 0.5 - 0.5 * clip.y / clip.w);
        let place = rect.min + share * rect.size();
        if rect.contains(place) {
            let middle = (place, Align2::CENTER_CENTER);
            let words = Lettering::new(painter, middle, &label.text, size * label.size, label.ink);
            let offset = aside(words.rect, rect, &written);
            if offset != Vec2::ZERO {
                let line = Stroke::new(1.0, label.ink.gamma_multiply(0.7));
                painter.line_segment([place, words.rect.translate(offset).clamp(place)], line);
            }
            written.push(words.paint(painter, offset, DARK.gamma_multiply(0.55)));
        }
    }
    if !room.note.is_empty() {
        let width = rect.width() - 2.0 * size;
        let note = wrapped(painter, &room.note, size, QUIET, width);
        let mut place = pos2(rect.min.x + size, rect.max.y - size - note.size().y).round();
        let mut lowest: Vec<&Rect> = taken.iter().collect();
        lowest.sort_by(|a, b| b.max.y.total_cmp(&a.max.y));
        for plate in lowest {
            if Rect::from_min_size(place, note.size()).expand(0.5 * size).intersects(*plate) {
                place.y = (plate.min.y - size - note.size().y).round();
            }
        }
        let plate = Rect::from_min_size(place, note.size()).expand2(vec2(0.4 * size, 0.1 * size));
        painter.rect_filled(plate, 0.0, DARK.gamma_multiply(0.8));
        painter.galley(place, note, QUIET);
    }
}

/// The offset by which a plate moves so that it stands within the picture and over no other: the least of those tried, none where
/// all fail.
fn aside(plate: Rect, picture: Rect, written: &[Rect]) -> Vec2 {
    let step = vec2(plate.width().min(4.0 * plate.height()), plate.height()) * 0.5;
    let steps = -6_i32..=6;
    let offset = |x: i32, y: i32| (vec2(x as f32, y as f32) * step).round();
    let offsets = steps.clone().flat_map(|x| steps.clone().map(move |y| offset(x, y)));
    let is_free = |offset: &Vec2| {
        let moved = plate.translate(*offset);
        picture.contains_rect(moved) && !written.iter().any(|other| other.intersects(moved))
    };
    let nearest = |a: &Vec2, b: &Vec2| a.length_sq().total_cmp(&b.length_sq());
    offsets.filter(is_free).min_by(nearest).unwrap_or_default()
}

fn eye_ink(eye: Eye) -> Color32 {
    match eye {
        Eye::Left => LEFT,
        Eye::Right => RIGHT,
        Eye::Centre => INK,
    }
}

fn linear(ink: Color32) -> Colour {
    egui::Rgba::from(ink).to_array()
}
