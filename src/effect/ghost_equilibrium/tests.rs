//! The ghost against the body that it is drawn over, and against what else solves the pose.

use super::*;
use crate::deform::{Statics, legs};
use crate::effect::{Resolved, attach, file_of};
use crate::fem::LAWS;
use crate::green::GreenFile;
use crate::render::Drawable;
use crate::solve::Silent;
use crate::stage::Stage;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use std::path::Path;
use std::sync::Arc;

/// Length and side of [`bar`], m.
pub(in crate::effect) const BAR: [f64; 2] = [4.0, 1.0];
/// Young's modulus of [`bar`], Pa.
pub(in crate::effect) const YOUNG: f64 = 1.0e3;

/// A bar along x, held at both end faces, with these effects; its scene, its file and a world.
pub(crate) fn bar(model: &str, effects: &[&str]) -> (Resolved, Arc<GreenFile>, World) {
    let [length, side] = BAR;
    let text = format!(
        "[body.bar]\n\
         generate = {{ block = {{ size = [{length}, {side}, {side}], cells = [12, 3, 3] }} }}\n\
         material = {{ young = {YOUNG}, poisson = 0.0 }}\n\
         model = \"{model}\"\n\
         effects = {effects:?}\n\
         control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
    );
    let scene = Resolved::parse(&text, Path::new("bar.toml")).unwrap();
    let file = file_of(&scene).unwrap();
    let world = World::new(&scene, &scene.models(), &file, Stage::find("desktop").unwrap()).unwrap();
    (scene, file, world)
}

/// The bar in a pose, with the picture that is kept of it; and the poses.
fn shown(model: &str, pose: [ControlPose; 2]) -> (Resolved, World) {
    let (scene, file, mut world) = bar(model, &["ghost_equilibrium"]);
    let mut running = attach(&[ENTRY], &scene, &file, &mut world).unwrap();
    world.is_for_pictures = true;
    world.bodies[0].deformer.evaluate(&pose);
    world.show_by(running[0].as_mut());
    assert!(
        world.frame.all(Drawable::ghost).next().is_none()
            && world.frame.all(Drawable::plate).next().is_none(),
        "a picture that is kept waits"
    );
    let mut frame = std::mem::take(&mut world.frame);
    running[0].before_picture(&world, &mut frame);
    world.frame = frame;
    (scene, world)
}

/// Largest distance of the ghost from the body over the surface, m.
fn apart(world: &World) -> f64 {
    let ghosts: Vec<_> = world.frame.all(Drawable::ghost).collect();
    let [ghost] = ghosts[..] else { panic!("{} ghosts", ghosts.len()) };
    let deformer = &world.bodies[0].deformer;
    let place =
        |node: usize| Vector3::from(deformer.rest()[node]).cast::<f64>() + deformer.displacement(node);
    let ghost = |node: usize| Vector3::from(ghost.shape.positions[node]).cast::<f64>();
    (0..deformer.node_count()).map(|node| (place(node) - ghost(node)).norm()).fold(0.0, f64::max)
}

fn words(world: &World) -> String {
    let lines = world.frame.all(Drawable::plate).flat_map(|plate| &plate.lines);
    lines.map(|line| line.iter().map(|(text, _)| text.as_str()).collect::<String>() + "\n").collect()
}

fn pulled(strain: f64) -> ControlPose {
    ControlPose { translation: Vector3::new(strain * BAR[0], 0.0, 0.0), ..ControlPose::REST }
}

/// Linear theory leaves out the square of the strain; with ν = 0 a pulled bar is the same by both.
#[test]
fn a_bar_pulled_slightly_is_in_equilibrium_within_linear_theory_s_own_error() {
    let (_, world) = shown("linear", [ControlPose::REST, pulled(1e-3)]);
    assert!(apart(&world) < 1e-6 * BAR[0], "{} m", apart(&world));
    assert!(words(&world).contains("linear is off by"), "{}", words(&world));
    let bent = ControlPose { translation: Vector3::new(0.0, 1e-3 * BAR[0], 0.0), ..ControlPose::REST };
    let (_, world) = shown("linear", [ControlPose::REST, bent]);
    let (sideways, error) = (1e-3 * BAR[0], apart(&world));
    assert!(error > 1e-5 * sideways && error < 5e-3 * sideways, "{error} m of {sideways} m");
}

