//! Effects of each command and each button on poses and places, on a block both ends of which can be taken.

use super::*;
use crate::effect::{self, EFFECTS};
use crate::interact::{Axis, Freedom};
use crate::prepare::Resolved;
use crate::render::Drawable;
use crate::stage::Stage;
use crate::track::{Signal, StylusState, TrackerState};
use crate::world::Highlight;
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;

mod snap;

/// A block of 2 m × 1 m × 1 m, which fills 0.95 of the workspace: x ±0.95, y and z ±0.475 of its radius.
fn world(effects: &str) -> World {
    let text = format!(
        r#"
[body.block]
generate = {{ block = {{ size = [2.0, 1.0, 1.0], cells = [4, 2, 2] }} }}
material = {{ young = 1.0e3, poisson = 0.3 }}
model = "rotation"
effects = [{effects}]
[body.block.control.left]
nodes = {{ group = "xmin" }}
grab = "dragger"
[body.block.control.right]
nodes = {{ group = "xmax" }}
grab = "dragger"
"#
    );
    let scene = Resolved::parse(&text, Path::new("scene.toml")).unwrap();
    let file = effect::file_of(&scene).unwrap();
    effect::world(EFFECTS, &scene, &file, Stage::find("workbench").unwrap()).unwrap()
}

const LEFT: usize = 0;
const RIGHT: usize = 1;

/// A stylus at workspace units `from`, pointing along `direction`, turned by the rotation vector `turn` about its tip.
fn stylus(from: [f64; 3], direction: [f64; 3], turn: [f64; 3]) -> StylusState {
    let workspace = Stage::find("workbench").unwrap().workspace;
    let place = workspace.centre + Vector3::from(from) * workspace.radius_m;
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn))
        * crate::stage::rotation_towards(&Vector3::from(direction), 0.0).unwrap();
    let room_from_stylus = Isometry3::from_parts(Translation3::from(place.coords), rotation).cast();
    StylusState { room_from_stylus, ..Default::default() }
}

/// A stylus beside the right end that points at it, moved by `by` and turned by `turn`.
fn right(by: [f64; 3], turn: [f64; 3]) -> StylusState {
    stylus([1.5 + by[0], by[1], 0.1 + by[2]], [-1.0, 0.0, 0.0], turn)
}

fn left(by: [f64; 3], turn: [f64; 3]) -> StylusState {
    stylus([-1.5 + by[0], by[1], 0.1 + by[2]], [1.0, 0.0, 0.0], turn)
}

fn pressed(stylus: StylusState) -> StylusState {
    StylusState { pressed: true, ..stylus }
}

fn step(world: &mut World, time_s: f64, styli: &[StylusState]) {
    world.step(&TrackerState { head: None, styli: styli.to_vec(), time_s }.into());
}

fn poses(world: &World) -> [ControlPose; 2] {
    [LEFT, RIGHT].map(|c| world.bodies[0].deformer.poses[c])
}

/// Takes the right end, carries and turns it, and lets go.
fn carry_right(world: &mut World, time_s: f64, by: [f64; 3], turn: [f64; 3]) {
    let start = right([0.0; 3], [0.0; 3]);
    step(world, time_s, &[start]);
    step(world, time_s, &[pressed(start)]);
    for share in [0.25, 0.5, 0.75, 1.0] {
        let part = |v: [f64; 3]| v.map(|x| x * share);
        let there = right(part(by), part(turn));
        step(world, time_s, &[pressed(there)]);
    }
    let there = right(by, turn);
    step(world, time_s, &[there]);
    let away = stylus([0.0, 3.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]);
    step(world, time_s, &[away]);
}

