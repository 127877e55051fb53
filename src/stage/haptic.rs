//! A stage's force-feedback devices: what each is, how it moves a stylus, and which forces it can bear.

use nalgebra::Isometry3;
use std::fmt;

/// One table `[haptic.NAME]` of a stage file.
#[derive(Clone, Debug, PartialEq)]
pub struct Haptic {
    pub name: String,
    pub device: HapticDevice,
    /// Name of the stylus that the device moves.
    pub stylus: String,
    /// Ticks of the force loop per second.
    pub rate_hz: f64,
    /// The force never exceeds this, N.
    pub max_force_n: f64,
    /// N·m; 0 for a device without torque.
    pub max_torque_nm: f64,
    /// Newtons in the hand per newton of the body.
    pub force: f64,
    /// Metres of the stylus in the room per metre of the device.
    pub motion: f64,
    /// The device's own viscous friction, N·s/m and N·m·s/rad, which dissipates the energy that sampling generates.
    pub damping: f64,
    pub rotational_damping: f64,
    /// The device's mass and inertia as the hand feels them, kg and kg·m².
    pub mass: f64,
    pub inertia: f64,
    /// Friction that the loop adds, N·s/m.
    pub virtual_damping: f64,
    /// The greatest age of a pose when its force begins to act, s, as far as the user knows. A greater measured age counts
    /// instead.
    pub latency_s: f64,
    pub room_from_device: Isometry3<f64>,
    /// The transform from the handle that the device measures to the stylus, whose ray is its -z axis.
    pub sensor_from_body: Isometry3<f64>,
    /// The buttons of a Haply grip that grab and act as the second button.
    pub buttons: [GripButton; 2],
}

/// A button of a grip, as Haply's service names it. The only button of a wired grip is `a`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GripButton {
    A,
    B,
    C,
    D,
    E,
    F,
    Up,
    Down,
    Left,
    Right,
}

impl GripButton {
    pub fn name(self) -> &'static str {
        match self {
            GripButton::A => "a",
            GripButton::B => "b",
            GripButton::C => "c",
            GripButton::D => "d",
            GripButton::E => "e",
            GripButton::F => "f",
            GripButton::Up => "up",
            GripButton::Down => "down",
            GripButton::Left => "left",
            GripButton::Right => "right",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HapticDevice {
    /// A mass on a spring that the stylus' tracker, or the mouse, pulls.
    Simulated,
    /// A VRPN force device: `Phantom0@host`.
    Vrpn(String),
    /// Haply's Inverse Service at `host:port`.
    Haply(String),
}

impl Haptic {
    /// A simulated device like a small desktop arm.
    pub fn simulated(name: &str) -> Haptic {
        Haptic {
            name: name.to_owned(),
            device: HapticDevice::Simulated,
            stylus: name.to_owned(),
            rate_hz: 1000.0,
            max_force_n: 8.0,
            max_torque_nm: 0.4,
            force: 1.0,
            motion: 1.0,
            damping: 1.0,
            rotational_damping: 2e-3,
            mass: 0.1,
            inertia: 1e-4,
            virtual_damping: 0.0,
            latency_s: 0.0,
            room_from_device: Isometry3::identity(),
            sensor_from_body: Isometry3::identity(),
            buttons: [GripButton::A, GripButton::B],
        }
    }

    /// The name among the trackers and the sensors.
    pub fn tracker(&self) -> String {
        format!("haptic.{}", self.name)
    }

    /// The length of a tick, s.
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }
}

impl fmt::Display for HapticDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            HapticDevice::Simulated => f.write_str("simulated"),
            HapticDevice::Vrpn(name) => write!(f, "vrpn {name}"),
            HapticDevice::Haply(place) => write!(f, "haply {place}"),
        }
    }
}
