//! The screw between two frames, and its derivatives by motions of both.
//!
//! In: frames gₐ, g_b. Out: ξ = (ω, v) of gₐ⁻¹ g_b = exp ξ in SE(3), and for motions g exp δ of the two frames
//!
//! ```text
//! dξ = J_r⁻¹ δ_b - J_l⁻¹ δₐ     J_r⁻¹, J_l⁻¹ = I ± ½ A + c₂ A² + c₄ A⁴     A = ad ξ
//! c₂ = Σ (2 - n) aₙ θ²⁽ⁿ⁻¹⁾     c₄ = -Σ (n - 1) aₙ θ²⁽ⁿ⁻²⁾     aₙ = |B₂ₙ| / (2n)!
//! ```
//!
//! (Sonneville, Cardona and Brüls, Comput. Methods Appl. Mech. Engrg. 268, 2014; c₂ and c₄ from the polynomial that A and
//! x/(1 - exp(-x)) have in common, the eigenvalues ±iθ of A being double.) The series of Bernoulli's numbers have no
//! special case at θ = 0, and converge to rounding for θ ≤ π.

use crate::deform::se3::slide_matrix;
use nalgebra::{Isometry3, SMatrix, SVector, UnitQuaternion, Vector3};

pub type Twist = SVector<f64, 6>;
pub type Matrix6 = SMatrix<f64, 6, 6>;
pub type Matrix6x12 = SMatrix<f64, 6, 12>;
pub type Matrix12 = SMatrix<f64, 12, 12>;

/// |B₂ₙ| / (2n)!, n = 1, 2, …
const A: [f64; 26] = [
    0.08333333333333333,
    0.001388888888888889,
    3.306878306878307e-05,
    8.267195767195768e-07,
    2.08767569878681e-08,
    5.284190138687493e-10,
    1.3382536530684679e-11,
    3.3896802963225827e-13,
    8.586062056277845e-15,
    2.174868698558062e-16,
    5.5090028283602295e-18,
    1.3954464685812522e-19,
    3.534707039629467e-21,
    8.953517427037546e-23,
    2.267952452337683e-24,
    5.744790668872202e-26,
    1.455172475614865e-27,
    3.6859949406653103e-29,
    9.336734257095045e-31,
    2.36502241570063e-32,
    5.990671762482134e-34,
    1.5174548844682903e-35,
    3.843758125454189e-37,
    9.736353072646691e-39,
    2.466247044200681e-40,
    6.247076741820743e-42,
];

/// A frame of a part's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndFrame {
    pub place: Vector3<f64>,
    pub turn: UnitQuaternion<f64>,
}

impl EndFrame {
    pub fn of(motion: &Isometry3<f64>) -> EndFrame {
        EndFrame { place: motion.translation.vector, turn: motion.rotation }
    }

    pub fn motion(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.place.into(), self.turn)
    }

    /// g exp δ with δ = (φ, ρ) in the frame's own axes.
    pub fn moved(&self, delta: &Twist) -> EndFrame {
        let (turn, slide) = (delta.fixed_rows::<3>(0).into_owned(), delta.fixed_rows::<3>(3).into_owned());
        let shift = slide_matrix(&turn) * slide;
        let mut rotation = self.turn * UnitQuaternion::from_scaled_axis(turn);
        rotation.renormalize_fast();
        EndFrame { place: self.place + self.turn * shift, turn: rotation }
    }
}

/// c₀ = Σ aₙ sⁿ⁻¹, c₂, c₄ and the derivatives of the last two by s = θ².
struct Series {
    whole: f64,
    c2: f64,
    c4: f64,
    c2_slope: f64,
    c4_slope: f64,
}

impl Series {
    fn at(s: f64) -> Series {
        let mut sum = Series { whole: 0.0, c2: 0.0, c4: 0.0, c2_slope: 0.0, c4_slope: 0.0 };
        // Horner's scheme, from the last.
        for (n, a) in A.iter().enumerate().rev().map(|(i, a)| (i as f64 + 1.0, a)) {
            sum.c2_slope = sum.c2_slope * s + sum.c2;
            sum.whole = sum.whole * s + a;
            sum.c2 = sum.c2 * s + (2.0 - n) * a;
            if n > 1.0 {
                sum.c4_slope = sum.c4_slope * s + sum.c4;
                sum.c4 = sum.c4 * s - (n - 1.0) * a;
            }
        }
        sum
    }
}

/// ξ = (ω, v) of a⁻¹ b, by the shorter turn.
pub fn screw(a: &EndFrame, b: &EndFrame) -> Twist {
    let turn = (a.turn.inverse() * b.turn).scaled_axis();
    let chord = a.turn.inverse() * (b.place - a.place);
    let cross = turn.cross(&chord);
    let slide = chord - cross * 0.5 + turn.cross(&cross) * Series::at(turn.norm_squared()).whole;
    Twist::new(turn.x, turn.y, turn.z, slide.x, slide.y, slide.z)
}

/// The derivatives at one ξ.
pub struct ScrewSlopes {
    /// dξ by (δₐ, δ_b).
    pub first: Matrix6x12,
    powers: [Matrix6; 4],
    series: Series,
    turn: Vector3<f64>,
}

