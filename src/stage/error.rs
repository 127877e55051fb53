//! Errors of a stage. Each carries its numbers and says what to do.

use crate::config::ConfigError;
use nalgebra::Point3;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// The reason why a stage was refused.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    #[error(transparent)]
    File(#[from] ConfigError),
    #[error("{}:{line}: {fault}", path.display())]
    Invalid { path: PathBuf, line: usize, fault: StageFault },
    #[error(
        "no stage is named `{name}`{}; there are {known}, or give the path of a .toml file",
        did_you_mean(nearest)
    )]
    Unknown { name: String, nearest: Option<&'static str>, known: String },
}

/// A fault of a stage, with what to do about it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StageFault {
    #[error(
        "the stage has no screen: add a [[screen]] with name, lower_left, lower_right, upper_left, pixels"
    )]
    NoScreen,
    #[error(
        "`{name}` cannot name a {what}: use 1 to 64 letters, digits, `-` and `_`, since images are named after it"
    )]
    Name { what: &'static str, name: String },
    #[error(
        "a second screen is named `{screen}` (the first stands in line {first_line}): rename one of them"
    )]
    Duplicate { screen: String, first_line: usize },
    #[error("{what} is {value}: it must be a number of metres between {min} and {max}{}", small_unit(*value, *min..=*max))]
    Length { what: String, value: f64, min: f64, max: f64 },
    #[error("the viewer has both `target` and `direction`: keep one")]
    TwoDirections,
    #[error(
        "the viewer looks nowhere: `target` must differ from `position`, and `direction` must not be zero"
    )]
    NoDirection,
    #[error(
        "ipd is {ipd_m} m: the distance between human pupils is 0.045 to 0.080 m (mean 0.063){}{}",
        ipd_unit(*ipd_m),
        if *ipd_m == 0.0 { "; 0 shows no depth and is allowed only where stage and windows are \"mono\"" } else { "" }
    )]
    Ipd { ipd_m: f64 },
    #[error("screen `{screen}` has {width} × {height} pixels: each must be between 1 and {MAX_PIXELS}")]
    Pixels { screen: String, width: u32, height: u32 },
    #[error(
        "screen `{screen}` is {width_m:.4} × {height_m:.4} m: each side must be between {MIN_SIDE_M} and {MAX_SIDE_M} m; {}",
        side_advice([*width_m, *height_m])
    )]
    Size { screen: String, width_m: f64, height_m: f64 },
    #[error(
        "screen `{screen}`: edges meet at {degrees:.2}°, not 90° (lower {:.3} m, left {:.3} m; \
         upper_left {:.1} mm off, up to {:.0} mm is straightened). Measure again; upper_left {} would be \
         right",
        sides_m[0], sides_m[1], off_m * 1e3, STRAIGHTENED_M * 1e3, place(upper_left)
    )]
    Skewed { screen: String, degrees: f64, off_m: f64, sides_m: [f64; 2], upper_left: Box<Point3<f64>> },
    #[error("screen `{screen}`: {message}")]
    Screen { screen: String, message: String },
    #[error(
        "screen `{screen}`: {what}. Write lower_left = {}, lower_right = {}, upper_left = {}",
        place(&corners[0]), place(&corners[1]), place(&corners[2])
    )]
    Corners {
        screen: String,
        /// Words for the corners that are exchanged.
        what: &'static str,
        /// Lower left, lower right and upper left as they should be.
        corners: Box<[Point3<f64>; 3]>,
    },
    #[error(
        "the viewer, at {}, stands {distance_m:.3} m behind screen `{screen}`, whose front is towards {front}: {remedy}",
        place(viewer)
    )]
    ViewerBehind {
        screen: String,
        viewer: Box<Point3<f64>>,
        distance_m: f64,
        /// Words for what shows the side of the screen's front.
        front: Box<str>,
        remedy: Box<str>,
    },
    #[error(
        "the viewer, at {}, stands {distance_m:.3} m behind screen `{screen}`. Either the screen {what}: \
         {remedy}. Or move the viewer before it: position = {}",
        place(viewer),
        place(before)
    )]
    EitherSide {
        screen: String,
        viewer: Box<Point3<f64>>,
        distance_m: f64,
        what: &'static str,
        remedy: Box<str>,
        before: Box<Point3<f64>>,
    },
    #[error(
        "screen `{screen}` {what}: the viewer, at {}, stands {distance_m:.3} m behind it. To turn it round, {remedy}",
        place(viewer)
    )]
    Mirrored {
        screen: String,
        viewer: Box<Point3<f64>>,
        distance_m: f64,
        /// Mirrored, or turned away.
        what: &'static str,
        remedy: Box<str>,
    },
    #[error(
        "{screens} face away from the viewer, the workspace and each other: the file is left-handed. \
         Change the sign of z in all points; the viewer's position = {}",
        place(viewer)
    )]
    LeftHanded { screens: Box<str>, viewer: Box<Point3<f64>> },
    #[error(
        "the viewer starts in the plane of screen `{screen}` ({:.1} mm away): move the viewer before the screen",
        distance_m * 1000.0
    )]
    EdgeOn { screen: String, distance_m: f64 },
    #[error("window `{window}`: {message}")]
    Window { window: String, message: String },
    #[error("a second window is named `{window}`: rename one of them")]
    DuplicateWindow { window: String },
    #[error("monitor `{name}`: {message}")]
    Monitor { name: String, message: String },
    #[error(transparent)]
    Tracking(#[from] TrackingFault),
    /// An error in the keys of a tracker's source.
    #[error("{0}")]
    Source(String),
    #[error("haptic `{name}`: {message}")]
    Haptic { name: String, message: String },
    #[error("loudspeaker {number}: {message}")]
    Loudspeaker { number: usize, message: String },
    #[error("the stage's sound: {message}")]
    Sound { message: String },
}

