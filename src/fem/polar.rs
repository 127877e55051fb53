//! Polar decomposition: a matrix as a proper rotation times a stretch.
//!
//! ```text
//! A = U Σ Vᵀ = R S     R = U D Vᵀ     S = V D Σ Vᵀ     D = diag(1, 1, det U Vᵀ)     σ₁ ≥ σ₂ ≥ σ₃ ≥ 0
//! ```
//!
//! R is the proper rotation nearest to A (W. Kabsch, Acta Cryst. A32, 1976, 922-923), also where A mirrors, and at half
//! a turn, where iterations that start from a rotation do not converge. It is unique where σ₂ + det(U Vᵀ) σ₃ > 0.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The parts of A.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polar {
    pub u: Matrix3<f64>,
    /// σ, descending.
    pub sigma: Vector3<f64>,
    /// Vᵀ.
    pub vt: Matrix3<f64>,
    /// det U Vᵀ: -1 where A mirrors, else 1.
    pub sign: f64,
}

impl Polar {
    /// `None` where a number of A, or of its decomposition, is not finite.
    pub fn new(a: &Matrix3<f64>) -> Option<Polar> {
        if !a.iter().all(|value| value.is_finite()) {
            return None;
        }
        let svd = a.svd(true, true);
        let (u, vt, sigma) = (svd.u?, svd.v_t?, svd.singular_values);
        let is_finite = u.iter().chain(&vt).chain(&sigma).all(|value| value.is_finite());
        let sign = if (u * vt).determinant() < 0.0 { -1.0 } else { 1.0 };
        is_finite.then_some(Polar { u, sigma, vt, sign })
    }

    /// R as a quaternion, whose angle is also accurate at 0° and 180°, where the arc cosine of R's trace may be no
    /// number.
    pub fn turn(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&self.rotation())
    }

    /// R.
    pub fn rotation(&self) -> Rotation3<f64> {
        self.with_signs([1.0, 1.0, self.sign])
    }

    /// U diag(signs) Vᵀ, which is a rotation where the signs' product is [`Polar::sign`].
    pub fn with_signs(&self, signs: [f64; 3]) -> Rotation3<f64> {
        Rotation3::from_matrix_unchecked(self.u * Matrix3::from_diagonal(&Vector3::from(signs)) * self.vt)
    }

    /// V Σ Vᵀ: S where A does not mirror, else S with its negative stretch turned positive.
    pub fn stretch(&self) -> Matrix3<f64> {
        self.vt.transpose() * Matrix3::from_diagonal(&self.sigma) * self.vt
    }
}

/// The proper rotation nearest to A; the identity where A is not finite.
pub fn nearest_turn(a: &Matrix3<f64>) -> UnitQuaternion<f64> {
    Polar::new(a).map_or_else(UnitQuaternion::identity, |polar| polar.turn())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Axes along edges, faces' diagonals and space diagonals of a cube, and around a spiral over the sphere.
    fn axes() -> Vec<Vector3<f64>> {
        let lattice = (0..27).map(|i| Vector3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)));
        let lattice = lattice.map(|axis| axis.add_scalar(-1.0)).filter(|axis| axis.norm() > 0.5);
        let spiral = (0..100).map(|i| {
            let z = (f64::from(i) + 0.5) / 50.0 - 1.0;
            let (angle, radius) = (2.4 * f64::from(i), (1.0 - z * z).sqrt());
            Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
        });
        lattice.chain(spiral).map(|axis| axis.normalize()).collect()
    }

    fn assert_proper(rotation: &Rotation3<f64>, what: &str) {
        let r = rotation.matrix();
        assert!((r.transpose() * r - Matrix3::identity()).amax() < 1e-13, "{what}: {r}");
        assert!((r.determinant() - 1.0).abs() < 1e-13, "{what}: {r}");
    }

    /// R S is taken apart again, from no turn to exactly half a turn about any axis.
    #[test]
    fn rotations_come_back_at_half_a_turn_too() {
        let stretch = Matrix3::new(1.5, 0.2, 0.0, 0.2, 0.7, -0.1, 0.0, -0.1, 2.0);
        for axis in axes() {
            for angle in [0.0, 1e-9, 0.5, PI / 2.0, 2.0, PI - 1e-7, PI - 1e-15, PI] {
                let exact = Rotation3::new(axis * angle);
                for s in [Matrix3::identity(), stretch] {
                    let polar = Polar::new(&(exact.matrix() * s)).unwrap();
                    let rotation = polar.rotation();
                    let what = format!("{angle} rad about {axis:?}");
                    assert_proper(&rotation, &what);
                    assert!((rotation.matrix() - exact.matrix()).amax() < 1e-13, "{what}: {rotation}");
                    assert!((polar.stretch() - s).amax() < 1e-13, "{what}");
                    let turn = nearest_turn(&(exact.matrix() * s));
                    assert!((turn.angle() - angle).abs() < 1e-13, "{what}: {}", turn.angle());
                    assert!((turn.to_rotation_matrix().matrix() - exact.matrix()).amax() < 1e-13, "{what}");
                }
            }
        }
    }

    /// Half a turn about an axis along an edge is a diagonal matrix: nothing rounds.
    #[test]
    fn half_a_turn_that_is_exact_is_kept_exactly() {
        for signs in [[1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let half_turn = Matrix3::from_diagonal(&Vector3::from(signs));
            assert_eq!(*Polar::new(&half_turn).unwrap().rotation().matrix(), half_turn);
            assert_eq!(nearest_turn(&half_turn).angle(), PI);
        }
    }

    /// One stretch down to nothing, and beyond it: the rotation is still that one; of two, any is as near, but it is
    /// one.
    #[test]
    fn flat_matrices_have_a_rotation() {
        for axis in axes() {
            let exact = Rotation3::new(axis * PI);
            for least in [1e-3, 1e-8, 1e-15, 1e-300, 0.0, -1e-15, -1e-8, -1e-3] {
                let what = format!("{least} about {axis:?}");
                let flat = exact.matrix() * Matrix3::from_diagonal(&Vector3::new(1.0, 0.6, least));
                let polar = Polar::new(&flat).unwrap();
                assert_proper(&polar.rotation(), &what);
                assert!((polar.rotation().matrix() - exact.matrix()).amax() < 1e-12, "{what}");
                assert!((polar.sigma - Vector3::new(1.0, 0.6, least.abs())).amax() < 1e-13, "{what}");
                if least.abs() > 1e-12 {
                    assert_eq!(polar.sign, least.signum(), "{what}");
                }
                let line = exact.matrix() * Matrix3::from_diagonal(&Vector3::new(1.0, least, least));
                assert_proper(&Polar::new(&line).unwrap().rotation(), &what);
                assert_proper(&Polar::new(&(flat * 1e-30)).unwrap().rotation(), &what);
            }
        }
        assert_proper(&Polar::new(&Matrix3::zeros()).unwrap().rotation(), "nothing");
    }

    #[test]
    fn what_is_not_finite_has_no_rotation() {
        for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
            let mut a = Matrix3::identity();
            a[(1, 2)] = bad;
            assert_eq!((Polar::new(&a), nearest_turn(&a)), (None, UnitQuaternion::identity()));
        }
    }
}
