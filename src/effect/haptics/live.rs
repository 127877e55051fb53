//! The force loops of a session: one for each device of the stage, if a body lists an effect that gives forces.
//!
//! A real device is a tracker of the stage, and its force loop is that tracker's source; a simulated device moves its stylus
//! before a frame. After the frame the loop receives what the stylus holds. If no body asks for forces, or the stage has no
//! device, there is no [`HapticSession`], and a frame makes no call here.

use super::super::entry::{EffectEntry, EffectInput};
use super::bond::TouchSpring;
use super::device::Device;
use super::elastic::Elastic;
use super::grasp::{ElementHold, HoldConstraint};
use super::haply::Haply;
use super::loop_state::{LoopFaults, LoopState};
use super::reading::HapticReading;
use super::simulated::{Hand, Simulated};
use super::thread::{Loop, Report};
use super::tick::{Control, Renewal};
use super::vrpn::VrpnDevice;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::plates::Words;
use crate::base::table::seconds;
use crate::deform::{Deformer, TouchPotential};
use crate::green::STIFFNESS;
use crate::interact::Mode;
use crate::stage::{Haptic, HapticDevice, Stage};
use crate::track::{Source, TrackerState, usable};
use crate::world::force_scale::ForceScale;
use crate::world::{BodyFrame, Frame, RunningEffect, World};
use nalgebra::Isometry3;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub struct HapticSession {
    links: Vec<Link>,
}

/// One device and its loop.
struct Link {
    haptic: Haptic,
    running: Loop,
    /// Index of its stylus.
    stylus: usize,
    /// Indices in the world of the bodies that give it forces.
    bodies: Vec<usize>,
    hold: Option<Hold>,
    /// Index in the world of the body that its tool presses.
    touches: Option<usize>,
    spring: TouchSpring,
    grips: u64,
    /// Pose of the hand of a simulated device, by the tracker or the mouse.
    room_from_hand: Option<Isometry3<f64>>,
    told: GivenWarnings,
}

/// Warnings about a device that were given, each once, and the time of its last pose.
struct GivenWarnings {
    stiff: bool,
    slow: bool,
    /// The age of the poses at the last warning, s.
    age_s: f64,
    silent: bool,
    heard: Instant,
}

/// Age of the poses above which a warning is given while their forces act, s; another follows at twice the age.
const LATE_S: f64 = 1.5e-3;

/// Silence of a device after which a warning is given.
const SILENT: Duration = Duration::from_secs(2);

#[derive(Clone, Copy)]
struct Hold {
    place: (usize, usize),
    way: HoldConstraint,
}

impl Hold {
    fn goes_on(&self, last: &Hold) -> bool {
        let is_same = match (&self.way, &last.way) {
            (HoldConstraint::Rigid(now), HoldConstraint::Rigid(then)) => (now - then).norm() < SAME_HOLD,
            (
                HoldConstraint::Carried { carrying: now, .. },
                HoldConstraint::Carried { carrying: then, .. },
            ) => now.begun() == then.begun(),
            _ => false,
        };
        is_same && self.place == last.place
    }
}

/// A hold whose matrix is off by more than this since it began is another one; an element that is off by more does not
/// follow.
const SAME_HOLD: f64 = 1e-3;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: "haptics",
    summary: "force and torque on every control element, by the strain energy of the body's model; felt with a device of the stage",
    requirements: &[STIFFNESS],
    needs_energy: true,
    is_felt: true,
    attach: Some(show_forces),
    start: Some(|listed, world| {
        Ok(HapticSession::start(listed, world)?.map(|session| Box::new(session) as Box<dyn RunningEffect>))
    }),
    ..EffectEntry::NOTHING
};

/// The arrow of the force at what a hand holds.
fn show_forces(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let mut scales = Vec::new();
    for &(b, name) in &listed.bodies {
        let body = &mut world.bodies[b];
        body.deformer.feel();
        let scale = listed.file.stiffness(name).map(|s| ForceScale::new(&s, body.assets.ball.1));
        scales.extend(scale.map(|scale| (b, Arc::new(scale))));
    }
    Ok(Some(Box::new(ShownForces { scales })))
}

/// Has the forces of bodies shown that list the effect.
struct ShownForces {
    scales: Vec<(usize, Arc<ForceScale>)>,
}

