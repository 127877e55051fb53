//! `deform` against independently computed solutions.

use super::{DEFORM, succeed, table};
use crate::common::{folder, shared};
use greenstage::deform::{ControlPose, PoseSlope, Wrench, axial, find_model, model_of, pose_file};
use greenstage::green::{self, Requirements, STIFFNESS};
use greenstage::mesh;
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::path::Path;

/// The independently computed cases, as `deform` gives them: f32 storage within 1e-6, f64 within 1e-9, forces
/// within 1e-6 of the largest.
#[test]
fn cases_agree_with_the_independent_solutions() {
    for (case, mesh) in [("tube", "mesh.msh"), ("block2", "mesh41.msh")] {
        let Some(source) = shared(&format!("cases/{case}")) else { return };
        let folder = folder(&format!("cli-case-{case}-{mesh}"));
        for entry in std::fs::read_dir(&source).unwrap() {
            let entry = entry.unwrap();
            std::fs::write(folder.join(entry.file_name()), std::fs::read(entry.path()).unwrap()).unwrap();
        }
        // The same mesh in two versions of the format: what holds of one holds of the other.
        let [old, new] = ["mesh.msh", "mesh41.msh"].map(|name| mesh::load(&source.join(name)).unwrap().mesh);
        assert!(old.nodes == new.nodes && old.tets == new.tets && old.tags == new.tags, "{case}");
        let scene = std::fs::read_to_string(source.join("scene.toml")).unwrap().replace("mesh.msh", mesh);
        std::fs::write(folder.join("scene.toml"), scene).unwrap();
        let expected_forces = slopes_of_case(&folder);
        for (options, limit) in [(&[][..], 2e-7), (&["--all-nodes"][..], 2e-11)] {
            succeed(&folder, &[&DEFORM[..], options].concat());
            let (worst, count) = compare_displacements(&folder);
            let force = compare_forces(&folder, &expected_forces);
            println!("{case}/{mesh} {options:?}: worst relative L2 {worst:.1e}, forces {force:.1e}");
            assert!(worst < limit && force < 1e-9);
            // Every node of the tube lies on its surface; of block2's 1,574 nodes 920 do.
            let expected = table(&folder.join("expected.csv")).len();
            assert_eq!(count, if options.is_empty() && case == "block2" { 2 * 920 } else { expected });
        }
    }
}

/// ∂V by the poses, control element by control element of each pose in the file's order.
fn slopes_of_case(folder: &Path) -> Vec<(PoseSlope, ControlPose)> {
    let scene = Scene::load(&folder.join("scene.toml")).unwrap();
    let (name, body) = scene.body.first().unwrap();
    let solution = green::solve(&scene, name, &Requirements::new(&[STIFFNESS]), &Silent).unwrap();
    let (mut model, _) = model_of(find_model("linear").unwrap(), &solution).unwrap();
    let path = folder.join("poses.toml");
    let of = |pose: &pose_file::Pose| {
        let poses = pose_file::control_poses(pose, name, body, &path).unwrap();
        let mut slopes = vec![PoseSlope::default(); poses.len()];
        model.respond(&poses, &mut slopes).unwrap();
        slopes.into_iter().zip(poses).collect::<Vec<_>>()
    };
    pose_file::load(&path).unwrap().iter().flat_map(of).collect()
}

/// Worst relative L2 error over the poses; where nothing moves, against the largest motion.
/// Also the number of rows compared.
fn compare_displacements(folder: &Path) -> (f64, usize) {
    let expected: BTreeMap<_, _> = table(&folder.join("expected.csv")).into_iter().collect();
    let mut sums = BTreeMap::<String, (f64, f64)>::new();
    let found = table(&folder.join("out.csv"));
    let rows = found.len();
    for (key, u) in found {
        let (pose, _) = key.split_once(',').unwrap();
        let sum = sums.entry(pose.to_owned()).or_default();
        for (u, e) in u.iter().zip(&expected[&key]) {
            *sum = (sum.0 + (u - e).powi(2), sum.1 + e * e);
        }
    }
    assert!(sums.len() >= 2);
    let largest = sums.values().map(|s| s.1).fold(0.0, f64::max);
    let worst =
        sums.values().map(|s| (s.0 / if s.1 > 1e-20 { s.1 } else { largest }).sqrt()).fold(0.0, f64::max);
    (worst, rows)
}

/// Worst error of forces, moments and energy, each against the largest of its kind.
///
/// The cases have moments with the lever arms at rest: the skew part of ∂V/∂M. Those of the file have the arms of the deformed
/// body, and are compared with ∂V/∂M of the library.
fn compare_forces(folder: &Path, slopes: &[(PoseSlope, ControlPose)]) -> f64 {
    let expected = table(&folder.join("expected.forces.csv"));
    let mut found = table(&folder.join("out.forces.csv"));
    assert_eq!(expected.len(), found.len());
    for ((_, row), (slope, pose)) in found.iter_mut().zip(slopes) {
        let wrench = Wrench::from_slope(slope, pose);
        let told = [Vector3::from_column_slice(&row[..3]), Vector3::from_column_slice(&row[3..6])];
        let size = wrench.force.norm().max(wrench.moment.norm());
        let off = (told[0] - wrench.force).norm() + (told[1] - wrench.moment).norm();
        assert!(off < 1e-6 * size, "{told:?} {wrench:?}");
        row[3..6].copy_from_slice(axial(&slope.matrix).as_slice());
    }
    let error = |kind: std::ops::Range<usize>| {
        let largest =
            expected.iter().flat_map(|(_, row)| &row[kind.clone()]).fold(0.0f64, |m, v| m.max(v.abs()));
        let worst = expected.iter().zip(&found).map(|((key, e), (found_key, f))| {
            assert_eq!(key, found_key);
            e[kind.clone()].iter().zip(&f[kind.clone()]).map(|(e, f)| (e - f).abs()).fold(0.0, f64::max)
        });
        worst.fold(0.0, f64::max) / largest
    };
    error(0..3).max(error(3..6)).max(error(6..7))
}
