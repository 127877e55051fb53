//! Force and torque that a hand must apply to hold a control element, from the slope of the energy.

use super::frames::{PoseSlope, axial};
use super::pose::ControlPose;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Force and moment that hold a control element where it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wrench {
    /// N.
    #[serde(with = "crate::field::numbers")]
    pub force: Vector3<f64>,
    /// Moment about where the element's origin rested, N·m, with the lever arms of the deformed body.
    #[serde(with = "crate::field::numbers")]
    pub moment: Vector3<f64>,
}

impl Wrench {
    /// The wrench that does the work ∂V in every rigid motion of the element from `pose`: a turn by δω about the origin o moves T
    /// by δω × T and M by \[δω\] M.
    pub fn of(slope: &PoseSlope, pose: &ControlPose) -> Wrench {
        let force = slope.translation;
        let moment = axial(&(slope.matrix * pose.matrix.transpose())) + pose.translation.cross(&force);
        Wrench { force, moment }
    }

    /// The wrench that holds the element in the theory of small strain, which writes equilibrium on the body at rest: whatever
    /// the pose, with the moment about where its origin rested.
    pub fn of_small_strain(slope: &PoseSlope) -> Wrench {
        Wrench::of(slope, &ControlPose::REST)
    }

    /// This wrench with the moment about where the element's origin is at `pose`.
    pub fn about_the_place(&self, pose: &ControlPose) -> Wrench {
        self.about(&Vector3::zeros(), pose)
    }

    /// This wrench with the moment about where `pose` brings a point; `arm` leads from the point to the element's origin at rest.
    pub fn about(&self, arm: &Vector3<f64>, pose: &ControlPose) -> Wrench {
        Wrench { moment: self.moment + (arm - pose.translation).cross(&self.force), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    /// A force at a place y from the origin of an element that is turned and moved.
    #[test]
    fn one_force_on_a_lever_gives_its_moment() {
        let (f, y) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 0.1, -0.7));
        let matrix = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.2);
        let pose = ControlPose { translation: Vector3::new(0.4, -0.2, 1.0), matrix };
        let wrench = Wrench::of(&PoseSlope { translation: f, matrix: f * y.transpose() }, &pose);
        let arm = pose.translation + matrix * y;
        assert!((wrench.force - f).norm() < 1e-15 && (wrench.moment - arm.cross(&f)).norm() < 1e-15);
    }
}
