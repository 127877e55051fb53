//! Measures how old a pose is, at worst, while the force that follows from it acts on the hand.
//!
//! A pose is measured at s_k and used by a tick at e_k. After the travel time of the message its force acts until the force
//! of pose k + 1 does. Just before that, pose k has the age A_k = e_{k+1} - s_k + t_m, where t_m is the travel time of
//! messages both ways and the device's own cycle. T is the mean time between two poses as the device reports them, and A
//! the greatest recent A_k. Then A = T + τ contains the period, the age τ of a pose when its force begins to act, and all
//! jitter.
//!
//! In: the device's readings and their times; t_m, the larger of the echo's measurement and the stage's `latency`. Out: T
//! and τ, for the observer of `passivity`. A rises at once and falls slowly ([`Peak`]).

use super::device::Reading;
use crate::base::peak::Peak;

/// Time constant of T, s.
const PERIOD_S: f64 = 0.2;
/// Silence after which the device counts as absent, s, and there is no force.
const ABSENT_S: f64 = 0.04;
/// The greatest drift between two clocks, s/s: the most by which a time service corrects.
const DRIFT: f64 = 5e-4;
/// A clock that jumps by more than this has been set, s.
const SET_S: f64 = 1.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    /// Poses per second: the mean of 1/T_i weighted by T_i, which equals the number of poses per time.
    rate_hz: f64,
    age: Peak,
    newest: Option<Pose>,
    clock: Clock,
}

/// Times of a pose, s of this program's clock: its arrival, and what that would have been with the shortest travel time so far.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pose {
    arrived_s: f64,
    sampled_s: f64,
}

/// State of the device's clock, as its stamps show it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Clock {
    Unheard,
    /// The last stamp, and the least difference between arrival and stamp; a message with a greater difference was late.
    Runs {
        stamp_s: f64,
        least_s: f64,
    },
    /// Two poses had the same stamp: the clock is too coarse.
    Coarse,
}

impl Delay {
    /// Starts with a steady device without delay.
    pub fn new(period_s: f64) -> Delay {
        Delay { rate_hz: 1.0 / period_s, age: Peak::default(), newest: None, clock: Clock::Unheard }
    }

    /// T, s.
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// τ: the age of a pose when its force begins to act, with all jitter; at least `given_s`.
    pub fn age_s(&self, given_s: f64) -> f64 {
        (self.age.value - self.period_s()).max(given_s).max(0.0)
    }

    /// Takes the reading of the tick at `now_s`; the device's messages and cycle take `echo_s`. Returns when the pose was
    /// measured, by the shortest travel time.
    pub fn heard(&mut self, reading: &Reading, now_s: f64, echo_s: f64) -> f64 {
        let last = self.newest;
        let arrived_s = reading.arrived_s;
        let age_s = last.map_or(0.0, |last| now_s - last.sampled_s + echo_s);
        if let Some(last) = last.filter(|last| arrived_s <= last.arrived_s) {
            return last.sampled_s;
        }
        let sampled_s =
            self.clock.sampled(reading).max(last.map_or(f64::NEG_INFINITY, |last| last.sampled_s));
        self.newest = Some(Pose { arrived_s, sampled_s });
        if let Some(time_s) = last.map(|last| arrived_s - last.arrived_s).filter(|time_s| *time_s < ABSENT_S)
        {
            self.rate_hz += (1.0 - self.rate_hz * time_s) / (time_s + PERIOD_S);
            self.age.take(age_s, now_s);
        }
        sampled_s
    }
}

