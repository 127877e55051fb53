//! A simulated device: a mass with friction on the spring of a hand, for tests and for desks without a device.
//!
//! m x'' = f - b x' - k_h (x - x_h) - b_h x' and the same for the rotation, between two ticks in steps of
//! at most `STEP_S` under the constant force of the loop, as motors hold it; m contains the hand's own mass. Its [`Reports`] may
//! be rare, late and irregular, like those of a device on a network.

use super::device::{Device, Push, Reading};
use crate::stage::Haptic;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// Longest step of the integration (Runge-Kutta of order 4 for the place, symplectic Euler for the rotation), s.
const STEP_S: f64 = 5e-5;

/// Times that differ by less are equal, s.
const SAME_S: f64 = 1e-9;

/// A hand that holds the handle: a mass, and a spring and damper to its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// Mass that moves with the handle, kg.
    pub mass: f64,
    /// N/m and N·s/m.
    pub stiffness: f64,
    pub damping: f64,
    /// N·m/rad and N·m·s/rad.
    pub rotational_stiffness: f64,
    pub rotational_damping: f64,
}

impl Hand {
    /// Two fingers that hold a pen, of the order that identification experiments give (350 N/m, 4 N·s/m, 0.1 kg).
    pub const FINGERS: Hand = Hand {
        mass: 0.1,
        stiffness: 350.0,
        damping: 4.0,
        rotational_stiffness: 1.0,
        rotational_damping: 0.02,
    };
    /// No hand: the handle is free.
    pub const NONE: Hand =
        Hand { mass: 0.0, stiffness: 0.0, damping: 0.0, rotational_stiffness: 0.0, rotational_damping: 0.0 };
    /// Two fingertips that barely touch it.
    pub const LIGHT: Hand = Hand {
        mass: 0.02,
        stiffness: 50.0,
        damping: 0.2,
        rotational_stiffness: 0.2,
        rotational_damping: 0.002,
    };
    /// A fist.
    pub const FIRM: Hand = Hand {
        mass: 0.3,
        stiffness: 1000.0,
        damping: 10.0,
        rotational_stiffness: 3.0,
        rotational_damping: 0.1,
    };
}

/// The manner in which the device reports its poses. By default it reports the current one whenever it is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reports {
    /// Time between two poses, s; 0: the current one.
    pub every_s: f64,
    /// Time from a pose's measurement to its arrival, including the force's way to the motors, s.
    pub delay_s: f64,
    /// Each pose is later by a random time of up to this, s, but none overtakes another. The poses have no stamps.
    pub jitter_s: f64,
}

/// The target of a scripted hand at a time.
pub type Script = Box<dyn Fn(f64) -> Isometry3<f64> + Send>;

pub struct Simulated {
    pub device_from_handle: Isometry3<f64>,
    /// m/s and rad/s.
    pub velocity: [Vector3<f64>; 2],
    pub hand: Hand,
    pub buttons: [bool; 2],
    /// False: it reports, but does not know its pose.
    pub tracked: bool,
    /// False: it does not report.
    pub present: bool,
    /// Work of the hand's spring and damper on the handle since the start, J.
    pub hand_work: f64,
    /// Work of the loop's push on the handle, and dissipation by the device's own friction, since the start, J.
    pub push_work: f64,
    pub eaten: f64,
    pub reports: Reports,
    /// The poses under way, the oldest first, and the newest that has arrived.
    under_way: VecDeque<Reading>,
    arrived: Option<Reading>,
    reported: u64,
    next_s: Option<f64>,
    script: Option<Script>,
    target: Isometry3<f64>,
    haptic: Haptic,
    push: Push,
    time_s: Option<f64>,
    has_hand: bool,
}

impl Simulated {
    pub fn new(haptic: &Haptic, hand: Hand) -> Simulated {
        Simulated {
            device_from_handle: Isometry3::identity(),
            velocity: [Vector3::zeros(); 2],
            hand,
            buttons: [false; 2],
            tracked: true,
            present: true,
            hand_work: 0.0,
            push_work: 0.0,
            eaten: 0.0,
            reports: Reports::default(),
            under_way: VecDeque::new(),
            arrived: None,
            reported: 0,
            next_s: None,
            script: None,
            target: Isometry3::identity(),
            haptic: haptic.clone(),
            push: Push::NONE,
            time_s: None,
            has_hand: false,
        }
    }

