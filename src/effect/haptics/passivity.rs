//! Keeps a sampled force from feeding energy to the hand: the largest stiffness that the device's own friction can bear, and
//! an observer that measures generated energy and brakes.
//!
//! A force that is held for a tick T while the hand moves by Δx is late by T/2 on average: a spring K returns ½ K Δx² per
//! tick more than it took. The device's friction b dissipates b Δx²/T. Hence b > K T/2 + |B| with a virtual damper B
//! (J. E. Colgate and G. Schenkel, "Passivity of a class of sampled-data systems", J. Robotic Systems 14, 1997, 37-47). Their
//! condition is b > T/2 · Re{(1 - e^{-jωT}) H}/(1 - cos ωT) at all ω. With H = K e^{-jωnT}, a delay of n ticks, the right side is
//! K T/2 · sin((n + ½) ωT)/sin(½ ωT), at most K (T/2 + nT). A delay τ counts in full (so too in the stability of J. J. Gil,
//! E. Sánchez, T. Hulin, C. Preusche and G. Hirzinger, "Stability boundary for haptic rendering: influence of damping and
//! delay", J. Computing and Information Science in Engineering 9, 2009, 011005):
//!
//! ```text
//! b > K (T/2 + τ) + |B|
//! ```
//!
//! For a changing delay: at t the force is that of a pose of age a(t), and is wrong by at most K ∫ |v| over that time, so that
//! it generates at most K ∫∫ |v(t)| |v(s)| ds dt over t - a(t) < s < t. With |v(t)| |v(s)| ≤ ½ v(t)² + ½ v(s)² that is at most
//! K ∫ ½ (a(t) + a'(t)) v² dt, where a'(s) is how long after s the force still follows from a pose before s. Where poses come
//! every T, and their forces begin to act up to τ later, for any τ of whole T, that is at most T + 2 τ: the same bound, with the
//! greatest τ. It requires only that the force's slope is at most K, and so holds for the coupling to any body. T and τ are
//! those of [`super::delay`]. A stiffer body is felt through a virtual coupling ([`super::coupling`]).

use super::device::Push;
use crate::deform::se3;
use nalgebra::{Vector3, Vector6};

/// The fraction of the theoretically passive stiffness that is used: the coupling is updated only when the lag has changed by
/// 1 %, a delay that is no multiple of the period is slightly worse than the bound, and the body's stiffness is that at the
/// handle.
pub const MARGIN: f64 = 0.8;

/// Largest stiffness, N/m, that a device of friction `damping` b N·s/m bears: (b - |B|)/(T/2 + τ), never below 0.
pub fn largest_stiffness(damping: f64, virtual_damping: f64, period_s: f64, age_s: f64) -> f64 {
    ((damping - virtual_damping.abs()) / (0.5 * period_s + age_s)).max(0.0)
}

/// The handle's motion between two readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// m, and the rotation vector, rad.
    pub dx: Vector3<f64>,
    pub turn: Vector3<f64>,
    /// s.
    pub time_s: f64,
}

impl Motion {
    pub fn stacked(&self) -> Vector6<f64> {
        se3::joined(&self.dx, &self.turn)
    }
}

/// Measures the energy that sampling generates, and brakes until it is taken back (B. Hannaford and J.-H. Ryu, "Time-domain passivity
/// control of haptic interfaces", IEEE Trans. Robotics and Automation 18, 2002, 1-10).
///
/// A force that is the gradient of a potential returns the energy that the potential loses. The work is that of the force
/// that acted between two poses, which is an older one if messages take time
/// ([`ActingPush`](super::haptic_source::ActingPush)); whatever exceeds the loss was generated. A ramp of the force, or
/// another hand on the body, changes the potential without a motion of this handle and is not counted; energy that another
/// effect adds to it is counted. Energy dissipated by friction offsets energy generated at the same time, and is forgotten
/// within [`RESERVE_S`], so that a calm second does not pay for a later limit cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// Recently dissipated less generated energy, J; if negative, this much must be taken back.
    pub energy: f64,
    /// The largest deficit so far, J.
    pub deepest: f64,
    /// The total energy that the brake has taken, J.
    pub braked: f64,
}

/// The time constant with which a surplus is forgotten, s.
pub const RESERVE_S: f64 = 0.01;
/// A brake of more than this fraction of the device's mass per tick would itself be unstable.
const BRAKE: f64 = 0.5;