impl Clock {
    /// The time at which a pose that has just arrived was measured, by the shortest travel time; without a clock, that of its
    /// arrival.
    fn sampled(&mut self, reading: &Reading) -> f64 {
        let (arrived_s, Some(measured_s)) = (reading.arrived_s, reading.measured_s) else {
            return reading.arrived_s;
        };
        let anew = Clock::Runs { stamp_s: measured_s, least_s: arrived_s - measured_s };
        let mut late_s = 0.0;
        *self = match *self {
            Clock::Coarse => Clock::Coarse,
            Clock::Runs { stamp_s, .. } if stamp_s == measured_s => Clock::Coarse,
            Clock::Runs { stamp_s, least_s } if (0.0..SET_S).contains(&(measured_s - stamp_s)) => {
                let behind_s = arrived_s - measured_s;
                let least_s = behind_s.min(least_s + DRIFT * (measured_s - stamp_s));
                late_s = behind_s - least_s;
                if late_s < ABSENT_S { Clock::Runs { stamp_s: measured_s, least_s } } else { anew }
            }
            _ => anew,
        };
        if late_s < ABSENT_S { arrived_s - late_s } else { arrived_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;

    fn reading(arrived_s: f64, measured_s: Option<f64>) -> Reading {
        Reading { measured_s, ..Reading::at(Isometry3::identity(), arrived_s) }
    }

    /// Ticks of a kilohertz, which see the newest of `poses` (measured, arrived) that has come.
    fn ticks(delay: &mut Delay, poses: &[(f64, f64)], stamped: bool, until_s: f64, echo_s: f64) {
        let mut next = 0;
        for tick in 0..(until_s / 1e-3).round() as u32 {
            let now_s = 1e-3 * f64::from(tick);
            while poses.get(next).is_some_and(|(_, arrived_s)| *arrived_s <= now_s) {
                next += 1;
            }
            if let Some((measured_s, arrived_s)) = next.checked_sub(1).map(|last| poses[last]) {
                delay.heard(&reading(arrived_s, stamped.then_some(500.0 + measured_s)), now_s, echo_s);
            }
        }
    }

    /// A pose every `step_s`, late by `late_s` of its number.
    fn poses(step_s: f64, late_s: impl Fn(u32) -> f64) -> Vec<(f64, f64)> {
        (0..2000).map(|i| (step_s * f64::from(i), step_s * f64::from(i) + late_s(i))).collect()
    }

    #[test]
    fn a_steady_device_is_no_older_than_its_messages() {
        let mut delay = Delay::new(1e-3);
        ticks(&mut delay, &poses(1e-3, |_| 0.0), false, 1.5, 0.0);
        assert!((delay.period_s() - 1e-3).abs() < 1e-9 && delay.age_s(0.0) < 1e-9, "{delay:?}");
        assert_eq!(delay.age_s(2e-3), 2e-3, "what is given counts where it is more");
        ticks(&mut delay, &poses(1e-3, |_| 0.0), false, 1.5, 1.6e-3);
        let mut delay = Delay::new(1e-3);
        ticks(&mut delay, &poses(0.01, |_| 0.0), false, 5.0, 1.6e-3);
        assert!((delay.period_s() - 0.01).abs() < 1e-5, "a hundred reports a second: {delay:?}");
        assert!((delay.age_s(0.0) - 1.6e-3).abs() < 1e-5, "{delay:?}");
    }

    /// Jitter shows in the longest silence if there are no stamps, and also in the stamps if there are; both estimates are at
    /// least the true jitter, and exceed it by not much more than the wait for a tick.
    #[test]
    fn jitter_is_found_with_stamps_and_without() {
        for stamped in [false, true] {
            let mut delay = Delay::new(1e-3);
            let late = |i: u32| 5e-3 * (f64::from(i) * 0.618_034).fract();
            ticks(&mut delay, &poses(5e-3, late), stamped, 9.0, 0.0);
            let age_s = delay.age_s(0.0);
            assert!((delay.period_s() - 5e-3).abs() < 2e-4, "{stamped} {delay:?}");
            assert!(age_s > 2.8e-3 && age_s < 6.5e-3, "{stamped}: {age_s}");
            if stamped {
                assert!(age_s > 4.7e-3, "{age_s}");
            }
        }
    }

    /// The age grows with the first report that is late, and shrinks by a third in two seconds.
    #[test]
    fn an_age_that_grows_counts_at_once_and_one_that_shrinks_slowly() {
        let mut delay = Delay::new(1e-3);
        ticks(&mut delay, &poses(1e-3, |_| 0.0), false, 1.5, 0.0);
        for (now_s, age_s) in [(1.502, 2e-3), (1.517, 0.014), (1.552, 0.034), (1.6, 0.034)] {
            delay.heard(&reading(now_s, None), now_s, 0.0);
            assert!((delay.age_s(0.0) - age_s).abs() < 1.5e-3, "{now_s}: {delay:?}");
        }
        for i in 1..2000 {
            let now_s = 1.6 + 1e-3 * f64::from(i);
            delay.heard(&reading(now_s, None), now_s, 0.0);
        }
        let age_s = delay.age_s(0.0);
        assert!(age_s > 0.02 && age_s < 0.027, "two seconds later: {age_s}");
    }

    /// Clocks that were set, that stand still or that mean nothing are not believed.
    #[test]
    fn stamps_that_cannot_be_are_passed_over() {
        let wild: [&dyn Fn(u32) -> f64; 3] =
            [&|i| if i > 1000 { 7e4 } else { 0.0 } + 1e-3 * f64::from(i), &|i| f64::from(i / 100), &|i| {
                f64::from(i * 7919 % 1000)
            }];
        for (number, stamp) in wild.into_iter().enumerate() {
            let mut delay = Delay::new(1e-3);
            for i in 0..3000 {
                let now_s = 1e-3 * f64::from(i);
                delay.heard(&reading(now_s, Some(stamp(i))), now_s, 0.0);
            }
            assert!(delay.age_s(0.0) < 1e-3, "{number}: {delay:?}");
        }
    }
}
