//! Where a stage sounds from: its loudspeakers, or headphones, and how loud the loudest sound is.
//!
//! In: places in the room. Out: [`Sound`], the directions from the viewer to each loudspeaker, and the directions from which
//! nothing can sound ([`most_open`]).

use nalgebra::{Point3, Vector3};

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

impl Loudspeaker {
    /// The two of a desk, 30° to the left and right of where the head looks, 1 m away.
    pub fn of_desk(room_from_head: &nalgebra::Isometry3<f64>) -> Vec<Loudspeaker> {
        let (sin, cos) = DESK_DEGREES.to_radians().sin_cos();
        let at = |(name, side): (&str, f64)| Loudspeaker {
            name: name.to_owned(),
            position: room_from_head * Point3::new(side * sin * DESK_M, 0.0, -cos * DESK_M),
        };
        [("left", -1.0), ("right", 1.0)].map(at).into()
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
