//! A body kept in equilibrium while its controlled nodes move, with a factor that is used many times.
//!
//! In: an equilibrium, where the controlled nodes go, and the factor of an earlier tangent stiffness A₀. Out: the next
//! equilibrium, as exact as [`TOLERANCE`] says. Newton's directions K(u) d = -f(u) are found by conjugate gradients on the
//! true tangent with R A₀⁻¹ Rᵀ as preconditioner, R turning each node as the material about it has turned since A₀ was
//! made. Each direction is shortened until the energy falls (Nocedal and Wright, Numerical Optimization, 2nd ed.,
//! algorithm 7.1). A factor is too old where the iterations grow; the caller then makes a new one.

use super::error::SolveError;
use super::minimise::{Energy, Step, minimise};
use super::solver::Factor;
use crate::base::statistics::larger;
use crate::fem::{Hyperelastic, NodeFields, Partition, StiffnessMatrix, nearest_turn};
use nalgebra::{Matrix3, Vector3};

/// An equilibrium has ‖f at free nodes‖₂ ≤ this times ‖f at controlled nodes‖₂, or the loads where these are larger.
pub const TOLERANCE: f64 = 1e-7;
/// An equilibrium is also reached by a step in which no node moves by more than this part of the largest displacement.
const LAST_STEP: f64 = 1e-9;
/// Solves with the factor that one step may take before the factor is called too old.
const MOST_SOLVES: usize = 40;
/// The residual of a direction in parts of its right-hand side: the prediction's, and the largest and least of Newton's.
const PREDICTED: f64 = 0.03;
const FORCED: [f64; 2] = [1e-3, 0.1];
/// A tangent is kept while a step leaves no more than this part of the forces.
const KEPT: f64 = 0.1;
/// Relative rounding error of the sum of energies.
const SUM_ROUNDING: f64 = 1e-13;

/// The factor of a tangent stiffness A₀, and the state that it was made at.
pub struct OldFactor<'a> {
    pub factor: &'a dyn Factor,
    /// F - I at every point of the elements there.
    pub gradients: &'a [Matrix3<f64>],
}

/// R A₀⁻¹ Rᵀ, R turning each free node as the material about it has turned since A₀.
struct Preconditioner<'a> {
    factor: &'a dyn Factor,
    turns: Vec<Matrix3<f64>>,
    solves: usize,
}

impl Preconditioner<'_> {
    fn solve(&mut self, r: &NodeFields) -> Result<NodeFields, SolveError> {
        self.solves += 1;
        let turned = |fields: &NodeFields, back: bool| {
            let mut turned = fields.clone();
            for (value, turn) in turned.data.chunks_exact_mut(3).zip(&self.turns) {
                let of = Vector3::from_column_slice(value);
                let moved = if back { turn.tr_mul(&of) } else { turn * of };
                value.copy_from_slice(moved.as_slice());
            }
            turned
        };
        let z = self.factor.precondition(&turned(r, true))?;
        Ok(turned(&z, false))
    }
}

/// The body that is kept in equilibrium.
#[derive(Clone, Copy)]
pub struct Settler<'a> {
    pub body: &'a Hyperelastic,
    pub partition: &'a Partition,
    /// Forces that keep their directions, one column over all nodes, N; `None` for a body that never has any, nor is warmed.
    pub loads: Option<&'a NodeFields>,
}

/// An equilibrium that was settled.
#[derive(Clone, Debug)]
pub struct Settled {
    /// Displacements of all nodes, one column, m.
    pub u: NodeFields,
    /// f less the loads over all nodes, N: at the controlled ones what holds them.
    pub forces: NodeFields,
    /// Strain energy less the work of the loads, J.
    pub energy: f64,
    /// Solves with the factor.
    pub solves: usize,
}

/// The error that no equilibrium was found: the factor is too old or the step too long, or the equilibrium is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unsettled;

