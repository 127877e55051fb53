//! Where a stage sounds from: its loudspeakers, or headphones, and how loud the loudest sound is.
//!
//! In: places in the room. Out: [`Sound`], the directions from the viewer to each loudspeaker ([`Bearing`]), and the directions
//! from which nothing can sound ([`most_open`]).

use nalgebra::{Isometry3, Point3, Vector3};
use std::fmt;

/// The largest number of loudspeakers, and so of channels.
pub const MOST_LOUDSPEAKERS: usize = 16;
/// The level of a stage that gives none, dB.
pub const USUAL_LOUDEST_DB: f64 = 94.0;
/// A direction is open where every loudspeaker is farther from it than this, degrees.
pub const OPEN_DEGREES: f64 = 80.0;
/// Loudspeakers of a desk stand this far to the left and right of where the viewer looks, degrees.
const DESK_DEGREES: f64 = 30.0;
/// The distance of a desk's loudspeakers from the viewer, m.
const DESK_M: f64 = 1.0;

/// The sound of a stage: what it is heard from, and how loud it can be.
#[derive(Clone, Debug, PartialEq)]
pub struct Sound {
    pub output: SoundOutput,
    /// The name of the audio device; the system's own if there is none.
    pub device: Option<String>,
    /// The RMS sound pressure level of a sine at digital full scale, dB re 20 µPa: of one loudspeaker at the viewer's place in
    /// the stage file, or at the ear in headphones.
    pub loudest_db: f64,
    /// Loudspeakers in the order of the device's channels.
    pub loudspeakers: Vec<Loudspeaker>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SoundOutput {
    /// The loudspeakers of the stage.
    Loudspeakers,
    /// Two channels, one per ear.
    Headphones,
    /// Two loudspeakers before the viewer.
    Stereo,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Loudspeaker {
    /// The name in the file, or "loudspeaker" with its number from 1.
    pub name: String,
    /// The acoustic centre, in the room.
    pub position: Point3<f64>,
}

impl Default for Sound {
    fn default() -> Sound {
        Sound {
            output: SoundOutput::Stereo,
            device: None,
            loudest_db: USUAL_LOUDEST_DB,
            loudspeakers: Vec::new(),
        }
    }
}

impl SoundOutput {
    /// The word in a stage file.
    pub fn name(self) -> &'static str {
        match self {
            SoundOutput::Loudspeakers => "loudspeakers",
            SoundOutput::Headphones => "headphones",
            SoundOutput::Stereo => "stereo",
        }
    }
}

impl Sound {
    /// The loudspeakers that sound for a viewer with this head by the stage file, in the order of the channels; none for
    /// headphones. Stereo takes the stage's own if there are two, else those of a desk.
    pub fn used(&self, room_from_head: &Isometry3<f64>) -> Vec<Loudspeaker> {
        match self.output {
            SoundOutput::Headphones => Vec::new(),
            SoundOutput::Stereo if self.loudspeakers.len() != 2 => Loudspeaker::of_desk(room_from_head),
            SoundOutput::Stereo | SoundOutput::Loudspeakers => self.loudspeakers.clone(),
        }
    }
}

impl Loudspeaker {
    /// The two of a desk, 30° to the left and right of where the head looks, 1 m away.
    pub fn of_desk(room_from_head: &Isometry3<f64>) -> Vec<Loudspeaker> {
        let (sin, cos) = DESK_DEGREES.to_radians().sin_cos();
        let at = |(name, side): (&str, f64)| Loudspeaker {
            name: name.to_owned(),
            position: room_from_head * Point3::new(side * sin * DESK_M, 0.0, -cos * DESK_M),
        };
        [("left", -1.0), ("right", 1.0)].map(at).into()
    }
}

/// Where the viewer sees something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bearing {
    pub distance_m: f64,
    /// Angle in the horizontal plane from where the viewer looks, to the right; -180 to 180.
    pub azimuth_degrees: f64,
    /// Angle above the horizontal plane.
    pub elevation_degrees: f64,
}

impl Bearing {
    /// The bearing of a place from a head, which may look up or down.
    pub fn new(room_from_head: &Isometry3<f64>, place: &Point3<f64>) -> Bearing {
        let away = place.coords - room_from_head.translation.vector;
        let gaze = room_from_head.rotation * -Vector3::z();
        let turn = |way: &Vector3<f64>| way.x.atan2(-way.z);
        let azimuth = (turn(&away) - turn(&gaze)).to_degrees();
        Bearing {
            distance_m: away.norm(),
            azimuth_degrees: azimuth - 360.0 * (azimuth / 360.0).round(),
            elevation_degrees: away.y.atan2(away.x.hypot(away.z)).to_degrees(),
        }
    }
}

