//! The tables `[haptic.NAME]` of a stage file: each becomes a [`Haptic`] whose numbers lie within their ranges.
//!
//! A device that measures its handle is also a tracker, with its own sensor and stylus.

use super::super::error::StageFault;
use super::super::haptic::{GripButton, Haptic, HapticDevice};
use super::super::tracking::{
    ButtonId, LostPolicy, Sensor, Stylus, Tracker, TrackerFrame, TrackerSource, Tracking,
};
use super::mount::{MountFile, isometry};
use nalgebra::Similarity3;

/// The largest latency, s; a force that is based on an older pose is not applied.
const MOST_LATENCY_S: f64 = 0.1;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HapticFile {
    device: String,
    stylus: Option<String>,
    rate: Option<f64>,
    max_force: Option<f64>,
    max_torque: Option<f64>,
    force: Option<f64>,
    motion: Option<f64>,
    damping: Option<f64>,
    rotational_damping: Option<f64>,
    mass: Option<f64>,
    inertia: Option<f64>,
    virtual_damping: Option<f64>,
    grab: Option<GripButton>,
    second: Option<GripButton>,
    latency: Option<f64>,
    #[serde(default)]
    room_from_device: MountFile,
    #[serde(default)]
    sensor_from_body: MountFile,
}

/// Checks one table.
pub fn check(name: &str, file: &HapticFile) -> Result<Haptic, StageFault> {
    let fault = |message: String| StageFault::Haptic { name: name.to_owned(), message };
    let device = device(&file.device).map_err(fault)?;
    let usual = Haptic::simulated(name);
    let is_simulated = device == HapticDevice::Simulated;
    if file.max_force.is_none() && !is_simulated {
        return Err(fault("max_force is missing: give what the device can push with for long, N".to_owned()));
    }
    // Neither VRPN nor the Inverse3 has torque.
    let torque = file.max_torque.unwrap_or(if is_simulated { usual.max_torque_nm } else { 0.0 });
    if torque > 0.0 && !is_simulated {
        return Err(fault(format!(
            "max_torque is {torque}, but \"{}\" has no torque: remove it",
            file.device
        )));
    }
    let stylus = file.stylus.clone().unwrap_or_else(|| name.to_owned());
    let mut haptic = Haptic { buttons: buttons(file, &device).map_err(fault)?, device, stylus, ..usual };
    for (key, number, given, unit, min, max) in [
        ("rate", &mut haptic.rate_hz, file.rate, " of Hz", 100.0, 20_000.0),
        ("max_force", &mut haptic.max_force_n, file.max_force, " of N", 0.1, 100.0),
        ("max_torque", &mut haptic.max_torque_nm, Some(torque), " of N·m", 0.0, 10.0),
        ("force", &mut haptic.force, file.force, "", 1e-6, 1e6),
        ("motion", &mut haptic.motion, file.motion, "", 1e-3, 1e3),
        ("damping", &mut haptic.damping, file.damping, " of N·s/m", 1e-3, 1e3),
        (
            "rotational_damping",
            &mut haptic.rotational_damping,
            file.rotational_damping,
            " of N·m·s/rad",
            1e-6,
            10.0,
        ),
        ("mass", &mut haptic.mass, file.mass, " of kg", 1e-3, 10.0),
        ("inertia", &mut haptic.inertia, file.inertia, " of kg·m²", 1e-7, 1.0),
        ("virtual_damping", &mut haptic.virtual_damping, file.virtual_damping, " of N·s/m", 0.0, 1e3),
        ("latency", &mut haptic.latency_s, file.latency, " of s", 0.0, MOST_LATENCY_S),
    ] {
        *number = given.unwrap_or(*number);
        if !(min..=max).contains(number) {
            return Err(fault(format!(
                "{key} is {number}: it must be a number{unit} between {min} and {max}"
            )));
        }
    }
    let mount = |key: &str, mount: &MountFile| isometry(&format!("{key} of haptic `{name}`"), mount);
    haptic.room_from_device = mount("room_from_device", &file.room_from_device)?;
    haptic.sensor_from_body = mount("sensor_from_body", &file.sensor_from_body)?;
    if haptic.virtual_damping >= haptic.damping {
        return Err(fault(format!(
            "virtual_damping {} is not below the device's own damping {}: nothing would be left for the body",
            haptic.virtual_damping, haptic.damping
        )));
    }
    Ok(haptic)
}

/// The grip's buttons that grab and act as the second button.
fn buttons(file: &HapticFile, device: &HapticDevice) -> Result<[GripButton; 2], String> {
    let given = file.grab.map(|_| "grab").or(file.second.map(|_| "second"));
    if let (Some(key), HapticDevice::Simulated | HapticDevice::Vrpn(_)) = (given, device) {
        return Err(format!(
            "{key} is for the buttons of a Haply grip, but device is \"{}\": remove it",
            file.device
        ));
    }
    let [grab, second] = [file.grab.unwrap_or(GripButton::A), file.second.unwrap_or(GripButton::B)];
    if grab == second {
        return Err(format!("grab and second are both \"{}\": give second another", grab.name()));
    }
    Ok([grab, second])
}

