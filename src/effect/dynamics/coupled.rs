//! The coordinates that nothing prescribes, in modes of their own: M z̈ + D ż + K z = f, with D diagonal in the modes.
//!
//! In: M and K of these coordinates (coefficients of released control elements, then amplitudes of the fixed-interface modes), and
//! the damping. Out: Ψ with ΨᵀMΨ = 1 and ΨᵀKΨ = diag λ, in which every step is exact. Directions without mass, such as those of
//! fields that vanish, do not move. With nothing released M = 1 and K = diag ω², and Ψ = 1.

use super::oscillator::Oscillator;
use crate::world::vibration::ModeStep;
use nalgebra::{DMatrix, DVector};

/// A direction with less than this part of the mass of its coordinates has none.
const MASSLESS: f64 = 1e-10;

/// The damping of modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Damping {
    /// ζ, the same for all.
    Ratio(f64),
    /// D = α M + β K: ζ = α/(2ω) + β ω/2; 1/s and s.
    Rayleigh([f64; 2]),
}

impl Damping {
    pub fn of(&self, square: f64) -> Oscillator {
        match *self {
            Damping::Ratio(ratio) => Oscillator::of_ratio(square, ratio),
            Damping::Rayleigh([by_mass, by_stiffness]) => {
                Oscillator { square, decay: 0.5 * (by_mass + by_stiffness * square.max(0.0)) }
            }
        }
    }

    /// Modes with these λ. One that nothing brings back, as in free flight, is not damped.
    fn of_all(&self, squares: impl Iterator<Item = f64> + Clone) -> Vec<Oscillator> {
        let least = LOOSE * squares.clone().fold(0.0, f64::max);
        let of = |square: f64| match square.abs() > least {
            true => self.of(square),
            false => Oscillator { square, decay: 0.0 },
        };
        squares.map(of).collect()
    }
}

/// z and ż.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    pub place: DVector<f64>,
    pub speed: DVector<f64>,
}

/// Loads on the coordinates during a step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepLoads {
    /// Impulse at its beginning.
    pub impulse: DVector<f64>,
    /// Load, its slope in time, and the factor of its part that grows with the square of time.
    pub load: DVector<f64>,
    pub slope: DVector<f64>,
    pub bend: DVector<f64>,
    /// Speed that is not damped in the middle of the step, and its rate: that with which held elements carry the body along.
    pub carried: [DVector<f64>; 2],
}

impl StepLoads {
    pub fn none(coordinates: usize) -> StepLoads {
        let none = DVector::zeros(coordinates);
        let carried = [none.clone(), none.clone()];
        StepLoads { impulse: none.clone(), load: none.clone(), slope: none.clone(), bend: none, carried }
    }
}

/// A mode below this part of the largest λ has no static place: nothing brings it back.
const LOOSE: f64 = 1e-12;

/// Largest factor by which speeds are raised to what the balance of energy leaves for them.
const FASTER: f64 = 1.1;

/// The modes of coordinates that are coupled by mass and stiffness.
#[derive(Clone, Debug, PartialEq)]
pub struct Coupled {
    pub modes: Vec<Oscillator>,
    /// Ψ, a row for each coordinate.
    shapes: DMatrix<f64>,
    /// ΨᵀM: the amplitudes of z.
    amplitudes: DMatrix<f64>,
}

impl Coupled {
    pub fn new(mass: &DMatrix<f64>, stiffness: &DMatrix<f64>, damping: Damping) -> Coupled {
        let moving = with_mass(mass);
        let seen = moving.transpose() * stiffness * &moving;
        let (squares, vectors) = eigen((&seen + seen.transpose()) * 0.5);
        let mut order: Vec<usize> = (0..squares.len()).collect();
        order.sort_by(|a, b| squares[*a].total_cmp(&squares[*b]));
        let mut shapes = moving * vectors.select_columns(&order);
        // So near to 1 that a million steps to and fro lose nothing.
        for _ in 0..2 {
            let unit = shapes.transpose() * mass * &shapes;
            let count = unit.nrows();
            shapes *= DMatrix::identity(count, count) * 1.5 - unit * 0.5;
        }
        let amplitudes = shapes.transpose() * mass;
        let modes = damping.of_all(order.iter().map(|&k| squares[k].max(0.0)));
        Coupled { modes, shapes, amplitudes }
    }

    /// The modes of the same coordinates and masses under another K, which need not be definite.
    pub fn with_stiffness(&self, stiffness: &DMatrix<f64>, damping: Damping) -> Coupled {
        let seen = self.shapes.tr_mul(&(stiffness * &self.shapes));
        let (squares, vectors) = eigen((&seen + seen.transpose()) * 0.5);
        let modes = damping.of_all(squares.iter().copied());
        Coupled { modes, shapes: &self.shapes * &vectors, amplitudes: vectors.tr_mul(&self.amplitudes) }
    }

    /// The state after a step of `dt_s`.
    pub fn advanced(&self, from: &Phase, loads: &StepLoads, dt_s: f64) -> Phase {
        self.ended(&self.begun(from, loads, dt_s), dt_s)
    }

