//! Blocks and bars that tools press, rub and strike.

use super::ENTRY;
use super::motion::Motion;
use crate::deform::{ControlPose, Deformer};
use crate::effect::{self, Resolved, file_of};
use crate::green::GreenFile;
use crate::mesh::{Block, TetMesh, block};
use crate::stage::Stage;
use crate::track::{StylusState, TrackerState};
use crate::world::running::read;
use crate::world::{State, World};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;
use std::sync::Arc;

type V3 = Vector3<f64>;

pub const YOUNG: f64 = 1.0e5;

/// A world with one body, and a tool in the hand.
pub struct Touched {
    pub world: World,
    pub frame: usize,
}

/// A block about the origin, held at one side, and a tool of this shape.
struct Setting<'a> {
    size: [f64; 3],
    cells: [usize; 3],
    held: &'a str,
    poisson: f64,
    tool: &'a str,
    keys: &'a str,
}

impl Setting<'_> {
    fn scene(&self) -> Resolved {
        let Setting { size, cells, held, poisson, tool, keys } = self;
        let text = format!(
            "[tool.probe]\n{tool}\n\
             [body.b]\n\
             generate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\n\
             material = {{ young = {YOUNG}, poisson = {poisson} }}\n\
             effects = [\"contact\"]\n\
             surface_compliance = {{ nodes = \"surface\", kept = \"factor\" }}\n\
             place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\n{keys}\n\
             control.base = {{ nodes = {{ group = \"{held}\" }}, grab = \"fixed\" }}\n"
        );
        Resolved::parse(&text, Path::new("contact.toml")).unwrap()
    }

    fn touched(&self) -> Touched {
        let scene = self.scene();
        let file = file_of(&scene).unwrap();
        Touched { world: world(&scene, &file), frame: 0 }
    }
}

pub fn world(scene: &Resolved, file: &Arc<GreenFile>) -> World {
    effect::world(&[ENTRY], scene, file, Stage::find("desktop").unwrap()).unwrap()
}

pub fn at(place: V3) -> Isometry3<f64> {
    Translation3::from(place).into()
}

/// A floor that faces down.
fn ceiling(place: V3) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_scaled_axis(V3::x() * PI))
}

impl Touched {
    pub fn put(&mut self, room_from_stylus: Isometry3<f64>) {
        self.track(StylusState { room_from_stylus: room_from_stylus.cast(), ..Default::default() });
    }

    fn track(&mut self, stylus: StylusState) {
        self.frame += 1;
        let time_s = self.frame as f64 / 60.0;
        self.world.step(&TrackerState { head: None, styli: vec![stylus], time_s }.into());
    }

    fn motion(&self) -> Motion {
        read(&self.world.effects[0].memory().unwrap()).unwrap()
    }

    /// Force on the tool, N. The body's axes are those of the room.
    pub fn force(&self) -> V3 {
        -self.motion().contacts.iter().map(|contact| contact.force).sum::<V3>()
    }

    pub fn contacts(&self) -> usize {
        self.motion().contacts.len()
    }

    pub fn body(&self) -> &Deformer {
        &self.world.bodies[0].deformer
    }

    /// Places of the surface's nodes in the room, as they are shown.
    fn places(&self) -> Vec<V3> {
        let motion = self.world.bodies[0].room_from_surface();
        let place = |x: &[f32; 3]| (motion * Point3::from(V3::from(x.map(f64::from)))).coords;
        self.body().positions().iter().map(place).collect()
    }
}

/// A bar whose end a small ball presses down bends like a cantilever, and pushes back as the model's own forces say.
#[test]
fn a_pressed_cantilever_bends_as_in_theory() {
    let [length, side, radius] = [1.0, 0.1, 0.02];
    let setting = Setting {
        size: [length, side, side],
        cells: [20, 2, 2],
        held: "xmin",
        poisson: 0.0,
        tool: "shape = { ball = { radius = 0.02 } }\nstylus = 1",
        keys: "element = \"tet10\"\neffect.contact = { friction = 0.0 }",
    };
    let mut bar = setting.touched();
    let top = side / 2.0 + radius;
    bar.put(at(V3::new(length / 2.0, top + 0.01, 0.0)));
    assert_eq!(bar.contacts(), 0);
    let depth = 0.01;
    bar.put(at(V3::new(length / 2.0, top - depth, 0.0)));
    let force = bar.force();
    // Timoshenko's deflection: bending, and shear with the coefficient 5/6.
    let area = side * side;
    let inertia = side.powi(4) / 12.0;
    let shear = length / (5.0 / 6.0 * area * YOUNG / 2.0);
    let expected = depth / (length.powi(3) / (3.0 * YOUNG * inertia) + shear);
    println!("{} N, theory {expected} N, {} contacts", force.y, bar.contacts());
    assert!((force.y / expected - 1.0).abs() < 0.02, "{force}, theory {expected} N");
    let (wrenches, _) = bar.body().wrenches().unwrap();
    // The base holds the bar against the tool.
    assert!((wrenches[0].force - force).norm() < 1e-6 * force.norm(), "{}, {force}", wrenches[0].force);
    let deepest =
        bar.places().into_iter().map(|x| (x - V3::new(length / 2.0, top - depth, 0.0)).norm() - radius);
    let deepest = deepest.fold(f64::INFINITY, f64::min);
    assert!(deepest > -1e-6, "a node is {deepest:e} m inside the ball");
    bar.put(at(V3::new(length / 2.0, top + 0.01, 0.0)));
    assert_eq!((bar.contacts(), bar.force()), (0, V3::zeros()));
    let rest = bar.body().rest().to_vec();
    assert_eq!(bar.body().positions()[..], rest[..]);
}

