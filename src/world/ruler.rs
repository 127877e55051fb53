//! A ruler between two points of surfaces: it follows the material, and tells their distance now and at rest.
//!
//! In: places on surfaces. Out: their distance, in words. [`measure`](super::measure) lays and draws it.

use super::body::PlacedBody;
use crate::base::quantity::quantity;
use nalgebra::{Point3, Vector3};

/// Up to two points of the material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ruler {
    pub(super) ends: Vec<SurfacePoint>,
}

/// A point of a body's surface: a triangle, and how much of each corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    pub body: usize,
    /// Nodes of the surface.
    pub corners: [u32; 3],
    pub weights: [f64; 3],
}

/// What a ruler tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
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
        let of = |&corners: &[u32; 3]| {
            let (weights, away) = nearest_in(&corners.map(at), place)?;
            Some((away, SurfacePoint { body: b, corners, weights }))
        };
        let found = body.deformer.triangles().iter().filter_map(of);
        found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, point)| point)
    }

    /// Where the point is now and was at rest, in the body's frame.
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

/// How much of each corner the point of a triangle has that is nearest to a place, and how far it is; `None` without area.
fn nearest_in(corners: &[Vector3<f64>; 3], place: &Vector3<f64>) -> Option<([f64; 3], f64)> {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a));
    let area = normal.norm_squared();
    if !(area.is_finite() && area > 0.0) {
        return None;
    }
    let share =
        |from: &Vector3<f64>, to: &Vector3<f64>| (to - from).cross(&(place - from)).dot(&normal) / area;
    // A ray that hits an edge may come to lie beside it by rounding.
    let shares = [share(b, c), share(c, a), share(a, b)].map(|share| share.max(0.0));
    let weights = shares.map(|share| share / shares.iter().sum::<f64>());
    let nearest = a * weights[0] + b * weights[1] + c * weights[2];
    Some((weights, (nearest - place).norm()))
}

impl Measured {
    /// `152 mm, at rest 150 mm: +2.00 mm (+1.33 %)`.
    pub(super) fn words(&self) -> String {
        let Measured { now_m, rest_m, is_of_one_body } = *self;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_beside_an_edge_belongs_to_the_edge() {
        let corners = [Vector3::zeros(), Vector3::x(), Vector3::y()];
        let (weights, away) = nearest_in(&corners, &Vector3::new(0.5, -1e-9, 0.2)).unwrap();
        assert!((weights[0] - 0.5).abs() < 1e-6 && weights[2] == 0.0 && (away - 0.2).abs() < 1e-6);
        assert_eq!(nearest_in(&[Vector3::x(); 3], &Vector3::zeros()), None);
    }
}
