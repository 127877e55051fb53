//! Force-feedback devices of a stage: which, how it moves a stylus, and what it can bear. Data only; no socket here.

use nalgebra::Isometry3;

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
    /// N·m; 0: a device that has no torque.
    pub max_torque_nm: f64,
    /// Newtons in the hand for a newton of the body.
    pub force: f64,
    /// Metres of the stylus in the room for a metre of the device.
    pub motion: f64,
    /// The device's own viscous friction, N·s/m and N·m·s/rad: it alone eats what sampling generates.
    pub damping: f64,
    pub rotational_damping: f64,
    /// What a hand feels of the device's own mass, kg and kg·m².
    pub mass: f64,
    pub inertia: f64,
    /// Friction that the loop adds, N·s/m.
    pub virtual_damping: f64,
    pub room_from_device: Isometry3<f64>,
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
            room_from_device: Isometry3::identity(),
        }
    }

    /// Seconds of a tick.
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }
}
