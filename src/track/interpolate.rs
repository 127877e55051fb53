//! Smooth motion through key frames that never overshoots, and that rests exactly where two keys are equal.
//!
//! In: key times and values. Out: the value between two keys, by a monotone cubic (F. N. Fritsch and
//! J. Butland, SIAM J. Sci. Stat. Comput. 5, 1984); rotations by slerp, paced by that cubic.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

/// A time between two key frames: after key `left`, at the fraction `s` (0..1) of the way to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeySpan {
    pub left: usize,
    pub s: f64,
}

/// Finds `time_s` among strictly increasing `times` (at least one). Before the first key and after the last one, that key
/// holds; NaN counts as the start.
pub fn locate(times: &[f64], time_s: f64) -> KeySpan {
    let left = times.partition_point(|&time| time <= time_s).saturating_sub(1);
    match times.get(left + 1) {
        Some(next) => {
            let s = (time_s - times[left]) / (next - times[left]);
            KeySpan { left, s: if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.0 } }
        }
        None => KeySpan { left, s: 0.0 },
    }
}

/// The pose between key poses `pose(k)`: each coordinate follows a monotone cubic; the rotation follows the shorter slerp,
/// with a monotone cubic through the accumulated angles as its parameter.
pub fn interpolate(times: &[f64], at: KeySpan, pose: impl Fn(usize) -> Isometry3<f64>) -> Isometry3<f64> {
    let KeySpan { left, s } = at;
    let from = pose(left);
    if s == 0.0 || left + 1 >= times.len() {
        return from;
    }
    let to = pose(left + 1);
    let coordinate = |axis: usize| cubic(times, at, |k| pose(k).translation.vector[axis]);
    let place = Point3::new(coordinate(0), coordinate(1), coordinate(2));

    let turn = |k: usize| pose(k).rotation.angle_to(&pose(k + 1).rotation);
    let angle = turn(left);
    let turned = |k: usize| match k {
        k if k < left => -turn(k),
        k if k == left => 0.0,
        k if k == left + 1 => angle,
        k => angle + turn(k - 1),
    };
    let part = if angle > 0.0 { cubic(times, at, turned) / angle } else { 0.0 };
    let rotation: UnitQuaternion<f64> =
        from.rotation.try_slerp(&to.rotation, part, 1e-12).unwrap_or(from.rotation);
    Isometry3::from_parts(Translation3::from(place.coords), rotation)
}

/// The monotone cubic Hermite curve through `value(k)` at `times[k]`; it needs only the four keys around.
fn cubic(times: &[f64], at: KeySpan, value: impl Fn(usize) -> f64) -> f64 {
    let KeySpan { left, s } = at;
    let width = times[left + 1] - times[left];
    let secant = |k: usize| (value(k + 1) - value(k)) / (times[k + 1] - times[k]);
    let slope = |k: usize| {
        if k == 0 || k + 1 == times.len() {
            return 0.0;
        }
        let (before, after) = (secant(k - 1), secant(k));
        if before * after <= 0.0 {
            return 0.0;
        }
        let (width_before, width_after) = (times[k] - times[k - 1], times[k + 1] - times[k]);
        let (a, b) = (2.0 * width_after + width_before, width_after + 2.0 * width_before);
        (a + b) / (a / before + b / after)
    };
    let (v0, v1, m0, m1) = (value(left), value(left + 1), slope(left) * width, slope(left + 1) * width);
    let t = s * s;
    let rise = t * (3.0 - 2.0 * s);
    v0 + (v1 - v0) * rise + m0 * s * (1.0 - s) * (1.0 - s) - m1 * t * (1.0 - s)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMES: [f64; 5] = [0.0, 1.0, 1.5, 3.0, 4.0];

    fn value_at(values: [f64; 5], time_s: f64) -> f64 {
        let at = locate(&TIMES, time_s);
        interpolate(&TIMES, at, |k| Isometry3::translation(values[k], 0.0, 0.0)).translation.x
    }

    #[test]
    fn keys_are_met_holds_are_held_and_nothing_overshoots() {
        let values = [0.0, 2.0, 2.0, 5.0, 4.0];
        for (time, value) in TIMES.into_iter().zip(values) {
            assert!((value_at(values, time) - value).abs() < 1e-12);
        }
        for i in 0..=400 {
            let time = f64::from(i) / 100.0;
            let value = value_at(values, time);
            assert!((0.0..=5.0).contains(&value), "{value} at {time}");
            assert!(!(1.0..=1.5).contains(&time) || (value - 2.0).abs() < 1e-12, "{value} at {time}");
        }
        assert_eq!(value_at(values, -1.0), 0.0);
        assert_eq!(value_at(values, 9.0), 4.0);
        assert_eq!(value_at(values, f64::NAN), 0.0);
        assert_eq!(value_at(values, f64::INFINITY), 4.0);
    }

    #[test]
    fn the_speed_is_continuous_at_a_key_for_places_and_rotations() {
        let angles = [0.0, 0.3, 0.9, 1.2, 2.0];
        let pose = |k: usize| {
            let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, angles[k]);
            Isometry3::from_parts(Translation3::new(angles[k], 0.0, 0.0), rotation)
        };
        let h = 1e-6;
        for key_time in [1.0, 1.5, 3.0] {
            let [before, at, after] =
                [key_time - h, key_time, key_time + h].map(|t| interpolate(&TIMES, locate(&TIMES, t), pose));
            let speeds = [(before, at), (at, after)].map(|(a, b)| {
                [(b.translation.x - a.translation.x) / h, a.rotation.angle_to(&b.rotation) / h]
            });
            for i in 0..2 {
                assert!(speeds[0][i] > 0.1, "{speeds:?} at {key_time}");
                assert!((speeds[0][i] - speeds[1][i]).abs() < 1e-3, "{speeds:?} at {key_time}");
            }
        }
    }

    #[test]
    fn a_half_turn_between_two_keys_does_not_panic() {
        let pose =
            |k: usize| Isometry3::rotation(nalgebra::Vector3::new(0.0, std::f64::consts::PI * k as f64, 0.0));
        for i in 0..=400 {
            let pose = interpolate(&TIMES, locate(&TIMES, f64::from(i) / 100.0), pose);
            assert!((pose.rotation.coords.norm() - 1.0).abs() < 1e-9);
        }
    }

    /// By hand at 1 s: steps of 1 s and ½ s with the secants 1 and 4 have the weights 2 and 2½, so that the slope is
    /// 4½ / (2/1 + 2½/4) = 12/7 (Moler, Numerical Computing with MATLAB, section 3.4).
    #[test]
    fn the_speed_at_a_key_is_the_weighted_harmonic_mean() {
        let h = 1e-6;
        let values = [0.0, 1.0, 3.0, 4.0, 5.0];
        let speed = (value_at(values, 1.0 + h) - value_at(values, 1.0 - h)) / (2.0 * h);
        assert!((speed - 12.0 / 7.0).abs() < 1e-4, "{speed}");
    }
}
