//! The rotations in matrices: the nearest one, and the one that continues the last.
//!
//! In: the matrix M of a control element, or a sum of such. Out: its polar factor where that is defined, as the quaternion of
//! the two whose sign goes on from the one before.

use super::pose::ControlPose;
use crate::fem::Polar;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The mean rotation is not defined where σ₂ + σ₃ of A vanishes (two elements half a turn apart), nor the mean of turns
/// where that of their quaternions does (a turn apart); below this part of σ₁, or of 1, the last one is kept.
pub const DEFINED: f64 = 0.1;

/// Whether A defines the rotation R at which tr(AᵀR) is stationary, by the eigenvalues β of RᵀA: the second derivatives
/// tr(RᵀA) I - RᵀA have the eigenvalues β_i + β_j, none of which may vanish. Where R is the polar factor, β are the σ.
pub fn is_mean_defined(beta: &Vector3<f64>) -> bool {
    let least =
        [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (beta[i] + beta[j]).abs()).into_iter().fold(f64::MAX, f64::min);
    least >= DEFINED * beta.amax() && beta.amax() > 0.0
}

/// The rotation in each M, as the quaternion of the two that continues `last`; without a last one, the shorter turn.
pub fn unwrapped(last: Option<&[UnitQuaternion<f64>]>, poses: &[ControlPose]) -> Vec<UnitQuaternion<f64>> {
    let before = |e: usize| last.and_then(|last| last.get(e));
    poses.iter().enumerate().map(|(e, pose)| continued(before(e), &pose.matrix)).collect()
}

/// The rotation in M, as the quaternion of the two that continues `before`; without one before, the shorter turn.
pub fn continued(before: Option<&UnitQuaternion<f64>>, m: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let Some(now) = nearest(m).map(|rotation| UnitQuaternion::from_rotation_matrix(&rotation)) else {
        return before.copied().unwrap_or_else(UnitQuaternion::identity);
    };
    let goes_on = before.map_or(now.w, |before| now.coords.dot(&before.coords)) >= 0.0;
    if goes_on { now } else { UnitQuaternion::new_unchecked(-now.into_inner()) }
}

/// The rotation nearest to A, or `None` where it is not defined.
pub fn nearest(a: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    let [(nearest, beta), ..] = stationary(a)?;
    is_mean_defined(&beta).then_some(nearest)
}

/// The rotations at which tr(AᵀR) is stationary: the polar factor of A, which is the nearest to it, and those with two
/// of its signs turned; and the eigenvalues of RᵀA. `None` where A is not finite.
pub fn stationary(a: &Matrix3<f64>) -> Option<[(Rotation3<f64>, Vector3<f64>); 4]> {
    let polar = Polar::of(a)?;
    let sign = polar.sign;
    let signs = [[1.0, 1.0, sign], [1.0, -1.0, -sign], [-1.0, 1.0, -sign], [-1.0, -1.0, sign]];
    Some(signs.map(|signs| (polar.with_signs(signs), polar.sigma.component_mul(&Vector3::from(signs)))))
}
