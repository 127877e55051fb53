//! The corotational law: Hooke's law in the frame of the rotation nearest to F.
//!
//! ```text
//! F = R S     ψ = μ |F - R|² + λ/2 (tr S - 3)²     P = 2μ (F - R) + λ (tr S - 3) R
//! dP = 2μ dF + λ (R:dF) R + (λ (tr S - 3) - 2μ) dR     dR = R [w]     (tr(S) I - S) w = axial(Rᵀ dF - dFᵀ R)
//! ```
//!
//! with [axial(A)] = A (Sifakis and Barbič, FEM Simulation of 3D Deformable Solids, SIGGRAPH 2012 courses, section 3.4;
//! McAdams et al., ACM Trans. Graph. 30(4), 2011, for dR). R is the proper rotation also where F is turned inside out.

use super::hyperelastic::{Law, Tangent};
use super::{Lame, Polar};
use nalgebra::{Matrix3, Vector3};

pub const COROTATIONAL: Law = Law {
    name: "corotational",
    remedy: "Press, turn or shear less, or refine where it folds",
    energy,
    stress,
    tangent,
};

/// Least sum of two principal stretches with which the tangent is computed: where one vanishes, dR is not defined.
const LEAST: f64 = 1e-6;

/// R.
fn rotation(f: &Matrix3<f64>) -> Matrix3<f64> {
    Polar::of(f).map_or_else(Matrix3::identity, |polar| polar.rotation().into_inner())
}

fn energy(h: &Matrix3<f64>, lame: Lame) -> f64 {
    let f = Matrix3::identity() + h;
    let r = rotation(&f);
    lame.mu * (f - r).norm_squared() + 0.5 * lame.lambda * (r.dot(&f) - 3.0).powi(2)
}

fn stress(h: &Matrix3<f64>, lame: Lame) -> Matrix3<f64> {
    let f = Matrix3::identity() + h;
    let r = rotation(&f);
    (f - r) * (2.0 * lame.mu) + r * (lame.lambda * (r.dot(&f) - 3.0))
}

fn tangent(h: &Matrix3<f64>, lame: Lame) -> Tangent {
    let f = Matrix3::identity() + h;
    let r = rotation(&f);
    let s = r.transpose() * f;
    let s = (s + s.transpose()) * 0.5;
    let sums = (Matrix3::from_diagonal_element(s.trace()) - s).symmetric_eigen();
    let inverse = sums.eigenvectors
        * Matrix3::from_diagonal(&sums.eigenvalues.map(|sum| 1.0 / sum.max(LEAST)))
        * sums.eigenvectors.transpose();
    let turning = lame.lambda * (s.trace() - 3.0) - 2.0 * lame.mu;
    let mut c = Tangent::from_diagonal_element(2.0 * lame.mu);
    for l in 0..3 {
        for k in 0..3 {
            // dF = e_k⊗e_L, for which the axial vector is e_L × Rᵀ e_k.
            let axial = Vector3::ith(l, 1.0).cross(&r.row(k).transpose());
            let change = r * (inverse * axial).cross_matrix() * turning + r * (lame.lambda * r[(k, l)]);
            let mut column = c.fixed_view_mut::<9, 1>(0, 3 * l + k);
            column += change.reshape_generic(nalgebra::Const::<9>, nalgebra::Const::<1>);
        }
    }
    c
}
