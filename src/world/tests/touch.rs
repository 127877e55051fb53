//! Points of a surface in the hand, and loads that are set.

use super::*;
use crate::effect;
use crate::interact::SurfaceGrip;

const LOADED: &str = "[body.b]\n\
    generate = { block = { size = [2.0, 1.0, 1.0], cells = [4, 2, 2] } }\n\
    material = { young = 1e5, poisson = 0.3, density = 1000 }\n\
    model = \"rotation\"\n\
    gravity = true\n\
    surface_compliance = { nodes = \"surface\", take = \"place\" }\n\
    load.press = { nodes = { group = \"ymax\" }, kind = \"pressure\" }\n\
    [body.b.control]\n\
    low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
    high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

fn loaded() -> World {
    let scene = Resolved::parse(LOADED, Path::new("scene.toml")).unwrap();
    let file = effect::file_of(&scene).unwrap();
    World::new(&scene, &scene.models(), &file, Stage::find("workbench").unwrap()).unwrap()
}

/// A ray from above onto the place (x, y, 0) of the block, shifted by `up` of the block's metres.
fn above(world: &World, x: f64, up: f64, pressed: bool) -> TrackerState {
    let room = world.bodies[0].assets.home;
    let (from, to) = (room * Point3::new(x, 2.0 + up, 0.1), room * Point3::new(x, up, 0.1));
    let rotation = rotation_towards(&(to - from), 0.0).unwrap();
    let room_from_stylus = Isometry3::from_parts(Translation3::from(from.coords), rotation).cast();
    let stylus = StylusState { room_from_stylus, pressed, ..Default::default() };
    TrackerState { head: None, styli: vec![stylus], time_s: 0.0 }
}

fn positions(world: &World) -> Vec<[f32; 3]> {
    world.bodies[0].deformer.positions().into_owned()
}

#[test]
fn a_held_point_follows_the_hand_and_goes_back() {
    let mut world = loaded();
    world.step(&above(&world, 0.3, 0.0, false).into());
    let before = positions(&world);
    world.step(&above(&world, 0.3, 0.0, true).into());
    let scale = world.bodies[0].room_from_body.scaling();
    for up in [0.05, 0.2, -0.1] {
        world.step(&above(&world, 0.3, up, true).into());
        let (touch, place) = world.touched(0).unwrap();
        let off = (place - touch.place_in_room).norm();
        assert!(off < 1e-6 * scale, "{off} m");
        assert!(
            world.frame.all(Drawable::plate).count() == 1 && world.frame.all(Drawable::ball).count() == 1
        );
    }
    assert_eq!(world.frame.all(Drawable::arrow).count(), 1, "the body pulls the hand");
    let pulled = positions(&world);
    assert_ne!(pulled, before);
    world.step(&above(&world, 0.3, 0.0, false).into());
    assert!(world.touched(0).is_none() && world.frame.all(Drawable::plate).next().is_none());
    let back = positions(&world);
    let off = back.as_flattened().iter().zip(before.as_flattened()).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f32::max) < 1e-6);
}

/// A recording may be damaged: a touch of a body or node that is not there is refused.
#[test]
fn a_touch_of_what_is_not_there_is_refused() {
    let mut world = loaded();
    world.carry_out(Action::SetTaking(SurfaceGrip::Force));
    world.step(&above(&world, 0.0, 0.0, false).into());
    world.step(&above(&world, 0.0, 0.0, true).into());
    let touch = *world.touched(0).unwrap().0;
    let state = serde_json::to_string(&world.state().unwrap()).unwrap();
    let known = serde_json::to_string(&touch).unwrap();
    assert_eq!(state.matches(&known).count(), 2, "of this frame and the one before: {state}");
    let (mut of_no_body, mut at_no_node) = (touch, touch);
    of_no_body.body = 9;
    at_no_node.nodes[2] = 99_999;
    for damaged in [of_no_body, at_no_node] {
        let text = state.replace(&known, &serde_json::to_string(&damaged).unwrap());
        let refused = loaded().set_state(&serde_json::from_str(&text).unwrap());
        assert_eq!(refused, Err("it touches a surface that is not there".to_owned()));
    }
    // The body's loads have the point too.
    let nodes = format!("{:?}", touch.nodes).replace(' ', "");
    let text =
        state.replace(&format!("\"points\":[{{\"nodes\":{nodes}"), "\"points\":[{\"nodes\":[0,1,99999]");
    assert_ne!(text, state);
    let refused = loaded().set_state(&serde_json::from_str(&text).unwrap()).unwrap_err();
    assert!(refused.contains("belongs to another body"), "{refused}");
    assert_eq!(loaded().set_state(&serde_json::from_str(&state).unwrap()), Ok(()));
}

