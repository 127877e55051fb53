//! Bodies that press, rub and strike each other and themselves.

use super::motion::Motion;
use super::tests::{YOUNG, graded, layer, medit, world};
use super::touch::Contact;
use crate::deform::ControlPose;
use crate::effect::{Resolved, file_of};
use crate::mesh::{self, Block};
use crate::track::{StylusState, TrackerState};
use crate::world::running::read;
use crate::world::{State, World};
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, SQRT_2};
use std::path::Path;

type V3 = Vector3<f64>;

/// Two bodies, "low" and "high", each with a control element "hand".
pub struct Two {
    pub world: World,
    pub frame: usize,
    pub warnings: Vec<String>,
}

impl Two {
    pub fn of(text: &str, path: &Path) -> Two {
        let scene = Resolved::parse(text, path).unwrap();
        Two { world: world(&scene, &file_of(&scene).unwrap()), frame: 0, warnings: Vec::new() }
    }

    /// Moves the hand of a body, by its number.
    pub fn hand(&mut self, b: usize, translation: V3) {
        let pose = self.world.fields.bodies[b].poses[0];
        let matrix = Matrix3::identity();
        self.world.graph.set(pose, ControlPose { translation, matrix }).unwrap();
    }

    pub fn step(&mut self) {
        self.frame += 1;
        let time_s = self.frame as f64 / 60.0;
        let frame = self.world.step(&TrackerState { head: None, styli: Vec::new(), time_s }.into());
        self.warnings.extend(frame.warnings.iter().cloned());
    }

    pub fn contacts(&self) -> Vec<Contact> {
        let motion: Motion = read(&self.world.effects[0].memory().unwrap()).unwrap();
        motion.contacts
    }

    /// Force on a body by all contacts, N; the axes of both are those of the room.
    fn force(&self, body: usize) -> V3 {
        let of = |contact: &Contact| if contact.body == body { contact.force } else { -contact.force };
        self.contacts().iter().map(of).sum()
    }

    /// Force of a body on its hand, N.
    pub fn on_hand(&self, b: usize) -> V3 {
        self.world.bodies[b].deformer.wrenches().unwrap().0[0].force
    }

    fn places(&self, b: usize) -> Vec<V3> {
        let motion = self.world.bodies[b].room_from_surface();
        let place = |x: &[f32; 3]| (motion * Point3::from(V3::from(x.map(f64::from)))).coords;
        self.world.bodies[b].deformer.positions().iter().map(place).collect()
    }
}

/// A block with this many cells about `place`, held at one side.
fn block(name: &str, place: [f64; 3], size: [f64; 3], cells: [usize; 3], held: &str, keys: &str) -> String {
    format!(
        "[body.{name}]\ngenerate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\n\
         material = {{ young = {YOUNG}, poisson = 0.0 }}\neffects = [\"contact\"]\n\
         place = {{ position = {place:?}, scale = 1.0 }}\n{keys}\n\
         control.hand = {{ nodes = {{ group = \"{held}\" }}, grab = \"fixed\" }}\n"
    )
}

/// Two blocks of different meshes, one on the other, are one column: E A d/(h₁ + h₂), pressed evenly.
#[test]
fn two_blocks_on_each_other_are_one_column() {
    let size = [0.3, 0.1, 0.3];
    for keys in ["effect.contact = { friction = 0.0 }", "model = \"rotation\""] {
        let low = block("low", [0.0, -0.05, 0.0], size, [5, 2, 5], "ymin", keys);
        let high = block("high", [0.0, 0.0505, 0.0], size, [6, 2, 6], "ymax", keys);
        let mut two = Two::of(&(low + &high), Path::new("two.toml"));
        two.step();
        assert!(two.contacts().is_empty());
        let depth = 1e-3;
        two.hand(1, -V3::y() * (depth + 5e-4));
        two.step();
        let expected = YOUNG * 0.09 * depth / 0.2;
        let (force, hand) = (two.force(1), two.on_hand(1));
        println!("{keys}: {force} N, expected {expected} N, {} contacts", two.contacts().len());
        assert!((force.y / expected - 1.0).abs() < 0.01, "{force}, column {expected} N");
        assert!((force + hand).norm() < 1e-6 * expected, "{force}, on the hand {hand}");
        assert!((force - two.on_hand(0)).norm() < 1e-6 * expected, "{force}, below {}", two.on_hand(0));
        for place in two.places(0).iter().filter(|x| x.y > -0.05) {
            assert!((place.y + depth / 2.0).abs() < 0.1 * depth, "the face is at {}", place.y);
        }
        two.hand(1, V3::zeros());
        two.step();
        assert!(two.contacts().is_empty());
    }
}

