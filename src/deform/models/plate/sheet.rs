//! A thin shell held by control elements, or under dead forces, in equilibrium.
//!
//! In: its control points at rest, [`Point`]s of integration, [`Grip`]s, and how the control elements are held. Out: the
//! control points in equilibrium, the energy, and its derivatives by the holds.

use super::point::{Block, Grip, Hold, Point, half_product};
use super::spline::Grid;
use crate::base::lanes::{self, Kernel};
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::pose::frame::PoseSlope;
use crate::solve::envelope::Envelope;
use nalgebra::{Matrix3, Vector3};

/// Iterations with an earlier factor.
pub const CHEAP: usize = 12;
/// Steps in which the Hessian of the next one is made.
pub const PARTS: usize = 6;

/// A shell in the state in which it was last held.
#[derive(Clone)]
pub struct Sheet {
    pub rest: Vec<Vector3<f64>>,
    pub q: Vec<Vector3<f64>>,
    pub points: Vec<Point>,
    pub grips: Vec<Grip>,
    /// Dead forces on the control points, N.
    pub loads: Vec<Vector3<f64>>,
    /// Stress to which the last step led each point.
    pub(super) stress: Vec<[[f64; 3]; 2]>,
    pub(super) gradient: Vec<f64>,
    pub(super) step: Vec<f64>,
    pub(super) hessian: Envelope,
    pub(super) factor: Envelope,
    /// The holds of the equilibrium that the factor is of; the state a last iteration before it, and the stress, of which it
    /// was made; and whether it has yet to be made of them.
    pub(super) factored: Vec<Hold>,
    /// The holds of the equilibrium in which it stands, where it is one.
    pub(super) settled: Vec<Hold>,
    pub(super) factored_q: Vec<Vector3<f64>>,
    pub(super) factored_stress: Vec<[[f64; 3]; 2]>,
    /// Whether it was made with stresses that a step led to, and …
    pub(super) is_led: bool,
    pub(super) is_awaited: bool,
    pub(super) next: Next,
    pub(super) pairs: Vec<Pair>,
    pub(super) trial: Vec<Vector3<f64>>,
    pub(super) kept: Vec<Vector3<f64>>,
    /// The largest distance of a control point from the first, and the mean thickness, m.
    pub size: f64,
    pub thickness: f64,
    /// Evaluations of the slopes, as which a factor counts several; whoever reads it sets it to 0.
    pub work: usize,
}

/// The factor that is made beside the steps.
#[derive(Clone, Default)]
pub(super) struct Next {
    /// The equilibrium that it is of.
    pub(super) holds: Vec<Hold>,
    pub(super) q: Vec<Vector3<f64>>,
    /// Parts of its Hessian that are made; `None` where none is begun.
    pub(super) parts: Option<usize>,
}

/// A step and what it changed of the gradient.
#[derive(Clone)]
pub(super) struct Pair {
    pub(super) step: Vec<f64>,
    pub(super) change: Vec<f64>,
}

/// An equilibrium of the shell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// V, J, less the work of dead forces.
    pub energy: f64,
    pub iterations: usize,
    /// Whether it was reached from a state that was not stable.
    pub buckled: bool,
}

/// The stress with which the Hessian is taken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Geometric {
    /// The stress of the state.
    Own,
    /// The stress to which the last step led.
    Led,
}

