//! Converts times of measurement from the device's clock to this program's.
//!
//! In: arrival times (our clock) and measurement times (the device's clock, with an unknown offset). Out: measurement times
//! on our clock. The offset is the least difference between arrival and measurement of the last seconds, since no packet
//! arrives before it was measured. Stamps that go back, or lie ahead or far behind, are counted and replaced by the arrival.

/// Largest lead of a stamp before the offset; beyond it the stamp is refused, s.
const AHEAD_S: f64 = 0.05;
/// Largest lag of a stamp behind the offset, s: no tracker's packet is under way for longer.
const BEHIND_S: f64 = 0.5;
/// Number of refused stamps in a row after which the device's clock counts as set, and the offset is determined again.
const MOST_REFUSED: u32 = 20;
/// The offset is the least over the last one to two of these windows, s. A wrong stamp that was accepted is forgotten
/// after that, and within it clocks drift apart by less than the accuracy of the measurement.
const WINDOW_S: f64 = 2.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceClock {
    /// Stamps that were refused.
    pub faults: u64,
    /// Arrival and measurement of the last stamp that was accepted.
    last: Option<[f64; 2]>,
    /// When the current window began, the least offset in it, and that of the previous window.
    window_s: f64,
    least_s: [f64; 2],
    refused: u32,
}

impl DeviceClock {
    /// Time at which it was measured, s of our clock; never after its arrival.
    pub fn time_s(&mut self, arrived_s: f64, measured_s: Option<f64>) -> f64 {
        let Some(measured_s) = measured_s else { return arrived_s };
        let behind_s = arrived_s - measured_s;
        if !behind_s.is_finite() {
            self.faults += 1;
            return arrived_s;
        }
        let Some([_, last_measured_s]) = self.last else {
            self.begin(arrived_s, measured_s);
            return arrived_s;
        };
        let late_s = behind_s - self.offset_s();
        let is_near = (-AHEAD_S..=BEHIND_S).contains(&late_s);
        if measured_s <= last_measured_s || !is_near {
            self.faults += 1;
            self.refused += 1;
            // A little back: either the clock was set or a packet was overtaken. The next stamps will show which.
            let is_set_back = is_near && measured_s < last_measured_s;
            if is_set_back || self.refused >= MOST_REFUSED {
                self.begin(arrived_s, measured_s);
            }
            return arrived_s;
        }
        self.refused = 0;
        self.last = Some([arrived_s, measured_s]);
        if arrived_s - self.window_s >= WINDOW_S {
            let is_next = arrived_s - self.window_s < 2.0 * WINDOW_S;
            self.least_s = [behind_s, if is_next { self.least_s[0] } else { behind_s }];
            self.window_s = arrived_s;
        }
        self.least_s[0] = self.least_s[0].min(behind_s);
        measured_s + self.offset_s()
    }

    fn offset_s(&self) -> f64 {
        self.least_s[0].min(self.least_s[1])
    }

    fn begin(&mut self, arrived_s: f64, measured_s: f64) {
        (self.last, self.refused) = (Some([arrived_s, measured_s]), 0);
        (self.window_s, self.least_s) = (arrived_s, [arrived_s - measured_s; 2]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_packet_keeps_the_time_of_its_measurement() {
        let mut clock = DeviceClock::default();
        assert_eq!(clock.time_s(10.0, Some(5000.0)), 10.0);
        assert!((clock.time_s(10.1, Some(5000.1)) - 10.1).abs() < 1e-4);
        assert!((clock.time_s(10.23, Some(5000.2)) - 10.2).abs() < 1e-4, "30 ms under way");
        assert_eq!(clock.time_s(10.3, None), 10.3);
        assert_eq!(clock.faults, 0);
    }

    #[test]
    fn stamps_that_go_back_or_lie_far_ahead_are_counted_and_the_arrival_counts() {
        let mut clock = DeviceClock::default();
        clock.time_s(10.0, Some(100.0));
        for (arrived_s, measured_s) in
            [(10.1, 99.0), (10.2, 100.0), (10.3, 1e6), (10.4, 1e300), (10.5, f64::NAN)]
        {
            assert_eq!(clock.time_s(arrived_s, Some(measured_s)), arrived_s);
        }
        assert_eq!(clock.faults, 5);
        assert!((clock.time_s(10.6, Some(100.6)) - 10.6).abs() < 1e-3, "and the good ones count again");
    }

    /// Error of the clock for the last of a hundred stamps a second from `from_s` on, against the time at which it was measured.
    fn error_after(clock: &mut DeviceClock, from_s: f64, seconds: f64, set_s: f64) -> f64 {
        let times = (0..(100.0 * seconds) as u32).map(|i| from_s + 0.01 * f64::from(i));
        let errors = times.map(|now_s| clock.time_s(now_s + 0.002, Some(now_s + set_s)) - (now_s + 0.002));
        errors.fold(0.0, |_, error| error)
    }

    #[test]
    fn one_stamp_that_lies_ahead_is_forgotten_within_seconds() {
        let mut clock = DeviceClock::default();
        assert!(error_after(&mut clock, 0.0, 1.0, 500.0).abs() < 1e-9);
        clock.time_s(1.0, Some(501.0 + 0.04));
        assert!((error_after(&mut clock, 1.05, 0.1, 500.0) + 0.042).abs() < 1e-9, "it was believed");
        assert!(error_after(&mut clock, 1.2, 4.2, 500.0).abs() < 1e-9);
        assert_eq!(clock.faults, 0);
    }

    #[test]
    fn a_small_step_of_the_clock_spoils_nothing() {
        let mut clock = DeviceClock::default();
        error_after(&mut clock, 0.0, 1.0, 500.0);
        assert!(error_after(&mut clock, 1.0, 0.1, 500.0 - 0.03).abs() < 1e-9, "set back: at once");
        error_after(&mut clock, 1.1, 0.1, 500.0);
        assert!(error_after(&mut clock, 1.2, 0.1, 500.0).abs() < 1e-9, "set on: at once");
    }

    #[test]
    fn a_clock_that_was_set_is_followed_in_the_end() {
        let mut clock = DeviceClock::default();
        clock.time_s(0.0, Some(1000.0));
        let times: Vec<f64> = (1..=30)
            .map(|i| {
                let arrived_s = f64::from(i) * 0.01;
                // One in two comes 5 ms late.
                clock.time_s(arrived_s + 0.005 * f64::from(i % 2), Some(arrived_s))
            })
            .collect();
        assert_eq!(clock.faults, 20);
        assert!((times[29] - 0.3).abs() < 1e-4 && (times[28] - 0.29).abs() < 1e-4, "{times:?}");
    }

    /// A packet that was faster than all others serves for the rest of its window and for the next one.
    #[test]
    fn the_fastest_packet_counts_for_two_windows() {
        let mut clock = DeviceClock::default();
        let mut late_s = |from: u32, until: u32| {
            let late = |i: u32| {
                let measured_s = 0.01 * f64::from(i);
                // Packets take 12 ms; one took 2 ms.
                let way_s = if i == 100 { 0.002 } else { 0.012 };
                clock.time_s(measured_s + way_s, Some(500.0 + measured_s)) - measured_s
            };
            (from..until).map(late).last().unwrap()
        };
        assert!((late_s(0, 99) - 0.012).abs() < 1e-9, "none is known that was faster");
        assert!((late_s(99, 150) - 0.002).abs() < 1e-9);
        assert!((late_s(150, 380) - 0.002).abs() < 1e-9, "in the next window");
        assert!((late_s(380, 620) - 0.012).abs() < 1e-9, "it is forgotten");
    }
}