#[test]
fn what_the_tip_touches_wins_over_what_the_ray_hits() {
    let mut world = world("");
    // Just above the right end's edge, pointing through the block at the left end.
    let at_edge = stylus([0.95, 0.50, 0.0], [-1.9, -0.1, 0.0], [0.0; 3]);
    let highlights = |world: &World| [LEFT, RIGHT].map(|c| world.frame.bodies[0].highlights[c]);
    step(&mut world, 0.0, &[at_edge]);
    assert_eq!(highlights(&world), [Highlight::Idle, Highlight::Hovered]);
    step(&mut world, 0.0, &[StylusState { from_eye: true, ..at_edge }]);
    assert_eq!(highlights(&world), [Highlight::Hovered, Highlight::Idle], "an eye touches nothing");
    step(&mut world, 0.0, &[stylus([0.95, 0.55, 0.0], [-1.9, -0.2, 0.0], [0.0; 3])]);
    assert_eq!(highlights(&world), [Highlight::Hovered, Highlight::Idle], "out of reach");
    let away = stylus([0.98, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]);
    step(&mut world, 0.0, &[away]);
    step(&mut world, 0.0, &[pressed(away)]);
    let lifted = stylus([0.98, 0.19, 0.0], [1.0, 0.0, 0.0], [0.0; 3]);
    step(&mut world, 0.0, &[pressed(lifted)]);
    assert_eq!(highlights(&world), [Highlight::Idle, Highlight::Held]);
    let carried = poses(&world)[RIGHT].translation;
    assert!((carried - Vector3::y() * 0.2).norm() < 1e-6, "{carried}");
}

#[test]
fn two_hands_bend_a_body_symmetrically() {
    let mut world = world("");
    let hands = |way: f64, press: bool| {
        let both =
            [right([-way, way, 0.0], [0.0, 0.0, 2.0 * way]), left([way, way, 0.0], [0.0, 0.0, -2.0 * way])];
        both.map(|stylus| StylusState { pressed: press, ..stylus })
    };
    for (way, press) in [(0.0, false), (0.0, true), (0.1, true), (0.2, true)] {
        step(&mut world, 0.0, &hands(way, press));
    }
    let [left, right] = poses(&world);
    let mirror = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
    assert!((mirror * right.translation - left.translation).norm() < 1e-6, "{left:?} {right:?}");
    assert!((mirror * right.matrix * mirror - left.matrix).norm() < 1e-6);
    assert!(right.translation.norm() > 0.1 && right.matrix[(1, 0)] > 0.3);
    assert!(world.bodies[0].deformer.body_from_surface().rotation.angle() < 1e-6);
    assert!(world.frame.all(Drawable::stylus).all(|stylus| stylus.pressed && stylus.bend.is_none()));
}

#[test]
fn two_hands_on_one_end_stretch_it() {
    let mut world = world("");
    let at = |z: f64| stylus([1.5, 0.0, z], [-1.0, 0.0, 0.0], [0.0; 3]);
    let both = |half: f64| [pressed(at(-half)), pressed(at(half))];
    step(&mut world, 0.0, &[at(-0.2), at(0.2)]);
    step(&mut world, 0.0, &both(0.2));
    step(&mut world, 0.0, &both(0.3));
    let right = poses(&world)[RIGHT];
    assert!((right.matrix - Matrix3::identity() * 1.5).norm() < 1e-5, "{}", right.matrix);
    step(&mut world, 0.0, &[at(-0.3), pressed(at(0.3))]);
    let after = poses(&world)[RIGHT];
    assert!((after.matrix - right.matrix).norm() < 1e-9, "one hand goes on without a jump");
}

#[test]
fn in_a_mode_only_its_part_of_the_hands_way_counts_and_the_ray_bends() {
    let mut world = world("");
    let start = right([0.0; 3], [0.0; 3]);
    step(&mut world, 0.0, &[start]);
    step(&mut world, 0.0, &[pressed(start)]);
    world.carry_out(Action::SetMode(Mode { freedom: Freedom::Translate, axis: None }.along(Axis::Y)));
    let there = right([0.0, 0.19, 0.19], [0.3, 0.0, 0.0]);
    step(&mut world, 0.0, &[pressed(start)]);
    step(&mut world, 0.0, &[pressed(there)]);
    let along_y = poses(&world)[RIGHT];
    assert!((along_y.matrix - Matrix3::identity()).norm() < 1e-12);
    assert!((along_y.translation - Vector3::y() * along_y.translation.y).norm() < 1e-12);
    assert!((along_y.translation.y - 0.2).abs() < 1e-6, "{}", along_y.translation);
    assert!(
        world.frame.all(Drawable::stylus).next().unwrap().bend.is_some(),
        "the hand is not where the end is"
    );
    let held = world.frame.all(Drawable::stylus).next().unwrap().hit.unwrap();
    assert!(
        held.z
            < world.assets.stage.workspace.centre.z as f32
                + 0.12 * world.assets.stage.workspace.radius_m as f32
    );
    // The mode changes while it is held: no jump, then only turning, about the end's own origin.
    world.carry_out(Action::SetMode(Mode { freedom: Freedom::Rotate, axis: None }));
    step(&mut world, 0.0, &[pressed(there)]);
    let before = poses(&world)[RIGHT];
    assert!((before.translation - along_y.translation).norm() < 1e-9);
    let turned = right([0.3, 0.19, 0.19], [0.8, 0.0, 0.0]);
    step(&mut world, 0.0, &[pressed(turned)]);
    let after = poses(&world)[RIGHT];
    assert!((after.translation - before.translation).norm() < 1e-9);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * 0.5).to_rotation_matrix();
    assert!((after.matrix - turn.matrix()).norm() < 1e-6, "{}", after.matrix);
}