impl Sheet {
    pub fn new(grid: &Grid, rest: Vec<Vector3<f64>>, points: Vec<Point>, grips: Vec<Grip>) -> Sheet {
        let unknowns = 3 * rest.len();
        let band = Envelope::band(unknowns, 3 * grid.reach() + 2);
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
            settled: Vec::new(),
            factored_q: rest.clone(),
            is_led: false,
            is_awaited: false,
            next: Next { q: rest.clone(), ..Next::default() },
            pairs: vec![Pair { step: vec![0.0; unknowns], change: vec![0.0; unknowns] }; CHEAP],
            trial: rest.clone(),
            kept: rest.clone(),
            rest,
            size,
            thickness,
            work: 0,
        }
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        self.drop_factor();
        self.settled.clear();
        self.q.clone_from_slice(&self.rest);
        self.relax();
    }

    /// Another state.
    pub fn put(&mut self, q: &[Vector3<f64>]) {
        self.drop_factor();
        self.settled.clear();
        self.q.clone_from_slice(q);
        self.relax();
    }

    /// Sets the thermal strain, by which the shell without stress is longer. A factor at another strain is dropped.
    pub fn warm(&mut self, strain: f64) {
        let green = 0.5 * strain * (2.0 + strain);
        if self.points.iter().any(|point| point.warmth != green) {
            self.drop_factor();
            self.settled.clear();
            self.points.iter_mut().for_each(|point| point.warmth = green);
            self.relax();
        }
    }

    /// The stresses are those of the state again.
    pub(super) fn relax(&mut self) {
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

    /// Count of the numbers that [`Sheet::keep`] adds for `controls` control elements.
    pub fn kept(&self, controls: usize) -> usize {
        5 + 36 * controls + 9 * self.q.len() + 6 * self.points.len()
    }

    /// Adds the state, and where the factor was made.
    pub fn keep(&self, controls: usize, memory: &mut ModelMemory) {
        let nowhere = Hold { place: Vector3::zeros(), matrix: Matrix3::zeros() };
        for holds in [&self.factored, &self.settled, &self.next.holds] {
            memory.unknowns.push(f64::from(u8::from(!holds.is_empty())));
            for hold in holds.iter().chain(std::iter::repeat(&nowhere)).take(controls) {
                memory.put(&hold.place);
                memory.put(&hold.matrix);
            }
        }
        memory.unknowns.push(f64::from(u8::from(self.is_led)));
        memory.unknowns.push(self.next.parts.map_or(-1.0, |parts| parts as f64));
        let places = self.q.iter().chain(&self.factored_q).chain(&self.next.q);
        memory.unknowns.extend(places.flat_map(|q| [q.x, q.y, q.z]));
        memory.unknowns.extend(self.factored_stress.as_flattened().as_flattened());
    }

    /// Takes back what [`Sheet::keep`] added; the factor is made where it is needed.
    pub fn take_back(&mut self, controls: usize, unknowns: &mut Unknowns<'_>) {
        for holds in [&mut self.factored, &mut self.settled, &mut self.next.holds] {
            let is_known = unknowns.take::<f64>() == 1.0;
            holds.clear();
            holds.extend((0..controls).map(|_| Hold { place: unknowns.take(), matrix: unknowns.take() }));
            if !is_known {
                holds.clear();
            }
        }
        self.is_awaited = !self.factored.is_empty();
        self.is_led = unknowns.take::<f64>() == 1.0;
        let parts = unknowns.take::<f64>();
        for q in self.q.iter_mut().chain(&mut self.factored_q).chain(&mut self.next.q) {
            *q = unknowns.take();
        }
        self.next.parts = (parts > 0.0).then_some((parts as usize).min(PARTS));
        unknowns.fill(self.factored_stress.as_flattened_mut().as_flattened_mut());
    }

    pub(super) fn drop_factor(&mut self) {
        self.factored.clear();
        self.is_awaited = false;
        self.next.parts = None;
    }

    /// Energy, gradient and Hessian; `None` where the surface has lost its tangent plane.
    pub(super) fn assemble(&mut self, holds: &[Hold], geometric: Geometric) -> Option<f64> {
        let energy = self.slope(holds)?;
        let Sheet { points, grips, stress, q, hessian, .. } = self;
        let led = (geometric == Geometric::Led).then_some(stress.as_slice());
        hessian.clear();
        for part in 0..PARTS {
            add_part(part, points, led, q, hessian)?;
        }
        add_grips(grips, holds, q, hessian)?;
        Some(energy)
    }

    /// Energy and gradient.
    pub fn slope(&mut self, holds: &[Hold]) -> Option<f64> {
        self.work += 1;
        let Sheet { q, rest, loads, gradient, .. } = self;
        let mut energy = potential(loads, q, rest);
        for (own, load) in gradient.chunks_exact_mut(3).zip(&self.loads) {
            (0..3).for_each(|axis| own[axis] = -load[axis]);
        }
        let mut of_points = None;
        lanes::run(Slope { points: &self.points, q, gradient, energy: &mut of_points });
        energy += of_points?;
        for grip in &self.grips {
            let pulled = grip.pulled(q, holds.get(grip.control)?);
            energy += grip.energy(&pulled);
            grip.add_gradient(&pulled, gradient);
        }
        energy.is_finite().then_some(energy)
    }

    pub fn energy(&self, holds: &[Hold], q: &[Vector3<f64>]) -> Option<f64> {
        let mut energy = potential(&self.loads, q, &self.rest);
        for point in &self.points {
            energy += point.energy(&point.local(q)?.strain);
        }
        for grip in &self.grips {
            energy += grip.energy(&grip.pulled(q, holds.get(grip.control)?));
        }
        energy.is_finite().then_some(energy)
    }

    /// The step against the gradient; returns twice the energy that it should win.
    pub(super) fn solve(&mut self) -> f64 {
        for (step, slope) in self.step.iter_mut().zip(&self.gradient) {
            *step = -slope;
        }
        self.factor.solve(&mut self.step);
        -self.step.iter().zip(&self.gradient).map(|(step, slope)| step * slope).sum::<f64>()
    }

    pub(super) fn largest_step(&self) -> f64 {
        self.step.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
    }

    pub(super) fn limit_step(&mut self) {
        let excess = (self.largest_step() / (0.25 * self.size)).max(1.0);
        self.step.iter_mut().for_each(|x| *x /= excess);
    }

    /// Finds the stresses to which the whole step leads the present state.
    pub(super) fn lead(&mut self) {
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
    pub(super) fn go(&mut self, share: f64) {
        for ((trial, q), step) in self.trial.iter_mut().zip(&self.q).zip(self.step.chunks_exact(3)) {
            *trial = q + Vector3::new(step[0], step[1], step[2]) * share;
        }
    }

    /// An energy that counts as none: that of bending by 1e-5 rad.
    pub(super) fn least_energy(&self) -> f64 {
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

/// Potential of dead forces, zero at rest.
fn potential(loads: &[Vector3<f64>], q: &[Vector3<f64>], rest: &[Vector3<f64>]) -> f64 {
    -loads.iter().zip(q.iter().zip(rest)).map(|(load, (q, rest))| load.dot(&(q - rest))).sum::<f64>()
}

/// Adds the Hessian of one of [`PARTS`] parts of the points, with their own stress where none is led to. The parts are always the
/// same, and so are the bits of the sum.
pub(super) fn add_part(
    part: usize,
    points: &[Point],
    led: Option<&[[[f64; 3]; 2]]>,
    q: &[Vector3<f64>],
    hessian: &mut Envelope,
) -> Option<()> {
    let size = points.len().div_ceil(PARTS).max(1);
    let (mut block, mut nodes) = (Block::ZERO, None);
    for (at, point) in points.iter().enumerate().skip(part * size).take(size) {
        // Points of a cell stand one after the other.
        if let Some(cell) = nodes.replace(point.nodes).filter(|cell| *cell != point.nodes) {
            block.spill(&cell, hessian);
        }
        let local = point.local(q)?;
        let stress = led.map_or_else(|| point.stress(&local.strain), |led| led[at]);
        point.add_hessian(&local, &stress, &mut block);
    }
    if let Some(cell) = nodes {
        block.spill(&cell, hessian);
    }
    Some(())
}

/// Energy of all points, `None` where the surface has lost its tangent plane, and its gradient, which is added.
struct Slope<'a> {
    points: &'a [Point],
    q: &'a [Vector3<f64>],
    gradient: &'a mut [f64],
    energy: &'a mut Option<f64>,
}

impl Kernel for Slope<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let mut energy = 0.0;
        for point in self.points {
            let Some(local) = point.local(self.q) else { return };
            let stress = point.stress(&local.strain);
            energy += half_product(&local.strain, &stress);
            point.add_gradient(&local, &stress, self.gradient);
        }
        *self.energy = Some(energy);
    }
}

/// x += share · y.
pub(super) fn add(x: &mut [f64], share: f64, y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += share * y);
}

pub(super) fn add_grips(
    grips: &[Grip],
    holds: &[Hold],
    q: &[Vector3<f64>],
    hessian: &mut Envelope,
) -> Option<()> {
    for grip in grips {
        grip.add_hessian(&grip.pulled(q, holds.get(grip.control)?), hessian);
    }
    Some(())
}

#[cfg(test)]
impl Sheet {
    /// V, its derivative along d, and Hd·d, at the present state.
    pub fn along(&mut self, holds: &[Hold], d: &[Vector3<f64>]) -> Option<[f64; 3]> {
        let energy = self.assemble(holds, Geometric::Own)?;
        let flat: Vec<f64> = d.iter().flat_map(|d| [d.x, d.y, d.z]).collect();
        let along = |a: &[f64]| a.iter().zip(&flat).map(|(a, d)| a * d).sum::<f64>();
        Some([energy, along(&self.gradient), along(&self.hessian.times(&flat))])
    }
}
