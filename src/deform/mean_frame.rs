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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    fn frames(count: usize) -> Vec<ControlFrame> {
        (0..count)
            .map(|e| {
                let x = e as f64;
                let turn = Vector3::new(0.4 * x, 0.9 - x, 0.3 * x * x);
                ControlFrame {
                    place: Vector3::new(2.0 * x, x.sin(), 0.5 - x),
                    turn: UnitQuaternion::from_scaled_axis(turn),
                    stretch: Matrix3::identity(),
                }
            })
            .collect()
    }

    fn moved(frame: &ControlFrame, by: &Vector6<f64>) -> ControlFrame {
        let step = Isometry3::from_parts(frame.place.into(), frame.turn) * exp(by);
        ControlFrame { place: step.translation.vector, turn: step.rotation, ..*frame }
    }

    /// Shares of a slope by the mean's motion are derivatives of the mean by each frame.
    #[test]
    fn the_mean_moves_with_its_frames_as_the_shares_say() {
        for count in [1, 2, 3, 4] {
            let frames = frames(count);
            let mut mean = MeanFrame::new(count);
            mean.find(&frames).unwrap();
            let sum: Vector6<f64> = mean.screws.iter().sum();
            assert!(sum.amax() < 1e-12, "{sum}");
            let rest = mean.body_from_mean;
            let slope = Vector6::new(0.3, -0.7, 0.2, 0.9, -0.4, 0.6);
            let share = mean.share(&slope).unwrap();
            let shares: Vec<_> = (0..count).map(|e| mean.own_share(e, &share)).collect();
            for e in 0..count {
                for k in 0..6 {
                    let mut along = |by: f64| {
                        let mut frames = frames.clone();
                        frames[e] = moved(&frames[e], &(Vector6::ith(k, by)));
                        mean.find(&frames).unwrap();
                        let change = rest.inverse() * mean.body_from_mean;
                        slope.dot(&log(&change.rotation, &change.translation.vector))
                    };
                    let expected = (along(1e-5) - along(-1e-5)) / 2e-5;
                    let found = if k < 3 { shares[e].0[k] } else { shares[e].1[k - 3] };
                    assert!((found - expected).abs() < 1e-8, "{count} {e} {k}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn half_a_turn_has_a_mean_and_a_whole_one_has_none() {
        let mut two = frames(2);
        two[0].turn = UnitQuaternion::identity();
        for (degrees, is_defined) in [(180.0_f64, true), (300.0, true), (359.0, false)] {
            let half = degrees.to_radians() / 2.0;
            let long = Quaternion::new(half.cos(), half.sin(), 0.0, 0.0);
            two[1].turn = UnitQuaternion::new_unchecked(long);
            assert_eq!(MeanFrame::new(2).find(&two).is_some(), is_defined, "{degrees}");
        }
    }
}
