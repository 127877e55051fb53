//! Models of large strain online: what the background finds is static equilibrium, and is felt as it should be.

use crate::common::block_scene;
use greenstage::deform::{
    ControlPose, ControlPoses, DeformationModel, Deformer, EquilibriumResult, PoseSlope, StateAge, Statics,
    find_model,
};
use greenstage::fem::LAWS;
use greenstage::green::{self, GreenFile, Requirements, VOLUME};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

const BEAM: &str = r#"
[body.b]
generate = { block = { size = [1.0, 0.1, 0.1], cells = [16, 2, 2] } }
material = { young = 1.0e6, poisson = 0.3 }
control.high = { nodes = { group = "xmax" }, grab = "dragger" }
control.low = { nodes = { group = "xmin" }, grab = "fixed" }
"#;

fn file_of(scene: &Scene) -> Arc<GreenFile> {
    let body = scene.body.keys().next().unwrap();
    let precomputed = green::precompute(scene, body, &Requirements::new(&[VOLUME]), &Silent).unwrap();
    green::opened(&[precomputed]).unwrap()
}

/// A body that waits for the equilibrium of each of its poses.
fn waiting(scene: &Scene, model: &str) -> Deformer {
    let mut deformer =
        Deformer::new(file_of(scene), scene.body.keys().next().unwrap(), find_model(model).unwrap()).unwrap();
    deformer.be_patient(Duration::MAX);
    deformer
}

/// The first control element turned about `axis` by an angle and moved, the second at rest.
fn turned(axis: Vector3<f64>, degrees: f64, translation: Vector3<f64>) -> ControlPoses {
    let matrix = *Rotation3::from_scaled_axis(axis * degrees.to_radians()).matrix();
    vec![ControlPose { translation, matrix }, ControlPose::REST]
}

/// A bend of the beam by an angle, along an arc of its length.
fn bend(degrees: f64) -> ControlPoses {
    let angle = degrees.to_radians().max(1e-9);
    let end = Vector3::new(angle.sin() / angle - 1.0, (1.0 - angle.cos()) / angle, 0.0);
    turned(Vector3::z(), degrees, end)
}

/// The largest difference of a surface node from the equilibrium, in parts of the largest displacement.
fn off(deformer: &Deformer, settled: &EquilibriumResult) -> f64 {
    let size = settled.displacement.iter().map(|u| u.norm()).fold(0.0, f64::max);
    let node = |i: usize| settled.displacement[deformer.tags()[i] as usize - 1];
    let off = |i: usize| (deformer.displacement(i) - node(i)).norm();
    (0..deformer.node_count()).map(off).fold(0.0, f64::max) / size
}

fn respond(model: &mut dyn DeformationModel, poses: &[ControlPose]) -> (f64, Vec<PoseSlope>) {
    let mut slopes = vec![PoseSlope::default(); poses.len()];
    let response = model.respond(poses, &mut slopes).unwrap();
    assert!(response.is_defined);
    (response.energy, slopes)
}

/// Each state is the equilibrium that `deform` finds: the surface to f32, energy and forces to the settler's tolerance.
#[test]
fn what_the_background_finds_is_static_equilibrium() {
    let scene = Scene::parse(BEAM, Path::new("background.toml")).unwrap();
    for law in LAWS {
        let mut deformer = waiting(&scene, law.name);
        let mut felt = deformer.another_model().unwrap();
        let mut statics = Statics::new(&scene, "b", law, &Silent).unwrap();
        let ways =
            [bend(20.0), bend(45.0), turned(Vector3::x(), 60.0, Vector3::new(0.02, 0.0, 0.0)), bend(5.0)];
        for poses in ways {
            deformer.evaluate(&poses).unwrap();
            assert_eq!(deformer.age(), Some(StateAge::Current));
            let settled = statics.solve(&poses, &Silent).unwrap();
            let (energy, slopes) = respond(felt.as_mut(), &poses);
            let off = off(&deformer, &settled);
            let energy_off = (energy / settled.energy - 1.0).abs();
            let force = settled.wrenches[0].force;
            let force_off = (slopes[0].translation - force).norm() / force.norm();
            println!("{}: u {off:.1e}, energy {energy_off:.1e}, force {force_off:.1e}", law.name);
            assert!(off < 1e-6 && energy_off < 1e-8 && force_off < 1e-4, "{}", law.name);
        }
    }
}