impl RunningEffect for ShownForces {
    fn name(&self) -> &'static str {
        ENTRY.name
    }

    fn surface(&mut self, _: &World, bodies: &mut [BodyFrame]) {
        for (b, scale) in &self.scales {
            bodies[*b].force_scale = Some(scale.clone());
        }
    }
}

impl HapticSession {
    /// Starts the loops; `None` where the stage has no force device.
    pub fn start(listed: &EffectInput<'_>, world: &World) -> Result<Option<HapticSession>, Failure> {
        let bodies: Vec<usize> = listed.bodies.iter().map(|&(b, _)| b).collect();
        if bodies.is_empty() || world.assets.stage.haptics.is_empty() {
            return Ok(None);
        }
        let link = |haptic: &Haptic| {
            let stylus = stylus_number(haptic, &world.assets.stage)?;
            let device = open(haptic)?;
            let elastic = listed.bodies.iter().map(|&(b, name)| {
                let made = Elastic::from_deformer(&world.bodies[b].deformer);
                made.map_err(|message| Failure::wrong(format!("body.{name}: {message}")))
            });
            let elastic = elastic.collect::<Result<Vec<_>, _>>()?;
            let control = Control::new(haptic.clone(), elastic, device.latency_s());
            let running = Loop::start(control, device).map_err(Failure::work)?;
            notice!("haptic {}: {}, {} Hz", haptic.name, running.device, haptic.rate_hz);
            Ok(Link {
                haptic: haptic.clone(),
                running,
                stylus,
                bodies: bodies.clone(),
                hold: None,
                touches: None,
                spring: TouchSpring::default(),
                grips: 0,
                room_from_hand: None,
                told: GivenWarnings {
                    stiff: false,
                    slow: false,
                    age_s: LATE_S,
                    silent: false,
                    heard: Instant::now(),
                },
            })
        };
        let links = world.assets.stage.haptics.iter().map(link).collect::<Result<_, Failure>>()?;
        Ok(Some(HapticSession { links }))
    }

    /// Puts simulated devices in the place of their styli.
    fn move_styli(&mut self, state: &mut TrackerState) {
        for link in self.links.iter_mut().filter(|link| link.haptic.device == HapticDevice::Simulated) {
            let loop_state = link.running.report().state;
            link.drag_along(&loop_state, state);
        }
    }

    /// Passes to the loops what is held after a frame.
    fn tell(&mut self, world: &World, frame: &Frame) {
        for link in &mut self.links {
            let held = link.held(world);
            let touch = link.touch(frame).filter(|_| held.is_none());
            let bearable = link.running.report().state.bearable;
            let touch = touch.map(|(b, touch)| {
                let mut touch = touch.clone();
                link.spring.soften(&link.haptic, bearable, &mut touch);
                (b, touch)
            });
            link.touches = touch.as_ref().filter(|(_, touch)| touch.presses()).map(|(b, _)| *b);
            let body = held.map(|held| &world.bodies[link.bodies[held.body]].deformer);
            let room_from_hand = link.room_from_hand;
            link.running.tell(|grasp| {
                (grasp.held, grasp.room_from_hand) = (held, room_from_hand);
                grasp.touch = touch.map(|(_, touch)| touch);
                grasp.poses.clear();
                grasp.poses.extend(body.into_iter().flat_map(|body| &body.poses));
                grasp.added = held.zip(body).and_then(|(held, body)| {
                    body.contribution().of_element(held.element, body.poses.get(held.element)?)
                });
                grasp.homecomings = body.map_or(0, |body| body.homecomings);
                grasp.turns.clear();
                let turn = |body: &Deformer, e| body.turn(e).quaternion;
                grasp
                    .turns
                    .extend(body.into_iter().flat_map(|b| (0..b.poses.len()).map(move |e| turn(b, e))));
            });
            let felt = held.map(|held| link.bodies[held.body]).or(link.touches);
            link.warn(world, felt);
        }
    }
}

