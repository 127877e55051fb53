//! Bodies that move by their inertia and touch tools and one another.

use super::motion::Motion;
use super::touch::Contact;
use crate::effect::{self, EFFECTS, Resolved, file_of};
use crate::stage::Stage;
use crate::track::{StylusState, TrackerState};
use crate::world::running::read;
use crate::world::{State, World};
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;

type V3 = Vector3<f64>;

const GRAVITY: f64 = 9.80665;
const FLOOR: &str = "[tool.floor]\nshape = \"floor\"\n";

/// A body of a scene.
struct Thing<'a> {
    name: &'a str,
    place: [f64; 3],
    turn: [f64; 3],
    size: [f64; 3],
    cells: [usize; 3],
    material: &'a str,
    element: &'a str,
    keys: &'a str,
}

impl Thing<'_> {
    fn text(&self) -> String {
        let Thing { name, place, turn, size, cells, material, element, keys } = self;
        format!(
            "[body.{name}]\ngenerate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\nmaterial = {{ {material} }}\n\
             effects = [\"contact\", \"dynamics\"]\nplace = {{ position = {place:?}, rotation = {turn:?}, scale = 1.0 }}\n{keys}\n\
             control.{element} = {{ nodes = {{ group = \"{element}\" }}, grab = \"fixed\" }}\n"
        )
    }
}

struct Scene {
    world: World,
    dt_s: f64,
    frame: usize,
}

impl Scene {
    fn of(text: &str, dt_s: f64) -> Scene {
        let scene = Resolved::parse(text, Path::new("inertia.toml")).unwrap();
        let file = file_of(&scene).unwrap();
        let stage = Stage::find("desktop").unwrap();
        let world = effect::world(EFFECTS, &scene, &file, stage).unwrap();
        Scene { world, dt_s, frame: 0 }
    }

    fn step(&mut self) {
        self.step_with(Vec::new());
    }

    fn step_with(&mut self, styli: Vec<StylusState>) {
        let time_s = self.frame as f64 * self.dt_s;
        self.frame += 1;
        self.world.step(&TrackerState { head: None, styli, time_s }.into());
    }

    fn contacts(&self) -> Vec<Contact> {
        let effect = self.world.effects.iter().find(|effect| effect.name() == "contact").unwrap();
        let motion: Motion = read(&effect.memory().unwrap()).unwrap();
        motion.contacts
    }

    fn force(&self) -> V3 {
        let turn = |contact: &Contact| self.world.bodies[contact.body].room_from_surface().isometry.rotation;
        self.contacts().iter().map(|contact| turn(contact) * contact.force).sum()
    }

    fn places(&self, b: usize) -> Vec<V3> {
        let motion = self.world.bodies[b].room_from_surface();
        let place = |x: &[f32; 3]| (motion * Point3::from(V3::from(x.map(f64::from)))).coords;
        self.world.bodies[b].deformer.positions().iter().map(place).collect()
    }

    fn lowest(&self, b: usize) -> f64 {
        self.places(b).iter().map(|x| x.y).fold(f64::INFINITY, f64::min)
    }
}

/// A cube of 1 kg that nothing holds, with `keys`.
fn cube<'a>(name: &'a str, place: [f64; 3], element: &'a str, keys: &'a str) -> Thing<'a> {
    let material = "young = 2e5, poisson = 0.3, density = 1000.0";
    Thing { name, place, turn: [0.0; 3], size: [0.1; 3], cells: [3; 3], material, element, keys }
}

fn free(element: &str, damping: f64) -> String {
    format!(
        "model = \"rotation\"\ngravity = true\neffect.dynamics = {{ free = [\"{element}\"], damping = {damping:?} }}\n"
    )
}

