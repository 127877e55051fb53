//! The elastica: a bar that bends without a strain of its axis.

use super::{bar, bending_stiffness};
use greenstage::deform::{Branch, ControlPose, EquilibriumResult, Freedom, Statics};
use greenstage::fem::STVK;
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::Vector3;
use std::path::Path;
use std::time::Instant;

/// ∫₀^φ (1 - k² sin² t)^power dt: F of power -½, E of power ½. Simpson's rule.
fn elliptic(phi: f64, k: f64, power: f64) -> f64 {
    const PARTS: usize = 2000;
    let at = |i: usize| (1.0 - (k * (phi * i as f64 / PARTS as f64).sin()).powi(2)).powf(power);
    let weight = |i: usize| if i == 0 || i == PARTS { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
    (0..=PARTS).map(|i| weight(i) * at(i)).sum::<f64>() * phi / (3 * PARTS) as f64
}

/// Root of an increasing function.
fn root(mut low: f64, mut high: f64, of: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if of(middle) > 0.0 { &mut high } else { &mut low }) = middle;
    }
    0.5 * (low + high)
}

/// Deflection across and along, in parts of the length, of a cantilever under P L²/EI = `load` across its end (Bisshopp and Drucker,
/// Quart. Appl. Math. 3, 1945, 272-275).
fn cantilever(load: f64) -> [f64; 2] {
    let half_pi = std::f64::consts::FRAC_PI_2;
    let modulus = |angle: f64| (0.5 * (1.0 + angle.sin())).sqrt();
    let first = |k: f64| (0.5_f64.sqrt() / k).asin();
    let length = |angle: f64| {
        let k = modulus(angle);
        elliptic(half_pi, k, -0.5) - elliptic(first(k), k, -0.5)
    };
    let angle = root(1e-6, half_pi - 1e-9, |angle| length(angle) - load.sqrt());
    let k = modulus(angle);
    let across = 1.0 - 2.0 / load.sqrt() * (elliptic(half_pi, k, 0.5) - elliptic(first(k), k, 0.5));
    [across, 1.0 - (2.0 * angle.sin() / load).sqrt()]
}

/// Mattiasson, Int. J. Numer. Methods Engng. 17, 1981, 145-153, table 1.
#[test]
fn the_closed_form_is_the_published_one() {
    for (load, known) in [(1.0, [0.30172, 0.05643]), (5.0, [0.71379, 0.38763]), (10.0, [0.81061, 0.55500])] {
        let own = cantilever(load);
        assert!((own[0] - known[0]).abs() < 1e-5 && (own[1] - known[1]).abs() < 1e-5, "{load}: {own:?}");
    }
}

/// An end that is pushed across up to P L²/EI = 10, each load at once.
#[test]
fn a_pushed_end_bends_as_the_elastica_at_once() {
    let thickness = 0.01;
    let mut statics = bar(thickness, 40);
    for load in [1.0, 5.0, 10.0] {
        let force = [0.0, 0.0, load * bending_stiffness(thickness), 0.0, 0.0, 0.0];
        statics.push(&[Freedom { free: [true; 6], load: force }, Freedom::default()]);
        let started = Instant::now();
        let found = statics.solve(&vec![ControlPose::REST; 2], &Silent).unwrap();
        let [across, along] = cantilever(load);
        let moved = found.poses[0].translation;
        let off = [moved.z / across - 1.0, -moved.x / along - 1.0];
        println!(
            "P L²/EI = {load}: off by {off:.5?}, {} steps, {} halved, {} factorizations, least {:?}, {:.2} s",
            found.counts.steps,
            found.counts.halved,
            found.counts.factorizations,
            found.stability.least.as_ref().map(|(least, _)| least),
            started.elapsed().as_secs_f64()
        );
        assert!(off.iter().all(|off| off.abs() < 5e-3), "{load}: {moved}");
        assert!(found.stability.branch == Branch::Stable && found.stability.negative == 0);
    }
}

/// Shortening and deflection of the middle, in parts of the length, of a column that is clamped at both ends and bears `ratio` times
/// Euler's load: four quarters, each half of a hinged one (Timoshenko and Gere, Theory of Elastic Stability, 2nd ed., section 2.7).
fn column(ratio: f64) -> [f64; 2] {
    let half_pi = std::f64::consts::FRAC_PI_2;
    let k = root(0.0, 1.0 - 1e-9, |k| elliptic(half_pi, k, -0.5) - half_pi * ratio.sqrt());
    let (first, second) = (elliptic(half_pi, k, -0.5), elliptic(half_pi, k, 0.5));
    [2.0 - 2.0 * second / first, k / first]
}

/// The motion across of the node in the middle.
fn middle(statics: &Statics, found: &EquilibriumResult) -> f64 {
    let at = |x: &Vector3<f64>| x.norm();
    let nodes = statics.mesh.nodes.iter().zip(&found.displacement);
    let (_, u) = nodes.min_by(|a, b| at(a.0).total_cmp(&at(b.0))).unwrap();
    u.yz().norm()
}