#[test]
fn undo_and_redo_bring_back_every_bit() {
    let mut world = world("");
    let rest = poses(&world);
    carry_right(&mut world, 0.0, [0.0, 0.2, 0.0], [0.0, 0.0, 0.7]);
    let first = poses(&world);
    // Back to where it is grabbed, and a turn beyond half a turn.
    world.carry_out(Action::Undo);
    carry_right(&mut world, 0.0, [0.1, 0.0, 0.0], [3.6, 0.0, 0.0]);
    let (twisted, shown) = (poses(&world), world.bodies[0].deformer.positions().into_owned());
    assert_ne!(first, rest);
    world.carry_out(Action::Undo);
    step(&mut world, 0.1, &[]);
    assert_eq!(poses(&world), rest);
    let left_over = |world: &World| {
        let body = &world.bodies[0].deformer;
        (0..body.node_count()).map(|i| body.displacement(i).norm()).fold(0.0, f64::max)
    };
    assert!(left_over(&world) < 1e-6, "no turn is left in it: {}", left_over(&world));
    world.carry_out(Action::Redo);
    step(&mut world, 0.2, &[]);
    assert_eq!(poses(&world), twisted);
    assert_eq!(*world.bodies[0].deformer.positions(), shown, "twisted the same way round");
    world.carry_out(Action::Redo);
    step(&mut world, 0.3, &[]);
    assert_eq!(poses(&world), twisted, "nothing more to do again");
    world.carry_out(Action::Undo);
    world.carry_out(Action::Undo);
    step(&mut world, 0.4, &[]);
    assert_eq!(poses(&world), rest);
}

#[test]
fn undo_while_holding_takes_back_the_hold() {
    let mut world = world("");
    let start = right([0.0; 3], [0.0; 3]);
    let there = right([0.0, 0.3, 0.0], [0.0; 3]);
    for state in [start, pressed(start), pressed(there)] {
        step(&mut world, 0.0, &[state]);
    }
    assert!(poses(&world)[RIGHT].translation.y > 0.2);
    world.carry_out(Action::Undo);
    for _ in 0..3 {
        step(&mut world, 0.0, &[pressed(there)]);
        assert_eq!(poses(&world)[RIGHT], ControlPose::REST);
    }
}

#[test]
fn navigation_moves_bodies_and_no_pose_and_picking_goes_along() {
    let mut world = world("");
    carry_right(&mut world, 0.0, [0.0, 0.1, 0.0], [0.0; 3]);
    let before = poses(&world);
    let home = world.bodies[0].room_from_body;
    world.carry_out(Action::ScaleScene(0.5));
    let away = |x: f64| stylus([x, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]);
    let second = |stylus| StylusState { second: true, ..stylus };
    step(&mut world, 0.1, &[away(0.0)]);
    step(&mut world, 0.2, &[second(away(0.0))]);
    step(&mut world, 0.3, &[second(away(0.4))]);
    step(&mut world, 0.4, &[away(0.4)]);
    let radius = world.assets.stage.workspace.radius_m;
    let place = world.bodies[0].room_from_body;
    assert!((place.scaling() / home.scaling() - 0.5).abs() < 1e-9);
    let way = place * Point3::origin() - home * Point3::origin();
    assert!((way - Vector3::x() * 0.4 * radius).norm() < 1e-6, "{way}");
    assert_eq!(poses(&world), before);
    // The right end stands at 0.4 + 0.95 / 2 of the radius now; a second hand holds it while the first navigates.
    let at_end = stylus([1.5, 0.0, 0.05], [-1.0, 0.0, 0.0], [0.0; 3]);
    step(&mut world, 0.5, &[away(0.0), at_end]);
    assert_eq!(world.frame.bodies[0].highlights[RIGHT], Highlight::Hovered);
    let hit = world.frame.all(Drawable::stylus).nth(1).unwrap().hit.unwrap().cast::<f64>()
        - world.assets.stage.workspace.centre;
    assert!((hit.x / radius - 0.875).abs() < 1e-5, "{hit}");
    step(&mut world, 0.6, &[second(away(0.0)), pressed(at_end)]);
    step(&mut world, 0.7, &[second(away(-0.3)), pressed(at_end)]);
    step(&mut world, 0.8, &[away(-0.3), pressed(at_end)]);
    for (now, before) in poses(&world).iter().zip(&before) {
        assert!(
            (now.translation - before.translation).norm() < 1e-6
                && (now.matrix - before.matrix).norm() < 1e-6
        );
    }
    assert!(
        world.frame.all(Drawable::stylus).nth(1).unwrap().bend.is_some(),
        "the held place went with the scene"
    );
    step(&mut world, 0.9, &[]);
    world.carry_out(Action::ResetNavigation);
    step(&mut world, 1.0, &[]);
    step(&mut world, 1.5, &[]);
    assert_eq!(world.bodies[0].room_from_body, home);
}

