//! The dragger: while the button is held, an element's matrix follows the stylus' matrix rigidly.
//!
//! In: a stylus and what its ray hits. Out: the matrix of the element that is held. Every matrix is computed
//! from those at the grab, never from the last one, so that nothing drifts.

use super::{Drag, Hit};
use crate::track::{HeldPose, StylusState};
use nalgebra::{Isometry3, Matrix4};

/// One stylus' grip on one control element. A new one is `Dragger::default()`.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dragger {
    /// The stylus' last usable pose, and the number of those that were not.
    pub stylus: HeldPose,
    hold: Option<Hold>,
    was_pressed: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Hold {
    target: usize,
    #[serde(with = "crate::field::numbers")]
    stylus_from_room: Isometry3<f64>,
    #[serde(with = "crate::field::numbers")]
    room_from_element: Matrix4<f64>,
}

impl Dragger {
    /// Takes the stylus as it is now. At the press of the button the element of `hit` is taken hold of, with the
    /// matrix that `room_from_target` tells of it; while the button is held,
    ///
    /// room_from_element(t) = stylus(t) · stylus(grab)⁻¹ · room_from_element(grab),
    ///
    /// whatever scale or shear that matrix has. On release the element stays where it is: the last [`Drag`]
    /// stands. A press beside everything grabs nothing until the next press. A pose that is not usable counts as
    /// the last usable one; a press that comes with it waits for one that is.
    pub fn update(
        &mut self,
        stylus: &StylusState,
        hit: Option<&Hit>,
        room_from_target: impl Fn(usize) -> Matrix4<f64>,
    ) -> Option<Drag> {
        let is_usable = self.stylus.update(&stylus.room_from_stylus);
        if !stylus.pressed {
            (self.hold, self.was_pressed) = (None, false);
            return None;
        }
        let room_from_stylus = self.stylus.last?;
        if is_usable && !self.was_pressed {
            self.was_pressed = true;
            self.hold = hit.map(|hit| Hold {
                target: hit.target,
                stylus_from_room: room_from_stylus.inverse(),
                room_from_element: room_from_target(hit.target),
            });
        }
        self.hold.map(|hold| {
            let motion = (room_from_stylus * hold.stylus_from_room).to_homogeneous();
            Drag { target: hold.target, room_from_element: motion * hold.room_from_element }
        })
    }

    /// The element that is held now.
    pub fn held(&self) -> Option<usize> {
        self.hold.map(|hold| hold.target)
    }

    /// Lets go without a release, as when the element's body was taken away; the next press grabs again.
    pub fn let_go(&mut self) {
        self.hold = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

    const HIT: Hit = Hit {
        target: 3,
        point_in_room: Point3::new(0.0, 0.0, 0.0),
        distance_m: 1.0,
        normal_in_room: Vector3::new(0.0, 0.0, 1.0),
        is_near: false,
    };

    fn stylus(pose: Isometry3<f32>, pressed: bool) -> StylusState {
        StylusState { room_from_stylus: pose, pressed, ..Default::default() }
    }

    fn element() -> Matrix4<f64> {
        Matrix4::new_translation(&Vector3::new(0.5, 1.0, -0.25))
            * Matrix4::new_nonuniform_scaling(&Vector3::new(1.0, 2.0, 0.5))
    }

    fn pose(t: f32) -> Isometry3<f32> {
        Isometry3::new(
            nalgebra::Vector3::new(t.sin(), 0.3 * t, 1.0),
            nalgebra::Vector3::new(0.2, t.cos(), -t),
        )
    }

    #[test]
    fn the_element_follows_rigidly_and_keeps_its_scale() {
        let mut dragger = Dragger::default();
        let start = dragger.update(&stylus(pose(0.0), true), Some(&HIT), |_| element()).unwrap();
        assert_eq!(start.target, 3);
        assert!((start.room_from_element - element()).norm() < 1e-14);
        let drag = dragger.update(&stylus(pose(0.7), true), None, |_| Matrix4::zeros()).unwrap();
        let motion = pose(0.7).cast::<f64>() * pose(0.0).cast::<f64>().inverse();
        assert!((drag.room_from_element - motion.to_homogeneous() * element()).norm() < 1e-6);
        let scales = drag.room_from_element.fixed_view::<3, 3>(0, 0).into_owned().singular_values();
        assert!((scales - Vector3::new(2.0, 1.0, 0.5)).norm() < 1e-12, "{scales}");
        assert_eq!(dragger.held(), Some(3));
        assert_eq!(dragger.update(&stylus(pose(0.8), false), Some(&HIT), |_| element()), None);
        assert_eq!(dragger.held(), None);
    }

    #[test]
    fn a_press_beside_everything_grabs_nothing_until_the_next_press() {
        let mut dragger = Dragger::default();
        assert_eq!(dragger.update(&stylus(pose(0.0), true), None, |_| element()), None);
        assert_eq!(dragger.update(&stylus(pose(0.1), true), Some(&HIT), |_| element()), None);
        assert_eq!(dragger.update(&stylus(pose(0.1), false), Some(&HIT), |_| element()), None);
        assert!(dragger.update(&stylus(pose(0.1), true), Some(&HIT), |_| element()).is_some());
    }

    #[test]
    fn nothing_drifts_over_a_million_updates() {
        let mut dragger = Dragger::default();
        dragger.update(&stylus(pose(0.0), true), Some(&HIT), |_| element());
        for i in 0..1_000_000 {
            dragger.update(&stylus(pose(i as f32 * 1e-3), true), Some(&HIT), |_| element());
        }
        let back = dragger.update(&stylus(pose(0.0), true), None, |_| element()).unwrap();
        assert!(
            (back.room_from_element - element()).norm() < 1e-14,
            "{}",
            back.room_from_element - element()
        );
    }

    #[test]
    fn unusable_poses_hold_the_last_one_and_are_counted() {
        let bad = Isometry3::from_parts(Translation3::new(f32::NAN, 0.0, 0.0), UnitQuaternion::identity());
        let mut dragger = Dragger::default();
        assert_eq!(dragger.update(&stylus(bad, true), Some(&HIT), |_| element()), None);
        let grabbed = dragger.update(&stylus(pose(0.0), true), Some(&HIT), |_| element());
        assert!(grabbed.is_some(), "the press waits for a usable pose");
        let moved = dragger.update(&stylus(pose(0.4), true), None, |_| element());
        assert_eq!(dragger.update(&stylus(bad, true), None, |_| element()), moved);
        assert_eq!(dragger.stylus.invalid, 2);
        assert_eq!(
            dragger.update(&stylus(bad, false), None, |_| element()),
            None,
            "a release counts at once"
        );
        assert_eq!(dragger.held(), None);
    }
}