/// Indentation of a layer that is bonded to its base by a ball (E. Dimitriadis and others, Determination of elastic moduli of thin layers of
/// soft material using the atomic force microscope, Biophysical Journal 82, 2002, 2798-2810, equation 12): Hertz's force times a
/// series in √(R δ)/h.
pub fn layer(radius: f64, depth: f64, thickness: f64, nu: f64) -> f64 {
    let hertz = 4.0 / 3.0 * YOUNG / (1.0 - nu * nu) * radius.sqrt() * depth.powf(1.5);
    let alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    let chi = (radius * depth).sqrt() / thickness;
    hertz
        * (1.0 - 2.0 * alpha / PI * chi + 4.0 * alpha.powi(2) / PI.powi(2) * chi.powi(2)
            - 8.0 / PI.powi(3) * (alpha.powi(3) + 4.0 * PI.powi(2) / 15.0 * beta) * chi.powi(3)
            + 16.0 * alpha / PI.powi(4) * (alpha.powi(3) + 3.0 * PI.powi(2) / 5.0 * beta) * chi.powi(4))
}

/// A block of half side 1 m whose cells shrink towards the middle of its top, which near there falls off by (x²/R₁ + z²/R₂)/2 with `round`
/// = \[1/R₁, 1/R₂\], as a file in which the bottom is told by its place.
pub fn graded(cells: [u32; 3], round: [f64; 2], path: &Path) {
    let mesh = block(&Block { size: [2.0, 1.0, 2.0], cells }).unwrap();
    let finer = |t: f64| t.signum() * t.abs().powf(2.5);
    let place = |x: &V3| {
        let [x, y, z] = [finer(x.x), -finer(0.5 - x.y), finer(x.z)];
        let fall = round[0] * x * x + round[1] * z * z;
        [x, y - (1.0 + y) * 0.06 * (1.0 - (-fall / 0.12).exp()), z]
    };
    medit(&mesh, &place, path);
}

/// Writes a mesh whose nodes are put elsewhere.
pub fn medit(mesh: &TetMesh, place: &dyn Fn(&V3) -> [f64; 3], path: &Path) {
    let mut text = String::from("MeshVersionFormatted 2\nDimension 3\nVertices\n");
    text += &format!("{}\n", mesh.nodes.len());
    for [x, y, z] in mesh.nodes.iter().map(place) {
        text += &format!("{x:?} {y:?} {z:?} 0\n");
    }
    text += &format!("Tetrahedra\n{}\n", mesh.tets.len());
    for [a, b, c, d] in mesh.tets.iter().map(|tet| [tet[0], tet[1], tet[2], tet[3]].map(|node| node + 1)) {
        text += &format!("{a} {b} {c} {d} 0\n");
    }
    std::fs::write(path, text + "End\n").unwrap();
}

/// A tool of this shape above the body in "block.mesh", which is held at y = -1 and smooth.
pub fn on_layer(shape: &str, nu: f64, folder: &Path) -> Touched {
    let bottom = "plane = { point = [0.0, -1.0, 0.0], normal = [0.0, 1.0, 0.0], distance = 1e-6 }";
    let text = format!(
        "[tool.probe]\nshape = {shape}\nstylus = 1\n\
         [body.b]\nmesh = \"block.mesh\"\nelement = \"tet10\"\n\
         material = {{ young = {YOUNG}, poisson = {nu} }}\n\
         effects = [\"contact\"]\neffect.contact = {{ friction = 0.0 }}\n\
         surface_compliance = {{ nodes = \"surface\", kept = \"factor\" }}\n\
         place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\n\
         control.base = {{ nodes = {{ {bottom} }}, grab = \"fixed\" }}\n"
    );
    let scene = Resolved::parse(&text, &folder.join("layer.toml")).unwrap();
    Touched { world: world(&scene, &file_of(&scene).unwrap()), frame: 0 }
}