/// Whatever it falls on, its control element too, it never comes higher than it was, rests in the end, and presses with its weight.
#[test]
fn a_cube_that_falls_comes_to_rest_on_the_floor() {
    for (element, turn, damping) in [("ymax", 0.0, 0.01), ("ymin", 0.0, 0.05), ("xmin", 0.5, 0.05)] {
        let keys = free(element, damping);
        let turned = [turn, 0.4 * turn, 0.8 * turn];
        let cube = Thing { turn: turned, ..cube("cube", [0.0, 0.2, 0.0], element, &keys) };
        let mut scene = Scene::of(&(FLOOR.to_owned() + &cube.text()), 1.0 / 60.0);
        let (mut peaks, mut deepest, mut forces) = ([0.0_f64; 4], 0.0_f64, Vec::new());
        for frame in 0..240 {
            scene.step();
            let lowest = scene.lowest(0);
            let part = &mut peaks[frame / 60];
            (*part, deepest) = (part.max(lowest), deepest.min(lowest));
            forces.push(scene.force());
        }
        let mean = forces[200..].iter().sum::<V3>() / 40.0;
        println!("{element} {turn}: up to {peaks:?} m, down to {deepest:e} m, pressing with {mean:?}");
        assert!(peaks[1] < peaks[0] && peaks[2] < peaks[1].max(1e-4), "{peaks:?}");
        assert!(peaks[3] < 1e-3 && deepest > -4e-5, "{peaks:?} {deepest:e}");
        assert!((mean - V3::y() * GRAVITY).norm() < 0.0034 * GRAVITY, "{mean}");
    }
}

/// Saint-Venant: a rod that falls on its end touches the floor for 2 L/c, the way of a wave to its other end and back, and flies off as
/// fast as it came.
#[test]
fn a_rod_that_falls_on_its_end_touches_for_two_passages_of_its_wave() {
    let keys = "model = \"linear\"\ngravity = true\neffect.dynamics = { free = [\"ymax\"], damping = 0.0, modes = 60 }";
    let (length, wave) = (1.0, (2e6_f64 / 1000.0).sqrt());
    let rod = Thing {
        name: "rod",
        place: [0.0, 0.75, 0.0],
        turn: [0.0; 3],
        size: [0.1, length, 0.1],
        cells: [1, 16, 1],
        material: "young = 2e6, poisson = 0.0, density = 1000.0",
        element: "ymax",
        keys,
    };
    let dt_s = 1.0 / 480.0;
    let mut scene = Scene::of(&(FLOOR.to_owned() + &rod.text()), dt_s);
    let mut touching = Vec::new();
    let mut heights = Vec::new();
    for frame in 0..200 {
        scene.step();
        let places = scene.places(0);
        // Of layers of nodes, the outermost count half.
        let rest = scene.world.bodies[0].deformer.rest();
        let weight = |x: &[f32; 3]| if f64::from(x[1].abs()) > 0.49 * length { 0.5 } else { 1.0 };
        let (sum, all) = rest
            .iter()
            .zip(&places)
            .fold((0.0, 0.0), |(sum, all), (x, place)| (sum + weight(x) * place.y, all + weight(x)));
        heights.push(sum / all);
        if scene.force().y > 0.0 {
            touching.push(frame);
        }
    }
    let [first, last] = [touching[0], touching[touching.len() - 1]];
    let speed = |frame: usize| (heights[frame + 5] - heights[frame - 5]) / (10.0 * dt_s);
    let [before, after] = [speed(first - 8), speed(last + 8)];
    let time_s = (last - first + 1) as f64 * dt_s;
    println!("{time_s} s, 2 L/c = {} s; {before} m/s, then {after} m/s", 2.0 * length / wave);
    assert!((time_s / (2.0 * length / wave) - 1.0).abs() < 0.08, "{time_s} s");
    assert!((after / before + 1.0).abs() < 0.05, "{before} m/s, then {after} m/s");
}

