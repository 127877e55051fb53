//! Measures how steadily a tracker's channel reports: its rate, the jitter of the arrivals, the noise of the positions.
//!
//! In: the time of every reading, and for a sensor its position. Out: means over about the last 64 readings.
//!
//! [`RateLimiter`] limits how much of a processor a source uses, whatever it is sent: a share of each slot of time.

use crate::stage::tracking::LostPolicy;
use nalgebra::Vector3;

/// The number of readings over which the means run.
const MEMORY: f64 = 64.0;

/// Statistics of one channel's readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flow {
    /// Mean time between two readings, s; 0 before the second one.
    pub interval_s: f64,
    /// Number of times that it was untracked for longer than `after_s` of [`LostPolicy::default`] and then came back.
    pub gaps: u64,
    /// Mean square deviation of that time, s².
    interval_variance: f64,
    intervals: u64,
    /// Mean of |x₀ - 2 x₁ + x₂|² / 6, the device's unit squared.
    noise_variance: f64,
    seconds: u64,
    before: [Option<Vector3<f64>>; 2],
}

impl Flow {
    /// RMS deviation of the time between two readings from its mean, s.
    pub fn interval_jitter_s(&self) -> f64 {
        self.interval_variance.sqrt()
    }

    /// RMS noise of the position over all three axes, in the device's unit. It is computed from second differences, which
    /// vanish for a steady motion and have the variance 6 σ² for white noise of variance σ².
    pub fn noise(&self) -> f64 {
        self.noise_variance.sqrt()
    }

    /// Readings per second at `age_s` after the last one: for a source that has gone silent it falls towards 0.
    pub fn rate_hz(&self, age_s: f64) -> f64 {
        if self.interval_s > 0.0 { 1.0 / self.interval_s.max(age_s) } else { 0.0 }
    }

    pub(super) fn arrived(&mut self, after_s: f64) {
        self.intervals += 1;
        let part = 1.0 / (self.intervals as f64).min(MEMORY);
        let off = after_s - self.interval_s;
        self.interval_s += part * off;
        if self.intervals > 1 {
            self.interval_variance = (1.0 - part) * (self.interval_variance + part * off * off);
        }
    }

    /// The channel is tracked; the last tracked reading came this long before.
    pub(super) fn seen_again(&mut self, after_s: f64) {
        self.gaps += u64::from(after_s > LostPolicy::default().after_s);
    }

    /// `None` if it was not tracked: no differences are taken across a gap.
    pub(super) fn stood(&mut self, place: Option<Vector3<f64>>) {
        if let (Some(place), [Some(last), Some(first)]) = (place, self.before) {
            self.seconds += 1;
            let part = 1.0 / (self.seconds as f64).min(MEMORY);
            let second = (place - last * 2.0 + first).norm_squared() / 6.0;
            self.noise_variance += part * (second - self.noise_variance);
        }
        self.before = if place.is_some() { [place, self.before[0]] } else { [None; 2] };
    }
}

/// A slot of time, and how long a source works in each at most, s.
const SLOT_S: f64 = 0.01;
const WORK_S: f64 = 0.0025;
/// Time that a packet costs the system besides, s.
const RECEIVE_S: f64 = 5e-6;
/// Longest time that one packet counts, s: a busy machine may have stopped in between.
const LONGEST_S: f64 = 1e-3;
/// A changed state is published no more often than this, s.
pub const PUBLISH_S: f64 = 1e-3;

/// Time that a source has worked in the current slot. While it waits, the operating system keeps what arrives, and drops
/// what is too much.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RateLimiter {
    slot_s: f64,
    worked_s: f64,
}

impl RateLimiter {
    /// Counts work on a packet from `from_s` to `until_s`; returns how long to wait, s, if the slot's share is used up.
    pub fn worked(&mut self, from_s: f64, until_s: f64) -> Option<f64> {
        if from_s - self.slot_s >= SLOT_S {
            *self = RateLimiter { slot_s: from_s, worked_s: 0.0 };
        }
        self.worked_s += (until_s - from_s).clamp(0.0, LONGEST_S) + RECEIVE_S;
        let left_s = self.slot_s + SLOT_S - until_s;
        (self.worked_s >= WORK_S && left_s > 0.0).then_some(left_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise without a random generator: the fractional parts of a Weyl sequence, uniform in ±1/2, variance 1/12.
    fn weyl(i: u32, step: f64) -> f64 {
        (f64::from(i) * step).fract() - 0.5
    }

    #[test]
    fn noise_of_a_steady_motion_is_that_of_the_device() {
        let (mut still, mut noisy) = (Flow::default(), Flow::default());
        for i in 0..2000 {
            let place = Vector3::new(f64::from(i) * 0.003, 1.0, -f64::from(i) * 0.001);
            still.stood(Some(place));
            let noise = Vector3::from_fn(|axis, _| weyl(i * i % 7919, 0.618 + 0.1 * axis as f64));
            noisy.stood(Some(place + noise * 1e-3));
        }
        assert!(still.noise() < 1e-9, "{}", still.noise());
        let expected = 1e-3 * (3.0_f64 / 12.0).sqrt();
        assert!((noisy.noise() / expected - 1.0).abs() < 0.3, "{} against {expected}", noisy.noise());
    }

    #[test]
    fn rate_and_jitter_are_those_of_the_arrivals() {
        let mut flow = Flow::default();
        assert_eq!(flow.rate_hz(0.0), 0.0);
        for i in 0..500 {
            flow.arrived(if i % 2 == 0 { 0.009 } else { 0.011 });
        }
        assert!((flow.rate_hz(0.001) - 100.0).abs() < 1.0, "{}", flow.rate_hz(0.001));
        assert!((flow.interval_jitter_s() - 0.001).abs() < 1e-4, "{}", flow.interval_jitter_s());
        assert_eq!(flow.rate_hz(10.0), 0.1);
    }

    /// Packets that take `cost_s` each, as fast as they are taken, for ten seconds: the part of the time worked.
    fn share(cost_s: f64) -> f64 {
        let (mut limiter, mut now_s, mut worked_s) = (RateLimiter::default(), 0.0, 0.0);
        while now_s < 10.0 {
            let until_s = now_s + cost_s;
            worked_s += cost_s;
            now_s = until_s + limiter.worked(now_s, until_s).unwrap_or(0.0);
        }
        worked_s / now_s
    }

    #[test]
    fn a_flood_gets_a_quarter_of_a_processor_whatever_its_packets_cost() {
        for cost_s in [1e-6, 2e-5, 1e-4, 3e-4, 9e-4] {
            let share = share(cost_s);
            assert!(share < 0.36, "{cost_s} s a packet: {share}");
        }
        assert!(share(1e-4) > 0.2);
    }

    #[test]
    fn a_tracker_at_a_kilohertz_never_waits() {
        let mut limiter = RateLimiter::default();
        for i in 0..10_000 {
            let now_s = 1e-3 * f64::from(i);
            assert_eq!(limiter.worked(now_s, now_s + 1e-4), None, "{i}");
        }
    }
}
