//! The list of sources: which key of a stage's `[tracker.NAME]` table each kind of tracker has, and what opens it.
//!
//! In: the table as the stage keeps it. Out: a running [`Source`], or an error that names file, line and remedy.

use super::device::Source;
use super::source_entry::{ExclusiveUse, OpenError, SourceEntry};
use super::{dtrack, fastrak, gamepad, osc, vrpn};
use crate::config;
use crate::stage::tracking::{SourceTable, TrackerSource, Tracking};
use crate::stage::{LocatedFault, Stage, StageError, StageFault};

/// All kinds of trackers; a new one is one file and one line here.
pub const SOURCES: &[SourceEntry] =
    &[vrpn::client::SOURCE, dtrack::SOURCE, osc::SOURCE, fastrak::SOURCE, gamepad::SOURCE];

pub fn open(tracker: &str, source: &TrackerSource) -> Result<Box<dyn Source>, OpenError> {
    match source {
        TrackerSource::Table(table) => {
            let settings = entry(tracker, table).and_then(|entry| (entry.read)(tracker, &table.keys));
            let settings = settings.map_err(|message| invalid(table, message))?;
            (settings.open)(tracker)
        }
        TrackerSource::Haptic(_) => {
            let why = "a force device is opened by whoever gives it forces".to_owned();
            Err(OpenError::Unsupported { tracker: tracker.to_owned(), why })
        }
    }
}

/// A built-in stage or a stage file ([`Stage::find`]) whose trackers' tables can be read, too.
pub fn find_stage(name: &str) -> Result<Stage, StageError> {
    checked(Stage::find(name)?)
}

/// The stage, if its trackers' tables can be read, too.
pub fn checked(stage: Stage) -> Result<Stage, StageError> {
    match faults(&stage.tracking).into_iter().next() {
        Some((table, message)) => Err(invalid(table, message)),
        None => Ok(stage),
    }
}

/// All that is wrong with the sources' tables of a stage.
pub fn source_faults(tracking: &Tracking) -> impl Iterator<Item = LocatedFault> {
    let located = |(table, message): (&SourceTable, _)| LocatedFault {
        line: table.line,
        fault: StageFault::Source(message),
    };
    faults(tracking).into_iter().map(located)
}

fn invalid(table: &SourceTable, message: String) -> StageError {
    StageError::Invalid { path: table.path.clone(), line: table.line, fault: StageFault::Source(message) }
}

/// Each table that is at fault with its first fault; two trackers cannot use the same port or device.
fn faults(tracking: &Tracking) -> Vec<(&SourceTable, String)> {
    let mut used: Vec<(&str, ExclusiveUse)> = Vec::new();
    let mut found = Vec::new();
    for (name, tracker) in &tracking.trackers {
        let TrackerSource::Table(table) = &tracker.source else { continue };
        let settings = entry(name, table).and_then(|entry| {
            let settings = (entry.read)(name, &table.keys)?;
            heard(entry, name, tracking).map(|()| settings)
        });
        let settings = match settings {
            Ok(settings) => settings,
            Err(message) => {
                found.push((table, message));
                continue;
            }
        };
        let Some(own) = settings.exclusive_use else { continue };
        match used.iter().find(|(_, other)| own.clashes_with(other)) {
            Some((first, _)) => found.push((
                table,
                format!(
                    "trackers `{first}` and `{name}` both use {own}: only one can receive data; remove the other: \
                     several sensors may name the same tracker"
                ),
            )),
            None => used.push((name, own)),
        }
    }
    found
}

/// Errors for a sensor or a button of the stage that a tracker of this kind never reports.
fn heard(entry: &SourceEntry, tracker: &str, tracking: &Tracking) -> Result<(), String> {
    let SourceEntry { key, sensors, .. } = entry;
    for (name, sensor) in tracking.sensors.iter().filter(|(_, sensor)| sensor.tracker == tracker) {
        if sensors.as_ref().is_none_or(|sensors| !sensors.contains(&sensor.id)) {
            let has = match sensors {
                None => "no sensors".to_owned(),
                Some(sensors) => format!("the sensors {} to {}", sensors.start(), sensors.end()),
            };
            return Err(format!(
                "sensor `{name}` has id = {}, and tracker `{tracker}` ({key}) has {has}",
                sensor.id
            ));
        }
    }
    for (name, stylus) in tracking.styli.iter().filter(|_| !entry.has_buttons) {
        if [&stylus.grab, &stylus.second].into_iter().flatten().any(|button| button.tracker == tracker) {
            return Err(format!(
                "stylus `{name}` names a button of tracker `{tracker}` ({key}), which has none: take one of another tracker"
            ));
        }
    }
    Ok(())
}

/// Finds the entry of a table by its keys.
fn entry(tracker: &str, table: &SourceTable) -> Result<&'static SourceEntry, String> {
    let keys = &table.keys;
    let given: Vec<&'static SourceEntry> =
        SOURCES.iter().filter(|entry| keys.contains_key(entry.key)).collect();
    for key in keys.keys().filter(|key| given.iter().all(|entry| entry.key != key.as_str())) {
        let goes_with = |entry: &&SourceEntry| entry.more_keys.contains(&key.as_str());
        let with: Vec<&str> = SOURCES.iter().filter(goes_with).map(|entry| entry.key).collect();
        if with.is_empty() {
            let own =
                |entry: &'static SourceEntry| [entry.key].into_iter().chain(entry.more_keys.iter().copied());
            let known = SOURCES.iter().flat_map(own).chain(["room_from_tracker"]);
            return Err(format!("tracker `{tracker}`: {}", config::unknown_name("key", key, known)));
        }
        if !given.iter().any(goes_with) {
            let with = with.join(" or ");
            return Err(format!("`{key}` of tracker `{tracker}` goes with `{with}` alone: remove it"));
        }
    }
    match given[..] {
        [entry] => Ok(entry),
        _ => {
            let given: Vec<&str> = given.iter().map(|entry| entry.key).collect();
            let found = if given.is_empty() { "none of them".to_owned() } else { given.join(" and ") };
            let all: Vec<&str> = SOURCES.iter().map(|entry| entry.key).collect();
            Err(format!("tracker `{tracker}` has {found}: give exactly one of {}", all.join(", ")))
        }
    }
}

#[cfg(test)]
mod tests;
