//! What keeps a sampled force from feeding the hand with energy: the largest stiffness that the device's own friction
//! can bear, and an observer that counts the energy and brakes.
//!
//! A force that is held for a tick T while the hand moves by Δx is late by T/2 on the mean: a spring K gives back
//! ½ K Δx² a tick more than it took. The device's friction b eats b Δx²/T. Hence b > K T/2 + |B| with a virtual damper B
//! (J. E. Colgate and G. Schenkel, "Passivity of a class of sampled-data systems", J. Robotic Systems 14, 1997, 37-47);
//! a further delay t_d of the device counts in full: b > K (T/2 + t_d) + |B|.
//!
//! A body that is stiffer is felt through a virtual coupling (R. J. Adams and B. Hannaford, IEEE Trans. Robotics and
//! Automation 15, 1999, 465-474), a spring between handle and body. It is made of the body's own stiffness at the handle:
//! soft in those directions alone in which the body is too stiff, and just so soft that both together are bearable. All
//! other directions are felt as they are.

use super::device::Push;
use nalgebra::{Matrix6, SMatrix, Vector3, Vector6};

/// Of the stiffness that is passive in theory so much is used: a loop's ticks are not all of one length.
pub const MARGIN: f64 = 0.8;

/// Largest stiffness, N/m, that a device of friction `damping` b N·s/m bears: (b - |B|)/(T/2 + t_d), never below 0.
pub fn largest_stiffness(damping: f64, virtual_damping: f64, period_s: f64, latency_s: f64) -> f64 {
    ((damping - virtual_damping.abs()) / (0.5 * period_s + latency_s)).max(0.0)
}

/// How the handle's motion (v, ω), m and rad of the device, moves the twelve coefficients of the held element.
pub type Jacobian = SMatrix<f64, 12, 6>;

/// The stiffness at the handle, 6 × 6 in N/m, N and N·m: Jᵀ S J of the held element's block of S.
pub fn handle_stiffness(block: &SMatrix<f64, 12, 12>, jacobian: &Jacobian) -> Matrix6<f64> {
    jacobian.transpose() * block * jacobian
}

/// A spring between the handle and the hold on the body: the hold is moved by Γ f while the hand is pushed with f.
///
/// With D = diag(b, b, b, b_r, b_r, b_r) and D⁻½ K D⁻½ = Q Λ Qᵀ, Γ = D⁻½ Q diag(max(0, 1/k - 1/λ)) Qᵀ D⁻½ makes of every
/// λ > k, what friction bears, k itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// Γ, m/N and so on.
    pub compliance: Matrix6<f64>,
    /// Newton's step for f = push(hold moved by Γ f) from its residual: (1 + K Γ)⁻¹.
    pub step: Matrix6<f64>,
    /// How many times stiffer the body is than the device bears, in its stiffest direction; up to 1 all is felt as it is.
    pub stiffer: f64,
}

impl Coupling {
    /// `damping` is b and b_r; `bearable` the largest stiffness for a friction of 1, 1/s. Without torque the three
    /// translations alone are coupled.
    pub fn new(stiffness: &Matrix6<f64>, damping: [f64; 2], has_torque: bool, bearable: f64) -> Coupling {
        let root = Vector6::from_fn(|k, _| damping[k / 3].max(1e-9).sqrt());
        let counted = if has_torque { 6 } else { 3 };
        let part = |i: usize, j: usize| if i.max(j) < counted { stiffness[(i, j)] } else { 0.0 };
        let scaled = Matrix6::from_fn(|i, j| part(i, j) / (root[i] * root[j]));
        if !scaled.iter().all(|x| x.is_finite()) {
            return Coupling::default();
        }
        let eigen = scaled.symmetric_eigen();
        let k = bearable.max(1e-9);
        let inside = |of: &dyn Fn(f64) -> f64| {
            let diagonal = Matrix6::from_diagonal(&eigen.eigenvalues.map(of));
            eigen.eigenvectors * diagonal * eigen.eigenvectors.transpose()
        };
        let compliance = inside(&|l| if l > k { 1.0 / k - 1.0 / l } else { 0.0 });
        let step = inside(&|l| if l > k { k / l } else { 1.0 });
        Coupling {
            compliance: Matrix6::from_fn(|i, j| compliance[(i, j)] / (root[i] * root[j])),
            step: Matrix6::from_fn(|i, j| step[(i, j)] * root[i] / root[j]),
            stiffer: eigen.eigenvalues.max() / k,
        }
    }
}

/// Rigid.
impl Default for Coupling {
    fn default() -> Coupling {
        Coupling { compliance: Matrix6::zeros(), step: Matrix6::identity(), stiffer: 0.0 }
    }
}

