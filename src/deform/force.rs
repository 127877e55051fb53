//! Force and torque on every control element from the handle stiffness: g = S c.

use crate::green::FIELDS;
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

/// What a hand must apply to a control element to hold it where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    /// N.
    pub force: Vector3<f64>,
    /// About the element's origin, N·m; lever arms are those at rest, as the linear theory has them.
    pub moment: Vector3<f64>,
}

/// The wrench on every control element by the coefficients c of its twelve columns, and the body's strain energy ½ cᵀ S c in J.
///
/// The generalised force on field k is g_k = (S c)_k: three forces Σ f_i, then Σ f_i (X - o)_j row by row, whose
/// skew part is the moment. `body_from_surface` turns the result from the frame in which c was taken.
pub fn wrenches(
    stiffness: &DMatrix<f64>,
    coefficients: &[f64],
    body_from_surface: UnitQuaternion<f64>,
) -> (Vec<Wrench>, f64) {
    let c = DVector::from_column_slice(coefficients);
    let g = stiffness * &c;
    let wrench = |g: &[f64]| {
        let moment_arm = |i: usize, j: usize| g[3 + 3 * i + j];
        Wrench {
            force: body_from_surface * Vector3::new(g[0], g[1], g[2]),
            moment: body_from_surface
                * Vector3::new(
                    moment_arm(2, 1) - moment_arm(1, 2),
                    moment_arm(0, 2) - moment_arm(2, 0),
                    moment_arm(1, 0) - moment_arm(0, 1),
                ),
        }
    };
    (g.as_slice().chunks_exact(FIELDS).map(wrench).collect(), 0.5 * c.dot(&g))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_force_on_a_lever_gives_its_moment() {
        let (f, r) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 0.1, -0.7));
        let mut g = vec![f.x, f.y, f.z];
        g.extend((0..9).map(|k| f[k / 3] * r[k % 3]));
        let stiffness = DMatrix::from_diagonal(&DVector::from_vec(g));
        let (wrenches, energy) = wrenches(&stiffness, &[1.0; FIELDS], UnitQuaternion::identity());
        assert!((wrenches[0].force - f).norm() < 1e-15 && (wrenches[0].moment - r.cross(&f)).norm() < 1e-15);
        assert!((energy - 0.5 * stiffness.trace()).abs() < 1e-15);
    }
}
