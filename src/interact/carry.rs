//! The motion that one hand or two hands give to the element that they hold, as a similarity of the room.
//!
//! In: the pose of every hand at the grab and now, and the point that it holds. Out: the motion since the grab. One hand
//! gives a rigid motion. With two hands, the line between the two held points follows the hands, is scaled with their
//! distance, and turns about itself by the mean of the hands' rotations.
//!
//! [`Carrying`] is the held element's matrix as a function of the pose of one of the hands that hold it.

use super::mode::{Mode, twist};
use nalgebra::{
    Isometry3, Matrix4, Point3, Quaternion, Similarity3, Translation3, Unit, UnitQuaternion, Vector3,
};

/// A hand at the grab and now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandMotion {
    pub room_from_hand_then: Isometry3<f64>,
    pub room_from_hand_now: Isometry3<f64>,
    /// The point that it holds, at the grab, in the room.
    pub held_then: Point3<f64>,
}

/// Two points nearer to each other than this define no direction and no scale, m; the last ones are kept.
const APART_M: f64 = 1e-3;

impl HandMotion {
    /// now · then⁻¹.
    fn rigid(&self) -> Isometry3<f64> {
        self.room_from_hand_now * self.room_from_hand_then.inverse()
    }

    fn held_now(&self) -> Point3<f64> {
        self.rigid() * self.held_then
    }

    /// Distance by which the hand has moved along the ray that it had at the grab, m.
    pub fn push(&self) -> f64 {
        let way = self.room_from_hand_now.translation.vector - self.room_from_hand_then.translation.vector;
        way.dot(&(self.room_from_hand_then.rotation * -Vector3::z()))
    }
}

/// The motion since the grab of what these hands hold; `None` without a hand. Only the first two hands count.
///
/// Two hands that hold the points p and q: the scale is |q'-p'|/|q-p|, the rotation takes the direction of q-p to that
/// of q'-p' the shortest way after a turn about it by the mean twist of the hands, and the middle goes to the middle.
/// Where p and q (nearly) coincide there is no such line: the rotation is halfway between the hands' and nothing is
/// scaled. Where p' and q' meet later, q'-p' is `last`, the [`held_line`] of the frame before (`None` at the grab).
pub fn carry(hands: &[HandMotion], last: Option<Vector3<f64>>) -> Option<Similarity3<f64>> {
    let (first, second) = match hands {
        [] => return None,
        [one] => return Some(Similarity3::from_isometry(one.rigid(), 1.0)),
        [first, second, ..] => (first, second),
    };
    let then = second.held_then - first.held_then;
    let (rotation, scale) = match Unit::try_new(then, APART_M) {
        Some(from) => {
            let now = held_line(hands, last).unwrap_or(then);
            let to = Unit::new_normalize(now);
            let swing = swing(&from, &to);
            let twists = [first, second].map(|hand| twist(&(swing.inverse() * hand.rigid().rotation), &from));
            (swing * halfway(&twists), now.norm() / then.norm())
        }
        None => (halfway(&[first.rigid().rotation, second.rigid().rotation]), 1.0),
    };
    let middle_then = nalgebra::center(&first.held_then, &second.held_then);
    let middle_now = nalgebra::center(&first.held_now(), &second.held_now());
    let shift = middle_now.coords - rotation * middle_then.coords * scale;
    Some(Similarity3::from_parts(Translation3::from(shift), rotation, scale))
}

/// The vector from the place that the first hand holds to that of the second, now; `last` if the two have met.
pub fn held_line(hands: &[HandMotion], last: Option<Vector3<f64>>) -> Option<Vector3<f64>> {
    let [first, second, ..] = hands else { return None };
    Some(second.held_now() - first.held_now()).filter(|line| line.norm() > APART_M).or(last)
}

/// The shortest rotation from one direction to another, (1 + a·b, a × b) made a unit quaternion; half a turn about any
/// axis across where they are opposite.
fn swing(from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>) -> UnitQuaternion<f64> {
    let (cosine, across) = (from.dot(to), from.cross(to));
    let quaternion = Quaternion::from_parts(1.0 + cosine, across);
    UnitQuaternion::try_new(quaternion, 1e-9).unwrap_or_else(|| {
        let across = from.cross(&Vector3::ith(from.iamin(), 1.0));
        UnitQuaternion::from_axis_angle(&Unit::new_normalize(across), std::f64::consts::PI)
    })
}

