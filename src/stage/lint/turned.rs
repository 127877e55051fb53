//! Finds pictures that are turned in their plane by a right angle or two: walls on their side or on their head, tables and
//! floors whose upper edge is not at the front, and ceilings that face away from the other screens.
//!
//! In: a [`Stage`]. Out: a warning for each, with the corners in the right order. A wall's picture is upright in the room; the
//! upper edge of a table's is at the front wall, or without walls beyond the table; a ceiling's is opposite.

use crate::base::diagnostic::{Diagnostic, Severity};
use crate::stage::description::Stage;
use crate::stage::error::place;
use crate::stage::screen::Screen;
use nalgebra::{Point3, Vector3};

/// Cosine between the vertical and the normal of a screen that lies or hangs: 30°.
const LEVEL: f64 = 0.866;
/// A wall's picture that is turned by more is on its side, degrees.
const WALL_TURN: f64 = 45.0;
/// A table's picture that is turned by more is not meant for a viewer at its front, degrees: benches stand at an angle, too.
const TABLE_TURN: f64 = 60.0;
/// Least cosine between the viewer's direction of sight and that to the front wall.
const FACED: f64 = 0.5;
/// A wall whose cosine is smaller by less than this may be the front as well, as where the viewer looks into a corner.
const AS_FACED: f64 = 0.3;
/// A viewer who stands beyond a table's edge by less may stand at another one, m.
const BEYOND_M: f64 = 0.05;
/// Pixels within this of squares speak for the order of the corners.
const SQUARE: f64 = 0.02;

const EDGES: [&str; 4] = ["upper", "right", "lower", "left"];

/// The way in which a picture's upper edge should lie, and how that is known.
struct UpperEdge {
    /// Direction in the room, not along the screen's normal.
    way: Vector3<f64>,
    /// `screen `wall`, the wall at the front,`; `None` if the viewer's place shows the way.
    wall: Option<String>,
}

pub fn lint(stage: &Stage, found: &mut Vec<Diagnostic>) {
    let mut push = |severity, screen: &Screen, message: String| {
        found.push(Diagnostic::new(severity, format!("screen.{}", screen.name), message));
    };
    // The loader reports the corners of a mirrored screen.
    let viewer = Point3::from(stage.viewer.room_from_head.translation.vector);
    for screen in stage.screens.iter().filter(|screen| screen.distance_m(&viewer) > 0.0) {
        if let Some(message) = faces_away(stage, screen) {
            push(Severity::Warning, screen, message);
        } else if let Some((severity, message)) = turned(stage, screen) {
            push(severity, screen, message);
        }
    }
}

fn is_level(screen: &Screen) -> bool {
    screen.axes()[2].y.abs() > LEVEL
}

/// Angle by which `way` is turned from the picture's up, towards its right, degrees.
fn turn_degrees(screen: &Screen, way: &Vector3<f64>) -> f64 {
    let [right, up, _] = screen.axes();
    right.dot(way).atan2(up.dot(way)).to_degrees()
}

/// A picture that hangs face down below all other screens: no ceiling.
fn faces_away(stage: &Stage, screen: &Screen) -> Option<String> {
    let mut others = stage.screens.iter().filter(|other| !std::ptr::eq(*other, screen)).peekable();
    let first = others.peek()?.name.as_str();
    let middle = |other: &Screen| screen.distance_m(&other.point([0.0, 0.0]));
    let is_below = screen.axes()[2].y < -LEVEL && others.all(|other| middle(other) < 0.0);
    let told = corners_told(&face_up(screen));
    is_below.then(|| {
        format!(
            "it hangs face down, and other screens, such as `{first}`, stand on its back. A table faces up: \
             write {told}"
        )
    })
}

/// The rectangle of `screen`, facing the other way.
fn face_up(screen: &Screen) -> Screen {
    let mut other = screen.clone();
    (other.lower_left, other.lower_right) = (screen.lower_right, screen.lower_left);
    other.upper_left = screen.upper_right();
    other
}

/// The finding about a picture that is turned in its plane.
pub fn turned(stage: &Stage, screen: &Screen) -> Option<(Severity, String)> {
    let (wanted, limit) = match is_level(screen) {
        false => (UpperEdge { way: Vector3::y(), wall: None }, WALL_TURN),
        true => (at_front(stage, screen)?, TABLE_TURN),
    };
    let degrees = turn_degrees(screen, &wanted.way);
    let quarters = (degrees / 90.0).round().rem_euclid(4.0) as usize;
    if degrees.abs() <= limit || quarters == 0 {
        return None;
    }
    let right = rotated(screen, quarters);
    let (edge, opposite) = (EDGES[quarters], EDGES[(quarters + 2) % 4]);
    let is_ceiling = screen.axes()[2].y < 0.0;
    let seen = match (is_level(screen), &wanted.wall) {
        (false, _) if quarters == 2 => {
            "its picture stands on its head: what is called its upper edge is the lower one".into()
        }
        (false, _) => {
            format!("its picture lies on its side: what is called its {edge} edge is the upper one")
        }
        (true, Some(wall)) if is_ceiling => format!(
            "its picture is turned by {}°: {wall} is at its {opposite} edge, where a ceiling has its lower one",
            degrees.abs().round()
        ),
        (true, Some(wall)) => format!(
            "its picture is turned by {}°: {wall} is at its {edge} edge, where a table or a floor has its upper one",
            degrees.abs().round()
        ),
        (true, None) => format!(
            "its picture is turned by {}°: the viewer stands at its {opposite} edge, where a table has its lower one",
            degrees.abs().round()
        ),
    };
    // Square pixels that would not be square otherwise: a display that is really mounted so.
    let is_mounted_so = is_square(screen) && !is_square(&right);
    let severity = if is_mounted_so { Severity::Note } else { Severity::Warning };
    let told = corners_told(&right);
    let message = format!(
        "{seen}. Unless the display is mounted so, write the corners as the viewer sees them: {told}"
    );
    Some((severity, message))
}