/// Two bodies of the mesh at `path`, "low" and "high", pressed onto each other by `depth`: the other one is turned over, and by `turn` about
/// the vertical.
pub fn two_layers(path: &Path, nu: f64, depth: f64, turn: f64) -> Two {
    let mesh = path.file_name().unwrap();
    let bottom = "plane = { point = [0.0, -1.0, 0.0], normal = [0.0, 1.0, 0.0], distance = 1e-6 }";
    let body = |name: &str, place: &str| {
        format!(
            "[body.{name}]\nmesh = {mesh:?}\nelement = \"tet10\"\nmaterial = {{ young = {YOUNG}, poisson = {nu} }}\n\
             effects = [\"contact\"]\neffect.contact = {{ friction = 0.0 }}\nplace = {{ scale = 1.0, {place} }}\n\
             control.hand = {{ nodes = {{ {bottom} }}, grab = \"fixed\" }}\n"
        )
    };
    let low = body("low", "position = [0.0, 0.0, 0.0]");
    // A half turn about an axis in the plane of contact turns it over, and by twice the axis' angle about the vertical.
    let axis = V3::new(PI * f64::cos(turn / 2.0), 0.0, PI * f64::sin(turn / 2.0));
    let high = format!("position = [0.0, {:?}, 0.0], rotation = [{:?}, 0.0, {:?}]", -depth, axis.x, axis.z);
    Two::of(&(low + &body("high", &high)), &path.with_extension("toml"))
}

/// Hertz: two equal balls, each a layer that is bonded to its base; nodes on nodes, and turned against each other.
#[test]
fn two_equal_balls_press_with_hertzs_force() {
    let (radius, depth, nu) = (1.0, 0.01, 0.3);
    let expected = layer(radius, depth / 2.0, 1.0, nu);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.mesh");
    for (cells, turn, most) in [([8, 5, 8], 0.0, 0.05), ([8, 5, 8], 0.7, 0.05), ([12, 8, 12], 0.7, 0.03)] {
        graded(cells, [1.0 / radius; 2], &path);
        let mut two = two_layers(&path, nu, depth, turn);
        two.step();
        let force = two.on_hand(0).y;
        println!(
            "{cells:?}, turned by {turn}: {force} N, Hertz {expected} N, {} contacts",
            two.contacts().len()
        );
        assert!((force / expected - 1.0).abs() < most, "{force} N, Hertz {expected} N");
    }
}

/// A block that is drawn aside on another one slides at the angle of their friction, the geometric mean of both.
#[test]
fn blocks_slide_on_each_other_at_the_angle_of_friction() {
    let size = [0.3, 0.1, 0.3];
    let keys = |friction: f64| format!("effect.contact = {{ friction = {friction:?} }}");
    let low = block("low", [0.0, -0.05, 0.0], [0.5, 0.1, 0.5], [5, 2, 5], "ymin", &keys(0.2));
    let high = block("high", [0.0, 0.0505, 0.0], size, [6, 2, 6], "ymax", &keys(0.8));
    let mut two = Two::of(&(low + &high), Path::new("two.toml"));
    let mut angles = Vec::new();
    for frame in 0..60 {
        two.hand(1, V3::new(2e-4 * f64::from(frame), -3e-3, 0.0));
        two.step();
        let force = two.force(1);
        assert!((force + two.on_hand(1)).norm() < 1e-6 * force.norm());
        angles.push((-force.x / force.y).atan().to_degrees());
    }
    let most = 0.4_f64.atan().to_degrees();
    println!("{angles:?}");
    assert!(angles[3] > 0.1 * most && angles[3] < 0.6 * most, "it sticks at first: {} of {most}°", angles[3]);
    assert!((angles[59] - most).abs() < 0.2, "{}°, friction {most}°", angles[59]);
}