    pub fn scripted(haptic: &Haptic, hand: Hand, script: Script) -> Simulated {
        let pose = script(0.0);
        Simulated {
            script: Some(script),
            device_from_handle: pose,
            target: pose,
            ..Simulated::new(haptic, hand)
        }
    }

    /// Kinetic energy of handle and hand, and the energy in the hand's spring, J.
    pub fn energy(&self) -> f64 {
        let [v, w] = &self.velocity;
        let off = self.device_from_handle.translation.vector - self.target.translation.vector;
        0.5 * ((self.haptic.mass + self.hand.mass) * v.norm_squared()
            + self.haptic.inertia * w.norm_squared()
            + self.hand.stiffness * off.norm_squared())
    }

    /// Simulates up to `now_s` under the last push.
    pub fn advance(&mut self, now_s: f64) {
        let Some(before) = self.time_s.replace(now_s) else { return };
        let span = (now_s - before).clamp(0.0, 0.1);
        let steps = (span / STEP_S).ceil().max(1.0) as u32;
        let step = span / f64::from(steps);
        for i in 0..steps {
            if let Some(script) = &self.script {
                self.target = script(before + f64::from(i) * step);
            }
            self.step(step);
        }
    }

    /// The current pose, arriving now.
    fn now(&self, arrived_s: f64) -> Reading {
        let Simulated { device_from_handle, buttons, tracked, .. } = *self;
        Reading { buttons, tracked, ..Reading::at(device_from_handle, arrived_s) }
    }

    /// Simulates up to `now_s` and sends poses meanwhile; returns the newest that has arrived.
    fn hear(&mut self, now_s: f64) -> Option<Reading> {
        let Reports { every_s, delay_s, jitter_s } = self.reports;
        // After a long pause, the time before is skipped.
        let mut next_s = self.next_s.unwrap_or(now_s).max(now_s - 0.1);
        while next_s <= now_s + SAME_S {
            self.advance(next_s);
            let last_s =
                self.under_way.back().or(self.arrived.as_ref()).map_or(next_s, |last| last.arrived_s);
            let arrives_s = next_s + delay_s + jitter_s * chance(self.reported);
            self.under_way.push_back(self.now(arrives_s.max(last_s)));
            self.reported += 1;
            next_s += every_s;
        }
        self.next_s = Some(next_s);
        self.advance(now_s);
        while self.under_way.front().is_some_and(|first| first.arrived_s <= now_s + SAME_S) {
            self.arrived = self.under_way.pop_front();
        }
        self.arrived
    }

    fn step(&mut self, h: f64) {
        let hand = self.hand;
        let (mass, target) = (self.haptic.mass + hand.mass, self.target.translation.vector);
        let (b, push) = (self.haptic.damping, self.push.force);
        let pull = |x: &Vector3<f64>, v: &Vector3<f64>| (target - x) * hand.stiffness - v * hand.damping;
        let acceleration = |x: &Vector3<f64>, v: &Vector3<f64>| (push + pull(x, v) - v * b) / mass;
        let (x, v) = (self.device_from_handle.translation.vector, self.velocity[0]);
        let (k1, a1) = (v, acceleration(&x, &v));
        let (k2, a2) = (v + a1 * (h / 2.0), acceleration(&(x + k1 * (h / 2.0)), &(v + a1 * (h / 2.0))));
        let (k3, a3) = (v + a2 * (h / 2.0), acceleration(&(x + k2 * (h / 2.0)), &(v + a2 * (h / 2.0))));
        let (k4, a4) = (v + a3 * h, acceleration(&(x + k3 * h), &(v + a3 * h)));
        let new_x = x + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        let new_v = v + (a1 + (a2 + a3) * 2.0 + a4) * (h / 6.0);
        // Trapezoidal rule.
        self.hand_work += 0.5 * (pull(&x, &v) + pull(&new_x, &new_v)).dot(&(new_x - x));
        self.push_work += push.dot(&(new_x - x));
        self.eaten += 0.5 * h * b * (v.norm_squared() + new_v.norm_squared());
        self.velocity[0] = new_v;

        let rotation = self.device_from_handle.rotation;
        let off = (self.target.rotation * rotation.inverse()).scaled_axis();
        let w = self.velocity[1];
        let turn = off * hand.rotational_stiffness - w * hand.rotational_damping;
        let w =
            w + (self.push.torque + turn - w * self.haptic.rotational_damping) * (h / self.haptic.inertia);
        self.hand_work += turn.dot(&w) * h;
        self.push_work += self.push.torque.dot(&w) * h;
        self.eaten += self.haptic.rotational_damping * w.norm_squared() * h;
        self.velocity[1] = w;
        let mut rotation = UnitQuaternion::from_scaled_axis(w * h) * rotation;
        rotation.renormalize();
        self.device_from_handle = Isometry3::from_parts(Translation3::from(new_x), rotation);
    }
}

