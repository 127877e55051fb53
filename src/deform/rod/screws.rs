//! The relative screw of two frames, h = log(g_a⁻¹ g_b), and its first and second derivatives.
//!
//! In: h = (v, ω). Out: how h changes when the frames move by g exp(η):
//!
//! ```text
//! δh = P_b η_b + P_a η_a    P_b = E + ½ ad h    P_a = -E + ½ ad h    E = I + α ad² h + β ad⁴ h    ad h = | [ω] [v] |
//! α = F - φ F'    β = -F'    F(φ) = (1 - θ/2 cot θ/2)/φ    φ = θ² = |ω|²                                  |  0  [ω] |
//! ```
//!
//! E is the even part of x/(1 - e⁻ˣ) at x = ad h, whose minimal polynomial is x (x² + φ)² (Selig, Geometric Fundamentals
//! of Robotics, section 4.5; Sonneville, Cardona and Brüls, CMAME 268, 2014).

use super::super::se3::{self, halves};
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};

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

/// log of the motion of a frame. The sign of its quaternion distinguishes turns up to 360° apart.
pub fn log(frame: &Isometry3<f64>) -> Vector6<f64> {
    se3::log(&frame.rotation, &frame.translation.vector)
}

fn blocks(a: &Matrix3<f64>, b: &Matrix3<f64>, c: &Matrix3<f64>, d: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(a);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(b);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(c);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(d);
    m
}

/// Ad of a shift by x: the motion (v, ω) of a frame is that of the frame moved by -x, whose origin is x away from it.
pub fn shift(x: &Vector3<f64>) -> Matrix6<f64> {
    blocks(&Matrix3::identity(), &x.cross_matrix(), &Matrix3::zeros(), &Matrix3::identity())
}

/// ad h.
fn adjoint(h: &Vector6<f64>) -> Matrix6<f64> {
    let (v, turn) = halves(h);
    let (v, turn) = (v.cross_matrix(), turn.cross_matrix());
    blocks(&turn, &v, &Matrix3::zeros(), &turn)
}

/// K with pᵀ (ad x) y = xᵀ K y.
fn coadjoint(p: &Vector6<f64>) -> Matrix6<f64> {
    let (force, moment) = halves(p);
    let (force, moment) = (-force.cross_matrix(), -moment.cross_matrix());
    blocks(&Matrix3::zeros(), &force, &force, &moment)
}

/// Derivatives of a relative screw h by its two frames.
pub struct Tangent {
    /// P_a and P_b.
    pub first: Matrix6<f64>,
    pub last: Matrix6<f64>,
    ad: Matrix6<f64>,
    square: Matrix6<f64>,
    turn: Vector3<f64>,
    /// F and its derivatives.
    f: [f64; 3],
}

impl Tangent {
    pub fn of(h: &Vector6<f64>) -> Tangent {
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

#[cfg(test)]
mod tests {
    use super::super::super::se3::exp;
    use super::*;

    /// Central differences along g_a exp(η_a t), g_b exp(η_b t), on both sides of where F changes its form.
    #[test]
    fn first_and_second_derivatives_are_those_of_the_logarithm() {
        let (p, step) = (Vector6::new(0.3, 1.0, -2.0, 0.5, 0.7, -0.2), 1e-4);
        let first = Vector6::new(0.1, -0.3, 0.5, 0.9, -0.2, 0.4);
        let last = Vector6::new(-0.7, 0.2, 0.1, -0.3, 0.6, 0.8);
        for angle in [0.0, 1e-3, 0.3, 0.599, 0.601, 1.5, 3.0] {
            let turn = Vector3::new(0.3, -0.5, 0.7).normalize() * angle;
            let h = se3::joined(&Vector3::new(0.2, -1.0, 0.4), &turn);
            let moved = |t: f64| log(&(exp(&(first * -t)) * exp(&h) * exp(&(last * t))));
            let tangent = Tangent::of(&h);
            let slope = (moved(step) - moved(-step)) / (2.0 * step);
            assert!((tangent.first * first + tangent.last * last - slope).amax() < 1e-8, "{angle}");
            let [aa, ab, bb] = tangent.curvature(&p);
            let found = first.dot(&(aa * first)) + 2.0 * first.dot(&(ab * last)) + last.dot(&(bb * last));
            let second = p.dot(&(moved(step) - moved(0.0) * 2.0 + moved(-step))) / (step * step);
            assert!((found - second).abs() < 1e-6, "{angle}: {found} {second}");
        }
    }
}
