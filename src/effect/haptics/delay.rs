//! How old the pose is behind the force that acts on the hand, at worst: the one place where it is reckoned.
//!
//! A pose is measured at s_k, is seen by a tick at e_k, and the force that follows from it acts from then on, later by
//! the messages' way, until the force from pose k + 1 does. Just before, pose k has the age A_k = e_{k+1} - s_k + t_m,
//! with t_m for both ways of messages and the device's own turn. T is the mean time between two poses, as the device really
//! reports; A the greatest A_k of late. A = T + τ then adds up the period, the age τ of a pose when its force begins to act,
//! and all jitter.
//!
//! In: what the device said, and when; t_m as the device's echo measures it; the stage's `latency`, of which the larger
//! counts. Out: T and τ, for [`super::passivity`]. A rises at once and falls slowly ([`Peak`]).

use super::device::Reading;
use crate::base::peak::Peak;

/// Time constant of T, s.
const PERIOD_S: f64 = 0.2;
/// A longer silence is no age, but an absence: there is no force any more, s.
const ABSENT_S: f64 = 0.04;
/// Two clocks drift apart by no more, s/s: the most that a time service corrects by.
const DRIFT: f64 = 5e-4;
/// A clock that leaps by more was set, s.
const SET_S: f64 = 1.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    /// Poses per second: the mean of 1/T_i in which each counts by its length, so that it is that of the poses counted.
    rate_hz: f64,
    age: Peak,
    newest: Option<Pose>,
    clock: Clock,
}

/// When a pose arrived, and when it would have on the fastest way that was seen; seconds of this program's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pose {
    arrived_s: f64,
    sampled_s: f64,
}

/// The device's own clock, as far as its stamps tell.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Clock {
    Unheard,
    /// The last stamp, and the least of arrival less stamp: what is more than that a message was late by.
    Runs {
        stamp_s: f64,
        least_s: f64,
    },
    /// It stood still between two poses: too coarse to be of use.
    Coarse,
}

impl Delay {
    /// Steady and at once, so far.
    pub fn new(period_s: f64) -> Delay {
        Delay { rate_hz: 1.0 / period_s, age: Peak::default(), newest: None, clock: Clock::Unheard }
    }

    /// T, s.
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// τ: how old a pose is when the force from it begins to act, with all jitter; `given_s` at least.
    pub fn age_s(&self, given_s: f64) -> f64 {
        (self.age.value - self.period_s()).max(given_s).max(0.0)
    }

    /// A tick at `now_s` has this reading, of a device whose messages and turn take `echo_s`. Says when it was measured, on the
    /// fastest way.
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
    /// When a pose that has just arrived was measured, on the fastest way; without a clock when it arrived.
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
    use super::super::device::SampleInfo;
    use super::*;
    use nalgebra::Isometry3;

    fn reading(arrived_s: f64, measured_s: Option<f64>) -> Reading {
        Reading {
            device_from_handle: Isometry3::identity(),
            buttons: [false; 2],
            arrived_s,
            measured_s,
            tracked: true,
            info: SampleInfo::default(),
        }
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

    /// Without stamps jitter shows in the longest silence, with them in the stamps too; both find at least what there was, and
    /// not much more than the wait for a tick beside it.
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

    /// It grows with the first report that is late, and shrinks by a third in two seconds.
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
