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

use crate::deform::se3;
use nalgebra::{Const, Isometry3, Matrix6, SymmetricEigen, Translation3, UnitQuaternion, Vector6};

/// The compliance Γ of the coupling and its parameters.
///
/// With D = diag(b, b, b, b_r, b_r, b_r) and D⁻½ K D⁻½ = Q Λ Qᵀ, Γ = D⁻½ Q diag(max(0, 1/k - 1/λ)) Qᵀ D⁻½ reduces every λ greater
/// than k, the stiffness that friction bears, to k. Where K changes, Γ only grows: the least U over the hold then falls, so that
/// no change of the coupling generates energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// K with the magnitudes of its eigenvalues, 6 × 6 in N/m, N and N·m, corrected by what was felt since; without
    /// torque the translations only. The push does not depend on it, only how fast the hold comes to its place.
    stiffness: Matrix6<f64>,
    /// Γ, m/N and so on.
    pub compliance: Matrix6<f64>,
    /// Newton's step for f = push(hold moved by Γ f) from its residual: (1 + K Γ)⁻¹.
    pub step: Matrix6<f64>,
    /// The body's stiffness over what the device bears, in the stiffest direction; up to 1 nothing is softened.
    pub stiffer: f64,
    /// Γ is greater than K asks for now.
    pub is_too_soft: bool,
    /// √b and √b_r.
    root: Vector6<f64>,
    /// Coordinates that have a force: 6, or 3 without torque.
    counted: usize,
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
    /// ∂U by the offset, N and N·m.
    pub push: Vector6<f64>,
    /// U - V: the energy of the springs, and of the hold's last step, J.
    pub energy: f64,
    /// The slip of the hold under the limit, J.
    slip: f64,
    /// The hold's last step, and the longest step that it may take, m; rotations are multiplied by [`ARM_M`].
    moved: Vector6<f64>,
    radius: f64,
    /// The last step was limited, or long: the hold has not arrived yet.
    pub is_on_the_way: bool,
    /// The body pulls harder than the device can push.
    pub is_limited: bool,
}

/// A hold at the handle, without a push.
impl Default for CouplingState {
    fn default() -> CouplingState {
        let none = Vector6::zeros();
        CouplingState {
            offset: none,
            push: none,
            energy: 0.0,
            slip: 0.0,
            moved: none,
            radius: RADIUS_M,
            is_on_the_way: false,
            is_limited: false,
        }
    }
}

impl CouplingState {
    /// Forces by the offset, from force and torque (N, N·m) on the hold: dθ = V⁻¹(θ) ω for the rotation vector θ.
    pub fn by_offset(&self, push: &Vector6<f64>) -> Vector6<f64> {
        let (force, torque) = se3::halves(push);
        let turn = self.offset.fixed_rows::<3>(3).into_owned();
        se3::joined(&force, &(se3::slide_matrix(&turn).transpose() * torque))
    }

    /// Force and torque on the handle, whose turning changes θ by -V⁻ᵀ(θ) ω.
    pub fn on_handle(&self) -> Vector6<f64> {
        let (force, torque) = se3::halves(&self.push);
        let turn = self.offset.fixed_rows::<3>(3).into_owned();
        se3::joined(&force, &(se3::inverse_slide_matrix(&turn) * torque))
    }

    /// Whether the coupling holds no energy that its replacement would change, J.
    pub fn is_slack(&self, compliance: &Matrix6<f64>) -> bool {
        !self.is_limited && 0.5 * self.push.dot(&(compliance * self.push)) < SLACK_J
    }

    /// The hold beside a handle.
    pub fn hold(&self, handle: &Isometry3<f64>) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.offset.fixed_rows::<3>(3).into_owned());
        let place = handle.translation.vector + self.offset.fixed_rows::<3>(0);
        Isometry3::from_parts(Translation3::from(place), turn * handle.rotation)
    }
}

/// Energies below are nothing, J.
const SLACK_J: f64 = 1e-9;

/// The longest step: faster than any hand in a tick, and short enough for the stiffness at the handle to be valid.
const RADIUS_M: f64 = 5e-3;
const ARM_M: f64 = 0.1;
/// A step has arrived that changes the energy by less than this part of the coupling's, or by less than this, J.
const ARRIVED: f64 = 1e-3;
const ARRIVED_J: f64 = 1e-7;