/// Quadratic elements, and linear ones that do not lock, near ν = ½.
#[test]
fn every_element_is_followed() {
    for (element, poisson, cells) in [("tet10", 0.3, [6, 1, 1]), ("tet4_anp", 0.49, [10, 2, 2])] {
        let from = "material = { young = 1.0e6, poisson = 0.3 }";
        let to = format!("material = {{ young = 1.0e6, poisson = {poisson} }}\nelement = \"{element}\"");
        let text = BEAM.replacen(from, &to, 1).replacen("[16, 2, 2]", &format!("{cells:?}"), 1);
        let scene = Scene::parse(&text, Path::new("background.toml")).unwrap();
        let mut deformer = waiting(&scene, "neo_hookean");
        let law = LAWS.iter().find(|law| law.name == "neo_hookean").unwrap();
        let mut statics = Statics::new(&scene, "b", law, &Silent).unwrap();
        for poses in [bend(15.0), bend(35.0)] {
            deformer.evaluate(&poses).unwrap();
            assert_eq!(deformer.age(), Some(StateAge::Current), "{element}");
            let off = off(&deformer, &statics.solve(&poses, &Silent).unwrap());
            println!("{element}: {off:.1e}");
            assert!(off < 1e-5, "{element}: {off:e}");
        }
    }
}

