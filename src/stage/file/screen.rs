//! The tables `[[screen]]` of a stage file: three measured corners, or values from a tape measure and a spirit level.
//!
//! With the sides w and h, the tilt t, the facing f, the rotation R about the vertical by f, and e the unit vectors:
//!
//! right = R ex, up = R (sin t ey - cos t ez), lower_left = anchor - w right / 2 (- h up / 2 from the centre).

use super::values::{check_name, length, point};
use crate::stage::error::{MAX_PIXELS, MAX_SIDE_M, MIN_SIDE_M, StageFault};
use crate::stage::screen::Screen;
use nalgebra::{Point3, Rotation3, Vector3};

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScreenFile {
    pub name: String,
    pixels: [u32; 2],
    lower_left: Option<[f64; 3]>,
    lower_right: Option<[f64; 3]>,
    upper_left: Option<[f64; 3]>,
    centre: Option<[f64; 3]>,
    middle_of_lower_edge: Option<[f64; 3]>,
    middle_of_upper_edge: Option<[f64; 3]>,
    width: Option<f64>,
    height: Option<f64>,
    tilt_degrees: Option<f64>,
    facing_degrees: Option<f64>,
}

/// The places from which a screen can be measured, with how far its lower left corner is away, in widths and heights.
const ANCHORS: [(&str, [f64; 2]); 4] = [
    ("centre", [0.5, 0.5]),
    ("middle_of_lower_edge", [0.5, 0.0]),
    ("middle_of_upper_edge", [0.5, 1.0]),
    ("lower_left", [0.0, 0.0]),
];
const TWO_WAYS: &str = "give lower_left, lower_right and upper_left; or, by tape measure, one of centre, \
    middle_of_lower_edge, middle_of_upper_edge, lower_left, with width, height and tilt_degrees";

/// A screen, and how it was measured if by tape.
#[derive(Clone, Debug)]
pub struct TapedScreen {
    pub screen: Screen,
    tape: Option<Tape>,
}

/// One place on a screen, its sides, and how it stands.
#[derive(Clone, Copy, Debug)]
struct Tape {
    anchor: Point3<f64>,
    /// Vector from the anchor to the lower left corner, in widths and heights.
    corner: [f64; 2],
    size_m: [f64; 2],
    tilt_degrees: f64,
    facing_degrees: f64,
}

impl Tape {
    /// Lower left, lower right and upper left.
    fn corners(&self) -> [Point3<f64>; 3] {
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), self.facing_degrees.to_radians());
        let (sin, cos) = self.tilt_degrees.to_radians().sin_cos();
        let right = turn * Vector3::x() * self.size_m[0];
        let up = turn * Vector3::new(0.0, sin, -cos) * self.size_m[1];
        let lower_left = self.anchor - right * self.corner[0] - up * self.corner[1];
        [lower_left, lower_left + right, lower_left + up]
    }
}

impl TapedScreen {
    /// The keys of a tape measure to change so that the screen `is_right`, if one change does: the sign of the tilt, the other
    /// way to face, or the face of what lies.
    pub fn facing(&self, is_right: impl Fn(&Screen) -> bool) -> Option<String> {
        let tape = self.tape?;
        let Tape { tilt_degrees, facing_degrees, .. } = tape;
        let around = facing_degrees - 180.0 * if facing_degrees > 0.0 { 1.0 } else { -1.0 };
        let changes = [
            (format!("tilt_degrees = {}", -tilt_degrees), Tape { tilt_degrees: -tilt_degrees, ..tape }),
            (format!("facing_degrees = {around}"), Tape { facing_degrees: around, ..tape }),
            (
                format!("tilt_degrees = {}", 180.0 - tilt_degrees.abs()),
                Tape { tilt_degrees: 180.0 - tilt_degrees.abs(), ..tape },
            ),
        ];
        let does = |changed: &Tape| {
            let [lower_left, lower_right, upper_left] = changed.corners();
            // Else the picture would stand on its head.
            changed.tilt_degrees > -45.0
                && is_right(&Screen { lower_left, lower_right, upper_left, ..self.screen.clone() })
        };
        changes.into_iter().find(|(_, changed)| does(changed)).map(|(keys, _)| keys)
    }
}

