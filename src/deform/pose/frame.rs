//! Poses of control elements with the paper's twelve coefficients, and poses taken apart: where the origin is, how the element is
//! turned, how it is stretched.
//!
//! In: a pose T, M. Out: the place o + T, the rotation R and the symmetric stretch U of M = R U, R as the quaternion of the two
//! whose sign goes on from the one before; and the way back of forces: the derivatives of an energy by T and M from those by place,
//! rotation and stretch, and the force and torque that a hand must apply ([`Wrench`]). With X = Rᵀ dM the polar factors move by
//!
//! ```text
//! dR = R [w]     (tr U - U) w = axial X     dU = sym X - sym([w] U)
//! ∂V/∂M = R ([y] + P)     (tr U - U) y = τ - axial(P U)     for dV = τ·w + P:dU
//! ```

use crate::fem::Polar;
use crate::field::numbers::Numbers;
use crate::green::FIELDS;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// x ↦ o + T + M (x - o) on the nodes of one control element, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlPose {
    /// T, m.
    #[serde(with = "crate::field::numbers")]
    pub translation: Vector3<f64>,
    /// M.
    #[serde(with = "crate::field::numbers")]
    pub matrix: Matrix3<f64>,
}

/// One pose per control element, in the body's order.
pub type ControlPoses = Vec<ControlPose>;

impl ControlPose {
    pub const REST: ControlPose = ControlPose {
        translation: Vector3::new(0.0, 0.0, 0.0),
        matrix: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    };

    /// c: T, then M - I row by row.
    pub fn coefficients(&self) -> [f64; FIELDS] {
        flat(&self.translation, &(self.matrix - Matrix3::identity()))
    }

    /// Whether it moves no point of a ball of this radius, m, about its origin by more than this part of the radius.
    pub fn is_rest_within(&self, part: f64, radius: f64) -> bool {
        self.translation.norm() + (self.matrix - Matrix3::identity()).norm() * radius <= part * radius
    }

    /// Expresses the affine motion about the origin `to` instead of `from`: o + T + M (x - o) = o' + T' + M (x - o') with
    /// T' = T + (M - I)(o' - o).
    pub fn with_origin(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> ControlPose {
        let translation = self.translation + (self.matrix - Matrix3::identity()) * (to - from);
        ControlPose { translation, matrix: self.matrix }
    }

    pub fn is_finite(&self) -> bool {
        self.translation.iter().chain(self.matrix.iter()).all(|value| value.is_finite())
    }
}

/// The mean rotation is not defined where σ₂ + σ₃ of A vanishes (two elements half a turn apart), nor the mean of turns
/// where that of their quaternions does (a turn apart); below this part of σ₁, or of 1, the last one is kept.
pub const DEFINED: f64 = 0.1;

/// Whether A defines the rotation R at which tr(AᵀR) is stationary, by the eigenvalues β of RᵀA: the second derivatives
/// tr(RᵀA) I - RᵀA have the eigenvalues β_i + β_j, none of which may vanish. Where R is the polar factor, β are the σ.
pub fn is_mean_defined(beta: &Vector3<f64>) -> bool {
    let least =
        [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (beta[i] + beta[j]).abs()).into_iter().fold(f64::MAX, f64::min);
    least >= DEFINED * beta.amax() && beta.amax() > 0.0
}

/// The rotation in each M, as the quaternion of the two that continues `last`; without a last one, the shorter turn.
pub fn unwrapped(last: Option<&[UnitQuaternion<f64>]>, poses: &[ControlPose]) -> Vec<UnitQuaternion<f64>> {
    let before = |e: usize| last.and_then(|last| last.get(e));
    poses.iter().enumerate().map(|(e, pose)| continued(before(e), &pose.matrix)).collect()
}

/// The rotation in M, as the quaternion of the two that continues `before`; without one before, the shorter turn.
pub fn continued(before: Option<&UnitQuaternion<f64>>, m: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let Some(now) = nearest(m).map(|rotation| UnitQuaternion::from_rotation_matrix(&rotation)) else {
        return before.copied().unwrap_or_else(UnitQuaternion::identity);
    };
    same_side(before.unwrap_or(&UnitQuaternion::identity()), now)
}

/// The quaternion of the two of the rotation `now` that continues `before`.
pub fn same_side(before: &UnitQuaternion<f64>, now: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if now.coords.dot(&before.coords) >= 0.0 { now } else { UnitQuaternion::new_unchecked(-now.into_inner()) }
}

/// The rotation nearest to A, or `None` where it is not defined.
pub fn nearest(a: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    let [(nearest, beta), ..] = stationary(a)?;
    is_mean_defined(&beta).then_some(nearest)
}

/// The rotations at which tr(AᵀR) is stationary: the polar factor of A, which is the nearest to it, and those with two
/// of its signs turned; and the eigenvalues of RᵀA. `None` where A is not finite.
pub fn stationary(a: &Matrix3<f64>) -> Option<[(Rotation3<f64>, Vector3<f64>); 4]> {
    let polar = Polar::new(a)?;
    let sign = polar.sign;
    let signs = [[1.0, 1.0, sign], [1.0, -1.0, -sign], [-1.0, 1.0, -sign], [-1.0, -1.0, sign]];
    Some(signs.map(|signs| (polar.with_signs(signs), polar.sigma.component_mul(&Vector3::from(signs)))))
}

/// The axial vector a of X, with a · ω = X : \[ω\]; for Σ f r it is the moment Σ r × f.
pub fn axial(x: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(x[(2, 1)] - x[(1, 2)], x[(0, 2)] - x[(2, 0)], x[(1, 0)] - x[(0, 1)])
}

/// M = R U at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlFrame {
    /// o + T, m.
    pub place: Vector3<f64>,
    /// R, with the sign that continues the rotation before: it distinguishes a turn by 200° from one by -160°.
    pub turn: UnitQuaternion<f64>,
    /// U.
    pub stretch: Matrix3<f64>,
}