/// Between two equilibria the energy is quadratic, its slopes are its derivatives, and its stiffness is that of equilibria.
#[test]
fn the_stiffness_that_is_felt_is_that_of_equilibria() {
    let scene = Scene::parse(BEAM, Path::new("background.toml")).unwrap();
    let mut deformer = waiting(&scene, "neo_hookean");
    let mut felt = deformer.another_model().unwrap();
    let poses = bend(30.0);
    deformer.evaluate(&poses).unwrap();
    let moved = |entry: usize, by: f64| {
        let mut moved = poses.clone();
        match entry {
            0..3 => moved[0].translation[entry] += by,
            _ => moved[0].matrix[(entry / 3 - 1, entry % 3)] += by,
        }
        moved
    };
    let of = |slopes: &[PoseSlope], entry: usize| match entry {
        0..3 => slopes[0].translation[entry],
        _ => slopes[0].matrix[(entry / 3 - 1, entry % 3)],
    };
    // The equilibria of two poses aside, and what is felt there of the one between them, once its stiffness has come.
    let step = 1e-4;
    for entry in [0, 1, 5, 7, 11] {
        let mut slope_at = |by: f64| {
            deformer.evaluate(&moved(entry, by)).unwrap();
            of(&respond(felt.as_mut(), &moved(entry, by)).1, entry)
        };
        let expected = (slope_at(step) - slope_at(-step)) / (2.0 * step);
        deformer.evaluate(&poses);
        let started = Instant::now();
        let (mut found, mut derivative) = (0.0, 0.0);
        while started.elapsed() < Duration::from_secs(60) {
            let [(ahead, slopes), (back, behind)] =
                [step, -step].map(|by| respond(felt.as_mut(), &moved(entry, by)));
            found = (of(&slopes, entry) - of(&behind, entry)) / (2.0 * step);
            derivative = (ahead - back) / (2.0 * step) - of(&respond(felt.as_mut(), &poses).1, entry);
            if (found / expected - 1.0).abs() < 1e-3 {
                break;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        println!("entry {entry}: {found:.5e} N/m felt, {expected:.5e} of equilibria");
        assert!((found / expected - 1.0).abs() < 1e-3, "entry {entry}: {found} {expected}");
        assert!(derivative.abs() < 1e-6 * expected.abs(), "entry {entry}: {derivative}");
    }
}

/// A force loop that feels a body changes no bit of what is found, with bends up to the first new factor and beyond.
#[test]
fn a_body_that_is_felt_is_found_with_the_same_bits() {
    let scene = Scene::parse(BEAM, Path::new("background.toml")).unwrap();
    let mut alone = waiting(&scene, "neo_hookean");
    let mut of_loop = waiting(&scene, "neo_hookean");
    of_loop.feel();
    let mut felt = of_loop.another_model().unwrap();
    for step in 1..=30 {
        let poses = bend(2.0 * f64::from(step));
        alone.evaluate(&poses).unwrap();
        of_loop.evaluate(&poses).unwrap();
        // The stiffness that the loop asks for comes now and then.
        std::thread::sleep(Duration::from_millis(if step % 4 == 0 { 20 } else { 0 }));
        respond(felt.as_mut(), &poses);
        assert_eq!(of_loop.snapshot(), alone.snapshot(), "step {step}");
    }
}

/// Turned by 360° in steps of a hand, the beam stays twisted; forgotten, it is at rest; set back, it is twisted again.
#[test]
fn a_whole_turn_of_a_hand_is_kept_forgotten_and_set_back() {
    let scene = Scene::parse(BEAM, Path::new("background.toml")).unwrap();
    let mut deformer = waiting(&scene, "corotational");
    let mut felt = deformer.another_model().unwrap();
    let twist = |degrees: f64| turned(Vector3::x(), degrees, Vector3::zeros());
    for step in 1..=18 {
        deformer.evaluate(&twist(20.0 * f64::from(step))).unwrap();
    }
    let whole = deformer.turn(0);
    let (energy, _) = respond(felt.as_mut(), &twist(360.0));
    let law = LAWS.iter().find(|law| law.name == "corotational").unwrap();
    let mut statics = Statics::new(&scene, "b", law, &Silent).unwrap();
    statics.solve(&twist(120.0), &Silent).unwrap();
    for degrees in [240.0, 360.0] {
        let held = statics.held().unwrap().clone();
        let settled = statics.solve_after("before", &held, &twist(degrees), &Silent).unwrap();
        if degrees == 360.0 {
            assert!((energy / settled.energy - 1.0).abs() < 1e-8, "{energy} {}", settled.energy);
        }
    }
    deformer.forget();
    deformer.evaluate(&twist(0.0));
    let (rest, _) = respond(felt.as_mut(), &twist(0.0));
    assert!(rest.abs() < 1e-9 * energy, "{rest} J");
    deformer.set_turn(0, whole);
    deformer.evaluate(&twist(359.0)).unwrap();
    let (again, _) = respond(felt.as_mut(), &twist(359.0));
    assert!((again / energy - (359.0f64 / 360.0).powi(2)).abs() < 1e-3, "{again} {energy}");
}

/// The newest equilibrium stays, and is reported as such, beyond the last one; on the way back the model goes on.
#[test]
fn a_lost_equilibrium_is_told_and_found_again() {
    let scene = block_scene([4, 4, 4], "");
    let mut deformer = waiting(&scene, "stvk");
    let press = |height: f64| turned(Vector3::x(), 0.0, Vector3::x() * (height - 1.0));
    deformer.evaluate(&press(0.9)).unwrap();
    assert_eq!(deformer.age(), Some(StateAge::Current));
    deformer.evaluate(&press(0.4)).unwrap();
    assert_eq!(deformer.age(), Some(StateAge::Lost));
    let lowest = (0..deformer.node_count()).map(|i| deformer.displacement(i).norm()).fold(0.0, f64::max);
    // It was lost where `deform` loses it, between 70 and 60 % of the height.
    assert!((0.3..0.4).contains(&lowest), "{lowest}");
    deformer.evaluate(&press(0.8)).unwrap();
    assert_eq!(deformer.age(), Some(StateAge::Current));
    let law = LAWS.iter().find(|law| law.name == "stvk").unwrap();
    let settled = Statics::new(&scene, "block", law, &Silent).unwrap().solve(&press(0.8), &Silent).unwrap();
    assert!(off(&deformer, &settled) < 1e-6);
}

/// A frame that does not wait shows the newest state; states come as they are found, the last one for the last pose.
#[test]
fn a_hand_is_followed_without_waiting() {
    let scene = Scene::parse(BEAM, Path::new("background.toml")).unwrap();
    let file = file_of(&scene);
    let mut deformer = Deformer::new(file, "b", find_model("neo_hookean").unwrap()).unwrap();
    let before = deformer.state.field_version;
    for step in 1..=40 {
        deformer.take(&bend(f64::from(step)));
    }
    let started = Instant::now();
    while deformer.age() != Some(StateAge::Current) && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(deformer.has_news());
    assert!(deformer.evaluate(&bend(40.0)).is_some(), "news is taken though no pose has changed");
    assert!(!deformer.has_news() && deformer.state.field_version > before);
    let law = LAWS.iter().find(|law| law.name == "neo_hookean").unwrap();
    let mut statics = Statics::new(&scene, "b", law, &Silent).unwrap();
    let settled = statics.solve(&bend(40.0), &Silent).unwrap();
    let off = off(&deformer, &settled);
    assert!(off < 1e-6, "{off:e}");
}

#[test]
fn a_volume_that_is_damaged_is_refused() {
    let scene = Scene::parse(BEAM, Path::new("background.toml")).unwrap();
    let solution = green::solve(&scene, "b", &Requirements::new(&[VOLUME]), &Silent).unwrap();
    let found = green::Volume::read(&|name| solution.tables.get(name).cloned(), 2).unwrap();
    assert_eq!((&found.mesh.nodes, &found.mesh.tets), (&solution.mesh.nodes, &solution.mesh.tets));
    assert_eq!(found.surface, solution.surface.nodes);
    let held: Vec<&Vec<u32>> = solution.controls.iter().map(|control| &control.nodes).collect();
    assert_eq!(found.held.iter().collect::<Vec<_>>(), held);
    for (name, entry, value) in [
        ("volume/tets", 3, 1e9),
        ("volume/tets", 0, 0.5),
        ("volume/nodes", 1, f64::NAN),
        ("volume/held", 0, 2.0),
        ("volume/surface", 0, -1.0),
        ("volume/element", 0, 99.0),
    ] {
        let damaged = |table: &str| {
            let mut found = solution.tables.get(table).cloned();
            if let Some(found) = found.as_mut().filter(|_| table == name) {
                found[entry] = value;
            }
            found
        };
        let message = green::Volume::read(&damaged, 2).unwrap_err();
        assert!(message.contains(name), "{message}");
    }
    let missing = |name: &str| solution.tables.get(name).filter(|_| name != "volume/lame").cloned();
    assert!(green::Volume::read(&missing, 2).unwrap_err().contains("volume/lame"));
}
