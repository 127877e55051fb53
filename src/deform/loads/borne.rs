//! The load on a frame of a section or an interface, as part of the energy of an equilibrium.
//!
//! In: N = Σ f and M = Σ f ⊗ a of forces at arms a from the frame, along the body's axes. Out: the potential -(N·x + M : R) of the
//! frame (x, R), and its derivatives by a motion exp (v, ω) along the frame's own axes, of x + R (v + ½ ω × v) and
//! R (1 + ω̂ + ½ ω̂²).

use crate::deform::frames::axial;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

type V3 = Vector3<f64>;

/// Slots of a frame in a list of shares: N, then the three columns of M.
pub const SLOTS: usize = 4;

/// N and M.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Borne {
    pub force: V3,
    pub moments: Matrix3<f64>,
}

impl Borne {
    /// Reads the [`SLOTS`] of a frame.
    pub fn of_slots(slots: &[V3]) -> Borne {
        Borne { force: slots[0], moments: Matrix3::from_columns(&slots[1..SLOTS]) }
    }

    /// The share of a force in the slots of a frame from `first` on; `arm` is already multiplied by the share.
    pub fn shares(first: usize, share: f64, arm: &V3) -> [(usize, f64); SLOTS] {
        [(first, share), (first + 1, arm.x), (first + 2, arm.y), (first + 3, arm.z)]
    }

    /// J.
    pub fn potential(&self, place: &V3, turn: &UnitQuaternion<f64>) -> f64 {
        -self.force.dot(place) - self.moments.dot(turn.to_rotation_matrix().matrix())
    }

    /// This load along the frame's own axes.
    pub fn along(&self, turn: &UnitQuaternion<f64>) -> Borne {
        let inverse = turn.inverse().to_rotation_matrix();
        Borne { force: inverse * self.force, moments: inverse.matrix() * self.moments }
    }

    /// Minus the slope of the potential by ω, of a load along the frame's own axes; by v it is the force.
    pub fn torque(&self) -> V3 {
        axial(&self.moments)
    }

    /// Minus the second derivatives of the potential by (v, ω) and by (ω, ω), of a load along the frame's own axes.
    pub fn curvatures(&self) -> [Matrix3<f64>; 2] {
        let symmetric = (self.moments + self.moments.transpose()) * 0.5;
        [self.force.cross_matrix() * 0.5, symmetric - Matrix3::from_diagonal_element(self.moments.trace())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// The derivatives against differences of the potential along a motion of the frame.
    #[test]
    fn derivatives_are_those_of_the_potential() {
        let mut random = Random::default();
        let mut vector = || V3::from_fn(|_, _| random.draw());
        let load = Borne { force: vector(), moments: Matrix3::from_columns(&[vector(), vector(), vector()]) };
        let (place, turn) = (vector(), UnitQuaternion::from_scaled_axis(vector()));
        let (v, w) = (vector(), vector());
        let at = |t: f64| {
            let (v, w) = (v * t, w * t);
            load.potential(
                &(place + turn * (v + w.cross(&v) * 0.5)),
                &(turn * UnitQuaternion::from_scaled_axis(w)),
            )
        };
        let own = load.along(&turn);
        let slope = -own.force.dot(&v) - own.torque().dot(&w);
        let [mixed, turning] = own.curvatures();
        let second = -2.0 * v.dot(&(mixed * w)) - w.dot(&(turning * w));
        let h = 1e-4;
        let (high, low, here) = (at(h), at(-h), at(0.0));
        assert!(((high - low) / (2.0 * h) - slope).abs() < 1e-7, "{slope}");
        assert!(((high - 2.0 * here + low) / (h * h) - second).abs() < 1e-6, "{second}");
    }
}