impl RunningEffect for HapticSession {
    fn name(&self) -> &'static str {
        ENTRY.name
    }

    fn input(&mut self, state: &mut TrackerState) {
        self.move_styli(state);
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        self.tell(world, frame);
    }

    fn reshaped(&mut self, world: &World, body: usize, _kept: usize) -> Result<(), String> {
        for link in &mut self.links {
            if let Some(own) = link.bodies.iter().position(|felt| *felt == body) {
                let model = world.bodies[body].deformer.another_model()?;
                link.running.renew(Renewal { body: own, model });
            }
        }
        Ok(())
    }

    fn source(&mut self, tracker: &str) -> Option<Box<dyn Source>> {
        let link = self.links.iter_mut().find(|link| link.haptic.tracker() == tracker)?;
        Some(Box::new(link.running.source()?))
    }

    fn readings(&mut self) -> Vec<Vec<Words>> {
        let of = |link: &mut Link| {
            let Report { state, timing, .. } = *link.running.report();
            HapticReading {
                name: link.haptic.name.clone(),
                state,
                timing,
                max_force_n: link.haptic.max_force_n,
                holds: link.hold.is_some() || link.touches.is_some(),
            }
            .rows()
        };
        self.links.iter_mut().map(of).collect()
    }

    fn summary(&mut self) -> String {
        let line = |link: &mut Link| {
            let Report { state, timing, malformed } = *link.running.report();
            let [p50, p99, late] = [timing.work_p50_s, timing.work_p99_s, timing.late_p99_s].map(seconds);
            let name = &link.haptic.name;
            let told = format!(
                "haptic {name}: {} ticks, {} late, {} left out; work p50 {p50}, p99 {p99}; late by p99 {late}\n",
                timing.ticks, timing.late, timing.missed
            );
            let LoopFaults { lost, absurd, jumps, backward, unattended, undefined } = state.faults;
            let faults = [
                (lost, "without news of the device"),
                (absurd, "with an impossible pose"),
                (jumps, "with a jump"),
                (backward, "with an older reading"),
                (unattended, "without news of the frame"),
                (undefined, "without a frame or equilibrium of the body"),
                (malformed, "messages not understood"),
            ];
            let seen: Vec<String> = faults
                .iter()
                .filter(|(count, _)| *count > 0)
                .map(|(count, what)| format!("{count} {what}"))
                .collect();
            if seen.is_empty() { told } else { format!("{told}haptic {name}: ticks {}\n", seen.join(", ")) }
        };
        self.links.iter_mut().map(line).collect()
    }
}

fn stylus_number(haptic: &Haptic, stage: &Stage) -> Result<usize, Failure> {
    let known = stage.tracking.stylus_names();
    known.iter().position(|name| *name == haptic.stylus).ok_or_else(|| {
        let message = crate::config::unknown_name("stylus", &haptic.stylus, known.iter().copied());
        Failure::wrong(format!("haptic.{}.stylus: {message}", haptic.name))
    })
}

/// Opens the device that a stage names.
pub fn open(haptic: &Haptic) -> Result<Box<dyn Device>, Failure> {
    let wrong = |message: String| Failure::wrong(format!("haptic.{}: {message}", haptic.name));
    Ok(match &haptic.device {
        HapticDevice::Simulated => Box::new(Simulated::new(haptic, Hand::FINGERS)),
        HapticDevice::Vrpn(name) => Box::new(VrpnDevice::open(name).map_err(wrong)?),
        HapticDevice::Haply(place) => {
            Box::new(Haply::open(place, haptic.buttons).map_err(|error| wrong(error.to_string()))?)
        }
    })
}

impl Link {
    /// The stylus of a simulated device goes where its mass is; the tracker's or the mouse's is the hand that pulls it.
    fn drag_along(&mut self, loop_state: &LoopState, state: &mut TrackerState) {
        let Some(stylus) = state.styli.get_mut(self.stylus) else {
            self.room_from_hand = None;
            return;
        };
        let was_pulled = self.room_from_hand.is_some();
        let handle_from_stylus = self.haptic.sensor_from_body;
        let hand = usable(&stylus.room_from_stylus).map(|pose| pose * handle_from_stylus.inverse());
        self.room_from_hand = hand.or(self.room_from_hand);
        if let Some(pose) = loop_state.room_from_handle.filter(|_| was_pulled) {
            stylus.room_from_stylus = (pose * handle_from_stylus).cast();
        }
    }

