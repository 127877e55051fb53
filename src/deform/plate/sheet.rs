//! A thin shell held by control elements, or under dead forces, in equilibrium.
//!
//! In: its control points at rest, [`Point`]s of integration, [`Grip`]s, and how the control elements are held. Out: the
//! control points in equilibrium, the energy, and its derivatives by the holds.
//!
//! Newton's iteration with the exact Hessian, a band. Thin shells make it slow: what a step bends, it stretches to second
//! order, and that meets the large membrane stiffness. The geometric part of the Hessian is therefore taken with the stress
//! that the last step was to lead to, σ + C B δq, which has no such part; both agree in equilibrium (Magisano, Leonetti and
//! Garcea, CMAME 313, 2017, 986-1005). Where that does not converge, energy is led down with the true Hessian, shifted until
//! it is positive definite; a state that is stationary but not stable is left along its mode. Near an equilibrium that was
//! found so, its factor serves on, and an iteration costs a gradient.

use super::super::frames::PoseSlope;
use super::super::memory::{ModelMemory, Unknowns};
use super::band::Band;
use super::point::{Block, Grip, Hold, Point};
use super::spline::Grid;
use nalgebra::{Matrix3, Vector3};

/// Twice the energy that an iteration promises to win, in parts of the energy: when it is below, this iteration is the last.
const CONVERGED: f64 = 1e-9;
/// The same with the factor of an earlier state, where each iteration wins so much less than the one before.
const COASTED: f64 = 1e-14;
const COASTS: f64 = 0.05;
/// It serves until a control element has turned by more, rad, or moved by more than this part of the thickness: before that, a
/// loss of stability is not seen.
const NEAR_TURN: f64 = 0.02;
const NEAR_MOVE: f64 = 0.05;
/// Iterations with an earlier factor, at full length, and along the energy's way down.
const CHEAP: usize = 6;
const FAST: usize = 16;
const SAFE: usize = 80;

/// A shell in the state in which it was last held.
#[derive(Clone)]
pub struct Sheet {
    pub rest: Vec<Vector3<f64>>,
    pub q: Vec<Vector3<f64>>,
    pub points: Vec<Point>,
    pub grips: Vec<Grip>,
    /// Dead forces on the control points, N.
    pub loads: Vec<Vector3<f64>>,
    /// Where the stress of each point is led to.
    stress: Vec<[[f64; 3]; 2]>,
    gradient: Vec<f64>,
    step: Vec<f64>,
    hessian: Band,
    factor: Band,
    /// The holds of the equilibrium that the factor is of; the state a last iteration before it, and the stress, of which it
    /// was made; and whether it has yet to be made of them.
    factored: Vec<Hold>,
    factored_q: Vec<Vector3<f64>>,
    factored_stress: Vec<[[f64; 3]; 2]>,
    is_awaited: bool,
    trial: Vec<Vector3<f64>>,
    kept: Vec<Vector3<f64>>,
    /// The largest distance of a control point from the first, and the mean thickness, m.
    pub size: f64,
    pub thickness: f64,
}

/// How the shell stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// V, J, less the work of dead forces.
    pub energy: f64,
    pub iterations: usize,
    /// It left a state that was not stable.
    pub buckled: bool,
}

/// Which stress the Hessian is taken with.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Geometric {
    /// That of the state.
    Own,
    /// That which the last step led to.
    Led,
}

impl Sheet {
    pub fn new(grid: &Grid, rest: Vec<Vector3<f64>>, points: Vec<Point>, grips: Vec<Grip>) -> Sheet {
        let unknowns = 3 * rest.len();
        let band = Band::new(unknowns, 3 * grid.reach() + 2);
        let first = rest.first().copied().unwrap_or_else(Vector3::zeros);
        let size = rest.iter().map(|x| (x - first).norm()).fold(0.0, f64::max);
        let sum = |of: fn(&Point) -> f64| points.iter().map(of).sum::<f64>();
        let thickness = sum(|point| point.thickness * point.area) / sum(|point| point.area);
        let stress = vec![[[0.0; 3]; 2]; points.len()];
        Sheet {
            q: rest.clone(),
            factored_stress: stress.clone(),
            stress,
            points,
            grips,
            loads: vec![Vector3::zeros(); rest.len()],
            gradient: vec![0.0; unknowns],
            step: vec![0.0; unknowns],
            hessian: band.clone(),
            factor: band,
            factored: Vec::new(),
            factored_q: rest.clone(),
            is_awaited: false,
            trial: rest.clone(),
            kept: rest.clone(),
            rest,
            size,
            thickness,
        }
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        self.factored.clear();
        self.is_awaited = false;
        self.q.clone_from_slice(&self.rest);
        self.relax();
    }