/// Adds a real device to the trackers: sensor 0 is its handle, buttons 0 and 1 grab and act as the second button. A
/// simulated device is moved by the stylus instead.
pub fn sense(haptic: &Haptic, tracking: &mut Tracking) -> Result<(), StageFault> {
    if haptic.device == HapticDevice::Simulated {
        return Ok(());
    }
    let Haptic { name, stylus, .. } = haptic;
    if let Some(other) = tracking.styli.get(stylus) {
        let message = format!(
            "stylus `{stylus}` follows sensor `{}` already: remove [stylus.{stylus}], or give the device a stylus of its \
             own by the key `stylus`",
            other.sensor
        );
        return Err(StageFault::Haptic { name: name.clone(), message });
    }
    let tracker = haptic.tracker();
    let room_from_tracker = Similarity3::from_isometry(haptic.room_from_device, haptic.motion);
    let frame = TrackerFrame { mirror: None, room_from_tracker };
    let button = |button| Some(ButtonId { tracker: tracker.clone(), button });
    let followed = Stylus { sensor: tracker.clone(), grab: button(0), second: button(1) };
    let sensor = Sensor {
        tracker: tracker.clone(),
        id: 0,
        sensor_from_body: haptic.sensor_from_body,
        filter: None,
        predict_s: 0.0,
        lost: LostPolicy::default(),
    };
    let source = TrackerSource::Haptic(haptic.device.clone());
    tracking.trackers.insert(tracker.clone(), Tracker { source, frame });
    tracking.sensors.insert(tracker, sensor);
    tracking.styli.insert(stylus.clone(), followed);
    Ok(())
}

/// Checks that the stylus exists, and that no other device uses it.
pub fn check_stylus<'a>(
    haptic: &Haptic,
    mut others: impl Iterator<Item = &'a Haptic>,
    tracking: &Tracking,
) -> Result<(), StageFault> {
    let Haptic { name, stylus, .. } = haptic;
    let fault = |message: String| Err(StageFault::Haptic { name: name.clone(), message });
    if let Some(other) = others.find(|other| other.stylus == *stylus) {
        return fault(format!(
            "stylus `{stylus}` is that of haptic `{}` already: give each device one of its own by the key `stylus`",
            other.name
        ));
    }
    let known = tracking.stylus_names();
    if known.contains(&stylus.as_str()) {
        return Ok(());
    }
    fault(crate::config::unknown_name("stylus", stylus, known.into_iter()))
}