/// Counts what the hand gave and got, and brakes where it got more (B. Hannaford and J.-H. Ryu, "Time-domain passivity
/// control of haptic interfaces", IEEE Trans. Robotics and Automation 18, 2002, 1-10).
///
/// The work is exact: the force is held between two ticks, so that it is force · Δx. What the device's friction eats is
/// counted with it, or the brake would grip where friction does already.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// What came in from the hand and by design, less what went out and was not eaten by friction, J. Negative: energy was generated.
    pub energy: f64,
    /// Most that was missing at once, J.
    pub deepest: f64,
    /// What the brake took in all, J.
    pub braked: f64,
}

/// A brake beyond this part of the device's mass a tick would itself be unstable.
const BRAKE: f64 = 0.5;

impl Observer {
    /// The handle moved by (Δx, Δφ) in `time_s` under `held`; its own friction, b and b_r, ate b Δx²/Δt at least.
    pub fn moved(
        &mut self,
        held: &Push,
        dx: &Vector3<f64>,
        turn: &Vector3<f64>,
        damping: [f64; 2],
        time_s: f64,
    ) {
        let eaten = (damping[0] * dx.norm_squared() + damping[1] * turn.norm_squared()) / time_s;
        self.energy += eaten - held.force.dot(dx) - held.torque.dot(turn);
        self.deepest = self.deepest.max(-self.energy);
    }

    /// Energy put in by design: a force that ramps up, another hand that moves the body.
    pub fn credit(&mut self, energy: f64) {
        self.energy += energy;
    }

    /// The force with which to brake a handle of the given mass and inertia, moving by (v, ω), so that a tick takes what
    /// is missing.
    pub fn brake(
        &mut self,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
        mass: f64,
        inertia: f64,
        period_s: f64,
    ) -> Push {
        let rate = mass * v.norm_squared() + inertia * w.norm_squared();
        if self.energy >= 0.0 || rate <= 0.0 {
            return Push::NONE;
        }
        // α m v² + α J ω² is the power: α in 1/s.
        let alpha = (-self.energy / (period_s * rate)).min(BRAKE / period_s);
        self.braked += alpha * rate * period_s;
        Push { force: v * (-alpha * mass), torque: w * (-alpha * inertia) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_that_of_colgate_and_schenkel() {
        assert_eq!(largest_stiffness(1.0, 0.0, 1e-3, 0.0), 2000.0);
        assert_eq!(largest_stiffness(1.0, -0.5, 1e-3, 0.0), 1000.0);
        assert_eq!(largest_stiffness(1.0, 0.0, 1e-3, 1e-3), 1.0 / 1.5e-3);
        assert_eq!(largest_stiffness(1.0, 2.0, 1e-3, 0.0), 0.0);
    }

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
        let coupling = Coupling::new(&stiffness, damping, true, k);
        assert!((coupling.stiffer - all.max() / k).abs() < 1e-12);
        // Both springs in series: (K⁻¹ + Γ)⁻¹.
        let felt = (stiffness.try_inverse().unwrap() + coupling.compliance).try_inverse().unwrap();
        let (mut expected, mut found) = (all.map(|l| l.min(k)), ratios(&felt));
        expected.as_mut_slice().sort_by(f64::total_cmp);
        found.as_mut_slice().sort_by(f64::total_cmp);
        assert!((expected - found).norm() < 1e-9 * k, "{expected} {found}");
        let newton = (Matrix6::identity() + stiffness * coupling.compliance).try_inverse().unwrap();
        assert!((newton - coupling.step).norm() < 1e-9);
        let three = Coupling::new(&stiffness, damping, false, k);
        assert!(three.compliance.fixed_view::<3, 6>(3, 0).norm() == 0.0 && three.stiffer > 0.0);
    }

    #[test]
    fn the_brake_takes_what_is_missing_and_no_more() {
        let mut observer = Observer::default();
        let push = Push { force: Vector3::new(2.0, 0.0, 0.0), torque: Vector3::zeros() };
        observer.moved(&push, &Vector3::new(1e-4, 0.0, 0.0), &Vector3::zeros(), [0.0; 2], 1e-3);
        assert!((observer.energy + 2e-4).abs() < 1e-18 && observer.deepest == -observer.energy);
        let (v, none) = (Vector3::new(3.0, 0.0, 0.0), Vector3::zeros());
        let brake = observer.brake(&v, &none, 0.1, 1e-4, 1e-3);
        assert!((brake.force.dot(&v) * 1e-3 + 2e-4).abs() < 1e-15, "{brake:?}");
        observer.credit(1.0);
        assert_eq!(observer.brake(&v, &none, 0.1, 1e-4, 1e-3), Push::NONE);
    }
}