/// On an incline a block slides with g (sin φ - μ cos φ), and does not where tan φ < μ.
#[test]
fn a_block_slides_down_an_incline_as_fast_as_friction_lets_it() {
    let angle = 0.4_f64;
    for friction in [0.3_f64, 0.41, 0.44] {
        let up = V3::new(-angle.sin(), angle.cos(), 0.0);
        let keys = free("ymax", 0.05) + &format!("effect.contact = {{ friction = {friction:?} }}");
        let block = Thing {
            turn: [0.0, 0.0, angle],
            size: [0.2, 0.04, 0.2],
            cells: [4, 2, 4],
            material: "young = 1e6, poisson = 0.3, density = 1000.0",
            ..cube("block", (up * 0.02).into(), "ymax", &keys)
        };
        let floor = format!("{FLOOR}rotation = [0.0, 0.0, {angle:?}]\n");
        let mut scene = Scene::of(&(floor + &block.text()), 1.0 / 60.0);
        let along = V3::new(angle.cos(), angle.sin(), 0.0);
        let way: Vec<f64> = (0..90)
            .map(|_| {
                scene.step();
                let places = scene.places(0);
                places.iter().map(|x| x.dot(&along)).sum::<f64>() / places.len() as f64
            })
            .collect();
        // The second half, in which it rests on the floor.
        let found = -(way[89] - 2.0 * way[64] + way[39]) / (25.0_f64 / 60.0).powi(2);
        let expected = (GRAVITY * (angle.sin() - friction * angle.cos())).max(0.0);
        println!("friction {friction}: {found} m/s², expected {expected} m/s²; way {}", way[89] - way[0]);
        assert!((found - expected).abs() < 9e-8, "{found} {expected}");
    }
}

/// A cube on a cube on the floor: the upper one presses with its weight, the lower one with both.
#[test]
fn a_cube_lies_on_another() {
    let keys = ["ymax", "xmin"].map(|element| free(element, 0.05));
    let low = cube("low", [0.0, 0.051, 0.0], "ymax", &keys[0]);
    let high = cube("high", [0.01, 0.16, 0.005], "xmin", &keys[1]);
    let mut scene = Scene::of(&(FLOOR.to_owned() + &low.text() + &high.text()), 1.0 / 60.0);
    let (mut on_floor, mut between) = (0.0, 0.0);
    for frame in 0..180 {
        scene.step();
        if frame >= 150 {
            for contact in scene.contacts() {
                let turn = scene.world.bodies[contact.body].room_from_surface().isometry.rotation;
                let up = (turn * contact.force).y / 30.0;
                match contact.other() {
                    None => on_floor += up,
                    Some(_) => between += up.abs(),
                }
            }
        }
    }
    println!("on the floor {on_floor} N, between {between} N");
    assert!((on_floor / (2.0 * GRAVITY) - 1.0).abs() < 0.02, "{on_floor}");
    assert!((between / GRAVITY - 1.0).abs() < 0.02, "{between}");
}

/// Two cubes lie on the floor, one on the other, for an hour: nothing creeps, nothing comes to life.
/// `cargo test --release --lib -- --ignored cubes_lie_for_an_hour --nocapture`
#[test]
#[ignore = "minutes: 216,000 frames"]
fn cubes_lie_for_an_hour() {
    let keys = ["ymax", "xmin"].map(|element| free(element, 0.05));
    let low = cube("low", [0.0, 0.051, 0.0], "ymax", &keys[0]);
    let high = cube("high", [0.01, 0.16, 0.005], "xmin", &keys[1]);
    let mut scene = Scene::of(&(FLOOR.to_owned() + &low.text() + &high.text()), 1.0 / 60.0);
    let mut lain = Vec::new();
    for second in 1..=3600 {
        (0..60).for_each(|_| scene.step());
        let places = [scene.places(0), scene.places(1)].concat();
        if second <= 60 {
            lain.clone_from(&places);
        }
        assert_eq!(places, lain, "after {second} s");
    }
}

/// A cube on the floor comes to rest to the last bit; what touches it then moves it again, and it comes to rest anew.
#[test]
fn a_cube_rests_until_something_touches_it() {
    let keys = free("ymax", 0.05);
    let tool = "[tool.ball]\nshape = { ball = { radius = 0.02 } }\nstylus = 1\n";
    let text = format!("{FLOOR}{tool}{}", cube("cube", [0.0, 0.051, 0.0], "ymax", &keys).text());
    let mut scene = Scene::of(&text, 1.0 / 60.0);
    // The ball goes to x in so many frames, and stays there for as many.
    let (mut at, lie) = (-0.1, |from: f64, to: f64, frames: usize, scene: &mut Scene| {
        for frame in 0..2 * frames {
            let x = from + (to - from) * (frame as f64 / frames as f64).min(1.0);
            let tip = Isometry3::translation(x as f32, 0.04, 0.0);
            scene.step_with(vec![StylusState { room_from_stylus: tip, ..StylusState::default() }]);
        }
        scene.places(0)
    });
    let mut go = |to: f64, frames: usize| lie(std::mem::replace(&mut at, to), to, frames, &mut scene);
    let resting = go(-0.1, 90);
    assert_eq!(go(-0.1, 15), resting);
    // 5 mm into its side.
    let pushed = go(-0.065, 60);
    let middle = |places: &[V3]| places.iter().sum::<V3>().x / places.len() as f64;
    let way = middle(&pushed) - middle(&resting);
    println!("pushed by {way} m");
    assert!((way - 0.005).abs() < 1e-3);
    let again = go(-0.1, 90);
    assert_eq!(go(-0.1, 15), again);
}

