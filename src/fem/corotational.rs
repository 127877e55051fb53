//! The corotational law: Hooke's law in the frame of the rotation nearest to F.
//!
//! ```text
//! F = R S     ψ = μ |F - R|² + λ/2 (tr S - 3)²     P = 2μ (F - R) + λ (tr S - 3) R
//! dP = 2μ dF + λ (R:dF) R + (λ (tr S - 3) - 2μ) dR     dR = R [w]     (tr(S) I - S) w = axial(Rᵀ dF - dFᵀ R)
//! ```
//!
//! with [axial(A)] = A (Sifakis and Barbič, FEM Simulation of 3D Deformable Solids, SIGGRAPH 2012 courses, section 3.4;
//! McAdams et al., ACM Trans. Graph. 30(4), 2011, for dR). R is the proper rotation also where F is turned inside out.
//!
//! F - R = R (S - I), and S - I is not taken as a difference, which would leave no digit of a small strain: it solves
//! (S - I)² + 2 (S - I) = FᵀF - I = H + Hᵀ + HᵀH.

use super::lame::Lame;
use super::law::{Law, Tangent};
use super::polar::Polar;
use nalgebra::{Matrix3, Vector3};

pub const COROTATIONAL: Law = Law {
    name: "corotational",
    title: "corotational",
    summary: "method 1b, found in the background: corotational statics, Hooke's law in every element's own frame",
    remedy: "Press, turn or shear less, or refine where it folds",
    resists_inversion: true,
    energy,
    stress,
    tangent,
    dilatation: |h| parts(h).1.trace(),
    dilatation_slope: |h| parts(h).0,
    dilatation_curvature: |h| turn_slope(&parts(h)),
    free_face: super::free_face::corotational,
};

/// The tangent is computed with sums of two principal stretches of at least this; dR is not defined where one is zero.
const LEAST: f64 = 1e-6;

/// R and S - I, the latter to a rounding of H.
fn parts(h: &Matrix3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let Some(polar) = Polar::new(&(Matrix3::identity() + h)) else { return (Matrix3::identity(), *h) };
    let (axes, sigma) = (polar.vt.transpose(), polar.sigma);
    let strain = if polar.sign < 0.0 {
        // A stretch of -σ₃ is no small strain.
        Matrix3::from_diagonal(&Vector3::new(sigma[0] - 1.0, sigma[1] - 1.0, -sigma[2] - 1.0))
    } else {
        // D = S - I from (D S + S D)/2 + D = FᵀF - I on the axes of S.
        let squared = polar.vt * (h + h.transpose() + h.transpose() * h) * axes;
        Matrix3::from_fn(|i, j| squared[(i, j)] / (1.0 + 0.5 * (sigma[i] + sigma[j])))
    };
    let strain = axes * strain * polar.vt;
    (polar.rotation().into_inner(), (strain + strain.transpose()) * 0.5)
}

fn energy(h: &Matrix3<f64>, lame: Lame) -> f64 {
    let (_, strain) = parts(h);
    lame.mu * strain.norm_squared() + 0.5 * lame.lambda * strain.trace().powi(2)
}

fn stress(h: &Matrix3<f64>, lame: Lame) -> Matrix3<f64> {
    let (r, strain) = parts(h);
    r * (strain * (2.0 * lame.mu) + Matrix3::from_diagonal_element(lame.lambda * strain.trace()))
}

fn tangent(h: &Matrix3<f64>, lame: Lame) -> Tangent {
    let parts = parts(h);
    let (r, strain) = &parts;
    let r9 = r.reshape_generic(nalgebra::Const::<9>, nalgebra::Const::<1>);
    Tangent::from_diagonal_element(2.0 * lame.mu)
        + r9 * r9.transpose() * lame.lambda
        + turn_slope(&parts) * (lame.lambda * strain.trace() - 2.0 * lame.mu)
}

/// ∂R/∂F, which is also ∂²(tr S)/∂F².
fn turn_slope((r, strain): &(Matrix3<f64>, Matrix3<f64>)) -> Tangent {
    let s = Matrix3::identity() + strain;
    let sums = (Matrix3::from_diagonal_element(s.trace()) - s).symmetric_eigen();
    let inverse = sums.eigenvectors
        * Matrix3::from_diagonal(&sums.eigenvalues.map(|sum| 1.0 / sum.max(LEAST)))
        * sums.eigenvectors.transpose();
    let mut slope = Tangent::zeros();
    for l in 0..3 {
        for k in 0..3 {
            // dF = e_k⊗e_L, for which the axial vector is e_L × Rᵀ e_k.
            let axial = Vector3::ith(l, 1.0).cross(&r.row(k).transpose());
            let change = r * (inverse * axial).cross_matrix();
            let change = change.reshape_generic(nalgebra::Const::<9>, nalgebra::Const::<1>);
            slope.set_column(3 * l + k, &change);
        }
    }
    slope
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    const LAME: Lame = Lame { lambda: 2.0, mu: 1.0 };

    /// ε = sym H: P = 2μ ε + λ tr ε I and ψ = μ ε:ε + λ/2 (tr ε)², both up to parts of the order of H.
    #[test]
    fn a_strain_far_below_rounding_beside_one_keeps_its_digits() {
        let shape = Matrix3::new(0.2, 0.1, -0.05, 0.2, -0.1, 0.15, -0.1, 0.05, 0.1);
        let strain = (shape + shape.transpose()) * 0.5;
        let hooke = strain * (2.0 * LAME.mu) + Matrix3::from_diagonal_element(LAME.lambda * strain.trace());
        let hooke_energy = LAME.mu * strain.norm_squared() + 0.5 * LAME.lambda * strain.trace().powi(2);
        for size in [1e-3, 1e-9, 1e-15, 1e-18, 1e-60] {
            let off = stress(&(shape * size), LAME) / size - hooke;
            assert!(off.amax() < 2.0 * size + 1e-15, "{size:e}: {off}");
            let off = energy(&(shape * size), LAME) / size / size - hooke_energy;
            assert!(off.abs() < size + 1e-15, "{size:e}: {off:e}");
        }
    }

    /// Principal stretches σ₁, σ₂, -σ₃ about skew axes, turned: ψ = μ Σ (σ - 1)² + λ/2 (Σ (σ - 1))².
    #[test]
    fn an_element_turned_inside_out_has_the_energy_of_its_stretches() {
        let (turn, axes) =
            (Rotation3::new(Vector3::new(0.4, -1.1, 2.0)), Rotation3::new(Vector3::new(1.0, 0.3, -0.7)));
        for stretches in [[1.3, 0.8, -0.2], [1.3, 0.8, -0.79], [1.3, 0.8, 1e-9], [2.0, 1.5, -1.0]] {
            let s =
                axes.matrix() * Matrix3::from_diagonal(&Vector3::from(stretches)) * axes.matrix().transpose();
            let changes = stretches.map(|stretch| stretch - 1.0);
            let sum: f64 = changes.iter().sum();
            let expected = LAME.mu * changes.iter().map(|change| change * change).sum::<f64>()
                + 0.5 * LAME.lambda * sum * sum;
            let found = energy(&(turn.matrix() * s - Matrix3::identity()), LAME);
            assert!((found - expected).abs() < 1e-13 * expected, "{stretches:?}: {found} against {expected}");
        }
    }
}