/// A column that is pressed far beyond Euler's load, by a pose and by a force: it buckles, and comes to the published curve.
#[test]
fn a_pressed_column_goes_on_buckled() {
    let thickness = 0.01;
    let mut statics = bar(thickness, 40);
    let euler = 4.0 * std::f64::consts::PI.powi(2) * bending_stiffness(thickness);
    for pressed in [0.05, 0.2] {
        let started = Instant::now();
        let pose = ControlPose { translation: Vector3::x() * -pressed, ..ControlPose::REST };
        let found = statics.solve(&vec![pose, ControlPose::REST], &Silent).unwrap();
        let ratio = -found.wrenches[0].force.x / euler;
        // Part of the shortening is strain of the axis.
        let strain = ratio * euler / (2.0e9 * thickness * thickness);
        let known = root(1.0, 4.0, |ratio| column(ratio)[0] - (pressed - strain));
        let deflection = middle(&statics, &found);
        println!(
            "pressed by {pressed}: P/Pcr {ratio:.4} ({known:.4}), deflection {deflection:.4} ({:.4}), {:?}, {:.2} s",
            column(known)[1],
            found.counts,
            started.elapsed().as_secs_f64()
        );
        println!("{:?}", found.stability.passed);
        assert!((ratio / known - 1.0).abs() < 0.02, "{ratio} and {known}");
        assert!((deflection / column(known)[1] - 1.0).abs() < 0.02, "{deflection}");
        assert!(found.stability.branch == Branch::Buckled && found.stability.least.unwrap().0 > 0.0);
    }
    let mut free = [false; 6];
    free[0] = true;
    let ratio = 1.1;
    let load = [-ratio * euler, 0.0, 0.0, 0.0, 0.0, 0.0];
    statics.push(&[Freedom { free, load }, Freedom::default()]);
    let found = statics.solve(&vec![ControlPose::REST; 2], &Silent).unwrap();
    let [shortening, deflection] = column(ratio);
    let own = [-found.poses[0].translation.x, middle(&statics, &found)];
    println!("pushed by {ratio} Pcr: {own:.4?}, {shortening:.4} {deflection:.4}, {:?}", found.counts);
    assert!((own[0] / shortening - 1.0).abs() < 0.02 && (own[1] / deflection - 1.0).abs() < 0.02, "{own:?}");
    assert!(found.stability.branch == Branch::Buckled);
}

/// A column that buckled to one side has a like equilibrium on the other, which is found from its mirror image at the surface alone.
#[test]
fn a_buckled_column_has_its_mirror_image_beside_it() {
    let thickness = 0.02;
    let mut statics = bar(thickness, 20);
    let pose = ControlPose { translation: Vector3::x() * -0.1, ..ControlPose::REST };
    let poses = vec![pose, ControlPose::REST];
    let found = statics.solve(&poses, &Silent).unwrap();
    let is_outside = |x: &Vector3<f64>| x.y.abs() > 0.999 * thickness || x.z.abs() > 0.499 * thickness;
    let nodes = statics.mesh.nodes.clone();
    let turned = |x: &Vector3<f64>| Vector3::new(x.x, -x.y, -x.z);
    let mirrored = |x: &Vector3<f64>| {
        let own = nodes.iter().zip(&found.displacement);
        let (_, u) =
            own.min_by(|a, b| (a.0 - turned(x)).norm().total_cmp(&(b.0 - turned(x)).norm())).unwrap();
        turned(u)
    };
    let outside: Vec<usize> = (0..nodes.len()).filter(|node| is_outside(&nodes[*node])).collect();
    assert!(outside.len() < nodes.len(), "no node is left to be found");
    let guess: Vec<_> = outside.iter().map(|node| mirrored(&nodes[*node])).collect();
    let other = statics.solve_near_some(&outside, &guess, &poses).unwrap().unwrap();
    let off =
        nodes.iter().zip(&other.displacement).map(|(x, u)| (u - mirrored(x)).norm()).fold(0.0, f64::max);
    let apart = found.displacement.iter().zip(&other.displacement).map(|(a, b)| (a - b).norm());
    let apart = apart.fold(0.0, f64::max);
    println!("off {off:.2e} of {apart:.3}, energies {} {}", found.energy, other.energy);
    assert!(apart > 0.2 && off < 1e-3 * apart, "{off} of {apart}");
    assert!((other.energy / found.energy - 1.0).abs() < 1e-3 && other.stability.branch == Branch::Stable);
    assert!(statics.solve_near_some(&[], &[], &vec![ControlPose::REST; 2]).unwrap().unwrap().energy < 1e-12);
}

/// A square column, 10 : 1, that a single load step takes beyond the pose in which it buckles: what is found is the state to which small
/// steps lead, not the straight one, which is in balance there too but not stable.
#[test]
fn a_column_that_is_pressed_at_once_buckles_as_one_that_is_led_there() {
    let keys = "generate = { block = { size = [0.2, 0.02, 0.02], cells = [16, 2, 2] } }\nelement = \"tet4\"\n\
                material = { young = 1.0e9, poisson = 0.3 }\n\
                control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    let scene = Scene::parse(&format!("[body.b]\n{keys}"), Path::new("column.toml")).unwrap();
    let pressed = |by: &[f64]| {
        let mut statics = Statics::new(&scene, "b", &STVK, &Silent).unwrap();
        statics.judge_stability();
        let pose = |x: &f64| ControlPose { translation: Vector3::x() * -x, ..ControlPose::REST };
        let states = by.iter().map(|x| statics.solve(&vec![ControlPose::REST, pose(x)], &Silent).unwrap());
        states.last().unwrap()
    };
    let straight = pressed(&[9.8e-3]);
    assert!(straight.stability.branch == Branch::Stable && straight.stability.least.unwrap().0 > 0.0);
    for by in [1e-2, 1.02e-2, 1.2e-2, 2e-2] {
        let at_once = pressed(&[by]);
        let led = pressed(&[9e-3, 9.8e-3, 0.5 * (9.8e-3 + by), by]);
        assert!(
            at_once.stability.branch == Branch::Buckled && led.stability.branch == Branch::Buckled,
            "{by}"
        );
        assert!(at_once.stability.least.unwrap().0 > 0.0, "{by}");
        let apart = (at_once.energy / led.energy - 1.0).abs();
        println!("{by} m: energies {apart:.1e} apart");
        assert!(apart < 1e-14, "{by}: {} {}", at_once.energy, led.energy);
    }
}