/// Hertz: a ball presses a block that is ten times as deep as the contact is wide; the theory of a bonded layer of that depth corrects
/// his force by 9 %.
#[test]
fn a_ball_presses_with_hertzs_force() {
    let (radius, depth, nu) = (1.0, 0.01, 0.3);
    let expected = layer(radius, depth, 1.0, nu);
    let folder = tempfile::tempdir().unwrap();
    let mut off = Vec::new();
    for cells in [[8, 5, 8], [12, 8, 12]] {
        graded(cells, [0.0; 2], &folder.path().join("block.mesh"));
        let mut touched = on_layer(&format!("{{ ball = {{ radius = {radius} }} }}"), nu, folder.path());
        touched.put(at(V3::new(0.0, radius - depth, 0.0)));
        let (force, contacts) = (touched.force().y, touched.contacts());
        off.push(force / expected - 1.0);
        println!("{cells:?}: {force} N, theory {expected} N, {contacts} contacts");
    }
    assert!(off[1].abs() < 0.05 && off[1].abs() < off[0].abs(), "{off:?}");
}

/// A plate that is pressed onto a block and drawn aside sticks, then slides with the force of friction: the angle of the force is that of an
/// incline on which the block begins to slide.
#[test]
fn a_plate_slides_off_a_block_at_the_angle_of_friction() {
    let mu = 0.35_f64;
    let setting = Setting {
        size: [0.3, 0.1, 0.3],
        cells: [6, 3, 6],
        held: "ymin",
        poisson: 0.3,
        tool: "shape = \"floor\"\nstylus = 1",
        keys: &format!("effect.contact = {{ friction = {mu} }}"),
    };
    let mut block = setting.touched();
    let mut angles = Vec::new();
    for step in 0..60 {
        block.put(ceiling(V3::new(2e-4 * f64::from(step), 0.05 - 0.002, 0.0)));
        let force = block.force();
        angles.push((-force.x / force.y).atan().to_degrees());
    }
    let (most, last) = (mu.atan().to_degrees(), angles[59]);
    println!("{angles:?}");
    assert!(angles[3] > 0.2 * most && angles[3] < 0.5 * most, "it sticks at first: {} of {most}°", angles[3]);
    assert!(angles.windows(2).all(|pair| pair[1] > pair[0] - 1e-6), "{angles:?}");
    assert!((last - most).abs() < 0.5, "{last}°, friction {most}°");
}

/// Nothing drifts at rest, and a tracker that says nothing usable changes nothing. A hand that trembles leaves a trace of less than a
/// thousandth without friction; with it the edge of the contact slips, and friction relaxes, ever more slowly: by 6.4 %, then by 3.1 %,
/// however closely the forces are sought.
#[test]
fn contact_at_rest_stays_as_it_is() {
    for friction in [0.0, 0.3] {
        let setting = Setting {
            size: [0.3, 0.1, 0.3],
            cells: [6, 3, 6],
            held: "ymin",
            poisson: 0.3,
            tool: "shape = { ball = { radius = 0.08 } }\nstylus = 1",
            keys: &format!("effect.contact = {{ friction = {friction:?} }}"),
        };
        let mut block = setting.touched();
        let place = |x: f64| at(V3::new(x, 0.05 + 0.08 - 0.01, 0.01));
        block.put(at(V3::new(0.0, 0.2, 0.01)));
        block.put(place(0.0));
        let (force, positions) = (block.force(), block.body().positions().to_vec());
        for _ in 0..1000 {
            block.put(place(0.0));
        }
        assert_eq!((block.force(), block.body().positions().to_vec()), (force, positions));
        let trembled = |block: &mut Touched| {
            for step in 0..1500 {
                block.put(place(1e-5 * f64::from(step).sin()));
            }
            block.put(place(0.0));
            block.force()
        };
        let [first, second] = [(); 2].map(|()| trembled(&mut block));
        let [all, more] =
            [(first - force).norm(), (second - first).norm()].map(|change| change / force.norm());
        println!("friction {friction}: {force}, changed by {all:e} and then by {more:e}");
        let [most, then] = if friction == 0.0 { [1e-3; 2] } else { [0.07, 0.6 * all] };
        assert!(all < most && more < then, "changed by {all:e} and then by {more:e}");
        let before = block.force();
        let nothing =
            Isometry3::from_parts(Translation3::new(f32::NAN, 0.0, 0.0), UnitQuaternion::identity());
        block.track(StylusState { room_from_stylus: nothing, ..Default::default() });
        assert_eq!(block.force(), before);
    }
}

