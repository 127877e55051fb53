//! The St. Venant–Kirchhoff law: Hooke's law between Green's strain and the second Piola–Kirchhoff stress.
//!
//! ```text
//! E = ½(FᵀF - I) = ½(H + Hᵀ + HᵀH)     ψ = λ/2 (tr E)² + μ E:E     S = λ tr(E) I + 2μ E     P = F S
//! C_iJkL = δ_ik S_JL + λ F_iJ F_kL + μ (F_iL F_kJ + (F Fᵀ)_ik δ_JL)
//! ```
//!
//! (Bonet and Wood, 2nd ed., section 6.4.) Right for large rotations and small strain. Under compression it softens: a
//! bar gives way at 1/√3 of its length, and nothing resists an element that turns inside out.

use super::lame::Lame;
use super::law::{Law, Tangent};
use nalgebra::Matrix3;

pub const STVK: Law = Law {
    name: "stvk",
    title: "St. Venant–Kirchhoff",
    summary: "method 1a, found in the background: St. Venant–Kirchhoff statics, right for large rotations and small strain",
    remedy: "This law gives way under compression, a bar at 58 % of its length: press less, or take model = \
             \"neo_hookean\"",
    resists_inversion: false,
    energy,
    stress,
    tangent,
    dilatation: |h| h.trace() + 0.5 * h.norm_squared(),
    dilatation_slope: |h| Matrix3::identity() + h,
    dilatation_curvature: |_| Tangent::identity(),
    free_face: super::free_face::stvk,
};

/// E.
fn green_strain(h: &Matrix3<f64>) -> Matrix3<f64> {
    (h + h.transpose() + h.transpose() * h) * 0.5
}

/// S.
fn second_stress(h: &Matrix3<f64>, lame: Lame) -> Matrix3<f64> {
    let strain = green_strain(h);
    strain * (2.0 * lame.mu) + Matrix3::from_diagonal_element(lame.lambda * strain.trace())
}

fn energy(h: &Matrix3<f64>, lame: Lame) -> f64 {
    let strain = green_strain(h);
    0.5 * lame.lambda * strain.trace().powi(2) + lame.mu * strain.norm_squared()
}

fn stress(h: &Matrix3<f64>, lame: Lame) -> Matrix3<f64> {
    (Matrix3::identity() + h) * second_stress(h, lame)
}

fn tangent(h: &Matrix3<f64>, lame: Lame) -> Tangent {
    let (f, s) = (Matrix3::identity() + h, second_stress(h, lame));
    let left = f * f.transpose() * lame.mu;
    let mut c = Tangent::zeros();
    for (l, k) in (0..3).flat_map(|l| (0..3).map(move |k| (l, k))) {
        let column = &mut c.data.0[3 * l + k];
        for j in 0..3 {
            for i in 0..3 {
                column[3 * j + i] = lame.lambda * f[(i, j)] * f[(k, l)] + lame.mu * f[(i, l)] * f[(k, j)];
            }
        }
        for i in 0..3 {
            column[3 * l + i] += left[(i, k)];
        }
        for j in 0..3 {
            column[3 * j + k] += s[(j, l)];
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAME: Lame = Lame { lambda: 2.0, mu: 1.0 };

    /// F = [[1.2, .1, -.05], [.2, .9, .15], [-.1, .05, 1.1]], by hand.
    #[test]
    fn stress_of_a_sample_is_that_of_the_closed_form() {
        let f = Matrix3::new(1.2, 0.1, -0.05, 0.2, 0.9, 0.15, -0.1, 0.05, 1.1);
        let expected = Matrix3::new(
            1.2815, 0.38175, -0.188625, //
            0.452, 0.41975, 0.255875, //
            -0.243, 0.1925, 0.884,
        );
        let p = stress(&(f - Matrix3::identity()), LAME);
        assert!((p - expected).amax() < 1e-13 * expected.amax(), "{p}");
    }

    /// A bar of length λ* with free sides: P = E (λ*³ - λ*)/2, whose limit point is λ* = 1/√3 with P = -E / (3√3).
    #[test]
    fn bar_gives_way_at_its_limit_point() {
        let (young, poisson) = (3.0, 0.3);
        let lame = Lame::from_young_poisson(young, poisson);
        let along = |stretch: f64| {
            // S across vanishes where E across is -ν E along.
            let strain = 0.5 * (stretch * stretch - 1.0);
            let across = (1.0 - 2.0 * poisson * strain).sqrt();
            let h = Matrix3::from_diagonal(&nalgebra::Vector3::new(stretch, across, across))
                - Matrix3::identity();
            let p = stress(&h, lame);
            assert!(p[(1, 1)].abs() < 1e-15 * young && p[(0, 1)] == 0.0, "{p}");
            p[(0, 0)]
        };
        for stretch in [0.3, 0.577_350_269_189_626, 0.9, 1.0, 1.7] {
            let expected = 0.5 * young * (stretch * stretch * stretch - stretch);
            assert!((along(stretch) - expected).abs() < 1e-14 * young, "{stretch}: {}", along(stretch));
        }
        let limit = 1.0 / 3.0_f64.sqrt();
        assert!((along(limit) + 0.192_450_089_729_875 * young).abs() < 1e-14 * young);
        assert!(along(limit - 1e-3) > along(limit) && along(limit + 1e-3) > along(limit));
    }
}