    /// Another state.
    pub fn put(&mut self, q: &[Vector3<f64>]) {
        self.factored.clear();
        self.is_awaited = false;
        self.q.clone_from_slice(q);
        self.relax();
    }

    /// The stresses are those of the state again.
    fn relax(&mut self) {
        for (point, stress) in self.points.iter().zip(&mut self.stress) {
            *stress = point.local(&self.q).map_or([[0.0; 3]; 2], |local| point.stress(&local.strain));
        }
    }

    /// The linear answers to holds that are all close to rest.
    pub fn answers(&mut self, holds: &[Vec<Hold>]) -> Option<Vec<Vec<Vector3<f64>>>> {
        self.reset();
        self.assemble(holds.first()?, Geometric::Own)?;
        self.factorise()?;
        let mut answers = Vec::with_capacity(holds.len());
        for holds in holds {
            self.slope(holds)?;
            self.solve();
            answers.push(self.step.chunks_exact(3).map(Vector3::from_column_slice).collect());
        }
        Some(answers)
    }

    /// Equilibrium with the control elements held so, from the present state; `None`, and the state as it was, where none is
    /// found.
    pub fn settle(&mut self, holds: &[Hold]) -> Option<Standing> {
        self.kept.clone_from_slice(&self.q);
        let (mut iterations, mut buckled) = (0, false);
        if self.is_near(holds) && self.factor_again().is_some() {
            if let Some(energy) = self.coast(holds, &mut iterations) {
                return Some(Standing { energy, iterations, buckled });
            }
            self.q.clone_from_slice(&self.kept);
        }
        self.factored.clear();
        self.is_awaited = false;
        self.relax();
        if let Some((energy, is_stable)) = self.newton(holds, &mut iterations) {
            if is_stable {
                self.factored.extend_from_slice(holds);
                return Some(Standing { energy, iterations, buckled });
            }
        } else {
            self.q.clone_from_slice(&self.kept);
        }
        let found = self.descend(holds, &mut iterations, &mut buckled);
        if found.is_none() {
            self.q.clone_from_slice(&self.kept);
            self.relax();
        }
        found.map(|energy| Standing { energy, iterations, buckled })
    }

    /// How many numbers [`Sheet::keep`] adds for so many control elements.
    pub fn kept(&self, controls: usize) -> usize {
        1 + 12 * controls + 6 * self.q.len() + 6 * self.points.len()
    }

    /// Adds the state, and where the factor was made.
    pub fn keep(&self, controls: usize, memory: &mut ModelMemory) {
        memory.unknowns.push(f64::from(u8::from(!self.factored.is_empty())));
        let nowhere = Hold { place: Vector3::zeros(), matrix: Matrix3::zeros() };
        for hold in self.factored.iter().chain(std::iter::repeat(&nowhere)).take(controls) {
            memory.put(&hold.place);
            memory.put(&hold.matrix);
        }
        memory.unknowns.extend(self.q.iter().chain(&self.factored_q).flat_map(|q| [q.x, q.y, q.z]));
        memory.unknowns.extend(self.factored_stress.as_flattened().as_flattened());
    }

    /// Takes back what [`Sheet::keep`] added; the factor is made where it is needed.
    pub fn take_back(&mut self, controls: usize, unknowns: &mut Unknowns<'_>) {
        let is_factored = unknowns.take::<f64>() == 1.0;
        self.factored.clear();
        self.factored.extend((0..controls).map(|_| Hold { place: unknowns.take(), matrix: unknowns.take() }));
        if !is_factored {
            self.factored.clear();
        }
        self.is_awaited = is_factored;
        for q in self.q.iter_mut().chain(&mut self.factored_q) {
            *q = unknowns.take();
        }
        unknowns.fill(self.factored_stress.as_flattened_mut().as_flattened_mut());
    }

    /// Makes the factor of the last equilibrium where that has yet to be done.
    fn factor_again(&mut self) -> Option<()> {
        if self.is_awaited {
            let holds = std::mem::take(&mut self.factored);
            self.q.clone_from_slice(&self.factored_q);
            self.stress.clone_from_slice(&self.factored_stress);
            let made = self.assemble(&holds, Geometric::Led).and_then(|_| self.factorise());
            self.q.clone_from_slice(&self.kept);
            self.factored = holds;
            made?;
            self.is_awaited = false;
        }
        Some(())
    }

    fn is_near(&self, holds: &[Hold]) -> bool {
        let near = |(from, to): (&Hold, &Hold)| {
            (to.matrix - from.matrix).amax() < NEAR_TURN
                && (to.place - from.place).amax() < NEAR_MOVE * self.thickness
        };
        self.factored.len() == holds.len() && self.factored.iter().zip(holds).all(near)
    }