#[test]
fn the_second_button_scales_what_is_held_within_the_guards_limits() {
    let mut world = world("");
    let at =
        |x: f64, second| StylusState { second, ..pressed(stylus([x, 0.0, 0.1], [-1.0, 0.0, 0.0], [0.0; 3])) };
    step(&mut world, 0.0, &[right([0.0; 3], [0.0; 3])]);
    step(&mut world, 0.1, &[at(1.5, false)]);
    step(&mut world, 0.2, &[at(1.5, true)]);
    step(&mut world, 0.8, &[at(1.3, true)]);
    let scaled = poses(&world)[RIGHT];
    // A push by 0.2 of the radius towards the body.
    assert!((scaled.matrix - Matrix3::identity() * 0.2_f64.exp()).norm() < 1e-6, "{}", scaled.matrix);
    assert!(scaled.translation.norm() < 1e-12, "about its own origin");
    step(&mut world, 0.9, &[at(-8.5, true)]);
    let most = poses(&world)[RIGHT].matrix;
    assert!((most - Matrix3::identity() * crate::deform::STRETCH[1]).norm() < 1e-9, "{most}");
    step(&mut world, 1.0, &[at(11.5, true)]);
    let least = poses(&world)[RIGHT].matrix;
    assert!((least - Matrix3::identity() * crate::deform::STRETCH[0]).norm() < 1e-9, "{least}");
}

#[test]
fn a_body_goes_aside_by_a_double_press_and_comes_back() {
    let mut world = world("");
    let home = world.bodies[0].room_from_body;
    // At the middle of the block, which is no control element.
    let over = |second| StylusState { second, ..stylus([0.0, 2.0, 0.0], [0.0, -1.0, 0.0], [0.0; 3]) };
    for (time_s, second) in [(0.0, false), (0.1, true), (0.2, false), (0.3, true), (0.4, false), (1.0, false)]
    {
        step(&mut world, time_s, &[over(second)]);
    }
    assert!(world.edit.asides[0].is_aside);
    let aside = world.bodies[0].room_from_body;
    assert!(aside.scaling() < 0.3 * home.scaling());
    let (middle, radius) = world.bodies[0].assets.ball;
    let workspace = world.assets.stage.workspace;
    assert!(((aside * middle - workspace.centre).norm() - workspace.radius_m).abs() < 1e-9);
    assert!((aside.scaling() * radius - 0.2 * workspace.radius_m).abs() < 1e-9);
    assert_eq!(poses(&world), [ControlPose::REST; 2]);
    world.carry_out(Action::SetAside(0));
    step(&mut world, 1.1, &[]);
    step(&mut world, 1.6, &[]);
    assert_eq!(world.bodies[0].room_from_body, home);
    world.carry_out(Action::SetAside(7));
    assert_eq!(world.pointed_body(7), None);
}

