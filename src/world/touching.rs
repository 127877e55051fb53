//! Touched points in a world: how they are drawn, and the commands that set loads and the grip of hands.
//!
//! In: [`Touches`] of a frame. Out: a ball, an arrow and the newtons of each touched point; fields that are set.

use super::body::PlacedBody;
use super::force_mark::{COLOR, mark_force};
use super::running::World;
use super::touch::{Touch, Touches};
use crate::base::plates::{Anchor, Plate};
use crate::base::quantity::quantity;
use crate::interact::SurfaceGrip;
use crate::render::{Ball, Drawable};
use nalgebra::Point3;

/// Radius of the ball at a touched point against the workspace's.
const BALL: f64 = 0.018;

impl World {
    /// The kind of thing that hands take, if a body can be touched.
    pub fn taking(&self) -> Option<SurfaceGrip> {
        self.fields.touch.as_ref().map(|touch| *self.graph.get(touch.taking))
    }

    /// Words for an overlay about what hands take beside control elements.
    pub fn taking_words(&self) -> &'static str {
        self.taking().map_or("", SurfaceGrip::words)
    }

    /// The touch of stylus `i`, and where its point is now.
    pub fn touched(&self, i: usize) -> Option<(&Touch, Point3<f64>)> {
        let touches = self.graph.get(self.fields.touch.as_ref()?.touches);
        let touch = touches.get(i)?;
        let before = (0..i).filter(|&j| touches.get(j).is_some_and(|other| other.body == touch.body)).count();
        let body = &self.bodies[touch.body];
        let result = body.deformer.point_results().get(before)?;
        Some((touch, body.room_from_body * Point3::from(result.place)))
    }

    /// Shows every touched point: a ball, the force on the hand as an arrow, and its newtons.
    pub(super) fn show_touches(&mut self) {
        let Some(fields) = &self.fields.touch else { return };
        let touches = self.graph.get(fields.touches).clone();
        let radius_m = self.assets.stage.workspace.radius_m;
        for touch in touches.coming() {
            let words = "solving for this point".to_owned();
            self.frame.draw(Drawable::Plate(Plate::new(Anchor::Place(touch.place_in_room.into()), words)));
        }
        let mut shown = vec![0; self.bodies.len()];
        for touch in touches.all() {
            let body = &self.bodies[touch.body];
            let Some(result) = body.deformer.point_results().get(shown[touch.body]) else { continue };
            shown[touch.body] += 1;
            let place = body.room_from_body * Point3::from(result.place);
            // The body pulls the hand back.
            let force = -(body.room_from_body.isometry.rotation * result.force);
            let radius = (BALL * radius_m) as f32;
            self.frame.draw(Drawable::Ball(Ball { center: place.cast(), radius_m: radius, color: COLOR }));
            let newtons = format!("{}, error unknown", quantity(force.norm(), "N"));
            let words = match touch.spring {
                Some(spring) => format!("{newtons}; by a spring of {}", quantity(spring, "N/m")),
                None => format!("{newtons}; held in place"),
            };
            mark_force((&place, &force), touch.full_n, words, (radius_m, &mut self.frame));
        }
    }

    /// The body that has the load of this name, as `tube.squeeze` or `squeeze`, and the load's first column.
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

    /// The value of a column of the loads of body `b`.
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

    pub(super) fn set_taking(&mut self, taking: SurfaceGrip) {
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
