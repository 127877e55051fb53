//! The motion as a whole of a body that nothing holds: it falls, flies and tumbles.
//!
//! In: mass, its moments, momentum at the beginning of a step, force and torque. Out: shift and turn of the body, and its velocity at
//! the end. The shift is that of a constant force, exactly. The turn is the implicit midpoint rule of Euler's equations,
//!
//! ```text
//! l' - l = dt l_m × J⁻¹ l_m,   l_m = (l + l')/2,   R' = R cay(dt J⁻¹ l_m)
//! ```
//!
//! which keeps energy and the angular momentum R l in space, both to rounding, for every length of step (J. Simo and K. Wong,
//! Int. J. Numer. Methods Eng. 31, 1991, 19-52). A torque acts in halves, at both ends of the step.

use nalgebra::{DMatrix, Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};

/// Turn in one midpoint step, rad, up to which its iteration contracts quickly.
const LONGEST: f64 = 0.2;
/// Most midpoint steps within one step.
const MOST: f64 = 200.0;
/// Iterations of a midpoint step; each gains a digit or more.
const ITERATIONS: usize = 40;

/// Inertia of a body in the axes of its frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidInertia {
    /// kg.
    pub mass: f64,
    /// The centre of mass about the origin of coordinates, m.
    pub centre: Vector3<f64>,
    /// J about the centre of mass, kg·m².
    pub moments: Matrix3<f64>,
}

/// Velocities of a body: of its centre of mass, m/s, and its spin, rad/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    pub velocity: Vector3<f64>,
    pub spin: Vector3<f64>,
}

/// A step, in the axes that stand still during it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Shift of the centre of mass, m.
    pub shift: Vector3<f64>,
    pub turn: UnitQuaternion<f64>,
    /// At the end.
    pub twist: Twist,
}

impl RigidInertia {
    /// Inertia from XᵀMX of the twelve affine fields X; `None` without mass.
    pub fn of_whole(whole: &DMatrix<f64>) -> Option<RigidInertia> {
        let mass = whole[(0, 0)];
        if mass.is_nan() || mass <= 0.0 {
            return None;
        }
        // Of the fields that move along x: by 1, and by each coordinate.
        let centre = Vector3::from_fn(|i, _| whole[(0, 3 + i)]) / mass;
        let second = Matrix3::from_fn(|i, j| whole[(3 + i, 3 + j)]) - centre * centre.transpose() * mass;
        let moments = Matrix3::from_diagonal_element(second.trace()) - second;
        Some(RigidInertia { mass, centre, moments })
    }

    /// The step of a body with this velocity under a force and a torque about its centre of mass, both constant in space.
    pub fn flown(&self, from: &Twist, force: &Vector3<f64>, torque: &Vector3<f64>, dt_s: f64) -> Flight {
        let acceleration = force / self.mass;
        let shift = (from.velocity + acceleration * (0.5 * dt_s)) * dt_s;
        let kick = torque * (0.5 * dt_s);
        let (turn, momentum) = self.turned(self.moments * from.spin + kick, dt_s);
        let inverse = self.inverse();
        let spin = turn * (inverse * (momentum + turn.inverse() * kick));
        Flight { shift, turn, twist: Twist { velocity: from.velocity + acceleration * dt_s, spin } }
    }

    fn inverse(&self) -> Matrix3<f64> {
        self.moments.try_inverse().unwrap_or_else(Matrix3::zeros)
    }

    /// The turn of a body without torque, and its angular momentum afterwards in the axes that turned with it.
    fn turned(&self, mut momentum: Vector3<f64>, dt_s: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let inverse = self.inverse();
        let angle = (inverse * momentum).norm() * dt_s;
        let steps = (angle / LONGEST).ceil().clamp(1.0, MOST);
        let dt_s = dt_s / steps;
        let mut turn = UnitQuaternion::identity();
        for _ in 0..steps as usize {
            let mut after = momentum;
            for _ in 0..ITERATIONS {
                let middle = (momentum + after) * 0.5;
                let next = momentum + middle.cross(&(inverse * middle)) * dt_s;
                let change = (next - after).norm();
                after = next;
                if change <= 1e-16 * momentum.norm() {
                    break;
                }
            }
            let spin = inverse * ((momentum + after) * 0.5);
            let step = cayley(&(spin * dt_s));
            // What rounding leaves of the iteration would add up: in space, the momentum is the same.
            momentum = step.inverse() * momentum;
            turn *= step;
        }
        (turn, momentum)
    }
}

/// The rotation (1 - \[a\]/2)⁻¹ (1 + \[a\]/2).
fn cayley(a: &Vector3<f64>) -> UnitQuaternion<f64> {
    Unit::new_normalize(Quaternion::from_parts(1.0, a * 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A book: its moments differ, and about the middle one it tumbles.
    const BOOK: RigidInertia = RigidInertia {
        mass: 2.0,
        centre: Vector3::new(0.0, 0.0, 0.0),
        moments: Matrix3::new(1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.7),
    };

    #[test]
    fn a_top_without_torque_keeps_energy_and_angular_momentum() {
        for (dt_s, steps) in [(0.01, 1_000_000), (0.3, 20_000), (2.0, 20_000)] {
            let mut turn = UnitQuaternion::identity();
            let mut spin = Vector3::new(0.01, 3.0, 0.02);
            let [energy, momentum] = [0.5 * spin.dot(&(BOOK.moments * spin)), (BOOK.moments * spin).norm()];
            let start = BOOK.moments * spin;
            let mut flips = 0.0_f64;
            for _ in 0..steps {
                let twist = Twist { velocity: Vector3::zeros(), spin };
                let flight = BOOK.flown(&twist, &Vector3::zeros(), &Vector3::zeros(), dt_s);
                turn *= flight.turn;
                spin = flight.turn.inverse() * flight.twist.spin;
                flips = flips.min(spin.y);
            }
            let now = turn * (BOOK.moments * spin);
            let drift = 0.5 * spin.dot(&(BOOK.moments * spin)) / energy - 1.0;
            println!(
                "{steps} steps of {dt_s} s: momentum {:.1e}, energy {drift:.1e} beside",
                (now - start).norm() / momentum
            );
            assert!((now - start).norm() < 5e-12 * momentum, "{dt_s}: {now} {start}");
            assert!(drift.abs() < 5e-12, "{dt_s}: {drift:e}");
            assert!(flips < -2.9, "about its middle axis it turns over: {flips}");
        }
    }

    #[test]
    fn a_falling_body_falls_as_it_should() {
        let (mut place, mut twist) = (Vector3::zeros(), Twist { velocity: Vector3::x(), spin: Vector3::y() });
        for dt_s in [0.1, 0.5, 0.013] {
            let flight = BOOK.flown(&twist, &(Vector3::y() * -9.81 * 2.0), &Vector3::zeros(), dt_s);
            (place, twist) = (place + flight.shift, flight.twist);
        }
        let t: f64 = 0.613;
        assert!((place - Vector3::new(t, -0.5 * 9.81 * t * t, 0.0)).norm() < 1e-14, "{place}");
    }

    /// A torque about a main axis: half of its angular acceleration times t².
    #[test]
    fn a_torque_spins_the_body_up() {
        let mut spin = Vector3::zeros();
        for _ in 0..100 {
            let twist = Twist { velocity: Vector3::zeros(), spin };
            spin = BOOK.flown(&twist, &Vector3::zeros(), &(Vector3::z() * 0.9), 0.01).twist.spin;
        }
        assert!((spin - Vector3::z() * (0.9 / 2.7)).norm() < 1e-12, "{spin}");
    }
}
