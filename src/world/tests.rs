//! A frame from stylus to control pose, without pictures.

use super::inertia::Inertia;
use super::*;
use crate::deform::{Contribution, ControlPose};
use crate::green;
use crate::interact::Action;
use crate::prepare::Resolved;
use crate::render::Drawable;
use crate::stage::{Eye, Stage, rotation_towards};
use crate::track::{Signal, StylusState, TrackerState};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

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

pub fn world() -> World {
    let scene = Resolved::parse(SCENE, Path::new("scene.toml")).unwrap();
    let file = green::opened(&crate::prepare::precompute(&scene, true).unwrap()).unwrap();
    World::new(&scene, &scene.models(), &file, Stage::find("workbench").unwrap()).unwrap()
}

/// A stylus at workspace units `from`, pointing at `to`.
fn state(world: &World, from: [f64; 3], to: [f64; 3], pressed: bool) -> TrackerState {
    let workspace = world.assets.stage.workspace;
    let place = |units: [f64; 3]| workspace.centre + Vector3::from(units) * workspace.radius_m;
    let rotation = rotation_towards(&(place(to) - place(from)), 0.0).unwrap();
    let room_from_stylus = Isometry3::from_parts(Translation3::from(place(from).coords), rotation).cast();
    let stylus = StylusState { room_from_stylus, pressed, ..Default::default() };
    TrackerState { head: None, styli: vec![stylus], time_s: 0.0 }
}

/// An effect that counts its calls of `solve`.
struct Counter(Arc<AtomicUsize>);

impl RunningEffect for Counter {
    fn name(&self) -> &'static str {
        "counter"
    }

    fn acts(&self) -> bool {
        true
    }

    fn solve(&mut self, _: &World, _: &mut [Contribution], _: &mut [&mut dyn Inertia]) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// The graph was evaluated twice in a frame that began at rest, and effects with it.
#[test]
fn effects_are_asked_once_a_frame() {
    let mut world = world();
    let count = Arc::new(AtomicUsize::new(0));
    world.join(vec![Box::new(Counter(count.clone()))]).unwrap();
    let at_end = state(&world, [1.5, 0.0, 0.1], [0.0, 0.0, 0.1], true);
    let mut step = |actions: Vec<Action>| {
        let before = count.load(Ordering::Relaxed);
        world.step(&Input { actions, ..at_end.clone().into() });
        count.load(Ordering::Relaxed) - before
    };
    assert_eq!([step(vec![]), step(vec![Action::Reset]), step(vec![Action::LetGo, Action::Undo])], [1; 3]);
}

/// A block is drawn with six flat sides: each vertex has the normal of its side, while a node is counted once.
#[test]
fn a_block_keeps_its_sharp_edges() {
    let mut world = world();
    let body = &mut world.bodies[0];
    let nodes = body.deformer.node_count();
    let corners_and_edges = 2 * 8 + 4 * (3 + 1 + 1);
    let (positions, normals) =
        (body.deformer.drawn_positions().into_owned(), body.deformer.normals().into_owned());
    assert_eq!([positions.len(), normals.len()], [nodes + corners_and_edges; 2]);
    assert_eq!(
        (body.deformer.positions().len(), body.colours(&world.frame.bodies[0]).len()),
        (nodes, positions.len())
    );
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
    let mut world = world();
    let at_end = |world: &World, y: f64, pressed| state(world, [1.5, y, 0.1], [0.0, y, 0.1], pressed);
    world.step(&at_end(&world, 0.0, false).into());
    assert_eq!(world.frame.bodies[0].highlights[1], Highlight::Hovered);
    world.step(&at_end(&world, 0.0, true).into());
    assert_eq!(world.frame.bodies[0].highlights[1], Highlight::Held);
    world.step(&at_end(&world, 0.2, true).into());
    // The block of 2 m fills 0.95 of the workspace: 0.2 of the radius are 0.2 / 0.95 of its half length of 1 m.
    let carried = world.bodies[0].deformer.poses[1].translation;
    assert!((carried - Vector3::new(0.0, 0.2 / 0.95, 0.0)).norm() < 1e-6, "{carried}");
    assert_eq!(world.bodies[0].deformer.poses[0], ControlPose::REST);
    world.step(&at_end(&world, 0.5, false).into());
    assert_eq!(world.bodies[0].deformer.poses[1].translation, carried, "it stays where it was let go");
    world.reset();
    assert_eq!(world.bodies[0].deformer.poses[1], ControlPose::REST);
}

#[test]
fn a_ray_that_passes_by_takes_a_planar_end_and_a_fixed_one_is_never_taken() {
    let mut world = world();
    let from_above = |world: &World, x: f64| state(world, [x, 1.5, 0.0], [x, 0.0, 0.0], false);
    for (x, highlight) in [
        (0.95, Highlight::Hovered),
        (0.98, Highlight::Hovered),
        (1.05, Highlight::Idle),
        (0.8, Highlight::Idle),
    ] {
        world.step(&from_above(&world, x).into());
        assert_eq!(world.frame.bodies[0].highlights[1], highlight, "x = {x}");
    }
    world.step(&from_above(&world, -0.95).into());
    assert_eq!(world.frame.bodies[0].highlights[0], Highlight::Idle);
}