/// The largest texture on common devices, pixels.
pub const MAX_PIXELS: u32 = 16384;
/// Window positions that fit the 16 bits of window systems.
pub const PLACES: std::ops::RangeInclusive<i32> = -32768..=32767;
pub const MIN_SIDE_M: f64 = 0.01;
pub const MAX_SIDE_M: f64 = 100.0;
/// Largest deviation of a corner from a rectangle that counts as an error of measurement and is straightened, m.
pub const STRAIGHTENED_M: f64 = 5e-3;
/// Largest cosine of the angle between a screen's edges that is straightened: 0.57° off a right angle.
pub const MAX_SKEW: f64 = 1e-2;
pub const IPD_M: std::ops::RangeInclusive<f64> = 0.045..=0.080;

/// The longest way from a sensor to the head or the stylus that it is on, m.
pub const MAX_MOUNT_M: f64 = 0.5;

/// A fault, and the line where the table at fault begins.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatedFault {
    pub line: usize,
    pub fault: StageFault,
}

fn did_you_mean(nearest: &Option<&'static str>) -> String {
    nearest.map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

/// A number of metres as it would be if it was in millimetres or centimetres, where that is within the limits.
fn small_unit(value: f64, limits: RangeInclusive<f64>) -> String {
    // Six digits are a micrometre, and print no rounding.
    let metres = |unit: f64| (value * unit * 1e6).round() / 1e6;
    match value.abs() {
        size if !(100.0..1e5).contains(&size) || !limits.contains(&metres(0.001)) => String::new(),
        size if size < 1000.0 => format!(
            "; was it in centimetres? Then write {} (in millimetres: {})",
            metres(0.01),
            metres(0.001)
        ),
        _ => format!("; was it in millimetres? Then write {}", metres(0.001)),
    }
}

fn ipd_unit(ipd: f64) -> String {
    let read = |(unit, scale): &(&str, f64)| {
        let metres = (ipd * scale * 1e4).round() / 1e4;
        IPD_M.contains(&metres).then(|| format!("; was it in {unit}? Then write {metres}"))
    };
    [("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)]
        .iter()
        .find_map(read)
        .unwrap_or_default()
}

fn side_advice(sides_m: [f64; 2]) -> String {
    let read = |(unit, scale): &(&str, f64)| {
        let [width_m, height_m] = sides_m.map(|side| side * scale);
        let fits = [width_m, height_m].iter().all(|side| (0.1..=10.0).contains(side));
        fits.then(|| format!("these look like {unit}: {width_m:.3} × {height_m:.3} m"))
    };
    [("centimetres", 0.01), ("millimetres", 0.001)].iter().find_map(read).unwrap_or_else(|| {
        "lower_left, lower_right and upper_left must be three different corners, in metres".to_owned()
    })
}

fn length(position: &[f64; 3]) -> f64 {
    position.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Suggests the same numbers as metres, if they look like centimetres or millimetres.
fn in_metres(position: &[f64; 3]) -> String {
    let read = |(unit, scale): &(&str, f64)| {
        let metres = position.map(|x| (x * scale * 1e6).round() / 1e6 + 0.0);
        let fits = length(&metres) <= MAX_MOUNT_M;
        fits.then(|| format!("; were these {unit}? Then write {metres:?}"))
    };
    [("centimetres", 0.01), ("millimetres", 0.001)].iter().find_map(read).unwrap_or_default()
}

/// A point as a stage file has it.
pub fn place(point: &Point3<f64>) -> String {
    // Adding 0.0 prints -0.0 as 0.0.
    let [x, y, z] = [point.x, point.y, point.z].map(|x| (x * 1e4).round() / 1e4 + 0.0);
    format!("[{x:.4}, {y:.4}, {z:.4}]")
}

/// A fault of a tracker, a sensor, a stylus or the viewer's head.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrackingFault {
    #[error("{what} is {value}: it must be a number{unit} between {min} and {max}")]
    Range { what: String, value: f64, unit: &'static str, min: f64, max: f64 },
    #[error("{what} has several of `rotation`, `rotation_degrees` and `axes`: keep one")]
    TwoRotations { what: String },
    #[error(
        "{what}: the axes {first} and {second} meet at {degrees:.1}° instead of 90°: measure again (up \
         to 5° is straightened)"
    )]
    Skewed { what: String, first: char, second: char, degrees: f64 },
    #[error(
        "{what}: the axes are left-handed. Turn one of them; for a left-handed tracker reverse the last \
         and add mirror = \"z\""
    )]
    LeftHanded { what: String },
    #[error("{what}: the {axis} axis has no length: say where in the room it points")]
    NoAxis { what: String, axis: char },
    #[error("{who} has `sensor_from_body` and `body_from_sensor`, its inverse: keep one")]
    TwoMounts { who: String },
    #[error(
        "`position` in {what} is {:.2} m from the sensor, which is at most {MAX_MOUNT_M} m from what it is mounted on: it is in \
         metres{}",
        length(position),
        in_metres(position)
    )]
    FarBody { what: String, position: [f64; 3] },
    #[error("{who}: {message}")]
    UnknownName { who: String, message: String },
    #[error(
        "sensors `{first}` and `{second}` are both number {id} of tracker `{tracker}`: change one \
         (`greenstage track` lists them)"
    )]
    SameSensor { first: String, second: String, tracker: String, id: i32 },
    #[error(
        "`grab` and `second` of stylus `{stylus}` are the same button: give `second` another, or remove it"
    )]
    SameButton { stylus: String },
    #[error("styli `{first}` and `{second}` both follow sensor `{sensor}`: give each its own, or remove one")]
    SharedSensor { first: String, second: String, sensor: String },
    #[error(
        "`lost` of sensor `{sensor}`: it warns after {warn_s} s, before it holds at {after_s} s: swap them"
    )]
    LostOrder { sensor: String, after_s: f64, warn_s: f64 },
}