/// Softer directions count with this fraction of the stiffest one's stiffness.
const SOFTEST: f64 = 1e-6;
/// Γ counts as too great from this part of it on.
const TOO_SOFT: f64 = 0.01;
/// Least change of the push that the coupling learns from, in parts of the limits.
const LEARN: f64 = 1e-4;
/// Largest change of the push that the coupling learns from, over the expected change.
const UNLIKELY: f64 = 100.0;
/// Range of the found over the expected change within which it is learned in full.
const LEAST: f64 = 0.2;
const MOST: f64 = 5.0;

/// Q f(Λ) Qᵀ.
fn inside(eigen: &SymmetricEigen<f64, Const<6>>, of: impl Fn(f64) -> f64) -> Matrix6<f64> {
    let diagonal = Matrix6::from_diagonal(&eigen.eigenvalues.map(of));
    eigen.eigenvectors * diagonal * eigen.eigenvectors.transpose()
}

impl Coupling {
    /// A coupling that is still rigid. `damping` is b and b_r; `limits` are those of the device, N and N·m; 0 N·m for one without
    /// torque.
    pub fn new(damping: [f64; 2], has_torque: bool, limits: Option<[f64; 2]>) -> Coupling {
        let per = |limit: f64| if limit > 0.0 { 1.0 / limit } else { 0.0 };
        let [force, torque] = limits.map_or([0.0; 2], |limits| limits.map(per));
        Coupling {
            stiffness: Matrix6::zeros(),
            compliance: Matrix6::zeros(),
            step: Matrix6::identity(),
            stiffer: 0.0,
            is_too_soft: false,
            root: Vector6::from_fn(|k, _| damping[k / 3].max(1e-9).sqrt()),
            counted: if has_torque { 6 } else { 3 },
            per_limit: Vector6::new(force, force, force, torque, torque, torque),
            saturated: None,
        }
    }

    /// Softens what is too stiff in a body of this stiffness; `bearable` is the largest stiffness per unit of friction,
    /// 1/s. A stiffness that is not finite changes nothing.
    pub fn suit(&mut self, stiffness: &Matrix6<f64>, bearable: f64) {
        let root = self.root;
        let part = |i: usize, j: usize| if i.max(j) < self.counted { stiffness[(i, j)] } else { 0.0 };
        let scaled = Matrix6::from_fn(|i, j| part(i, j) / (root[i] * root[j]));
        if !scaled.iter().all(|x| x.is_finite()) {
            return;
        }
        let mut eigen = scaled.symmetric_eigen();
        // Where the body gives way, it counts as stiff as it is unstable: the steps go downhill and stay short.
        eigen.eigenvalues.apply(|value| *value = value.abs());
        let k = bearable.max(1e-9);
        let asked = inside(&eigen, |l| if l > k { 1.0 / k - 1.0 / l } else { 0.0 });
        let more =
            (asked - self.compliance.zip_map(&(root * root.transpose()), |c, r| c * r)).symmetric_eigen();
        self.is_too_soft = more.eigenvalues.min() < -TOO_SOFT * asked.norm();
        let grown = inside(&more, |c| c.max(0.0));
        self.compliance += Matrix6::from_fn(|i, j| grown[(i, j)] / (root[i] * root[j]));
        self.stiffer = eigen.eigenvalues.max() / k;
        let positive = inside(&eigen, |l| l);
        self.expect(Matrix6::from_fn(|i, j| positive[(i, j)] * root[i] * root[j]));
    }

    /// K from now on.
    fn expect(&mut self, stiffness: Matrix6<f64>) {
        let step = (Matrix6::identity() + stiffness * self.compliance).try_inverse();
        if let Some(step) = step.filter(|step| step.iter().all(|x| x.is_finite())) {
            (self.stiffness, self.step, self.saturated) = (stiffness, step, None);
        }
    }

