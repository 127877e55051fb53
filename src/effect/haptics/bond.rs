//! The bond of a handle: a control element that it holds, or a tool that touches bodies.
//!
//! In: the hold's pose in the room. Out: push and energy there. Both are potentials, and everything that keeps the loop stable is the
//! same for both.

use super::coupling::Coupling;
use super::device::Push;
use super::elastic::Elastic;
use super::grasp::ElementHold;
use crate::deform::TouchPotential;
use crate::stage::Haptic;
use nalgebra::{Isometry3, Matrix6};

/// The bond of a handle.
#[allow(clippy::large_enum_variant, reason = "it is copied once in a tick, without a heap")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bond {
    Element(ElementHold),
    /// The tool of a frame's [`TouchPotential`].
    Tool,
}

impl Bond {
    /// Whether the force of `last` goes on in this one.
    pub fn continues(&self, last: &Bond) -> bool {
        match (self, last) {
            (Bond::Element(now), Bond::Element(then)) => now.grip == then.grip,
            (Bond::Tool, Bond::Tool) => true,
            _ => false,
        }
    }

    /// Joules in the hand per joule of the body or the room.
    pub fn energy_scale(&self, haptic: &Haptic) -> f64 {
        match self {
            Bond::Element(held) => held.energy_scale(haptic),
            Bond::Tool => haptic.force / haptic.motion,
        }
    }

    /// Push and energy with the hold at `room_from_hold`; `None` where the hold is not defined there.
    pub fn respond(
        &self,
        haptic: &Haptic,
        room_from_hold: &Isometry3<f64>,
        bodies: &mut [Elastic],
        touch: &TouchPotential,
    ) -> Option<BondResponse> {
        match self {
            Bond::Element(held) => {
                let body = bodies.get_mut(held.body)?;
                let reach = held.reach(room_from_hold, &body.origin())?;
                let found = body.respond(&reach.pose);
                let push = held.push(haptic, &reach, &found)?;
                Some(BondResponse { push, energy: found.energy, is_defined: found.is_defined })
            }
            Bond::Tool => Some(touched(haptic, room_from_hold, touch)),
        }
    }
}

/// The push on the hand, in the device's frame, and the energy, J, of the body or in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BondResponse {
    pub push: Push,
    pub energy: f64,
    /// Whether the body's frame or equilibrium was found; otherwise an earlier one was kept.
    pub is_defined: bool,
}

impl BondResponse {
    /// A part of energy and push.
    pub fn scaled(&self, share: f64) -> BondResponse {
        BondResponse { push: self.push.scaled(share), energy: self.energy * share, ..*self }
    }
}

/// The tool where the handle has it.
fn tool(haptic: &Haptic, room_from_handle: &Isometry3<f64>, touch: &TouchPotential) -> Isometry3<f64> {
    let stylus_from_tool = touch.room_from_stylus.inv_mul(&touch.room_from_tool);
    room_from_handle * haptic.sensor_from_body * stylus_from_tool
}

/// Push and energy of a touch with the handle at `room_from_handle`.
pub fn touched(haptic: &Haptic, room_from_handle: &Isometry3<f64>, touch: &TouchPotential) -> BondResponse {
    let tool = tool(haptic, room_from_handle, touch);
    let found = touch.respond(&tool);
    let arm = tool.translation.vector - room_from_handle.translation.vector;
    let device_from_room = haptic.room_from_device.rotation.inverse();
    let push = Push {
        force: device_from_room * found.force * haptic.force,
        torque: device_from_room * (found.torque + arm.cross(&found.force)) * (haptic.force / haptic.motion),
    };
    BondResponse { push, energy: found.energy, is_defined: true }
}

/// The stiffness of a touch at the handle, 6 × 6 in N/m, N and N·m of the device: the greatest that its contacts can have.
pub fn stiffness(haptic: &Haptic, room_from_handle: &Isometry3<f64>, touch: &TouchPotential) -> Matrix6<f64> {
    let motion = tool_motion(haptic, room_from_handle, touch);
    motion.transpose() * touch.stiffness * motion * (haptic.force / haptic.motion)
}

/// The tool's motion (v, ω) in the room by the handle's in the device.
fn tool_motion(haptic: &Haptic, room_from_handle: &Isometry3<f64>, touch: &TouchPotential) -> Matrix6<f64> {
    let arm = tool(haptic, room_from_handle, touch).translation.vector - room_from_handle.translation.vector;
    let turn = haptic.room_from_device.rotation.to_rotation_matrix();
    let mut motion = Matrix6::zeros();
    motion.fixed_view_mut::<3, 3>(0, 0).copy_from(&(turn.matrix() * haptic.motion));
    motion.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-arm.cross_matrix() * turn.matrix()));
    motion.fixed_view_mut::<3, 3>(3, 3).copy_from(turn.matrix());
    motion
}

