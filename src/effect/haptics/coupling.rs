//! The virtual coupling between the handle and the hold on a body: a spring that softens bodies that are too stiff for the
//! device, and that keeps the push within the device's limits so that it remains the gradient of a potential.
//!
//! In: the body's stiffness at the handle, the device's friction and limits. Out: the hold's offset from the handle, the
//! push there, and the energy whose negative gradient it is.
//!
//! The hold is where U = V(hold) + ½ fᵀ Γ f + s is least, V the body's energy (R. J. Adams and B. Hannaford, IEEE Trans.
//! Robotics and Automation 15, 1999, 465-474, for Γ). The last term is the limit: with y = (f/F, t/T), where F and T are
//! the device's limits, it is s |y| for a hold that has slipped by s (f/F², t/T²), and it slips just so far that |y| ≤ 1.
//! The minimum over the hold is a function of the handle's place alone, so its gradient does no work around a closed path.
//! A push that were clipped to its limit would do work if a body is stiffer in one direction than in another.

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector6};

/// With D = diag(b, b, b, b_r, b_r, b_r) and D⁻½ K D⁻½ = Q Λ Qᵀ, Γ = D⁻½ Q diag(max(0, 1/k - 1/λ)) Qᵀ D⁻½ reduces
/// every λ greater than k, the stiffness that friction bears, to k.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// K with the magnitudes of its eigenvalues, 6 × 6 in N/m, N and N·m; without torque the translations only.
    stiffness: Matrix6<f64>,
    /// Γ, m/N and so on.
    pub compliance: Matrix6<f64>,
    /// Newton's step for f = push(hold moved by Γ f) from its residual: (1 + K Γ)⁻¹.
    pub step: Matrix6<f64>,
    /// The body's stiffness over what the device bears, in the stiffest direction; up to 1 nothing is softened.
    pub stiffer: f64,
    /// 1/F and 1/T; 0: no limit.
    per_limit: Vector6<f64>,
    /// Principal directions and stiffnesses of K (1 + Γ K)⁻¹ in units of the limits; computed when first needed.
    saturated: Option<(Matrix6<f64>, Vector6<f64>)>,
}

/// The hold's offset from the handle, and its push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CouplingState {
    /// Translation and rotation vector of the hold from the handle, m and rad.
    pub offset: Vector6<f64>,
    /// On the hand.
    pub push: Vector6<f64>,
    /// U - V: the energy of the springs, and of the hold's last step, J.
    pub energy: f64,
    /// The hold's last step, and the longest step that it may take, m; rotations are multiplied by [`ARM_M`].
    moved: Vector6<f64>,
    radius: f64,
    /// The last step was limited: the hold has not arrived yet.
    pub is_on_the_way: bool,
    /// The body pulls harder than the device can push.
    pub is_limited: bool,
}

/// Beside the handle, with no push yet.
impl Default for CouplingState {
    fn default() -> CouplingState {
        let none = Vector6::zeros();
        CouplingState {
            offset: none,
            push: none,
            energy: 0.0,
            moved: none,
            radius: RADIUS_M,
            is_on_the_way: false,
            is_limited: false,
        }
    }
}

impl CouplingState {
    /// The hold beside a handle.
    pub fn hold(&self, handle: &Isometry3<f64>) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.offset.fixed_rows::<3>(3).into_owned());
        let place = handle.translation.vector + self.offset.fixed_rows::<3>(0);
        Isometry3::from_parts(Translation3::from(place), turn * handle.rotation)
    }
}

/// The longest step: faster than any hand in a tick, and short enough for the stiffness at the handle to be valid.
const RADIUS_M: f64 = 5e-3;
const ARM_M: f64 = 0.1;

/// Softer directions count with this fraction of the stiffest one's stiffness.
const SOFTEST: f64 = 1e-6;

