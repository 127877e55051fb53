//! The tables `[tracker.NAME]`, `[sensor.NAME]` and `[stylus.NAME]` of a stage file, and the key `viewer.head`.
//!
//! Out: a checked [`Tracking`], in which the keys of a tracker's source are kept unread for `track::SOURCES`.

use super::super::error::{MAX_MOUNT_M, TrackingFault};
use super::super::tracking::{
    Axis, ButtonId, LostPolicy, OneEuro, Sensor, SourceTable, Stylus, Tracker, TrackerFrame, TrackerSource,
    Tracking,
};
use super::mount::{MountFile, isometry, range};
use crate::config;
use indexmap::IndexMap;
use nalgebra::{Isometry3, Similarity3};
use std::path::Path;
use toml::Spanned;

/// The tracker's frame, and the keys of its source.
#[derive(serde::Deserialize)]
pub struct TrackerFile {
    #[serde(default)]
    room_from_tracker: FrameFile,
    #[serde(flatten)]
    source: toml::Table,
}

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameFile {
    mirror: Option<Axis>,
    scale: Option<f64>,
    position: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    rotation_degrees: Option<[f64; 3]>,
    axes: Option<[[f64; 3]; 3]>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    tracker: String,
    id: i32,
    sensor_from_body: Option<MountFile>,
    body_from_sensor: Option<MountFile>,
    filter: Option<FilterFile>,
    #[serde(default)]
    predict: f64,
    #[serde(default)]
    lost: LostFile,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct FilterFile {
    min_cutoff: f64,
    #[serde(default)]
    beta: f64,
    speed_cutoff: Option<f64>,
}

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct LostFile {
    after: Option<f64>,
    warn: Option<f64>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StylusFile {
    sensor: String,
    grab: Option<ButtonFile>,
    second: Option<ButtonFile>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct ButtonFile {
    tracker: String,
    button: i32,
}

/// Named tables, each with its position in the text.
pub type Tables<T> = IndexMap<String, Spanned<T>>;

/// The valid tracking keys of a stage; `tell` receives every fault and its position in the text. Naming a tracker or a sensor
/// that exists but is at fault is not a second fault.
pub fn check(
    trackers: Tables<TrackerFile>,
    sensors: Tables<SensorFile>,
    styli: Tables<StylusFile>,
    head: Option<&Spanned<String>>,
    (text, path): (&str, &Path),
    tell: &mut dyn FnMut(usize, TrackingFault),
) -> Tracking {
    let mut tracking = Tracking::default();
    let names =
        Names { trackers: trackers.keys().cloned().collect(), sensors: sensors.keys().cloned().collect() };
    for (name, found) in trackers {
        let start = found.span().start;
        let line = config::line_and_column(text, start).0;
        match tracker(&name, found.into_inner(), path, line) {
            Ok(tracker) => drop(tracking.trackers.insert(name, tracker)),
            Err(fault) => tell(start, fault),
        }
    }
    for (name, found) in sensors {
        let start = found.span().start;
        match sensor(&name, found.into_inner(), &names, &tracking) {
            Ok(sensor) => drop(tracking.sensors.insert(name, sensor)),
            Err(fault) => tell(start, fault),
        }
    }
    for (name, found) in styli {
        let start = found.span().start;
        match stylus(&name, found.into_inner(), &names, &tracking) {
            Ok(stylus) => drop(tracking.styli.insert(name, stylus)),
            Err(fault) => tell(start, fault),
        }
    }
    if let Some(head) = head {
        if let Err(fault) = known("the viewer's head", "sensor", head.get_ref(), &names.sensors) {
            tell(head.span().start, fault);
        }
        tracking.head = Some(head.get_ref().clone());
    }
    tracking
}

/// The names of all tables in the file, valid or not.
struct Names {
    trackers: Vec<String>,
    sensors: Vec<String>,
}

fn tracker(name: &str, file: TrackerFile, path: &Path, line: usize) -> Result<Tracker, TrackingFault> {
    let FrameFile { mirror, scale, position, rotation, rotation_degrees, axes } = file.room_from_tracker;
    let what = format!("room_from_tracker of tracker `{name}`");
    let scale = range(&format!("scale in {what}"), scale.unwrap_or(1.0), "", 1e-6, 1e6)?;
    let mount = MountFile { position, rotation, rotation_degrees, axes };
    let room_from_tracker = Similarity3::from_isometry(isometry(&what, &mount)?, scale);
    let source = TrackerSource::Table(SourceTable { keys: file.source, path: path.to_owned(), line });
    Ok(Tracker { source, frame: TrackerFrame { mirror, room_from_tracker } })
}

fn sensor(name: &str, file: SensorFile, names: &Names, tracking: &Tracking) -> Result<Sensor, TrackingFault> {
    let who = format!("sensor `{name}`");
    known(&who, "tracker", &file.tracker, &names.trackers)?;
    let same = |other: &Sensor| other.tracker == file.tracker && other.id == file.id;
    if let Some((first, _)) = tracking.sensors.iter().find(|(_, other)| same(other)) {
        return Err(TrackingFault::SameSensor {
            first: first.clone(),
            second: name.to_owned(),
            tracker: file.tracker,
            id: file.id,
        });
    }
    let filter = match file.filter {
        None => None,
        Some(FilterFile { min_cutoff, beta, speed_cutoff }) => Some(OneEuro {
            min_cutoff: range(&format!("filter.min_cutoff of {who}"), min_cutoff, " of hertz", 1e-3, 1e3)?,
            beta: range(&format!("filter.beta of {who}"), beta, "", 0.0, 1e3)?,
            speed_cutoff: range(
                &format!("filter.speed_cutoff of {who}"),
                speed_cutoff.unwrap_or(1.0),
                " of hertz",
                1e-3,
                1e3,
            )?,
        }),
    };
    let usual = LostPolicy::default();
    let after_s = file.lost.after.unwrap_or(usual.after_s.min(file.lost.warn.unwrap_or(usual.after_s)));
    let after_s = range(&format!("lost.after of {who}"), after_s, " of seconds", 0.01, 60.0)?;
    let warn_s = file.lost.warn.unwrap_or(usual.warn_s.max(after_s));
    let warn_s = range(&format!("lost.warn of {who}"), warn_s, " of seconds", 0.01, 600.0)?;
    if warn_s < after_s {
        return Err(TrackingFault::LostOrder { sensor: name.to_owned(), after_s, warn_s });
    }
    Ok(Sensor {
        sensor_from_body: sensor_from_body(&who, file.sensor_from_body, file.body_from_sensor)?,
        filter,
        predict_s: range(&format!("predict of {who}"), file.predict, " of seconds", 0.0, 0.1)?,
        lost: LostPolicy { after_s, warn_s },
        tracker: file.tracker,
        id: file.id,
    })
}

/// The mount by either of the two keys for it; bodies are near their sensors.
fn sensor_from_body(
    who: &str,
    sensor_from_body: Option<MountFile>,
    body_from_sensor: Option<MountFile>,
) -> Result<Isometry3<f64>, TrackingFault> {
    let (key, mount) = match (&sensor_from_body, &body_from_sensor) {
        (None, None) => return Ok(Isometry3::identity()),
        (Some(_), Some(_)) => return Err(TrackingFault::TwoMounts { who: who.to_owned() }),
        (Some(mount), None) => ("sensor_from_body", mount),
        (None, Some(mount)) => ("body_from_sensor", mount),
    };
    let what = format!("{key} of {who}");
    let read = isometry(&what, mount)?;
    let position = read.translation.vector;
    if position.norm() > MAX_MOUNT_M {
        return Err(TrackingFault::FarBody { what, position: position.into() });
    }
    Ok(if body_from_sensor.is_some() { read.inverse() } else { read })
}

fn stylus(name: &str, file: StylusFile, names: &Names, tracking: &Tracking) -> Result<Stylus, TrackingFault> {
    let who = format!("stylus `{name}`");
    known(&who, "sensor", &file.sensor, &names.sensors)?;
    if let Some((first, _)) = tracking.styli.iter().find(|(_, other)| other.sensor == file.sensor) {
        let (first, second) = (first.clone(), name.to_owned());
        return Err(TrackingFault::SharedSensor { first, second, sensor: file.sensor });
    }
    let button = |found: Option<ButtonFile>| match found {
        None => Ok(None),
        Some(ButtonFile { tracker, button }) => {
            known(&who, "tracker", &tracker, &names.trackers)?;
            Ok(Some(ButtonId { tracker, button }))
        }
    };
    let (grab, second) = (button(file.grab)?, button(file.second)?);
    if grab.is_some() && grab == second {
        return Err(TrackingFault::SameButton { stylus: name.to_owned() });
    }
    Ok(Stylus { sensor: file.sensor, grab, second })
}

fn known(who: &str, kind: &str, name: &str, all: &[String]) -> Result<(), TrackingFault> {
    if all.iter().any(|known| known == name) {
        return Ok(());
    }
    let message = config::unknown_name(kind, name, all.iter().map(String::as_str));
    Err(TrackingFault::UnknownName { who: who.to_owned(), message })
}
