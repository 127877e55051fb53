//! A gamepad or joystick under Linux: buttons, and axes as valuators from -1 to 1.
//!
//! In: records of 8 bytes read from /dev/input/js0 (the kernel's joystick API: time in ms as u32, value as i16, kind,
//! number). Out: button n and valuator n. It has no poses; a stylus can use its buttons.

use super::device::{DeviceState, Link};
use super::source_entry::{ExclusiveUse, OpenError, SourceEntry, SourceSettings, device, keys};
use super::worker::Worker;
use std::path::{Path, PathBuf};

pub const RECORD: usize = 8;
const BUTTON: u8 = 1;
const AXIS: u8 = 2;
/// Set in the records that describe the state at the time of opening.
const INITIAL: u8 = 0x80;

pub const SOURCE: SourceEntry =
    SourceEntry { key: "gamepad", more_keys: &[], sensors: None, has_buttons: true, read };

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    gamepad: PathBuf,
}

fn read(tracker: &str, table: &toml::Table) -> Result<SourceSettings, String> {
    let path = device(tracker, "gamepad", keys::<Keys>(tracker, table)?.gamepad, "/dev/input/js0")?;
    Ok(SourceSettings {
        exclusive_use: Some(ExclusiveUse::Opens(path.clone())),
        open: Box::new(move |tracker| Ok(Box::new(open(tracker, &path)?))),
    })
}

/// Takes one record.
pub fn take(record: [u8; RECORD], state: &mut DeviceState) {
    let [t0, t1, t2, t3, v0, v1, kind, number] = record;
    let measured_s = Some(f64::from(u32::from_ne_bytes([t0, t1, t2, t3])) * 1e-3);
    let value = i16::from_ne_bytes([v0, v1]);
    state.counters.messages += 1;
    match kind & !INITIAL {
        BUTTON => state.take_button(number.into(), value != 0, measured_s),
        AXIS => {
            let part = (f64::from(value) / f64::from(i16::MAX)).max(-1.0);
            state.take_valuator(number.into(), part, measured_s);
        }
        _ => state.counters.malformed += 1,
    }
}

#[cfg(not(target_os = "linux"))]
pub fn open(tracker: &str, device: &Path) -> Result<Worker, OpenError> {
    let why = format!(
        "{} cannot be read: gamepads are read from Linux' joystick devices alone; on this system use a VRPN server",
        device.display()
    );
    Err(OpenError::Unsupported { tracker: tracker.to_owned(), why })
}

/// Opens `device`, now or as soon as it is plugged in.
#[cfg(target_os = "linux")]
pub fn open(tracker: &str, device: &Path) -> Result<Worker, OpenError> {
    let description = format!("gamepad {}", device.display());
    let device = device.to_owned();
    Worker::reconnecting(description, move |publisher| {
        let why = match std::fs::File::open(&device) {
            Ok(mut file) => {
                publisher.state.link = Link::Up;
                publisher.publish();
                listen(publisher, &mut file)
            }
            Err(error) => error.to_string(),
        };
        // The buttons of a device that is gone count as released.
        publisher.state.buttons.values_mut().for_each(|button| button.value = false);
        why
    })
    // Its thread is blocked in a read until the next event of the device.
    .map(Worker::detached)
    .map_err(|source| OpenError::Thread { tracker: tracker.to_owned(), source })
}

#[cfg(target_os = "linux")]
fn listen(publisher: &mut super::worker::Publisher, file: &mut impl std::io::Read) -> String {
    let mut record = [0; RECORD];
    while !publisher.is_stopped() {
        if let Err(error) = file.read_exact(&mut record) {
            return match error.kind() {
                std::io::ErrorKind::UnexpectedEof => "unplugged".into(),
                _ => error.to_string(),
            };
        }
        publisher.state.counters.packets += 1;
        take(record, &mut publisher.state);
        publisher.publish();
    }
    "stopped".into()
}