    /// Each mode where a step of `dt_s` begins.
    pub fn begun(&self, from: &Phase, loads: &StepLoads, dt_s: f64) -> Vec<ModeStep> {
        let force = |force: &DVector<f64>| self.shapes.tr_mul(force);
        let (x, v) = (&self.amplitudes * &from.place, &self.amplitudes * &from.speed);
        let (impulse, load) = (force(&loads.impulse), force(&loads.load));
        let (slope, bend) = (force(&loads.slope), force(&loads.bend));
        let [carried, rate] = loads.carried.each_ref().map(|speed| &self.amplitudes * speed);
        let of = |(k, mode): (usize, &Oscillator)| {
            let damping = 2.0 * mode.decay;
            let load = load[k] + damping * (carried[k] - 0.5 * dt_s * rate[k]);
            let load = [load, slope[k] + damping * rate[k], bend[k]];
            ModeStep { state: [x[k], v[k] + impulse[k]], kick: impulse[k], load }
        };
        self.modes.iter().enumerate().map(of).collect()
    }

    /// The state where a step of `dt_s` ends that begins so.
    pub fn ended(&self, begun: &[ModeStep], dt_s: f64) -> Phase {
        let (mut x, mut v) = (DVector::zeros(self.modes.len()), DVector::zeros(self.modes.len()));
        for (k, (mode, begun)) in self.modes.iter().zip(begun).enumerate() {
            [x[k], v[k]] = mode.advanced(begun.state, begun.load, dt_s);
        }
        Phase { place: &self.shapes * x, speed: &self.shapes * v }
    }

    /// The mean of z over a step of `dt_s` that begins so and leads to a phase.
    pub fn mean_place(&self, begun: &[ModeStep], to: &Phase, dt_s: f64) -> DVector<f64> {
        let (x, v) = (&self.amplitudes * &to.place, &self.amplitudes * &to.speed);
        let mean = |k: usize| self.modes[k].mean([begun[k].state, [x[k], v[k]]], begun[k].load, dt_s);
        &self.shapes * DVector::from_fn(self.modes.len(), |k, _| mean(k))
    }

    /// Ψ, a row for each coordinate.
    pub fn shapes(&self) -> &DMatrix<f64> {
        &self.shapes
    }

    /// The displacement of each mode after a step of `dt_s` under a load of 1 on it.
    pub fn yields(&self, dt_s: f64) -> impl Iterator<Item = f64> {
        self.modes.iter().map(move |mode| mode.responses(dt_s).step[0])
    }

    /// The factor of the speeds against those of an even motion, `along`, after a step of `dt_s` under loads of which the potential has
    /// risen by `raised`, J, seen from it, with which the kinetic energy at the end is that at the beginning less this and what
    /// damping takes; `None` where so much is not there.
    pub fn balance(
        &self,
        [from, to]: [&Phase; 2],
        loads: &StepLoads,
        (along, raised): (&DVector<f64>, f64),
        dt_s: f64,
    ) -> Option<f64> {
        let before = &self.amplitudes * (&from.speed - along) + self.shapes.tr_mul(&loads.impulse);
        let after = &self.amplitudes * (&to.speed - along);
        let of = [along, &loads.carried[0], &loads.carried[1], &to.place, &to.speed];
        let [along, carried, rate, x, v] = of.map(|of| &self.amplitudes * of);
        let steps = self.begun(from, loads, dt_s);
        let taken = |k: usize| {
            let undamped = [carried[k] - 0.5 * dt_s * rate[k], rate[k]];
            let states = [steps[k].state, [x[k], v[k]]];
            self.modes[k].dissipated(states, steps[k].load, (undamped, along[k]), dt_s)
        };
        let damped: f64 = (0..self.modes.len()).filter(|k| self.modes[*k].decay > 0.0).map(taken).sum();
        let wanted = 0.5 * before.norm_squared() - raised - damped;
        let found = 0.5 * after.norm_squared();
        (wanted >= 0.0).then(|| if found > 0.0 { (wanted / found).sqrt().min(FASTER) } else { 1.0 })
    }

    /// The speed of the static place under a load that grows with this slope: K ż = b.
    pub fn static_speed(&self, slope: &DVector<f64>) -> DVector<f64> {
        let mut speed = self.shapes.tr_mul(slope);
        let least = LOOSE * self.modes.last().map_or(0.0, |mode| mode.square);
        for (speed, mode) in speed.iter_mut().zip(&self.modes) {
            *speed = if mode.square > least { *speed / mode.square } else { 0.0 };
        }
        &self.shapes * speed
    }
}