#[test]
fn a_lost_stylus_leaves_the_element_where_it_is() {
    let mut world = world("");
    let there = right([0.0, 0.2, 0.0], [0.0; 3]);
    let start = right([0.0; 3], [0.0; 3]);
    for state in [start, pressed(start), pressed(there)] {
        step(&mut world, 0.0, &[state]);
    }
    let held = poses(&world)[RIGHT];
    step(&mut world, 0.1, &[StylusState { signal: Signal::Held { age_s: 0.4 }, ..pressed(there) }]);
    assert_eq!(world.frame.bodies[0].highlights[RIGHT], Highlight::Held);
    for _ in 0..3 {
        step(&mut world, 0.2, &[StylusState { signal: Signal::Lost { age_s: 3.0 }, ..pressed(start) }]);
        assert_eq!(poses(&world)[RIGHT], held);
        assert_eq!(world.frame.bodies[0].highlights[RIGHT], Highlight::Idle);
    }
}

#[test]
fn forces_are_told_only_of_bodies_whose_scene_wants_them() {
    for (effects, wanted) in [("", false), (r#""haptics""#, true)] {
        let mut world = world(effects);
        assert_eq!(world.frame.bodies[0].force_scale.is_some(), wanted);
        let start = right([0.0; 3], [0.0; 3]);
        let there = right([0.19, 0.0, 0.0], [0.0; 3]);
        step(&mut world, 0.0, &[start]);
        step(&mut world, 0.0, &[pressed(start)]);
        step(&mut world, 0.0, &[pressed(there)]);
        assert_eq!(
            (world.frame.forces.len(), world.frame.all(Drawable::arrow).count()),
            (usize::from(wanted), usize::from(wanted))
        );
        let Some(force) = world.frame.forces.first() else { continue };
        let (wrenches, _) = world.bodies[0].deformer.wrenches().unwrap();
        assert!((force.force_n + wrenches[RIGHT].force).norm() < 1e-9, "the body pulls back");
        // A bar of 1 m² and 2 m stretched by 0.2 m at 1 kPa: 100 N, more where its held ends cannot narrow.
        assert!(force.force_n.x < -95.0 && force.force_n.x > -130.0, "{}", force.force_n);
        let along = Vector3::from(world.frame.all(Drawable::arrow).next().unwrap().along).cast::<f64>();
        assert!(along.x < 0.0 && along.norm() <= 0.6 * world.assets.stage.workspace.radius_m + 1e-6);
        // It starts where the ray holds the bar, moved on with the hand.
        let (from, held) = (
            world.frame.all(Drawable::arrow).next().unwrap().from,
            world.frame.all(Drawable::stylus).next().unwrap().hit.unwrap(),
        );
        assert!((from - held).norm() < 1e-6, "{from} is not {held}");
        // Pushed in, the body pushes the hand out again, from the same place.
        step(&mut world, 0.0, &[pressed(right([-0.19, 0.0, 0.0], [0.0; 3]))]);
        let (from, held) = (
            world.frame.all(Drawable::arrow).next().unwrap().from,
            world.frame.all(Drawable::stylus).next().unwrap().hit.unwrap(),
        );
        assert!(
            (from - held).norm() < 1e-6 && world.frame.all(Drawable::arrow).next().unwrap().along.x > 0.0,
            "{from} is not {held}"
        );
        step(&mut world, 0.0, &[there]);
        assert_eq!(
            (world.frame.forces.len(), world.frame.all(Drawable::arrow).count()),
            (0, 0),
            "nothing held, nothing felt"
        );
    }
}

#[test]
fn the_hands_and_every_command_are_the_same_after_a_stream() {
    let mut world = world("");
    let start = right([0.0; 3], [0.0; 3]);
    world.carry_out(Action::SetMode(Mode::FREE.along(Axis::Z)));
    step(&mut world, 0.0, &[start, start]);
    step(&mut world, 0.1, &[pressed(start), StylusState { second: true, ..start }]);
    let grasp = world.graph.get(world.fields.hands);
    assert!(!grasp.asked.drags.is_empty() && !grasp.asked.navigating.is_empty());
    let text = serde_json::to_string(grasp).unwrap();
    assert_eq!(serde_json::from_str::<HandState>(&text).unwrap(), *grasp);
    for action in [
        Action::Undo,
        Action::SetMode(world.mode()),
        Action::SetAside(3),
        Action::ScaleScene(1.1),
        Action::ResetNavigation,
    ] {
        let text = serde_json::to_string(&action).unwrap();
        assert_eq!(serde_json::from_str::<Action>(&text).unwrap(), action, "{text}");
    }
}
