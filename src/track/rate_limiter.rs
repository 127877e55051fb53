//! Limits how much of a processor a source uses, whatever it is sent: a share of each slot of time.
//!
//! In: when work on a packet began and ended. Out: how long to wait before the next one. The operating system keeps what
//! comes meanwhile, and drops what is too much.

/// A slot of time, and how long a source works in each at most, s.
const SLOT_S: f64 = 0.01;
const WORK_S: f64 = 0.0025;
/// Time that a packet costs the system besides, s.
const RECEIVE_S: f64 = 5e-6;
/// Longest time that one packet counts, s: a busy machine may have stopped in between.
const LONGEST_S: f64 = 1e-3;
/// A changed state is published no more often than this, s.
pub const PUBLISH_S: f64 = 1e-3;

/// Time that a source has worked in the current slot.
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
