//! The point of a surface that is nearest to a place: a triangle, and how much of each corner.

use nalgebra::Vector3;

/// Corners, their shares, and how far the point is from the place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    pub corners: [u32; 3],
    pub weights: [f64; 3],
    pub away: f64,
}

/// The point nearest to `place` of triangles whose corners are where `at` says; `None` where none has an area.
pub fn nearest_point(
    triangles: &[[u32; 3]],
    at: &dyn Fn(u32) -> Vector3<f64>,
    place: &Vector3<f64>,
) -> Option<NearestPoint> {
    let of = |&corners: &[u32; 3]| {
        let (weights, away) = nearest_in(&corners.map(at), place)?;
        Some(NearestPoint { corners, weights, away })
    };
    triangles.iter().filter_map(of).min_by(|a, b| a.away.total_cmp(&b.away))
}

/// Weights of the corners in the point of a triangle that is nearest to a place, and its distance; `None` without area.
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
