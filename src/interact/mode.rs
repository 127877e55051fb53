//! Constraint modes: which part of the hands' motion a control element follows.
//!
//! In: the similarity that the hands describe in the room, the element's matrix at the grab, the held point. Out: the
//! element's matrix. The six modes are the joints of a mechanism:
//!
//! | | no axis | along an axis |
//! |---|---|---|
//! | free | rigid; two hands scale too | slides along it and twists about it (cylindrical) |
//! | translate | moved, not turned (Cartesian) | slides along it (prismatic) |
//! | rotate | turned about its origin (spherical) | twists about it (revolute) |

pub use crate::stage::tracking::Axis;
use nalgebra::{Matrix3, Matrix4, Point3, Similarity3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The constraint on the motion of held elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mode {
    pub freedom: Freedom,
    pub axis: Option<(Axis, AxisOf)>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Freedom {
    #[default]
    Free,
    Translate,
    Rotate,
}

/// Whose axis: the body's is fixed, the element's own turns with the element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisOf {
    Body,
    Element,
}

impl Mode {
    pub const FREE: Mode = Mode { freedom: Freedom::Free, axis: None };

    /// The mode after the key of an axis: first the body's axis, at the second press the element's own, at the third none.
    pub fn along(self, axis: Axis) -> Mode {
        let axis = match self.axis {
            Some((current, AxisOf::Body)) if current == axis => Some((axis, AxisOf::Element)),
            Some((current, AxisOf::Element)) if current == axis => None,
            _ => Some((axis, AxisOf::Body)),
        };
        Mode { axis, ..self }
    }

    /// The mode after a click of the second button, in the cycle free, translate, rotate, then along and about the body's x,
    /// y and z.
    pub fn next(self) -> Mode {
        let free_along = |axis| Mode { freedom: Freedom::Free, axis: Some((axis, AxisOf::Body)) };
        let only = |freedom| Mode { freedom, axis: None };
        match (self.freedom, self.axis.map(|(axis, _)| axis)) {
            (Freedom::Free, None) => only(Freedom::Translate),
            (Freedom::Translate, None) => only(Freedom::Rotate),
            (Freedom::Rotate, None) => free_along(Axis::X),
            (_, Some(Axis::X)) => free_along(Axis::Y),
            (_, Some(Axis::Y)) => free_along(Axis::Z),
            (_, Some(Axis::Z)) => Mode::FREE,
        }
    }

    /// Words for an overlay: `free`, `translate along the body's x`.
    pub fn name(self) -> String {
        let what = match (self.freedom, self.axis) {
            (Freedom::Free, None) => "free",
            (Freedom::Free, Some(_)) => "slide along and twist about",
            (Freedom::Translate, None) => "translate",
            (Freedom::Translate, Some(_)) => "translate along",
            (Freedom::Rotate, None) => "rotate",
            (Freedom::Rotate, Some(_)) => "rotate about",
        };
        let whose = |of| if of == AxisOf::Body { "the body's" } else { "its own" };
        let letter = |axis| ["x", "y", "z"][axis as usize];
        self.axis
            .map_or_else(|| what.to_owned(), |(axis, of)| format!("{what} {} {}", whose(of), letter(axis)))
    }

    /// The unit axis in the room for an element with this matrix; `None` in a mode without an axis, or if the element's own
    /// axis has no length.
    pub fn axis_in_room(
        self,
        room_from_body: &Similarity3<f64>,
        room_from_element: &Matrix4<f64>,
    ) -> Option<Unit<Vector3<f64>>> {
        let (axis, of) = self.axis?;
        let direction = match of {
            AxisOf::Body => room_from_body.isometry.rotation * Vector3::ith(axis as usize, 1.0),
            AxisOf::Element => room_from_element.fixed_view::<3, 1>(0, axis as usize).into_owned(),
        };
        Unit::try_new(direction, 1e-12)
    }

    /// The element's matrix after this mode's part of the hands' `motion` since the grab:
    ///
    /// free: motion · E. Otherwise, with o the element's origin, p the held point, d = motion(p) - p, R the motion's
    /// rotation, a the axis:
    /// the linear part becomes R E, twist(R, a) E or stays, and o becomes o + d, o + a (a·d) or stays.
    ///
    /// `axis` is [`Mode::axis_in_room`] at the grab; if the mode needs one and there is none, the element stays.
    pub fn take(
        self,
        motion: &Similarity3<f64>,
        element: &Matrix4<f64>,
        held: &Point3<f64>,
        axis: Option<Unit<Vector3<f64>>>,
    ) -> Matrix4<f64> {
        let shift = motion * held - held;
        let rotation = motion.isometry.rotation;
        let (shift, rotation) = match (self.axis, axis) {
            (None, _) if self.freedom == Freedom::Free => return motion.to_homogeneous() * element,
            (None, _) => (shift, rotation),
            (Some(_), Some(axis)) => (axis.into_inner() * axis.dot(&shift), twist(&rotation, &axis)),
            (Some(_), None) => return *element,
        };
        let mut moved = *element;
        if self.freedom != Freedom::Rotate {
            let place: Vector3<f64> = element.fixed_view::<3, 1>(0, 3).into_owned();
            moved.fixed_view_mut::<3, 1>(0, 3).copy_from(&(place + shift));
        }
        if self.freedom != Freedom::Translate {
            let linear: Matrix3<f64> = element.fixed_view::<3, 3>(0, 0).into_owned();
            moved.fixed_view_mut::<3, 3>(0, 0).copy_from(&(rotation.to_rotation_matrix() * linear));
        }
        moved
    }
}

/// The part of a rotation about `axis`: R = swing · twist with the swing's axis across. Where R is half a turn about
/// an axis across, no twist is defined and it is none.
pub fn twist(rotation: &UnitQuaternion<f64>, axis: &Unit<Vector3<f64>>) -> UnitQuaternion<f64> {
    let along = axis.dot(&rotation.imag());
    UnitQuaternion::from_axis_angle(axis, 2.0 * along.atan2(rotation.w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;

    fn element() -> Matrix4<f64> {
        Matrix4::new_translation(&Vector3::new(0.5, 1.0, -0.25))
            * UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9).to_homogeneous()
            * Matrix4::new_nonuniform_scaling(&Vector3::new(1.0, 2.0, 0.5))
    }

    fn motion() -> Similarity3<f64> {
        Similarity3::from_parts(
            Translation3::new(0.1, -0.2, 0.3),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.7, -0.1)),
            1.0,
        )
    }

    const HELD: Point3<f64> = Point3::new(0.6, 1.1, -0.2);

    fn linear(matrix: &Matrix4<f64>) -> Matrix3<f64> {
        matrix.fixed_view::<3, 3>(0, 0).into_owned()
    }

    fn place(matrix: &Matrix4<f64>) -> Vector3<f64> {
        matrix.fixed_view::<3, 1>(0, 3).into_owned()
    }

    fn taken(mode: Mode) -> Matrix4<f64> {
        let body = Similarity3::new(Vector3::x(), Vector3::new(0.0, 0.5, 0.0), 0.3);
        mode.take(&motion(), &element(), &HELD, mode.axis_in_room(&body, &element()))
    }

    #[test]
    fn free_takes_all_and_the_held_place_stays_in_the_hand() {
        let moved = taken(Mode::FREE);
        assert!((moved - motion().to_homogeneous() * element()).norm() < 1e-15);
        let in_element = element().try_inverse().unwrap().transform_point(&HELD);
        assert!((moved.transform_point(&in_element) - motion() * HELD).norm() < 1e-14);
    }

    #[test]
    fn translate_moves_by_the_held_places_way_and_rotate_turns_about_the_origin() {
        let moved = taken(Mode { freedom: Freedom::Translate, axis: None });
        assert_eq!(linear(&moved), linear(&element()));
        assert!((place(&moved) - place(&element()) - (motion() * HELD - HELD)).norm() < 1e-15);
        let turned = taken(Mode { freedom: Freedom::Rotate, axis: None });
        assert_eq!(place(&turned), place(&element()));
        let expected = motion().isometry.rotation.to_rotation_matrix() * linear(&element());
        assert!((linear(&turned) - expected).norm() < 1e-15);
    }

    #[test]
    fn along_an_axis_only_its_part_of_the_way_and_of_the_turn_counts() {
        let across = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.5, 0.0)) * Vector3::x();
        let axis = Unit::new_normalize(across);
        for (freedom, slides, turns) in
            [(Freedom::Free, true, true), (Freedom::Translate, true, false), (Freedom::Rotate, false, true)]
        {
            let moved = taken(Mode { freedom, axis: Some((Axis::X, AxisOf::Body)) });
            let way = if slides { across * across.dot(&(motion() * HELD - HELD)) } else { Vector3::zeros() };
            assert!((place(&moved) - place(&element()) - way).norm() < 1e-14, "{freedom:?}");
            let turn = twist(&motion().isometry.rotation, &axis).to_rotation_matrix().into_inner();
            let turn = if turns { turn } else { Matrix3::identity() };
            assert!((linear(&moved) - turn * linear(&element())).norm() < 1e-14, "{freedom:?}");
        }
        let own = taken(Mode { freedom: Freedom::Translate, axis: Some((Axis::Y, AxisOf::Element)) });
        let way = place(&own) - place(&element());
        assert!(way.cross(&linear(&element()).column(1)).norm() < 1e-14 && way.norm() > 0.01);
    }

    #[test]
    fn a_twist_is_the_whole_turn_about_its_axis_and_nothing_across() {
        let z = Vector3::z_axis();
        for angle in [-3.0, -0.5, 0.0, 1.0, 3.1] {
            let about = UnitQuaternion::from_axis_angle(&z, angle);
            assert!(twist(&about, &z).angle_to(&about) < 1e-12);
            let swing = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.8);
            assert!(twist(&(swing * about), &z).angle_to(&about) < 1e-12);
        }
        let half_across = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        assert!(twist(&half_across, &z).coords.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn keys_of_axes_go_from_the_bodys_to_the_elements_own_to_none_and_clicks_go_round() {
        let body = Mode::FREE.along(Axis::Y);
        assert_eq!(body.axis, Some((Axis::Y, AxisOf::Body)));
        assert_eq!(body.along(Axis::Y).axis, Some((Axis::Y, AxisOf::Element)));
        assert_eq!(body.along(Axis::Y).along(Axis::Y), Mode::FREE);
        assert_eq!(body.along(Axis::Y).along(Axis::X).axis, Some((Axis::X, AxisOf::Body)));
        let round: Vec<Mode> =
            std::iter::successors(Some(Mode::FREE), |mode| Some(mode.next())).take(7).collect();
        assert_eq!(round[6], Mode::FREE);
        assert!((1..6).all(|i| round[i] != Mode::FREE));
        assert_eq!(body.along(Axis::Y).name(), "slide along and twist about its own y");
    }
}
