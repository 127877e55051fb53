//! What the frame tells the loop: which element is held and how, and where the others are.

use super::coupling::Lever;
use super::device::Push;
use super::elastic::{Response, axial};
use crate::deform::ControlPose;
use crate::stage::Haptic;
use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Similarity3, Vector3};

/// The newest of these is handed to the loop in every frame.
#[derive(Clone, Debug, Default)]
pub struct Grasp {
    /// `None`: nothing is held, or it is held in a way whose force is not known.
    pub held: Option<Held>,
    /// Poses of all control elements of the held body.
    pub poses: Vec<ControlPose>,
    /// Where a simulated device's hand is, in the room.
    pub room_from_hand: Option<Isometry3<f64>>,
}

/// A stylus' hold on one control element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Number of the grab: another number is another hold.
    pub grip: u64,
    /// Of the loop's bodies.
    pub body: usize,
    pub element: usize,
    pub room_from_body: Similarity3<f64>,
    /// stylus(grab)⁻¹ · room_from_element(grab): room_from_element = room_from_handle · this.
    pub handle_from_element: Matrix4<f64>,
    /// Rotation of the whole body in the frame, where the loop starts to follow it.
    pub mean: Rotation3<f64>,
}

/// The stylus in the room of a device's handle: translations times `motion`.
pub fn room_from_handle(haptic: &Haptic, device_from_handle: &Isometry3<f64>) -> Isometry3<f64> {
    let mut scaled = *device_from_handle;
    scaled.translation.vector *= haptic.motion;
    haptic.room_from_device * scaled
}

/// The handle of a stylus in the room; the inverse of [`room_from_handle`].
pub fn device_from_handle(haptic: &Haptic, room_from_handle: &Isometry3<f64>) -> Isometry3<f64> {
    let mut pose = haptic.room_from_device.inv_mul(room_from_handle);
    pose.translation.vector /= haptic.motion;
    pose
}

/// The held element with the stylus at a place.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Its pose in the body.
    pub pose: ControlPose,
    /// From the stylus' origin to the element's, in the room, m.
    pub arm: Vector3<f64>,
}

impl Held {
    /// Where the element is while the stylus is at `room_from_handle`.
    pub fn reach(&self, room_from_handle: &Isometry3<f64>, origin: &Vector3<f64>) -> Reach {
        let element = self.handle_from_element;
        let matrix = room_from_handle.rotation.to_rotation_matrix() * element.fixed_view::<3, 3>(0, 0);
        let arm = room_from_handle.rotation * element.fixed_view::<3, 1>(0, 3).into_owned();
        let place = room_from_handle.translation.vector + arm;
        let body = &self.room_from_body;
        let turn = body.isometry.rotation.to_rotation_matrix().matrix().transpose() / body.scaling();
        let translation = turn * (place - body.isometry.translation.vector) - origin;
        Reach { pose: ControlPose { translation, matrix: turn * matrix }, arm }
    }

    /// What the body pushes the hand with, in the device's frame: minus the slope of its energy, by virtual work. A newton
    /// of the body is `force` newtons in the hand; the torque is what belongs to that, so that no energy is made on the way.
    pub fn push(&self, haptic: &Haptic, reach: &Reach, response: &Response) -> Push {
        let rotation = &self.room_from_body.isometry.rotation;
        let force = rotation * response.slope;
        let moment = rotation * axial(&(response.slope_matrix * reach.pose.matrix.transpose()));
        let torque = reach.arm.cross(&force) + moment * self.room_from_body.scaling();
        let device_from_room = haptic.room_from_device.rotation.inverse();
        Push {
            force: device_from_room * force * -haptic.force,
            torque: device_from_room * torque * (-haptic.force / haptic.motion),
        }
    }

    /// Joules in the hand for a joule of the body.
    pub fn energy_scale(&self, haptic: &Haptic) -> f64 {
        haptic.force * self.room_from_body.scaling() / haptic.motion
    }

    /// How the handle's motion moves the element, in the frame of the body's mean rotation now.
    pub fn lever(&self, haptic: &Haptic, reach: &Reach, mean: &Rotation3<f64>) -> Lever {
        let room = haptic.room_from_device.rotation.to_rotation_matrix();
        let body = self.room_from_body.isometry.rotation.to_rotation_matrix();
        let surface_from_room = mean.inverse() * body.inverse();
        let scale = 1.0 / self.room_from_body.scaling();
        let turn: Matrix3<f64> = *(surface_from_room * room).matrix();
        Lever {
            translation_from_v: turn * (haptic.motion * scale),
            translation_from_w: -(surface_from_room.matrix() * reach.arm.cross_matrix() * room.matrix())
                * scale,
            turn_from_w: turn,
            matrix: mean.inverse() * reach.pose.matrix,
        }
    }
}
