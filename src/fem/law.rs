//! An entry of the list of laws: an energy density ψ(F), its derivatives, and the dilatation in it.

use super::free_face::FreeFace;
use super::lame::Lame;
use nalgebra::{Matrix3, SMatrix};

/// C = ∂P/∂F, Pa: row 3 J + i belongs to P_iJ, column 3 L + k to F_kL, as nalgebra stores a 3×3 matrix.
pub type Tangent = SMatrix<f64, 9, 9>;

/// A material law of the form ψ = ψ₀(F; μ) + λ/2 θ(F)². Its functions take H = F - I instead of F, so that small strains
/// keep their digits.
#[derive(Debug)]
pub struct Law {
    /// The name in a scene's `model`.
    pub name: &'static str,
    /// The name in books.
    pub title: &'static str,
    /// The method of the paper that it belongs to, and what it is good for.
    pub summary: &'static str,
    /// Advice where a body of this material has no equilibrium.
    pub remedy: &'static str,
    /// Whether energy grows where a tetrahedron turns inside out, so that such a state can be an equilibrium.
    pub resists_inversion: bool,
    /// ψ, J/m³; 0 at rest.
    pub energy: fn(&Matrix3<f64>, Lame) -> f64,
    /// First Piola–Kirchhoff stress P = ∂ψ/∂F, Pa; at rest 0, and for small H that of Hooke's law.
    pub stress: fn(&Matrix3<f64>, Lame) -> Matrix3<f64>,
    pub tangent: fn(&Matrix3<f64>, Lame) -> Tangent,
    /// θ, tr ε for small H: the dilatation that λ resists. Elements that do not lock near ν = 1/2 take its mean.
    pub dilatation: fn(&Matrix3<f64>) -> f64,
    /// ∂θ/∂F.
    pub dilatation_slope: fn(&Matrix3<f64>) -> Matrix3<f64>,
    /// ∂²θ/∂F², indexed as [`Tangent`].
    pub dilatation_curvature: fn(&Matrix3<f64>) -> Tangent,
    /// The stress in a face that nothing presses or pulls, from its two principal stretches less 1.
    pub free_face: fn([f64; 2], Lame) -> FreeFace,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::LAWS;
    use nalgebra::{Const, Rotation3, Vector3};

    const LAME: Lame = Lame { lambda: 2.0, mu: 1.0 };

    fn sample() -> Matrix3<f64> {
        Matrix3::new(0.2, 0.1, -0.05, 0.2, -0.1, 0.15, -0.1, 0.05, 0.1)
    }

    #[test]
    fn stress_and_tangent_are_the_derivatives_of_the_energy() {
        for law in LAWS {
            let (h, step) = (sample(), 1e-5);
            let (p, c) = ((law.stress)(&h, LAME), (law.tangent)(&h, LAME));
            assert!((c - c.transpose()).amax() < 1e-14 * c.amax(), "{}: ∂²ψ is symmetric", law.name);
            for entry in 0..9 {
                let (mut plus, mut minus) = (h, h);
                plus[entry] += step;
                minus[entry] -= step;
                let slope = ((law.energy)(&plus, LAME) - (law.energy)(&minus, LAME)) / (2.0 * step);
                assert!(
                    (slope - p[entry]).abs() < 1e-9,
                    "{} P{entry}: {slope} against {}",
                    law.name,
                    p[entry]
                );
                let change = ((law.stress)(&plus, LAME) - (law.stress)(&minus, LAME)) / (2.0 * step);
                for (row, change) in change.iter().enumerate() {
                    let off = change - c[(row, entry)];
                    assert!(off.abs() < 1e-9, "{} C({row}, {entry}): {off:e}", law.name);
                }
            }
        }
    }

