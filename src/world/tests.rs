//! A frame from stylus to control pose, without pictures.

use super::*;
use crate::deform::ControlPose;
use crate::green;
use crate::green::GreenFile;
use crate::interact::Action;
use crate::prepare;
use crate::scene::Scene;
use crate::stage::rotation_towards;
use crate::stage::{Eye, Stage};
use crate::track::StylusState;
use crate::track::{Signal, TrackerState};
use nalgebra::{Isometry3, Point3};
use nalgebra::{Translation3, Vector3};
use std::path::Path;
use std::sync::Arc;

mod elsewhere;
mod touch;
mod tracked;

const SCENE: &str = r#"
[body.block]
generate = { block = { size = [2.0, 1.0, 1.0], cells = [4, 2, 2] } }
material = { young = 1.0e3, poisson = 0.3 }
model = "rotation"
[body.block.control.fixed]
nodes = { group = "xmin" }
grab = "fixed"
[body.block.control.end]
nodes = { group = "xmax" }
grab = "dragger"
"#;

pub fn world(name: &str) -> World {
    let folder = std::env::temp_dir().join(format!("greenstage-world-{name}-{}", std::process::id()));
    let scene = Scene::parse(SCENE, Path::new("scene.toml")).unwrap();
    let path = folder.join("scene.green");
    green::write(&path, &prepare::precompute(&scene, true).unwrap()).unwrap();
    let file = Arc::new(GreenFile::open(&path).unwrap());
    std::fs::remove_dir_all(&folder).unwrap();
    World::new(&scene, &file, Stage::find("workbench").unwrap()).unwrap()
}

/// A stylus at workspace units `from`, pointing at `to`.
fn state(world: &World, from: [f64; 3], to: [f64; 3], pressed: bool) -> TrackerState {
    let workspace = world.stage.workspace;
    let place = |units: [f64; 3]| workspace.centre + Vector3::from(units) * workspace.radius_m;
    let rotation = rotation_towards(&(place(to) - place(from)), 0.0).unwrap();
    let room_from_stylus = Isometry3::from_parts(Translation3::from(place(from).coords), rotation).cast();
    let stylus = StylusState { room_from_stylus, pressed, ..Default::default() };
    TrackerState { head: None, styli: vec![stylus], time_s: 0.0 }
}

/// A block is drawn with six flat sides: each vertex has the normal of its own, on nodes that are counted once.
#[test]
fn a_block_keeps_its_sharp_edges() {
    let mut world = world("edges");
    let body = &mut world.bodies[0];
    let nodes = body.deformer.node_count();
    let corners_and_edges = 2 * 8 + 4 * (3 + 1 + 1);
    let (positions, normals) =
        (body.deformer.drawn_positions().into_owned(), body.deformer.normals().into_owned());
    assert_eq!([positions.len(), normals.len()], [nodes + corners_and_edges; 2]);
    assert_eq!((body.deformer.positions().len(), body.colours().len()), (nodes, positions.len()));
    let is_axis = |n: &[f32; 3]| n.iter().filter(|x| (x.abs() - 1.0).abs() < 1e-6).count() == 1;
    assert!(normals.iter().all(is_axis), "{normals:?}");
    for (drawn, nodes) in body.deformer.drawn_triangles().iter().zip(body.deformer.triangles()) {
        let at = body.deformer.positions();
        assert_eq!(drawn.map(|v| positions[v as usize]), nodes.map(|v| at[v as usize]));
    }
    body.deformer.keep_sharp(std::f64::consts::PI);
    assert_eq!(body.deformer.normals().len(), nodes, "no edge is sharper than a half turn");
}

#[test]
fn the_stylus_carries_the_end_of_a_fitted_body() {
    let mut world = world("carry");
    let at_end = |world: &World, y: f64, pressed| state(world, [1.5, y, 0.1], [0.0, y, 0.1], pressed);
    world.step(&at_end(&world, 0.0, false));
    assert_eq!(world.bodies[0].controls[1].highlight, Highlight::Hovered);
    world.step(&at_end(&world, 0.0, true));
    assert_eq!(world.bodies[0].controls[1].highlight, Highlight::Held);
    world.step(&at_end(&world, 0.2, true));
    // The block of 2 m fills 0.95 of the workspace: 0.2 of the radius are 0.2 / 0.95 of its half length of 1 m.
    let carried = world.bodies[0].deformer.poses[1].translation;
    assert!((carried - Vector3::new(0.0, 0.2 / 0.95, 0.0)).norm() < 1e-6, "{carried}");
    assert_eq!(world.bodies[0].deformer.poses[0], ControlPose::REST);
    world.step(&at_end(&world, 0.5, false));
    assert_eq!(world.bodies[0].deformer.poses[1].translation, carried, "it stays where it was let go");
    world.reset();
    assert_eq!(world.bodies[0].deformer.poses[1], ControlPose::REST);
}

