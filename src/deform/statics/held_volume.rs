//! The body that a thread keeps in static equilibrium.
//!
//! In: what the thread is asked for ([`Background`]). Out: each equilibrium that it finds, and the stiffness there. Each is a full
//! one ([`Settler`]); between two poses no element is turned by more than 30° at once, and what lies on the way is an equilibrium,
//! too. The factor of one tangent stiffness serves many of them, and is made anew where the iterations grow.

use super::background::{Asked, Background, Found, Next, Shared, lock, lose, next};
use super::step_count;
use super::way::warmed;
use crate::base::extent::bounding_box;
use crate::deform::loads::applied::StaticForces;
use crate::deform::loads::lumped::NodalLoads;
use crate::deform::memory::{HeldNodes, Warm};
use crate::deform::model::ControlRest;
use crate::deform::pose::frame::{ControlPose, ControlPoses, PoseSlope, unwrapped};
use crate::deform::pose::screw::Way;
use crate::fem::{Hyperelastic, Law, NodeFields, Partition, StiffnessMatrix};
use crate::green::{FIELDS, Volume};
use crate::solve::{
    Factor, LinearSolver, OldFactor, Settled, Settler, Silent, SolveError, Solver, Unsettled,
};
use nalgebra::{DMatrix, Matrix3, UnitQuaternion, Vector3};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// An equilibrium that took more solves than this with its factor asks for a new one.
const TIRED: usize = 18;
/// A step that fails with a new factor is halved so often before the equilibrium is called lost.
const HALVINGS: u32 = 6;

/// The body as the thread holds it.
struct HeldVolume {
    volume: Volume,
    law: &'static Law,
    /// The body by how much warmth lengthens it where it is free, as it was needed last.
    body: RefCell<(f64, Arc<Hyperelastic>)>,
    /// `None` of a body without loads.
    loads: Option<NodalLoads>,
    controls: Vec<ControlRest>,
    partition: Partition,
    solver: Box<dyn LinearSolver>,
    /// Centroids of the held nodes, m.
    origins: Vec<Vector3<f64>>,
    size: f64,
}

/// The tangent stiffness at an equilibrium, that of the free nodes, and the displacement gradients there.
struct Tangent {
    gradients: Vec<Matrix3<f64>>,
    k: StiffnessMatrix,
    a: StiffnessMatrix,
}

/// The reason why the factor is made anew.
enum Renewal {
    Tired,
    Anew(VecDeque<ControlPoses>),
    Restored((Arc<Warm>, u64)),
    End,
}

/// Starts the thread for a body under `law`, with its loads where it has some. Errors where this body cannot be solved.
pub fn start(law: &'static Law, volume: Volume, loads: Option<NodalLoads>) -> Result<Background, String> {
    let body = HeldVolume::new(law, volume, loads)?;
    Background::start(at_rest(&body.volume), body.volume.surface.len(), move |shared| body.run(shared))
}

impl HeldVolume {
    fn new(law: &'static Law, volume: Volume, loads: Option<NodalLoads>) -> Result<HeldVolume, String> {
        let mesh = &volume.mesh;
        let body =
            Hyperelastic::new(volume.element, law, mesh, &volume.lame).map_err(|error| error.to_string())?;
        let partition = Partition::new(mesh.nodes.len(), volume.held.iter().flatten().copied());
        if partition.controlled.is_empty() {
            return Err("no control element holds a node of it: there is no equilibrium to find".into());
        }
        let rest = body.tangent(&body.gradients(&NodeFields::zeros(mesh.nodes.len(), 1)));
        let solver = Solver::default().analyse(&partition.a(&rest), &Silent);
        let solver = solver.map_err(|error| error.to_string())?;
        let mean = |held: &Vec<u32>| {
            let sum: Vector3<f64> = held.iter().map(|&node| mesh.nodes[node as usize]).sum();
            sum / held.len().max(1) as f64
        };
        let (low, high) = bounding_box(&mesh.nodes);
        let origins: Vec<Vector3<f64>> = volume.held.iter().map(mean).collect();
        let control = |(held, origin): (&Vec<u32>, &Vector3<f64>)| ControlRest {
            name: String::new(),
            origin: *origin,
            nodes: held.len(),
        };
        Ok(HeldVolume {
            controls: volume.held.iter().zip(&origins).map(control).collect(),
            origins,
            size: (high - low).norm(),
            body: RefCell::new((1.0, Arc::new(body))),
            law,
            loads,
            partition,
            solver,
            volume,
        })
    }