/// A spring as stiff as the point itself brings it half way; a control element is taken before the surface behind it.
#[test]
fn a_spring_pulls_half_way_and_keys_change_what_is_taken() {
    let mut world = loaded();
    world.carry_out(Action::SetTaking(SurfaceGrip::Force));
    world.step(&above(&world, 0.0, 0.0, false).into());
    world.step(&above(&world, 0.0, 0.0, true).into());
    let scale = world.bodies[0].room_from_body.scaling();
    let start = world.touched(0).unwrap().1;
    world.step(&above(&world, 0.0, 0.2, true).into());
    let moved = (world.touched(0).unwrap().1 - start).norm() / scale;
    assert!((0.06..0.14).contains(&moved), "{moved} m of 0.2 m");
    world.carry_out(Action::LetGo);
    world.step(&above(&world, 0.0, 0.2, false).into());
    world.carry_out(Action::SetTaking(SurfaceGrip::Elements));
    world.step(&above(&world, 0.0, 0.0, true).into());
    assert!(world.touched(0).is_none());
}

#[test]
fn a_load_is_set_by_its_name_and_taken_back_by_a_reset() {
    let mut world = loaded();
    world.step(&above(&world, 0.0, 1.0, false).into());
    let before = positions(&world);
    let (body, column) = world.load_named("b.press").unwrap();
    assert_eq!((body, column, world.load_named("press")), (0, 3, Some((0, 3))));
    assert_eq!(world.load_named("pull"), None);
    world.carry_out(Action::SetLoad { body, column, value: 3000.0 });
    world.carry_out(Action::SetLoad { body: 9, column: 9, value: 1.0 });
    world.step(&above(&world, 0.0, 1.0, false).into());
    assert_ne!(positions(&world), before);
    world.reset();
    assert_eq!((world.load(0, 3), positions(&world)), (Some(0.0), before));
}

/// A block of rubber a metre high hangs aside under its weight, though no control element is turned.
#[test]
fn what_loads_bend_counts_as_bent() {
    let mut world = loaded();
    let turn = |world: &World| TurnLimits::of_body(&world.bodies[0]).0.to_degrees();
    world.step(&above(&world, 0.0, 1.0, false).into());
    let by_weight = turn(&world);
    let (body, column) = world.load_named("b.press").unwrap();
    world.carry_out(Action::SetLoad { body, column, value: 30_000.0 });
    world.step(&above(&world, 0.0, 1.0, false).into());
    let pressed = turn(&world);
    assert!(by_weight > 1.0 && pressed > 2.0 * by_weight, "{by_weight}° {pressed}°");
}

/// Gravity stays downward in the room: a body that is turned by half a turn about its length sags the other way in its own frame.
#[test]
fn gravity_stays_in_the_room() {
    let mut world = loaded();
    world.step(&above(&world, 0.0, 1.0, false).into());
    let c = world.bodies[0].deformer.state.coefficients.clone();
    let gravity = &c[24..27];
    let weight: f64 = gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    assert!((weight - 9.80665).abs() < 1e-9 && c.len() == 28, "{c:?}");
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
    let turned = world.bodies[0].room_from_body * turn;
    world.bodies[0].room_from_body = turned;
    world.put(world.fields.bodies[0].place, super::super::flow::BodyPlace(turned));
    world.evaluate();
    let now = &world.bodies[0].deformer.state.coefficients[24..27];
    assert!((gravity[1] + now[1]).abs() < 1e-9, "{gravity:?} {now:?}");
}

/// A feature that a scene does not list is in no field, tensor or frame.
#[test]
fn a_scene_without_loads_has_nothing_of_them() {
    let world = world();
    let body = &world.bodies[0];
    assert!(world.fields.touch.is_none() && world.taking().is_none() && world.taking_words().is_empty());
    assert!(world.fields.bodies[0].loads.is_none() && body.assets.takes_forces.is_empty());
    assert!(body.deformer.load_metas().is_empty() && !body.deformer.has_field());
    assert_eq!(body.deformer.state.coefficients.len(), 24);
    let names: Vec<&str> = world.graph.entries().iter().map(|field| field.name).collect();
    assert!(names.iter().all(|name| !name.contains("load") && !name.contains("touch")), "{names:?}");
}
