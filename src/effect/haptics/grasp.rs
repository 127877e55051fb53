//! The data that a frame passes to the haptic loop: the held element, how it is held, and the poses of the others; or a tool's contacts.

use super::device::Push;
use super::elastic::ElasticResponse;
use crate::deform::{ControlPose, ElementPotential, TouchPotential, axial};
use crate::interact::Carrying;
use crate::stage::Haptic;
use nalgebra::{Isometry3, Matrix3, Matrix4, Similarity3, Translation3, UnitQuaternion, Vector3, Vector6};

/// Written in every frame; the loop takes the newest.
#[derive(Clone, Debug, Default)]
pub struct Grasp {
    /// `None` if nothing is held, or if the element does not follow the hand.
    pub held: Option<ElementHold>,
    /// Poses of all control elements of the held body.
    pub poses: Vec<ControlPose>,
    /// The turns that led to these poses.
    pub turns: Vec<UnitQuaternion<f64>>,
    /// Count of the body's ways home: another state may stand behind these poses after one.
    pub homecomings: u64,
    /// Energy that other effects add to that of the held element.
    pub added: Option<ElementPotential>,
    /// The contacts of the tool that the stylus carries, where it holds no element.
    pub touch: Option<TouchPotential>,
    /// The hand's pose in the room, for a simulated device.
    pub room_from_hand: Option<Isometry3<f64>>,
}

/// A handle's hold on one control element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementHold {
    /// The number of the grab; another number means another hold.
    pub grip: u64,
    /// Index into the loop's bodies.
    pub body: usize,
    pub element: usize,
    pub room_from_body: Similarity3<f64>,
    pub constraint: HoldConstraint,
}

/// Dependence of the held element's motion on the handle's.
#[allow(clippy::large_enum_variant, reason = "both are copied through a triple buffer, without a heap")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldConstraint {
    /// Held freely by one hand: handle(grab)⁻¹ · room_from_element(grab), so that room_from_element = room_from_handle ·
    /// this.
    Rigid(Matrix4<f64>),
    /// Held in a constraint mode, with a second hand, or scaled: a function of the stylus' pose.
    Carried { carrying: Carrying, handle_from_stylus: Isometry3<f64> },
}

/// The step of the central differences along [`HoldConstraint::Carried`], m and rad: for hands 0.1 m apart the error is
/// below a millionth.
const STEP: f64 = 1e-4;

/// The handle's pose in the room, with translations multiplied by `motion`.
pub fn room_from_handle(haptic: &Haptic, device_from_handle: &Isometry3<f64>) -> Isometry3<f64> {
    let mut scaled = *device_from_handle;
    scaled.translation.vector *= haptic.motion;
    haptic.room_from_device * scaled
}

/// The inverse of [`room_from_handle`].
pub fn device_from_handle(haptic: &Haptic, room_from_handle: &Isometry3<f64>) -> Isometry3<f64> {
    let mut pose = haptic.room_from_device.inv_mul(room_from_handle);
    pose.translation.vector /= haptic.motion;
    pose
}

/// The held element for a pose of the handle.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    pub room_from_handle: Isometry3<f64>,
    /// The element's origin at rest, in the body's frame.
    pub origin: Vector3<f64>,
    /// The element's pose in the body.
    pub pose: ControlPose,
    /// The vector from the handle's origin to the element's, in the room, m.
    pub arm: Vector3<f64>,
}

impl HoldConstraint {
    /// room_from_element for a pose of the handle; `None` if the hold does not define it.
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

    /// Derivatives of the element's origin and linear part along direction `k` of (v, ω), in the room.
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

impl ElementHold {
    /// The element while the handle is at `room_from_handle`; `None` if the hold does not define it.
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

    /// The body's push on the hand, in the device's frame: minus the gradient of its energy, by virtual work. A newton of the
    /// body becomes `force` newtons in the hand, and the torque is scaled to match, so that no energy is generated.
    pub fn push(&self, haptic: &Haptic, reach: &Reach, response: &ElasticResponse) -> Option<Push> {
        let body = &self.room_from_body;
        let [force, torque] = match &self.constraint {
            HoldConstraint::Rigid(_) => {
                let force = body.isometry.rotation * response.slope.translation;
                let matrix = response.slope.matrix * reach.pose.matrix.transpose();
                let moment = body.isometry.rotation * axial(&matrix);
                [force, reach.arm.cross(&force) + moment * body.scaling()]
            }
            way @ HoldConstraint::Carried { .. } => {
                let body_from_room = self.body_from_room() * body.scaling();
                let work = |k: usize| {
                    let (origin, linear) = way.slope(&reach.room_from_handle, k)?;
                    let of_origin = response.slope.translation.dot(&(body_from_room * origin));
                    Some(of_origin + response.slope.matrix.dot(&(body_from_room * linear)))
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

    /// Joules in the hand per joule of the body.
    pub fn energy_scale(&self, haptic: &Haptic) -> f64 {
        haptic.force * self.room_from_body.scaling() / haptic.motion
    }
}