#[test]
fn a_ray_that_passes_by_takes_a_planar_end_and_a_fixed_one_is_never_taken() {
    let mut world = world("passing");
    let from_above = |world: &World, x: f64| state(world, [x, 1.5, 0.0], [x, 0.0, 0.0], false);
    for (x, highlight) in [
        (0.95, Highlight::Hovered),
        (0.98, Highlight::Hovered),
        (1.05, Highlight::Idle),
        (0.8, Highlight::Idle),
    ] {
        world.step(&from_above(&world, x));
        assert_eq!(world.bodies[0].controls[1].highlight, highlight, "x = {x}");
    }
    world.step(&from_above(&world, -0.95));
    assert_eq!(world.bodies[0].controls[0].highlight, Highlight::Idle);
}

#[test]
fn an_eye_behind_a_screen_has_no_view() {
    let mut world = world("behind");
    assert!(world.view(1, Eye::Left).is_some());
    let behind = Isometry3::translation(0.0, 1.5, -0.5);
    world.step(&TrackerState { head: Some(behind), styli: vec![], time_s: 2.5 });
    assert!(world.view(1, Eye::Left).is_none() && world.view(1, Eye::Left).is_none());
    let [(time_s, said)] = world.warnings.as_slice() else { panic!("{:?}", world.warnings) };
    assert!(*time_s == 2.5 && said.starts_with("left eye: "), "{time_s} s: {said}");
    let lost = Isometry3::translation(f32::NAN, 1.5, 1.0);
    world.step(&TrackerState { head: Some(lost), styli: vec![], time_s: 3.0 });
    assert_eq!(world.room_from_head, behind.cast(), "a lost head stays where it was");
}

#[test]
fn a_world_read_from_a_stream_goes_on_as_the_one_that_was_written() {
    let at_end = |world: &World, y: f64| state(world, [1.5, y, 0.1], [0.0, y, 0.1], true);
    let (mut first, mut second) = (world("written"), world("read"));
    for y in [0.0, 0.1, 0.2] {
        first.step(&at_end(&first, y));
    }
    let mut stream = Vec::new();
    first.write(&mut stream).unwrap();
    assert_ne!(first.state_hash(), second.state_hash());
    second.graph.read(&mut stream.as_slice(), &mut 0).unwrap();
    for y in [0.2, 0.35, 0.5] {
        for world in [&mut first, &mut second] {
            world.step(&at_end(world, y));
        }
        assert_eq!(first.state_hash(), second.state_hash(), "still in the hand at {y}");
    }
}

#[test]
fn a_world_that_is_not_at_rest_beside_its_fields_is_not_written() {
    let refusal = |world: &World| world.write(&mut Vec::new()).map_err(|error| error.to_string());
    let mut world = world("unwritten");
    let resting = state(&world, [0.0, 3.0, 0.0], [0.0, 4.0, 0.0], false);
    let at = |time_s: f64| TrackerState { time_s, ..resting.clone() };
    world.step(&at(0.0));
    refusal(&world).unwrap();
    world.act(Action::ScaleScene(1.5));
    world.step(&at(0.1));
    assert!(refusal(&world).unwrap_err().contains("the scene is moved"));
    world.act(Action::ResetNavigation);
    world.step(&at(0.2));
    assert!(refusal(&world).is_err(), "on its way back");
    world.step(&at(5.0));
    refusal(&world).unwrap();
    world.act(Action::SetAside(0));
    world.step(&at(10.0));
    assert!(refusal(&world).unwrap_err().contains("set aside"));
    world.act(Action::SetAside(0));
    for time_s in [11.0, 12.0] {
        world.step(&at(time_s));
    }
    refusal(&world).unwrap();
    let carry = |y: f64, pressed| state(&world, [1.5, y, 0.1], [0.0, y, 0.1], pressed);
    let frames = [carry(0.0, false), carry(0.0, true), carry(0.3, true), carry(0.3, false)];
    for frame in &frames {
        world.step(frame);
    }
    assert!(refusal(&world).unwrap_err().contains("something to undo"));
}

#[test]
fn keys_act_where_the_cursor_points_though_another_stylus_is_lost() {
    let mut world = world("cursor");
    let mut tracked = state(&world, [1.5, 0.0, 0.1], [0.0, 0.0, 0.1], false);
    assert_eq!(world.cursor(), None);
    let lost = StylusState { signal: Signal::Lost { age_s: 9.0 }, ..tracked.styli[0] };
    let mouse = StylusState { from_eye: true, ..tracked.styli[0] };
    tracked.styli = vec![lost, lost, mouse];
    world.step(&tracked);
    assert_eq!(world.cursor(), Some(2));
    let key = crate::render::window::Key::Char('p');
    assert_eq!(crate::session::keys::action(key, false, &world), Some(Action::SetAside(0)));
    tracked.styli = vec![lost, StylusState { from_eye: false, ..mouse }, mouse];
    world.step(&tracked);
    assert_eq!(world.cursor(), Some(2), "the one that aims from the eye");
    tracked.styli[2] = lost;
    world.step(&tracked);
    assert_eq!(world.cursor(), Some(1), "else the first one that is seen");
}