impl Settler<'_> {
    /// Goes from the equilibrium `u`, maybe under other loads, to that with the controlled nodes where `moved` has them. `factor`
    /// is of A at a state not far from it.
    pub fn step(
        &self,
        old: &OldFactor<'_>,
        u: &NodeFields,
        moved: &NodeFields,
    ) -> Result<Result<Settled, Unsettled>, SolveError> {
        let gradients = self.body.gradients(u);
        let turns = self.turns(old.gradients, &gradients, u.nodes);
        let mut inverse = Preconditioner { factor: old.factor, turns, solves: 0 };
        let mut along = u.clone();
        along.data.iter_mut().zip(&moved.data).for_each(|(along, moved)| *along = moved - *along);
        for &node in &self.partition.free {
            along.data[3 * node as usize..][..3].fill(0.0);
        }
        // The prediction keeps the free nodes in balance to first order: A d = loads - f - B Δb, where loads and f are the same
        // but for what has changed.
        let k = self.body.tangent(&gradients);
        let mut rhs = self.partition.minus_b_times(&k, &along);
        if self.loads.is_some() {
            rhs = sum(&rhs, 1.0, &self.downhill(&gradients));
        }
        let acting = self.loads.map_or(0.0, |loads| loads.at(&self.partition.free).norms()[0]);
        let direction = self.direction(&mut inverse, &k, &rhs, PREDICTED)?;
        let now = self.state(sum(&sum(u, 1.0, &along), 1.0, &direction));
        let size = largest(u).max(largest(&now.u));
        let (forces, d) = (NodeFields::zeros(0, 1), NodeFields::zeros(0, 1));
        let mut search = Search {
            settler: self,
            inverse,
            k,
            now,
            tried: None,
            forces,
            norms: [0.0; 2],
            last: None,
            acting,
            d,
            size,
            error: None,
        };
        let found = minimise(&mut search, MOST_SOLVES, &mut 0);
        if let Some(error) = search.error {
            return Err(error);
        }
        let Search { now, forces, inverse, .. } = search;
        let settled = found.ok().map(|found| Settled {
            u: now.u,
            forces,
            energy: found.energy,
            solves: inverse.solves,
        });
        Ok(settled.ok_or(Unsettled))
    }

    pub(super) fn state(&self, u: NodeFields) -> State {
        let gradients = self.body.gradients(&u);
        State { energy: self.body.energy(&gradients) - self.work(&u), gradients, u }
    }

    /// The work of the loads, J.
    fn work(&self, u: &NodeFields) -> f64 {
        self.loads.map_or(0.0, |loads| loads.dots(u)[0])
    }

    /// f less the loads.
    pub(super) fn net_forces(&self, gradients: &[Matrix3<f64>]) -> NodeFields {
        let forces = self.body.forces(gradients);
        match self.loads {
            Some(loads) => sum(&forces, -1.0, loads),
            None => forces,
        }
    }

    /// The loads less f at the free nodes.
    pub(super) fn downhill(&self, gradients: &[Matrix3<f64>]) -> NodeFields {
        let mut downhill = self.net_forces(gradients).at(&self.partition.free);
        downhill.data.iter_mut().for_each(|value| *value = -*value);
        downhill
    }

    /// Rounding error of a state's energy, J.
    pub(super) fn rounding(&self, state: &State) -> f64 {
        let size = state.energy.abs() + self.work(&state.u).abs();
        SUM_ROUNDING * size + self.body.energy_rounding(&state.gradients)
    }

    /// Turn of the material about each free node from one state to another.
    fn turns(&self, then: &[Matrix3<f64>], now: &[Matrix3<f64>], nodes: usize) -> Vec<Matrix3<f64>> {
        let one = Matrix3::identity();
        let mut sums = vec![Matrix3::zeros(); nodes];
        let points = &self.body.points;
        for (point, (then, now)) in then.iter().zip(now).enumerate() {
            let turned = (one + now) * (one + then).try_inverse().unwrap_or(one);
            let nodes = points.nodes_of(points.element_of(point));
            nodes.iter().for_each(|&node| sums[node as usize] += turned);
        }
        let turn = |&node: &u32| *nearest_turn(&sums[node as usize]).to_rotation_matrix().matrix();
        self.partition.free.iter().map(turn).collect()
    }

    /// d with ‖A d - rhs‖₂ ≤ `tolerance` ‖rhs‖₂, over all nodes, zero at the controlled ones; shorter where
    /// A turns out not to be positive definite. Preconditioned conjugate gradients.
    fn direction(
        &self,
        inverse: &mut Preconditioner<'_>,
        k: &StiffnessMatrix,
        rhs: &NodeFields,
        tolerance: f64,
    ) -> Result<NodeFields, SolveError> {
        let dot = |a: &NodeFields, b: &NodeFields| a.dots(b)[0];
        let mut d = NodeFields::zeros(rhs.nodes, 1);
        let (mut all, mut product) = (NodeFields::zeros(k.nodes(), 1), NodeFields::zeros(k.nodes(), 1));
        let mut r = rhs.clone();
        let mut p = NodeFields::zeros(rhs.nodes, 1);
        let mut before = f64::INFINITY;
        let enough = tolerance * rhs.norms()[0];
        while r.norms()[0] > enough && inverse.solves < MOST_SOLVES {
            let z = inverse.solve(&r)?;
            let now = dot(&r, &z);
            p = sum(&z, now / before, &p);
            before = now;
            self.partition.insert_free(&p, &mut all);
            k.multiply(&all, &mut product);
            let product = product.at(&self.partition.free);
            let curvature = dot(&p, &product);
            if curvature <= 0.0 {
                // Downhill for ever, to second order: as far as the factor has it.
                if dot(&d, &d) == 0.0 {
                    d = p;
                }
                break;
            }
            let alpha = now / curvature;
            d = sum(&d, alpha, &p);
            r = sum(&r, -alpha, &product);
        }
        self.partition.insert_free(&d, &mut all);
        Ok(all)
    }
}

