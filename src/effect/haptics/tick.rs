//! One tick of the force loop: the device's newest pose in, the push on the hand out.
//!
//! Pose → held element, moved by the coupling, or tool → energy and gradient → push within the limits, times a gain that ramps up;
//! plus a brake if energy was generated. If anything is wrong with the pose, or if frames stop coming, the force goes to
//! zero within [`FADE_S`]. A tick waits for no lock and allocates nothing.

use super::bond::{self, Bond};
use super::coupling::{Coupling, CouplingState};
use super::delay::Delay;
use super::device::{Push, Reading};
use super::elastic::Elastic;
use super::grasp::{ElementHold, Grasp, device_from_handle, room_from_handle};
use super::haptic_source::{ActingPush, TimedPush};
use super::loop_state::{LoopState, Measures};
use super::passivity::{MARGIN, Motion, largest_stiffness};
use super::stiffness::Stiffness;
use crate::deform::{DeformationModel, TouchPotential, se3};
use crate::stage::{Haptic, HapticDevice, ROOM_LIMIT_M};
use nalgebra::{Isometry3, Vector3, Vector6};

/// A new hold reaches its full force within this time, s.
pub const RAMP_S: f64 = 0.25;
/// A force that ends fades out within this time, s.
pub const FADE_S: f64 = 0.05;
/// A device that reports nothing for this long is lost, s.
pub const STALE_S: f64 = 0.02;
/// The hold ends if no frame comes for this long, s.
pub const UNATTENDED_S: f64 = 0.2;
/// The shortest time in which the force may change by the device's whole limit, s. It stops only changes that no hand
/// causes: at 5 ms it delayed a stiff body's force, and from 2 kHz on the loop diverged.
pub const SLEW_S: f64 = 0.001;
/// No hand moves a handle faster, m/s and rad/s: the sensor jumped.
pub const MOST_SPEED: [f64; 2] = [10.0, 100.0];
/// The coupling is updated when the body's stiffness was estimated again, and when the lag of the force has changed by this
/// factor.
const SLOWER: f64 = 1.01;
/// The most steps of the hold in one tick.
const MOST_STEPS: usize = 4;
/// Time constant with which contacts that were not foreseen reach their full force, s.
const SHARE_S: f64 = 0.1;
/// A stored energy below this is nothing that friction could pay for, J.
const LEAST_J: f64 = 1e-9;
/// Time constant of the velocity for the virtual damper, s.
const VELOCITY_S: f64 = 0.005;

/// Another model for a body, by its number among those of a loop.
pub struct Renewal {
    pub body: usize,
    pub model: Box<dyn DeformationModel>,
}

/// The force loop without its clock, so that tests run the same code as devices.
pub struct Control {
    pub haptic: Haptic,
    pub measures: Measures,
    pub state: LoopState,
    /// Travel time of the device's messages both ways and its own cycle, s: the current [`super::Device::latency_s`].
    pub latency_s: f64,
    bodies: Vec<Elastic>,
    bond: Option<Bond>,
    /// Contacts of the tool, where the handle carries one.
    touch: TouchPotential,
    /// Whether the coupling still has the stiffness of an earlier touch.
    is_touch_new: bool,
    /// Part of the energy and the force of the contacts that is felt.
    share: f64,
    /// Count of the held body's ways home in the last frame.
    homecomings: u64,
    /// The hold's pose in the room at the last tick.
    hold_at: Option<Isometry3<f64>>,
    coupling: Coupling,
    /// The body's stiffness at the handle.
    stiffness: Stiffness,
    /// The lag of the force at the last update of the coupling, s; `None` if nothing is held.
    coupled_s: Option<f64>,
    /// The state of the coupling, with the push before the gain.
    give: CouplingState,
    /// The last hold in the device's frame, and the body's push there.
    felt: Option<(Isometry3<f64>, Vector6<f64>)>,
    /// Stored energy at the last reading; `None` if the next one belongs to another potential.
    stored: Option<f64>,
    /// The body's torque, for a device that cannot render it.
    unfelt: Vector3<f64>,
    /// The force that fades out, and the fraction that is left.
    fading: (Push, f64),
    /// Whether a frame has come since the last tick, and when the last one came, s.
    news: bool,
    news_s: f64,
    motion: Option<Motion>,
    delay: Delay,
    /// Times at which the last two poses were measured, s.
    between_s: [f64; 2],
    acting: ActingPush,
    last: Option<Reading>,
    last_s: Option<f64>,
    velocity: [Vector3<f64>; 2],
}

