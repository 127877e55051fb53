//! A geometrically exact rod (Simo-Reissner) of n two-node elements between two clamps.
//!
//! In: the section stiffness C, the segment at rest, and the two frames of the clamps. Out: the frames of all sections in
//! equilibrium, the energy, and the wrenches on the clamps.
//!
//! ```text
//! V = Σ ½ ẽᵀ C/ℓ ẽ    ẽ = e + u ½ eᵀ A e/ℓ    e = h - h₀    h = log(g_i⁻¹ g_i+1), constant strain along each segment
//! ```
//!
//! Helicoidal elements (Sonneville, Cardona and Brüls, CMAME 268, 2014): no locking, no change under rigid motions, and
//! arcs, twists and helices are exact. A is the second-order stretch along the axis u that follows from a section's own
//! strains ([`super::section`]); without it the material is linear.
//!
//! Newton's iteration has the exact Hessian, which is block tridiagonal (6 × 6). Where it is not positive definite, it is
//! shifted until it is; a state that is stationary but not stable is left along its unstable mode.
//!
//! Loads are dead while a pose is solved; those of a section act on its frame ([`Borne`]). Warmth lengthens the rod at rest.

use crate::deform::loads::Borne;
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::pose::se3::{Tangent, exp, halves, log_of};
use crate::solve::minimise::{Energy, Step, factorise, minimise};
use nalgebra::{Cholesky, Const, Isometry3, Matrix6, Vector6};

/// Largest turn of a clamp in one step, rad, and its largest move, in parts of the rod's length.
const CLAMP_TURN: f64 = std::f64::consts::FRAC_PI_4;
const CLAMP_MOVE: f64 = 0.25;
/// Largest turn of a section in one iteration, rad, and its largest move, in parts of the rod's length.
const SECTION_TURN: f64 = 0.7;
const SECTION_MOVE: f64 = 0.25;
/// The iteration is the last one when -gᵀs, twice the energy that its step s is predicted to win, is below this part of the
/// energy. The relative error of forces is then about √1e-10 before the step, and, by quadratic convergence, 1e-10 after it.
const CONVERGED: f64 = 1e-10;
/// Least shift of a Hessian that is not positive definite, in parts of `weight`.
const SHIFT: f64 = 0.3;
/// Iterations for one pose of the clamps.
const MOST_ITERATIONS: usize = 300;

type Factor = Cholesky<f64, Const<6>>;

/// An equilibrium of the rod between its clamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// J.
    pub energy: f64,
    /// ∂V by a motion g exp(η) of the first and the last frame: force and torque in that frame's own axes.
    pub wrenches: [Vector6<f64>; 2],
    pub iterations: usize,
    /// Whether another state was left for this one because it was not stable: the rod buckled.
    pub buckled: bool,
}

/// A rod and the state in which it was last held.
#[derive(Clone)]
pub struct Chain {
    /// C/ℓ, N/m and N·m of a segment.
    stiffness: Matrix6<f64>,
    /// u, and A/ℓ of a segment.
    axis: Vector6<f64>,
    second: Matrix6<f64>,
    /// h₀ of the rod as warm as it is, and without warmth.
    rest: Vector6<f64>,
    cold: Vector6<f64>,
    length: f64,
    /// Load on each section (empty where nothing acts), and the strain energy of the last assembly, J.
    loads: Vec<Borne>,
    strained: f64,
    /// Frames of the n + 1 sections.
    pub frames: Vec<Isometry3<f64>>,
    trial: Vec<Isometry3<f64>>,
    kept: Vec<Isometry3<f64>>,
    /// ∂V by the motion of each section, and the blocks (i, i) and (i, i + 1) of its derivative.
    gradient: Vec<Vector6<f64>>,
    diagonal: Vec<Matrix6<f64>>,
    beside: Vec<Matrix6<f64>>,
    /// Factors of the pivots of the inner sections, and pivot⁻¹ times the block beside.
    pivots: Vec<Factor>,
    upper: Vec<Matrix6<f64>>,
    step: Vec<Vector6<f64>>,
    /// Whether the factor belongs to the present equilibrium, and the frames, one iteration before it, at which it was made.
    is_factored: bool,
    factored: Vec<Isometry3<f64>>,
    /// Weights of the six motions of a section in the shift.
    weight: Vector6<f64>,
}

