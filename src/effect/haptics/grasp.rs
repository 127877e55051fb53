//! What the frame tells the loop: which element is held and how, and where the others are.

use super::coupling::Jacobian;
use super::device::Push;
use super::elastic::{Response, axial};
use crate::deform::ControlPose;
use crate::interact::Carrying;
use crate::stage::Haptic;
use nalgebra::{
    Isometry3, Matrix3, Matrix4, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3, Vector6,
};

/// The newest of these is handed to the loop in every frame.
#[derive(Clone, Debug, Default)]
pub struct Grasp {
    /// `None`: nothing is held, or it does not go where the hand wants it.
    pub held: Option<Held>,
    /// Poses of all control elements of the held body.
    pub poses: Vec<ControlPose>,
    /// Where a simulated device's hand is, in the room.
    pub room_from_hand: Option<Isometry3<f64>>,
}

/// A handle's hold on one control element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Number of the grab: another number is another hold.
    pub grip: u64,
    /// Of the loop's bodies.
    pub body: usize,
    pub element: usize,
    pub room_from_body: Similarity3<f64>,
    pub constraint: HoldConstraint,
    /// Rotation of the whole body in the frame, where the loop starts to follow it.
    pub mean: Rotation3<f64>,
}

/// How the element goes with the handle.
#[allow(clippy::large_enum_variant, reason = "both are copied through a triple buffer, without a heap")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldConstraint {
    /// One hand, freely: handle(grab)⁻¹ · room_from_element(grab), and room_from_element = room_from_handle · this.
    Rigid(Matrix4<f64>),
    /// By a mode, with a second hand, or scaled: what the hold makes of the stylus' pose.
    Carried { carrying: Carrying, handle_from_stylus: Isometry3<f64> },
}

/// Half the difference of the handle's pose, m and rad, over which a slope along [`HoldConstraint::Carried`] is taken: for hands 0.1 m
/// apart it is off by less than a millionth.
const STEP: f64 = 1e-4;

/// A device's handle in the room: translations times `motion`.
pub fn room_from_handle(haptic: &Haptic, device_from_handle: &Isometry3<f64>) -> Isometry3<f64> {
    let mut scaled = *device_from_handle;
    scaled.translation.vector *= haptic.motion;
    haptic.room_from_device * scaled
}

/// What the device tells of a handle in the room; the inverse of [`room_from_handle`].
pub fn device_from_handle(haptic: &Haptic, room_from_handle: &Isometry3<f64>) -> Isometry3<f64> {
    let mut pose = haptic.room_from_device.inv_mul(room_from_handle);
    pose.translation.vector /= haptic.motion;
    pose
}

/// The held element with the handle at a place.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    pub room_from_handle: Isometry3<f64>,
    /// From the body's frame: the element's origin at rest.
    pub origin: Vector3<f64>,
    /// Its pose in the body.
    pub pose: ControlPose,
    /// From the handle's origin to the element's, in the room, m.
    pub arm: Vector3<f64>,
}

impl HoldConstraint {
    /// room_from_element with the handle at a place; `None` where the hold says nothing of it.
    fn element(&self, room_from_handle: &Isometry3<f64>) -> Option<Matrix4<f64>> {
        match self {
            HoldConstraint::Rigid(handle_from_element) => {
                let rotation = room_from_handle.rotation.to_rotation_matrix();
                let mut element = *handle_from_element;
                let linear = rotation * element.fixed_view::<3, 3>(0, 0);
                let place = room_from_handle.rotation * element.fixed_view::<3, 1>(0, 3).into_owned();
                element.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
                element
                    .fixed_view_mut::<3, 1>(0, 3)
                    .copy_from(&(room_from_handle.translation.vector + place));
                Some(element)
            }
            HoldConstraint::Carried { carrying, handle_from_stylus } => {
                carrying.at(&(room_from_handle * handle_from_stylus))
            }
        }
    }

    /// Slopes of the element's origin and of its linear part along direction `k` of (v, ω), in the room.
    fn slope(&self, room_from_handle: &Isometry3<f64>, k: usize) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let moved = |by: f64| {
            let mut motion = Vector6::<f64>::zeros();
            motion[k] = by;
            let place = room_from_handle.translation.vector + motion.fixed_rows::<3>(0);
            let turn = UnitQuaternion::from_scaled_axis(motion.fixed_rows::<3>(3).into_owned());
            let handle = Isometry3::from_parts(Translation3::from(place), turn * room_from_handle.rotation);
            self.element(&handle)
        };
        let slope = (moved(STEP)? - moved(-STEP)?) / (2.0 * STEP);
        Some((slope.fixed_view::<3, 1>(0, 3).into_owned(), slope.fixed_view::<3, 3>(0, 0).into_owned()))
    }
}

