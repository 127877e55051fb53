//! The two ears of a rigid sphere: delay and shadow of a head without ear conchas, for headphones.
//!
//! In: a direction in the head's frame (x to the right ear, -z forward). Out: a delay and the parameter of a filter per ear. With
//! the angle θ between the direction and the ear's axis, the head's radius a and the speed of sound c (Brown and Duda 1998,
//! equations 2 to 5):
//!
//! delay = a/c (1 - cos θ) for θ < 90°, else a/c (1 + θ - π/2)      (Woodworth, counted from the plane that touches the head)
//!
//! H(s) = (1 + α τ s) / (1 + τ s), τ = a / 2c,   α(θ) = 1 + α₀/2 + (1 - α₀/2) cos(θ π / θ₀), α₀ = 0.1, θ₀ = 150°

use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Speed of sound in air of 20 °C, m/s.
pub const SPEED_OF_SOUND: f64 = 343.0;
/// Radius of the sphere that stands for a head, m.
pub const HEAD_RADIUS_M: f64 = 0.0875;
/// The time constant τ of the head's shadow, s.
pub const SHADOW_S: f64 = HEAD_RADIUS_M / (2.0 * SPEED_OF_SOUND);

const LEAST_SHADOW: f64 = 0.1;
const DARKEST: f64 = 150.0 / 180.0 * PI;

/// Delay in seconds, and the shadow α, of the left and the right ear.
pub fn ears(direction_in_head: &Vector3<f64>) -> [(f64, f64); 2] {
    let towards_right = direction_in_head.normalize().x.clamp(-1.0, 1.0);
    [-towards_right, towards_right].map(|cos| {
        let angle = cos.acos();
        (delay_s(angle), shadow(angle))
    })
}

fn delay_s(angle: f64) -> f64 {
    let way = if angle < FRAC_PI_2 { 1.0 - angle.cos() } else { 1.0 + angle - FRAC_PI_2 };
    HEAD_RADIUS_M / SPEED_OF_SOUND * way
}

fn shadow(angle: f64) -> f64 {
    (1.0 + LEAST_SHADOW / 2.0) + (1.0 - LEAST_SHADOW / 2.0) * (angle * PI / DARKEST).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Woodworth's interaural delay a/c (θ + sin θ), for an azimuth θ in front.
    #[test]
    fn the_interaural_delay_is_woodworths() {
        for azimuth in [0.0f64, 10.0, 45.0, 80.0, 90.0].map(f64::to_radians) {
            let [(left, _), (right, _)] = ears(&Vector3::new(azimuth.sin(), 0.0, -azimuth.cos()));
            let expected = 0.0875 / 343.0 * (azimuth + azimuth.sin());
            assert!((left - right - expected).abs() < 1e-15, "{azimuth}: {}", left - right);
        }
        let [(left, _), (right, _)] = ears(&-Vector3::x());
        assert!((right - left - 655.8e-6).abs() < 1e-7, "{}", right - left);
    }

    /// 6 dB more at the ear that faces the source, 20 dB less where it is darkest, and some of the bright spot right behind.
    #[test]
    fn the_shadow_has_the_papers_limits() {
        let at = |degrees: f64| shadow(degrees.to_radians());
        assert!((at(0.0) - 2.0).abs() < 1e-12 && (at(150.0) - 0.1).abs() < 1e-12);
        assert!((at(180.0) - 0.281_43).abs() < 1e-5, "{}", at(180.0));
        assert!((0..=180).all(|degrees| at(f64::from(degrees)) > 0.0999));
    }

    #[test]
    fn a_source_in_the_middle_plane_reaches_both_ears_alike() {
        for direction in [Vector3::y(), -Vector3::z(), Vector3::new(0.0, 1.0, 2.0)] {
            let [left, right] = ears(&direction);
            assert_eq!(left, right);
        }
    }
}
