//! The pose file of `greenstage deform`: `[[pose]]` tables in TOML.

use crate::base::failure::Failure;
use crate::config;
use crate::deform::{ControlPose, ControlPoses, Screw};
use crate::scene::Body;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Two control elements turned against each other by more, rad, may have been meant to be turned the other way.
const DOUBTFUL: f64 = 150.0 * std::f64::consts::PI / 180.0;

/// Largest number of a pose; what is summed must stay within single precision.
const LARGEST: f64 = 1e15;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseFile {
    pose: Vec<Pose>,
}

/// One pose of one body; control elements that it does not name are at rest.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    pub name: String,
    /// Which body; may be left out where the scene has one.
    pub body: Option<String>,
    #[serde(default)]
    pub control: BTreeMap<String, Affine>,
}

/// x ↦ o + translation + matrix · (x - o).
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Affine {
    #[serde(default)]
    pub translation: [f64; 3],
    #[serde(default = "identity")]
    pub matrix: [[f64; 3]; 3],
}

fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

/// Reads the pose file.
pub fn load(path: &Path) -> Result<Vec<Pose>, Failure> {
    let text = config::read(path)?;
    parse(&text, path)
}

/// Checks the text of a pose file; `path` is only named in errors.
pub fn parse(text: &str, path: &Path) -> Result<Vec<Pose>, Failure> {
    let file: PoseFile = config::parse(text, path)?;
    let mut known = BTreeSet::new();
    for pose in &file.pose {
        if !known.insert((&pose.name, &pose.body)) {
            return Err(Failure::wrong(format!(
                "{}: two poses are called \"{}\"",
                path.display(),
                pose.name
            )));
        }
    }
    Ok(file.pose)
}

/// The poses of all control elements of the body called `name`, in its order.
pub fn control_poses(pose: &Pose, name: &str, body: &Body, path: &Path) -> Result<ControlPoses, Failure> {
    let entity = |message: String| {
        Failure::wrong(format!("{}: pose \"{}\": body.{}: {message}", path.display(), pose.name, name))
    };
    for control in pose.control.keys() {
        if !body.control.contains_key(control) {
            let known = body.control.keys().map(String::as_str);
            return Err(entity(config::unknown_name("control element", control, known)));
        }
    }
    body.control
        .keys()
        .map(|control| {
            let Some(affine) = pose.control.get(control) else { return Ok(ControlPose::REST) };
            let m = affine.matrix;
            let pose = ControlPose {
                translation: Vector3::from(affine.translation),
                matrix: Matrix3::from_fn(|i, j| m[i][j]),
            };
            let numbers = pose.translation.iter().chain(pose.matrix.iter());
            if !numbers.into_iter().all(|value| value.abs() <= LARGEST) {
                let message = format!("control {control}: a number is not finite, or above {LARGEST:e}");
                return Err(entity(message));
            }
            Ok(pose)
        })
        .collect()
}

/// Which turn was taken, where two control elements of `body` are so far turned against each other that their matrices,
/// which are the same after whole turns, leave a doubt.
pub fn doubtful_turn(poses: &ControlPoses, body: &Body) -> Option<String> {
    let turns: Vec<Vector3<f64>> = poses.iter().map(|pose| Screw::of(pose).turn).collect();
    let pairs = (0..turns.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let apart = |&(i, j): &(usize, usize)| (turns[i] - turns[j]).norm();
    let (i, j) = pairs.max_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    let angle = apart(&(i, j));
    // The one that is turned further from rest is told.
    let (turned, other) = if turns[i].norm() >= turns[j].norm() { (i, j) } else { (j, i) };
    let name = |e: usize| body.control.keys().nth(e).map_or("", String::as_str);
    (angle > DOUBTFUL).then(|| {
        let degrees = angle.to_degrees();
        format!(
            "control element {} is turned by {degrees:.1}° against {}, each by its shorter turn from rest; their matrices \
             are the same after {:.1}° the other way, which a pose file cannot ask for",
            name(turned),
            name(other),
            360.0 - degrees
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str =
        "[[pose]]\nname = \"a\"\ncontrol.c = { translation = [0.1, 0, 0] }\n[[pose]]\nname = \"b\"\n";

    #[test]
    fn what_is_absent_is_at_rest() {
        let poses = parse(GOOD, Path::new("poses.toml")).unwrap();
        assert_eq!(poses[0].control["c"].matrix, identity());
        assert!(poses[1].control.is_empty());
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in ".*", at in 0..GOOD.len(), cut in any::<bool>()) {
            let rest = if cut { "" } else { &GOOD[at..] };
            for text in [text.clone(), format!("{}{text}{rest}", &GOOD[..at])] {
                if let Err(failure) = parse(&text, Path::new("poses.toml")) {
                    prop_assert!(failure.to_string().contains("poses.toml"), "{failure}");
                }
            }
        }
    }
}