    /// Corrects K by the change of the body's push on a hold that has moved, so that the next step is true along this one
    /// (the BFGS formula, damped to keep K positive: J. Nocedal and S. Wright, Numerical Optimization, 2006, procedure 18.2).
    /// Without torque the force changes by turns too, of which K knows nothing: then K stays.
    pub fn learn(&mut self, moved: &Vector6<f64>, push_change: &Vector6<f64>) {
        let expected = self.stiffness * moved;
        let (work, felt) = (moved.dot(&expected), -push_change.dot(moved));
        let size = |force: &Vector6<f64>| force.component_mul(&self.per_limit).norm();
        let sizes = [size(&expected), size(push_change)];
        let is_known = self.counted == 6 && work > 0.0 && felt.is_finite();
        // A push that changes much without a motion says nothing of the stiffness.
        if !(is_known && sizes[1] > LEARN && sizes[1] < UNLIKELY * sizes[0]) {
            return;
        }
        let share = match felt / work {
            ratio if ratio < LEAST => (1.0 - LEAST) / (1.0 - ratio),
            ratio if ratio > MOST => (MOST - 1.0) / (ratio - 1.0),
            _ => 1.0,
        };
        let force = expected * (1.0 - share) - push_change * share;
        let change = force * force.transpose() / moved.dot(&force) - expected * expected.transpose() / work;
        self.expect(self.stiffness + change);
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
        let of_step = 0.5 * moved.dot(&(self.stiffness * moved));
        let energy = 0.5 * push_now.dot(&given) + slip * y.norm_squared() - push.dot(&moved) + of_step;
        // V is that of a spring only near the hold.
        let is_on_the_way = is_on_the_way || of_step > ARRIVED_J.max(ARRIVED * energy.abs());
        let (offset, is_limited) = (last.offset + moved, slip > 0.0);
        CouplingState { offset, push: push_now, energy, slip, moved, radius, is_on_the_way, is_limited }
    }

    /// Predicts the hold when the handle has moved by `moved`, to first order with K.
    pub fn follow(&self, moved: &Vector6<f64>, last: &CouplingState) -> CouplingState {
        let (place, turn) = se3::halves(moved);
        let angle = last.offset.fixed_rows::<3>(3).into_owned();
        let moved = se3::joined(&place, &(se3::inverse_slide_matrix(&-angle) * turn));
        let slipping = Matrix6::from_diagonal(&self.per_limit.component_mul(&self.per_limit)) * last.slip;
        let compliance = self.compliance + slipping;
        let push = (Matrix6::identity() + self.stiffness * compliance).lu().solve(&(self.stiffness * moved));
        let back = push.map_or_else(Vector6::zeros, |push| compliance * push);
        CouplingState { offset: last.offset - back, ..*last }
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

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
        let mut coupling = Coupling::new(damping, true, None);
        coupling.suit(&stiffness, k);
        assert!((coupling.stiffer - all.max() / k).abs() < 1e-12);
        // Both springs in series: (K⁻¹ + Γ)⁻¹.
        let softened = (stiffness.try_inverse().unwrap() + coupling.compliance).try_inverse().unwrap();
        let (mut expected, mut found) = (all.map(|l| l.min(k)), ratios(&softened));
        expected.as_mut_slice().sort_by(f64::total_cmp);
        found.as_mut_slice().sort_by(f64::total_cmp);
        assert!((expected - found).norm() < 1e-9 * k, "{expected} {found}");
        let newton = (Matrix6::identity() + stiffness * coupling.compliance).try_inverse().unwrap();
        assert!((newton - coupling.step).norm() < 1e-9);
        let mut three = Coupling::new(damping, false, None);
        three.suit(&stiffness, k);
        assert!(three.compliance.fixed_view::<3, 6>(3, 0).norm() == 0.0 && three.stiffer > 0.0);
    }

