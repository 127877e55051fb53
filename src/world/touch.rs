//! Hands that take points of a surface: by a spring, or held where the hand is.
//!
//! In: styli, what they hold, and bodies whose scene lists `surface_compliance`. Out: [`Touches`], from which each body gets its
//! [`AppliedLoads`]; a ball, an arrow and the newtons of each touched point. A scene without such a body has none of this.

use super::body::PlacedBody;
use super::flow::{Bodies, HandState};
use super::frame::World;
use super::ruler::SurfacePoint;
use crate::base::plates::{Anchor, Plate};
use crate::base::quantity::quantity;
use crate::deform::{AppliedLoads, PointLoad, Pull};
use crate::field::{Value, value_types};
use crate::interact::{PickRay, PickShape, Taking, force_arrow, pick};
use crate::render::{Arrow, Ball};
use crate::track::{Signal, StylusState};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Radius of the ball at a touched point and of its arrow's shaft, and the longest arrow, against the workspace's radius.
const BALL: f64 = 0.018;
const SHAFT: f64 = 0.012;
const LONGEST: f64 = 0.6;
/// The force of the longest arrow moves the point by this part of the body's radius.
const FULL_AT: f64 = 0.1;
/// Linear.
const COLOR: [f32; 3] = [0.25, 0.85, 0.75];

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
}

/// A point that is touched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Touch {
    pub body: usize,
    nodes: [u32; 3],
    weights: [f64; 3],
    /// It is carried by the hand.
    #[serde(with = "crate::field::numbers")]
    pub place_in_stylus: Point3<f64>,
    /// Where the hand has it now.
    #[serde(with = "crate::field::numbers")]
    pub place_in_room: Point3<f64>,
    /// N/m in the body's own metres; without one the point is where the hand is.
    spring: Option<f64>,
    /// The force of the longest arrow, N.
    full_n: f64,
}

value_types! {
    Touches => "touches",
    Taking => "taking",
    LoadValues => "loads",
}

/// What the loads of a body come to, for each of their columns; gravity in the room's axes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LoadValues(pub Vec<f64>);

impl Touches {
    /// What stylus `i` touches.
    pub fn of(&self, i: usize) -> Option<&Touch> {
        self.0.get(i)?.touch.as_ref()
    }

