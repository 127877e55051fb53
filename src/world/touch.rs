//! Hands that take points of a surface: by a spring, or held where the hand is.
//!
//! In: styli, what they hold, and bodies whose scene lists `surface_compliance`. Out: [`Touches`], from which each body gets its
//! [`AppliedLoads`]. A scene without such a body has none of this.

use super::body::PlacedBody;
use super::ruler::SurfacePoint;
use crate::base::diagnostic::notice;
use crate::deform::{AppliedLoads, PointLoad, Pull};
use crate::field::{Value, value_types};
use crate::interact::{Hands, PickRay, PickShape, SurfaceGrip, pick};
use crate::track::{Signal, StylusState};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// The force of the longest arrow moves the point by this part of the body's radius.
const FULL_AT: f64 = 0.1;

/// The points that the styli touch.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Touches(Vec<Finger>);

/// One stylus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Finger {
    was_pressed: bool,
    touch: Option<Touch>,
    /// The point that it will touch once the point's columns are there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    coming: Option<PendingTouch>,
}

/// A point that cannot be pulled yet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PendingTouch {
    touch: Touch,
    /// Number of frames that it has waited: each looks again.
    frames: u64,
}

/// A point that is touched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Touch {
    pub body: usize,
    pub nodes: [u32; 3],
    weights: [f64; 3],
    /// The point in the hand's frame, by which the hand carries it.
    #[serde(with = "crate::field::numbers")]
    pub place_in_stylus: Point3<f64>,
    /// The place to which the hand has carried the point.
    #[serde(with = "crate::field::numbers")]
    pub place_in_room: Point3<f64>,
    /// N/m in the body's own metres; without one the point is where the hand is.
    pub spring: Option<f64>,
    /// The force of the longest arrow, N.
    pub full_n: f64,
}

value_types! {
    Touches => "touches",
    SurfaceGrip => "taking",
    LoadValues => "loads",
}

/// Values of the loads of a body, one for each of their columns; gravity in the room's axes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LoadValues(pub Vec<f64>);

impl Touches {
    /// The touch of stylus `i`.
    pub fn get(&self, i: usize) -> Option<&Touch> {
        self.0.get(i)?.touch.as_ref()
    }

    /// Points that cannot be pulled yet.
    pub fn coming(&self) -> impl Iterator<Item = &Touch> {
        self.0.iter().filter_map(|finger| finger.coming.as_ref()).map(|coming| &coming.touch)
    }

    /// All touches, stylus after stylus.
    pub fn all(&self) -> impl Iterator<Item = &Touch> {
        self.0.iter().filter_map(|finger| finger.touch.as_ref())
    }

    /// The next frame's touches.
    pub fn step<'a>(
        &self,
        taking: SurfaceGrip,
        styli: impl Iterator<Item = &'a Option<StylusState>>,
        hands: &Hands,
        bodies: &[PlacedBody],
    ) -> Touches {
        let step = |(i, stylus): (usize, &Option<StylusState>)| {
            let last = self.0.get(i).copied().unwrap_or_default();
            let pressing = stylus.as_ref().filter(|s| s.pressed && !matches!(s.signal, Signal::Lost { .. }));
            let (Some(stylus), Some(pose)) = (pressing, hands.room_from_stylus(i)) else {
                return Finger::default();
            };
            let is_free = hands.grip(i).is_none() && taking != SurfaceGrip::Elements;
            let coming = match last.was_pressed {
                true => last.coming,
                false if is_free => {
                    taken(stylus, &pose, bodies).map(|touch| PendingTouch { touch, frames: 0 })
                }
                false => None,
            };
            let moved = |touch: Touch| Touch { place_in_room: pose * touch.place_in_stylus, ..touch };
            let (touch, coming) = match coming.filter(|_| is_free) {
                None => (last.touch, None),
                Some(coming) => arrived(coming, taking, bodies),
            };
            Finger { was_pressed: true, touch: touch.filter(|_| is_free).map(moved), coming }
        };
        Touches(styli.enumerate().map(step).collect())
    }

    /// The loads of body `b`.
    pub fn applied(&self, b: usize, body: &PlacedBody, loads: &LoadValues) -> AppliedLoads {
        let body_from_room = body.room_from_body.inverse();
        let mut coefficients = loads.0.clone();
        if body.assets.has_gravity && coefficients.len() >= 3 {
            let along = Vector3::from_column_slice(&coefficients[..3]);
            coefficients[..3].copy_from_slice((body_from_room.isometry.rotation * along).as_slice());
        }
        let own = self.0.iter().filter_map(|finger| finger.touch).filter(|touch| touch.body == b);
        let point = |touch: Touch| PointLoad {
            nodes: touch.nodes,
            weights: touch.weights,
            pull: Pull::Towards {
                place: (body_from_room * touch.place_in_room).coords,
                spring: touch.spring,
            },
        };
        AppliedLoads { coefficients, points: own.map(point).collect() }
    }
}