impl Chain {
    /// A rod at rest that begins at `first` and has `segments` (2 at least), the ends of each a screw `rest` apart;
    /// `section`: C, in N and N·m² (and N·m off the diagonal); `second`: A.
    pub fn new(
        section: &Matrix6<f64>,
        second: &Matrix6<f64>,
        rest: Vector6<f64>,
        segments: usize,
        first: Isometry3<f64>,
    ) -> Chain {
        let slide = halves(&rest).0;
        let piece = slide.norm();
        let axis = slide / piece;
        let length = piece * segments as f64;
        let bending = (section[(3, 3)] + section[(4, 4)] + section[(5, 5)]) / 3.0;
        let turning = bending / (length * segments as f64);
        let moving = turning / (length * length);
        let mut chain = Chain {
            stiffness: section / piece,
            axis: Vector6::new(axis.x, axis.y, axis.z, 0.0, 0.0, 0.0),
            second: second / piece,
            rest,
            cold: rest,
            length,
            loads: Vec::new(),
            strained: 0.0,
            frames: vec![first; segments + 1],
            trial: Vec::new(),
            kept: Vec::new(),
            gradient: vec![Vector6::zeros(); segments + 1],
            diagonal: vec![Matrix6::zeros(); segments + 1],
            beside: vec![Matrix6::zeros(); segments],
            pivots: Vec::with_capacity(segments),
            upper: Vec::with_capacity(segments),
            step: vec![Vector6::zeros(); segments + 1],
            is_factored: false,
            factored: vec![first; segments + 1],
            weight: Vector6::new(moving, moving, moving, turning, turning, turning),
        };
        chain.reset(first);
        chain.trial.clone_from(&chain.frames);
        chain.kept.clone_from(&chain.frames);
        chain
    }

    pub fn segments(&self) -> usize {
        self.frames.len() - 1
    }

    /// Returns the rod to rest, beginning at `first`.
    pub fn reset(&mut self, first: Isometry3<f64>) {
        let piece = exp(&self.rest);
        self.is_factored = false;
        self.frames[0] = first;
        for i in 1..self.frames.len() {
            self.frames[i] = self.frames[i - 1] * piece;
        }
    }

    /// Sets the loads on the sections, none where there are none, and the factor `stretch` by which the rod at rest is longer.
    pub fn bear(&mut self, loads: impl Iterator<Item = Borne>, stretch: f64) {
        let rest = self.cold * stretch;
        let mut has_changed = self.rest != rest;
        self.rest = rest;
        let mut count = 0;
        for load in loads {
            match self.loads.get_mut(count) {
                Some(own) if *own == load => {}
                Some(own) => (*own, has_changed) = (load, true),
                None => {
                    self.loads.push(load);
                    has_changed = true;
                }
            }
            count += 1;
        }
        has_changed |= self.loads.len() > count;
        self.loads.truncate(count);
        // The factor was that of another equilibrium.
        self.is_factored &= !has_changed;
    }

    /// Count of the numbers that [`Chain::keep`] adds.
    pub fn kept(&self) -> usize {
        1 + 7 * (self.frames.len() + self.factored.len())
    }

    /// Adds the frames of the sections to `memory`, and those at which the factor was made.
    pub fn keep(&self, memory: &mut ModelMemory) {
        memory.unknowns.push(f64::from(u8::from(self.is_factored)));
        self.frames.iter().chain(&self.factored).for_each(|frame| memory.put(frame));
    }

    /// Restores the state that [`Chain::keep`] added.
    pub fn take_back(&mut self, unknowns: &mut Unknowns<'_>) {
        let is_factored = unknowns.take::<f64>() == 1.0;
        self.kept.iter_mut().for_each(|frame| *frame = unknowns.take());
        self.factored.iter_mut().for_each(|frame| *frame = unknowns.take());
        self.frames.clone_from_slice(&self.factored);
        self.assemble();
        self.is_factored = is_factored && factorise(self).is_some();
        self.frames.clone_from_slice(&self.kept);
        self.slopes();
    }

    pub fn length(&self) -> f64 {
        self.length
    }