impl Control {
    /// [`ElementHold::body`] is an index of `bodies`; `latency_s` is that of the device.
    pub fn new(haptic: Haptic, bodies: Vec<Elastic>, latency_s: f64) -> Control {
        let (delay, acting) = (Delay::new(haptic.period_s()), ActingPush::new(haptic.rate_hz));
        Control {
            haptic,
            measures: Measures::ALL,
            state: LoopState::default(),
            latency_s,
            bodies,
            bond: None,
            touch: TouchPotential::with_room(),
            is_touch_new: false,
            share: 1.0,
            homecomings: 0,
            hold_at: None,
            coupling: Coupling::new([1.0; 2], true, None),
            stiffness: Stiffness::default(),
            coupled_s: None,
            give: CouplingState::default(),
            felt: None,
            stored: None,
            unfelt: Vector3::zeros(),
            fading: (Push::NONE, 0.0),
            news: false,
            news_s: 0.0,
            motion: None,
            delay,
            between_s: [0.0; 2],
            acting,
            last: None,
            last_s: None,
            velocity: [Vector3::zeros(); 2],
        }
    }

    /// Gives a body another model, and hands back its old one. The energy by which they differ is not the hand's: [`Control::take`] sees to
    /// that, and has to follow.
    pub fn renew(&mut self, renewal: &mut Renewal) {
        if let Some(body) = self.bodies.get_mut(renewal.body) {
            body.exchange(&mut renewal.model);
        }
    }

    /// Takes the data of a new frame.
    pub fn take(&mut self, grasp: &Grasp) {
        self.news = true;
        let known = |held: &ElementHold| {
            self.bodies.get(held.body).is_some_and(|body| held.element < body.elements())
        };
        let tool = grasp.touch.as_ref().map(|_| Bond::Tool);
        let bond = grasp.held.filter(known).map(Bond::Element).or(tool);
        let goes_on = bond.zip(self.bond).is_some_and(|(now, last)| now.continues(&last));
        if !goes_on {
            self.end();
            self.hold_at = None;
        }
        self.bond = bond;
        // The change of the push by the motion of other elements does not belong to this hold's stiffness.
        self.felt = None;
        match bond {
            Some(Bond::Element(held)) => self.take_element(&held, grasp, !goes_on),
            Some(Bond::Tool) => {
                if let Some(touch) = &grasp.touch {
                    self.take_touch(touch, goes_on);
                }
            }
            None => {}
        }
    }

    /// Takes the contacts of a frame. Where they hold more energy than those of the last one did at the same place, as where the tool has
    /// reached points that were not foreseen, their share is such that nothing is added; it grows with what friction eats, and in time.
    fn take_touch(&mut self, touch: &TouchPotential, goes_on: bool) {
        let energy = |control: &Control| {
            let hold = control.hold_at?;
            Some(control.share * bond::touched(&control.haptic, &hold, &control.touch).energy)
        };
        let before = energy(self);
        self.touch.copy_from(touch);
        (self.is_touch_new, self.share) = (true, 1.0);
        let is_felt = goes_on && self.state.gain > 0.0;
        let both = before.zip(energy(self)).filter(|(before, now)| is_felt && now > before);
        if let Some((before, now)) = both {
            self.share = before / now;
        }
    }