/// A ball that flies through a thin plate at 2 m/s carries it along, and does not come out behind it.
#[test]
fn a_fast_ball_does_not_pass_a_thin_plate() {
    for keys in ["", "model = \"rotation\""] {
        let setting = Setting {
            size: [0.3, 0.01, 0.3],
            cells: [8, 1, 8],
            held: "xmin",
            poisson: 0.3,
            tool: "shape = { ball = { radius = 0.006 } }\nstylus = 1",
            keys,
        };
        let mut plate = setting.touched();
        for frame in 0..6 {
            let y = 0.05 - 2.0 / 60.0 * f64::from(frame);
            let centre = V3::new(0.06, y, 0.013);
            plate.put(at(centre));
            // The plate's nodes near the ball lie below it.
            let places = plate.places();
            let near = |x: &&V3| (x.x - centre.x).hypot(x.z - centre.z) < 0.03;
            let highest = places.iter().filter(near).map(|x| x.y).fold(f64::NEG_INFINITY, f64::max);
            println!("{keys} frame {frame}: ball at {y}, plate to {highest}, {} contacts", plate.contacts());
            assert!(y > 0.01 || (plate.contacts() > 0 && plate.force().y > 0.0), "frame {frame}");
            let deepest = places.iter().map(|x| (x - centre).norm()).fold(f64::INFINITY, f64::min);
            assert!(deepest > 0.006 - 1e-6, "frame {frame}: a node is {deepest} m from the ball's centre");
        }
    }
}

/// A tool that begins inside a body moves freely until it has come out, and then touches it.
#[test]
fn a_tool_inside_at_the_start_is_told() {
    let setting = Setting {
        size: [0.3, 0.3, 0.3],
        cells: [3, 3, 3],
        held: "ymin",
        poisson: 0.3,
        tool: "shape = { ball = { radius = 0.09 } }\nstylus = 1",
        keys: "",
    };
    let mut block = setting.touched();
    block.put(at(V3::new(0.05, 0.08, 0.05)));
    let warned = |block: &Touched, words: &str| {
        block.world.warnings.iter().any(|(_, warning)| warning.contains(words))
    };
    assert!(warned(&block, "it is inside body.b") && block.contacts() == 0, "{:?}", block.world.warnings);
    block.put(at(V3::new(0.05, 0.25, 0.05)));
    block.put(at(V3::new(0.05, 0.23, 0.05)));
    assert!(block.contacts() > 0 && block.force().y > 0.0);
}

/// Two plates squeeze a block to half its height.
#[test]
fn a_block_is_squeezed_between_two_plates() {
    let setting = Setting {
        size: [0.3, 0.2, 0.3],
        cells: [6, 4, 6],
        held: "xmin",
        poisson: 0.3,
        tool: "shape = \"floor\"\nstylus = 1\n[tool.table]\nshape = \"floor\"\nposition = [0.0, -0.1, 0.0]",
        keys: "",
    };
    let mut block = setting.touched();
    let mut last = 0.0;
    for step in 0..=50 {
        let y = 0.1 - 0.002 * f64::from(step);
        block.put(ceiling(V3::new(0.0, y, 0.0)));
        let motion = block.motion();
        let pushed: f64 = motion
            .contacts
            .iter()
            .filter(|contact| contact.tool() == Some(0))
            .map(|contact| -contact.force.y)
            .sum();
        assert!(pushed.is_finite() && pushed >= last, "{pushed} N at {y}, {last} N before");
        last = pushed;
        let held = |x: &V3| x.x < -0.149;
        for x in block.places().iter().filter(|x| !held(x)) {
            assert!(x.y < y + 1e-5 && x.y > -0.1 - 1e-5, "a node at {} m, plates at {y} and -0.1", x.y);
        }
    }
    println!("{last} N, {} contacts", block.contacts());
}