/// Midway between two rotations, the shorter way.
fn halfway([a, b]: &[UnitQuaternion<f64>; 2]) -> UnitQuaternion<f64> {
    a.try_slerp(b, 0.5, 1e-9).unwrap_or(*a)
}

/// The logarithm of the largest scale, beyond any that a body admits.
const MOST_SCALE_LN: f64 = 6.0;

/// A hold of one hand or two, seen from one of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrying {
    pub mode: Mode,
    /// The transform at the beginning of the hold.
    pub room_from_element: Matrix4<f64>,
    pub axis: Option<Unit<Vector3<f64>>>,
    /// The [`held_line`] of the frame before.
    pub line: Option<Vector3<f64>>,
    /// Motions of both hands; a single hand's stands twice.
    pub motions: [HandMotion; 2],
    /// 1 or 2.
    pub hands: usize,
    /// The index of the hand whose pose is the argument.
    pub mine: usize,
    /// The hand that scales with its second button, by e per `radius_m` along its ray; meanwhile the element does not follow.
    pub scaled_by: Option<usize>,
    pub radius_m: f64,
}

impl Carrying {
    /// The element's matrix in the room.
    pub fn now(&self) -> Option<Matrix4<f64>> {
        let motions = self.motions.get(..self.hands)?;
        if let Some(scaling) = self.scaled_by {
            let scale_ln = motions.get(scaling)?.push() / self.radius_m;
            let scale = scale_ln.clamp(-MOST_SCALE_LN, MOST_SCALE_LN).exp();
            return Some(self.room_from_element * Matrix4::new_scaling(scale));
        }
        let held: Vector3<f64> = motions.iter().map(|motion| motion.held_then.coords).sum();
        let held = Point3::from(held / motions.len() as f64);
        Some(self.mode.take(&carry(motions, self.line)?, &self.room_from_element, &held, self.axis))
    }

    /// The [`held_line`] for the next frame.
    pub fn line_now(&self) -> Option<Vector3<f64>> {
        held_line(self.motions.get(..self.hands)?, self.line)
    }

    /// The element's matrix if this hand were at another pose. The force on the hand is minus the derivative of the body's
    /// energy along this function.
    pub fn at(&self, room_from_hand: &Isometry3<f64>) -> Option<Matrix4<f64>> {
        let mut moved = *self;
        moved.motions.get_mut(self.mine)?.room_from_hand_now = *room_from_hand;
        moved.now()
    }