    /// Takes the poses of the held body.
    fn take_element(&mut self, held: &ElementHold, grasp: &Grasp, is_new: bool) {
        let body = &mut self.bodies[held.body];
        let pose = if is_new { grasp.poses.get(held.element).copied() } else { Some(body.held_pose()) };
        body.set(held.element, &grasp.poses);
        // The loop itself follows the turn of the element that it holds.
        let is_home = grasp.homecomings != std::mem::replace(&mut self.homecomings, grasp.homecomings);
        if is_home && !is_new {
            body.forget();
        }
        let sets = |e: usize| is_new || is_home || e != held.element;
        for (e, turn) in grasp.turns.iter().enumerate().filter(|(e, _)| sets(*e)) {
            body.set_turn(e, *turn);
        }
        // The other hand of this hold moved the element too.
        let reach = |at: Isometry3<f64>| held.reach(&at, &body.origin());
        let moved = self.hold_at.filter(|_| !is_new).and_then(reach).map(|reach| reach.pose);
        let pose = moved.or(pose);
        let Some(pose) = pose.filter(|pose| pose.is_finite()) else { return };
        // Energy that another hand has put into the body since the last frame is not this hand's.
        let energy = body.respond(&pose).energy;
        if let Some(stored) = &mut self.stored {
            *stored += (energy - self.state.strain_energy) * held.energy_scale(&self.haptic);
        }
        // Energy that an effect adds from now on counts as generated, because no hand did work for it: the observer brakes it.
        self.state.strain_energy = energy + self.bodies[held.body].add(grasp.added, &pose);
    }

    /// Whether an element is held, or the tool touches something.
    pub fn holds(&self) -> bool {
        match self.bond {
            Some(Bond::Element(_)) => true,
            Some(Bond::Tool) => self.touch.points() > 0,
            None => false,
        }
    }

    /// The push from now until the next tick.
    pub fn tick(&mut self, reading: Option<&Reading>, now_s: f64) -> Push {
        let dt = self.last_s.map_or(0.0, |last_s| (now_s - last_s).clamp(0.0, 0.1));
        self.last_s = Some(now_s);
        let moved = self.admit(reading, now_s, dt);
        if std::mem::take(&mut self.news) {
            self.news_s = now_s;
        }
        let is_attended = !self.holds() || now_s - self.news_s <= UNATTENDED_S;
        self.state.faults.unattended += u64::from(!is_attended);
        // A real device reports the released button before the frame does.
        let is_open = matches!(self.bond, Some(Bond::Element(_)))
            && self.haptic.device != HapticDevice::Simulated
            && !self.state.buttons[0];
        let wanted = match self.bond {
            Some(bond) if moved && is_attended && !is_open => self.pull(&bond, dt),
            _ => None,
        };
        let wanted = match wanted {
            Some(wanted) => wanted,
            None => {
                self.end();
                Push::NONE
            }
        };
        self.fading.1 = (self.fading.1 - dt / FADE_S).max(0.0);
        let faded = self.fading.0.scaled(self.fading.1);
        let push = self.limited(wanted.plus(&faded), dt);
        self.state.push = push;
        self.acting.give(TimedPush {
            at_s: now_s,
            push: push.plus(&faded.scaled(-1.0)),
            gain: self.state.gain,
        });
        push
    }

    /// Ends the hold: the force fades out, and the next hold starts without force.
    fn end(&mut self) {
        if self.state.gain > 0.0 {
            self.fading = (self.state.push, 1.0);
            self.state.gain = 0.0;
        }
        self.state.observer.energy = 0.0;
        self.state.limited = false;
        self.coupled_s = None;
        self.stored = None;
        self.acting.clear();
    }