/// The energy at fixed controlled nodes, lowered along directions that an old factor helps to find.
struct Search<'a> {
    settler: &'a Settler<'a>,
    inverse: Preconditioner<'a>,
    /// The tangent stiffness, of this state or an earlier one.
    k: StiffnessMatrix,
    now: State,
    tried: Option<State>,
    /// f less the loads, and its norms at the free and the controlled nodes; that at the free ones a step before.
    forces: NodeFields,
    norms: [f64; 2],
    last: Option<f64>,
    /// Norm of the loads at the free nodes, N.
    acting: f64,
    d: NodeFields,
    size: f64,
    error: Option<SolveError>,
}

impl Energy for Search<'_> {
    const TRIALS: usize = 6;

    fn evaluate(&mut self) -> Option<f64> {
        let Partition { free, controlled, .. } = self.settler.partition;
        self.forces = self.settler.net_forces(&self.now.gradients);
        self.norms = [free, controlled].map(|nodes| self.forces.at(nodes).norms()[0]);
        let is_left = self.inverse.solves < MOST_SOLVES && self.norms.iter().all(|norm| norm.is_finite());
        is_left.then_some(self.now.energy)
    }

    fn rounding(&self) -> f64 {
        self.settler.rounding(&self.now)
    }

    fn serves(&mut self) -> bool {
        true
    }

    fn factorise(&mut self, _shift: f64) -> bool {
        false
    }

    fn find_step(&mut self, _energy: f64) -> Step {
        let Settler { body, partition, .. } = self.settler;
        let [left, held] = self.norms;
        if left <= TOLERANCE * held.max(self.acting) {
            return Step { gain: 0.0, is_last: true };
        }
        let eased = self.last.map_or(1.0, |last| left / last);
        if eased > KEPT && self.last.is_some() {
            self.k = body.tangent(&self.now.gradients);
        }
        self.last = Some(left);
        // Eisenstat and Walker, SIAM J. Sci. Comput. 17, 1996: as exact as the last step was good.
        let forced = (0.5 * eased * eased).clamp(FORCED[0], FORCED[1]);
        let mut downhill = self.forces.at(&partition.free);
        downhill.data.iter_mut().for_each(|value| *value = -*value);
        match self.settler.direction(&mut self.inverse, &self.k, &downhill, forced) {
            Ok(d) => self.d = d,
            Err(error) => {
                self.error = Some(error);
                return Step { gain: f64::NAN, is_last: true };
            }
        }
        let gain = downhill.dots(&self.d.at(&partition.free))[0];
        Step { gain, is_last: largest(&self.d) <= LAST_STEP * self.size }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        let tried = self.settler.state(sum(&self.now.u, share, &self.d));
        Some(self.tried.insert(tried).energy)
    }

    fn accept(&mut self) {
        if let Some(tried) = self.tried.take() {
            self.now = tried;
        }
    }

    /// The last step is too short to matter and is not taken.
    fn finish(&mut self, energy: f64, _gain: f64) -> Option<f64> {
        Some(energy)
    }
}

/// Displacements with F - I at every point of the elements and the energy, that of the loads included, J.
pub(super) struct State {
    pub u: NodeFields,
    pub gradients: Vec<Matrix3<f64>>,
    pub energy: f64,
}

/// a + s b.
pub(super) fn sum(a: &NodeFields, s: f64, b: &NodeFields) -> NodeFields {
    NodeFields { data: a.data.iter().zip(&b.data).map(|(a, b)| a + s * b).collect(), ..*a }
}

/// The largest number of fields; NaN where one is NaN.
pub(super) fn largest(fields: &NodeFields) -> f64 {
    fields.data.iter().map(|value| value.abs()).fold(0.0, larger)
}
