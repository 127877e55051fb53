//! One scene, some hundred frames long: hands carry an end of each body, a ball presses, a blade cuts, force devices push back.
//!
//! In: a scene, its .green file, and the number of frames. Out: the time of a frame, how far the bodies were moved, and the warnings; or the
//! first frame in which something was not as it must be. In the middle the state goes into another world of the same scene, whose bodies list
//! their effects in the opposite order, and both must go on with the same bits.

use super::setting::{Accepted, BALL_M, BLADE_M, Setting};
use crate::base::failure::Failure;
use crate::effect::haptics::{Control, Device, Elastic, ElementHold, Grasp, Hand, HoldConstraint, Simulated};
use crate::effect::{self, EFFECTS, Resolved};
use crate::green::GreenFile;
use crate::stage::Haptic;
use crate::track::{StylusState, TrackerState};
use crate::world::assets::PATIENCE;
use crate::world::{Input, State, World};
use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;
use std::time::Instant;

type V3 = Vector3<f64>;

/// Frames that a second world replays, at most.
const REPLAYED: usize = 60;
/// A body has failed where a node is farther from its place at rest than this, in parts of the body's length. Hands carry an end by a tenth.
const FARTHEST: f64 = 0.5;
/// The stylus of the first body's hand, after those of the ball and the blade.
const HANDS: usize = 2;
/// Frames of a way of a hand and of the blade, of the ball down and up, and of the ball along the body.
const WAY: usize = 120;
const DOWN: f64 = 75.0;
const ALONG: f64 = 400.0;
/// Ticks of the force loop in a second: fewer than devices have, since each finds an equilibrium with some models.
const RATE_HZ: f64 = 120.0;

/// Times, motions and warnings of all frames.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Ran {
    /// Mean time of [`World::step`], s.
    pub frame_s: f64,
    /// The largest displacement of a node, in parts of the body's length.
    pub moved: f64,
    pub warnings: Vec<String>,
}

/// The first frame that failed, and why.
#[derive(Clone, Debug, Serialize)]
pub struct Failed {
    pub frame: usize,
    pub why: String,
}

fn world(scene: &Resolved, file: &Arc<GreenFile>) -> Result<World, Failure> {
    let stage = Setting::stage().map_err(Failure::request)?;
    effect::world(EFFECTS, scene, file, stage)
}

/// A scene on its way through the frames.
struct Course<'a> {
    accepted: &'a Accepted,
    world: World,
    /// Another world that goes on from a state of this one.
    second: Option<World>,
    devices: Vec<Option<ForceDevice>>,
    /// The middles of the bodies, m.
    places: Vec<V3>,
}

/// Goes through the frames of a scene.
pub fn run(accepted: &Accepted, file: &Arc<GreenFile>, frames: usize) -> Result<Ran, Failed> {
    let at = |frame: usize| move |why: String| Failed { frame, why };
    let mut course = Course::new(accepted, file).map_err(at(0))?;
    let (mut ran, begins) = (Ran::default(), frames / 2);
    let mut spent_s = 0.0;
    for frame in 0..frames {
        if frame == begins {
            course.begin_replay(file).map_err(at(frame))?;
        }
        if frame == begins + REPLAYED {
            course.end_replay();
        }
        spent_s += course.step(frame).map_err(at(frame))?;
        ran.moved = ran.moved.max(course.moved().map_err(at(frame))?);
    }
    course.world.before_picture();
    ran.frame_s = spent_s / frames.max(1) as f64;
    ran.warnings = course.world.warnings.iter().map(|(_, warning)| warning.clone()).collect();
    Ok(ran)
}