    /// h of segment `i`.
    pub fn screw(&self, i: usize) -> Vector6<f64> {
        log_of(&self.frames[i].inv_mul(&self.frames[i + 1]))
    }

    /// The wrench C/ℓ (h - h₀) of segment `i`, in the axes of its sections, at its middle.
    pub fn linear_wrench(&self, i: usize) -> Vector6<f64> {
        self.stiffness * (self.screw(i) - self.rest)
    }

    /// The energy of a segment, ∂V/∂h, and for [`Chain::tangent`] A e/ℓ and the force along u.
    fn law(&self, h: &Vector6<f64>) -> (f64, Vector6<f64>, Vector6<f64>, f64) {
        let strain = h - self.rest;
        let slope = self.second * strain;
        let whole = strain + self.axis * (0.5 * strain.dot(&slope));
        let linear = self.stiffness * whole;
        let force = linear.dot(&self.axis);
        (0.5 * whole.dot(&linear), linear + slope * force, slope, force)
    }

    /// ∂²V/∂h² of a segment, from the last two results of [`Chain::law`].
    fn tangent(&self, slope: &Vector6<f64>, force: f64) -> Matrix6<f64> {
        let along = self.stiffness * self.axis;
        let mixed = (along + slope * (0.5 * along.dot(&self.axis))) * slope.transpose();
        self.stiffness + mixed + mixed.transpose() + self.second * force
    }

    /// The frame in the middle of segment `i`.
    pub fn middle(&self, i: usize) -> Isometry3<f64> {
        self.frames[i] * exp(&(self.screw(i) * 0.5))
    }

    /// Finds the equilibrium with the clamps at `ends`, in steps from the present state. The signs of the quaternions
    /// distinguish turns up to 360°. `None`, with the state unchanged, where there is none.
    pub fn hold(&mut self, ends: &[Isometry3<f64>; 2]) -> Option<Standing> {
        self.kept.clone_from_slice(&self.frames);
        let standing = self.approach(ends);
        if standing.is_none() {
            self.is_factored = false;
            self.frames.clone_from_slice(&self.kept);
        }
        standing
    }

    fn approach(&mut self, ends: &[Isometry3<f64>; 2]) -> Option<Standing> {
        // The whole rod takes part in the motion of the first clamp, which changes no strain.
        let carried = ends[0] * self.frames[0].inverse();
        for frame in &mut self.frames {
            *frame = carried * *frame;
            frame.rotation.renormalize_fast();
        }
        let last = self.segments();
        let from = self.frames[last];
        let turn = halves(&log_of(&from.inv_mul(&ends[1]))).1.norm();
        let distance = (ends[1].translation.vector - from.translation.vector).norm();
        if !(turn.is_finite() && distance.is_finite()) {
            return None;
        }
        let steps = (turn / CLAMP_TURN).max(distance / (CLAMP_MOVE * self.length)).ceil().clamp(1.0, 64.0);
        let (mut iterations, mut buckled) = (0, false);
        let mut energy = 0.0;
        for step in 1..=steps as usize {
            let goal = between(&ends[0], &from, &ends[1], step as f64 / steps);
            let eta = log_of(&self.frames[last].inv_mul(&goal));
            energy = self.settle(eta, &mut iterations, &mut buckled)?;
            self.frames[last] = goal;
        }
        self.slopes();
        let wrenches = [self.gradient[0], self.gradient[last]];
        wrenches.iter().all(|w| w.iter().all(|x| x.is_finite())).then_some(Standing {
            energy,
            wrenches,
            iterations,
            buckled,
        })
    }

    /// Moves the last frame by `eta` and the others to equilibrium; returns the energy.
    fn settle(&mut self, eta: Vector6<f64>, iterations: &mut usize, buckled: &mut bool) -> Option<f64> {
        if eta.amax() > 0.0 {
            self.predict(eta)?;
        }
        let most = MOST_ITERATIONS.saturating_sub(*iterations);
        let found = minimise(self, most, iterations).ok()?;
        *buckled |= found.buckled;
        self.gradient.fill(Vector6::zeros());
        self.is_factored = true;
        Some(found.energy)
    }