impl ScrewSlopes {
    pub fn at(xi: &Twist) -> ScrewSlopes {
        let turn = xi.fixed_rows::<3>(0).into_owned();
        let series = Series::at(turn.norm_squared());
        let a = ad(xi);
        let a2 = a * a;
        let (a3, a4) = (a2 * a, a2 * a2);
        let even = Matrix6::identity() + a2 * series.c2 + a4 * series.c4;
        let mut first = Matrix6x12::zeros();
        first.fixed_columns_mut::<6>(0).copy_from(&(a * 0.5 - even));
        first.fixed_columns_mut::<6>(6).copy_from(&(even + a * 0.5));
        ScrewSlopes { first, powers: [a, a2, a3, a4], series, turn }
    }

    /// Σ_k m_k ∂²ξ_k by motions of both frames: symmetric.
    pub fn second(&self, m: &Twist) -> Matrix12 {
        let [a, a2, a3, a4] = self.powers.map(|power| power.transpose());
        let odd = coadjoint(m) * 0.5;
        let (m1, m2, m3, m4) = (a * m, a2 * m, a3 * m, a4 * m);
        let mut even = (coadjoint(&m1) + a * coadjoint(m)) * self.series.c2
            + (coadjoint(&m3) + a * coadjoint(&m2) + a2 * coadjoint(&m1) + a3 * coadjoint(m))
                * self.series.c4;
        // d(θ²) = 2 ω · dω.
        let mut by_turn = Twist::zeros();
        by_turn.fixed_rows_mut::<3>(0).copy_from(&(self.turn * 2.0));
        even += (m2 * self.series.c2_slope + m4 * self.series.c4_slope) * by_turn.transpose();
        let mut slopes = SMatrix::<f64, 12, 6>::zeros();
        slopes.fixed_rows_mut::<6>(0).copy_from(&(odd - even));
        slopes.fixed_rows_mut::<6>(6).copy_from(&(even + odd));
        let product = slopes * self.first;
        (product + product.transpose()) * 0.5
    }
}

/// ad ξ = [ω̂ 0; v̂ ω̂].
fn ad(xi: &Twist) -> Matrix6 {
    let (turn, slide) = (
        xi.fixed_rows::<3>(0).into_owned().cross_matrix(),
        xi.fixed_rows::<3>(3).into_owned().cross_matrix(),
    );
    let mut ad = Matrix6::zeros();
    ad.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    ad.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    ad.fixed_view_mut::<3, 3>(3, 0).copy_from(&slide);
    ad
}

/// N(m) with (ad ξ)ᵀ m = N(m) ξ.
fn coadjoint(m: &Twist) -> Matrix6 {
    let (turn, slide) =
        (m.fixed_rows::<3>(0).into_owned().cross_matrix(), m.fixed_rows::<3>(3).into_owned().cross_matrix());
    let mut n = Matrix6::zeros();
    n.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    n.fixed_view_mut::<3, 3>(0, 3).copy_from(&slide);
    n.fixed_view_mut::<3, 3>(3, 0).copy_from(&slide);
    n
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(turn: [f64; 3], place: [f64; 3]) -> EndFrame {
        EndFrame { place: place.into(), turn: UnitQuaternion::from_scaled_axis(turn.into()) }
    }

    /// Small and large turns, and none: first and second derivatives of m · ξ against central differences.
    #[test]
    fn derivatives_agree_with_differences() {
        let m = Twist::new(0.3, -0.7, 0.2, 0.5, 0.4, -0.9);
        for turn in [[0.0; 3], [0.02, -0.01, 0.03], [0.5, 0.9, -0.4], [1.6, 0.5, -2.3]] {
            let (a, b) =
                (frame([0.3, -0.2, 0.1], [0.1, 0.2, 0.3]), frame([0.3, -0.2, 0.1], [1.0, -0.4, 0.6]));
            let b = b.moved(&Twist::new(turn[0], turn[1], turn[2], 0.0, 0.0, 0.0));
            let slopes = ScrewSlopes::at(&screw(&a, &b));
            let moved = |step: &SVector<f64, 12>| {
                let (da, db) = (step.fixed_rows::<6>(0).into_owned(), step.fixed_rows::<6>(6).into_owned());
                screw(&a.moved(&da), &b.moved(&db))
            };
            let second = slopes.second(&m);
            for i in 0..12 {
                let unit = |i: usize, h: f64| SVector::<f64, 12>::ith(i, h);
                let h = 1e-5;
                let first = (moved(&unit(i, h)) - moved(&unit(i, -h))) / (2.0 * h);
                assert!((first - slopes.first.column(i)).amax() < 1e-9, "{turn:?} {i}");
                for j in 0..=i {
                    let h = 1e-4;
                    let f = |x: f64, y: f64| m.dot(&moved(&(unit(i, x) + unit(j, y))));
                    let difference = (f(h, h) - f(h, -h) - f(-h, h) + f(-h, -h)) / (4.0 * h * h);
                    let off = (difference - second[(i, j)]).abs();
                    assert!(off < 1e-6, "{turn:?} {i} {j}: {difference} {}", second[(i, j)]);
                }
            }
        }
    }
}