impl Course<'_> {
    fn new<'a>(accepted: &'a Accepted, file: &Arc<GreenFile>) -> Result<Course<'a>, String> {
        let world = world(&accepted.scene, file).map_err(|failure| failure.to_string())?;
        let bodies = &accepted.setting.bodies;
        let device = |b: usize| {
            let is_felt = bodies[b].iter().any(|effect| effect.is_felt);
            is_felt.then(|| ForceDevice::new(&world, b)).transpose()
        };
        let devices = (0..bodies.len()).map(device).collect::<Result<_, _>>()?;
        let places = (0..bodies.len()).map(|b| accepted.setting.place(b, &world.assets.stage)).collect();
        Ok(Course { accepted, world, second: None, devices, places })
    }

    /// The state as text, in another world; this one goes on from it too and waits for what is computed in the background, as with a recording.
    fn begin_replay(&mut self, file: &Arc<GreenFile>) -> Result<(), String> {
        let reversed = self.accepted.setting.reversed().accepted()?;
        if reversed.required != self.accepted.required {
            return Err("the opposite order of effects requires other columns".into());
        }
        let mut second = world(&reversed.scene, file).map_err(|failure| failure.to_string())?;
        let text = self.world.state().and_then(|state| serde_json::to_string(&state));
        let state: State = text.and_then(|text| serde_json::from_str(&text)).map_err(|e| e.to_string())?;
        for world in [&mut self.world, &mut second] {
            world.wait_for_background();
            world.set_state(&state)?;
        }
        self.second = Some(second);
        Ok(())
    }

    fn end_replay(&mut self) {
        self.second = None;
        self.world.bodies.iter_mut().for_each(|body| body.deformer.be_patient(PATIENCE));
    }

    /// One frame; returns the time that the world took.
    fn step(&mut self, frame: usize) -> Result<f64, String> {
        let time_s = frame as f64 / 60.0;
        let mut styli = vec![self.probe(frame), self.scalpel(frame)];
        for b in 0..self.places.len() {
            let (mut room_from_hand, pressed) = self.hand(b, frame);
            if let Some(device) = &mut self.devices[b] {
                room_from_hand = device.follow(room_from_hand, time_s)?;
            }
            styli.push(StylusState {
                room_from_stylus: room_from_hand.cast(),
                pressed,
                ..Default::default()
            });
        }
        let trackers = TrackerState { head: None, styli, time_s };
        let input = Input { arrivals: self.world.arrivals(), ..trackers.into() };
        let started = Instant::now();
        self.world.step(&input);
        let spent_s = started.elapsed().as_secs_f64();
        self.devices.iter_mut().flatten().for_each(|device| device.take(&self.world));
        self.hear()?;
        if let Some(second) = &mut self.second {
            second.step(&input);
            if second.state_hash() != self.world.state_hash() {
                return Err("a world that goes on from the state comes to another one".into());
            }
        }
        Ok(spent_s)
    }

    /// Hears what sounds, as a file would.
    fn hear(&mut self) -> Result<(), String> {
        let mut heard = self.world.effects.iter_mut().filter_map(|effect| effect.heard());
        match heard.all(|heard| heard.samples.iter().all(|sample| sample.is_finite())) {
            true => Ok(()),
            false => Err("a sample of the sound is not finite".into()),
        }
    }

    /// The largest displacement of a node, in parts of the body's length.
    fn moved(&self) -> Result<f64, String> {
        let length = self.accepted.setting.shape.size[0];
        let mut most = 0.0_f64;
        for body in &self.world.bodies {
            let deformer = &body.deformer;
            let motion = deformer.body_from_surface();
            for (x, rest) in deformer.positions().iter().zip(deformer.rest()) {
                let [x, rest] = [x, rest].map(|x| Point3::from(x.map(f64::from)));
                let off = (motion * x - rest).norm() / length;
                if !off.is_finite() {
                    return Err(format!("a place on body.{} is not finite", deformer.body));
                }
                most = most.max(off);
            }
        }
        match most <= FARTHEST {
            true => Ok(most),
            false => Err(format!("a node is moved by {most:.2} of the body's length")),
        }
    }

    /// The hand at the right end of a body, pointing at it: for half of the time it carries the end aside, up and outward, turned, and back.
    fn hand(&self, b: usize, frame: usize) -> (Isometry3<f64>, bool) {
        let length = self.accepted.setting.shape.size[0];
        let share = (frame % WAY) as f64 / WAY as f64;
        let phase = ((share - 0.1) / 0.5).clamp(0.0, 1.0);
        let away = (PI * phase).sin().powi(2);
        let aside = V3::new(0.03, 0.06, 0.04 * (TAU * phase).sin()) * (away * length);
        let turn = UnitQuaternion::from_scaled_axis(V3::new(0.1, 0.0, 0.2) * away);
        let pointing = UnitQuaternion::from_scaled_axis(V3::y() * FRAC_PI_2);
        let end = self.places[b] + V3::x() * (0.5 * length);
        let place = end + aside + turn * (V3::x() * 0.1);
        (Isometry3::from_parts(Translation3::from(place), turn * pointing), (0.1..0.6).contains(&share))
    }

    /// The ball above the body that it presses: it goes along it, and down by 3 % of its length and up again.
    fn probe(&self, frame: usize) -> StylusState {
        let setting = &self.accepted.setting;
        let [length, height, _] = setting.shape.size;
        let above = height / 2.0 + BALL_M + 0.03 * length * (TAU * frame as f64 / DOWN).cos();
        let along = 0.25 * length * (TAU * frame as f64 / ALONG).sin();
        tip(self.places[setting.body_with(|effect| effect.presses_points)] + V3::new(along, above, 0.0))
    }

    /// The blade across the body that it cuts: down to its middle and up, and every time at another place.
    fn scalpel(&self, frame: usize) -> StylusState {
        let setting = &self.accepted.setting;
        let [length, height, _] = setting.shape.size;
        let (cut, share) = (frame / WAY, (frame % WAY) as f64 / WAY as f64);
        let depth = (1.0 - (share / 0.4 - 1.0).abs()).max(0.0);
        let aside = ((share - 0.8) / 0.2).max(0.0);
        let along =
            length * (-0.29 + 0.17 * ((cut % 4) as f64 + if cut % 4 < 3 { aside } else { -3.0 * aside }));
        let above = (height / 2.0 + 0.05) * (1.0 - depth);
        tip(self.places[setting.body_with(|effect| effect.is_cut)] + V3::new(along, above, -BLADE_M / 2.0))
    }
}