impl Held {
    /// Where the element is while the handle is at `room_from_handle`; `None` where nothing is known of it.
    pub fn reach(&self, room_from_handle: &Isometry3<f64>, origin: &Vector3<f64>) -> Option<Reach> {
        let element = self.constraint.element(room_from_handle)?;
        let (room_from_handle, origin) = (*room_from_handle, *origin);
        let place = element.fixed_view::<3, 1>(0, 3).into_owned();
        let body = &self.room_from_body;
        let turn = self.body_from_room();
        let translation = turn * (place - body.isometry.translation.vector) - origin;
        let pose = ControlPose { translation, matrix: turn * element.fixed_view::<3, 3>(0, 0) };
        Some(Reach { pose, arm: place - room_from_handle.translation.vector, room_from_handle, origin })
    }

    fn body_from_room(&self) -> Matrix3<f64> {
        let body = &self.room_from_body;
        body.isometry.rotation.to_rotation_matrix().matrix().transpose() / body.scaling()
    }

    /// What the body pushes the hand with, in the device's frame: minus the slope of its energy, by virtual work. A newton
    /// of the body is `force` newtons in the hand; the torque is what belongs to that, so that no energy is made on the way.
    pub fn push(&self, haptic: &Haptic, reach: &Reach, response: &Response) -> Option<Push> {
        let body = &self.room_from_body;
        let [force, torque] = match &self.constraint {
            HoldConstraint::Rigid(_) => {
                let force = body.isometry.rotation * response.slope;
                let matrix = response.slope_matrix * reach.pose.matrix.transpose();
                let moment = body.isometry.rotation * axial(&matrix);
                [force, reach.arm.cross(&force) + moment * body.scaling()]
            }
            way @ HoldConstraint::Carried { .. } => {
                let body_from_room = self.body_from_room() * body.scaling();
                let work = |k: usize| {
                    let (origin, linear) = way.slope(&reach.room_from_handle, k)?;
                    let of_origin = response.slope.dot(&(body_from_room * origin));
                    Some(of_origin + response.slope_matrix.dot(&(body_from_room * linear)))
                };
                let three =
                    |first: usize| Some(Vector3::new(work(first)?, work(first + 1)?, work(first + 2)?));
                [three(0)?, three(3)?]
            }
        };
        let device_from_room = haptic.room_from_device.rotation.inverse();
        Some(Push {
            force: device_from_room * force * -haptic.force,
            torque: device_from_room * torque * (-haptic.force / haptic.motion),
        })
    }

    /// Joules in the hand for a joule of the body.
    pub fn energy_scale(&self, haptic: &Haptic) -> f64 {
        haptic.force * self.room_from_body.scaling() / haptic.motion
    }

    /// How the handle's motion moves the element's coefficients, in the frame of the body's mean rotation now.
    pub fn jacobian(&self, haptic: &Haptic, reach: &Reach, mean: &Rotation3<f64>) -> Option<Jacobian> {
        let surface_from_room = mean.matrix().transpose() * self.body_from_room();
        let room_from_device = haptic.room_from_device.rotation.to_rotation_matrix();
        let mut in_room = Jacobian::zeros();
        for k in 0..6 {
            let (origin, linear) = self.constraint.slope(&reach.room_from_handle, k)?;
            let (origin, linear) = (surface_from_room * origin, surface_from_room * linear);
            in_room.fixed_view_mut::<3, 1>(0, k).copy_from(&origin);
            for (i, slope) in linear.transpose().iter().enumerate() {
                in_room[(3 + i, k)] = *slope;
            }
        }
        // A metre of the device is `motion` metres of the handle in the room.
        let mut of_device = Jacobian::zeros();
        let (v, w) = (in_room.fixed_view::<12, 3>(0, 0), in_room.fixed_view::<12, 3>(0, 3));
        of_device.fixed_view_mut::<12, 3>(0, 0).copy_from(&(v * room_from_device.matrix() * haptic.motion));
        of_device.fixed_view_mut::<12, 3>(0, 3).copy_from(&(w * room_from_device.matrix()));
        Some(of_device)
    }
}
