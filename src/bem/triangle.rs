//! A flat triangle, and what it and another one pull each other by.

use super::potentials::{Frame, PULL, Point, Points};
use super::rules::{SEVEN, THREE};
use nalgebra::Vector3;

/// A flat triangle, counter-clockwise as seen from outside.
#[derive(Clone, Debug)]
pub struct Triangle {
    pub corners: [Vector3<f64>; 3],
    pub centre: Vector3<f64>,
    pub area: f64,
    /// Radius of the circle about the centre that holds the corners.
    pub radius: f64,
    /// n × ∇φ_q of each corner.
    pub curls: [Vector3<f64>; 3],
    pub frame: Frame,
    /// Points of Gauss' rules.
    pub three: [Point; 3],
    pub seven: Points<8>,
}

/// ∫∫ 1/r, and of the symmetric ∫∫ r rᵀ/r³ the parts xx, xy, xz, yy, yz, zz.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pull(pub [f64; PULL]);

impl Pull {
    /// The sum with another, times `weight`.
    pub fn plus(mut self, other: &Pull, weight: f64) -> Pull {
        self.0.iter_mut().zip(&other.0).for_each(|(own, other)| *own += weight * other);
        self
    }
}

impl Triangle {
    /// `None` for one without area.
    pub fn new(corners: [Vector3<f64>; 3]) -> Option<Triangle> {
        let [a, b, c] = corners;
        let across = (b - a).cross(&(c - a));
        let area = across.norm() / 2.0;
        let normal = across.try_normalize(0.0)?;
        let centre = (a + b + c) / 3.0;
        let radius = corners.iter().map(|x| (x - centre).norm()).fold(0.0, f64::max);
        let behind: [Vector3<f64>; 3] = std::array::from_fn(|q| corners[(q + 1) % 3] - corners[q]);
        let along = behind.map(|edge| edge.normalize());
        let curls: [Vector3<f64>; 3] = std::array::from_fn(|q| -behind[(q + 1) % 3] / (2.0 * area));
        let frame = Frame {
            corners: corners.map(Into::into),
            centre: centre.into(),
            normal: normal.into(),
            along: along.map(Into::into),
            out: along.map(|along| along.cross(&normal).into()),
            lengths: behind.map(|edge| edge.norm()),
            slopes: curls.map(|curl| curl.cross(&normal).into()),
        };
        let three = THREE.map(|[p, q, r]| (a * p + b * q + c * r).into());
        let seven = SEVEN.points(&corners);
        let is_sound = area > 0.0 && curls.iter().flatten().all(|x: &f64| x.is_finite());
        is_sound.then_some(Triangle { corners, centre, area, radius, curls, frame, three, seven })
    }
}