impl fmt::Display for Bearing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = |degrees: f64, [less, more]: [&'static str; 2]| match degrees.round() {
            0.0 => String::new(),
            degrees => format!(", {:.0}° {}", degrees.abs(), if degrees < 0.0 { less } else { more }),
        };
        write!(f, "{:.2} m away", self.distance_m)?;
        f.write_str(&side(self.azimuth_degrees, ["left", "right"]))?;
        f.write_str(&side(self.elevation_degrees, ["down", "up"]))
    }
}

/// The direction that is farthest from all these unit directions, and its angle to the nearest of them in radians, if it is open.
///
/// While no direction is open, the centre lies within the convex hull of the unit directions, by cos 80° or more: that cosine
/// is the hull's support function. The six ways along the axes of the room come first, then 400 ways over the sphere.
pub fn most_open(directions: &[Vector3<f64>]) -> Option<(Vector3<f64>, f64)> {
    let nearest = |way: &Vector3<f64>| directions.iter().map(|u| u.dot(way)).fold(-1.0, f64::max);
    let open = |ways: &mut dyn Iterator<Item = Vector3<f64>>| {
        let mut found: Option<(Vector3<f64>, f64)> = None;
        for way in ways {
            let cos = nearest(&way);
            // What is equal but for rounding stays with the first.
            if cos < OPEN_DEGREES.to_radians().cos() && found.is_none_or(|(_, least)| cos < least - 1e-9) {
                found = Some((way, cos));
            }
        }
        found.map(|(way, cos)| (way, cos.clamp(-1.0, 1.0).acos()))
    };
    let axes = [Vector3::z(), Vector3::y(), -Vector3::y(), Vector3::x(), -Vector3::x(), -Vector3::z()];
    open(&mut axes.into_iter()).or_else(|| open(&mut (0..400).map(|k| on_sphere(k, 400))))
}

/// The k-th of n unit vectors that are spread evenly over the sphere, in a spiral of the golden angle.
fn on_sphere(k: usize, n: usize) -> Vector3<f64> {
    let height = 1.0 - (2 * k + 1) as f64 / n as f64;
    let turn = k as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let radius = (1.0 - height * height).sqrt();
    Vector3::new(radius * turn.cos(), height, radius * turn.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::Stage;

    #[test]
    fn a_desk_has_its_loudspeakers_30_degrees_to_each_side() {
        let head = Stage::find("desktop").unwrap().viewer.room_from_head;
        let [left, right] = &Loudspeaker::of_desk(&head)[..] else { panic!("two") };
        let seen = |it: &Loudspeaker| head.inverse_transform_point(&it.position).coords;
        for (seen, side) in [(seen(left), -1.0), (seen(right), 1.0)] {
            assert!((seen - Vector3::new(side * 0.5, 0.0, -0.75f64.sqrt())).norm() < 1e-12, "{seen}");
        }
    }

    #[test]
    fn bearings_are_those_from_where_the_viewer_looks() {
        let stage = Stage::find("cyberstage").unwrap();
        let of =
            |place: [f64; 3]| Bearing::new(&stage.viewer.room_from_head, &Point3::from(place)).to_string();
        assert_eq!(of([0.0, 1.7, -1.6]), "2.00 m away");
        assert_eq!(of([1.0, 1.7, 0.4]), "1.00 m away, 90° right");
        assert_eq!(of([-1.0, 0.7, 0.4]), "1.41 m away, 90° left, 45° down");
        assert_eq!(of([0.001, 3.7, 2.4]), "2.83 m away, 180° right, 45° up");
    }

    #[test]
    fn what_no_loudspeaker_covers_is_found() {
        let corner =
            |k: usize| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -1.0 } else { 1.0 }).normalize();
        let corners: Vec<Vector3<f64>> = (0..8).map(corner).collect();
        assert_eq!(most_open(&corners), None);
        let upper: Vec<Vector3<f64>> = corners.iter().copied().filter(|u| u.y > 0.0).collect();
        let (way, angle) = most_open(&upper).unwrap();
        assert_eq!(way, -Vector3::y());
        assert!((angle.to_degrees() - 125.264).abs() < 1e-3, "{angle}");
        let (way, angle) = most_open(&[]).unwrap();
        assert_eq!((way, angle), (Vector3::z(), std::f64::consts::PI));
    }
}