/// A plate that is thrown at another one, 33 mm a frame, carries it along.
#[test]
fn a_thrown_plate_does_not_pass_another() {
    for keys in ["effect.contact = { friction = 0.1 }", "model = \"rotation\""] {
        let size = [0.3, 0.01, 0.3];
        let low = block("low", [0.0; 3], size, [8, 1, 8], "xmin", keys);
        let high = block("high", [0.0375, 0.07, 0.0], size, [8, 1, 8], "xmax", keys);
        let mut two = Two::of(&(low + &high), Path::new("two.toml"));
        let mut most = 0.0_f64;
        for frame in 0..6 {
            two.hand(1, -V3::y() * (2.0 / 60.0 * f64::from(frame)));
            two.step();
            let [low, high] = [two.places(0), two.places(1)];
            // Both plates have the same nodes: what was above one of the other's stays above it.
            let rest = |b: usize| two.world.bodies[b].deformer.rest().to_vec();
            for (x, at) in rest(0).iter().zip(&low) {
                for (z, other) in rest(1).iter().zip(&high) {
                    if (x[0] - z[0] - 0.0375).hypot(x[2] - z[2]) < 1e-6 && x[1] > 0.0 && z[1] < 0.0 {
                        most = most.max(at.y - other.y);
                    }
                }
            }
            println!(
                "{keys} frame {frame}: {} contacts, {} N, passed by {most} m",
                two.contacts().len(),
                two.force(1).y
            );
            assert!(frame < 3 || two.force(1).y > 0.0);
        }
        assert!(most < 1e-5, "a node is {most} m beyond the other plate");
    }
}

/// A clamp whose legs are pressed together touches itself as one leg touches a slab in its plane of symmetry.
#[test]
fn a_clamp_touches_itself_as_half_of_it_touches_a_slab() {
    let folder = tempfile::tempdir().unwrap();
    let pressed = |is_half: bool| {
        clamp(is_half, &folder.path().join("clamp.mesh"));
        let slab =
            "[tool.slab]\nshape = { box = { size = [0.2, 0.1, 0.2] } }\nposition = [0.14, -0.05, 0.0]\n";
        let leg = |name: &str, low: f64, high: f64| {
            let nodes = format!("box = {{ min = [0.049, {low:?}, -1.0], max = [0.071, {high:?}, 1.0] }}");
            format!("control.{name} = {{ nodes = {{ {nodes} }}, grab = \"fixed\" }}\n")
        };
        let bend = "plane = { point = [0.0, 0.0, 0.0], normal = [0.0, 1.0, 0.0], distance = 1e-6 }";
        let text = format!(
            "{}[body.clamp]\nmesh = \"clamp.mesh\"\nelement = \"tet10\"\n\
             material = {{ young = {YOUNG}, poisson = 0.3 }}\n\
             effects = [\"contact\"]\neffect.contact = {{ friction = 0.0, itself = true }}\n\
             place = {{ scale = 1.0, position = [0.0, 0.0, 0.0] }}\n\
             control.bend = {{ nodes = {{ {bend} }}, grab = \"fixed\" }}\n{}{}",
            if is_half { slab } else { "" },
            leg("high", 0.01, 0.05),
            if is_half { String::new() } else { leg("low", -0.05, -0.01) },
        );
        let mut clamp = Two::of(&text, &folder.path().join("clamp.toml"));
        let legs: &[(usize, f64)] = if is_half { &[(1, -1.0)] } else { &[(1, -1.0), (2, 1.0)] };
        let mut forces = Vec::new();
        for frame in 0..7 {
            for &(leg, sign) in legs {
                let way = sign * f64::from(frame);
                let mut matrix = Matrix3::identity();
                (matrix[(1, 0)], matrix[(0, 1)]) = (0.03 * way, -0.03 * way);
                let pose = clamp.world.fields.bodies[0].poses[leg];
                let translation = V3::y() * (0.003 * way);
                clamp.world.graph.set(pose, ControlPose { translation, matrix }).unwrap();
            }
            clamp.step();
            let of =
                |contact: &Contact| if is_half { contact.force.y.max(0.0) } else { contact.force.y.abs() };
            forces.push(clamp.contacts().iter().map(of).sum::<f64>());
            println!(
                "half {is_half}, {frame}: {} N, {} contacts",
                forces[frame as usize],
                clamp.contacts().len()
            );
        }
        forces
    };
    let [half, whole] = [true, false].map(pressed);
    assert!(half[6] > 0.0 && half[3] == 0.0);
    for (half, whole) in half.iter().zip(&whole) {
        assert!((whole - half).abs() <= 1e-3 * half, "{whole} N, half of it on a slab {half} N");
    }
}

