//! One hand: the control element that it points at or touches, and the shape in which its stylus is drawn.

use super::body::PlacedBody;
use crate::interact::{Grip, Hit, PickRay, PickTarget, bend, pick as pick_nearest, reach};
use crate::render::StylusShape;
use crate::stage::Workspace;
use crate::track::{Signal, StylusState, usable};
use nalgebra::{Isometry3, Point3, Translation3};

/// Largest distance at which the tip of a stylus takes what it touches, as part of the workspace's radius.
const REACH: f64 = 0.06;

/// Picks what the tip touches, else what the ray hits, else what the ray narrowly misses, because the end of a tube is hard to
/// hit from the side. A ray from the eye has no tip that touches; a stylus that is lost points at nothing.
pub fn pick(
    stylus: &StylusState,
    bodies: &[PlacedBody],
    targets: &[(usize, usize)],
    radius_m: f64,
) -> Option<Hit> {
    if matches!(stylus.signal, Signal::Lost { .. }) {
        return None;
    }
    let shapes = |near: bool| -> Vec<PickTarget> {
        targets.iter().map(|&(b, c)| bodies[b].pick_target(c, near)).collect()
    };
    pick_shape(stylus, &shapes(false), radius_m)
        .or_else(|| pick_nearest(&PickRay::from_stylus(stylus)?, &shapes(true)))
}

/// Picks the shape that the tip of a stylus touches, else what its ray hits. `radius_m` is that of the workspace.
pub fn pick_shape(stylus: &StylusState, shapes: &[PickTarget], radius_m: f64) -> Option<Hit> {
    let touched = usable(&stylus.room_from_stylus)
        .filter(|_| !stylus.from_eye)
        .and_then(|pose| reach(&Point3::from(pose.translation.vector), shapes, REACH * radius_m));
    touched.or_else(|| pick_nearest(&PickRay::from_stylus(stylus)?, shapes))
}

/// The grip of a hand, and where the place that it grabbed is now.
#[derive(Clone, Copy)]
pub struct HeldPlace<'a> {
    pub grip: &'a Grip,
    pub place: Point3<f64>,
}

/// The shape of a stylus. Its ray is bent where the grabbed place does not follow the hand. A ray that starts at the eye
/// would be seen end-on: its pen is drawn as if held in the right hand, pointing at the same place.
pub fn shape(
    stylus: &StylusState,
    room_from_stylus: Isometry3<f64>,
    hit: Option<&Hit>,
    held: Option<HeldPlace<'_>>,
    workspace: &Workspace,
) -> StylusShape {
    let end = held.map(|held| held.place).or(hit.map(|hit| hit.point_in_room.cast()));
    let carried = held.map(|held| room_from_stylus * held.grip.place_in_stylus).or(end);
    let radius = workspace.radius_m;
    let mut shown = room_from_stylus;
    let mut ray_length_m = 3.0 * radius;
    if stylus.from_eye {
        let eye = shown.translation.vector;
        let to_workspace = (workspace.centre.coords - eye).norm();
        let aim = carried.unwrap_or(shown * Point3::new(0.0, 0.0, -to_workspace));
        let hand = shown
            * Point3::new(0.9 * radius, -0.9 * radius, -(to_workspace - 1.4 * radius).max(0.5 * radius));
        if let Some(rotation) = crate::stage::rotation_towards(&(aim - hand), 0.0) {
            shown = Isometry3::from_parts(Translation3::from(hand.coords), rotation);
            ray_length_m = (aim - hand).norm();
        }
    }
    let tip = Point3::from(shown.translation.vector);
    let control = carried.zip(end).and_then(|(carried, end)| bend(&tip, &carried, &end));
    StylusShape {
        room_from_stylus: shown.to_homogeneous().cast(),
        size_m: (0.45 * radius) as f32,
        ray_length_m: ray_length_m as f32,
        hit: end.map(|point| point.cast()),
        bend: control.map(|point| point.cast()),
        pressed: held.is_some(),
    }
}