#[test]
fn an_eye_behind_a_screen_has_no_view() {
    let mut world = world();
    assert!(world.view(1, Eye::Left).is_some());
    let behind = Isometry3::translation(0.0, 1.5, -0.5);
    world.step(&TrackerState { head: Some(behind), styli: vec![], time_s: 2.5 }.into());
    assert!(world.view(1, Eye::Left).is_none() && world.view(0, Eye::Left).is_some());
    let [(time_s, left), (_, right)] = world.warnings.as_slice() else { panic!("{:?}", world.warnings) };
    assert!(*time_s == 2.5 && left.starts_with("left eye: ") && right.starts_with("right eye: "), "{left}");
    let lost = Isometry3::translation(f32::NAN, 1.5, 1.0);
    world.step(&TrackerState { head: Some(lost), styli: vec![], time_s: 3.0 }.into());
    assert_eq!(world.room_from_head, behind.cast(), "a lost head stays where it was");
}

/// The state of `first`, through JSON, in a new world.
fn copied(first: &World) -> World {
    let text = serde_json::to_vec(&first.state().unwrap()).unwrap();
    let mut second = world();
    second.set_state(&serde_json::from_slice(&text).unwrap()).unwrap();
    second
}

/// Recordings stored fields alone, and refused to begin where something else was not at rest.
#[test]
fn a_world_in_the_state_of_another_goes_on_as_that_one_does() {
    let mut first = world();
    let carry = |world: &World, y: f64, pressed, time_s: f64| TrackerState {
        time_s,
        ..state(world, [1.5, y, 0.1], [0.0, y, 0.1], pressed)
    };
    let mut frame = 0;
    let mut go_on = |worlds: &mut [&mut World], y: f64, pressed: bool, action: Option<Action>| {
        frame += 1;
        let hashes = worlds.iter_mut().map(|world| {
            action.into_iter().for_each(|action| world.carry_out(action));
            let input = carry(world, y, pressed, 0.1 * f64::from(frame));
            world.step(&input.clone().into());
            (world.state_hash(), serde_json::to_string(&world.state().unwrap()).unwrap())
        });
        let hashes: Vec<_> = hashes.collect();
        assert!(hashes.iter().all(|hash| *hash == hashes[0]), "frame {frame}, {action:?}");
        hashes[0].0.clone()
    };
    let mut seen = Vec::new();
    for (y, pressed) in [(0.0, false), (0.0, true), (0.3, true), (0.3, false)] {
        seen.push(go_on(&mut [&mut first], y, pressed, None));
    }
    // In the hand, with something to undo, moved and scaled, on its way aside, with a ruler laid.
    for action in [Some(Action::ScaleScene(1.5)), Some(Action::Measure), Some(Action::SetAside(0)), None] {
        let mut second = copied(&first);
        for (y, pressed) in [(0.3, true), (0.35, true), (0.5, true), (0.5, false)] {
            seen.push(go_on(&mut [&mut first, &mut second], y, pressed, None));
        }
        seen.push(go_on(&mut [&mut first], 0.5, false, action));
    }
    for action in [Action::ResetNavigation, Action::Undo, Action::Redo, Action::SnapBack] {
        go_on(&mut [&mut first], 0.5, false, Some(action));
        let mut second = copied(&first);
        for _ in 0..6 {
            seen.push(go_on(&mut [&mut first, &mut second], 0.5, false, None));
        }
    }
    seen.dedup();
    assert!(seen.len() > 20, "{} different frames", seen.len());
}

#[test]
fn a_state_of_another_scene_is_refused() {
    let first = world();
    let refusal = |change: &dyn Fn(&mut State)| {
        let mut state = first.state().unwrap();
        change(&mut state);
        world().set_state(&state).unwrap_err()
    };
    assert_eq!(refusal(&|state| state.bodies.clear()), "it has 0 bodies, the scene has 1");
    assert!(refusal(&|state| state.styli = 99).contains("99 styli"));
    assert!(
        refusal(&|state| state.bodies[0].limiters.clear()).contains("body.block: it has 0 control elements")
    );
    assert!(refusal(&|state| state.edit.asides.clear()).contains("bodies that can be set aside"));
    assert!(refusal(&|state| drop(state.fields.pop())).contains("fields, this graph has"));
    assert!(refusal(&|state| state.bodies[0].deformer.poses.clear()).contains("body.block: "));
}

#[test]
fn keys_act_where_the_cursor_points_though_another_stylus_is_lost() {
    let mut world = world();
    let mut tracked = state(&world, [1.5, 0.0, 0.1], [0.0, 0.0, 0.1], false);
    assert_eq!(world.cursor(), None);
    let lost = StylusState { signal: Signal::Lost { age_s: 9.0 }, ..tracked.styli[0] };
    let mouse = StylusState { from_eye: true, ..tracked.styli[0] };
    tracked.styli = vec![lost, lost, mouse];
    world.step(&tracked.clone().into());
    assert_eq!(world.cursor(), Some(2));
    let key = crate::render::window::Key::Char('p');
    assert_eq!(crate::session::keys::action(key, false, &world), Some(Action::SetAside(0)));
    tracked.styli = vec![lost, StylusState { from_eye: false, ..mouse }, mouse];
    world.step(&tracked.clone().into());
    assert_eq!(world.cursor(), Some(2), "the one that aims from the eye");
    tracked.styli[2] = lost;
    world.step(&tracked.clone().into());
    assert_eq!(world.cursor(), Some(1), "else the first one that is seen");
}