/// A tool on a spring gives way as springs in a row do.
#[test]
fn a_tool_on_a_spring_yields_with_the_body() {
    let of = |keys: &str| {
        let setting = Setting {
            size: [0.3, 0.1, 0.3],
            cells: [4, 2, 4],
            held: "ymin",
            poisson: 0.3,
            tool: &format!("shape = \"floor\"\nstylus = 1{keys}"),
            keys: "effect.contact = { friction = 0.0 }",
        };
        let mut block = setting.touched();
        [0.06, 0.05 - 1e-3].into_iter().for_each(|y| block.put(ceiling(V3::new(0.0, y, 0.0))));
        block.force().y
    };
    let (stiff, soft) = (of(""), of("\nstiffness = 5e4"));
    let in_a_row = 1e-3 / (1e-3 / stiff + 1.0 / 5e4);
    println!("{stiff} N, by a spring {soft} N");
    assert!((soft / in_a_row - 1.0).abs() < 1e-5, "{soft} N, in a row {in_a_row} N");
}

/// A state that is taken while a tool presses and rubs goes on bit by bit, from text too.
#[test]
fn a_state_in_the_middle_of_a_contact_goes_on_bit_by_bit() {
    for keys in ["", "model = \"rotation\""] {
        let setting = Setting {
            size: [0.3, 0.1, 0.3],
            cells: [6, 3, 6],
            held: "ymin",
            poisson: 0.3,
            tool: "shape = { capsule = { radius = 0.02, length = 0.2 } }\nstylus = 1\nstiffness = 500.0",
            keys,
        };
        let scene = setting.scene();
        let file = file_of(&scene).unwrap();
        let [mut first, mut second] = [(); 2].map(|()| Touched { world: world(&scene, &file), frame: 0 });
        let place = |step: i32| {
            let turn = UnitQuaternion::from_scaled_axis(V3::new(-1.2, 0.0, 0.1 * f64::from(step)));
            let place = V3::new(0.004 * f64::from(step), 0.08 - 0.002 * f64::from(step), 0.0);
            Isometry3::from_parts(place.into(), turn)
        };
        (0..20).for_each(|step| first.put(place(step)));
        assert!(first.contacts() > 0);
        let text = serde_json::to_string(&first.world.state().unwrap()).unwrap();
        let state: State = serde_json::from_str(&text).unwrap();
        second.world.set_state(&state).unwrap();
        second.frame = first.frame;
        for step in 20..40 {
            [&mut first, &mut second].into_iter().for_each(|touched| touched.put(place(step)));
            assert_eq!(first.motion(), second.motion(), "step {step}");
            assert_eq!(first.world.state_hash(), second.world.state_hash(), "step {step}");
        }
    }
}

/// A block that its hand presses onto a table is pressed as by a table that comes to it, also where the hand has turned it by a
/// quarter first.
#[test]
fn a_body_that_is_moved_onto_a_table_is_pressed_like_one_that_the_table_comes_to() {
    let press = |keys: &str, tool: &str, pose: Option<ControlPose>, table: Isometry3<f64>| {
        let setting = Setting {
            size: [0.3, 0.1, 0.3],
            cells: [4, 2, 4],
            held: "ymax",
            poisson: 0.3,
            tool: &format!("shape = \"floor\"\n{tool}"),
            keys: &format!("effect.contact = {{ friction = 0.0 }}\n{keys}"),
        };
        let mut block = setting.touched();
        if let Some(pose) = pose {
            let base = block.world.fields.bodies[0].poses[0];
            block.world.graph.set(base, pose).unwrap();
        }
        block.put(table);
        (block.force().norm(), block.contacts())
    };
    let depth = 1e-3;
    let at_rest = at(V3::new(0.0, -0.05, 0.0));
    let (expected, contacts) = press("", "stylus = 1", None, at(V3::new(0.0, depth - 0.05, 0.0)));
    assert!(expected > 1.0 && contacts == 25, "{expected} N, {contacts} contacts");
    let down = |turn: f64, shift: V3| ControlPose {
        translation: shift,
        matrix: *Rotation3::from_axis_angle(&V3::z_axis(), turn).matrix(),
    };
    // The base lies 0.05 m above the origin, and turns about its middle; the table has come along.
    let quarter = UnitQuaternion::from_axis_angle(&V3::z_axis(), FRAC_PI_2);
    let middle = V3::new(0.0, 0.05, 0.0);
    let turned = Isometry3::from_parts((middle - quarter * (middle * 2.0)).into(), quarter);
    for (keys, pose, table) in [
        ("", down(0.0, V3::y() * -depth), at_rest),
        ("model = \"rotation\"", down(0.0, V3::y() * -depth), at_rest),
        ("model = \"rotation\"", down(FRAC_PI_2, V3::x() * depth), turned),
    ] {
        let (force, found) = press(keys, "stylus = 1", Some(pose), table);
        assert!(
            (force / expected - 1.0).abs() < 1e-4 && found == contacts,
            "{keys}: {force} N, not {expected}; {found} contacts"
        );
    }
}