    /// The next frame's touches.
    pub fn step<'a>(
        &self,
        taking: Taking,
        styli: impl Iterator<Item = &'a Option<StylusState>>,
        hands: &HandState,
        bodies: &Bodies,
    ) -> Touches {
        let step = |(i, stylus): (usize, &Option<StylusState>)| {
            let last = self.0.get(i).copied().unwrap_or_default();
            let pressing = stylus.as_ref().filter(|s| s.pressed && !matches!(s.signal, Signal::Lost { .. }));
            let (Some(stylus), Some(pose)) = (pressing, hands.hands.room_from_stylus(i)) else {
                return Finger::default();
            };
            let is_free = hands.hands.grip(i).is_none() && taking != Taking::Elements;
            let touch = match last.was_pressed {
                true => last.touch,
                false => taken(stylus, &pose, taking, bodies),
            };
            let moved = |touch: Touch| Touch { place_in_room: pose * touch.place_in_stylus, ..touch };
            Finger { was_pressed: true, touch: touch.filter(|_| is_free).map(moved) }
        };
        Touches(styli.enumerate().map(step).collect())
    }

    /// The loads of body `b`.
    pub fn applied(&self, b: usize, body: &PlacedBody, loads: &LoadValues) -> AppliedLoads {
        let body_from_room = body.room_from_body.inverse();
        let mut coefficients = loads.0.clone();
        if body.has_gravity && coefficients.len() >= 3 {
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

/// The point at which a ray meets a body that takes forces, of all bodies as they were last seen.
fn taken(
    stylus: &StylusState,
    pose: &Isometry3<f64>,
    taking: Taking,
    bodies: &[PlacedBody],
) -> Option<Touch> {
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
    let is_free = |node: &u32| body.takes_forces.contains(node);
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
    let point = SurfacePoint { weights: weights.map(|w| w / sum), ..point };
    let place_in_room = body.room_from_body * point.places(body)[0];
    let softness = body.deformer.softness(&point.corners, &point.weights);
    let spring = (taking == Taking::Force).then(|| body.spring.unwrap_or(1.0 / softness));
    Some(Touch {
        body: hit.target,
        nodes: point.corners,
        weights: point.weights,
        place_in_stylus: pose.inverse() * place_in_room,
        place_in_room,
        spring,
        full_n: FULL_AT * body.ball.1 / softness,
    })
}

impl World {
    /// What hands take, where a body can be touched.
    pub fn taking(&self) -> Option<Taking> {
        self.fields.touch.as_ref().map(|touch| *self.graph.get(touch.taking))
    }

    /// For an overlay: what hands take beside control elements.
    pub fn taking_words(&self) -> &'static str {
        self.taking().map_or("", Taking::words)
    }

    /// What stylus `i` touches, and where that point is now.
    pub fn touched(&self, i: usize) -> Option<(&Touch, Point3<f64>)> {
        let touches = self.graph.get(self.fields.touch.as_ref()?.touches);
        let touch = touches.of(i)?;
        let before = (0..i).filter(|&j| touches.of(j).is_some_and(|other| other.body == touch.body)).count();
        let body = &self.bodies[touch.body];
        let result = body.deformer.point_results().get(before)?;
        Some((touch, body.room_from_body * Point3::from(result.place)))
    }

    /// Shows every touched point: a ball, the force on the hand as an arrow, and its newtons.
    pub(super) fn show_touches(&mut self) {
        let Some(fields) = &self.fields.touch else { return };
        let touches = self.graph.get(fields.touches).clone();
        let radius_m = self.stage.workspace.radius_m;
        let mut shown = vec![0; self.bodies.len()];
        for touch in touches.0.iter().filter_map(|finger| finger.touch) {
            let body = &self.bodies[touch.body];
            let Some(result) = body.deformer.point_results().get(shown[touch.body]) else { continue };
            shown[touch.body] += 1;
            let place = body.room_from_body * Point3::from(result.place);
            // The body pulls the hand back.
            let force = -(body.room_from_body.isometry.rotation * result.force);
            let radius = (BALL * radius_m) as f32;
            self.balls.push(Ball { center: place.cast(), radius_m: radius, color: COLOR });
            if let Some(arrow) = force_arrow(&place, &force, touch.full_n, LONGEST * radius_m) {
                self.arrows.push(Arrow {
                    from: arrow.from.cast(),
                    along: arrow.along.cast(),
                    radius_m: (SHAFT * radius_m) as f32,
                    color: COLOR,
                    through: true,
                });
            }
            let newtons = quantity(force.norm(), "N");
            let words = match touch.spring {
                Some(spring) => format!("{newtons}, by a spring of {}", quantity(spring, "N/m")),
                None => format!("{newtons}, held in place"),
            };
            self.plates.push(Plate::of(Anchor::Place(place.into()), words));
        }
    }

    /// Sets the load of this name, as `tube.squeeze` or `squeeze`; false where no body has one.
    pub fn load_named(&self, name: &str) -> Option<(usize, usize)> {
        let of_body = |(b, body): (usize, &PlacedBody)| {
            let own = name.strip_prefix(&format!("{}.", body.deformer.body)).unwrap_or(name);
            let mut column = 0;
            for meta in body.deformer.load_metas() {
                if meta.name == own {
                    return Some((b, column));
                }
                column += meta.columns;
            }
            None
        };
        self.bodies.iter().enumerate().find_map(of_body)
    }

    /// What a column of the loads of body `b` comes to.
    pub fn load(&self, b: usize, column: usize) -> Option<f64> {
        self.graph.get(self.fields.bodies.get(b)?.loads?).0.get(column).copied()
    }

    pub(super) fn set_load(&mut self, b: usize, column: usize, value: f64) {
        let Some(field) = self.fields.bodies.get(b).and_then(|body| body.loads) else { return };
        let mut loads = self.graph.get(field).clone();
        if let Some(place) = loads.0.get_mut(column).filter(|_| value.is_finite()) {
            *place = value;
            self.put(field, loads);
        }
    }

    pub(super) fn set_taking(&mut self, taking: Taking) {
        if let Some(field) = self.fields.touch.as_ref().map(|touch| touch.taking) {
            self.put(field, taking);
        }
    }

    /// Every hand lets go of the point that it touches; a button that is down takes one again.
    pub(super) fn let_go_of_points(&mut self) {
        if let Some(field) = self.fields.touch.as_ref().map(|touch| touch.touches) {
            self.graph.restore(field, Touches::default());
        }
    }
}
