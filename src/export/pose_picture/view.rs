//! Chooses the best view of a moved body: with its length to the right and its motion upwards or downwards in the picture.

use crate::base::extent::bounding_box;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

/// Directions to the right, upwards and towards the eye: rows of a rotation.
pub struct View(Matrix3<f64>);

/// Cosine from which a direction is taken for the nearest axis of the body.
const NEAR_AXIS: f64 = 0.9;
/// Angle of the eye above the picture plane's normal, rad.
const ABOVE: f64 = 0.22;
/// Angle of the eye to the side, rad.
const ASIDE: f64 = 0.18;

/// The largest extent, m; `None` without one.
pub fn size(places: &[Vector3<f64>]) -> Option<f64> {
    let (low, high) = bounding_box(places);
    let size = (high - low).amax();
    (size.is_finite() && size > 0.0).then_some(size)
}

fn spread(of: impl Iterator<Item = Vector3<f64>>) -> nalgebra::SymmetricEigen<f64, nalgebra::U3> {
    of.map(|x| x * x.transpose()).sum::<Matrix3<f64>>().symmetric_eigen()
}

/// An axis of the body in place of a direction near it, pointing the way in which its largest part is positive.
fn tidy(direction: Vector3<f64>) -> Vector3<f64> {
    let (axis, largest) = (direction.iamax(), direction.amax());
    let direction =
        if largest > NEAR_AXIS { Vector3::ith(axis, direction[axis].signum()) } else { direction };
    if direction[axis] < 0.0 { -direction } else { direction }
}

impl View {
    pub fn new(rest: &[Vector3<f64>], moved: &[Vector3<f64>]) -> View {
        let mean = rest.iter().sum::<Vector3<f64>>() / rest.len().max(1) as f64;
        let shape = spread(rest.iter().map(|x| x - mean));
        let motion = spread(moved.iter().copied());
        let column = |of: &nalgebra::SymmetricEigen<f64, nalgebra::U3>, k: usize| -> Vector3<f64> {
            of.eigenvectors.column(k).into()
        };
        let long = tidy(column(&shape, shape.eigenvalues.imax()));
        let way = column(&motion, motion.eigenvalues.imax());
        let across = way - long * way.dot(&long);
        // Of a body that is pulled or at rest, its flat side.
        let upwards = match across.norm() > 0.2 && motion.eigenvalues.max() > 0.0 {
            true => across,
            false => {
                let mut order = [0, 1, 2];
                order.sort_by(|a, b| shape.eigenvalues[*b].total_cmp(&shape.eigenvalues[*a]));
                let middle = column(&shape, order[1]);
                middle - long * middle.dot(&long)
            }
        };
        let any = Vector3::ith(long.iamin(), 1.0);
        let up = tidy(upwards.try_normalize(1e-9).unwrap_or_else(|| long.cross(&any).normalize()));
        let up = (up - long * up.dot(&long)).normalize();
        let towards = long.cross(&up);
        let plane = Matrix3::from_rows(&[long.transpose(), up.transpose(), towards.transpose()]);
        let tilt = Rotation3::from_axis_angle(&Unit::new_unchecked(Vector3::x()), ABOVE)
            * Rotation3::from_axis_angle(&Unit::new_unchecked(Vector3::y()), -ASIDE);
        View(tilt.matrix() * plane)
    }

    pub fn turned(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.0 * place
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate in x and y whose end is pushed along z: the motion is seen at nearly its full length.
    #[test]
    fn the_motion_lies_in_the_picture() {
        let rest: Vec<Vector3<f64>> =
            (0..60).map(|i| Vector3::new(f64::from(i % 10), 0.5 * f64::from(i / 10), 0.0)).collect();
        for way in [Vector3::z(), Vector3::y(), Vector3::new(0.0, -0.6, 0.8), Vector3::x(), Vector3::zeros()]
        {
            let moved: Vec<Vector3<f64>> = rest.iter().map(|x| way * x.x * x.x).collect();
            let view = View::new(&rest, &moved);
            let rows = view.0;
            assert!(
                (rows * rows.transpose() - Matrix3::identity()).amax() < 1e-12 && rows.determinant() > 0.0
            );
            let seen = view.turned(&way);
            assert!(seen.xy().norm() >= 0.95 * way.norm(), "{way}");
            assert!(view.turned(&Vector3::x()).x > 0.95, "its length is to the right");
        }
    }
}