/// Derivatives of an energy by a [`ControlFrame`], in the body's axes but for that by U.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSlope {
    /// Slope by the place, N.
    pub force: Vector3<f64>,
    /// Slope by a turn exp(\[δ\]) R about the place, N·m.
    pub torque: Vector3<f64>,
    /// Slope by U: symmetric, in the element's own axes, N·m.
    pub stretch: Matrix3<f64>,
}

/// Derivatives of an energy by a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseSlope {
    /// ∂V/∂T, N: the force that a hand must apply.
    #[serde(with = "crate::field::numbers")]
    pub translation: Vector3<f64>,
    /// ∂V/∂M, N·m: Σ f_i y_jᵀ over the held nodes, y being their places from o at rest.
    #[serde(with = "crate::field::numbers")]
    pub matrix: Matrix3<f64>,
}

impl PoseSlope {
    /// Twelve numbers in the order of the coefficients.
    pub fn of_numbers(g: &[f64]) -> PoseSlope {
        PoseSlope { translation: Vector3::new(g[0], g[1], g[2]), matrix: Matrix3::from_row_slice(&g[3..]) }
    }

    /// ∂V/∂c, in the order of the coefficients.
    pub fn numbers(&self) -> [f64; FIELDS] {
        flat(&self.translation, &self.matrix)
    }
}

/// A vector, then a matrix row by row.
pub fn flat(vector: &Vector3<f64>, matrix: &Matrix3<f64>) -> [f64; FIELDS] {
    std::array::from_fn(|i| if i < 3 { vector[i] } else { matrix[(i / 3 - 1, i % 3)] })
}

impl ControlFrame {
    /// `None` where M is too flat to have a rotation.
    pub fn new(
        origin: &Vector3<f64>,
        pose: &ControlPose,
        before: Option<&UnitQuaternion<f64>>,
    ) -> Option<ControlFrame> {
        nearest(&pose.matrix)?;
        let turn = continued(before, &pose.matrix);
        let stretch = turn.to_rotation_matrix().transpose() * pose.matrix;
        let stretch = (stretch + stretch.transpose()) * 0.5;
        Some(ControlFrame { place: origin + pose.translation, turn, stretch })
    }

    /// The frame of an element that rests with its origin there.
    pub fn at_rest(origin: Vector3<f64>) -> ControlFrame {
        ControlFrame { place: origin, turn: UnitQuaternion::identity(), stretch: Matrix3::identity() }
    }

    /// The frame as a motion.
    pub fn motion(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.place.into(), self.turn)
    }

    /// M.
    pub fn matrix(&self) -> Matrix3<f64> {
        self.turn.to_rotation_matrix() * self.stretch
    }

    /// The derivatives by the pose from those by the frame.
    pub fn pull_back(&self, slope: &FrameSlope) -> PoseSlope {
        let (rotation, u) = (self.turn.to_rotation_matrix(), &self.stretch);
        let torque = rotation.transpose() * slope.torque;
        let spin = Matrix3::from_diagonal_element(u.trace()) - u;
        // A rotation is defined, so that no two stretches cancel.
        let y = spin.try_inverse().unwrap_or_else(Matrix3::zeros) * (torque - axial(&(slope.stretch * u)));
        PoseSlope { translation: slope.force, matrix: rotation * (y.cross_matrix() + slope.stretch) }
    }
}