/// Bars that lie across each other touch with their edges, far from every node: as two springs in a row, of whose bars each bends as a beam
/// that is held at both ends.
#[test]
fn bars_across_each_other_touch_with_their_edges() {
    let (length, side) = (1.0, 0.04);
    let bar = |name: &str, place: [f64; 3], rotation: [f64; 3]| {
        format!(
            "[body.{name}]\ngenerate = {{ block = {{ size = [{length:?}, {side:?}, {side:?}], cells = [9, 1, 1] }} }}\nelement = \"tet10\"\n\
             material = {{ young = {YOUNG}, poisson = 0.0 }}\neffects = [\"contact\"]\neffect.contact = {{ friction = 0.0 }}\n\
             place = {{ position = {place:?}, rotation = {rotation:?}, scale = 1.0 }}\n\
             control.hand = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.end = {{ nodes = {{ group = \"xmax\" }}, grab = \"fixed\" }}\n"
        )
    };
    // Each bar stands on an edge: turned by an eighth about its own axis, the upper one by a quarter about the vertical before.
    let eighth = UnitQuaternion::from_axis_angle(&V3::x_axis(), FRAC_PI_4);
    let quarter = UnitQuaternion::from_axis_angle(&V3::y_axis(), FRAC_PI_2);
    let rest = side * SQRT_2;
    let low = bar("low", [0.0; 3], eighth.scaled_axis().into());
    let high = bar("high", [0.0, rest + 0.002, 0.0], (quarter * eighth).scaled_axis().into());
    let mut two = Two::of(&(low + &high), Path::new("bars.toml"));
    two.step();
    assert!(two.contacts().is_empty());
    let mut forces = Vec::new();
    for step in 1..=4 {
        let depth = 0.005 * f64::from(step);
        for element in 0..2 {
            let pose = two.world.fields.bodies[1].poses[element];
            // The hand moves in the axes of its body.
            let translation = (quarter * eighth).inverse() * (-V3::y() * (depth + 0.002));
            two.world.graph.set(pose, ControlPose { translation, matrix: Matrix3::identity() }).unwrap();
        }
        two.step();
        let force =
            two.world.bodies[1].deformer.wrenches().unwrap().0.iter().map(|w| w.force).sum::<V3>().norm();
        forces.push(force / depth);
        println!("{depth} m: {force} N, {} contacts", two.contacts().len());
    }
    let inertia = side.powi(4) / 12.0;
    let shear = length / 4.0 / (5.0 / 6.0 * side * side * YOUNG / 2.0);
    let one = 1.0 / (length.powi(3) / (192.0 * YOUNG * inertia) + shear);
    println!("{forces:?} N/m, beams {} N/m", one / 2.0);
    assert!(forces.iter().all(|force| (force / (one / 2.0) - 1.0).abs() < 0.1), "{forces:?}");
}

/// The corner of a coarse cube presses a fine plate between its nodes, and passes into it by no more than the plate is rounded.
#[test]
fn the_corner_of_a_coarse_cube_does_not_pass_between_the_nodes_of_a_fine_plate() {
    let size = [0.3, 0.1, 0.3];
    let low =
        block("low", [0.01, -0.05, 0.006], size, [10, 3, 10], "ymin", "effect.contact = { friction = 0.0 }");
    let high = block("high", [0.0; 3], [0.2; 3], [2, 2, 2], "ymax", "effect.contact = { friction = 0.0 }");
    // On its corner: the diagonal of the cube is vertical.
    let along = UnitQuaternion::rotation_between(&V3::new(-1.0, -1.0, -1.0), &-V3::y()).unwrap();
    let height = 0.1 * 3.0_f64.sqrt();
    let turned = format!(
        "rotation = {:?}, position = [0.0, {:?}, 0.0]",
        <[f64; 3]>::from(along.scaled_axis()),
        height
    );
    let mut two =
        Two::of(&(low + &high.replace("position = [0.0, 0.0, 0.0]", &turned)), Path::new("corner.toml"));
    for step in 0..10 {
        two.hand(1, along.inverse() * (-V3::y() * (0.001 * f64::from(step))));
        two.step();
        let corner = two.places(1).into_iter().min_by(|a, b| a.y.total_cmp(&b.y)).unwrap();
        let from_axis = |x: &&V3| (x.x - corner.x).hypot(x.z - corner.z);
        let nearest = two.places(0).into_iter().filter(|x| x.y > -0.03);
        let mut nearest: Vec<V3> = nearest.collect();
        nearest.sort_by(|a, b| from_axis(&a).total_cmp(&from_axis(&b)));
        let surface = nearest[..3].iter().map(|x| x.y).fold(f64::INFINITY, f64::min);
        println!(
            "{step}: corner {corner:?}, {:?}, {} N, {} contacts",
            nearest[0],
            two.force(1).y,
            two.contacts().len()
        );
        assert!(
            corner.y > surface - 0.02 * 0.03 * SQRT_2 - 1e-5,
            "the corner at {corner:?}, the plate {nearest:?}"
        );
    }
    assert!(two.force(1).y > 0.0);
}