/// The spring through which the hand feels a tool that presses bodies stiffer than the device bears: that of a [`Coupling`].
#[derive(Default)]
pub struct TouchSpring(Option<Coupling>);

impl TouchSpring {
    /// Softens the touch of a frame for what the loop bears: `bearable` in N/m, 0 while the loop does not know it.
    pub fn soften(&mut self, haptic: &Haptic, bearable: f64, touch: &mut TouchPotential) {
        // A spring without force can be replaced by a stiffer one.
        if !touch.presses() {
            self.0 = None;
        }
        if bearable <= 0.0 {
            return;
        }
        let damping = [haptic.damping, haptic.rotational_damping];
        let rigid = || Coupling::new(damping, haptic.max_torque_nm > 0.0, None);
        let coupling = self.0.get_or_insert_with(rigid);
        let room_from_handle = touch.room_from_stylus * haptic.sensor_from_body.inverse();
        coupling.suit(&stiffness(haptic, &room_from_handle, touch), bearable / haptic.damping.max(1e-9));
        let motion = tool_motion(haptic, &room_from_handle, touch);
        let spring = motion * coupling.compliance * motion.transpose() * (haptic.force / haptic.motion);
        touch.soften(&spring, coupling.stiffer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{TouchPoint, contact_axes, se3};
    use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

    /// A device with axes and a scale of its own whose tool stands off the handle: the push is minus the slope of the energy by the
    /// handle's motion, and changes by the stiffness.
    #[test]
    fn the_push_of_a_tool_is_the_slope_of_its_energy() {
        let mut haptic = Haptic::simulated("turned");
        (haptic.force, haptic.motion) = (0.5, 3.0);
        haptic.room_from_device = Isometry3::new(Vector3::new(0.1, 0.9, 0.3), Vector3::new(0.3, -0.5, 1.0));
        haptic.sensor_from_body = Isometry3::new(Vector3::new(0.01, 0.02, 0.0), Vector3::new(0.0, 0.2, 0.0));
        let handle = Isometry3::new(Vector3::new(0.02, -0.01, 0.03), Vector3::new(0.1, 0.4, -0.2));
        let room_from_handle = super::super::grasp::room_from_handle(&haptic, &handle);
        let stylus = room_from_handle * haptic.sensor_from_body;
        let tool = stylus * Isometry3::translation(0.0, 0.0, -0.1);
        let normals = [Vector3::y(), Vector3::new(1.0, 0.2, 0.0), Vector3::new(-0.3, 0.5, 1.0)];
        let points: Vec<TouchPoint> = (0..3)
            .map(|i| {
                let axes = contact_axes(&normals[i].normalize());
                let force = axes * Vector3::new(1.0 + i as f64, 0.1, -0.2);
                let arm = Vector3::new(0.01 * i as f64, 0.02, -0.01 * (i * i) as f64);
                TouchPoint { arm, axes, friction: 2.0, force, gap: 0.0, limit: f64::INFINITY }
            })
            .collect();
        let compliance = |i: usize, j: usize| Matrix3::identity() * if i == j { 1.5e-3 } else { 5e-4 };
        let touch = TouchPotential::new((0, stylus, tool), &points, &compliance);
        let scale = Bond::Tool.energy_scale(&haptic);
        let at = |moved: &Vector6<f64>| {
            let (v, w) = se3::halves(moved);
            let turn = UnitQuaternion::from_scaled_axis(w) * handle.rotation;
            let moved = Isometry3::from_parts((handle.translation.vector + v).into(), turn);
            touched(&haptic, &super::super::grasp::room_from_handle(&haptic, &moved), &touch)
        };
        let here = at(&Vector6::zeros());
        let sum: Vector3<f64> = points.iter().map(|point| -point.force).sum();
        let expected = haptic.room_from_device.rotation.inverse() * sum * haptic.force;
        assert!((here.push.force - expected).norm() < 1e-9, "{here:?}");
        let found = stiffness(&haptic, &room_from_handle, &touch);
        let step = 1e-7;
        for k in 0..6 {
            let mut moved = Vector6::zeros();
            moved[k] = step;
            let (ahead, behind) = (at(&moved), at(&-moved));
            let slope = scale * (ahead.energy - behind.energy) / (2.0 * step);
            assert!((slope + here.push.stacked()[k]).abs() < 1e-5, "{k}: {slope} {:?}", here.push);
            // The torque also changes because the arms turn.
            let change = (behind.push.stacked() - ahead.push.stacked()) / (2.0 * step);
            let (own, whole) = (found.column(k), found.norm());
            let rows = if k < 3 { 6 } else { 3 };
            let off = (change.rows(0, rows) - own.rows(0, rows)).norm();
            assert!(off < 2e-2 * whole, "{k}: {change} {own}");
        }
    }
}