    /// The body as warm as `loads` make it.
    fn body(&self, loads: &StaticForces) -> Result<Arc<Hyperelastic>, SolveError> {
        let stretch = self.loads.as_ref().map_or(1.0, |columns| columns.stretch(loads));
        let mut last = self.body.borrow_mut();
        if last.0 != stretch {
            let Volume { element, mesh, lame, .. } = &self.volume;
            *last = (stretch, warmed(element, self.law, mesh, lame, stretch)?);
        }
        Ok(last.1.clone())
    }

    /// Finds equilibria until nobody wants them any more. A body of which no factor can be made is lost where it is.
    fn run(&self, shared: &Shared) {
        let rest = Warm::at(at_rest(&self.volume));
        let (mut warm, mut stable, mut epoch) = (rest.clone(), rest.held.clone(), 0);
        let mut legs = VecDeque::new();
        loop {
            match self.follow(shared, &mut warm, (&mut stable, epoch), &mut legs) {
                Ok(Renewal::Tired) => warm = Warm::at(warm.held),
                Ok(Renewal::Anew(way)) => (warm, legs) = (rest.clone(), way),
                Ok(Renewal::Restored((other, since))) => {
                    (warm, legs, epoch) = ((*other).clone(), VecDeque::new(), since);
                }
                Ok(Renewal::End) => return,
                Err(_) => {
                    // What was found last is no stable equilibrium: back to the one before, and on from there; from rest where
                    // that is not stable either.
                    if warm.factored == rest.held {
                        return lose(shared, shared.number.load(Ordering::Acquire), (epoch, &warm));
                    }
                    if warm.factored == stable {
                        stable.clone_from(&rest.held);
                    }
                    (warm, legs) = (Warm::at(stable.clone()), VecDeque::new());
                    lose(shared, shared.number.load(Ordering::Acquire), (epoch, &warm));
                }
            }
        }
    }

    /// Follows the poses that are asked for, with one factor: that of `warm.factored`.
    fn follow(
        &self,
        shared: &Shared,
        warm: &mut Warm,
        (stable, epoch): (&mut HeldNodes, u64),
        legs: &mut VecDeque<ControlPoses>,
    ) -> Result<Renewal, SolveError> {
        let tangent = self.tangent(&warm.factored)?;
        let factor = self.solver.factor(&tangent.a, &Silent)?;
        stable.clone_from(&warm.factored);
        let old = OldFactor { factor: factor.as_ref(), gradients: &tangent.gradients };
        loop {
            let mut asked = match next(shared) {
                Next::End => return Ok(Renewal::End),
                Next::Restored(other) => return Ok(Renewal::Restored(other)),
                Next::Stiffness => {
                    let stiffness = match warm.is_new {
                        true => self.stiffness(&tangent.k, factor.as_ref()),
                        false => self.stiffness_at(&warm.held),
                    };
                    if stiffness.is_err() && !warm.is_new && !lock(&shared.asked).is_awaited {
                        return Ok(Renewal::Tired);
                    }
                    tell_stiffness(shared, stiffness.ok(), epoch);
                    continue;
                }
                Next::Poses(asked) => asked,
            };
            if let Some(way) = asked.anew.take() {
                return Ok(Renewal::Anew(way));
            }
            let aim = legs.front().unwrap_or(&asked.poses);
            let ways: Vec<Way> =
                warm.held.poses.iter().zip(aim).map(|(from, to)| Way::onwards(from, to)).collect();
            let share = 0.5f64.powi(warm.halved as i32) / step_count(&ways, self.size) as f64;
            let poses = match share {
                1.0 => aim.clone(),
                share => ways.iter().map(|way| way.pose(share)).collect(),
            };
            let loads = warm.held.loads.towards(&asked.loads, share);
            let turns = unwrapped(Some(&warm.held.turns), &poses);
            match self.step(&old, &warm.held, &poses, &turns, &loads)? {
                Ok(settled) => {
                    let is_reached = share == 1.0 && legs.pop_front().is_none();
                    let is_tired = settled.solves > TIRED && !warm.is_new;
                    warm.held = HeldNodes { poses, u: settled.u.data.clone(), turns, loads };
                    warm.halved = warm.halved.saturating_sub(1);
                    warm.is_new = false;
                    if is_tired {
                        *warm = Warm::at(warm.held.clone());
                    }
                    // A way from rest is shown when it ends: what was shown before is nearer than what lies on it.
                    if is_reached || legs.is_empty() {
                        self.tell(shared, &asked, is_reached, &settled, (epoch, warm));
                    }
                    if is_tired {
                        return Ok(Renewal::Tired);
                    }
                }
                Err(_) if !warm.is_new => return Ok(Renewal::Tired),
                Err(_) if warm.halved < HALVINGS => warm.halved += 1,
                Err(_) => {
                    (warm.halved, *legs) = (0, VecDeque::new());
                    lose(shared, asked.number, (epoch, warm));
                }
            }
        }
    }