    /// The push is minus the slope of U, and reaches the limit without passing it: on a body that is stiffer in one direction
    /// than in another, handle and limit in all six degrees of freedom.
    #[test]
    fn a_limited_push_is_the_slope_of_its_energy() {
        let root = Matrix6::from_fn(|i, j| ((5 * i + 2 * j) as f64).sin() + if i == j { 2.0 } else { 0.0 });
        let per_torque = Vector6::new(1.0, 1.0, 1.0, 0.05, 0.05, 0.05);
        let stiffness =
            Matrix6::from_fn(|i, j| (root * root.transpose())[(i, j)] * per_torque[i] * per_torque[j]);
        let stiffness = stiffness * 100.0;
        let mut coupling = Coupling::new([1.0, 2e-3], true, Some([3.0, 0.2]));
        coupling.suit(&stiffness, 800.0);
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

    /// A body that is stiff in one direction and then in another stays softened in both; the coupling then reports that it is
    /// softer than needed.
    #[test]
    fn the_coupling_only_softens() {
        let along =
            |k: usize| Matrix6::from_fn(|i, j| if i == j { if i == k { 5e4 } else { 10.0 } } else { 0.0 });
        let mut coupling = Coupling::new([1.0, 1.0], true, None);
        coupling.suit(&along(0), 1000.0);
        let first = coupling.compliance;
        assert!(!coupling.is_too_soft && first[(0, 0)] > 9e-4 && first[(1, 1)].abs() < 1e-12);
        coupling.suit(&along(1), 1000.0);
        assert!(coupling.is_too_soft && coupling.stiffer == 50.0);
        assert!((coupling.compliance - first).symmetric_eigenvalues().min() > -1e-12);
        assert!(coupling.compliance[(1, 1)] > 9e-4, "{}", coupling.compliance);
    }

    #[test]
    fn what_was_felt_along_a_step_is_expected_along_the_next() {
        let root = Matrix6::from_fn(|i, j| ((3 * i + 5 * j) as f64).sin() + if i == j { 3.0 } else { 0.0 });
        let (known, felt) = (root * root.transpose(), root.transpose() * root * 1.5);
        let mut coupling = Coupling::new([1.0, 1.0], true, Some([1.0, 1.0]));
        coupling.suit(&known, f64::INFINITY);
        let moved = Vector6::new(0.2, -0.1, 0.4, 0.3, 0.1, -0.2);
        coupling.learn(&moved, &(-felt * moved));
        assert!((coupling.stiffness * moved - felt * moved).norm() < 1e-12 * (felt * moved).norm());
        assert!(coupling.stiffness.symmetric_eigenvalues().min() > 0.0);
        // An unstable direction leaves it positive.
        coupling.learn(&moved, &(felt * moved));
        assert!(coupling.stiffness.symmetric_eigenvalues().min() > 0.0);
    }

    /// Softer about one axis than about the others, with the hold turned far from the handle: the push on the handle is
    /// minus the slope of U by its motions, spins included.
    #[test]
    fn far_turns_push_as_the_energy_says() {
        let slope = |hold: &Isometry3<f64>, stiffness: &Matrix6<f64>| {
            let turn = hold.rotation.scaled_axis();
            let place = hold.translation.vector;
            let apart = se3::joined(&place, &turn);
            let force = stiffness * apart;
            // By a spin of the hold, dθ = V⁻¹(θ) ω.
            let (force, torque) = se3::halves(&force);
            let by_motion = se3::joined(&force, &(se3::inverse_slide_matrix(&turn).transpose() * torque));
            (0.5 * apart.dot(&(stiffness * apart)), by_motion)
        };
        let stiffness = Matrix6::from_diagonal(&Vector6::new(900.0, 40.0, 10.0, 4.0, 0.3, 1.0));
        let mut coupling = Coupling::new([1.0, 1e-3], true, None);
        coupling.suit(&stiffness, 300.0);
        let mut at = |handle: &Isometry3<f64>| {
            let mut give = CouplingState::default();
            for _ in 0..400 {
                let (energy, by_motion) = slope(&give.hold(handle), &stiffness);
                let next = coupling.settle(&give.by_offset(&-by_motion), &give);
                if (next.offset - give.offset).norm() < 1e-13 {
                    return (energy + next.energy, next);
                }
                give = next;
            }
            panic!("the hold does not come to rest: {give:?}");
        };
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.9, -0.5, 0.8));
        let handle = Isometry3::from_parts(Translation3::new(0.02, -0.01, 0.03), turn);
        let (_, give) = at(&handle);
        assert!(give.offset.fixed_rows::<3>(3).norm() > 0.5, "{}", give.offset);
        let push = give.on_handle();
        let slope = Vector6::from_fn(|k, _| {
            let mut moved = |by: f64| {
                let mut motion = Vector6::zeros();
                motion[k] = by;
                let (place, spin) = se3::halves(&motion);
                let turn = UnitQuaternion::from_scaled_axis(spin) * handle.rotation;
                at(&Isometry3::from_parts((handle.translation.vector + place).into(), turn)).0
            };
            (moved(1e-5) - moved(-1e-5)) / 2e-5
        });
        assert!((slope + push).norm() < 1e-5 * push.norm(), "{slope} {push}");
        let apart = (push - give.push).norm() / push.norm();
        assert!(apart > 0.01, "the turn between hold and handle matters here: {apart}");
    }

    /// offset = Γ f with f = -K (moved + offset): a body that is linear is followed exactly.
    #[test]
    fn the_hold_is_predicted_where_spring_and_body_balance() {
        let mut coupling = Coupling::new([2.0, 0.5], true, None);
        let stiffness = Matrix6::from_diagonal(&Vector6::new(4000.0, 3000.0, 5000.0, 30.0, 20.0, 40.0));
        coupling.suit(&stiffness, 1000.0);
        let moved = Vector6::new(1e-3, -2e-3, 5e-4, 0.0, 0.0, 0.0);
        let offset = coupling.follow(&moved, &CouplingState::default()).offset;
        let push = -(stiffness * (moved + offset));
        assert!((coupling.compliance * push - offset).norm() < 1e-12 && offset.norm() > 1e-4, "{offset}");
    }
}