    /// Takes the device's reading if it can be used; false if there is no force at this tick.
    fn admit(&mut self, reading: Option<&Reading>, now_s: f64, dt: f64) -> bool {
        let faults = &mut self.state.faults;
        self.motion = None;
        let newest = match (reading, &self.last) {
            (Some(new), Some(last)) if new.is_before(last) => {
                faults.backward += 1;
                Some(last)
            }
            (new, _) => new,
        };
        let Some(new) = newest.copied().filter(|new| new.tracked && now_s - new.arrived_s <= STALE_S) else {
            faults.lost += 1;
            self.state.room_from_handle = None;
            self.state.buttons = [false; 2];
            // Otherwise a clock that was set back would be refused for ever.
            self.last = None;
            return false;
        };
        self.state.buttons = new.buttons;
        let sampled_s = self.delay.heard(&new, now_s, self.latency_s);
        self.between_s = [self.between_s[1], sampled_s];
        self.state.spacing_s = self.delay.period_s();
        self.state.age_s = self.age_s();
        let faults = &mut self.state.faults;
        if !is_sane(&new.device_from_handle) {
            faults.absurd += 1;
            self.last = None;
            return false;
        }
        let room = room_from_handle(&self.haptic, &new.device_from_handle);
        self.state.room_from_handle = Some(room);
        let Some(last) = self.last.replace(new) else {
            self.velocity = [Vector3::zeros(); 2];
            return true;
        };
        let dx = new.device_from_handle.translation.vector - last.device_from_handle.translation.vector;
        let turn =
            (new.device_from_handle.rotation * last.device_from_handle.rotation.inverse()).scaled_axis();
        // A silent device may have moved for as long as it was silent.
        let time = (new.arrived_s - last.arrived_s).max(dt).max(self.haptic.period_s());
        if dx.norm() > MOST_SPEED[0] * time || turn.norm() > MOST_SPEED[1] * time {
            faults.jumps += 1;
            self.velocity = [Vector3::zeros(); 2];
            return false;
        }
        self.motion = Some(Motion { dx, turn, time_s: time });
        // The velocity changes only when a new report has arrived.
        if new.arrived_s > last.arrived_s {
            let share = time / (time + VELOCITY_S);
            for (velocity, step) in self.velocity.iter_mut().zip([dx, turn]) {
                *velocity += (step / time - *velocity) * share;
            }
        }
        true
    }

    /// The push of the body and the dampers; `None` if it is not a number.
    fn pull(&mut self, bond: &Bond, dt: f64) -> Option<Push> {
        let handle = self.last?.device_from_handle;
        self.couple(bond, &handle);
        let haptic = &self.haptic;
        let scale = bond.energy_scale(haptic);
        if self.share < 1.0 {
            let surplus = self.stored.filter(|stored| *stored > LEAST_J);
            let eaten = surplus.map_or(0.0, |stored| self.state.observer.energy.max(0.0) / stored);
            self.share = (self.share * (1.0 + eaten) + (1.0 - self.share) * dt / SHARE_S).min(1.0);
        }
        if let Some(motion) = &self.motion {
            self.give = self.coupling.follow(&motion.stacked(), &self.give);
        }
        let (mut stored, mut torque, mut is_unsettled, mut energy) = (f64::NAN, Vector3::zeros(), false, 0.0);
        // Usually one step; more if the hold is far from its place.
        for _ in 0..MOST_STEPS {
            let hold = room_from_handle(haptic, &self.give.hold(&handle));
            let mut response = bond.respond(haptic, &hold, &mut self.bodies, &self.touch)?;
            self.hold_at = Some(hold);
            if *bond == Bond::Tool {
                response = response.scaled(self.share);
            }
            let mut push = response.push;
            torque = push.torque;
            if haptic.max_torque_nm <= 0.0 {
                push.torque = Vector3::zeros();
            }
            let felt = (device_from_handle(haptic, &hold), push.stacked());
            if let Some((from, before)) = self.felt.replace(felt) {
                self.coupling.learn(&way(&from, &felt.0), &(felt.1 - before));
            }
            // Limited before the gain; otherwise the force of a bent body would reach the limit too early in the ramp.
            self.give = self.coupling.settle(&self.give.by_offset(&felt.1), &self.give);
            energy = response.energy;
            stored = energy * scale + self.give.energy;
            if !push.is_finite() || !stored.is_finite() {
                self.state.faults.absurd += 1;
                return None;
            }
            self.state.faults.undefined += u64::from(!response.is_defined);
            is_unsettled = !response.is_defined || self.give.is_on_the_way;
            if !self.give.is_on_the_way {
                break;
            }
        }
        let felt = self.felt.as_ref()?;
        let is_found = match bond {
            Bond::Element(held) => {
                self.stiffness.search(haptic, held, felt, self.bodies.get_mut(held.body)?)?
            }
            Bond::Tool => false,
        };
        if is_found {
            self.suit();
        }
        self.state.limited = self.give.is_limited;
        self.count(stored, torque, is_unsettled);
        let haptic = &self.haptic;
        // A new hold's force grows once the coupling suits the body's stiffness and the hold has arrived at its place.
        let is_known = match bond {
            Bond::Element(_) => self.stiffness.found.is_some() && !is_found,
            // A touch comes softened once the loop knows what it bears.
            Bond::Tool => self.touch.points() == 0 || self.touch.stiffer > 0.0,
        };
        let is_ready = is_known && !self.give.is_on_the_way;
        let ramp = if is_ready { dt / RAMP_S } else { 0.0 };
        let gain = (self.state.gain + ramp).min(1.0);
        (self.state.gain, self.state.strain_energy, self.state.stored_energy) = (gain, energy, stored);
        let mut wanted = Push::unstacked(&self.give.on_handle()).scaled(gain);
        let [v, w] = &self.velocity;
        wanted.force -= v * haptic.virtual_damping * gain;
        if self.measures.brake {
            // The brake lags like every other force.
            let period_s = 2.0 * self.lag_s();
            let brake = self.state.observer.brake(v, w, haptic.mass, haptic.inertia, period_s);
            wanted = wanted.plus(&brake);
        }
        Some(wanted)
    }