    /// The equilibrium of `poses`, to which the control elements have turned so, under `loads`.
    fn step(
        &self,
        old: &OldFactor<'_>,
        from: &HeldNodes,
        poses: &[ControlPose],
        turns: &[UnitQuaternion<f64>],
        loads: &StaticForces,
    ) -> Result<Result<Settled, Unsettled>, SolveError> {
        let Ok(body) = self.body(loads) else { return Ok(Err(Unsettled)) };
        let u = self.fields(from);
        let moved = self.moved(&u, poses);
        let forces = self.loads.as_ref().map(|columns| {
            let nodes = self.volume.mesh.nodes.len();
            columns.forces(loads, nodes, &self.controls, poses, turns)
        });
        Settler { body: &body, partition: &self.partition, loads: forces.as_ref() }.step(old, &u, &moved)
    }

    fn fields(&self, held: &HeldNodes) -> NodeFields {
        NodeFields { data: held.u.clone(), ..NodeFields::zeros(self.volume.mesh.nodes.len(), 1) }
    }

    /// `u` with the held nodes where `poses` have them.
    fn moved(&self, u: &NodeFields, poses: &[ControlPose]) -> NodeFields {
        let mut moved = u.clone();
        for ((held, origin), pose) in self.volume.held.iter().zip(&self.origins).zip(poses) {
            let gradient = pose.matrix - Matrix3::identity();
            for &node in held {
                let at = pose.translation + gradient * (self.volume.mesh.nodes[node as usize] - origin);
                moved.data[3 * node as usize..][..3].copy_from_slice(at.as_slice());
            }
        }
        moved
    }

