//! Rigid motions and their screws ξ = (v, ω) ∈ R⁶: exponential, logarithm with its first and second derivatives, and means.
//!
//! ```text
//! exp ξ = (exp [ω], V v)     V(ω) = I + (1 - cos θ)/θ² [ω] + (θ - sin θ)/θ³ [ω]²     θ = |ω|     φ = θ²
//! log(exp(-μ) exp ξ exp δ) = ξ + J⁻¹ δ - L⁻¹ μ + …     J⁻¹ = E + ½ ad ξ     L⁻¹ = E - ½ ad ξ     ad ξ = | [ω] [v] |
//! E = I + α ad² ξ + β ad⁴ ξ     α = F - φ F'     β = -F'     F(φ) = (1 - θ/2 cot θ/2)/φ                  |  0  [ω] |
//! ```
//!
//! E is the even part of x/(1 - e⁻ˣ) at x = ad ξ, whose minimal polynomial is x (x² + φ)² (Murray, Li and Sastry, A Mathematical
//! Introduction to Robotic Manipulation, section 2.3; Selig, Geometric Fundamentals of Robotics, section 4.5; Sonneville, Cardona and
//! Brüls, CMAME 268, 2014). Defined up to θ < 2π.
//!
//! The mean of the control elements' frames ([`MeanFrame`]): of frames g_e = (R_e, p_e) the m with Σ_e log(m⁻¹ g_e) = 0, and the
//! slopes of a scalar by the frames from that by m:
//!
//! ```text
//! ξ_e = log(m⁻¹ g_e)     g_e → g_e exp δ_e  ⇒  m → m exp η,   (Σ L⁻¹(ξ_e)) η = Σ J⁻¹(ξ_e) δ_e
//! ```
//!
//! (Karcher's mean; the derivatives of the logarithm are those above.) Of two elements m is the middle of the
//! screw motion between them.

use super::frame::ControlFrame;
pub use crate::base::slide::slide_matrix;
use nalgebra::{
    Isometry3, Matrix3, Matrix6, Quaternion, Translation3, UnitQuaternion, Vector3, Vector4, Vector6,
};

/// Angle below which the series of F is shorter than its closed form, and more exact.
const SMALL: f64 = 0.6;

/// B₂ₖ/(2k)!, without signs: F(φ) = Σ `SERIES[k]` φᵏ.
const SERIES: [f64; 9] = [
    1.0 / 12.0,
    1.0 / 720.0,
    1.0 / 30_240.0,
    1.0 / 1_209_600.0,
    1.0 / 47_900_160.0,
    691.0 / 1_307_674_368_000.0,
    1.0 / 74_724_249_600.0,
    3_617.0 / 10_670_622_842_880_000.0,
    43_867.0 / 5_109_094_217_170_944_000.0,
];

/// F. Infinite at a whole turn.
fn bernoulli_value(square: f64) -> f64 {
    if square < SMALL * SMALL {
        return SERIES.iter().rev().fold(0.0, |sum, term| sum * square + term);
    }
    let half = 0.5 * square.sqrt();
    (1.0 - half / half.tan()) / square
}

/// F and its first two derivatives by φ. Infinite at a whole turn.
fn bernoulli(square: f64) -> [f64; 3] {
    if square < SMALL * SMALL {
        let mut sums = [0.0; 3];
        for (k, term) in SERIES.iter().enumerate().rev() {
            let k = k as f64;
            sums[0] = sums[0] * square + term;
            if k >= 1.0 {
                sums[1] = sums[1] * square + k * term;
            }
            if k >= 2.0 {
                sums[2] = sums[2] * square + k * (k - 1.0) * term;
            }
        }
        return sums;
    }
    let angle = square.sqrt();
    let cot = 1.0 / (0.5 * angle).tan();
    let csc = 1.0 + cot * cot;
    // G = θ/2 cot θ/2 = 1 - φ F, and G', G'' by φ.
    let even = 0.5 * angle * cot;
    let first = 0.25 * cot / angle - 0.125 * csc;
    let second = 0.0625 * (csc * cot / angle - csc / square - 2.0 * cot / (square * angle));
    let value = (1.0 - even) / square;
    let slope = -(first + value) / square;
    [value, slope, -(second + 2.0 * slope) / square]
}

