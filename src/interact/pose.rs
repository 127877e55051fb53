//! Converts between a control element's matrix in the room and its pose in the body.
//!
//! In: room_from_body (rotation, uniform scale, translation) and the element's rest origin o in the body. Out:
//! T and M of x ↦ o + T + M (x - o), or the matrix again. f64; none of it is done per vertex.

use nalgebra::{Matrix3, Matrix4, Point3, Similarity3, Vector3};

/// The element's matrix in the room: from the frame that has its origin at o and the body's axes at rest.
///
/// room_from_element = room_from_body · [M | o + T].
pub fn room_from_element(
    room_from_body: &Similarity3<f64>,
    origin_in_body: &Point3<f64>,
    translation: &Vector3<f64>,
    matrix: &Matrix3<f64>,
) -> Matrix4<f64> {
    let mut body_from_element = matrix.to_homogeneous();
    let place = origin_in_body.coords + translation;
    body_from_element.fixed_view_mut::<3, 1>(0, 3).copy_from(&place);
    room_from_body.to_homogeneous() * body_from_element
}

/// T (metres of the body) and M of an element whose matrix in the room is `room_from_element`; the inverse of
/// [`room_from_element`]. `None` if a result is not finite.
pub fn control_pose_in_body(
    room_from_element: &Matrix4<f64>,
    room_from_body: &Similarity3<f64>,
    origin_in_body: &Point3<f64>,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let body_from_element = room_from_body.inverse().to_homogeneous() * room_from_element;
    let matrix: Matrix3<f64> = body_from_element.fixed_view::<3, 3>(0, 0).into_owned();
    let place: Vector3<f64> = body_from_element.fixed_view::<3, 1>(0, 3).into_owned();
    let translation = place - origin_in_body.coords;
    let is_finite = matrix.iter().chain(translation.iter()).all(|x| x.is_finite());
    is_finite.then_some((translation, matrix))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn placed() -> Similarity3<f64> {
        Similarity3::new(Vector3::new(0.3, 1.2, -0.4), Vector3::new(0.2, -0.9, 0.5), 0.35)
    }

    #[test]
    fn there_and_back_is_the_same_pose() {
        let origin = Point3::new(2.0, -1.0, 0.5);
        let translation = Vector3::new(0.1, 0.2, -0.3);
        let matrix = Matrix3::new(1.1, 0.2, 0.0, -0.3, 0.9, 0.1, 0.4, 0.0, 1.3);
        let in_room = room_from_element(&placed(), &origin, &translation, &matrix);
        let (back_translation, back_matrix) = control_pose_in_body(&in_room, &placed(), &origin).unwrap();
        assert!((back_translation - translation).norm() < 1e-14);
        assert!((back_matrix - matrix).norm() < 1e-14);
        // The definition: a rest point x of the body goes to o + T + M (x - o).
        let x = Point3::new(2.5, -1.5, 0.75);
        let moved = origin + translation + matrix * (x - origin);
        let shown = in_room * (x - origin).push(1.0);
        assert!((shown.xyz() - (placed() * moved).coords).norm() < 1e-14);
    }

    #[test]
    fn a_rotation_in_the_room_about_a_far_point_gives_the_analytic_pose() {
        let origin = Point3::new(2.0, -1.0, 0.5);
        let rest = room_from_element(&placed(), &origin, &Vector3::zeros(), &Matrix3::identity());
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.3, 0.8));
        let pivot = Point3::new(-0.7, 0.4, 2.0);
        let motion = nalgebra::Isometry3::rotation_wrt_point(turn, pivot);
        let (translation, matrix) =
            control_pose_in_body(&(motion.to_homogeneous() * rest), &placed(), &origin).unwrap();
        // In the body the rotation's axis is R⁻¹·axis and its pivot the body's point at that place.
        let body_turn = placed().isometry.rotation.inverse() * turn * placed().isometry.rotation;
        let body_pivot = placed().inverse() * pivot;
        assert!((matrix - body_turn.to_rotation_matrix().matrix()).norm() < 1e-13);
        let expected = body_pivot + body_turn * (origin - body_pivot) - origin;
        assert!((translation - expected).norm() < 1e-13, "{translation} is not {expected}");
    }

    #[test]
    fn what_is_not_finite_is_no_pose() {
        let mut matrix = Matrix4::identity();
        matrix[(1, 2)] = f64::NAN;
        assert_eq!(control_pose_in_body(&matrix, &placed(), &Point3::origin()), None);
    }
}
