//! The boundary integral operators of isotropic elasticity, tested with functions on the same triangles.
//!
//! In: triangles and material constants. Out: blocks of the matrices of
//!
//! ```text
//! V t = (½ + K) u     D u = (½ - Kᵀ) t
//! ```
//!
//! with u linear on each triangle and continuous, t constant on each. Kernels that cannot be integrated are integrated by parts on
//! the surface first: with c the curl n × ∇φ of a corner's function, all that is left are [`Pull`] and [`pairs::view`] (Kupradze,
//! Three-Dimensional Problems of the Mathematical Theory of Elasticity and Thermoelasticity, 1979, chapter 5; Han, J. Comput. Math. 12, 1994;
//! Steinbach, Numerical Approximation Methods for Elliptic Boundary Value Problems, 2008, section 6.7). Nothing of it grows without
//! bounds as Poisson's ratio nears ½.

use super::pairs;
use super::triangle::{Pull, Triangle};
use crate::fem::Lame;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

/// Shear modulus and Poisson's ratio.
#[derive(Clone, Copy, Debug)]
pub struct Material {
    mu: f64,
    nu: f64,
}

impl From<Lame> for Material {
    fn from(Lame { lambda, mu }: Lame) -> Material {
        Material { mu, nu: lambda / (2.0 * (lambda + mu)) }
    }
}

impl Material {
    /// V: the displacement, summed over one triangle, that a unit traction on another causes by Kelvin's solution, m³ for N/m².
    pub fn single_layer(self, pull: &Pull) -> Matrix3<f64> {
        let factor = 1.0 / (16.0 * PI * self.mu * (1.0 - self.nu));
        pull.combined(factor * (3.0 - 4.0 * self.nu), factor)
    }

    /// K: a block for each corner of j, its rows tested on i.
    pub fn double_layer(self, i: &Triangle, j: &Triangle, pull: &Pull) -> [Matrix3<f64>; 3] {
        let view = if std::ptr::eq(i, j) { Vector3::zeros() } else { pairs::view(i, j) } / (4.0 * PI);
        let factor = 1.0 / (8.0 * PI * (1.0 - self.nu));
        let shear = pull.combined(factor * (1.0 - 2.0 * self.nu), factor);
        std::array::from_fn(|q| Matrix3::from_diagonal_element(view[q]) + times_cross(&shear, &j.curls[q]))
    }

    /// D: block \[p\]\[q\] for corner p of i and corner q of j, N/m.
    pub fn hypersingular(self, i: &Triangle, j: &Triangle, pull: &Pull) -> [[Matrix3<f64>; 3]; 3] {
        let factor = self.mu / (4.0 * PI);
        let g = factor * pull.g;
        let within = factor / (1.0 - self.nu);
        let inner = pull.combined(within * (1.0 - 2.0 * self.nu), within);
        let columns = j.curls.map(|d| times_cross(&inner, &d));
        std::array::from_fn(|p| {
            let c = &i.curls[p];
            std::array::from_fn(|q| {
                let d = &j.curls[q];
                let plain = Matrix3::from_diagonal_element(2.0 * g * c.dot(d)) - c * d.transpose() * g;
                plain + Matrix3::from_columns(&[0, 1, 2].map(|k| c.cross(&columns[q].column(k))))
            })
        })
    }
}

/// M \[d\], with \[d\] b = d × b.
fn times_cross(m: &Matrix3<f64>, d: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_rows(&[0, 1, 2].map(|k| m.row(k).transpose().cross(d).transpose()))
}