/// Turned as a whole about its axis by θ, a linear bar takes sin θ of the turn and stays 1 in place of cos θ wherever its
/// ends do not hold it: its middle swells, and stands 1 - cos θ of its radius from where the turn brings it.
#[test]
fn a_bar_turned_as_a_whole_swells_by_one_minus_the_cosine() {
    let angle = 0.5;
    let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), angle).matrix();
    let turned = ControlPose { matrix, ..ControlPose::REST };
    let (_, world) = shown("linear", [turned; 2]);
    let radius = BAR[1] / 2.0f64.sqrt();
    let swelling = (1.0 - f64::cos(angle)) * radius;
    assert!((apart(&world) / swelling - 1.0).abs() < 0.02, "{} m, not {swelling} m", apart(&world));
    // The ghost is the turn itself: nothing of it is strained.
    let rest = world.bodies[0].deformer.rest();
    for (ghost, rest) in world.frame.all(Drawable::ghost).next().unwrap().shape.positions.iter().zip(rest) {
        let turned: Vector3<f64> = matrix * Vector3::from(*rest).cast::<f64>();
        assert!((Vector3::from(*ghost).cast::<f64>() - turned).norm() < 1e-5);
    }
    let (_, world) = shown("rotation", [turned; 2]);
    assert!(apart(&world) < 1e-5, "the model rotation turns as a whole: {} m", apart(&world));
}

/// A scene may ask for another law than that of the body's model.
#[test]
fn the_ghost_stands_in_equilibrium_under_the_law_of_its_settings() {
    let pose = ControlPose { translation: Vector3::new(0.6, 0.0, 0.0), matrix: Matrix3::identity() };
    let (scene, file, mut world) = bar("rotation", &[NAME]);
    let mut asking = Scene::clone(&scene);
    asking.body["bar"].effect.insert(NAME.into(), "law = \"neo_hookean\"".parse().unwrap());
    let scene = Resolved::new(asking).unwrap();
    let mut running = attach(&[ENTRY], &scene, &file, &mut world).unwrap();
    let poses = vec![ControlPose::REST, pose];
    world.bodies[0].deformer.evaluate(&poses);
    let mut frame = std::mem::take(&mut world.frame);
    running[0].before_picture(&world, &mut frame);
    world.frame = frame;
    let neo_hookean = LAWS.iter().find(|law| law.name == "neo_hookean").unwrap();
    let mut statics = Statics::new(&scene, "bar", neo_hookean, &Silent).unwrap();
    let settled = statics.solve(&poses, &Silent).unwrap();
    let deformer = &world.bodies[0].deformer;
    for (node, tag) in deformer.tags().iter().enumerate() {
        let at = statics.mesh.tags.iter().position(|known| known == tag).unwrap();
        let place = Vector3::from(deformer.rest()[node]).cast::<f64>() + settled.displacement[at];
        let ghost = Vector3::from(world.frame.all(Drawable::ghost).next().unwrap().shape.positions[node])
            .cast::<f64>();
        assert!((place - ghost).norm() < 1e-6, "node {node}: {place} is not {ghost}");
    }
    assert!(words(&world).contains("neo-Hookean"), "{}", words(&world));
}

#[test]
fn the_ghost_is_the_equilibrium_that_deform_writes_and_its_numbers_are_those_of_the_pose() {
    let angle = f64::to_radians(40.0);
    let matrix: Matrix3<f64> = *Rotation3::from_axis_angle(&Vector3::z_axis(), angle).matrix();
    let translation = Vector3::new(-0.2, 1.2, 0.0);
    let poses = vec![ControlPose::REST, ControlPose { translation, matrix }];
    let (scene, world) = shown("rotation", [poses[0], poses[1]]);
    let mut statics = Statics::new(&scene, "bar", &STVK, &Silent).unwrap();
    let settled = statics.solve(&poses, &Silent).unwrap();
    let deformer = &world.bodies[0].deformer;
    let (mut largest, mut sum) = (0.0_f64, 0.0);
    for (node, tag) in deformer.tags().iter().enumerate() {
        let at = statics.mesh.tags.iter().position(|known| known == tag).unwrap();
        let u = settled.displacement[at];
        let place = Vector3::from(deformer.rest()[node]).cast::<f64>() + u;
        let ghost = Vector3::from(world.frame.all(Drawable::ghost).next().unwrap().shape.positions[node])
            .cast::<f64>();
        assert!((place - ghost).norm() < 1e-6, "node {node}: {place} is not {ghost}");
        let off = (deformer.displacement(node) - u).norm();
        (largest, sum) = (largest.max(off), sum + off * off);
    }
    let rms = (sum / deformer.node_count() as f64).sqrt();
    let told = format!("off by {} at most, {} RMS", quantity(largest, "m"), quantity(rms, "m"));
    let words = words(&world);
    assert!(
        words.contains(&told) && words.contains("of this pose\nSt. Venant–Kirchhoff, found in"),
        "{words}"
    );
    assert!(largest > 0.01, "{largest} m: the models differ");
}

