//! The mean of frames in SE(3): what a body's control elements have in common, and how it moves with them.
//!
//! In: frames g_e = (R_e, p_e). Out: m̂ with Σ_e log(m̂⁻¹ g_e) = 0, and its derivative:
//!
//! ```text
//! ξ_e = log(m̂⁻¹ g_e)      g_e → g_e exp(δ_e)  ⇒  m̂ → m̂ exp(η)      (Σ_e J_l(ξ_e)⁻¹) η = Σ_e J_r(ξ_e)⁻¹ δ_e
//! ```
//!
//! (Karcher's mean; J of Müller, Proc. R. Soc. A 477, 2021, 20210303, equations 2.34 to 2.36.) Of two frames m̂ is the middle of
//! the screw between them, and the chord of a circular arc between them has no strain in it.

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

/// A place and a turn, whose quaternion's sign tells 200° from -160°.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame3 {
    pub place: Vector3<f64>,
    pub turn: UnitQuaternion<f64>,
}

/// Beyond this angle between an element and the mean, rad, the mean is not told from others: 175°, 350° between two.
const LARGEST: f64 = 3.05;
/// Steps of the iteration for the mean turn; two elements need one.
const MOST_STEPS: usize = 50;
const CONVERGED: f64 = 1e-14;

impl Frame3 {
    /// Frame `other` as it is seen from this one.
    pub fn inverse_times(&self, other: &Frame3) -> Frame3 {
        let back = self.turn.inverse();
        Frame3 { place: back * (other.place - self.place), turn: back * other.turn }
    }

    /// The mean of `frames`, or `None` where it is not defined.
    pub fn mean(frames: &[Frame3]) -> Option<Frame3> {
        let count = frames.len() as f64;
        let sum = frames.iter().fold(nalgebra::Vector4::zeros(), |sum, frame| sum + frame.turn.coords);
        let mut turn = UnitQuaternion::try_new(nalgebra::Quaternion::from(sum / count), 1e-3)?;
        for _ in 0..MOST_STEPS {
            let step = frames.iter().fold(Vector3::zeros(), |sum, frame| {
                sum + rotation_vector(&(turn.inverse() * frame.turn))
            }) / count;
            turn *= UnitQuaternion::from_scaled_axis(step);
            if step.norm() <= CONVERGED {
                break;
            }
        }
        // The logarithm's first part is linear in the mean's place: Σ V(ω_e)⁻¹ R̂ᵀ (p_e - p̂) = 0.
        let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for frame in frames {
            let relative = turn.inverse() * frame.turn;
            let omega = rotation_vector(&relative);
            if omega.norm() > LARGEST {
                return None;
            }
            let inverse = slide_inverse(&omega);
            matrix += inverse;
            right += inverse * (turn.inverse() * frame.place);
        }
        Some(Frame3 { place: turn * matrix.lu().solve(&right)?, turn })
    }

    /// log: (v, ω), the slide first.
    pub fn logarithm(&self) -> Vector6<f64> {
        let omega = rotation_vector(&self.turn);
        let slide = slide_inverse(&omega) * self.place;
        Vector6::new(slide.x, slide.y, slide.z, omega.x, omega.y, omega.z)
    }

    /// exp of (v, ω).
    pub fn exponential(screw: &Vector6<f64>) -> Frame3 {
        let (slide, omega) = halves(screw);
        let (square, cross) = (omega.norm_squared(), omega.cross_matrix());
        let (first, second) = if square < 1e-4 {
            (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0)
        } else {
            let angle = square.sqrt();
            ((1.0 - angle.cos()) / square, (angle - angle.sin()) / (angle * square))
        };
        let place = slide + cross * slide * first + cross * (cross * slide) * second;
        Frame3 { place, turn: UnitQuaternion::from_scaled_axis(omega) }
    }
}

/// The rotation vector of a quaternion as it is signed: up to 2π long.
fn rotation_vector(turn: &UnitQuaternion<f64>) -> Vector3<f64> {
    let axis = turn.imag();
    let sine = axis.norm();
    if sine < 1e-9 && turn.w > 0.0 {
        return axis * 2.0;
    }
    let angle = 2.0 * sine.atan2(turn.w);
    if sine == 0.0 { Vector3::x() * angle } else { axis * (angle / sine) }
}

/// V(ω)⁻¹ = I - ½ ω̂ + (1 - α)/θ² ω̂², α = θ/2 cot θ/2.
fn slide_inverse(omega: &Vector3<f64>) -> Matrix3<f64> {
    let cross = omega.cross_matrix();
    Matrix3::identity() - cross * 0.5 + cross * cross * cotangent_terms(omega.norm_squared()).0
}

/// (1 - α)/θ², and those before ad² and ad⁴ in the inverse of the exponential's derivative.
fn cotangent_terms(square: f64) -> (f64, f64, f64) {
    if square < 1e-2 {
        let first = 1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1_209_600.0));
        let fourth = -1.0 / 720.0 - square * (1.0 / 15120.0 + square * 3.0 / 1_209_600.0);
        return (first, first + fourth * square, fourth);
    }
    let half = 0.5 * square.sqrt();
    let (alpha, beta) = (half / half.tan(), (half / half.sin()).powi(2));
    let rest = 1.0 - alpha + 0.5 * (alpha - beta);
    ((1.0 - alpha) / square, (1.0 - alpha + rest) / square, rest / (square * square))
}

pub fn halves(six: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (six.fixed_rows::<3>(0).into_owned(), six.fixed_rows::<3>(3).into_owned())
}

/// J_l(ξ)⁻¹ for `sign` = 1, J_r(ξ)⁻¹ for -1.
fn inverse_derivative(screw: &Vector6<f64>, sign: f64) -> Matrix6<f64> {
    let (slide, omega) = halves(screw);
    let mut ad = Matrix6::zeros();
    ad.fixed_view_mut::<3, 3>(0, 0).copy_from(&omega.cross_matrix());
    ad.fixed_view_mut::<3, 3>(3, 3).copy_from(&omega.cross_matrix());
    ad.fixed_view_mut::<3, 3>(0, 3).copy_from(&slide.cross_matrix());
    let square = ad * ad;
    let (_, second, fourth) = cotangent_terms(omega.norm_squared());
    Matrix6::identity() - ad * (0.5 * sign) + square * second + square * square * fourth
}

/// Given the slope of a scalar against the mean's own motion exp(η), adds what it makes of the slopes against those of the
/// elements, exp(δ_e): `screws` are ξ_e. `None` where the mean is not defined.
pub fn share_slope(
    screws: &[Vector6<f64>],
    slope: &Vector6<f64>,
    slopes: &mut [Vector6<f64>],
) -> Option<()> {
    let sum = screws.iter().fold(Matrix6::zeros(), |sum, screw| sum + inverse_derivative(screw, 1.0));
    let share = sum.transpose().lu().solve(slope)?;
    for (own, screw) in slopes.iter_mut().zip(screws) {
        *own += inverse_derivative(screw, -1.0).transpose() * share;
    }
    Some(())
}
