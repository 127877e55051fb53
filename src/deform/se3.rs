//! Rigid motions and their screws ξ = (v, ω) ∈ R⁶: exponential, logarithm, and the derivative of the logarithm.
//!
//! ```text
//! exp ξ = (exp [ω], V v)     V(ω) = I + (1 - cos θ)/θ² [ω] + (θ - sin θ)/θ³ [ω]²     θ = |ω|
//! log(g exp δ) = ξ + J⁻¹(ξ) δ + …     log(exp(-μ) g) = ξ - J⁻¹(-ξ)… = ξ - L⁻¹(ξ) μ + …     g = exp ξ
//! L⁻¹ = I - ½ ad + a ad² + b ad⁴      J⁻¹(ξ) = L⁻¹(-ξ)      ad = [[ω], [v]; 0, [ω]]
//! a = 2/θ² + (θ + 3 sin θ)/(4θ (cos θ - 1))      b = 1/θ⁴ + (θ + sin θ)/(4θ³ (cos θ - 1))
//! ```
//!
//! (Murray, Li and Sastry, A Mathematical Introduction to Robotic Manipulation, section 2.3; F. Bullo and R. Murray, Proc.
//! European Control Conference 1995, 1091-1097, for the last two lines.) Defined up to θ < 2π.

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// θ² below which the coefficients are summed as series, which are exact to 1e-15 there.
const SERIES: f64 = 0.04;

/// V(ω).
pub fn slide_matrix(turn: &Vector3<f64>) -> Matrix3<f64> {
    let (square, cross) = (turn.norm_squared(), turn.cross_matrix());
    let (first, second) = if square < 1e-4 {
        (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0)
    } else {
        let angle = square.sqrt();
        ((1.0 - angle.cos()) / square, (angle - angle.sin()) / (angle * square))
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

/// V(ω)⁻¹; its singularity is at θ = 2π.
pub fn inverse_slide_matrix(turn: &Vector3<f64>) -> Matrix3<f64> {
    let (square, cross) = (turn.norm_squared(), turn.cross_matrix());
    let second = if square < SERIES {
        1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30_240.0 + square * (1.0 / 1_209_600.0)))
    } else {
        let half = 0.5 * square.sqrt();
        (1.0 - half * half.cos() / half.sin()) / square
    };
    Matrix3::identity() - cross * 0.5 + cross * cross * second
}

/// exp ξ.
pub fn exp(screw: &Vector6<f64>) -> Isometry3<f64> {
    let (slide, turn) = halves(screw);
    let place = slide_matrix(&turn) * slide;
    Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_scaled_axis(turn))
}

/// ξ of the rotation q and the translation t, where the sign of q distinguishes turns up to 360° from those the other way round.
pub fn log(rotation: &UnitQuaternion<f64>, translation: &Vector3<f64>) -> Vector6<f64> {
    let turn = long_turn(rotation);
    let slide = inverse_slide_matrix(&turn) * translation;
    Vector6::new(slide.x, slide.y, slide.z, turn.x, turn.y, turn.z)
}

/// The rotation vector of q with |ω| up to 2π, by the sign of q.
pub fn long_turn(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (imag, real) = (rotation.imag(), rotation.w);
    let sine = imag.norm();
    // Near no turn, 2 asin(s)/s → 2.
    if sine < 1e-9 && real > 0.0 {
        return imag * 2.0;
    }
    imag * (2.0 * sine.atan2(real) / sine.max(f64::MIN_POSITIVE))
}