    /// θ has the slope and curvature that are said to be its own, and λ/2 θ² is all that λ adds to ψ, P and C.
    #[test]
    fn the_dilatation_is_what_lambda_resists() {
        let stiff = Lame { lambda: 7.5, mu: LAME.mu };
        for law in LAWS {
            let (h, step) = (sample(), 1e-5);
            let (theta, slope) = ((law.dilatation)(&h), (law.dilatation_slope)(&h));
            let curvature = (law.dilatation_curvature)(&h);
            for entry in 0..9 {
                let (mut plus, mut minus) = (h, h);
                plus[entry] += step;
                minus[entry] -= step;
                let found = ((law.dilatation)(&plus) - (law.dilatation)(&minus)) / (2.0 * step);
                assert!((found - slope[entry]).abs() < 1e-9, "{} slope {entry}: {found}", law.name);
                let found = ((law.dilatation_slope)(&plus) - (law.dilatation_slope)(&minus)) / (2.0 * step);
                for (row, found) in found.iter().enumerate() {
                    let off = found - curvature[(row, entry)];
                    assert!(off.abs() < 1e-9, "{} curvature ({row}, {entry}): {off:e}", law.name);
                }
            }
            let more = stiff.lambda - LAME.lambda;
            let energy = (law.energy)(&h, stiff) - (law.energy)(&h, LAME);
            assert!((energy - 0.5 * more * theta * theta).abs() < 1e-14, "{}: {energy}", law.name);
            let stress = (law.stress)(&h, stiff) - (law.stress)(&h, LAME) - slope * (more * theta);
            assert!(stress.amax() < 1e-14, "{}: {stress}", law.name);
            let slope = slope.reshape_generic(Const::<9>, Const::<1>);
            let added = (slope * slope.transpose() + curvature * theta) * more;
            let tangent = (law.tangent)(&h, stiff) - (law.tangent)(&h, LAME) - added;
            assert!(tangent.amax() < 1e-13, "{}: {tangent}", law.name);
        }
    }

    /// The stress from P of the whole gradient: none across the face, and σ = P F^T / det F in it.
    #[test]
    fn a_free_face_bears_no_stress_across_it() {
        for law in LAWS {
            for lame in [LAME, Lame { lambda: 2e4, mu: 1.0 }] {
                for h in [[0.2, 0.1], [-0.1, 0.15], [1e-6, -3e-7], [0.2, 0.2], [-0.2, -0.1]] {
                    let face = (law.free_face)(h, lame);
                    let changes = Vector3::new(h[0], h[1], face.across);
                    let p = (law.stress)(&Matrix3::from_diagonal(&changes), lame);
                    let size = h[0].abs().max(h[1].abs());
                    assert!(p[(2, 2)].abs() < 1e-13 * (lame.lambda + lame.mu), "{} {h:?}: {p}", law.name);
                    let f = changes.add_scalar(1.0);
                    for i in 0..2 {
                        let expected = p[(i, i)] * f[i] / f.product();
                        let off = (face.stress[i] - expected).abs();
                        assert!(off < 1e-9 * size + 1e-13 * lame.lambda, "{} {h:?}: {off:e}", law.name);
                    }
                }
            }
        }
    }

    /// ψ(Q F) = ψ(F) and P(Q F) = Q P(F).
    #[test]
    fn turning_the_body_turns_its_stress_and_costs_nothing() {
        let q = *Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 2.0)).matrix();
        for law in LAWS {
            let f = Matrix3::identity() + sample();
            let turned = q * f - Matrix3::identity();
            let (before, after) = ((law.energy)(&sample(), LAME), (law.energy)(&turned, LAME));
            assert!((before - after).abs() < 1e-14, "{}: {before} and {after}", law.name);
            let off = (law.stress)(&turned, LAME) - q * (law.stress)(&sample(), LAME);
            assert!(off.amax() < 1e-14, "{}: {off}", law.name);
            let rigid = (law.stress)(&(q - Matrix3::identity()), LAME);
            assert!(rigid.amax() < 1e-14, "{}: {rigid}", law.name);
        }
    }
}