/// A screen whose corners span an area.
pub fn screen(file: ScreenFile) -> Result<TapedScreen, StageFault> {
    check_name("screen", &file.name)?;
    let (tape, [lower_left, lower_right, upper_left]) = match by_tape(&file)? {
        Some(tape) => (Some(tape), tape.corners()),
        None => (None, by_corners(&file)?),
    };
    let ScreenFile { name, pixels, .. } = file;
    let screen = Screen { name, lower_left, lower_right, upper_left, pixels };
    let [width, height] = pixels;
    if !(1..=MAX_PIXELS).contains(&width) || !(1..=MAX_PIXELS).contains(&height) {
        return Err(StageFault::Pixels { screen: screen.name, width, height });
    }
    let side = MIN_SIDE_M..=MAX_SIDE_M;
    let (width_m, height_m) = (screen.width_m(), screen.height_m());
    let across = screen.lower_right - screen.lower_left;
    let area = across.cross(&(screen.upper_left - screen.lower_left)).norm();
    if !side.contains(&width_m) || !side.contains(&height_m) || area < 1e-6 * width_m * height_m {
        return Err(odd_number(&screen).unwrap_or(StageFault::Size {
            screen: screen.name,
            width_m,
            height_m,
        }));
    }
    Ok(TapedScreen { screen, tape })
}

fn read(file: &ScreenFile, key: &str, place: Option<[f64; 3]>) -> Result<Point3<f64>, StageFault> {
    match place {
        Some(place) => point(&format!("{key} of screen `{}`", file.name), place),
        None => Err(missing(file, key)),
    }
}

fn missing(file: &ScreenFile, key: &str) -> StageFault {
    StageFault::Screen { screen: file.name.clone(), message: format!("`{key}` is missing: {TWO_WAYS}") }
}

/// Lower left, lower right and upper left as measured.
fn by_corners(file: &ScreenFile) -> Result<[Point3<f64>; 3], StageFault> {
    Ok([
        read(file, "lower_left", file.lower_left)?,
        read(file, "lower_right", file.lower_right)?,
        read(file, "upper_left", file.upper_left)?,
    ])
}

/// The values that were measured by tape; `None` for a screen with measured corners.
fn by_tape(file: &ScreenFile) -> Result<Option<Tape>, StageFault> {
    let ScreenFile { name, width, height, tilt_degrees, facing_degrees, .. } = file;
    let fault = |message: String| StageFault::Screen { screen: name.clone(), message };
    let missing = |key: &str| missing(file, key);
    let anchors = [file.centre, file.middle_of_lower_edge, file.middle_of_upper_edge, file.lower_left];
    let is_by_tape = [width, height, tilt_degrees, facing_degrees].iter().any(|number| number.is_some())
        || anchors[..3].iter().any(Option::is_some);
    if !is_by_tape {
        return Ok(None);
    }
    for (key, corner) in [("lower_right", file.lower_right), ("upper_left", file.upper_left)] {
        if corner.is_some() {
            return Err(fault(format!(
                "`{key}` does not go with width, height and tilt_degrees: {TWO_WAYS}"
            )));
        }
    }
    let mut given = ANCHORS.iter().zip(anchors).filter(|(_, place)| place.is_some());
    let (Some(((key, corner), place)), None) = (given.next(), given.next()) else {
        return Err(fault(format!("it is measured from exactly one place: {TWO_WAYS}")));
    };
    let anchor = read(file, key, place)?;
    let side = |key: &str, value: &Option<f64>| {
        let value = value.ok_or_else(|| missing(key))?;
        // What is no side of a screen is refused later, with both sides.
        length(&format!("{key} of screen `{name}`"), value, 0.0, 1e6)
    };
    let (width_m, height_m) = (side("width", width)?, side("height", height)?);
    let tilt = tilt_degrees.ok_or_else(|| missing("tilt_degrees"))?;
    let facing = facing_degrees.unwrap_or(0.0);
    for (key, degrees) in [("tilt_degrees", tilt), ("facing_degrees", facing)] {
        if !(-180.0..=180.0).contains(&degrees) {
            return Err(fault(format!("{key} is {degrees}: it must be between -180 and 180")));
        }
    }
    Ok(Some(Tape {
        anchor,
        corner: *corner,
        size_m: [width_m, height_m],
        tilt_degrees: tilt,
        facing_degrees: facing,
    }))
}