    /// Iterations with the last factor: the energy.
    fn coast(&mut self, holds: &[Hold], iterations: &mut usize) -> Option<f64> {
        let mut before = f64::INFINITY;
        for _ in 0..CHEAP {
            *iterations += 1;
            let energy = self.slope(holds)?;
            let gain = self.solve();
            if gain.is_nan() || gain > COASTS * before {
                return None;
            }
            before = gain;
            self.go(1.0);
            self.q.clone_from_slice(&self.trial);
            if gain <= COASTED * energy.abs().max(self.least_energy()) {
                return Some(energy - 0.5 * gain);
            }
        }
        None
    }

    /// Newton's iteration in full steps: the energy, and whether the state is stable.
    fn newton(&mut self, holds: &[Hold], iterations: &mut usize) -> Option<(f64, bool)> {
        for _ in 0..FAST {
            *iterations += 1;
            let energy = self.assemble(holds, Geometric::Led)?;
            self.factored_q.clone_from_slice(&self.q);
            self.factored_stress.clone_from_slice(&self.stress);
            let shift = self.factorise()?;
            let gain = self.solve();
            if !self.is_step_bearable() {
                return None;
            }
            self.lead();
            self.go(1.0);
            self.q.clone_from_slice(&self.trial);
            if gain <= CONVERGED * energy.abs().max(self.least_energy()) {
                return Some((self.energy(holds, &self.q)?, shift == 0.0));
            }
        }
        None
    }

    /// Leads the energy down to where it is least.
    fn descend(&mut self, holds: &[Hold], iterations: &mut usize, buckled: &mut bool) -> Option<f64> {
        for _ in 0..SAFE {
            *iterations += 1;
            let energy = self.assemble(holds, Geometric::Own)?;
            let shift = self.factorise()?;
            let gain = self.solve();
            let is_last = gain <= CONVERGED * energy.abs().max(self.least_energy());
            if is_last && shift > 0.0 {
                self.leave_along_mode(holds, energy)?;
                *buckled = true;
                continue;
            }
            self.limit_step();
            let mut share = 1.0;
            loop {
                self.go(share);
                let after = self.energy(holds, &self.trial);
                if is_last || after.is_some_and(|after| after <= energy - 1e-4 * share * gain) {
                    break;
                }
                share *= 0.5;
                if share < 1e-8 {
                    return None;
                }
            }
            self.q.clone_from_slice(&self.trial);
            if is_last {
                self.relax();
                return self.energy(holds, &self.q);
            }
        }
        None
    }

    /// Steps off a stationary state that is not stable, along the mode that lowers the energy most.
    fn leave_along_mode(&mut self, holds: &[Hold], energy: f64) -> Option<()> {
        for (i, step) in self.step.iter_mut().enumerate() {
            *step = (1.7 * i as f64).sin() + 0.3;
        }
        for _ in 0..20 {
            self.factor.solve(&mut self.step);
            let most = self.step.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            self.step.iter_mut().for_each(|x| *x /= most);
        }
        let mut share = 0.02 * self.size;
        for _ in 0..14 {
            for sign in [1.0, -1.0] {
                self.go(sign * share);
                if self.energy(holds, &self.trial).is_some_and(|after| after < energy) {
                    self.q.clone_from_slice(&self.trial);
                    return Some(());
                }
            }
            share *= 0.5;
        }
        None
    }

    /// Energy, gradient and Hessian; `None` where the surface has lost its tangent plane.
    fn assemble(&mut self, holds: &[Hold], geometric: Geometric) -> Option<f64> {
        let energy = self.slope(holds)?;
        let Sheet { q, hessian, .. } = self;
        hessian.clear();
        let (mut block, mut nodes) = (Block::ZERO, None);
        for (point, led) in self.points.iter().zip(&self.stress) {
            // Points of a cell stand one after the other.
            if let Some(cell) = nodes.replace(point.nodes).filter(|cell| *cell != point.nodes) {
                block.spill(&cell, hessian);
            }
            let local = point.local(q)?;
            match geometric {
                Geometric::Led => point.add_hessian(&local, led, &mut block),
                Geometric::Own => point.add_hessian(&local, &point.stress(&local.strain), &mut block),
            }
        }
        if let Some(cell) = nodes {
            block.spill(&cell, hessian);
        }
        for grip in &self.grips {
            grip.add_hessian(&grip.pulled(q, holds.get(grip.control)?), hessian);
        }
        Some(energy)
    }

