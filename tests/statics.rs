//! Static equilibrium at large strain: against independently computed solutions, closed forms, rigid motions, and its
//! own rate of convergence.

#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod common;

use common::{block_scene, scene, shared};
use greenstage::config;
use greenstage::deform::{ControlPose, ControlPoses, Settled, Statics, StaticsError};
use greenstage::fem::{Hyperelastic, LAWS, Lame, Law, NodeFields, tet4};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

fn law(name: &str) -> &'static Law {
    LAWS.iter().find(|law| law.name == name).unwrap()
}

#[derive(serde::Deserialize)]
struct Poses {
    pose: Vec<Pose>,
}

#[derive(serde::Deserialize)]
struct Pose {
    name: String,
    control: BTreeMap<String, Affine>,
}

#[derive(serde::Deserialize)]
struct Affine {
    translation: [f64; 3],
    matrix: [[f64; 3]; 3],
}

/// A case of ../shared: its body, and the poses of its file.
fn case(folder: &Path) -> (Statics, Vec<(String, ControlPoses)>) {
    let scene = Scene::load(&folder.join("scene.toml")).unwrap();
    let (name, body) = scene.body.first().unwrap();
    let statics = Statics::new(&scene, name, law(&body.model), &Silent).unwrap();
    let poses: Poses = config::load(&folder.join("poses.toml")).unwrap();
    let of = |pose: Pose| {
        let control = |name: &String| match pose.control.get(name) {
            Some(Affine { translation, matrix }) => ControlPose {
                translation: (*translation).into(),
                matrix: Matrix3::from_fn(|i, j| matrix[i][j]),
            },
            None => ControlPose::REST,
        };
        (pose.name.clone(), body.control.keys().map(control).collect())
    };
    (statics, poses.pose.into_iter().map(of).collect())
}

/// Rows of a CSV file: the pose, and the numbers after it.
fn rows(path: &Path) -> Vec<(String, Vec<f64>)> {
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let (pose, numbers) = line.split_once(',').unwrap();
        (pose.to_owned(), numbers.split(',').map(|number| number.parse().unwrap()).collect())
    };
    text.lines().skip(1).map(row).collect()
}

/// Solves the case pose by pose; worst relative differences of displacements (L2), energy, and force on the control
/// element that moves.
fn compare(name: &str) -> Option<[f64; 3]> {
    let folder = shared(&format!("cases/{name}"))?;
    let (mut statics, poses) = case(&folder);
    let expected = rows(&folder.join("expected.csv"));
    let energies: BTreeMap<_, _> = rows(&folder.join("expected.energy.csv")).into_iter().collect();
    let mut worst = [0.0f64; 3];
    println!("{name}: {} nodes, {} tetrahedra", statics.mesh.nodes.len(), statics.mesh.tets.len());
    println!(
        "  pose       displacement   energy    force   residual  steps halved factors  least det F  seconds"
    );
    for (pose, control) in &poses {
        let started = std::time::Instant::now();
        let settled = statics.solve(control, &Silent).unwrap();
        let seconds = started.elapsed().as_secs_f64();
        let by_tag: BTreeMap<u64, Vector3<f64>> =
            statics.mesh.tags.iter().copied().zip(settled.displacement.iter().copied()).collect();
        let (mut off, mut all, mut count) = (0.0, 0.0, 0);
        for (_, numbers) in expected.iter().filter(|(of, _)| of == pose) {
            let u = Vector3::from_column_slice(&numbers[1..]);
            off += (by_tag[&(numbers[0] as u64)] - u).norm_squared();
            all += u.norm_squared();
            count += 1;
        }
        assert_eq!(count, statics.mesh.nodes.len(), "every node is compared");
        let moved = control.iter().position(|pose| *pose != ControlPose::REST).unwrap();
        let row = &energies[pose];
        let force = Vector3::from_column_slice(&row[1..]);
        let found = [
            (off / all).sqrt(),
            (settled.energy / row[0] - 1.0).abs(),
            (settled.wrenches[moved].force - force).norm() / force.norm(),
        ];
        println!(
            "  {pose:<10} {:12.1e} {:8.1e} {:8.1e} {:10.1e} {:6} {:6} {:7} {:12.4} {seconds:8.2}",
            found[0],
            found[1],
            found[2],
            settled.residual,
            settled.counts.steps,
            settled.counts.halved,
            settled.counts.factorizations,
            settled.least_det.0
        );
        (0..3).for_each(|i| worst[i] = worst[i].max(found[i]));
    }
    Some(worst)
}

#[test]
fn tube_and_beam_match_the_independent_solutions() {
    for name in ["tube_stvk", "beam_stvk"] {
        let Some(worst) = compare(name) else { continue };
        assert!(worst.iter().all(|worst| *worst < 1e-8), "{name}: {worst:?}");
    }
}

#[test]
fn experiment_twist() {
    let Some(folder) = shared("cases/tube_stvk") else { return };
    let (mut statics, poses) = case(&folder);
    let moved = poses[0].1.iter().position(|pose| *pose != ControlPose::REST).unwrap();
    for degrees in [90.0f64, 100., 110., 120., 130., 140., 150., 160., 170., 175.0, 180.0] {
        let mut pose = vec![ControlPose::REST; 2];
        pose[moved].matrix = *Rotation3::from_axis_angle(&Vector3::z_axis(), degrees.to_radians()).matrix();
        match statics.solve(&pose, &Silent) {
            Ok(s) => println!(
                "{degrees}: W {} least {:?} inverted {} {:?} res {:.1e}",
                s.energy,
                s.least_det,
                s.inverted.len(),
                s.counts,
                s.residual
            ),
            Err(e) => println!("{degrees}: {e}"),
        }
    }
}

#[test]
fn experiment_compress() {
    let mut statics = Statics::new(&block_scene([4, 4, 4], ""), "block", law("stvk"), &Silent).unwrap();
    for height in [0.9, 0.8, 0.7, 0.68, 0.66, 0.64, 0.62, 0.6, 0.55, 0.5] {
        let mut pose = vec![ControlPose::REST; 2];
        pose[0].translation.x = height - 1.0;
        match statics.solve(&pose, &Silent) {
            Ok(s) => println!(
                "{height}: W {} f {} least {:?} inverted {} {:?} res {:.1e}",
                s.energy,
                s.wrenches[0].force.x,
                s.least_det,
                s.inverted.len(),
                s.counts,
                s.residual
            ),
            Err(e) => println!("{height}: {e}"),
        }
    }
}
