//! A Polhemus FASTRAK on a serial line.
//!
//! In: ASCII records, which the device is configured to send. Out: station s as sensor s, the switch of its stylus as
//! button s. From the 3SPACE FASTRAK user manual (OPM00PI002, rev. G, 2012): a record consists of `0`, the station, an
//! error code, and the requested items: position (52), quaternion w x y z (61), switch (66), end of line (1).

use super::device::{DeviceState, Link, now_s};
use super::source_entry::{ExclusiveUse, OpenError, SourceEntry, SourceSettings, device, keys};
use super::worker::{Publisher, Worker};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The device has four receivers; it reads one at 120 Hz or four at 30 Hz.
const STATIONS: u32 = 4;
/// Stop continuous output, use ASCII, use centimetres.
const QUIET: &[u8] = b"cFu";
const CONTINUOUS: &[u8] = b"C";
const METRES: f64 = 0.01;
/// A longer line is malformed, bytes; a record has about 100.
const LONGEST_LINE: usize = 256;
/// Time without a record after which the device is configured again, s.
const SILENCE_S: f64 = 3.0;
const WAKE: Duration = Duration::from_millis(50);

pub const SOURCE: SourceEntry = SourceEntry {
    key: "fastrak",
    more_keys: &["baud"],
    sensors: Some(1..=STATIONS as i32),
    has_buttons: true,
    read,
};

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    fastrak: PathBuf,
    baud: Option<u32>,
}

fn read(tracker: &str, table: &toml::Table) -> Result<SourceSettings, String> {
    let Keys { fastrak, baud } = keys(tracker, table)?;
    let (path, baud) =
        (device(tracker, "fastrak", fastrak, "/dev/ttyUSB0 or COM3")?, baud.unwrap_or(115_200));
    if !(300..=4_000_000).contains(&baud) {
        return Err(format!("baud is {baud}: it must be a number between 300 and 4000000"));
    }
    Ok(SourceSettings {
        exclusive_use: Some(ExclusiveUse::Opens(path.clone())),
        open: Box::new(move |tracker| Ok(Box::new(open(tracker, &path, baud)?))),
    })
}

/// Opens the serial line `device`, now or as soon as it appears.
pub fn open(tracker: &str, device: &Path, baud: u32) -> Result<Worker, OpenError> {
    let description = format!("fastrak {} at {baud} baud", device.display());
    let path = device.to_string_lossy().into_owned();
    Worker::reconnecting(description, move |publisher| {
        match serialport::new(path.as_str(), baud).timeout(WAKE).open() {
            Ok(mut port) => listen(publisher, &mut port),
            Err(error) => error.to_string(),
        }
    })
    .map_err(|source| OpenError::Thread { tracker: tracker.to_owned(), source })
}

/// Configures the device and reads it until it is gone or silent; returns the reason.
pub fn listen(publisher: &mut Publisher, port: &mut (impl Read + Write + ?Sized)) -> String {
    if let Err(error) = command(port) {
        return format!("cannot be commanded: {error}");
    }
    let mut lines = Lines::default();
    let mut heard_s = now_s();
    let mut bytes = [0; 1024];
    while !publisher.is_stopped() {
        match port.read(&mut bytes) {
            Ok(0) => return "the line is closed".into(),
            Ok(count) => {
                publisher.state.counters.packets += 1;
                if lines.take(&bytes[..count], &mut publisher.state) {
                    heard_s = now_s();
                    publisher.state.link = Link::Up;
                }
                publisher.publish();
            }
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return error.to_string(),
        }
        if now_s() - heard_s > SILENCE_S {
            return format!("no record for {SILENCE_S} s: is it on, and is its baud rate the same?");
        }
    }
    // Leave the device silent, as it was found.
    let _ = port.write_all(b"c");
    "stopped".into()
}

fn command(port: &mut (impl Read + Write + ?Sized)) -> std::io::Result<()> {
    port.write_all(QUIET)?;
    for station in 1..=STATIONS {
        port.write_all(format!("O{station},52,61,66,1\r").as_bytes())?;
    }
    port.write_all(CONTINUOUS)?;
    port.flush()
}

/// Splits bytes into lines, each of which is a record.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    line: Vec<u8>,
    is_too_long: bool,
}

impl Lines {
    /// True if these bytes completed at least one good record.
    pub fn take(&mut self, bytes: &[u8], state: &mut DeviceState) -> bool {
        let mut is_good = false;
        for &byte in bytes {
            match byte {
                b'\r' | b'\n' => {
                    if self.is_too_long {
                        state.counters.malformed += 1;
                    } else if !self.line.is_empty() {
                        let taken = record(&self.line, state).is_some();
                        state.counters.messages += u64::from(taken);
                        state.counters.malformed += u64::from(!taken);
                        is_good |= taken;
                    }
                    self.line.clear();
                    self.is_too_long = false;
                }
                _ if self.line.len() < LONGEST_LINE => self.line.push(byte),
                _ => self.is_too_long = true,
            }
        }
        is_good
    }
}

fn record(line: &[u8], state: &mut DeviceState) -> Option<()> {
    // The error code is that of the device's self-test; it does not concern this pose.
    let [b'0', station @ b'1'..=b'9', _error, items @ ..] = line else { return None };
    let station = i32::from(station - b'0');
    let mut numbers = [0.0; 8];
    let mut count = 0;
    for word in std::str::from_utf8(items).ok()?.split_ascii_whitespace() {
        *numbers.get_mut(count)? = word.parse().ok().filter(|value: &f64| value.is_finite())?;
        count += 1;
    }
    let [x, y, z, qw, qx, qy, qz, switch] = numbers;
    let rotation = Quaternion::new(qw, qx, qy, qz);
    if count != numbers.len() || (rotation.norm() - 1.0).abs() > 0.05 || switch != 0.0 && switch != 1.0 {
        return None;
    }
    let place = Translation3::from(Vector3::new(x, y, z) * METRES);
    let pose = Isometry3::from_parts(place, UnitQuaternion::new_normalize(rotation));
    state.take_pose(station, pose, None, 1.0);
    state.take_button(station, switch == 1.0, None);
    Some(())
}
