//! The neo-Hookean law that is Hooke's at rest and stays finite through inversion.
//!
//! ```text
//! ψ = μ/2 (tr FᵀF - 3) - μ (J - 1) + ½ (λ + μ)(J - 1)²     P = μ F + ((λ + μ)(J - 1) - μ) cof F     J = det F
//! C_iJkL = μ δ_ik δ_JL + (λ + μ) cof_iJ cof_kL + ((λ + μ)(J - 1) - μ) ε_ikm ε_JLN F_mN
//! ```
//!
//! (Smith, de Goes and Kim, ACM Trans. Graph. 37(2), 2018, equation 13 and section 4, without the logarithm that resists
//! collapse to a point.) It stiffens under compression, where [`super::STVK`] gives way.

use super::lame::Lame;
use super::law::{Law, Tangent};
use nalgebra::Matrix3;

pub const NEO_HOOKEAN: Law = Law {
    name: "neo_hookean",
    title: "neo-Hookean",
    summary: "method 1a, found in the background: neo-Hookean statics, which bear compression",
    remedy: "Press, turn or shear less, or refine where it folds",
    resists_inversion: true,
    energy,
    stress,
    tangent,
    dilatation: |h| changes(h).0,
    dilatation_slope: |h| Matrix3::identity() + changes(h).1,
    dilatation_curvature: volume_curvature,
    free_face: super::free_face::neo_hookean,
};

/// cof M = det(M) M⁻ᵀ.
fn cofactor(m: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c) = (m.column(0), m.column(1), m.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// J - 1 and cof F - I of F = I + H.
fn changes(h: &Matrix3<f64>) -> (f64, Matrix3<f64>) {
    let cof = cofactor(h);
    let change = Matrix3::from_diagonal_element(h.trace()) - h.transpose() + cof;
    (h.trace() + cof.trace() + h.determinant(), change)
}

fn energy(h: &Matrix3<f64>, lame: Lame) -> f64 {
    let (volume, _) = changes(h);
    // ½ (tr FᵀF - 3) - (J - 1), whose first orders cancel. With C = FᵀF - I, J² - 1 = tr C + tr cof C + det C, which
    // leaves second orders of the strain alone, however far F turns; not where J is near -1.
    let shear = if volume > -0.5 {
        let c = h + h.transpose() + h.transpose() * h;
        (0.5 * c.trace() * volume - cofactor(&c).trace() - c.determinant()) / (2.0 + volume)
    } else {
        0.5 * h.norm_squared() - cofactor(h).trace() - h.determinant()
    };
    lame.mu * shear + 0.5 * (lame.lambda + lame.mu) * volume * volume
}

fn stress(h: &Matrix3<f64>, lame: Lame) -> Matrix3<f64> {
    let (volume, cof) = changes(h);
    let pressure = (lame.lambda + lame.mu) * volume;
    (h - cof) * lame.mu + (Matrix3::identity() + cof) * pressure
}

fn tangent(h: &Matrix3<f64>, lame: Lame) -> Tangent {
    let (volume, cof) = changes(h);
    let bulk = lame.lambda + lame.mu;
    let cof = (Matrix3::identity() + cof).reshape_generic(nalgebra::Const::<9>, nalgebra::Const::<1>);
    let c = Tangent::from_diagonal_element(lame.mu) + cof * cof.transpose() * bulk;
    c + volume_curvature(h) * (bulk * volume - lame.mu)
}

/// ∂²J/∂F² = ε_ikm ε_JLN F_mN.
fn volume_curvature(h: &Matrix3<f64>) -> Tangent {
    let f = Matrix3::identity() + h;
    let mut c = Tangent::zeros();
    for n in 0..3 {
        let (j, l) = ((n + 1) % 3, (n + 2) % 3);
        let block = f.column(n).cross_matrix();
        c.fixed_view_mut::<3, 3>(3 * j, 3 * l).copy_from(&-block);
        c.fixed_view_mut::<3, 3>(3 * l, 3 * j).copy_from(&block);
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// F = Q (I + H) with a turn Q: the energy is that of H to a rounding of ε, not of 1.
    #[test]
    fn energy_of_a_small_strain_keeps_its_digits_in_a_turned_body() {
        let shape = Matrix3::new(0.2, 0.1, -0.05, 0.1, -0.1, 0.15, -0.05, 0.15, 0.1);
        let q = *nalgebra::Rotation3::new(nalgebra::Vector3::new(0.4, -1.1, 2.0)).matrix();
        let lame = Lame { lambda: 2.0, mu: 1.0 };
        for size in [1e-1, 1e-4, 1e-8] {
            let h = shape * size;
            let turned = (q - Matrix3::identity()) + q * h;
            let (straight, turned) = (energy(&h, lame), energy(&turned, lame));
            assert!((straight - turned).abs() < 1e-14 * size, "{size:e}: {straight:e} and {turned:e}");
        }
    }

    /// F = [[1.2, .1, -.05], [.2, .9, .15], [-.1, .05, 1.1]], λ = 2, μ = 1.
    #[test]
    fn stress_of_a_sample_is_that_of_the_closed_form() {
        let h = Matrix3::new(0.2, 0.1, -0.05, 0.2, -0.1, 0.15, -0.1, 0.05, 0.1);
        let expected = Matrix3::new(
            0.66109875, 0.2288975, -0.10485, //
            0.26170625, 0.1787225, 0.188395, //
            -0.13291, 0.154215, 0.51859,
        );
        let p = stress(&h, Lame { lambda: 2.0, mu: 1.0 });
        assert!((p - expected).amax() < 1e-13 * expected.amax(), "{p}");
    }
}