/// L⁻¹(ξ).
pub fn inverse_left_jacobian(screw: &Vector6<f64>) -> Matrix6<f64> {
    let ad = adjoint(screw);
    let square = screw.fixed_rows::<3>(3).norm_squared();
    let (a, b) = if square < SERIES {
        let q = square;
        // Bernoulli's numbers over factorials, with ad⁵ = -2θ² ad³ - θ⁴ ad.
        let a =
            1.0 / 12.0 - q * q / 30_240.0 - q.powi(3) * 2.0 / 1_209_600.0 - q.powi(4) * 3.0 / 47_900_160.0;
        let b =
            -1.0 / 720.0 - q * 2.0 / 30_240.0 - q * q * 3.0 / 1_209_600.0 - q.powi(3) * 4.0 / 47_900_160.0;
        (a, b)
    } else {
        let angle = square.sqrt();
        let (sine, cosine) = angle.sin_cos();
        let a = 2.0 / square + (angle + 3.0 * sine) / (4.0 * angle * (cosine - 1.0));
        let b = 1.0 / (square * square) + (angle + sine) / (4.0 * angle * square * (cosine - 1.0));
        (a, b)
    };
    let ad2 = ad * ad;
    Matrix6::identity() - ad * 0.5 + ad2 * a + ad2 * ad2 * b
}

/// J⁻¹(ξ).
pub fn inverse_right_jacobian(screw: &Vector6<f64>) -> Matrix6<f64> {
    inverse_left_jacobian(&-screw)
}

fn adjoint(screw: &Vector6<f64>) -> Matrix6<f64> {
    let (slide, turn) = halves(screw);
    let mut ad = Matrix6::zeros();
    ad.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn.cross_matrix());
    ad.fixed_view_mut::<3, 3>(0, 3).copy_from(&slide.cross_matrix());
    ad.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn.cross_matrix());
    ad
}

/// (v, ω) in one vector.
pub fn joined(first: &Vector3<f64>, second: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(first.x, first.y, first.z, second.x, second.y, second.z)
}

/// (v, ω).
pub fn halves(screw: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (screw.fixed_rows::<3>(0).into_owned(), screw.fixed_rows::<3>(3).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn screws() -> Vec<Vector6<f64>> {
        [1e-7, 1e-3, 0.15, 0.25, 1.0, 2.5, 3.1, 4.0, 5.5]
            .map(|angle| {
                let turn = Vector3::new(0.4, -1.1, 2.0).normalize() * angle;
                Vector6::new(0.3, -2.0, 0.7, turn.x, turn.y, turn.z)
            })
            .to_vec()
    }

    /// Rotation and translation of a screw, whose quaternion keeps the whole turn.
    fn parts(screw: &Vector6<f64>) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let turn = screw.fixed_rows::<3>(3).into_owned();
        let half = 0.5 * turn.norm();
        let imag = turn.normalize() * half.sin();
        let long = nalgebra::Quaternion::new(half.cos(), imag.x, imag.y, imag.z);
        (UnitQuaternion::new_unchecked(long), exp(screw).translation.vector)
    }

    #[test]
    fn a_screw_comes_back_from_its_motion_up_to_a_turn() {
        for screw in screws() {
            let (rotation, translation) = parts(&screw);
            let back = log(&rotation, &translation);
            assert!((back - screw).amax() < 1e-12, "{screw} {back}");
        }
    }

    /// Both derivatives of the logarithm against central differences.
    #[test]
    fn the_logarithm_has_these_derivatives() {
        for screw in screws().into_iter().filter(|screw| screw.fixed_rows::<3>(3).norm() < 3.0) {
            let (motion, step) = (exp(&screw), 1e-6);
            let of = |motion: Isometry3<f64>| log(&motion.rotation, &motion.translation.vector);
            for k in 0..6 {
                let mut by = Vector6::zeros();
                by[k] = step;
                let right = (of(motion * exp(&by)) - of(motion * exp(&-by))) / (2.0 * step);
                let left = (of(exp(&by) * motion) - of(exp(&-by) * motion)) / (2.0 * step);
                let off = (right - inverse_right_jacobian(&screw).column(k)).amax();
                let off_left = (left - inverse_left_jacobian(&screw).column(k)).amax();
                assert!(off.max(off_left) < 1e-8, "{screw} {k}: {off:e} {off_left:e}");
            }
        }
    }
}
