//! The mean of the control elements' frames in SE(3), and how forces go through it.
//!
//! In: frames g_e = (R_e, p_e). Out: m with Σ_e log(m⁻¹ g_e) = 0, and the slopes of a scalar by the frames from that by m:
//!
//! ```text
//! ξ_e = log(m⁻¹ g_e)     g_e → g_e exp δ_e  ⇒  m → m exp η,   (Σ L⁻¹(ξ_e)) η = Σ J⁻¹(ξ_e) δ_e
//! ```
//!
//! (Karcher's mean; the derivatives of the logarithm are those of [`super::se3`].) Of two elements m is the middle of the
//! screw motion between them.

use super::frames::ControlFrame;
use super::se3::{exp, halves, inverse_left_jacobian, inverse_right_jacobian, log};
use nalgebra::{Isometry3, Matrix6, Quaternion, UnitQuaternion, Vector3, Vector4, Vector6};

/// The mean turn is not defined where the sum of E quaternions is shorter than this part of E.
const DEFINED: f64 = 0.1;
/// The mean is found when a step is smaller than this, rad, or part of the places.
const STEP: f64 = 1e-13;
const MOST_STEPS: usize = 30;

/// m of the last frames that had one.
#[derive(Clone, Debug)]
pub struct MeanFrame {
    pub body_from_mean: Isometry3<f64>,
    /// ξ_e.
    pub screws: Vec<Vector6<f64>>,
}

impl MeanFrame {
    pub fn new(elements: usize) -> MeanFrame {
        MeanFrame { body_from_mean: Isometry3::identity(), screws: vec![Vector6::zeros(); elements] }
    }

    /// Finds m of as many frames; `None` where they have none.
    pub fn find(&mut self, frames: &[ControlFrame]) -> Option<()> {
        let count = frames.len() as f64;
        let sum: Vector4<f64> = frames.iter().map(|frame| frame.turn.coords).sum();
        let rotation = UnitQuaternion::try_new(Quaternion::from(sum / count), DEFINED)?;
        let place = frames.iter().map(|frame| frame.place).sum::<Vector3<f64>>() / count;
        let size = frames.iter().map(|frame| (frame.place - place).norm().max(place.norm()));
        let size = size.fold(f64::MIN_POSITIVE, f64::max);
        let mut mean = Isometry3::from_parts(place.into(), rotation);
        for _ in 0..MOST_STEPS {
            let (mut rest, mut sum) = (Vector6::zeros(), Matrix6::zeros());
            for (screw, frame) in self.screws.iter_mut().zip(frames) {
                let inverse = mean.rotation.inverse();
                *screw = log(&(inverse * frame.turn), &(inverse * (frame.place - mean.translation.vector)));
                rest += *screw;
                sum += inverse_left_jacobian(screw);
            }
            let step = sum.lu().solve(&rest)?;
            let (slide, turn) = halves(&step);
            if turn.norm() <= STEP && slide.norm() <= STEP * size {
                self.body_from_mean = mean;
                return Some(());
            }
            mean *= exp(&step);
        }
        None
    }

    /// λ with which a slope `common` by m's own motion exp η is shared: that by δ_e is J⁻¹(ξ_e)ᵀ λ ([`MeanFrame::own_share`]).
    pub fn share(&self, common: &Vector6<f64>) -> Option<Vector6<f64>> {
        let sum: Matrix6<f64> = self.screws.iter().map(inverse_left_jacobian).sum();
        sum.transpose().lu().solve(common)
    }

    /// Force and torque in the axes of element `e`.
    pub fn own_share(&self, e: usize, share: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
        halves(&(inverse_right_jacobian(&self.screws[e]).transpose() * share))
    }
}