    /// The hold of this link's stylus; `None` also while the element does not follow the hand, which wants it beyond the limits
    /// of a pose.
    fn held(&mut self, world: &World) -> Option<ElementHold> {
        let now = self.holds_now(world);
        let goes_on = now.zip(self.hold).is_some_and(|(now, last)| now.goes_on(&last));
        if !goes_on {
            self.grips += u64::from(now.is_some());
        }
        // The other hand of a hold moves; what one hand holds freely stays as it was taken.
        if !goes_on || matches!(now, Some(Hold { way: HoldConstraint::Carried { .. }, .. })) {
            self.hold = now;
        }
        let hold = self.hold?;
        let (b, element) = hold.place;
        let body = &world.bodies[b];
        Some(ElementHold {
            grip: self.grips,
            body: self.bodies.iter().position(|body| *body == b)?,
            element,
            room_from_body: body.room_from_body,
            constraint: hold.way,
        })
    }

    /// The contacts of the tool of its stylus, with the body that has them.
    fn touch<'a>(&self, frame: &'a Frame) -> Option<(usize, &'a TouchPotential)> {
        let of = |b: &usize| frame.bodies.get(*b)?.touches.iter().find(|touch| touch.stylus == self.stylus);
        self.bodies.iter().find_map(|b| Some((*b, of(b)?)))
    }

    fn holds_now(&self, world: &World) -> Option<Hold> {
        let hands = &world.graph.get(world.fields.hands).hands;
        let target = hands.grip(self.stylus)?.target;
        let holders =
            (0..world.fields.styli.len()).filter(|&i| hands.grip(i).is_some_and(|g| g.target == target));
        let stylus = world.graph.get(world.fields.styli.get(self.stylus)?.stylus).as_ref()?;
        let place = *world.fields.targets.get(target)?;
        if !self.bodies.contains(&place.0) {
            return None;
        }
        let handle_from_stylus = self.haptic.sensor_from_body;
        let (body, pose) = (&world.bodies[place.0], hands.room_from_stylus(self.stylus)?);
        let shown = body.room_from_element(place.1, body.deformer.poses.get(place.1)?);
        let way = if hands.mode == Mode::FREE && holders.count() == 1 && !stylus.second {
            let handle_from_room = handle_from_stylus * pose.inverse();
            HoldConstraint::Rigid(handle_from_room.to_homogeneous() * shown)
        } else {
            let carrying = hands.carrying(self.stylus)?;
            let is_followed = (carrying.now()? - shown).norm() < SAME_HOLD;
            is_followed.then_some(HoldConstraint::Carried { carrying, handle_from_stylus })?
        };
        Some(Hold { place, way })
    }

    /// Warns, once each, when a device is silent, reports slowly or late, or when a body is too stiff to be felt as it is.
    fn warn(&mut self, world: &World, felt: Option<usize>) {
        let state = self.running.report().state;
        let Haptic { name, rate_hz, damping, .. } = &self.haptic;
        if state.room_from_handle.is_some() {
            self.told.heard = Instant::now();
        } else if !self.told.silent && self.told.heard.elapsed() > SILENT {
            self.told.silent = true;
            notice!(
                "warning: haptic {name}: {} has reported no pose for {} s: check that it is on, that its service runs, and that its address is right",
                self.running.device,
                SILENT.as_secs()
            );
        }
        if state.gain <= 0.0 {
            return;
        }
        if !self.told.slow && state.spacing_s * rate_hz > 2.0 {
            self.told.slow = true;
            notice!(
                "warning: haptic {name}: {:.0} reports a second for a loop at {rate_hz} Hz: at most {:.0} N/m \
                 can be felt (`greenstage manual haptics`)",
                1.0 / state.spacing_s,
                state.bearable
            );
        }
        if state.age_s > self.told.age_s {
            self.told.age_s = 2.0 * state.age_s;
            notice!(
                "warning: haptic {name}: poses are up to {:.1} ms old: at most {:.0} N/m can be felt \
                 (`greenstage manual haptics`)",
                1e3 * state.age_s,
                state.bearable
            );
        }
        let Some(felt) = felt.filter(|_| !self.told.stiff && state.stiffer > 1.0) else { return };
        self.told.stiff = true;
        notice!(
            "note: haptic {name}: body.{} is up to {:.0} times stiffer than the device bears ({damping} \
             N·s/m, reports every {:.1} ms, {:.1} ms old), and is felt softer",
            world.bodies[felt].deformer.body,
            state.stiffer.ceil(),
            1e3 * state.spacing_s,
            1e3 * state.age_s,
        );
    }
}

#[cfg(test)]
mod tests;