/// Coordinates as large as a house among such as a room has: another unit slipped in.
pub fn odd_number(screen: &Screen) -> Option<StageFault> {
    const ROOM_M: f64 = 10.0;
    let corners = [
        ("lower_left", &screen.lower_left),
        ("lower_right", &screen.lower_right),
        ("upper_left", &screen.upper_left),
    ];
    let all = corners.iter().flat_map(|(name, corner)| {
        corner.iter().zip(["x", "y", "z"]).map(move |(value, axis)| (*name, axis, *value))
    });
    let odd: Vec<_> = all.filter(|(_, _, value)| value.abs() >= ROOM_M).collect();
    let [(corner, axis, value)] = odd[..] else { return None };
    let (unit, metres) =
        if value.abs() < 1e3 { ("centimetres", value / 100.0) } else { ("millimetres", value / 1e3) };
    let (width_m, height_m) = (screen.width_m(), screen.height_m());
    let message = format!(
        "{axis} of {corner} is {value} m, all others are below {ROOM_M} m: {unit}? Then write \
         {metres:.4}. Now the lower edge is {width_m:.3} m, the left {height_m:.3} m"
    );
    Some(StageFault::Screen { screen: screen.name.clone(), message })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn made(keys: &str) -> Result<Screen, StageFault> {
        let file = toml::from_str(&format!("name = \"table\"\npixels = [1400, 1050]\n{keys}")).unwrap();
        screen(file).map(|measured| measured.screen)
    }

    fn refused(keys: &str) -> String {
        made(keys).unwrap_err().to_string()
    }

    /// A bench that a technician measured, and the corners that he computed by hand, to a millimetre.
    #[test]
    fn tilted_screens_have_the_corners_that_were_computed_by_hand() {
        for (keys, corners) in [
            (
                "centre = [0.89, 0.92, 0.5545]\nwidth = 1.78\nheight = 1.12\ntilt_degrees = 8",
                [[0.0, 0.842, 1.109], [1.78, 0.842, 1.109], [0.0, 0.998, 0.0]],
            ),
            (
                "middle_of_lower_edge = [0.89, 1.028, 0.0]\nwidth = 1.78\nheight = 1.30\ntilt_degrees = 85",
                [[0.0, 1.028, 0.0], [1.78, 1.028, 0.0], [0.0, 2.323, -0.113]],
            ),
            (
                "middle_of_upper_edge = [-1.5, 2.4, 0.0]\nwidth = 3\nheight = 2.4\ntilt_degrees = 90\nfacing_degrees = 90",
                [[-1.5, 0.0, 1.5], [-1.5, 0.0, -1.5], [-1.5, 2.4, 1.5]],
            ),
            (
                "lower_left = [0.1, 0.9, 1.2]\nwidth = 1.6\nheight = 1.2\ntilt_degrees = 0",
                [[0.1, 0.9, 1.2], [1.7, 0.9, 1.2], [0.1, 0.9, 0.0]],
            ),
        ] {
            let screen = made(keys).unwrap();
            for (found, expected) in
                [screen.lower_left, screen.lower_right, screen.upper_left].iter().zip(corners)
            {
                assert!((found - Point3::from(expected)).norm() < 1e-3, "{keys}: {found}");
            }
        }
    }

    #[test]
    fn what_a_tape_measure_does_not_tell_is_asked_for() {
        let whole = "centre = [0, 0.9, 0.6]\nwidth = 1.6\nheight = 1.2\ntilt_degrees = 0\n";
        assert!(made(whole).is_ok());
        for (keys, part) in [
            (whole.replace("width = 1.6\n", ""), "`width` is missing"),
            (whole.replace("tilt_degrees = 0\n", ""), "`tilt_degrees` is missing"),
            (whole.replace("centre", "lower_right"), "`lower_right` does not go with width"),
            (whole.to_owned() + "lower_left = [0, 0, 0]\n", "from exactly one place"),
            (whole.replace("= 0\n", "= 270\n"), "between -180 and 180"),
            (whole.replace("1.6", "nan"), "width of screen `table` is NaN"),
            (
                whole.replace("1.6", "160").replace("1.2", "120"),
                "these look like centimetres: 1.600 × 1.200 m",
            ),
            ("lower_left = [0, 0, 0]\nlower_right = [1, 0, 0]".into(), "`upper_left` is missing"),
        ] {
            let text = refused(&keys);
            assert!(text.contains(part), "no `{part}` in {text}");
        }
    }

    proptest! {
        /// Values by tape are read back from the corners.
        #[test]
        fn sides_tilt_and_facing_come_back(
            width in 0.1..5.0f64, height in 0.1..5.0f64, tilt in -179.0..179.0f64, facing in -179.0..179.0f64,
            anchor in 0..4usize, place in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let keys = format!(
                "{} = {place:?}\nwidth = {width}\nheight = {height}\ntilt_degrees = {tilt}\nfacing_degrees = {facing}",
                ANCHORS[anchor].0
            );
            let screen = made(&keys).unwrap();
            let found = [screen.width_m(), screen.height_m(), screen.tilt_degrees(), screen.facing_degrees()];
            for (found, expected) in found.into_iter().zip([width, height, tilt, facing]) {
                prop_assert!((found - expected).abs() < 1e-9, "{found} is not {expected}");
            }
            let [across, upward] = ANCHORS[anchor].1.map(|share| 2.0 * share - 1.0);
            prop_assert!((screen.point([across, upward]) - Point3::from(place)).norm() < 1e-12);
            prop_assert!(screen.off_rectangle_m() < 1e-12);
        }
    }
}