impl Device for Simulated {
    fn describe(&self) -> String {
        "simulated".into()
    }

    fn read(&mut self, now_s: f64) -> Option<Reading> {
        let reading = if self.reports.every_s > 0.0 {
            self.hear(now_s)
        } else {
            self.advance(now_s);
            Some(self.now(now_s))
        };
        reading.filter(|_| self.present)
    }

    fn push(&mut self, push: &Push, _now_s: f64) {
        self.push = *push;
    }

    /// The latency that an echo would measure, which does not contain the random part.
    fn latency_s(&self) -> f64 {
        self.reports.delay_s
    }

    fn hand(&mut self, device_from_hand: &Isometry3<f64>) {
        // A hand that takes the handle for the first time starts where it is.
        if !std::mem::replace(&mut self.has_hand, true) && self.script.is_none() {
            self.device_from_handle = *device_from_hand;
            self.velocity = [Vector3::zeros(); 2];
        }
        self.target = *device_from_hand;
        self.script = None;
    }
}

/// A pseudo-random number from 0 to 1, the same on every machine (S. Vigna's splitmix64).
fn chance(number: u64) -> f64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_are_as_late_as_they_are_to_be_and_in_order() {
        let mut device = Simulated::new(&Haptic::simulated("right"), Hand::NONE);
        device.reports = Reports { every_s: 5e-3, delay_s: 1e-3, jitter_s: 4e-3 };
        device.velocity[0].x = 1e-3;
        let (mut last, mut least_s, mut most_s, mut count) = (-1.0, f64::MAX, 0.0f64, 0);
        for tick in 0..5000 {
            let now_s = 1e-3 * f64::from(tick);
            let Some(reading) = device.read(now_s).filter(|reading| reading.arrived_s > last) else {
                continue;
            };
            assert!(reading.arrived_s <= now_s && now_s - reading.arrived_s < 1e-3 + 1e-9);
            // Poses are measured at multiples of 5 ms, and none is overtaken.
            let late_s = reading.arrived_s - 5e-3 * f64::from(count);
            (last, least_s, most_s, count) =
                (reading.arrived_s, least_s.min(late_s), most_s.max(late_s), count + 1);
        }
        assert!(count > 990 && least_s > 1e-3 && least_s < 1.1e-3, "{count} {least_s}");
        assert!(most_s < 5e-3 && most_s > 4.9e-3, "{most_s}");
    }

    /// The loop has run for a while before the first frame gives it the place of the hand.
    #[test]
    fn a_hand_finds_the_handle_where_it_is() {
        let mut device = Simulated::new(&Haptic::simulated("right"), Hand::FINGERS);
        device.read(0.0);
        device.read(0.5);
        let hand = Isometry3::translation(0.3, 1.0, -0.2);
        device.hand(&hand);
        let reading = device.read(0.501).unwrap();
        assert!((reading.device_from_handle.translation.vector - hand.translation.vector).norm() < 1e-12);
        assert!(device.energy() < 1e-12, "it is not flung there: {} J", device.energy());
        device.hand(&Isometry3::translation(0.31, 1.0, -0.2));
        device.read(0.502);
        assert!((device.device_from_handle.translation.x - 0.3).abs() < 1e-3, "nor does it jump later");
    }
}