fn tip(place: V3) -> StylusState {
    StylusState { room_from_stylus: Isometry3::from(Translation3::from(place)).cast(), ..Default::default() }
}

/// A simulated device in virtual time, whose handle is the hand of a body.
struct ForceDevice {
    control: Control,
    device: Simulated,
    body: usize,
    ticks: u64,
    grips: u64,
    /// element ← handle of the hold that goes on.
    handle_from_element: Option<Matrix4<f64>>,
    room_from_hand: Isometry3<f64>,
}

impl ForceDevice {
    fn new(world: &World, body: usize) -> Result<ForceDevice, String> {
        let haptic = Haptic { rate_hz: RATE_HZ, ..Haptic::simulated("hand") };
        let elastic = Elastic::from_deformer(&world.bodies[body].deformer)?;
        Ok(ForceDevice {
            device: Simulated::new(&haptic, Hand::FINGERS),
            control: Control::new(haptic, vec![elastic], 0.0),
            body,
            ticks: 0,
            grips: 0,
            handle_from_element: None,
            room_from_hand: Isometry3::identity(),
        })
    }

    /// The force loop up to this time while the hand wants to be there; returns where the handle is.
    fn follow(&mut self, room_from_hand: Isometry3<f64>, time_s: f64) -> Result<Isometry3<f64>, String> {
        self.room_from_hand = room_from_hand;
        self.device.hand(&room_from_hand);
        while (self.ticks as f64) < time_s * RATE_HZ {
            self.ticks += 1;
            let now_s = self.ticks as f64 / RATE_HZ;
            let reading = self.device.read(now_s);
            let push = self.control.tick(reading.as_ref(), now_s);
            if !push.is_finite() {
                return Err("the force on the hand is not finite".into());
            }
            self.device.push(&push, now_s);
        }
        Ok(self.device.device_from_handle)
    }

    /// Takes over what the hand holds after a frame.
    fn take(&mut self, world: &World) {
        let hands = &world.graph.get(world.fields.hands).hands;
        let body = &world.bodies[self.body];
        let deformer = &body.deformer;
        let grip = hands.grip(HANDS + self.body).and_then(|grip| world.fields.targets.get(grip.target));
        let element = grip.filter(|(b, _)| *b == self.body).map(|(_, element)| *element);
        let Some(element) = element else {
            self.handle_from_element = None;
            self.control.take(&Grasp::default());
            return;
        };
        let matrix = *self.handle_from_element.get_or_insert_with(|| {
            self.grips += 1;
            let handle_from_room = self.device.device_from_handle.inverse().to_homogeneous();
            handle_from_room * body.room_from_element(element, &deformer.poses[element])
        });
        let held = ElementHold {
            grip: self.grips,
            body: 0,
            element,
            room_from_body: body.room_from_body,
            constraint: HoldConstraint::Rigid(matrix),
        };
        self.control.take(&Grasp {
            held: Some(held),
            poses: deformer.poses.clone(),
            turns: (0..deformer.poses.len()).map(|e| deformer.turn(e).quaternion).collect(),
            homecomings: deformer.homecomings,
            added: deformer.contribution().of_element(element, &deformer.poses[element]),
            touch: None,
            room_from_hand: Some(self.room_from_hand),
        });
    }
}
