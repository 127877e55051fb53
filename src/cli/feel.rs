//! The force loops of a session: one for each device of the stage, if a body lists an effect that gives forces.
//!
//! Before a frame a device moves its stylus; after it the loop is told what that stylus holds. Where no body asks for it,
//! or the stage has no device, there is no [`Feel`], no thread and no call in the frame.

use super::failure::Failure;
use super::world::World;
use crate::effect::find_effect;
use crate::effect::haptics::{
    Control, Device, Elastic, Felt, Hand, Haply, Held, Loop, Simulated, VrpnDevice,
};
use crate::green::GreenFile;
use crate::interact::Mode;
use crate::report::table::seconds;
use crate::scene::Scene;
use crate::stage::{Haptic, HapticDevice, Stage};
use crate::track::{Signal, StylusState, TrackerState, usable};
use nalgebra::{Isometry3, Matrix4};

pub struct Feel {
    links: Vec<Link>,
}

/// One device and its loop.
struct Link {
    haptic: Haptic,
    running: Loop,
    /// Number of its stylus.
    stylus: usize,
    /// Numbers in the world of the bodies that it can feel.
    bodies: Vec<usize>,
    hold: Option<Hold>,
    grips: u64,
    /// Where the tracker, or the mouse, has the hand of a simulated device.
    room_from_hand: Option<Isometry3<f64>>,
    /// When the device was last seen, s, and how.
    seen: Option<(f64, Isometry3<f64>, [bool; 2])>,
    warned: bool,
}

#[derive(Clone, Copy, PartialEq)]
struct Hold {
    place: (usize, usize),
    handle_from_element: Matrix4<f64>,
}

/// A device that is gone for so long lets go of what it holds, s. Its force is gone long before.
const LOST_S: f64 = 2.0;
/// A hold whose matrix is off by more than this since it began is another one.
const SAME_HOLD: f64 = 1e-3;

/// A frame of the world, felt where something is to be felt.
pub fn step(feel: Option<&mut Feel>, world: &mut World, state: &mut TrackerState) {
    match feel {
        None => {
            world.step(state);
        }
        Some(feel) => {
            feel.move_styli(state);
            world.step(state);
            feel.tell(world);
        }
    }
}

impl Feel {
    /// Starts the loops; `None` where nothing asks for one.
    pub fn start(scene: &Scene, file: &GreenFile, world: &World) -> Result<Option<Feel>, Failure> {
        let wants = |effect: &String| find_effect(effect).is_ok_and(|effect| effect.needs.stiffness);
        let (mut bodies, mut elastic) = (Vec::new(), Vec::new());
        for (b, (name, body)) in scene.body.iter().enumerate() {
            let stiffness = file.stiffness(name).filter(|_| body.effects.iter().any(wants));
            if let Some(stiffness) = stiffness {
                let made = Elastic::new(&body.model, &stiffness, &world.bodies[b].deformer.controls);
                elastic.push(made.map_err(|message| Failure::wrong(format!("body.{name}: {message}")))?);
                bodies.push(b);
            }
        }
        if bodies.is_empty() || world.stage.haptics.is_empty() {
            return Ok(None);
        }
        let link = |haptic: &Haptic| {
            let stylus = stylus_number(haptic, &world.stage)?;
            let device = open(haptic)?;
            let control = Control::new(haptic.clone(), elastic.clone(), device.latency_s());
            let running = Loop::start(control, device).map_err(Failure::work)?;
            eprintln!("haptic {}: {}, {} Hz", haptic.name, running.device, haptic.rate_hz);
            Ok(Link {
                haptic: haptic.clone(),
                running,
                stylus,
                bodies: bodies.clone(),
                hold: None,
                grips: 0,
                room_from_hand: None,
                seen: None,
                warned: false,
            })
        };
        let links = world.stage.haptics.iter().map(link).collect::<Result<_, Failure>>()?;
        Ok(Some(Feel { links }))
    }

    /// Puts the devices in the place of their styli.
    pub fn move_styli(&mut self, state: &mut TrackerState) {
        for link in &mut self.links {
            let felt = link.running.report().felt;
            match link.haptic.device {
                HapticDevice::Simulated => link.drag_along(&felt, state),
                _ => link.move_stylus(&felt, state),
            }
        }
    }

    /// Tells the loops what is held after a frame.
    pub fn tell(&mut self, world: &World) {
        for link in &mut self.links {
            let held = link.held(world);
            let poses = held.map(|held| &world.bodies[link.bodies[held.body]].deformer.poses);
            let room_from_hand = link.room_from_hand;
            link.running.tell(|grasp| {
                (grasp.held, grasp.room_from_hand) = (held, room_from_hand);
                grasp.poses.clear();
                grasp.poses.extend(poses.into_iter().flatten());
            });
            link.warn(world, held.as_ref());
        }
    }