/// A state that is taken while bodies rub goes on bit by bit, from text too.
#[test]
fn a_state_in_the_middle_of_a_rub_goes_on_bit_by_bit() {
    let keys = "model = \"rotation\"\neffect.contact = { friction = 0.2, itself = true }";
    let low = block("low", [0.0, -0.05, 0.0], [0.3, 0.1, 0.3], [5, 2, 5], "ymin", keys);
    let high = block("high", [0.0, 0.0505, 0.0], [0.2, 0.1, 0.2], [4, 2, 4], "ymax", keys);
    let scene = Resolved::parse(&(low + &high), Path::new("two.toml")).unwrap();
    let file = file_of(&scene).unwrap();
    let [mut first, mut second] =
        [(); 2].map(|()| Two { world: world(&scene, &file), frame: 0, warnings: Vec::new() });
    let rub = |two: &mut Two, frame: i32| {
        two.hand(1, V3::new(1e-3 * f64::from(frame), -2e-4 * f64::from(frame), 0.0));
        two.step();
    };
    (0..20).for_each(|frame| rub(&mut first, frame));
    assert!(!first.contacts().is_empty());
    let text = serde_json::to_string(&first.world.state().unwrap()).unwrap();
    let state: State = serde_json::from_str(&text).unwrap();
    second.world.set_state(&state).unwrap();
    second.frame = first.frame;
    for frame in 20..40 {
        [&mut first, &mut second].into_iter().for_each(|two| rub(two, frame));
        assert_eq!(first.contacts(), second.contacts(), "frame {frame}");
        assert_eq!(first.world.state_hash(), second.world.state_hash(), "frame {frame}");
    }
}

/// A block that slides off another one presses nothing any more, whether it slides or jumps; a tool that flies about elsewhere changes nothing.
#[test]
fn what_slides_off_is_let_go() {
    let keys = "effect.contact = { friction = 0.3 }";
    let low = block("low", [0.0, -0.05, 0.0], [0.3, 0.1, 0.3], [5, 2, 5], "ymin", keys);
    let high = block("high", [0.0, 0.0505, 0.0], [0.2, 0.1, 0.2], [4, 2, 4], "ymax", keys);
    let tool = "[tool.probe]\nshape = { ball = { radius = 0.02 } }\nstylus = 1\n";
    for steps in [1, 7, 40] {
        let mut two = Two::of(&format!("{tool}{low}{high}"), Path::new("two.toml"));
        two.hand(1, -V3::y() * 2e-3);
        two.step();
        let force = two.force(1);
        assert!(two.contacts().len() > 8);
        for x in [2.0, -1.0, 3.0] {
            two.frame += 1;
            let room_from_stylus = Isometry3::translation(x, 2.0, 0.0).cast();
            let styli = vec![StylusState { room_from_stylus, ..Default::default() }];
            let time_s = two.frame as f64 / 60.0;
            two.world.step(&TrackerState { head: None, styli, time_s }.into());
            assert!((two.force(1) - force).norm() < 1e-3 * force.norm(), "{}, not {force}", two.force(1));
        }
        for step in 1..=steps {
            let share = f64::from(step) / f64::from(steps);
            two.hand(1, V3::new(0.4 * share, -2e-3, 0.0));
            two.step();
        }
        // What slid off in the last step is found in the next frame.
        two.step();
        assert!(two.contacts().is_empty(), "{steps} steps: {} contacts", two.contacts().len());
        assert_eq!(two.on_hand(0).norm(), 0.0);
    }
}

/// Two legs, 0.12 m long and 0.02 m thick, with a half ring between them, or the upper half of it.
fn clamp(is_half: bool, path: &Path) {
    let (middle, leg) = (0.03, 0.12);
    let arc = FRAC_PI_2 * middle;
    let parts = if is_half { 1.0 } else { 2.0 };
    let size = [parts * (leg + arc), 0.02, 0.02];
    let mesh = mesh::block(&Block { size, cells: [16 * parts as u32, 2, 2] }).unwrap();
    let place = |x: &V3| {
        let s = if is_half { x.x + size[0] / 2.0 } else { x.x };
        let radius = middle + x.y;
        match s.abs() > arc {
            true => [s.abs() - arc, s.signum() * radius, x.z],
            false => [-radius * (s / middle).cos(), radius * (s / middle).sin(), x.z],
        }
    };
    medit(&mesh, &place, path);
}