    /// Energy and gradient.
    pub fn slope(&mut self, holds: &[Hold]) -> Option<f64> {
        let Sheet { q, gradient, .. } = self;
        let mut energy = -self.loads.iter().zip(&*q).map(|(load, q)| load.dot(q)).sum::<f64>();
        for (own, load) in gradient.chunks_exact_mut(3).zip(&self.loads) {
            (0..3).for_each(|axis| own[axis] = -load[axis]);
        }
        for point in &self.points {
            let local = point.local(q)?;
            energy += point.energy(&local.strain);
            point.add_gradient(&local, &point.stress(&local.strain), gradient);
        }
        for grip in &self.grips {
            let pulled = grip.pulled(q, holds.get(grip.control)?);
            energy += grip.energy(&pulled);
            grip.add_gradient(&pulled, gradient);
        }
        energy.is_finite().then_some(energy)
    }

    pub fn energy(&self, holds: &[Hold], q: &[Vector3<f64>]) -> Option<f64> {
        let mut energy = -self.loads.iter().zip(q).map(|(load, q)| load.dot(q)).sum::<f64>();
        for point in &self.points {
            energy += point.energy(&point.local(q)?.strain);
        }
        for grip in &self.grips {
            energy += grip.energy(&grip.pulled(q, holds.get(grip.control)?));
        }
        energy.is_finite().then_some(energy)
    }

    /// Factorises the Hessian, shifted as little as it must be to be positive definite; returns the shift.
    fn factorise(&mut self) -> Option<f64> {
        let mean = self.hessian.trace() / self.gradient.len() as f64;
        let mut shift = 0.0;
        for _ in 0..16 {
            self.factor.copy_from(&self.hessian);
            self.factor.add_to_diagonal(shift);
            if self.factor.factor() {
                return Some(shift);
            }
            shift = if shift == 0.0 { 1e-7 * mean } else { 4.0 * shift };
        }
        None
    }

    /// The step against the gradient; returns twice the energy that it should win.
    fn solve(&mut self) -> f64 {
        for (step, slope) in self.step.iter_mut().zip(&self.gradient) {
            *step = -slope;
        }
        self.factor.solve(&mut self.step);
        -self.step.iter().zip(&self.gradient).map(|(step, slope)| step * slope).sum::<f64>()
    }

    fn largest_step(&self) -> f64 {
        self.step.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
    }

    fn is_step_bearable(&self) -> bool {
        self.largest_step() < 4.0 * self.size
    }

    fn limit_step(&mut self) {
        let excess = (self.largest_step() / (0.25 * self.size)).max(1.0);
        self.step.iter_mut().for_each(|x| *x /= excess);
    }

    /// Where the stresses of the present state are led by the whole step.
    fn lead(&mut self) {
        let step = &self.step;
        for (point, led) in self.points.iter().zip(&mut self.stress) {
            let Some(local) = point.local(&self.q) else { continue };
            let by =
                point.strain_by(&local, |node| Vector3::from_column_slice(&step[3 * node..3 * node + 3]));
            let strain = [0, 1].map(|part| std::array::from_fn(|i| local.strain[part][i] + by[part][i]));
            *led = point.stress(&strain);
        }
    }

    /// The state after this share of the step, as the trial.
    fn go(&mut self, share: f64) {
        for ((trial, q), step) in self.trial.iter_mut().zip(&self.q).zip(self.step.chunks_exact(3)) {
            *trial = q + Vector3::new(step[0], step[1], step[2]) * share;
        }
    }

    /// An energy that counts as none: that of bending by 1e-5 rad.
    fn least_energy(&self) -> f64 {
        let bending: f64 = self.points.iter().map(|point| point.bending.first).sum();
        1e-10 * bending / (self.size * self.size)
    }

    /// ∂V by the pose of each control element.
    pub fn slopes(&self, holds: &[Hold], slopes: &mut [PoseSlope]) {
        slopes.fill(PoseSlope::default());
        for grip in &self.grips {
            if let (Some(hold), Some(slope)) = (holds.get(grip.control), slopes.get_mut(grip.control)) {
                let (force, matrix) = grip.slope(&grip.pulled(&self.q, hold));
                slope.translation += force;
                slope.matrix += matrix;
            }
        }
    }
}

#[cfg(test)]
impl Sheet {
    /// V, its derivative along d, and Hd·d, at the present state.
    pub fn along(&mut self, holds: &[Hold], d: &[Vector3<f64>]) -> Option<[f64; 3]> {
        let energy = self.assemble(holds, Geometric::Own)?;
        let flat: Vec<f64> = d.iter().flat_map(|d| [d.x, d.y, d.z]).collect();
        let dot = |a: &[f64]| a.iter().zip(&flat).map(|(a, d)| a * d).sum::<f64>();
        Some([energy, dot(&self.gradient), dot(&self.hessian.times(&flat))])
    }
}
