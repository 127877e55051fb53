//! The One Euro filter, which smooths still hands and hardly delays fast ones.
//!
//! In: poses and their times. Out: smoothed poses. From G. Casiez, N. Roussel, D. Vogel, "1 € Filter: A Simple
//! Speed-based Low-pass Filter for Noisy Input in Interactive Systems", CHI 2012.

use crate::stage::tracking::OneEuro;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Two readings are taken to be at least this far apart, s.
const SHORTEST_S: f64 = 1e-4;

/// The filter for one sensor: an exponential mean x̂ₖ = α x + (1 - α) x̂ₖ₋₁ with α = 1 / (1 + 1 / (2π f Δt)), whose
/// cutoff f = `min_cutoff` + `beta` |v̂| grows with the speed; v̂ is the mean, with `speed_cutoff`, of the differences
/// between readings. The speed is that of the whole vector rather than of each coordinate, so that the result does not
/// depend on the axes; for orientations it is the angular velocity, and the mean is a slerp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseFilter {
    pub parameters: OneEuro,
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Last {
    time_s: f64,
    raw: Isometry3<f64>,
    smooth: Isometry3<f64>,
    velocity: Vector3<f64>,
    turning: Vector3<f64>,
}

/// Weight of a new value for the cutoff frequency `f`, Hz, after `step_s`.
pub fn alpha(f: f64, step_s: f64) -> f64 {
    1.0 / (1.0 + 1.0 / (TAU * f * step_s))
}

impl PoseFilter {
    pub fn new(parameters: OneEuro) -> PoseFilter {
        PoseFilter { parameters, last: None }
    }

    /// Forgets the past: the next pose is taken as it is.
    pub fn restart(&mut self) {
        self.last = None;
    }

    pub fn apply(&mut self, pose: &Isometry3<f64>, time_s: f64) -> Isometry3<f64> {
        let OneEuro { min_cutoff, beta, speed_cutoff } = self.parameters;
        let mut next =
            Last { time_s, raw: *pose, smooth: *pose, velocity: Vector3::zeros(), turning: Vector3::zeros() };
        if let Some(last) = &self.last {
            let step_s = (time_s - last.time_s).max(SHORTEST_S);
            let speed_part = alpha(speed_cutoff, step_s);
            let velocity = (pose.translation.vector - last.raw.translation.vector) / step_s;
            let turning = (pose.rotation * last.raw.rotation.inverse()).scaled_axis() / step_s;
            next.velocity = last.velocity.lerp(&velocity, speed_part);
            next.turning = last.turning.lerp(&turning, speed_part);
            let part = alpha(min_cutoff + beta * next.velocity.norm(), step_s);
            let place = last.smooth.translation.vector.lerp(&pose.translation.vector, part);
            let part = alpha(min_cutoff + beta * next.turning.norm(), step_s);
            next.smooth = Isometry3::from_parts(
                Translation3::from(place),
                slerp(&last.smooth.rotation, &pose.rotation, part),
            );
        }
        self.last = Some(next);
        next.smooth
    }
}

/// Slerp along the shorter way; for rotations half a turn apart, one of the two.
fn slerp(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>, part: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis((to * from.inverse()).scaled_axis() * part) * from
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 0.01;

    fn turned(angle: f64) -> Isometry3<f64> {
        Isometry3::rotation(Vector3::new(0.0, angle, 0.0))
    }

    /// The exponential mean lags by v Δt (1 - α) / α = v / (2π f) at a steady speed v, with f = min_cutoff + beta |v|.
    #[test]
    fn the_lag_of_a_steady_motion_is_that_of_the_formula() {
        for (speed, beta) in [(0.1, 0.0), (0.1, 1.0), (1.0, 1.0), (1.0, 5.0)] {
            let parameters = OneEuro { min_cutoff: 1.5, beta, speed_cutoff: 1.0 };
            let (mut place, mut turn) = (PoseFilter::new(parameters), PoseFilter::new(parameters));
            let (mut lag_m, mut lag_rad) = (0.0, 0.0);
            for i in 0..3000 {
                let time_s = f64::from(i) * STEP_S;
                let x = speed * time_s;
                lag_m = x - place.apply(&Isometry3::translation(x, 0.0, 0.0), time_s).translation.x;
                lag_rad = turn.apply(&turned(x), time_s).rotation.angle_to(&turned(x).rotation);
            }
            let expected = speed / (TAU * (1.5 + beta * speed));
            assert!((lag_m / expected - 1.0).abs() < 1e-6, "{lag_m} m, formula {expected}");
            assert!((lag_rad / expected - 1.0).abs() < 1e-6, "{lag_rad} rad, formula {expected}");
        }
    }

    /// White noise through an exponential mean: its variance falls by α / (2 - α).
    #[test]
    fn the_noise_of_a_still_sensor_falls_as_the_formula_says() {
        let parameters = OneEuro { min_cutoff: 1.0, beta: 0.0, speed_cutoff: 1.0 };
        let mut filter = PoseFilter::new(parameters);
        let (mut raw, mut smooth) = (0.0, 0.0);
        let mut seed = 12345_u64;
        for i in 0..40_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
            let x =
                filter.apply(&Isometry3::translation(noise, 0.0, 0.0), f64::from(i) * STEP_S).translation.x;
            if i > 1000 {
                raw += noise * noise;
                smooth += x * x;
            }
        }
        let part = alpha(1.0, STEP_S);
        let expected = part / (2.0 - part);
        assert!((smooth / raw / expected - 1.0).abs() < 0.1, "{} against {expected}", smooth / raw);
    }

    #[test]
    fn a_half_turn_and_equal_times_stay_finite() {
        let mut filter = PoseFilter::new(OneEuro { min_cutoff: 1.0, beta: 0.1, speed_cutoff: 1.0 });
        for i in 0..100 {
            let smooth = filter.apply(&turned(std::f64::consts::PI * f64::from(i % 2)), 0.0);
            assert!((smooth.rotation.coords.norm() - 1.0).abs() < 1e-9, "{smooth}");
        }
        filter.restart();
        assert_eq!(filter.apply(&turned(1.0), 5.0), turned(1.0));
    }
}