/// V(ω)⁻¹; its singularity is at θ = 2π.
pub fn inverse_slide_matrix(turn: &Vector3<f64>) -> Matrix3<f64> {
    let (square, cross) = (turn.norm_squared(), turn.cross_matrix());
    Matrix3::identity() - cross * 0.5 + cross * cross * bernoulli_value(square)
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

/// log of the motion of a frame. The sign of its quaternion distinguishes turns up to 360° apart.
pub fn log_of(motion: &Isometry3<f64>) -> Vector6<f64> {
    log(&motion.rotation, &motion.translation.vector)
}

/// L⁻¹(ξ).
pub fn inverse_left_jacobian(screw: &Vector6<f64>) -> Matrix6<f64> {
    -Tangent::at(screw).first
}

/// J⁻¹(ξ).
pub fn inverse_right_jacobian(screw: &Vector6<f64>) -> Matrix6<f64> {
    Tangent::at(screw).last
}

/// A matrix of four blocks, row by row.
pub fn blocks(a: &Matrix3<f64>, b: &Matrix3<f64>, c: &Matrix3<f64>, d: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(a);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(b);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(c);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(d);
    m
}

/// ad ξ.
fn adjoint(screw: &Vector6<f64>) -> Matrix6<f64> {
    let (v, turn) = halves(screw);
    let (v, turn) = (v.cross_matrix(), turn.cross_matrix());
    blocks(&turn, &v, &Matrix3::zeros(), &turn)
}

/// K with pᵀ (ad x) y = xᵀ K y.
fn coadjoint(p: &Vector6<f64>) -> Matrix6<f64> {
    let (force, moment) = halves(p);
    let (force, moment) = (-force.cross_matrix(), -moment.cross_matrix());
    blocks(&Matrix3::zeros(), &force, &force, &moment)
}

/// Derivatives of the relative screw h = log(g_a⁻¹ g_b) by motions g exp(η) of its two frames: δh = P_a η_a + P_b η_b.
pub struct Tangent {
    /// P_a = -L⁻¹ and P_b = J⁻¹.
    pub first: Matrix6<f64>,
    pub last: Matrix6<f64>,
    ad: Matrix6<f64>,
    square: Matrix6<f64>,
    turn: Vector3<f64>,
    /// F and its derivatives.
    f: [f64; 3],
}

impl Tangent {
    pub fn at(h: &Vector6<f64>) -> Tangent {
        let (ad, turn) = (adjoint(h), h.fixed_rows::<3>(3).into_owned());
        let phi = turn.norm_squared();
        let (square, f) = (ad * ad, bernoulli(phi));
        let even = Matrix6::identity() + square * (f[0] - phi * f[1]) - square * square * f[1];
        Tangent { first: ad * 0.5 - even, last: even + ad * 0.5, ad, square, turn, f }
    }

    /// The second derivative of p · h along g_a exp(η_a), g_b exp(η_b) with p held: blocks (a, a), (a, b) and (b, b).
    pub fn curvature(&self, p: &Vector6<f64>) -> [Matrix6<f64>; 3] {
        let Tangent { ad, square, turn, f, .. } = self;
        let phi = turn.norm_squared();
        let (alpha, beta) = (f[0] - phi * f[1], -f[1]);
        // Along the way h' = P η, h'' = DE[h'] (η_b - η_a) + ½ ad h' (η_b + η_a), with D adᵐ[x] = Σ_j adʲ (ad x) adᵐ⁻¹⁻ʲ.
        let step = |q: &Vector6<f64>| ad.tr_mul(q);
        let p1 = step(p);
        let p2 = step(&p1);
        let p3 = step(&p2);
        let p4 = step(&p3);
        let half = coadjoint(p) * 0.5;
        let mut k = coadjoint(&(p1 * alpha + p3 * beta))
            + (half * (2.0 * alpha) + coadjoint(&(p2 * beta)) + (half * (2.0 * beta)) * square) * ad
            + coadjoint(&(p1 * beta)) * square;
        // α' = -φ F'' and β' = -F'' by φ, whose own change is 2 ω · ω'.
        let row = (p2 * (-phi * f[2]) - p4 * f[2]) * 2.0;
        for axis in 0..3 {
            for column in 0..6 {
                k[(3 + axis, column)] += turn[axis] * row[column];
            }
        }
        let (minus, plus) = (half - k, half + k);
        let first = self.first.tr_mul(&minus);
        let last = self.last.tr_mul(&plus);
        let across = self.first.tr_mul(&plus) + self.last.tr_mul(&minus).transpose();
        [(first + first.transpose()) * 0.5, across * 0.5, (last + last.transpose()) * 0.5]
    }
}

/// (v, ω) in one vector.
pub fn joined(first: &Vector3<f64>, second: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(first.x, first.y, first.z, second.x, second.y, second.z)
}

/// (v, ω).
pub fn halves(screw: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (screw.fixed_rows::<3>(0).into_owned(), screw.fixed_rows::<3>(3).into_owned())
}

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
            for k in 0..6 {
                let mut by = Vector6::zeros();
                by[k] = step;
                let right = (log_of(&(motion * exp(&by))) - log_of(&(motion * exp(&-by)))) / (2.0 * step);
                let left = (log_of(&(exp(&by) * motion)) - log_of(&(exp(&-by) * motion))) / (2.0 * step);
                let off = (right - inverse_right_jacobian(&screw).column(k)).amax();
                let off_left = (left - inverse_left_jacobian(&screw).column(k)).amax();
                assert!(off.max(off_left) < 1e-8, "{screw} {k}: {off:e} {off_left:e}");
            }
        }
    }

    /// Central differences along g_a exp(η_a t), g_b exp(η_b t), on both sides of where F changes its form.
    #[test]
    fn first_and_second_derivatives_are_those_of_the_logarithm() {
        let (p, step) = (Vector6::new(0.3, 1.0, -2.0, 0.5, 0.7, -0.2), 1e-4);
        let first = Vector6::new(0.1, -0.3, 0.5, 0.9, -0.2, 0.4);
        let last = Vector6::new(-0.7, 0.2, 0.1, -0.3, 0.6, 0.8);
        for angle in [0.0, 1e-3, 0.3, 0.599, 0.601, 1.5, 3.0] {
            let turn = Vector3::new(0.3, -0.5, 0.7).normalize() * angle;
            let h = joined(&Vector3::new(0.2, -1.0, 0.4), &turn);
            let moved = |t: f64| log_of(&(exp(&(first * -t)) * exp(&h) * exp(&(last * t))));
            let tangent = Tangent::at(&h);
            let slope = (moved(step) - moved(-step)) / (2.0 * step);
            assert!((tangent.first * first + tangent.last * last - slope).amax() < 1e-8, "{angle}");
            let [aa, ab, bb] = tangent.curvature(&p);
            let found = first.dot(&(aa * first)) + 2.0 * first.dot(&(ab * last)) + last.dot(&(bb * last));
            let second = p.dot(&(moved(step) - moved(0.0) * 2.0 + moved(-step))) / (step * step);
            assert!((found - second).abs() < 1e-6, "{angle}: {found} {second}");
        }
    }

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
