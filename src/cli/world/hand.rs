//! One hand: what its ray hits, what it holds, and how its stylus is drawn.

use super::PlacedBody;
use crate::field::Value;
use crate::interact::{Drag, Dragger, Hit, PickRay, PickTarget, pick as pick_nearest};
use crate::render::StylusShape;
use crate::stage::Workspace;
use crate::track::StylusState;
use nalgebra::{Isometry3, Matrix4, Point3, Translation3};
use serde::{Deserialize, Serialize};

/// What a hand holds, and where it took hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grip {
    pub dragger: Dragger,
    /// The matrix of what is held now.
    pub drag: Option<Drag>,
    /// The place that was hit at the grab, in the stylus' frame.
    #[serde(with = "crate::field::numbers::option")]
    pub hit_in_stylus: Option<Point3<f64>>,
}

impl Value for Grip {
    const TYPE: &'static str = "dragger";
}

impl Grip {
    /// The grip in the next frame.
    pub fn follow(
        &self,
        stylus: &StylusState,
        hit: Option<&Hit>,
        room_from_target: impl Fn(usize) -> Matrix4<f64>,
    ) -> Grip {
        let mut next = *self;
        next.drag = next.dragger.update(stylus, hit, room_from_target);
        if next.drag.is_some() && self.dragger.held().is_none() {
            let place = next.dragger.stylus.last.zip(hit);
            next.hit_in_stylus = place.map(|(pose, hit)| pose.inverse() * hit.point_in_room.cast::<f64>());
        }
        next
    }
}

/// What the ray hits, or else what it passes within a hand's aim: the end of a tube is hard to hit from the side.
pub fn pick(stylus: &StylusState, bodies: &[PlacedBody], targets: &[(usize, usize)]) -> Option<Hit> {
    let ray = PickRay::from_stylus(stylus)?;
    let among = |near: bool| {
        let shapes: Vec<PickTarget> = targets.iter().map(|&(b, c)| bodies[b].pick_target(c, near)).collect();
        pick_nearest(&ray, &shapes)
    };
    among(false).or_else(|| among(true))
}

/// How a stylus is drawn; `None` as long as it had no usable pose. One that starts at the eye would be seen end-on: its
/// pen is drawn as held in the right hand instead, pointing at the same place.
pub fn shape(
    stylus: &StylusState,
    hit: Option<&Hit>,
    grip: &Grip,
    workspace: &Workspace,
) -> Option<StylusShape> {
    let room_from_stylus = grip.dragger.stylus.last?;
    let hit: Option<Point3<f64>> = match grip.drag {
        Some(_) => grip.hit_in_stylus.map(|point| room_from_stylus * point),
        None => hit.map(|hit| hit.point_in_room.cast()),
    };
    let radius = workspace.radius_m;
    let mut shown = room_from_stylus;
    let mut ray_length_m = 3.0 * radius;
    if stylus.from_eye {
        let eye = shown.translation.vector;
        let to_workspace = (workspace.centre.coords - eye).norm();
        let aim = hit.unwrap_or(shown * Point3::new(0.0, 0.0, -to_workspace));
        let hand = shown
            * Point3::new(0.9 * radius, -0.9 * radius, -(to_workspace - 1.4 * radius).max(0.5 * radius));
        if let Some(rotation) = crate::stage::rotation_towards(&(aim - hand), 0.0) {
            shown = Isometry3::from_parts(Translation3::from(hand.coords), rotation);
            ray_length_m = (aim - hand).norm();
        }
    }
    Some(StylusShape {
        room_from_stylus: shown.to_homogeneous().cast(),
        size_m: (0.45 * radius) as f32,
        ray_length_m: ray_length_m as f32,
        hit: hit.map(|point| point.cast()),
        bend: None,
        pressed: grip.drag.is_some(),
    })
}
