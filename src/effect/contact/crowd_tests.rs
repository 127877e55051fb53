//! Hundreds of contacts with friction, in bodies of 10,000 nodes: whether their forces are found.

use super::motion::Motion;
use super::tests::world;
use crate::deform::ControlPose;
use crate::effect::{Resolved, file_of};
use crate::track::TrackerState;
use crate::world::World;
use crate::world::running::read;
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

type V3 = Vector3<f64>;

struct Crowd {
    world: World,
    frame: usize,
    /// Contacts of each frame.
    contacts: Vec<usize>,
    warnings: Vec<String>,
}

/// A slab about `y`, held at one side by its hand.
fn slab(name: &str, y: f64, size: [f64; 3], cells: [usize; 3], held: &str) -> String {
    format!(
        "[body.{name}]\ngenerate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\n\
         material = {{ young = 1e5, poisson = 0.4, density = 1000.0 }}\n\
         effects = [\"contact\"]\neffect.contact = {{ friction = 0.3 }}\n\
         place = {{ position = [0.0, {y:?}, 0.0], scale = 1.0 }}\n\
         control.hand = {{ nodes = {{ group = \"{held}\" }}, grab = \"fixed\" }}\n"
    )
}

impl Crowd {
    fn of(text: &str) -> Crowd {
        let scene = Resolved::parse(text, Path::new("crowd.toml")).unwrap();
        let world = world(&scene, &file_of(&scene).unwrap());
        Crowd { world, frame: 0, contacts: Vec::new(), warnings: Vec::new() }
    }

    fn step(&mut self, b: usize, translation: V3) {
        let pose = self.world.fields.bodies[b].poses[0];
        let matrix = Matrix3::identity();
        self.world.graph.set(pose, ControlPose { translation, matrix }).unwrap();
        self.frame += 1;
        let time_s = self.frame as f64 / 60.0;
        let frame = self.world.step(&TrackerState { head: None, styli: Vec::new(), time_s }.into());
        self.warnings.extend(frame.warnings.iter().cloned());
        let motion: Motion = read(&self.world.effects[0].memory().unwrap()).unwrap();
        self.contacts.push(motion.contacts.len());
    }

    /// Presses the hand of a body in, draws it aside, and lifts it.
    fn press_and_rub(&mut self, name: &str, b: usize, down: f64, aside: f64) {
        (0..=10).for_each(|frame| self.step(b, -V3::y() * down * f64::from(frame) / 10.0));
        for frame in 1..=30 {
            let share = f64::from(frame) / 30.0;
            self.step(b, V3::new(aside * share, -down, 0.3 * aside * share * share));
        }
        for frame in 1..=5 {
            self.step(b, V3::new(aside, down * (f64::from(frame) / 5.0 - 1.0), 0.3 * aside));
        }
        let most = self.contacts.iter().copied().max().unwrap_or(0);
        println!("{name}: {most} contacts");
        assert_eq!(self.warnings, Vec::<String>::new());
        assert!(most > 80 && self.contacts[45] == 0, "{most} contacts, {} after lifting", self.contacts[45]);
    }
}

#[test]
#[ignore = "takes minutes"]
fn hundreds_of_contacts_are_found() {
    let low = slab("low", -0.03, [0.3, 0.06, 0.3], [30, 9, 30], "ymin");
    for k in [10, 14] {
        let side = 0.01 * (f64::from(k) - 0.5);
        let tool = format!(
            "[tool.plate]\nshape = {{ box = {{ size = [{side:?}, 0.02, {side:?}] }} }}\nposition = [0.005, 0.0105, 0.005]\n"
        );
        Crowd::of(&(tool + &low)).press_and_rub(&format!("plate of {k} cells"), 0, -2e-3, 4e-3);
    }
    for radius in [0.3, 0.8] {
        let y = radius + 5e-4;
        let tool = format!(
            "[tool.ball]\nshape = {{ ball = {{ radius = {radius:?} }} }}\nposition = [0.0, {y:?}, 0.0]\n"
        );
        Crowd::of(&(tool + &low)).press_and_rub(&format!("ball of {radius} m"), 0, -6e-3, 4e-3);
    }
    for k in [10, 14, 17, 22] {
        let layers = 9600 / ((k + 1) * (k + 1)) - 1;
        let low = slab("low", -0.05, [0.2, 0.1, 0.2], [k - 2, layers / 2, k - 2], "ymin");
        let high = slab("high", 0.0505, [0.19, 0.1, 0.19], [k, layers, k], "ymax");
        Crowd::of(&(low + &high)).press_and_rub(&format!("blocks of {k} cells"), 1, 4e-3, 6e-3);
    }
}
