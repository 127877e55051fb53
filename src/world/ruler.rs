//! A ruler between two points of surfaces: it follows the material, and measures their distance now and at rest.
//!
//! In: places on surfaces. Out: their distance, in words. [`measure`](super::measure) lays and draws it.

use super::body::PlacedBody;
use crate::base::quantity::quantity;
use crate::deform::{NearestPoint, nearest_point};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A ruler between two points of the material; up to two ends.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ruler {
    pub(super) ends: Vec<SurfacePoint>,
}

/// A point of a body's surface: a triangle, and how much of each corner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfacePoint {
    pub body: usize,
    /// Nodes of the surface.
    pub corners: [u32; 3],
    pub weights: [f64; 3],
}

/// The lengths that a ruler measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RulerLengths {
    /// m: of the body itself between points of one body, in the room between two bodies.
    pub now_m: f64,
    pub rest_m: f64,
    pub is_of_one_body: bool,
}

impl SurfacePoint {
    /// The point of the surface that is nearest to a place in the body's frame.
    pub(super) fn nearest(b: usize, body: &PlacedBody, place: &Vector3<f64>) -> Option<SurfacePoint> {
        let positions = body.deformer.positions();
        let motion = body.deformer.body_from_surface();
        let at =
            |node: u32| (motion * Point3::from(Vector3::from(positions[node as usize]).cast::<f64>())).coords;
        let NearestPoint { corners, weights, .. } = nearest_point(body.deformer.triangles(), &at, place)?;
        Some(SurfacePoint { body: b, corners, weights })
    }

    /// Places of the point now and at rest, in the body's frame.
    pub(super) fn places(&self, body: &PlacedBody) -> [Point3<f64>; 2] {
        let (mut now, mut rest) = (Vector3::zeros(), Vector3::zeros());
        for (node, weight) in self.corners.iter().zip(self.weights) {
            let at = Vector3::from(body.deformer.rest()[*node as usize]).cast::<f64>();
            rest += at * weight;
            now += (at + body.deformer.displacement(*node as usize)) * weight;
        }
        [now.into(), rest.into()]
    }
}

impl RulerLengths {
    /// `152 mm, at rest 150 mm: +2.00 mm (+1.33 %)`.
    pub(super) fn words(&self) -> String {
        let RulerLengths { now_m, rest_m, is_of_one_body } = *self;
        let change = now_m - rest_m;
        let [now, rest] = [now_m, rest_m].map(|m| quantity(m, "m"));
        let sign = if change >= 0.0 { "+" } else { "" };
        let part = match rest_m > 0.0 {
            true => format!(" ({:+.2} %)", 100.0 * change / rest_m),
            false => String::new(),
        };
        let whose = if is_of_one_body { "" } else { " in the room" };
        format!("{now}{whose}, at rest {rest}: {sign}{}{part}", quantity(change, "m"))
    }
}