    /// How the loops did, a line for each.
    pub fn summary(&mut self) -> String {
        let line = |link: &mut Link| {
            let clock = link.running.report().clockwork;
            let [p50, p99, late] = [clock.work_p50_s, clock.work_p99_s, clock.late_p99_s].map(seconds);
            format!(
                "haptic {}: {} ticks, {} late, {} left out; work p50 {p50}, p99 {p99}; late by p99 {late}\n",
                link.haptic.name, clock.ticks, clock.late, clock.missed
            )
        };
        self.links.iter_mut().map(line).collect()
    }
}

/// Where the stage tracks styli, the number of that name; else that of the hand: right, left.
fn stylus_number(haptic: &Haptic, stage: &Stage) -> Result<usize, Failure> {
    let tracked: Vec<&str> = stage.tracking.styli.keys().map(String::as_str).collect();
    let known = if tracked.is_empty() { vec!["right", "left"] } else { tracked };
    known.iter().position(|name| *name == haptic.stylus).ok_or_else(|| {
        let message = crate::config::unknown_name("stylus", &haptic.stylus, known.iter().copied());
        Failure::wrong(format!("haptic.{}.stylus: {message}", haptic.name))
    })
}

fn open(haptic: &Haptic) -> Result<Box<dyn Device>, Failure> {
    let wrong = |message: String| Failure::wrong(format!("haptic.{}: {message}", haptic.name));
    Ok(match &haptic.device {
        HapticDevice::Simulated => Box::new(Simulated::new(haptic, Hand::FINGERS)),
        HapticDevice::Vrpn(name) => Box::new(VrpnDevice::open(name).map_err(wrong)?),
        HapticDevice::Haply(place) => Box::new(Haply::open(place).map_err(|error| wrong(error.to_string()))?),
    })
}

impl Link {
    /// The stylus of a simulated device goes where its mass is; the tracker's or the mouse's is the hand that pulls it.
    fn drag_along(&mut self, felt: &Felt, state: &mut TrackerState) {
        let Some(stylus) = state.styli.get_mut(self.stylus) else {
            self.room_from_hand = None;
            return;
        };
        let was_pulled = self.room_from_hand.is_some();
        self.room_from_hand = usable(&stylus.room_from_stylus).or(self.room_from_hand);
        if let Some(pose) = felt.room_from_handle.filter(|_| was_pulled) {
            stylus.room_from_stylus = pose.cast();
        }
    }

    fn move_stylus(&mut self, felt: &Felt, state: &mut TrackerState) {
        if let Some(pose) = felt.room_from_handle {
            self.seen = Some((state.time_s, pose, felt.buttons));
        }
        let Some((seen_s, pose, [pressed, second])) = self.seen else { return };
        let signal = match state.time_s - seen_s {
            age_s if age_s <= 0.0 => Signal::Live,
            age_s if age_s < LOST_S => Signal::Held { age_s },
            age_s => Signal::Lost { age_s },
        };
        state.styli.resize_with(state.styli.len().max(self.stylus + 1), StylusState::default);
        state.styli[self.stylus] =
            StylusState { room_from_stylus: pose.cast(), pressed, second, signal, from_eye: false };
    }

    /// What this link's stylus holds freely and alone; `None` for all else, whose force is not known.
    fn held(&mut self, world: &World) -> Option<Held> {
        let now = self.holds_now(world);
        let goes_on = now.zip(self.hold).is_some_and(|(now, last)| {
            now.place == last.place && (now.handle_from_element - last.handle_from_element).norm() < SAME_HOLD
        });
        if !goes_on {
            self.grips += u64::from(now.is_some());
            self.hold = now;
        }
        let hold = self.hold?;
        let (b, element) = hold.place;
        let body = &world.bodies[b];
        Some(Held {
            grip: self.grips,
            body: self.bodies.iter().position(|body| *body == b)?,
            element,
            room_from_body: body.room_from_body,
            handle_from_element: hold.handle_from_element,
            mean: body.deformer.displacements.body_from_surface.rotation.to_rotation_matrix(),
        })
    }

    fn holds_now(&self, world: &World) -> Option<Hold> {
        let grasp = world.graph.get(world.fields.hands);
        let hands = &grasp.hands;
        let target = hands.grip(self.stylus)?.target;
        let holders =
            (0..world.fields.styli.len()).filter(|&i| hands.grip(i).is_some_and(|g| g.target == target));
        let stylus = world.graph.get(world.fields.styli.get(self.stylus)?.stylus).as_ref()?;
        let place = *world.fields.targets.get(target)?;
        let is_free = hands.mode == Mode::FREE && holders.count() == 1 && !stylus.second;
        if !is_free || !self.bodies.contains(&place.0) {
            return None;
        }
        let (body, pose) = (&world.bodies[place.0], hands.room_from_stylus(self.stylus)?);
        let room_from_element = body.room_from_element(place.1, body.deformer.poses.get(place.1)?);
        Some(Hold { place, handle_from_element: pose.inverse().to_homogeneous() * room_from_element })
    }