    /// The hold as it began, which does not change while it lasts.
    pub fn begun(&self) -> Carrying {
        let then =
            |motion: HandMotion| HandMotion { room_from_hand_now: motion.room_from_hand_then, ..motion };
        Carrying { motions: self.motions.map(then), line: None, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand(held: [f64; 3], motion: Isometry3<f64>) -> HandMotion {
        let then = Isometry3::new(Vector3::new(0.3, 1.0, 0.4), Vector3::new(0.1, 0.2, 0.3));
        HandMotion { room_from_hand_then: then, room_from_hand_now: motion * then, held_then: held.into() }
    }

    #[test]
    fn one_hand_is_its_own_rigid_motion_and_two_that_agree_are_the_same() {
        let motion = Isometry3::new(Vector3::new(0.1, -0.4, 0.2), Vector3::new(0.5, -1.2, 0.7));
        let one = carry(&[hand([1.0, 2.0, 3.0], motion)], None).unwrap();
        let two = carry(&[hand([1.0, 2.0, 3.0], motion), hand([0.5, 2.5, 3.0], motion)], None).unwrap();
        for similarity in [one, two] {
            assert!((similarity.to_homogeneous() - motion.to_homogeneous()).norm() < 1e-12, "{similarity}");
        }
        assert_eq!(carry(&[], None), None);
    }

    #[test]
    fn hands_that_part_stretch_and_hands_that_twist_turn_by_the_mean() {
        let apart = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        let motion =
            carry(&[hand([-0.2, 0.0, 0.0], apart(-0.1)), hand([0.2, 0.0, 0.0], apart(0.3))], None).unwrap();
        assert!((motion.scaling() - 2.0).abs() < 1e-12 && motion.isometry.rotation.angle() < 1e-7);
        assert!((motion * Point3::new(0.2, 0.0, 0.0) - Point3::new(0.5, 0.0, 0.0)).norm() < 1e-12);
        let turned = |angle: f64| Isometry3::rotation(Vector3::x() * angle);
        let motion =
            carry(&[hand([-0.2, 0.0, 0.0], turned(0.2)), hand([0.2, 0.0, 0.0], turned(0.6))], None).unwrap();
        assert!((motion.isometry.rotation.scaled_axis() - Vector3::x() * 0.4).norm() < 1e-9);
    }

    #[test]
    fn both_held_places_are_met_whatever_the_hands_do() {
        for i in 0..200 {
            let t = f64::from(i) * 0.37;
            let move_by = |s: f64| {
                Isometry3::new(
                    Vector3::new((t * s).sin(), (t + s).cos(), 0.3 * t.sin()),
                    Vector3::new(s * t.cos(), 0.7 * (t * s).sin(), t.sin()) * 2.0,
                )
            };
            let hands = [hand([0.3, 0.1, 0.0], move_by(1.0)), hand([-0.4, 0.2, 0.5], move_by(2.3))];
            let motion = carry(&hands, None).unwrap();
            for hand in &hands {
                let miss = (motion * hand.held_then - hand.held_now()).norm();
                assert!(miss < 1e-9, "{i}: {miss}");
            }
        }
    }

    #[test]
    fn hands_at_one_place_and_hands_that_change_sides_stay_finite() {
        let still = Isometry3::identity();
        let turned = Isometry3::rotation(Vector3::y() * 0.5);
        let same = carry(&[hand([0.1, 0.0, 0.0], still), hand([0.1, 0.0, 0.0], turned)], None).unwrap();
        assert!(
            (same.scaling() - 1.0).abs() < 1e-15 && (same.isometry.rotation.angle() - 0.25).abs() < 1e-12
        );
        let to = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        let hands = [hand([-0.2, 0.0, 0.0], to(0.4)), hand([0.2, 0.0, 0.0], to(-0.4))];
        let swapped = carry(&hands, None).unwrap();
        assert!((swapped * Point3::new(-0.2, 0.0, 0.0) - Point3::new(0.2, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn hands_that_meet_keep_scale_and_direction() {
        let mut line = None;
        // 0.2 m apart at the grab; together to 0.4 mm, there with noise, and apart again, a tenth of a millimetre a step.
        let gaps = (4..=2000).rev().chain((4..40).map(|i| 4 + i * 7 % 9)).chain(4..=2000);
        let mut last: Option<Similarity3<f64>> = None;
        for gap in gaps {
            let half = 0.5e-4 * f64::from(gap);
            let to = |x: f64, y: f64| Isometry3::translation(x, y, 0.0);
            // Near each other they circle: the direction between them is any.
            let angle = if gap < 10 { f64::from(gap) } else { 0.0 };
            let (sin, cos) = angle.sin_cos();
            let hands = [
                hand([-0.1, 0.0, 0.0], to(0.1 - half * cos, -half * sin)),
                hand([0.1, 0.0, 0.0], to(-0.1 + half * cos, half * sin)),
            ];
            let motion = carry(&hands, line).unwrap();
            line = held_line(&hands, line);
            assert!(motion.isometry.rotation.angle() < 1e-6, "{gap}: {motion}");
            if let Some(last) = last {
                let step = (motion.scaling() - last.scaling()).abs();
                assert!(step < 2e-3, "{gap}: from {} to {}", last.scaling(), motion.scaling());
            }
            last = Some(motion);
        }
        assert!((last.unwrap().scaling() - 1.0).abs() < 1e-12);
    }
}