/// The motion, then U.
impl Numbers for ControlFrame {
    const COUNT: usize = 16;

    fn list(&self) -> Vec<f64> {
        [self.motion().list(), self.stretch.list()].concat()
    }

    fn made(numbers: &[f64]) -> ControlFrame {
        let (motion, stretch) = numbers.split_at(7);
        let motion = Isometry3::made(motion);
        ControlFrame {
            place: motion.translation.vector,
            turn: motion.rotation,
            stretch: Matrix3::made(stretch),
        }
    }
}

/// Force and moment that hold a control element where it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wrench {
    /// N.
    #[serde(with = "crate::field::numbers")]
    pub force: Vector3<f64>,
    /// Moment about where the element's origin rested, N·m, with the lever arms of the deformed body.
    #[serde(with = "crate::field::numbers")]
    pub moment: Vector3<f64>,
}

impl Wrench {
    /// The wrench that does the work ∂V in every rigid motion of the element from `pose`: a turn by δω about the origin o moves T
    /// by δω × T and M by \[δω\] M.
    pub fn from_slope(slope: &PoseSlope, pose: &ControlPose) -> Wrench {
        let force = slope.translation;
        let moment = axial(&(slope.matrix * pose.matrix.transpose())) + pose.translation.cross(&force);
        Wrench { force, moment }
    }

    /// The wrench that holds the element in the theory of small strain, which writes equilibrium on the body at rest: whatever
    /// the pose, with the moment about where its origin rested.
    pub fn of_small_strain(slope: &PoseSlope) -> Wrench {
        Wrench::from_slope(slope, &ControlPose::REST)
    }

    /// This wrench with the moment about where the element's origin is at `pose`.
    pub fn about_the_place(&self, pose: &ControlPose) -> Wrench {
        self.about(&Vector3::zeros(), pose)
    }

    /// This wrench with the moment about where `pose` brings a point; `arm` leads from the point to the element's origin at rest.
    pub fn about(&self, arm: &Vector3<f64>, pose: &ControlPose) -> Wrench {
        Wrench { moment: self.moment + (arm - pose.translation).cross(&self.force), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3};

    #[test]
    fn slopes_go_back_to_the_pose() {
        let origin = Vector3::new(0.2, 0.1, -0.4);
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.5, -1.2, 0.8));
        let stretch = Matrix3::new(1.2, 0.1, -0.05, 0.1, 0.9, 0.15, -0.05, 0.15, 1.1);
        let pose = ControlPose { translation: Vector3::new(0.3, 0.4, -1.0), matrix: turn.matrix() * stretch };
        // V = a·p + t·log R + B:U, whose slopes by the frame are these where the turn is taken from R₀.
        let (a, t) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.7, 0.2, -0.9));
        let b = Matrix3::new(0.3, -0.2, 0.5, -0.2, 0.8, 0.1, 0.5, 0.1, -0.4);
        let energy = |pose: &ControlPose| {
            let frame = ControlFrame::new(&origin, pose, None).unwrap();
            let moved = frame.turn * UnitQuaternion::from_rotation_matrix(&turn).inverse();
            a.dot(&frame.place) + t.dot(&moved.scaled_axis()) + b.dot(&frame.stretch)
        };
        let frame = ControlFrame::new(&origin, &pose, None).unwrap();
        let slope = frame.pull_back(&FrameSlope { force: a, torque: t, stretch: b });
        let step = 1e-6;
        for k in 0..12 {
            let moved = |by: f64| {
                let mut pose = pose;
                if k < 3 {
                    pose.translation[k] += by
                } else {
                    pose.matrix[(k / 3 - 1, k % 3)] += by
                }
                energy(&pose)
            };
            let expected = (moved(step) - moved(-step)) / (2.0 * step);
            let found = if k < 3 { slope.translation[k] } else { slope.matrix[(k / 3 - 1, k % 3)] };
            assert!((found - expected).abs() < 1e-8, "{k}: {found} {expected}");
        }
    }

    /// A force at a place y from the origin of an element that is turned and moved.
    #[test]
    fn one_force_on_a_lever_gives_its_moment() {
        let (f, y) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 0.1, -0.7));
        let matrix = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.2);
        let pose = ControlPose { translation: Vector3::new(0.4, -0.2, 1.0), matrix };
        let wrench = Wrench::from_slope(&PoseSlope { translation: f, matrix: f * y.transpose() }, &pose);
        let arm = pose.translation + matrix * y;
        assert!((wrench.force - f).norm() < 1e-15 && (wrench.moment - arm.cross(&f)).norm() < 1e-15);
    }
}
