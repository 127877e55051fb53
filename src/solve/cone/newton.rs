//! A Newton step for the equations of the contacts' present states.
//!
//! In: forces f and the displacements d under them, and of each contact its state by f_t - d_t/s, with its softness s. Out: the forces of
//! the next step. A contact that is open has no unknown, one that sticks three (its force, by d = 0), one without friction that of its
//! normal. One that slips has two. Along a = (f_t - d_t/s)/|f_t - d_t/s| its force is μ f_n, across it
//!
//! ```text
//! d_n = 0        s (1 - τ) f_⊥ + τ d_⊥ = 0        τ = μ f_n/|f_t - d_t/s|
//! ```

use super::problem::{Cone, Tried, of, set};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::lu::partial_pivoting::solve::{solve_in_place, solve_in_place_scratch};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{Vector2, Vector3};

type V3 = Vector3<f64>;

/// A factor with N unknowns takes as long as N³/n² over this many sweeps over n contacts.
const OF_FACTOR: f64 = 150.0;
/// Part of its softness by which a contact yields more, so that forces that depend on one another are determined.
const SKIN: f64 = 1e-10;

/// Motion of a contact that touches.
#[derive(Clone, Copy)]
enum State {
    /// No friction holds it.
    Free,
    Sticks,
    /// Along this unit vector, with this τ.
    Slips(Vector2<f64>, f64),
}

/// A contact that touches, and its first unknown.
struct Touching {
    a: usize,
    state: State,
    first: usize,
}

impl Touching {
    fn size(&self) -> usize {
        match self.state {
            State::Free => 1,
            State::Slips(..) => 2,
            State::Sticks => 3,
        }
    }

    /// Directions of its force that its unknowns measure.
    fn directions(&self, friction: f64) -> [V3; 3] {
        match self.state {
            State::Slips(along, _) => [
                V3::new(1.0, friction * along.x, friction * along.y),
                V3::new(0.0, -along.y, along.x),
                V3::zeros(),
            ],
            _ => [V3::x(), V3::y(), V3::z()],
        }
    }

    /// Writes what its equations ask of its displacement.
    fn ask(&self, d: &V3, to: &mut [f64]) {
        let rows = &mut to[self.first..];
        match self.state {
            State::Free => rows[0] = d.x,
            State::Slips(along, part) => rows[..2].copy_from_slice(&[d.x, part * across(&along, d)]),
            State::Sticks => rows[..3].copy_from_slice(d.as_slice()),
        }
    }
}

/// Part of a tangential vector across a direction.
fn across(along: &Vector2<f64>, v: &V3) -> f64 {
    along.x * v.z - along.y * v.y
}

/// A step that is not solved for yet.
pub struct Newton<'a> {
    cone: &'a Cone<'a>,
    /// Forces of the contacts that touch; of those that slip they are as large along a as friction is.
    f: Vec<f64>,
    touching: Vec<Touching>,
    size: usize,
}

impl Cone<'_> {
    /// `None` where nothing touches.
    pub fn newton(&self, tried: &Tried) -> Option<Newton<'_>> {
        let normal = |a: usize| self.w.own(a)[(0, 0)].max(f64::MIN_POSITIVE);
        let touches = |a: &usize| tried.f[3 * a] - tried.d[3 * a] / normal(*a) > 0.0;
        let mut f = vec![0.0; tried.f.len()];
        let all: Vec<usize> = (0..self.contacts()).filter(touches).collect();
        all.iter().for_each(|a| set(&mut f, *a, &of(&tried.f, *a)));
        let d = self.displacements(&f);
        let (mut touching, mut size) = (Vec::with_capacity(all.len()), 0);
        for a in all {
            let own = of(&f, a);
            let aim = (own - of(&d, a) / self.w.softness(a)).yz();
            let (most, far) = (self.friction[a] * own.x.max(0.0), aim.norm());
            let state = if self.friction[a] == 0.0 {
                set(&mut f, a, &V3::new(own.x, 0.0, 0.0));
                State::Free
            } else if far <= most {
                State::Sticks
            } else {
                let along = aim / far;
                let lacks = along * (most - own.yz().dot(&along));
                set(&mut f, a, &(own + V3::new(0.0, lacks.x, lacks.y)));
                State::Slips(along, most / far)
            };
            let own = Touching { a, state, first: size };
            size += own.size();
            touching.push(own);
        }
        (size > 0).then_some(Newton { cone: self, f, touching, size })
    }
}

impl Newton<'_> {
    /// The sweeps that take as long as the step.
    pub fn sweeps(&self) -> usize {
        let contacts = self.cone.contacts() as f64;
        ((self.size as f64).powi(3) / (OF_FACTOR * contacts * contacts)).ceil() as usize
    }

    /// The forces after the step; `None` where they are not finite.
    pub fn forces(mut self) -> Option<Vec<f64>> {
        let Newton { cone, ref touching, size, .. } = self;
        let now = cone.displacements(&self.f);
        let mut jacobian = vec![0.0; size * size];
        let mut wrong = vec![0.0; size];
        let mut moved = vec![0.0; self.f.len()];
        for own in touching {
            let (a, first) = (own.a, own.first);
            let directions = own.directions(cone.friction[a]);
            for (k, direction) in directions.iter().enumerate().take(own.size()) {
                moved.fill(0.0);
                cone.w.add(a, direction, &mut moved);
                let column = &mut jacobian[(first + k) * size..][..size];
                touching.iter().for_each(|other| other.ask(&of(&moved, other.a), column));
                column[first + k] += SKIN * cone.w.softness(a);
            }
            own.ask(&of(&now, a), &mut wrong);
            if let State::Slips(along, part) = own.state {
                let soft = cone.w.softness(a) * (1.0 - part);
                jacobian[(first + 1) * size + first + 1] += soft;
                wrong[first + 1] += soft * across(&along, &of(&self.f, a));
            }
        }
        let step = solved(&mut jacobian, wrong)?;
        for own in touching {
            let directions = own.directions(cone.friction[own.a]);
            let change = &step[own.first..own.first + own.size()];
            let change: V3 = directions.iter().zip(change).map(|(direction, x)| direction * *x).sum();
            let force = of(&self.f, own.a) - change;
            set(&mut self.f, own.a, &force);
        }
        Some(self.f)
    }
}

/// J⁻¹ b, in one thread; `None` where it is not finite.
fn solved(jacobian: &mut [f64], mut b: Vec<f64>) -> Option<Vec<f64>> {
    let size = b.len();
    let needs = lu_in_place_scratch::<usize, f64>(size, size, Par::Seq, Spec::default())
        .or(solve_in_place_scratch::<usize, f64>(size, 1, Par::Seq));
    let mut memory = MemBuffer::new(needs);
    let stack = MemStack::new(&mut memory);
    let (mut rows, mut inverse) = (vec![0_usize; size], vec![0; size]);
    let matrix = MatMut::from_column_major_slice_mut(jacobian, size, size);
    let (_, rows) = lu_in_place(matrix, &mut rows, &mut inverse, Par::Seq, stack, Spec::default());
    let lu = MatRef::from_column_major_slice(jacobian, size, size);
    solve_in_place(lu, lu, rows, MatMut::from_column_major_slice_mut(&mut b, size, 1), Par::Seq, stack);
    b.iter().all(|x| x.is_finite()).then_some(b)
}
