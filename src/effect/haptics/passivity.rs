//! What keeps a sampled force from feeding the hand with energy: the largest stiffness that the device's own friction
//! can bear, and an observer that counts the energy and brakes.
//!
//! A force that is held for a tick T while the hand moves by Δx is late by T/2 on the mean: a spring K gives back
//! ½ K Δx² a tick more than it took. The device's friction b eats b Δx²/T. Hence b > K T/2 + |B| with a virtual damper B
//! (J. E. Colgate and G. Schenkel, "Passivity of a class of sampled-data systems", J. Robotic Systems 14, 1997, 37-47);
//! a further delay t_d of the device counts in full: b > K (T/2 + t_d) + |B|.
//!
//! Where the device does not report in every tick, T is the time between two reports ([`Spacing`]). A body that is stiffer is
//! felt through a virtual coupling ([`super::coupling`]).

use super::device::Push;
use nalgebra::Vector3;

/// Of the stiffness that is passive in theory so much is used: a loop's ticks are not all of one length.
pub const MARGIN: f64 = 0.8;

/// Largest stiffness, N/m, that a device of friction `damping` b N·s/m bears: (b - |B|)/(T/2 + t_d), never below 0.
pub fn largest_stiffness(damping: f64, virtual_damping: f64, period_s: f64, latency_s: f64) -> f64 {
    ((damping - virtual_damping.abs()) / (0.5 * period_s + latency_s)).max(0.0)
}

/// The time for which a reading holds: its mean over the last 0.2 s, in which a long one counts by its length. With
/// times T_i that is Σ T_i²/Σ T_i, for which a spring K generates Σ ½ K v² T_i² what friction eats, Σ b v² T_i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    pub mean_s: f64,
    heard_s: Option<f64>,
}

/// s.
const SPACING_S: f64 = 0.2;
/// A longer silence is no spacing, but an absence, s.
const ABSENT_S: f64 = 0.04;

impl Spacing {
    /// Steady so far.
    pub fn new(period_s: f64) -> Spacing {
        Spacing { mean_s: period_s, heard_s: None }
    }

    /// A reading that arrived then; the same one again is none.
    pub fn heard(&mut self, arrived_s: f64) {
        let Some(last_s) = self.heard_s.replace(arrived_s) else { return };
        let time_s = arrived_s - last_s;
        if time_s > 0.0 && time_s < ABSENT_S {
            self.mean_s += (time_s - self.mean_s) * time_s / (time_s + SPACING_S);
        }
    }
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

/// Counts what sampling generates, and brakes until it is taken back (B. Hannaford and J.-H. Ryu, "Time-domain passivity
/// control of haptic interfaces", IEEE Trans. Robotics and Automation 18, 2002, 1-10).
///
/// A force that is the slope of a potential gives back what the potential loses. The work is exact: the force is held between
/// two readings, so that it is force · Δx. What it is more than that loss was generated. A ramp of the force, or another
/// hand on the body, changes the potential without a motion of this handle, and is not counted. What friction eats offsets
/// what is generated at the same time, and is forgotten within [`RESERVE_S`]: a calm second does not pay for a later cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// What friction and brake took of late less what was generated, J. Negative: so much must be taken back.
    pub energy: f64,
    /// Most that was missing at once, J.
    pub deepest: f64,
    /// What the brake took in all, J.
    pub braked: f64,
}

/// Time constant in which an excess is forgotten, s.
pub const RESERVE_S: f64 = 0.01;
/// A brake beyond this part of the device's mass a tick would itself be unstable.
const BRAKE: f64 = 0.5;

impl Observer {
    /// The handle moved under the force `held`, whose potential rose by `stored` J; friction, b and b_r, ate b Δx²/Δt at least.
    pub fn moved(&mut self, held: &Push, stored: f64, motion: &Motion, damping: [f64; 2]) {
        let Motion { dx, turn, time_s } = motion;
        let eaten = (damping[0] * dx.norm_squared() + damping[1] * turn.norm_squared()) / time_s;
        if self.energy > 0.0 {
            self.energy *= (1.0 - time_s / RESERVE_S).max(0.0);
        }
        self.energy += eaten - held.force.dot(dx) - held.torque.dot(turn) - stored;
        self.deepest = self.deepest.max(-self.energy);
    }

    /// The force with which to brake a handle of the given mass and inertia, moving by (v, ω), so that a tick takes what
    /// is missing.
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

    /// Of a hundred reports a second a thousand ticks make no more; a late one among steady ones counts by its length.
    #[test]
    fn the_spacing_is_that_of_the_reports() {
        let mut spacing = Spacing::new(1e-3);
        let hear = |spacing: &mut Spacing, from_s: f64, to_s: f64, step_s: f64| {
            for i in 0..((to_s - from_s) / 1e-3).round() as u32 {
                let now_s = from_s + 1e-3 * f64::from(i);
                spacing.heard((now_s / step_s + 1e-6).floor() * step_s);
            }
        };
        hear(&mut spacing, 0.0, 2.0, 0.01);
        assert!((spacing.mean_s - 0.01).abs() < 1e-5, "{spacing:?}");
        hear(&mut spacing, 2.0, 5.0, 1e-3);
        assert!((spacing.mean_s - 1e-3).abs() < 1e-6, "{spacing:?}");
        spacing.heard(5.019);
        assert!(spacing.mean_s > 1.5e-3 && spacing.mean_s < 4e-3, "{spacing:?}");
        let before = spacing;
        spacing.heard(8.0);
        assert_eq!(spacing.mean_s, before.mean_s, "an absence is no spacing");
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