/// A live picture never shows a number without the pose to which it belongs.
#[test]
fn a_ghost_of_a_pose_that_was_left_says_so_and_is_solved_anew() {
    let (scene, file, mut world) = bar("rotation", &["ghost_equilibrium"]);
    let mut running = attach(&[ENTRY], &scene, &file, &mut world).unwrap();
    let mut frame = |world: &mut World| {
        world.frame.drawables.clear();
        world.show_by(running[0].as_mut());
        words(world)
    };
    assert_eq!(frame(&mut world), "", "at rest nothing is solved");
    world.bodies[0].deformer.evaluate(&[ControlPose::REST, pulled(0.05)]);
    assert!(frame(&mut world).contains("once the hand rests"));
    let mut until = |world: &mut World, what: &str| {
        let started = Instant::now();
        while !frame(world).contains(what) {
            assert!(started.elapsed().as_secs() < 60, "{}", frame(world));
            std::thread::sleep(Duration::from_millis(5));
        }
        (frame(world), world.frame.all(Drawable::ghost).next().unwrap().color[3])
    };
    let (words, fresh) = until(&mut world, "of this pose");
    assert!(words.contains("is off by") && !words.contains("solving"), "{words}");
    world.bodies[0].deformer.evaluate(&[ControlPose::REST, pulled(0.15)]);
    let (words, faded) = until(&mut world, "of a pose 400 mm away");
    assert!(words.contains("was off by") && faded < fresh, "{words}");
    until(&mut world, "of this pose");
}

/// A St. Venant–Kirchhoff bar gives way at 1/√3 of its length.
#[test]
fn a_pose_without_equilibrium_is_told() {
    let (_, world) = shown("linear", [ControlPose::REST, pulled(-0.7)]);
    let words = words(&world);
    assert!(
        words.contains("no static equilibrium of this pose found") && words.contains("% of the way"),
        "{words}"
    );
    assert!(world.frame.all(Drawable::ghost).next().is_none());
}

/// Twisted by 200° at one end, or by 100° at both against each other: the same shape, and another than twisted by 160° the other way
/// round, which the same matrix stands for.
#[test]
fn a_turn_of_more_than_half_is_gone_in_legs() {
    let (scene, _, _) = bar("linear", &[]);
    let mut statics = Statics::new(&scene, "bar", &STVK, &Silent).unwrap();
    let turned = |degrees: f64| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), f64::to_radians(degrees));
    let pose = |degrees: f64| ControlPose {
        matrix: *turned(degrees).to_rotation_matrix().matrix(),
        ..ControlPose::REST
    };
    // The quaternion of 200° by its sign: cos 100° is negative.
    let turns =
        [turned(0.0), UnitQuaternion::new_unchecked(turned(100.0).into_inner() * turned(100.0).into_inner())];
    assert_eq!((legs(&turns), legs(&[turned(170.0)])), (3, 1));
    let long = statics.solve_turned(&vec![ControlPose::REST, pose(200.0)], &turns, &Silent).unwrap();
    let both = statics.solve(&vec![pose(-100.0), pose(100.0)], &Silent).unwrap();
    let short = statics.solve(&vec![ControlPose::REST, pose(200.0)], &Silent).unwrap();
    assert!((long.energy / both.energy - 1.0).abs() < 1e-5, "{} J, {} J", long.energy, both.energy);
    assert!(short.energy < 0.8 * long.energy, "{} J, {} J", short.energy, long.energy);
}