    /// Moves the last frame by `eta`, and the others by the linear response, with the factor of the last equilibrium where
    /// there is one. The energy may rise.
    fn predict(&mut self, eta: Vector6<f64>) -> Option<()> {
        if !std::mem::take(&mut self.is_factored) {
            self.assemble();
            factorise(self)?;
        }
        self.solve(eta);
        self.limit_step();
        self.try_step(1.0);
        self.frames.clone_from_slice(&self.trial);
        Some(())
    }

    /// The energy of a bend by 1e-4 rad, which counts as none.
    fn least_energy(&self) -> f64 {
        1e-8 * self.weight[3] * self.segments() as f64
    }

    /// Shortens the step of the inner sections to the limits of one iteration.
    fn limit_step(&mut self) {
        let last = self.segments();
        let mut excess: f64 = 1.0;
        for step in &self.step[1..last] {
            let (v, turn) = halves(step);
            excess = excess.max(turn.norm() / SECTION_TURN).max(v.norm() / (SECTION_MOVE * self.length));
        }
        self.step[1..last].iter_mut().for_each(|step| *step /= excess);
    }

    /// Sets the trial to the state after this share of the step.
    fn try_step(&mut self, share: f64) {
        for i in 0..self.frames.len() {
            self.trial[i] = self.frames[i];
            if i > 0 {
                self.trial[i] *= exp(&(self.step[i] * share));
                self.trial[i].rotation.renormalize_fast();
            }
        }
        let last = self.segments();
        if self.step[last] == Vector6::zeros() {
            self.trial[last] = self.frames[last];
        }
    }

    fn energy_of(&self, frames: &[Isometry3<f64>]) -> f64 {
        let segment = |pair: &[Isometry3<f64>]| self.law(&log_of(&pair[0].inv_mul(&pair[1]))).0;
        let strained: f64 = frames.windows(2).map(segment).sum();
        let potential = |(frame, load): (&Isometry3<f64>, &Borne)| {
            load.potential(&frame.translation.vector, &frame.rotation)
        };
        strained + frames.iter().zip(&self.loads).map(potential).sum::<f64>()
    }

    /// Subtracts the loads' wrenches from the gradient.
    fn take_work(&mut self) {
        for (slope, (frame, load)) in self.gradient.iter_mut().zip(self.frames.iter().zip(&self.loads)) {
            *slope -= load.along(&frame.rotation).wrench();
        }
    }

    /// Computes the gradient alone.
    fn slopes(&mut self) {
        self.gradient.fill(Vector6::zeros());
        for i in 0..self.segments() {
            let h = self.screw(i);
            let (tangent, (_, wrench, ..)) = (Tangent::at(&h), self.law(&h));
            self.gradient[i] += tangent.first.tr_mul(&wrench);
            self.gradient[i + 1] += tangent.last.tr_mul(&wrench);
        }
        self.take_work();
    }

    /// Computes gradient and Hessian; returns the energy.
    fn assemble(&mut self) -> f64 {
        self.gradient.fill(Vector6::zeros());
        self.diagonal.fill(Matrix6::zeros());
        let mut energy = 0.0;
        for i in 0..self.segments() {
            let h = self.screw(i);
            let (tangent, (of_segment, wrench, slope, force)) = (Tangent::at(&h), self.law(&h));
            energy += of_segment;
            self.gradient[i] += tangent.first.tr_mul(&wrench);
            self.gradient[i + 1] += tangent.last.tr_mul(&wrench);
            let [first, across, last] = tangent.curvature(&wrench);
            let stiffness = self.tangent(&slope, force);
            let (by_first, by_last) = (stiffness * tangent.first, stiffness * tangent.last);
            self.diagonal[i] += tangent.first.tr_mul(&by_first) + first;
            self.diagonal[i + 1] += tangent.last.tr_mul(&by_last) + last;
            self.beside[i] = tangent.first.tr_mul(&by_last) + across;
        }
        self.strained = energy;
        if self.loads.is_empty() {
            return energy;
        }
        self.take_work();
        for (block, (frame, load)) in self.diagonal.iter_mut().zip(self.frames.iter().zip(&self.loads)) {
            *block -= load.along(&frame.rotation).curvature();
        }
        self.energy_of(&self.frames)
    }