/// A bar that is pressed for a while is pressed as without inertia.
#[test]
fn a_body_that_has_come_to_rest_is_pressed_as_without_inertia() {
    let text = |effects: &str| {
        format!(
            "[tool.ball]\nshape = {{ ball = {{ radius = 0.03 }} }}\nposition = [0.0, 0.075, 0.0]\n\
             [body.bar]\ngenerate = {{ block = {{ size = [0.3, 0.1, 0.1], cells = [9, 3, 3] }} }}\n\
             material = {{ young = 2e5, poisson = 0.3, density = 1000.0 }}\nmodel = \"rotation\"\neffects = {effects}\n\
             place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\neffect.contact = {{ friction = 0.0 }}\n\
             control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"fixed\" }}\n"
        )
    };
    let mut at_rest = Scene::of(&text("[\"contact\"]"), 1.0 / 60.0);
    let mut living =
        Scene::of(&text("[\"contact\", \"dynamics\"]\neffect.dynamics.damping = 0.2"), 1.0 / 60.0);
    at_rest.step();
    let expected = at_rest.force();
    for _ in 0..120 {
        living.step();
    }
    let found = living.force();
    println!("{found:?} N, at rest {expected:?} N");
    assert!(
        expected.norm() > 1.0 && (found - expected).norm() < 1e-3 * expected.norm(),
        "{found} {expected}"
    );
    let shapes = [&at_rest, &living].map(|scene| scene.places(0));
    let off = shapes[0].iter().zip(&shapes[1]).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(off < 1e-5, "{off:e}");
}

#[test]
fn a_state_in_the_middle_of_a_bounce_goes_on_bit_by_bit() {
    let keys = free("xmin", 0.01);
    let cube = Thing { turn: [0.5, 0.2, 0.4], ..cube("cube", [0.0, 0.12, 0.0], "xmin", &keys) };
    let text = FLOOR.to_owned() + &cube.text();
    let mut first = Scene::of(&text, 1.0 / 60.0);
    let mut second = Scene::of(&text, 1.0 / 60.0);
    let mut touched = 0;
    while first.contacts().is_empty() {
        first.step();
        touched += 1;
        assert!(touched < 60, "it does not reach the floor");
    }
    let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
    let state: State = serde_json::from_str(&state).unwrap();
    second.world.set_state(&state).unwrap();
    second.frame = first.frame;
    for _ in 0..20 {
        first.step();
        second.step();
        assert_eq!(second.world.state_hash(), first.world.state_hash());
    }
}

/// A cube that begins with its control element inside the floor comes out of it slowly, and does not leave it.
#[test]
fn what_begins_inside_the_floor_comes_out_slowly() {
    let keys = free("ymin", 0.05);
    let cube = cube("cube", [0.0, 0.045, 0.0], "ymin", &keys);
    let mut scene = Scene::of(&(FLOOR.to_owned() + &cube.text()), 1.0 / 60.0);
    let mut lowest: Vec<f64> = Vec::new();
    for _ in 0..120 {
        scene.step();
        lowest.push(scene.lowest(0));
    }
    let fastest = lowest.windows(2).map(|pair| (pair[1] - pair[0]) * 60.0).fold(0.0, f64::max);
    println!("from {} to {} m, at {fastest} m/s at most", lowest[0], lowest[119]);
    assert!(lowest[0] < -4e-3 && lowest[119].abs() < 1e-4, "{} {}", lowest[0], lowest[119]);
    assert!(fastest < 0.08 && lowest.iter().all(|y| *y < 2e-3), "{fastest} m/s");
}
