//! A held element's matrix as a function of the pose of one of the hands that hold it.
//!
//! In: a hold, that is mode, hands and element at its start, and the hands now. Out: the element's matrix for any pose of that
//! hand. The force on the hand is minus the derivative of the body's energy along this function.

use super::carry::{HandMotion, carry, held_line};
use super::mode::Mode;
use nalgebra::{Isometry3, Matrix4, Point3, Unit, Vector3};

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

    /// The element's matrix if this hand were at another pose.
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