impl Coupling {
    /// `damping` is b and b_r, `bearable` the largest stiffness per unit of friction, 1/s. `limits` are those of the device,
    /// N and N·m; 0 N·m for one without torque.
    pub fn new(
        stiffness: &Matrix6<f64>,
        damping: [f64; 2],
        has_torque: bool,
        bearable: f64,
        limits: Option<[f64; 2]>,
    ) -> Coupling {
        let root = Vector6::from_fn(|k, _| damping[k / 3].max(1e-9).sqrt());
        let counted = if has_torque { 6 } else { 3 };
        let part = |i: usize, j: usize| if i.max(j) < counted { stiffness[(i, j)] } else { 0.0 };
        let scaled = Matrix6::from_fn(|i, j| part(i, j) / (root[i] * root[j]));
        if !scaled.iter().all(|x| x.is_finite()) {
            return Coupling::default();
        }
        let mut eigen = scaled.symmetric_eigen();
        // Where the body gives way, it counts as stiff as it is unstable: the steps go downhill and stay short.
        eigen.eigenvalues.apply(|value| *value = value.abs());
        let k = bearable.max(1e-9);
        let inside = |of: &dyn Fn(f64) -> f64| {
            let diagonal = Matrix6::from_diagonal(&eigen.eigenvalues.map(of));
            eigen.eigenvectors * diagonal * eigen.eigenvectors.transpose()
        };
        let compliance = inside(&|l| if l > k { 1.0 / k - 1.0 / l } else { 0.0 });
        let step = inside(&|l| if l > k { k / l } else { 1.0 });
        let per = |limit: f64| if limit > 0.0 { 1.0 / limit } else { 0.0 };
        let [force, torque] = limits.map_or([0.0; 2], |limits| limits.map(per));
        Coupling {
            stiffness: {
                let positive = inside(&|l| l);
                Matrix6::from_fn(|i, j| positive[(i, j)] * root[i] * root[j])
            },
            compliance: Matrix6::from_fn(|i, j| compliance[(i, j)] / (root[i] * root[j])),
            step: Matrix6::from_fn(|i, j| step[(i, j)] * root[i] / root[j]),
            stiffer: eigen.eigenvalues.max() / k,
            per_limit: Vector6::new(force, force, force, torque, torque, torque),
            saturated: None,
        }
    }

    /// One Newton step from the body's `push` at the hold of `last`; exact if the push is linear.
    pub fn settle(&mut self, push: &Vector6<f64>, last: &CouplingState) -> CouplingState {
        let free = self.step * (push + self.stiffness * last.offset);
        let (push_now, slip) = self.limited(&free);
        let y = push_now.component_mul(&self.per_limit);
        let given = self.compliance * push_now;
        let mut moved = given + y.component_mul(&self.per_limit) * slip - last.offset;
        let arm = Vector6::new(1.0, 1.0, 1.0, ARM_M, ARM_M, ARM_M);
        let way = moved.component_mul(&arm).norm();
        let (mut radius, is_on_the_way) = (last.radius, way > last.radius);
        if is_on_the_way {
            // The steps alternate, so the stiffness does not describe the body well.
            let is_turning = moved.dot(&last.moved.component_mul(&arm).component_mul(&arm)) < 0.0;
            moved *= radius / way;
            radius = if is_turning { 0.5 * radius } else { (1.5 * radius).min(RADIUS_M) };
        }
        let energy = 0.5 * push_now.dot(&given) + slip * y.norm_squared() - push.dot(&moved)
            + 0.5 * moved.dot(&(self.stiffness * moved));
        let (offset, is_limited) = (last.offset + moved, slip > 0.0);
        CouplingState { offset, push: push_now, energy, moved, radius, is_on_the_way, is_limited }
    }

    /// (1 + s W)⁻¹ y with the least s ≥ 0 that keeps it within 1, y and the stiffness W in units of the limits: the push,
    /// and s in J.
    fn limited(&mut self, free: &Vector6<f64>) -> (Vector6<f64>, f64) {
        let y = free.component_mul(&self.per_limit);
        let size = y.norm();
        // NaN is passed on and found by the caller.
        if size.is_nan() || size <= 1.0 {
            return (*free, 0.0);
        }
        let (directions, stiffness) = *self.saturated.get_or_insert_with(|| {
            let (per, softened) = (&self.per_limit, self.step * self.stiffness);
            let scaled =
                Matrix6::from_fn(|i, j| 0.5 * (softened[(i, j)] + softened[(j, i)]) * per[i] * per[j]);
            let eigen = scaled.symmetric_eigen();
            let least = SOFTEST * eigen.eigenvalues.amax();
            (eigen.eigenvectors, eigen.eigenvalues.map(|w| w.max(least)))
        });
        let z = directions.transpose() * y;
        let mut slip: f64 = 0.0;
        // Newton's iteration for 1/|y| = 1, which is nearly straight in s.
        for _ in 0..12 {
            let part = stiffness.map(|w| 1.0 / (1.0 + slip * w));
            let now = z.component_mul(&part);
            let size = now.norm();
            let slope: f64 = (0..6).map(|k| now[k] * now[k] * stiffness[k] * part[k]).sum();
            if (size - 1.0).abs() < 1e-9 || slope <= 0.0 {
                break;
            }
            slip = (slip + (size - 1.0) * size * size / slope).max(0.0);
        }
        let now = directions * z.component_mul(&stiffness.map(|w| 1.0 / (1.0 + slip * w)));
        // If nothing yields, or the iteration has not converged.
        let now = now / now.norm().max(1.0);
        let limited = |k: usize, per: f64| if per > 0.0 { now[k] / per } else { free[k] };
        (Vector6::from_fn(|k, _| limited(k, self.per_limit[k])), slip)
    }
}