    /// The time between two poses, s.
    fn period_s(&self) -> f64 {
        self.haptic.period_s().max(self.delay.period_s())
    }

    /// The age of a pose when its force begins to act, s.
    fn age_s(&self) -> f64 {
        if self.measures.age { self.delay.age_s(self.haptic.latency_s) } else { 0.0 }
    }

    /// The lag of the force behind the motion, s: half the time for which it is held, plus the age of its pose.
    fn lag_s(&self) -> f64 {
        0.5 * self.period_s() + self.age_s()
    }

    /// Reports the handle's last motion to the observer: the force that acted meanwhile, without the fading rest of an earlier
    /// hold, and the energy stored at the motion's end. Because of the poses' age it is not known exactly which force acted: of the last
    /// one and the oldest possible one, the one that generates more is counted. A device without torque is counted as if it
    /// had one, because the hand that turns it changes the body's energy by that much.
    fn count(&mut self, stored: f64, torque: Vector3<f64>, is_unsettled: bool) {
        let half_torque = (self.unfelt + torque) * 0.5;
        self.unfelt = torque;
        let before = std::mem::replace(&mut self.stored, (!is_unsettled).then_some(stored));
        let Some((before, motion)) = before.zip(self.motion) else { return };
        let [from_s, until_s] = self.between_s;
        let acted = |late_s: f64| {
            let mut given = self.acting.during(from_s - late_s, until_s - late_s)?;
            if self.haptic.max_torque_nm <= 0.0 {
                given.push.torque = half_torque * given.gain;
            }
            let gained = given.push.force.dot(&motion.dx) + given.push.torque.dot(&motion.turn);
            Some((gained + given.gain * (stored - before), given))
        };
        let Some((at_once, late)) = acted(0.0).zip(acted(self.age_s())) else { return };
        let (_, given) = if late.0 > at_once.0 { late } else { at_once };
        let damping = [self.haptic.damping, self.haptic.rotational_damping];
        self.state.observer.moved(&given.push, given.gain * (stored - before), &motion, damping);
    }