impl Observer {
    /// Takes a motion of the handle under the force `held`, during which the potential rose by `stored` J and friction, b and
    /// b_r, dissipated at least b Δx²/Δt.
    pub fn moved(&mut self, held: &Push, stored: f64, motion: &Motion, damping: [f64; 2]) {
        let Motion { dx, turn, time_s } = motion;
        let eaten = (damping[0] * dx.norm_squared() + damping[1] * turn.norm_squared()) / time_s;
        if self.energy > 0.0 {
            self.energy *= (1.0 - time_s / RESERVE_S).max(0.0);
        }
        self.energy += eaten - held.force.dot(dx) - held.torque.dot(turn) - stored;
        self.deepest = self.deepest.max(-self.energy);
    }

    /// The force that brakes a handle of this mass and inertia, moving by (v, ω), so that one tick takes the deficit.
    pub fn brake(
        &mut self,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
        mass: f64,
        inertia: f64,
        period_s: f64,
    ) -> Push {
        let rate = mass * v.norm_squared() + inertia * w.norm_squared();
        if self.energy >= 0.0 || rate <= 0.0 {
            return Push::NONE;
        }
        // α m v² + α J ω² is the power: α in 1/s.
        let alpha = (-self.energy / (period_s * rate)).min(BRAKE / period_s);
        self.braked += alpha * rate * period_s;
        Push { force: v * (-alpha * mass), torque: w * (-alpha * inertia) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_that_of_colgate_and_schenkel() {
        assert_eq!(largest_stiffness(1.0, 0.0, 1e-3, 0.0), 2000.0);
        assert_eq!(largest_stiffness(1.0, -0.5, 1e-3, 0.0), 1000.0);
        assert_eq!(largest_stiffness(1.0, 0.0, 1e-3, 1e-3), 1.0 / 1.5e-3);
        assert_eq!(largest_stiffness(1.0, 2.0, 1e-3, 0.0), 0.0);
    }

    fn moved(observer: &mut Observer, force: f64, stored: f64, dx: f64, damping: f64) {
        let push = Push { force: Vector3::new(force, 0.0, 0.0), torque: Vector3::zeros() };
        let motion = Motion { dx: Vector3::new(dx, 0.0, 0.0), turn: Vector3::zeros(), time_s: 1e-3 };
        observer.moved(&push, stored, &motion, [damping, 0.0]);
    }

    #[test]
    fn the_brake_takes_what_is_missing_and_no_more() {
        let mut observer = Observer::default();
        moved(&mut observer, 2.0, 0.0, 1e-4, 0.0);
        assert!((observer.energy + 2e-4).abs() < 1e-18 && observer.deepest == -observer.energy);
        let (v, none) = (Vector3::new(3.0, 0.0, 0.0), Vector3::zeros());
        let brake = observer.brake(&v, &none, 0.1, 1e-4, 1e-3);
        assert!((brake.force.dot(&v) * 1e-3 + 2e-4).abs() < 1e-15, "{brake:?}");
        moved(&mut observer, -2.0, 0.0, 1e-4, 0.0);
        moved(&mut observer, 2.0, -2e-4, 1e-4, 0.0);
        assert!(observer.energy.abs() < 1e-18, "what the potential gives is not generated: {observer:?}");
        assert_eq!(Observer::default().brake(&v, &none, 0.1, 1e-4, 1e-3), Push::NONE);
    }

    /// Ten seconds of ordinary motion, of which friction eats a joule, do not hide a cycle worth a few millijoules.
    #[test]
    fn friction_is_not_saved_up() {
        let mut observer = Observer::default();
        let mut eaten = 0.0;
        for i in 0..10_000 {
            let dx = 3e-4 * (0.01 * f64::from(i)).cos();
            eaten += dx * dx / 1e-3;
            moved(&mut observer, 0.0, 0.0, dx, 1.0);
        }
        assert!(eaten > 0.4 && observer.energy < 2e-3, "{eaten} J eaten, {observer:?}");
        for _ in 0..20 {
            moved(&mut observer, 2.0, 0.0, 2e-4, 1.0);
        }
        assert!(observer.energy < -4e-3, "{observer:?}");
    }
}