/// A rigid coupling without limits.
impl Default for Coupling {
    fn default() -> Coupling {
        Coupling {
            stiffness: Matrix6::zeros(),
            compliance: Matrix6::zeros(),
            step: Matrix6::identity(),
            stiffer: 0.0,
            per_limit: Vector6::zeros(),
            saturated: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coupling_softens_what_is_too_stiff_and_nothing_else() {
        let root = Matrix6::from_fn(|i, j| ((7 * i + 3 * j) as f64).sin() + if i == j { 3.0 } else { 0.0 });
        let stiffness = root * root.transpose() * 100.0;
        let damping: [f64; 2] = [2.0, 0.5];
        let friction = |k: usize| -> f64 { damping[k / 3] };
        let ratios = |k: &Matrix6<f64>| {
            Matrix6::from_fn(|i, j| k[(i, j)] / (friction(i) * friction(j)).sqrt()).symmetric_eigenvalues()
        };
        let all = ratios(&stiffness);
        let k = 0.5 * (all.min() + all.max());
        let coupling = Coupling::new(&stiffness, damping, true, k, None);
        assert!((coupling.stiffer - all.max() / k).abs() < 1e-12);
        // Both springs in series: (K⁻¹ + Γ)⁻¹.
        let softened = (stiffness.try_inverse().unwrap() + coupling.compliance).try_inverse().unwrap();
        let (mut expected, mut found) = (all.map(|l| l.min(k)), ratios(&softened));
        expected.as_mut_slice().sort_by(f64::total_cmp);
        found.as_mut_slice().sort_by(f64::total_cmp);
        assert!((expected - found).norm() < 1e-9 * k, "{expected} {found}");
        let newton = (Matrix6::identity() + stiffness * coupling.compliance).try_inverse().unwrap();
        assert!((newton - coupling.step).norm() < 1e-9);
        let three = Coupling::new(&stiffness, damping, false, k, None);
        assert!(three.compliance.fixed_view::<3, 6>(3, 0).norm() == 0.0 && three.stiffer > 0.0);
    }

    /// On a body that is stiffer in one direction than in another, handle and limit in all six degrees of freedom: the
    /// push is minus the slope of U, and reaches the limit without passing it.
    #[test]
    fn a_limited_push_is_the_slope_of_its_energy() {
        let root = Matrix6::from_fn(|i, j| ((5 * i + 2 * j) as f64).sin() + if i == j { 2.0 } else { 0.0 });
        let per_torque = Vector6::new(1.0, 1.0, 1.0, 0.05, 0.05, 0.05);
        let stiffness =
            Matrix6::from_fn(|i, j| (root * root.transpose())[(i, j)] * per_torque[i] * per_torque[j]);
        let stiffness = stiffness * 100.0;
        let mut coupling = Coupling::new(&stiffness, [1.0, 2e-3], true, 800.0, Some([3.0, 0.2]));
        assert!(coupling.stiffer > 1.0);
        // V = ½ hᵀ K h; one step is the answer once it is near.
        let mut at = |x: &Vector6<f64>| {
            let mut give = CouplingState::default();
            loop {
                let hold = x + give.offset;
                give = coupling.settle(&(-stiffness * hold), &give);
                if !give.is_on_the_way {
                    return (give, 0.5 * hold.dot(&(stiffness * hold)) + give.energy);
                }
            }
        };
        let (mut least, mut most) = (f64::MAX, 0.0f64);
        for far in [0.001, 0.01, 0.1] {
            let x = Vector6::new(1.0, -0.4, 0.3, 2.0, 1.0, -3.0) * far;
            let (give, _) = at(&x);
            let size =
                (give.push.fixed_rows::<3>(0).norm() / 3.0).hypot(give.push.fixed_rows::<3>(3).norm() / 0.2);
            (least, most) = (least.min(size), most.max(size));
            let slope = Vector6::from_fn(|k, _| {
                let mut step = Vector6::zeros();
                step[k] = 1e-6;
                (at(&(x + step)).1 - at(&(x - step)).1) / 2e-6
            });
            assert!((slope + give.push).norm() < 1e-6 * give.push.norm(), "{far}: {slope} {}", give.push);
        }
        assert!(least < 0.5 && (most - 1.0).abs() < 1e-9, "{least} {most}");
    }
}
