//! A VTU file for ParaView: the bodies at rest, and a displacement field for every pose.

use super::exporter::{Exporter, Spread};
use super::result_set::{Geometry, Needs, ResultSet};
use crate::base::output::Kind;
use crate::base::text::one_line;
use crate::deform::NodeStress;
use crate::mesh::formats::vtu_write::{self, Cell, Piece};
use indexmap::IndexSet;
use nalgebra::Vector3;

/// The surface of each body that is shown online, and all tetrahedra of the others.
pub const BODIES: Exporter = Exporter {
    suffix: ".vtu",
    // A mesh in this format, as `convert` writes it, has no displacements.
    kind: Kind {
        name: "a VTU file by `deform`",
        recognizes: |head| {
            let mark = b" Vectors=\"displacement ";
            head.starts_with(b"<VTKFile ") && head.windows(mark.len()).any(|window| window == mark)
        },
    },
    spread: Spread::AllPoses,
    needs: Needs::Nothing,
    write: bodies,
};

fn bodies(set: &ResultSet) -> Vec<u8> {
    vtu_write::encode(&pieces(set))
}

/// One piece per body: rest points, its cells, one displacement field a pose. Every piece has the fields of all
/// poses, as VTK asks for; a body that a pose does not name is at rest in it, one that has no equilibrium there is NaN.
fn pieces(set: &ResultSet) -> Vec<Piece<'_>> {
    let ResultSet { geometry, results, missed } = set;
    let found = results.iter().map(|result| result.pose.as_str());
    let poses: IndexSet<&str> = found.chain(missed.iter().map(|missed| missed.pose.as_str())).collect();
    geometry
        .iter()
        .map(|g| {
            let field = |pose: &&str| {
                let result = results.iter().find(|result| result.body == g.body && result.pose == *pose);
                let is_missed = || missed.iter().any(|missed| missed.body == g.body && missed.pose == *pose);
                let u = match result {
                    Some(result) => result.displacement.clone(),
                    None => {
                        let unknown = if is_missed() { f64::NAN } else { 0.0 };
                        vec![Vector3::repeat(unknown); g.rest.len()]
                    }
                };
                (one_line(format_args!("displacement {pose}")), u)
            };
            let cell = match g.cells.first().map_or(3, Vec::len) {
                3 => Cell::Triangle,
                4 => Cell::Tetra,
                _ => Cell::QuadraticTetra,
            };
            let connectivity = g.cells.concat();
            Piece {
                points: &g.rest,
                cell,
                connectivity,
                vectors: poses.iter().map(field).collect(),
                scalars: scalars(set, g, &poses),
                numbers: None,
            }
        })
        .collect()
}

/// The three fields of every pose, where any body has them; NaN where nothing is known.
fn scalars(set: &ResultSet, g: &Geometry, poses: &IndexSet<&str>) -> Vec<(String, Vec<f64>)> {
    if !set.has_stress() {
        return Vec::new();
    }
    let of_pose = |pose: &&str| {
        let result = set.results.iter().find(|result| result.body == g.body && result.pose == *pose);
        let size = result.map(|result| result.displacement.iter().map(|u| u.norm()).collect());
        let of = |value: fn(&NodeStress) -> f64| {
            let nodes = result.and_then(|result| result.stress.as_ref()).map(|stress| &stress.nodes);
            let known = |nodes: &Vec<Option<NodeStress>>| {
                nodes.iter().map(|at| at.as_ref().map_or(f64::NAN, value)).collect()
            };
            nodes.map(known)
        };
        let unknown = || vec![f64::NAN; g.rest.len()];
        [
            ("von Mises stress", of(|at| at.von_mises)),
            ("largest principal strain", of(|at| at.strain)),
            ("size of displacement", size),
        ]
        .map(|(name, values)| (one_line(format_args!("{name} {pose}")), values.unwrap_or_else(unknown)))
    };
    poses.iter().flat_map(of_pose).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::result_set::{MissedPose, PoseResult};

    #[test]
    fn names_of_poses_leave_the_file_readable() {
        let rest = vec![Vector3::zeros(), Vector3::x(), Vector3::y()];
        let geometry = [Geometry { body: "a".into(), tags: vec![1, 2, 3], rest, cells: vec![vec![0, 1, 2]] }];
        let poses = ["\u{1b}[2Jevil", "a\n\"b\" <&> 'c'", "\u{0}\u{202e}\u{ffff}", "röhre"];
        let results = poses.map(|pose| PoseResult {
            pose: pose.into(),
            body: "a".into(),
            displacement: vec![Vector3::x(); 3],
            wrenches: None,
            stress: None,
            told: Default::default(),
        });
        let set = ResultSet { geometry: geometry.into(), results: results.into(), missed: Vec::new() };
        let text = String::from_utf8(bodies(&set)).unwrap();
        assert!(!text.contains(['\u{1b}', '\u{0}', '\u{202e}', '\u{ffff}']));
        let mut reader = quick_xml::Reader::from_str(&text);
        let mut names = Vec::new();
        loop {
            match reader.read_event().unwrap() {
                quick_xml::events::Event::Eof => break,
                quick_xml::events::Event::Start(start) if start.name().as_ref() == b"DataArray" => {
                    let name = start.try_get_attribute("Name").unwrap().unwrap();
                    names.push(
                        name.normalized_value(quick_xml::XmlVersion::Implicit1_0).unwrap().into_owned(),
                    );
                }
                _ => {}
            }
        }
        names.retain(|name| name.starts_with("displacement"));
        let expected = ["\\u001b[2Jevil", "a\\n\"b\" <&> 'c'", "\\u0000\\u202e\\uffff", "röhre"];
        assert_eq!(names, expected.map(|pose| format!("displacement {pose}")));
    }

    /// ParaView showed nothing of a pose that had no equilibrium.
    #[test]
    fn every_piece_has_the_fields_of_all_poses() {
        let geometry = ["a", "b"].map(|body| Geometry {
            body: body.into(),
            tags: vec![1],
            rest: vec![Vector3::zeros()],
            cells: vec![vec![0, 0, 0]],
        });
        let results = [("pull", "b"), ("push", "a")].map(|(pose, body)| PoseResult {
            pose: pose.into(),
            body: body.into(),
            displacement: vec![Vector3::x()],
            wrenches: None,
            stress: None,
            told: Default::default(),
        });
        let missed = MissedPose { pose: "half".into(), body: "a".into(), why: String::new() };
        let set = ResultSet { geometry: geometry.into(), results: results.into(), missed: vec![missed] };
        for piece in pieces(&set) {
            let names: Vec<&str> = piece.vectors.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, ["displacement pull", "displacement push", "displacement half"]);
        }
        let missed = pieces(&set)[0].vectors[2].1[0];
        assert!(missed.x.is_nan(), "{missed}");
    }
}
