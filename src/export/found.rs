//! The poses of control elements that were found, as a pose file that can be asked for again.

use super::exporter::{Exporter, Spread};
use super::result_set::{Needs, ResultSet};
use crate::base::output::Kind;
use crate::deform::ControlPose;
use crate::deform::pose_file::PointForce;
use std::fmt::Write;

const HEADING: &str = "# Poses as `greenstage deform` found them";

/// Every pose, all control elements held where they were found, under the loads that it was found with.
pub const POSES: Exporter = Exporter {
    suffix: ".poses.toml",
    kind: Kind { name: "poses found by `deform`", recognizes: |head| head.starts_with(HEADING.as_bytes()) },
    spread: Spread::AllPoses,
    needs: Needs::Found,
    write: poses,
};

fn poses(set: &ResultSet) -> Vec<u8> {
    let mut text = format!("{HEADING}; all that was free is held in them: a pose file for `--poses`\n");
    for result in &set.results {
        let text_of = |name: &str| toml::Value::String(name.to_owned()).to_string();
        // Writing into a String cannot fail.
        let _ =
            write!(text, "\n[[pose]]\nname = {}\nbody = {}\n", text_of(&result.pose), text_of(&result.body));
        if let Some(after) = &result.told.after {
            let _ = writeln!(text, "after = {}", text_of(after));
        }
        for (name, value) in &result.told.loads.written {
            let _ = writeln!(text, "load.{} = {}", text_of(name), value);
        }
        let forces = result.told.loads.forces.iter().map(force);
        let forces: Vec<String> = forces.collect();
        if !forces.is_empty() {
            let _ = writeln!(text, "force = [{}]", forces.join(", "));
        }
        for (name, pose) in result.told.names.iter().zip(&result.told.control) {
            if *pose != ControlPose::REST {
                let t = pose.translation;
                let row = |i: usize| {
                    format!(
                        "[{:?}, {:?}, {:?}]",
                        pose.matrix[(i, 0)],
                        pose.matrix[(i, 1)],
                        pose.matrix[(i, 2)]
                    )
                };
                let (name, matrix) = (text_of(name), [row(0), row(1), row(2)].join(", "));
                let _ = writeln!(
                    text,
                    "control.{name} = {{ translation = [{:?}, {:?}, {:?}], matrix = [{matrix}] }}",
                    t.x, t.y, t.z
                );
            }
        }
    }
    text.into_bytes()
}

fn force(PointForce { at, node, force }: &PointForce) -> String {
    let at = at.map(|at| format!("at = {at:?}")).or(node.map(|node| format!("node = {node}")));
    format!("{{ {}, force = {force:?} }}", at.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::super::result_set::PoseResult;
    use super::super::told::PoseFacts;
    use super::*;
    use crate::deform::pose_file;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn what_was_found_can_be_asked_for_again() {
        let pose = ControlPose {
            translation: Vector3::new(1e-7, -0.25, 3.0),
            matrix: Matrix3::from_fn(|i, j| 0.1 * (i + 3 * j) as f64) + Matrix3::identity(),
        };
        let told = PoseFacts {
            names: vec!["a \"b\"".into(), "c".into()],
            control: vec![pose, ControlPose::REST],
            ..PoseFacts::default()
        };
        let result = PoseResult {
            pose: "push 5 \"mm\"".into(),
            body: "part".into(),
            displacement: Vec::new(),
            wrenches: None,
            stress: None,
            told,
        };
        let set = ResultSet { results: vec![result], ..ResultSet::default() };
        let text = String::from_utf8(poses(&set)).unwrap();
        let read = pose_file::parse(&text, std::path::Path::new("out.poses.toml")).unwrap();
        let back = &read[0].control["a \"b\""];
        assert_eq!((read[0].name.as_str(), read[0].control.len()), ("push 5 \"mm\"", 1));
        assert_eq!(Vector3::from(back.translation), pose.translation);
        assert_eq!(Matrix3::from_fn(|i, j| back.matrix()[i][j]), pose.matrix);
    }
}