    /// Solves for the Newton step of the inner sections; the last section moves by `of_last`.
    fn solve(&mut self, of_last: Vector6<f64>) {
        let last = self.segments();
        self.step[last] = of_last;
        for i in 1..last {
            let mut rhs = -self.gradient[i];
            if i > 1 {
                rhs -= self.beside[i - 1].tr_mul(&self.step[i - 1]);
            }
            self.step[i] = self.pivots[i - 1].solve(&rhs);
        }
        for i in (1..last).rev() {
            let next = self.step[i + 1];
            self.step[i] -= self.upper[i - 1] * next;
        }
    }

    /// Whether the present state is stable between its clamps: its Hessian is positive definite.
    #[cfg(test)]
    pub fn is_stable(&mut self) -> bool {
        self.assemble();
        self.factorise(0.0)
    }
}

/// The energy of the inner sections between two fixed clamps.
impl Energy for Chain {
    const TRIALS: usize = 30;

    fn evaluate(&mut self) -> Option<f64> {
        let energy = self.assemble();
        self.factored.clone_from_slice(&self.frames);
        energy.is_finite().then_some(energy)
    }

    fn factorise(&mut self, shift: f64) -> bool {
        self.pivots.clear();
        self.upper.clear();
        let added = Matrix6::from_diagonal(&(self.weight * (SHIFT * shift)));
        for i in 1..self.segments() {
            let mut pivot = self.diagonal[i] + added;
            if let Some(above) = self.upper.last() {
                pivot -= self.beside[i - 1].tr_mul(above);
            }
            let Some(factor) = pivot.cholesky() else { return false };
            self.upper.push(factor.solve(&self.beside[i]));
            self.pivots.push(factor);
        }
        true
    }

    fn find_step(&mut self, _energy: f64) -> Step {
        self.solve(Vector6::zeros());
        let gain: f64 = -(1..self.segments()).map(|i| self.gradient[i].dot(&self.step[i])).sum::<f64>();
        self.limit_step();
        Step { gain, is_last: gain <= CONVERGED * self.strained.max(self.least_energy()) }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        self.try_step(share);
        Some(self.energy_of(&self.trial))
    }

    fn accept(&mut self) {
        self.frames.clone_from_slice(&self.trial);
    }

    /// Inverse iteration with the shifted Hessian, from a start without symmetry.
    fn find_mode(&mut self) -> Option<f64> {
        let last = self.segments();
        for i in 1..last {
            self.step[i] = Vector6::from_fn(|k, _| (1.7 * i as f64 + 0.9 * k as f64).sin() + 0.3);
        }
        for _ in 0..20 {
            for i in 1..last {
                self.step[i].component_mul_assign(&-self.weight);
            }
            std::mem::swap(&mut self.step, &mut self.gradient);
            self.solve(Vector6::zeros());
            let size = self.step[1..last].iter().map(Vector6::amax).fold(0.0, f64::max);
            self.step[1..last].iter_mut().for_each(|step| *step /= size);
        }
        let turn = self.step[1..last].iter().map(|s| halves(s).1.norm()).fold(0.0, f64::max);
        Some(0.1 / turn)
    }
}

/// The frame of the last clamp after a share of its way. Its screw from `first` is interpolated linearly where neither end
/// of the way is more than half a turn away; else the clamp turns and moves at a constant speed.
fn between(first: &Isometry3<f64>, from: &Isometry3<f64>, to: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    if share >= 1.0 {
        return *to;
    }
    let [start, end] = [from, to].map(|frame| log_of(&first.inv_mul(frame)));
    let most = halves(&start).1.norm().max(halves(&end).1.norm());
    if most <= std::f64::consts::PI {
        return first * exp(&start.lerp(&end, share));
    }
    let turn = halves(&log_of(&from.inv_mul(to))).1 * share;
    let turned = exp(&Vector6::new(0.0, 0.0, 0.0, turn.x, turn.y, turn.z)).rotation;
    let place = from.translation.vector.lerp(&to.translation.vector, share);
    Isometry3::from_parts(place.into(), from.rotation * turned)
}

#[cfg(test)]
#[path = "chain_tests.rs"]
mod tests;
