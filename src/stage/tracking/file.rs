//! The tracking keys of a stage file, as they stand there, and their checks.

use super::super::screen::ROOM_LIMIT_M;
use super::fault::TrackingFault;
use super::{
    Axis, ButtonId, EulerOrder, LostPolicy, OneEuro, Sensor, Stylus, Tracker, TrackerFrame, TrackerKind,
    Tracking, Transport, address,
};
use crate::config;
use indexmap::IndexMap;
use nalgebra::{Isometry3, Matrix3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use toml::Spanned;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerFile {
    vrpn: Option<String>,
    transport: Option<Transport>,
    dtrack: Option<String>,
    osc: Option<String>,
    interface: Option<Ipv4Addr>,
    euler: Option<EulerOrder>,
    fastrak: Option<PathBuf>,
    baud: Option<u32>,
    gamepad: Option<PathBuf>,
    #[serde(default)]
    room_from_tracker: FrameFile,
}

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameFile {
    mirror: Option<Axis>,
    scale: Option<f64>,
    position: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    axes: Option<[[f64; 3]; 3]>,
}

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountFile {
    position: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    axes: Option<[[f64; 3]; 3]>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    tracker: String,
    id: i32,
    #[serde(default)]
    sensor_from_body: MountFile,
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

/// A table of named tables, each with its place in the text.
pub type Tables<T> = IndexMap<String, Spanned<T>>;

/// All tracking keys of a stage but those at fault; `tell` gets every fault and its place in the text. What names a
/// tracker or a sensor that is there, but at fault, is not at fault for it.
pub fn check(
    trackers: Tables<TrackerFile>,
    sensors: Tables<SensorFile>,
    styli: Tables<StylusFile>,
    head: Option<&Spanned<String>>,
    tell: &mut dyn FnMut(usize, TrackingFault),
) -> Tracking {
    let mut tracking = Tracking::default();
    let names =
        Names { trackers: trackers.keys().cloned().collect(), sensors: sensors.keys().cloned().collect() };
    for (name, found) in trackers {
        let start = found.span().start;
        match tracker(&name, &found.into_inner(), &tracking) {
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

/// What the file has tables for.
struct Names {
    trackers: Vec<String>,
    sensors: Vec<String>,
}

fn tracker(name: &str, file: &TrackerFile, others: &Tracking) -> Result<Tracker, TrackingFault> {
    let kinds = [
        ("vrpn", file.vrpn.is_some()),
        ("dtrack", file.dtrack.is_some()),
        ("osc", file.osc.is_some()),
        ("fastrak", file.fastrak.is_some()),
        ("gamepad", file.gamepad.is_some()),
    ];
    let given: Vec<&str> = kinds.iter().filter(|(_, is)| *is).map(|(kind, _)| *kind).collect();
    for (key, is, with) in [
        ("transport", file.transport.is_some(), "vrpn"),
        ("euler", file.euler.is_some(), "osc"),
        ("baud", file.baud.is_some(), "fastrak"),
    ] {
        if is && given != [with] {
            return Err(TrackingFault::LoneKey { tracker: name.to_owned(), key, with });
        }
    }
    if file.interface.is_some() && !["dtrack", "osc"].iter().any(|kind| given.contains(kind)) {
        let (tracker, key) = (name.to_owned(), "interface");
        return Err(TrackingFault::LoneKey { tracker, key, with: "dtrack or osc" });
    }
    let kind = match file {
        _ if given.len() > 1 => Err(given.join(" and ")),
        TrackerFile { vrpn: Some(at), .. } => Ok(address::vrpn(name, at, file.transport)?),
        TrackerFile { dtrack: Some(at), .. } => {
            Ok(TrackerKind::Dtrack { listen: address::listen(name, "dtrack", at, file.interface)? })
        }
        TrackerFile { osc: Some(at), .. } => Ok(TrackerKind::Osc {
            listen: address::listen(name, "osc", at, file.interface)?,
            euler: file.euler.unwrap_or_default(),
        }),
        TrackerFile { fastrak: Some(at), .. } => Ok(TrackerKind::Fastrak {
            device: device(name, "fastrak", at, "/dev/ttyUSB0 or COM3")?,
            baud: range("baud", file.baud.unwrap_or(115_200).into(), "", 300.0, 4e6)? as u32,
        }),
        TrackerFile { gamepad: Some(at), .. } => {
            Ok(TrackerKind::Gamepad { device: device(name, "gamepad", at, "/dev/input/js0")? })
        }
        _ => Err("none of them".to_owned()),
    };
    let kind = kind.map_err(|found| TrackingFault::Kind { tracker: name.to_owned(), found })?;
    if let Some((first, what)) = same_place(&kind, others) {
        return Err(TrackingFault::SamePlace { first, second: name.to_owned(), what });
    }
    let FrameFile { mirror, scale, position, rotation, axes } = file.room_from_tracker;
    let what = format!("room_from_tracker of tracker `{name}`");
    let scale = range(&format!("scale in {what}"), scale.unwrap_or(1.0), "", 1e-6, 1e6)?;
    let room_from_tracker =
        Similarity3::from_isometry(isometry(&what, &MountFile { position, rotation, axes })?, scale);
    Ok(Tracker { kind, frame: TrackerFrame { mirror, room_from_tracker } })
}

/// The tracker before this one that listens at the same place or opens the same device.
fn same_place(kind: &TrackerKind, others: &Tracking) -> Option<(String, String)> {
    use TrackerKind::{Dtrack, Fastrak, Gamepad, Osc};
    let listens = |kind: &TrackerKind| match kind {
        Dtrack { listen } | Osc { listen, .. } if listen.at.port() != 0 => Some(listen.at),
        _ => None,
    };
    let opens = |kind: &TrackerKind| match kind {
        Fastrak { device, .. } | Gamepad { device } => Some(device.clone()),
        _ => None,
    };
    // 0.0.0.0 is every address of this machine.
    let clash = |a: SocketAddr, b: SocketAddr| {
        a.port() == b.port() && (a.ip() == b.ip() || a.ip().is_unspecified() || b.ip().is_unspecified())
    };
    let (at, device) = (listens(kind), opens(kind));
    let is_same = |other: &TrackerKind| {
        at.zip(listens(other)).is_some_and(|(a, b)| clash(a, b)) || device.is_some() && device == opens(other)
    };
    let (first, _) = others.trackers.iter().find(|(_, other)| is_same(&other.kind))?;
    let what = device.map(|device| device.display().to_string());
    Some((first.clone(), what.or(at.map(|at| format!("port {}", at.port())))?))
}

fn device(
    tracker: &str,
    key: &'static str,
    path: &std::path::Path,
    example: &'static str,
) -> Result<PathBuf, TrackingFault> {
    if path.as_os_str().is_empty() {
        return Err(TrackingFault::Device { tracker: tracker.to_owned(), key, example });
    }
    Ok(path.to_owned())
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
        sensor_from_body: isometry(&format!("sensor_from_body of {who}"), &file.sensor_from_body)?,
        filter,
        predict_s: range(&format!("predict of {who}"), file.predict, " of seconds", 0.0, 0.1)?,
        lost: LostPolicy { after_s, warn_s },
        tracker: file.tracker,
        id: file.id,
    })
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

fn range(what: &str, value: f64, unit: &'static str, min: f64, max: f64) -> Result<f64, TrackingFault> {
    if (min..=max).contains(&value) {
        Ok(value)
    } else {
        Err(TrackingFault::Range { what: what.to_owned(), value, unit, min, max })
    }
}

pub fn isometry(what: &str, file: &MountFile) -> Result<Isometry3<f64>, TrackingFault> {
    let numbers = |key: &str, numbers: [f64; 3], unit, limit: f64| -> Result<Vector3<f64>, TrackingFault> {
        for value in numbers {
            range(&format!("`{key}` in {what}"), value, unit, -limit, limit)?;
        }
        Ok(numbers.into())
    };
    let position = numbers("position", file.position.unwrap_or_default(), " of metres", ROOM_LIMIT_M)?;
    let rotation = match (file.rotation, file.axes) {
        (Some(_), Some(_)) => return Err(TrackingFault::TwoRotations { what: what.to_owned() }),
        (Some(vector), None) => {
            UnitQuaternion::from_scaled_axis(numbers("rotation", vector, " of radians", 6.3)?)
        }
        (None, Some([x, y, z])) => {
            let axis = |axis| numbers("axes", axis, "", ROOM_LIMIT_M);
            rotation_from_axes(what, [axis(x)?, axis(y)?, axis(z)?])?
        }
        (None, None) => UnitQuaternion::identity(),
    };
    Ok(Isometry3::from_parts(Translation3::from(position), rotation))
}

/// The rotation nearest to three measured axes, of any length.
fn rotation_from_axes(what: &str, axes: [Vector3<f64>; 3]) -> Result<UnitQuaternion<f64>, TrackingFault> {
    const NAMES: [char; 3] = ['x', 'y', 'z'];
    let what = || what.to_owned();
    let mut unit = Matrix3::zeros();
    for (i, axis) in axes.iter().enumerate() {
        let direction =
            axis.try_normalize(1e-9).ok_or_else(|| TrackingFault::NoAxis { what: what(), axis: NAMES[i] })?;
        unit.set_column(i, &direction);
    }
    for [i, j] in [[0, 1], [0, 2], [1, 2]] {
        let degrees = unit.column(i).angle(&unit.column(j)).to_degrees();
        if (degrees - 90.0).abs() > 5.0 {
            return Err(TrackingFault::Skewed { what: what(), first: NAMES[i], second: NAMES[j], degrees });
        }
    }
    if unit.determinant() < 0.0 {
        return Err(TrackingFault::LeftHanded { what: what() });
    }
    // The nearest rotation is U Vᵀ of the singular value decomposition.
    let svd = unit.svd(true, true);
    let nearest = svd.u.zip(svd.v_t).map_or(unit, |(u, v_t)| u * v_t);
    Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest)))
}