/// The touch, once the columns of its point are there.
fn arrived(
    coming: PendingTouch,
    taking: SurfaceGrip,
    bodies: &[PlacedBody],
) -> (Option<Touch>, Option<PendingTouch>) {
    let touch = coming.touch;
    let body = &bodies[touch.body];
    match body.deformer.softness(&touch.nodes, &touch.weights) {
        Ok(Some(softness)) => {
            let spring = (taking == SurfaceGrip::Force).then(|| body.assets.spring.unwrap_or(1.0 / softness));
            (Some(Touch { spring, full_n: FULL_AT * body.assets.ball.1 / softness, ..touch }), None)
        }
        Ok(None) => (None, Some(PendingTouch { frames: coming.frames + 1, ..coming })),
        Err(error) => {
            notice!("{error}; this point of the surface takes no force");
            (None, None)
        }
    }
}

/// The point at which a ray meets a body that takes forces, of all bodies as they were last seen; how soft it is, is not known
/// yet.
fn taken(stylus: &StylusState, pose: &Isometry3<f64>, bodies: &[PlacedBody]) -> Option<Touch> {
    let ray = PickRay::from_stylus(stylus)?;
    let positions: Vec<_> = bodies.iter().map(|body| body.deformer.positions()).collect();
    let shapes: Vec<PickShape> = bodies.iter().map(PlacedBody::whole_shape).collect();
    let targets = bodies.iter().zip(&shapes).zip(&positions);
    let targets: Vec<_> = targets.map(|((body, shape), places)| body.whole(shape, places)).collect();
    let hit = pick(&ray, &targets)?;
    let body = &bodies[hit.target];
    let place = body.room_from_body.inverse() * hit.point_in_room.cast::<f64>();
    let point = SurfacePoint::nearest(hit.target, body, &place.coords)?;
    // Beside a control element: the nodes that are free share what is taken.
    let is_free = |node: &u32| body.assets.takes_forces.contains(node);
    let shares = point.corners.iter().zip(point.weights);
    let mut weights = [0.0; 3];
    weights
        .iter_mut()
        .zip(shares)
        .for_each(|(w, (node, share))| *w = if is_free(node) { share } else { 0.0 });
    let sum: f64 = weights.iter().sum();
    if sum <= 1e-6 {
        return None;
    }
    // A corner without a share may be one that a cut has made, which goes when the cut goes on.
    let most = (0..3).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or_default();
    let corner = |i: usize| point.corners[if weights[i] > 0.0 { i } else { most }];
    let point = SurfacePoint { corners: [0, 1, 2].map(corner), weights: weights.map(|w| w / sum), ..point };
    let place_in_room = body.room_from_body * point.places(body)[0];
    Some(Touch {
        body: hit.target,
        nodes: point.corners,
        weights: point.weights,
        place_in_stylus: pose.inverse() * place_in_room,
        place_in_room,
        spring: None,
        full_n: 0.0,
    })
}