    /// Makes the coupling for a new hold, rigid until the body's stiffness is found. Softens it when the lag of the force has
    /// changed.
    fn couple(&mut self, bond: &Bond, handle: &Isometry3<f64>) {
        let lag_s = self.lag_s();
        if self.coupled_s.is_none() {
            (self.coupling, self.stiffness) = (self.rigid(), Stiffness::default());
            (self.give, self.felt, self.stored) = (CouplingState::default(), None, None);
        }
        let last_s = *self.coupled_s.get_or_insert(lag_s);
        let mut is_new_touch = false;
        match bond {
            Bond::Element(held) => {
                if let Some(body) = self.bodies.get_mut(held.body) {
                    self.stiffness.follow(handle, body);
                }
            }
            Bond::Tool => {
                is_new_touch = std::mem::take(&mut self.is_touch_new) || self.stiffness.found.is_none();
                let room = room_from_handle(&self.haptic, handle);
                self.stiffness.found = Some(bond::stiffness(&self.haptic, &room, &self.touch));
            }
        }
        // A coupling without energy can be replaced by a stiffer one.
        let is_replaced = self.coupling.is_too_soft && self.give.is_slack(&self.coupling.compliance);
        if is_replaced {
            self.coupling = self.rigid();
        }
        if is_replaced || is_new_touch || (lag_s / last_s).max(last_s / lag_s) >= SLOWER {
            self.suit();
        }
    }

    /// A coupling that does not give.
    fn rigid(&self) -> Coupling {
        let haptic = &self.haptic;
        let limits = self.measures.limits.then_some([haptic.max_force_n, haptic.max_torque_nm]);
        Coupling::new([haptic.damping, haptic.rotational_damping], haptic.max_torque_nm > 0.0, limits)
    }

    /// Softens the coupling for the body's stiffness, where that is known, and for the lag of the force.
    fn suit(&mut self) {
        let Some(stiffness) = &self.stiffness.found else { return };
        // Damping and stiffness in units of the device's own damping.
        let b = self.haptic.virtual_damping / self.haptic.damping.max(1e-9);
        let bearable = MARGIN * largest_stiffness(1.0, b, self.period_s(), self.age_s());
        // A touch comes softened.
        let is_tool = self.bond == Some(Bond::Tool);
        let softens = self.measures.coupling && !is_tool;
        self.coupling.suit(stiffness, if softens { bearable } else { f64::INFINITY });
        self.coupled_s = Some(self.lag_s());
        let stiffer = if is_tool { self.touch.stiffer } else { self.coupling.stiffer };
        (self.state.stiffer, self.state.bearable) = (stiffer, bearable * self.haptic.damping);
    }

    /// The push reduced to the device's limits, in the same direction.
    fn fitting(&self, mut push: Push) -> Push {
        let (force, torque) = (self.haptic.max_force_n, self.haptic.max_torque_nm);
        if torque <= 0.0 {
            push.torque = Vector3::zeros();
        }
        if !self.measures.limits {
            return push;
        }
        push.scaled(part(push.force.norm(), force).min(part(push.torque.norm(), torque)))
    }

    /// The push within the limits, changing no faster than [`SLEW_S`] allows.
    fn limited(&self, push: Push, dt: f64) -> Push {
        let push = self.fitting(if push.is_finite() { push } else { Push::NONE });
        if !self.measures.limits {
            return push;
        }
        let last = &self.state.push;
        let step = Push { force: push.force - last.force, torque: push.torque - last.torque };
        let (force, torque) = (self.haptic.max_force_n, self.haptic.max_torque_nm);
        let time = dt.max(self.haptic.period_s()) / SLEW_S;
        last.plus(
            &step.scaled(part(step.force.norm(), force * time).min(part(step.torque.norm(), torque * time))),
        )
    }
}

/// The factor that reduces a length to at most `most`.
fn part(length: f64, most: f64) -> f64 {
    if length > most { most / length } else { 1.0 }
}

/// Translation and rotation vector from one pose to another.
fn way(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Vector6<f64> {
    let place = to.translation.vector - from.translation.vector;
    let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
    se3::joined(&place, &turn)
}

fn is_sane(pose: &Isometry3<f64>) -> bool {
    let is_near = pose.translation.vector.iter().all(|x| x.abs() <= ROOM_LIMIT_M);
    is_near && (pose.rotation.coords.norm() - 1.0).abs() <= 0.01
}
