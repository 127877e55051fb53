//! Bodies that move by their inertia and touch tools and one another.

use super::running::Motion;
use super::tests::file;
use super::touch::Contact;
use crate::deform::ControlPose;
use crate::effect::{EFFECTS, Resolved, attach};
use crate::stage::Stage;
use crate::track::TrackerState;
use crate::world::World;
use crate::world::running::read;
use nalgebra::{Point3, Vector3};
use std::path::Path;

type V3 = Vector3<f64>;

const GRAVITY: f64 = 9.80665;
const FLOOR: &str = "[tool.floor]\nshape = \"floor\"\n";

/// A body of a scene.
struct Thing<'a> {
    name: &'a str,
    place: [f64; 3],
    size: [f64; 3],
    cells: [usize; 3],
    material: &'a str,
    element: &'a str,
    keys: &'a str,
}

impl Thing<'_> {
    fn text(&self) -> String {
        let Thing { name, place, size, cells, material, element, keys } = self;
        format!(
            "[body.{name}]\ngenerate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\nmaterial = {{ {material} }}\n\
             effects = [\"contact\", \"dynamics\"]\nplace = {{ position = {place:?}, scale = 1.0 }}\n{keys}\n\
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
        let file = file(&scene);
        let stage = Stage::find("desktop").unwrap();
        let mut world = World::new(&scene, &scene.models(), &file, stage).unwrap();
        let effects = attach(EFFECTS, &scene, &file, &mut world).unwrap();
        world.join(effects).unwrap();
        Scene { world, dt_s, frame: 0 }
    }

    fn step(&mut self) {
        let time_s = self.frame as f64 * self.dt_s;
        self.frame += 1;
        self.world.step(&TrackerState { head: None, styli: Vec::new(), time_s }.into());
    }

    fn contacts(&self) -> Vec<Contact> {
        let effect = self.world.effects.iter().find(|effect| effect.name() == "contact").unwrap();
        let motion: Motion = read(&effect.memory().unwrap()).unwrap();
        motion.contacts
    }

    fn force(&self) -> V3 {
        let turn =
            |contact: &Contact| self.world.bodies[contact.body].deformer.state.body_from_surface().rotation;
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

    fn pose(&self, b: usize) -> ControlPose {
        *self.world.graph.get(self.world.fields.bodies[b].poses[0])
    }
}

#[test]
fn exp_bounce() {
    for element in ["ymax", "ymin"] {
        for rate in [60.0, 120.0, 240.0, 960.0] {
            let keys = format!(
                "model = \"rotation\"\ngravity = true\neffect.dynamics = {{ free = [\"{element}\"], damping = 0.0 }}"
            );
            let thing = Thing {
                name: "block",
                place: [0.0, 0.1, 0.0],
                size: [0.1; 3],
                cells: [3; 3],
                material: "young = 2e5, poisson = 0.3, density = 1000.0",
                element,
                keys: &keys,
            };
            let mut scene = Scene::of(&(FLOOR.to_owned() + &thing.text()), 1.0 / rate);
            let (mut bounced, mut peak, mut most, mut longest) = (false, 0.0_f64, 0.0_f64, 0);
            for _ in 0..(0.27 * rate) as usize {
                scene.step();
                let force = scene.force().y;
                bounced |= force > 0.0;
                longest += usize::from(force > 0.0);
                most = most.max(force);
                if bounced {
                    peak = peak.max(scene.lowest(0));
                }
            }
            println!(
                "{element} {rate}: peak {peak:.5}, force {most:.1}, contact {:.4} s",
                longest as f64 / rate
            );
        }
    }
}

/// Saint-Venant: a rod that falls on its end touches for 2 L/c with A ρ c v, and comes back as fast.
#[test]
fn exp_rod() {
    for (cells, modes) in [(10, 40), (10, 100), (20, 100), (20, 200)] {
        for rate in [60.0, 600.0] {
            let keys = format!(
                "model = \"linear\"\ngravity = true\neffect.dynamics = {{ free = [\"ymax\"], damping = 0.0, modes = {modes} }}"
            );
            let thing = Thing {
                name: "rod",
                place: [0.0, 0.75, 0.0],
                size: [0.1, 1.0, 0.1],
                cells: [1, cells, 1],
                material: "young = 2e6, poisson = 0.0, density = 1000.0",
                element: "ymax",
                keys: &keys,
            };
            let mut scene = Scene::of(&(FLOOR.to_owned() + &thing.text()), 1.0 / rate);
            let (mut list, mut before, mut after) = (Vec::new(), 0.0_f64, 0.0_f64);
            let mut last = scene.pose(0).translation.y;
            for _ in 0..(0.42 * rate) as usize {
                scene.step();
                list.push(scene.force().y);
                let now = scene.pose(0).translation.y;
                let speed = (now - last) * rate;
                last = now;
                (before, after) = (before.min(speed), after.max(speed));
            }
            let touching: Vec<f64> = list.iter().copied().filter(|f| *f > 0.0).collect();
            println!(
                "{cells} {modes} {rate}: {:.4} s, speeds {before:.3} {after:.3}, impulse {:.3}, {:?}",
                touching.len() as f64 / rate,
                list.iter().sum::<f64>() / rate,
                touching
                    .iter()
                    .step_by(if rate > 100.0 { 3 } else { 1 })
                    .map(|f| f.round())
                    .collect::<Vec<_>>()
            );
        }
    }
}