    fn tell(
        &self,
        shared: &Shared,
        asked: &Asked,
        is_reached: bool,
        at: &Settled,
        (epoch, warm): (u64, &Warm),
    ) {
        let of = |fields: &NodeFields, node: u32| {
            Vector3::from_column_slice(&fields.data[3 * node as usize..][..3])
        };
        let field = self.volume.surface.iter().map(|&node| of(&at.u, node).cast::<f32>().into()).collect();
        let slope = |(held, origin): (&Vec<u32>, &Vector3<f64>)| {
            let mut slope = PoseSlope::default();
            for &node in held {
                let force = of(&at.forces, node);
                slope.translation += force;
                slope.matrix += force * (self.volume.mesh.nodes[node as usize] - origin).transpose();
            }
            slope
        };
        let slopes = self.volume.held.iter().zip(&self.origins).map(slope).collect();
        let is_inverted = self
            .body
            .borrow()
            .1
            .gradients(&at.u)
            .iter()
            .any(|h| (Matrix3::identity() + h).determinant() <= 0.0);
        let mut found = lock(&shared.found);
        if found.epoch != epoch {
            return;
        }
        let Found { version, stiffness_version, .. } = *found;
        let stiffness = std::mem::replace(&mut found.stiffness, DMatrix::zeros(0, 0));
        let new = Found {
            version: version + 1,
            number: asked.number,
            is_reached,
            is_lost: false,
            has_ended: false,
            asked_at: asked.since,
            warm: Arc::new(warm.clone()),
            epoch,
            poses: warm.held.poses.clone(),
            field,
            is_inverted,
            energy: at.energy,
            slopes,
            stiffness,
            stiffness_version,
        };
        let before = std::mem::replace(&mut *found, new);
        drop(found);
        shared.arrived.notify_all();
        drop(before);
    }

    fn tangent(&self, held: &HeldNodes) -> Result<Tangent, SolveError> {
        let body = self.body(&held.loads)?;
        let gradients = body.gradients(&self.fields(held));
        let k = body.tangent(&gradients);
        Ok(Tangent { gradients, a: self.partition.a(&k), k })
    }

    /// [`HeldVolume::stiffness`] by a factor of its own: the one that finds the next equilibrium must not depend on when there was time
    /// for this. The error says that `held` is not stable.
    fn stiffness_at(&self, held: &HeldNodes) -> Result<DMatrix<f64>, SolveError> {
        let here = self.tangent(held)?;
        self.stiffness(&here.k, self.solver.factor(&here.a, &Silent)?.as_ref())
    }

    /// ∂²V/∂c² = Φᵀ K Φ by the coefficients c of the poses, Φ being the fields that keep the free nodes in balance.
    fn stiffness(&self, k: &StiffnessMatrix, factor: &dyn Factor) -> Result<DMatrix<f64>, SolveError> {
        let columns = FIELDS * self.volume.held.len();
        let mut fields = NodeFields::zeros(self.volume.mesh.nodes.len(), columns);
        for (e, (held, origin)) in self.volume.held.iter().zip(&self.origins).enumerate() {
            for &node in held {
                let arm = self.volume.mesh.nodes[node as usize] - origin;
                for axis in 0..3 {
                    let row = &mut fields.row_mut(3 * node as usize + axis)[FIELDS * e..][..FIELDS];
                    row[axis] = 1.0;
                    row[3 + 3 * axis..][..3].copy_from_slice(arm.as_slice());
                }
            }
        }
        let (free, _) = factor.solve(&self.partition.minus_b_times(k, &fields), &Silent)?;
        self.partition.insert_free(&free, &mut fields);
        let mut product = NodeFields::zeros(fields.nodes, columns);
        k.multiply(&fields, &mut product);
        let rows = 3 * fields.nodes;
        let phi = DMatrix::from_row_slice(rows, columns, &fields.data);
        let stiffness = phi.transpose() * DMatrix::from_row_slice(rows, columns, &product.data);
        Ok((&stiffness + stiffness.transpose()) * 0.5)
    }
}

/// Tells the stiffness of the newest equilibrium; `None` leaves that of the one before.
fn tell_stiffness(shared: &Shared, stiffness: Option<DMatrix<f64>>, epoch: u64) {
    let mut found = lock(&shared.found);
    if found.epoch != epoch {
        return;
    }
    found.version += 1;
    found.stiffness_version = found.version;
    if let Some(stiffness) = stiffness {
        found.stiffness = stiffness;
    }
}

fn at_rest(volume: &Volume) -> HeldNodes {
    let elements = volume.held.len();
    HeldNodes {
        poses: vec![ControlPose::REST; elements],
        u: vec![0.0; 3 * volume.mesh.nodes.len()],
        turns: vec![UnitQuaternion::identity(); elements],
        loads: StaticForces::default(),
    }
}