fn device(text: &str) -> Result<HapticDevice, String> {
    let wrong = || {
        Err(format!(
            "device is \"{text}\": write \"simulated\", \"vrpn://host/Phantom0\" or \"haply://localhost:10001\""
        ))
    };
    let is_place = |place: &str| {
        !place.is_empty()
            && place.len() <= 256
            && place.chars().all(|c| c.is_ascii_alphanumeric() || "-_.:[]".contains(c))
    };
    if text == "simulated" {
        return Ok(HapticDevice::Simulated);
    }
    if let Some((host, name)) = text.strip_prefix("vrpn://").and_then(|rest| rest.split_once('/')) {
        return if is_place(host) && is_place(name) {
            Ok(HapticDevice::Vrpn(format!("{name}@{host}")))
        } else {
            wrong()
        };
    }
    match text.strip_prefix("haply://") {
        Some(place) if is_place(place) => Ok(HapticDevice::Haply(place.to_owned())),
        _ => wrong(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::{BUILT_IN, Stage};
    use nalgebra::{Isometry3, Vector3};
    use std::path::Path;

    fn stage(table: &str) -> Result<Stage, String> {
        let text = format!("{}\n[haptic.right]\n{table}\n", BUILT_IN[0].1);
        Stage::parse(&text, Path::new("bench.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn devices_are_read_with_their_limits() {
        assert_eq!(stage("device = \"simulated\"").unwrap().haptics, [Haptic::simulated("right")]);
        let found = stage(
            "device = \"vrpn://10.0.0.5:4000/Phantom0\"\nmax_force = 3.3\nmotion = 2.0\nstylus = \"pen\"\n\
             latency = 0.002\nroom_from_device = { position = [0.0, 0.9, 0.4] }",
        );
        let found = found.unwrap().haptics.remove(0);
        assert_eq!(found.device, HapticDevice::Vrpn("Phantom0@10.0.0.5:4000".into()));
        assert_eq!((found.max_force_n, found.max_torque_nm, found.motion), (3.3, 0.0, 2.0));
        assert_eq!(found.latency_s, 0.002);
        assert_eq!((found.stylus.as_str(), found.room_from_device.translation.y), ("pen", 0.9));
        let found = stage("device = \"haply://localhost\"\nmax_force = 5").unwrap().haptics.remove(0);
        assert_eq!(found.device, HapticDevice::Haply("localhost".into()));
        assert_eq!(found.buttons, [GripButton::A, GripButton::B]);
        let other = "device = \"haply://localhost\"\nmax_force = 5\ngrab = \"c\"\nsecond = \"up\"";
        assert_eq!(stage(other).unwrap().haptics[0].buttons, [GripButton::C, GripButton::Up]);
    }

    #[test]
    fn a_real_device_is_a_tracker_with_its_stylus_and_a_simulated_one_is_not() {
        let real = "device = \"haply://localhost\"\nmax_force = 5\nmotion = 2.0\nstylus = \"pen\"\n\
                    room_from_device = { position = [0.0, 0.9, 0.4], axes = [[0, 0, -1], [0, 1, 0], [1, 0, 0]] }\n\
                    sensor_from_body = { position = [0.0, 0.0, -0.1] }";
        let stage_of = stage;
        let stage = stage_of(real).unwrap();
        let tracking = &stage.tracking;
        assert_eq!(
            tracking.trackers["haptic.right"].source,
            TrackerSource::Haptic(stage.haptics[0].device.clone())
        );
        let stylus = &tracking.styli["pen"];
        assert_eq!((stylus.sensor.as_str(), stylus.grab.as_ref().unwrap().button), ("haptic.right", 0));
        // The handle 10 cm along the device's x lies 20 cm along -z of the room; its tip 10 cm further along its ray.
        let handle = Isometry3::translation(0.1, 0.0, 0.0);
        let room = tracking.trackers["haptic.right"].frame.room_from_sensor(&handle);
        let tip = room * tracking.sensors["haptic.right"].sensor_from_body;
        assert!((room.translation.vector - Vector3::new(0.0, 0.9, 0.2)).norm() < 1e-12, "{room}");
        assert!((tip.translation.vector - Vector3::new(-0.1, 0.9, 0.2)).norm() < 1e-12, "{tip}");
        assert_eq!(stage.tracking.stylus_names(), ["pen"]);
        assert!(stage.to_string().contains("tracker haptic.right: force device, haply localhost"), "{stage}");
        let simulated = stage_of("device = \"simulated\"").unwrap();
        assert_eq!(simulated.tracking, Tracking::default());
        assert_eq!(simulated.tracking.stylus_names(), ["right", "left"]);
        let twice =
            format!("{real}\n[haptic.other]\ndevice = \"haply://h\"\nmax_force = 5\nstylus = \"pen\"");
        let error = stage_of(&twice).unwrap_err();
        assert!(
            error.contains("haptic `other`: stylus `pen` follows sensor `haptic.right` already"),
            "{error}"
        );
    }

    #[test]
    fn a_stylus_that_is_not_there_or_has_a_device_is_refused() {
        let simulated = "device = \"simulated\"";
        let error = stage(&format!("{simulated}\nstylus = \"rihgt\"")).unwrap_err();
        assert!(error.contains("haptic `right`: ") && error.contains("rihgt"), "{error}");
        assert!(error.contains("right"), "{error}");
        let twice = format!("{simulated}\n[haptic.other]\n{simulated}\nstylus = \"right\"");
        let error = stage(&twice).unwrap_err();
        assert!(
            error.contains("haptic `other`: stylus `right` is that of haptic `right` already"),
            "{error}"
        );
        let both = format!("{simulated}\n[haptic.left]\n{simulated}");
        assert_eq!(stage(&both).unwrap().haptics.len(), 2);
    }

    #[test]
    fn what_cannot_be_is_refused_with_the_remedy() {
        for (table, expected) in [
            ("device = \"phantom\"", "write \"simulated\""),
            ("device = \"vrpn://host\"", "vrpn://host/Phantom0"),
            ("device = \"haply://a b\"", "haply://localhost:10001"),
            ("device = \"haply://localhost\"", "max_force is missing"),
            ("device = \"simulated\"\nmax_force = nan", "max_force is NaN"),
            ("device = \"simulated\"\nrate = 10", "rate is 10: it must be a number of Hz between 100"),
            ("device = \"haply://h\"\nmax_force = 5\nmax_torque = 1", "has no torque: remove it"),
            ("device = \"simulated\"\nvirtual_damping = 1.0", "not below the device's own damping"),
            (
                "device = \"simulated\"\nlatency = 1.6",
                "latency is 1.6: it must be a number of s between 0 and 0.1",
            ),
            ("device = \"simulated\"\nlatency = -0.001", "latency is -0.001"),
            ("device = \"simulated\"\nmax_forse = 1.0", "did you mean `max_force`?"),
            ("device = \"simulated\"\ngrab = \"c\"", "grab is for the buttons of a Haply grip"),
            ("device = \"haply://h\"\nmax_force = 5\ngrab = \"b\"", "both \"b\": give second another"),
            ("device = \"haply://h\"\nmax_force = 5\ngrab = \"x\"", "unknown variant"),
            (
                "device = \"simulated\"\nroom_from_device = { position = [inf, 0, 0] }",
                "room_from_device of haptic `right` is inf",
            ),
        ] {
            let error = stage(table).unwrap_err();
            assert!(error.contains(expected), "{table}: {error}");
        }
        let line = BUILT_IN[0].1.lines().count() + 2;
        assert!(
            stage("device = \"x\"").unwrap_err().starts_with(&format!("bench.toml:{line}: haptic `right`"))
        );
    }
}