/// Columns that span all directions with mass, orthonormal in M.
fn with_mass(mass: &DMatrix<f64>) -> DMatrix<f64> {
    let largest = mass.diagonal().amax();
    // Below this, a diagonal entry is the rounding of fields that vanish.
    let scale = mass.diagonal().map(|m| if m > 1e-20 * largest { 1.0 / m.sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(mass.nrows(), mass.ncols(), |i, j| {
        0.5 * (mass[(i, j)] + mass[(j, i)]) * scale[i] * scale[j]
    });
    let (masses, vectors) = eigen(scaled);
    let kept: Vec<usize> = (0..masses.len()).filter(|&k| masses[k] > MASSLESS).collect();
    DMatrix::from_fn(mass.nrows(), kept.len(), |row, column| {
        let k = kept[column];
        scale[row] * vectors[(row, k)] / masses[k].sqrt()
    })
}

/// Eigenvalues and eigenvectors of a symmetric matrix, which may be empty.
fn eigen(matrix: DMatrix<f64>) -> (DVector<f64>, DMatrix<f64>) {
    if matrix.is_empty() {
        return (DVector::zeros(0), DMatrix::zeros(0, 0));
    }
    let eigen = matrix.symmetric_eigen();
    (eigen.eigenvalues, eigen.eigenvectors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// A symmetric positive definite matrix.
    fn definite(random: &mut Random, size: usize) -> DMatrix<f64> {
        let half = DMatrix::from_fn(size, size, |_, _| random.draw());
        &half * half.transpose() + DMatrix::identity(size, size) * 0.3
    }

    /// Kinetic and elastic energy over 10⁶ steps: nothing is lost in the modes or on the way to them.
    #[test]
    fn an_undamped_system_keeps_its_energy() {
        let mut random = Random::default();
        let (mass, stiffness) = (definite(&mut random, 4), definite(&mut random, 4) * 900.0);
        let coupled = Coupled::new(&mass, &stiffness, Damping::Ratio(0.0));
        let energy =
            |at: &Phase| 0.5 * (at.speed.dot(&(&mass * &at.speed)) + at.place.dot(&(&stiffness * &at.place)));
        let draw = |random: &mut Random| DVector::from_fn(4, |_, _| random.draw());
        let mut at = Phase { place: draw(&mut random), speed: draw(&mut random) * 30.0 };
        let before = energy(&at);
        let loads = StepLoads::none(4);
        for _ in 0..1_000_000 {
            at = coupled.advanced(&at, &loads, 1.0 / 60.0);
        }
        let drift = energy(&at) / before - 1.0;
        assert!(drift.abs() < 1e-9, "{drift:e}");
    }

    /// α damps what swings: a mode without stiffness goes by f t²/2, one with stiffness is damped by exp(-α t/2).
    #[test]
    fn free_flight_is_not_damped() {
        let stiffness = DMatrix::from_diagonal(&DVector::from_vec(vec![0.0, 900.0]));
        let coupled = Coupled::new(&DMatrix::identity(2, 2), &stiffness, Damping::Rayleigh([40.0, 0.0]));
        let loads = StepLoads { load: DVector::from_vec(vec![9.8, 0.0]), ..StepLoads::none(2) };
        let from = Phase { place: DVector::from_vec(vec![0.0, 1.0]), speed: DVector::zeros(2) };
        let at = coupled.advanced(&from, &loads, 0.5);
        assert!((at.place[0] - 0.5 * 9.8 * 0.25).abs() < 1e-14, "{}", at.place[0]);
        let (decay, turned) = (20.0_f64, 500.0_f64.sqrt());
        let swung = (-0.5 * decay).exp() * ((0.5 * turned).cos() + decay / turned * (0.5 * turned).sin());
        assert!((at.place[1] - swung).abs() < 1e-14, "{} {swung}", at.place[1]);
    }

    #[test]
    fn a_constant_load_moves_the_system_about_its_static_place() {
        let mut random = Random::default();
        let (mass, stiffness) = (definite(&mut random, 5), definite(&mut random, 5) * 10.0);
        let coupled = Coupled::new(&mass, &stiffness, Damping::Ratio(0.3));
        let load = DVector::from_fn(5, |_, _| random.draw());
        let mut at = Phase { place: DVector::zeros(5), speed: DVector::zeros(5) };
        let loads = StepLoads { load: load.clone(), ..StepLoads::none(5) };
        for _ in 0..400 {
            at = coupled.advanced(&at, &loads, 0.5);
        }
        let rest = stiffness.cholesky().unwrap().solve(&load);
        assert!((at.place - &rest).amax() < 1e-12 * rest.amax(), "{rest}");
        assert!(at.speed.amax() < 1e-12);
    }

    /// A field that vanishes has neither mass nor stiffness, and one that depends on two others has none of its own.
    #[test]
    fn directions_without_mass_do_not_move() {
        let by = DMatrix::from_row_slice(2, 4, &[1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
        let mass = by.transpose() * &by;
        let coupled = Coupled::new(&mass, &(&mass * 4.0), Damping::Ratio(0.0));
        assert_eq!(coupled.modes.len(), 2);
        assert!(coupled.modes.iter().all(|mode| (mode.square - 4.0).abs() < 1e-12));
        let load = DVector::from_element(4, 1.0);
        let still = Phase { place: DVector::zeros(4), speed: DVector::zeros(4) };
        let moved = coupled.advanced(&still, &StepLoads { load, ..StepLoads::none(4) }, 0.1);
        assert!(moved.place[2] == 0.0 && moved.place[0] > 0.0, "{}", moved.place);
    }
}
