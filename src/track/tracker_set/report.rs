//! Reports on every sensor, button and valuator, for `greenstage track` and the overlay.

use super::follower::SensorFaults;
use crate::stage::tracking::LostPolicy;
use crate::track::device::{Counters, Link, Reading};
use crate::track::state::Signal;
use nalgebra::Isometry3;
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq)]
pub struct TrackerReport {
    pub name: String,
    /// `vrpn Tracker0@host:3883`.
    pub source: String,
    pub link: Link,
    pub counters: Counters,
    /// First those that the stage names, then the others that the tracker reports.
    pub sensors: Vec<SensorReport>,
    pub buttons: Vec<ChannelReport<bool>>,
    pub valuators: Vec<ChannelReport<f64>>,
}

/// One sensor. One that was never reported has no raw pose and the count 0.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorReport {
    /// The stage's name for it; `None` if the stage has none.
    pub name: Option<String>,
    pub id: i32,
    /// The pose that the tracker reported last; `None` if it never tracked the sensor.
    pub raw: Option<Isometry3<f64>>,
    /// The pose in the room: the body's, filtered and predicted, if the stage names the sensor; else the sensor's own.
    pub in_room: Option<Isometry3<f64>>,
    /// The signal by the stage's policy for the sensor, or by the default one if the stage does not name it.
    pub signal: Signal,
    pub quality: f32,
    pub count: u64,
    pub rate_hz: f64,
    /// Time since the last reading arrived, s.
    pub age_s: f64,
    /// RMS noise of the position, in the tracker's unit; a steady motion adds none.
    pub noise: f64,
    /// RMS deviation of the time between readings, s.
    pub interval_jitter_s: f64,
    pub faults: SensorFaults,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ChannelReport<T> {
    pub id: i32,
    pub value: T,
    pub age_s: f64,
    pub count: u64,
}

/// The report on a sensor, whether or not the stage names it.
pub fn sensor(id: i32, reading: Option<&Reading<Isometry3<f64>>>, now_s: f64) -> SensorReport {
    let age_s = reading.map_or(0.0, |reading| (now_s - reading.arrived_s).max(0.0));
    let seen_s = reading.and_then(Reading::seen).map(|(_, arrived_s)| (now_s - arrived_s).max(0.0));
    let LostPolicy { after_s, warn_s } = LostPolicy::default();
    let signal = match seen_s {
        Some(age_s) if age_s <= after_s => Signal::Live,
        Some(age_s) if age_s <= warn_s => Signal::Held { age_s },
        _ => Signal::Lost { age_s: seen_s.unwrap_or(age_s) },
    };
    let gaps = reading.map_or(0, |reading| reading.flow.gaps)
        + u64::from(seen_s.is_some() && signal != Signal::Live);
    SensorReport {
        name: None,
        id,
        raw: reading.and_then(Reading::seen).map(|(pose, _)| pose),
        in_room: None,
        signal,
        quality: reading.map_or(0.0, |reading| reading.quality),
        count: reading.map_or(0, |reading| reading.count),
        rate_hz: reading.map_or(0.0, |reading| reading.flow.rate_hz(age_s)),
        age_s,
        noise: reading.map_or(0.0, |reading| reading.flow.noise()),
        interval_jitter_s: reading.map_or(0.0, |reading| reading.flow.interval_jitter_s()),
        faults: SensorFaults { drop_outs: gaps, ..SensorFaults::default() },
    }
}

/// The reports on all buttons, or on all valuators.
pub fn channels<T: Copy>(readings: &BTreeMap<i32, Reading<T>>, now_s: f64) -> Vec<ChannelReport<T>> {
    let report = |(&id, &Reading { value, arrived_s, count, .. }): (&i32, &Reading<T>)| ChannelReport {
        id,
        value,
        age_s: (now_s - arrived_s).max(0.0),
        count,
    };
    readings.iter().map(report).collect()
}
