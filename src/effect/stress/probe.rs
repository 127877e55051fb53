//! The place on a deformed surface that a ray meets first.

use nalgebra::{Point3, Vector3};

/// A triangle that is met, and the weights of its corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met {
    pub triangle: usize,
    pub weights: [f64; 3],
    /// In lengths of the ray's direction.
    pub distance: f64,
}

/// The nearest crossing (Möller and Trumbore, Journal of Graphics Tools 2, 1997, 21-28), from either side.
pub fn first_met(
    from: &Point3<f64>,
    along: &Vector3<f64>,
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Option<Met> {
    let mut nearest: Option<Met> = None;
    for (triangle, corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|node| Vector3::from(positions[node as usize]).cast::<f64>());
        let (ab, ac, to) = (b - a, c - a, from.coords - a);
        let p = along.cross(&ac);
        let determinant = ab.dot(&p);
        let q = to.cross(&ab);
        let [v, w, distance] = [to.dot(&p), along.dot(&q), ac.dot(&q)].map(|part| part / determinant);
        let is_met = v >= 0.0 && w >= 0.0 && v + w <= 1.0 && distance > 0.0 && distance.is_finite();
        if is_met && nearest.is_none_or(|met| distance < met.distance) {
            nearest = Some(Met { triangle, weights: [1.0 - v - w, v, w], distance });
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_the_nearer_of_two_triangles_where_it_crosses_it() {
        let positions = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [4.0, 0.0, 1.0],
            [0.0, 4.0, 1.0],
        ];
        let triangles = [[3, 4, 5], [0, 1, 2]];
        let ray = |x: f64, y: f64| {
            first_met(&Point3::new(x, y, -2.0), &Vector3::new(0.0, 0.0, 0.5), &positions, &triangles)
        };
        let met = ray(0.25, 0.5).unwrap();
        assert_eq!((met.triangle, met.weights, met.distance), (1, [0.25, 0.25, 0.5], 4.0));
        assert_eq!(ray(1.0, 1.0).unwrap().triangle, 0, "past the first");
        assert_eq!(ray(5.0, 5.0), None);
        assert_eq!(
            first_met(&Point3::new(0.2, 0.2, 2.0), &Vector3::z(), &positions, &triangles),
            None,
            "behind"
        );
    }
}