    /// Says once that a body is too stiff to be felt as it is.
    fn warn(&mut self, world: &World, held: Option<&Held>) {
        let felt = self.running.report().felt;
        let Some(held) = held.filter(|_| !self.warned && felt.gain > 0.0 && felt.stiffer > 1.0) else {
            return;
        };
        self.warned = true;
        eprintln!(
            "note: haptic {}: body.{} is up to {:.0} times stiffer than the device bears at {} Hz with {} N·s/m of friction; \
             in those directions it is felt that much softer (`greenstage manual haptics`)",
            self.haptic.name,
            world.bodies[self.bodies[held.body]].deformer.body,
            felt.stiffer.ceil(),
            self.haptic.rate_hz,
            self.haptic.damping
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::session;
    use super::*;
    use crate::effect::haptics::thread::running;
    use crate::green;
    use crate::stage::{BUILT_IN, rotation_towards};
    use nalgebra::{Translation3, Vector3};
    use std::path::Path;
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    /// A block in the workbench, with or without the effect, with or without a device.
    fn session(effects: &str, device: &str) -> (Scene, Arc<GreenFile>, World) {
        let text = format!(
            "[body.block]\ngenerate = {{ block = {{ size = [2.0, 1.0, 1.0], cells = [4, 2, 2] }} }}\n\
             material = {{ young = 100.0, poisson = 0.3 }}\nmodel = \"rotation\"\neffects = [{effects}]\n\
             [body.block.control.fixed]\nnodes = {{ group = \"xmin\" }}\ngrab = \"fixed\"\n\
             [body.block.control.end]\nnodes = {{ group = \"xmax\" }}\ngrab = \"dragger\"\n"
        );
        let scene = Scene::parse(&text, Path::new("scene.toml")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.green");
        green::write(&path, &session::precompute(&scene, true).unwrap()).unwrap();
        let file = Arc::new(GreenFile::open(&path).unwrap());
        let stage = Stage::parse(&format!("{}\n{device}", BUILT_IN[0].1), Path::new("stage.toml")).unwrap();
        let world = World::new(&scene, &file, stage).unwrap();
        (scene, file, world)
    }

    const DEVICE: &str = "[haptic.right]\ndevice = \"simulated\"\n";

    /// In one test, as the loops of the process are counted: no thread unless a body asks and the stage has a device; and
    /// with both the stylus feels what it holds, stays behind the hand, and feels nothing after it lets go.
    #[test]
    fn a_loop_runs_only_where_it_is_asked_for_and_the_hand_feels_what_it_holds() {
        for (effects, device) in [("", ""), ("", DEVICE), ("\"haptics\"", "")] {
            let (scene, file, world) = session(effects, device);
            assert!(Feel::start(&scene, &file, &world).unwrap().is_none(), "{effects} {device}");
            assert_eq!(running(), 0, "{effects} {device}");
        }
        let (scene, file, mut world) = session("\"haptics\"", DEVICE);
        let mut feel = Feel::start(&scene, &file, &world).unwrap().unwrap();
        assert_eq!(running(), 1);
        let workspace = world.stage.workspace;
        let started = Instant::now();
        let mut follow =
            |world: &mut World, y: f64, pressed: bool, until: &dyn Fn(&Felt, &TrackerState) -> bool| {
                let deadline = Instant::now() + Duration::from_secs(30);
                loop {
                    let place = |x: f64| workspace.centre + Vector3::new(x, y, 0.1) * workspace.radius_m;
                    let rotation = rotation_towards(&(place(0.0) - place(1.5)), 0.0).unwrap();
                    let pose = Isometry3::from_parts(Translation3::from(place(1.5).coords), rotation).cast();
                    let stylus = StylusState { room_from_stylus: pose, pressed, ..Default::default() };
                    let time_s = started.elapsed().as_secs_f64();
                    let mut state = TrackerState { head: None, styli: vec![stylus], time_s };
                    feel.move_styli(&mut state);
                    world.step(&state);
                    feel.tell(world);
                    let felt = feel.links[0].running.report().felt;
                    if until(&felt, &state) {
                        return felt;
                    }
                    assert!(Instant::now() < deadline, "{felt:?} {state:?}");
                    std::thread::sleep(Duration::from_millis(5));
                }
            };
        follow(&mut world, 0.0, false, &|felt, _| felt.room_from_handle.is_some());
        follow(&mut world, 0.0, true, &|felt, _| felt.gain == 1.0);
        let felt = follow(&mut world, 0.3, true, &|felt, _| felt.push.force.norm() > 0.1);
        assert!(felt.push.force.y < 0.0, "it pulls back down: {felt:?}");
        assert!(world.bodies[0].deformer.poses[1].translation.y > 0.0, "the picture shows what is felt");
        follow(&mut world, 0.3, false, &|felt, _| felt.push.force.norm() == 0.0);
        drop(feel);
        assert_eq!(running(), 0);
    }
}