fn is_square(screen: &Screen) -> bool {
    let [width_m, height_m] = screen.pixel_size_m();
    (width_m / height_m - 1.0).abs() < SQUARE
}

/// The way of the upper edge of a screen that lies or hangs, if that is certain.
fn at_front(stage: &Stage, screen: &Screen) -> Option<UpperEdge> {
    // A ceiling's lower edge is at the front.
    let sign = screen.axes()[2].y.signum();
    let walls: Vec<Wall<'_>> = stage
        .screens
        .iter()
        .filter(|other| !is_level(other))
        .filter_map(|screen| Some(Wall { screen, way: level(-screen.axes()[2].xz())? }))
        .collect();
    if walls.is_empty() {
        let way = from_viewer(screen, &Point3::from(stage.viewer.room_from_head.translation.vector))?;
        return Some(UpperEdge { way: way * sign, wall: None });
    }
    let nearest = fronts(stage, &walls).into_iter().min_by(|a, b| {
        let turn = |wall: &Wall<'_>| turn_degrees(screen, &(wall.way * sign)).abs();
        turn(a).total_cmp(&turn(b))
    })?;
    let wall = Some(format!("screen `{}`, the wall at the front,", nearest.screen.name));
    Some(UpperEdge { way: nearest.way * sign, wall })
}

/// A wall, and the horizontal way over its upper edge out of the room.
#[derive(Clone, Copy)]
struct Wall<'a> {
    screen: &'a Screen,
    way: Vector3<f64>,
}

/// The walls that may be the front: those of that name; else those that no other faces, as the middle one of three; else, where
/// walls stand all around, those that the viewer looks at.
fn fronts<'a>(stage: &Stage, walls: &[Wall<'a>]) -> Vec<Wall<'a>> {
    let those = |is_front: &dyn Fn(&Wall<'_>) -> bool| {
        let found: Vec<Wall<'a>> = walls.iter().filter(|wall| is_front(wall)).copied().collect();
        Some(found).filter(|found| !found.is_empty())
    };
    let is_named = |wall: &Wall<'_>| wall.screen.name.to_lowercase().contains("front");
    let is_alone = |wall: &Wall<'_>| walls.iter().all(|other| other.way.dot(&wall.way) > -LEVEL);
    let looks = level((stage.viewer.room_from_head * -Vector3::z()).xz()).unwrap_or_default();
    let best = walls.iter().map(|wall| looks.dot(&wall.way)).fold(f64::NEG_INFINITY, f64::max);
    let is_faced = |wall: &Wall<'_>| looks.dot(&wall.way) >= (best - AS_FACED).max(FACED);
    those(&is_named).or_else(|| those(&is_alone)).or_else(|| those(&is_faced)).unwrap_or_default()
}

/// A horizontal unit vector, if the way is not steep.
fn level(way: nalgebra::Vector2<f64>) -> Option<Vector3<f64>> {
    (way.norm() > 0.1).then(|| Vector3::new(way.x, 0.0, way.y).normalize())
}

/// The way from the viewer over the one edge of a table at which the viewer stands.
fn from_viewer(screen: &Screen, viewer: &Point3<f64>) -> Option<Vector3<f64>> {
    // Seen from above, since a sloped table lies below a viewer who stands before it.
    let [right, up, _] = screen.axes();
    let from_corner = viewer - screen.lower_left;
    let beyond = |axis: &Vector3<f64>, side_m: f64| {
        let along_m = level(axis.xz()).map_or(0.0, |way| from_corner.dot(&way));
        along_m - along_m.clamp(0.0, side_m * axis.xz().norm())
    };
    let [across_m, along_m] = [beyond(&right, screen.width_m()), beyond(&up, screen.height_m())];
    match (across_m.abs() > BEYOND_M, along_m.abs() > BEYOND_M) {
        (true, false) => Some(right * -across_m.signum()),
        (false, true) => Some(up * -along_m.signum()),
        _ => None,
    }
}

/// The screen with its corners named anew so that what lies `quarters` right angles from up towards the right is up.
fn rotated(screen: &Screen, quarters: usize) -> Screen {
    let around = [screen.lower_left, screen.lower_right, screen.upper_right(), screen.upper_left];
    let corner = |k: usize| around[(4 - quarters + k) % 4];
    Screen { lower_left: corner(0), lower_right: corner(1), upper_left: corner(3), ..screen.clone() }
}

/// Three corners to paste, and the same as a tape measure has it.
fn corners_told(screen: &Screen) -> String {
    // Adding 0.0 prints -0.0 as 0.0.
    let tenth = |degrees: f64| (degrees * 10.0).round() / 10.0 + 0.0;
    let is_across = screen.axes()[0].y.abs() < 1e-3;
    let tape = match is_across {
        true => format!(
            " (by tape measure tilt_degrees = {:.1}, facing_degrees = {:.1})",
            tenth(screen.tilt_degrees()),
            tenth(screen.facing_degrees())
        ),
        false => String::new(),
    };
    format!(
        "lower_left = {}, lower_right = {}, upper_left = {}{tape}",
        place(&screen.lower_left),
        place(&screen.lower_right),
        place(&screen.upper_left)
    )
}
