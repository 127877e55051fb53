//! Contact forces: a complementarity problem with Coulomb's cone.
//!
//! In: for n contacts, each with a normal and two tangents, the compliance W, 3n × 3n, m/N, the displacements d₀ without forces, m (normal: the
//! gap; tangential: the slip), and a coefficient of friction μ of each. Out: forces f, N, with
//!
//! ```text
//! d = W f + d₀      0 ≤ d_n ⊥ f_n ≥ 0      |f_t| ≤ μ f_n,  f_t = -μ f_n d_t/|d_t| where d_t ≠ 0
//! ```
//!
//! Block Gauss–Seidel sweeps, each contact solved by itself (M. Jean, The non-smooth contact dynamics method, Computer Methods in
//! Applied Mechanics and Engineering 177, 1999, 235-257), find out which contacts are open, stick or slip. They converge slowly where a
//! soft body moves as a whole, so that between them a Newton step for the equations of these states (P. Alart and A. Curnier, the same
//! journal 92, 1991, 353-375) is tried, and kept where it is nearer.
//!
//! Of W only the columns of contacts that were pressed once are computed, and a sweep costs nothing for contacts that stay open: of a flat
//! body that falls onto a floor hundreds of nodes reach it, and few of them carry it.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::lu::partial_pivoting::solve::{solve_in_place, solve_in_place_scratch};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};
use std::cell::OnceCell;

/// Sweeps at most, and after how many a Newton step is tried where they have not come nearer by this factor.
const MOST_SWEEPS: usize = 300;
const BETWEEN: usize = 6;
const NEARER: f64 = 0.05;
/// Newton steps one after the other, and contacts for which a step is affordable in a frame.
const NEWTON_STEPS: usize = 8;
const NEWTON_CONTACTS: usize = 100;
/// Times that a step is halved at most.
const HALVINGS: i32 = 5;
/// Part of the largest displacement of d₀ by which the conditions may be missed.
const TOLERANCE: f64 = 1e-8;
/// Part of it by which they are missed where that is told.
const FAR: f64 = 1e-2;
/// Steps of a single contact that slips.
const SLIP_STEPS: usize = 8;

/// W, whose columns are computed when a force first needs them.
pub struct Compliance<'a> {
    /// 3 × 3 blocks on the diagonal.
    diagonal: Vec<Matrix3<f64>>,
    columns: Vec<OnceCell<DMatrix<f64>>>,
    /// The three columns of a contact, 3n × 3.
    compute: Box<dyn Fn(usize) -> DMatrix<f64> + 'a>,
}

impl<'a> Compliance<'a> {
    pub fn new(diagonal: Vec<Matrix3<f64>>, compute: impl Fn(usize) -> DMatrix<f64> + 'a) -> Compliance<'a> {
        let columns = vec![OnceCell::new(); diagonal.len()];
        Compliance { diagonal, columns, compute: Box::new(compute) }
    }

    /// The compliance of a matrix that is known as a whole.
    pub fn of(w: &'a DMatrix<f64>) -> Compliance<'a> {
        let block = |a: usize| w.fixed_view::<3, 3>(3 * a, 3 * a).into_owned();
        Compliance::new((0..w.nrows() / 3).map(block).collect(), |a| w.columns(3 * a, 3).into_owned())
    }

    fn columns(&self, a: usize) -> &DMatrix<f64> {
        self.columns[a].get_or_init(|| (self.compute)(a))
    }

    /// Displacement of contact `a` by a force at `b`.
    fn block(&self, a: usize, b: usize) -> Matrix3<f64> {
        self.columns(b).fixed_view::<3, 3>(3 * a, 0).into_owned()
    }

    /// Mean compliance of a contact in all directions, above 0.
    fn softness(&self, a: usize) -> f64 {
        self.diagonal[a].trace().max(f64::MIN_POSITIVE) / 3.0
    }
}

/// A problem.
pub struct Cone<'a> {
    pub w: &'a Compliance<'a>,
    pub d0: &'a DVector<f64>,
    pub friction: &'a [f64],
}

/// Distance of the forces from those that the conditions ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    pub sweeps: usize,
    /// Largest displacement by which a condition is missed, and largest one of d₀, m.
    pub missed: f64,
    pub largest: f64,
    pub is_solved: bool,
}

impl Reached {
    /// Whether more is missed than one could overlook.
    pub fn is_far(&self) -> bool {
        !self.is_solved && self.missed > FAR * self.largest
    }
}

impl Cone<'_> {
    fn contacts(&self) -> usize {
        self.friction.len()
    }

    /// d under these forces.
    pub fn displacements(&self, f: &DVector<f64>) -> DVector<f64> {
        let mut d = self.d0.clone();
        for a in 0..self.contacts() {
            let own = f.fixed_rows::<3>(3 * a);
            if own != Vector3::zeros() {
                d.gemv(1.0, self.w.columns(a), &own, 1.0);
            }
        }
        d
    }

    /// Improves `f` until the conditions hold. After a few sweeps over all contacts those that are pressed then are solved by themselves.
    pub fn solve(&self, f: &mut DVector<f64>) -> Reached {
        self.solve_within(f, 0.0)
    }

    /// [`Cone::solve`], done as soon as no condition is missed by more than `within`, m.
    pub fn solve_within(&self, f: &mut DVector<f64>, within: f64) -> Reached {
        let largest = self.d0.amax();
        let limit = within.max(TOLERANCE * largest);
        let mut reached = Reached { sweeps: 0, missed: self.missed(f), largest, is_solved: false };
        while reached.missed > limit && reached.sweeps < MOST_SWEEPS {
            self.sweep(f);
            reached.sweeps += BETWEEN;
            let pressed: Vec<usize> = (0..self.contacts()).filter(|a| f[3 * a] > 0.0).collect();
            if pressed.len() < self.contacts() {
                reached.sweeps += self.solve_alone(&pressed, f, limit, MOST_SWEEPS - reached.sweeps);
            } else {
                reached.sweeps += self.solve_all(f, limit, MOST_SWEEPS - reached.sweeps);
            }
            reached.missed = self.missed(f);
        }
        reached.is_solved = reached.missed <= limit;
        reached
    }

    /// Solves for some contacts while the others stay open. The sweeps that it took.
    fn solve_alone(&self, some: &[usize], f: &mut DVector<f64>, limit: f64, most: usize) -> usize {
        let n = 3 * some.len();
        let w = DMatrix::from_fn(n, n, |r, c| self.w.columns(some[c / 3])[(3 * some[r / 3] + r % 3, c % 3)]);
        let part = |v: &DVector<f64>| DVector::from_fn(n, |r, _| v[3 * some[r / 3] + r % 3]);
        let friction: Vec<f64> = some.iter().map(|a| self.friction[*a]).collect();
        let mut own = part(f);
        let alone = Cone { w: &Compliance::of(&w), d0: &part(self.d0), friction: &friction };
        let sweeps = alone.solve_all(&mut own, limit, most);
        for (i, a) in some.iter().enumerate() {
            f.fixed_rows_mut::<3>(3 * a).copy_from(&own.fixed_rows::<3>(3 * i));
        }
        sweeps
    }

    /// Sweeps and Newton steps over all contacts. The sweeps that it took.
    fn solve_all(&self, f: &mut DVector<f64>, limit: f64, most: usize) -> usize {
        let (mut sweeps, mut missed, mut wait, mut patience) = (0, self.missed(f), 0, 0);
        while missed > limit && sweeps < most {
            self.sweep(f);
            sweeps += BETWEEN;
            let before = std::mem::replace(&mut missed, self.missed(f));
            if wait > 0 {
                wait -= 1;
            } else if missed > limit.max(NEARER * before) {
                let swept = missed;
                missed = self.polish(f, limit, swept);
                // A step that does not help is not tried again soon.
                patience = if missed < NEARER * swept { 0 } else { 2 * patience + 1 };
                wait = patience;
            }
        }
        sweeps
    }

    fn sweep(&self, f: &mut DVector<f64>) {
        let mut d = self.displacements(f);
        for _ in 0..BETWEEN {
            (0..self.contacts()).for_each(|a| self.relax(a, f, &mut d));
        }
    }

    /// Solves one contact while the others keep their forces, under which the displacements are `d`.
    fn relax(&self, a: usize, f: &mut DVector<f64>, d: &mut DVector<f64>) {
        let (own, old) = (&self.w.diagonal[a], f.fixed_rows::<3>(3 * a).into_owned());
        let free = d.fixed_rows::<3>(3 * a) - own * old;
        let new = single(own, &free, self.friction[a], &old);
        if new != old {
            f.fixed_rows_mut::<3>(3 * a).copy_from(&new);
            d.gemv(1.0, self.w.columns(a), &(new - old), 1.0);
        }
    }

    /// Largest displacement by which the conditions are missed: of what f - ρ d, put into its cone, differs from f.
    pub fn missed(&self, f: &DVector<f64>) -> f64 {
        let d = self.displacements(f);
        let of = |a: usize| {
            let softness = self.w.softness(a);
            let (own, gap) = (f.fixed_rows::<3>(3 * a).into_owned(), d.fixed_rows::<3>(3 * a));
            let moved = own - gap / softness;
            let normal = moved.x.max(0.0);
            let tangent = within(&Vector2::new(moved.y, moved.z), self.friction[a] * own.x.max(0.0));
            softness * (own - Vector3::new(normal, tangent.x, tangent.y)).norm()
        };
        (0..self.contacts()).map(of).fold(0.0, f64::max)
    }

    /// Newton steps, shortened until each is nearer than the last; by how much the last misses.
    fn polish(&self, f: &mut DVector<f64>, limit: f64, mut missed: f64) -> f64 {
        for _ in 0..NEWTON_STEPS {
            let Some(next) = self.newton(f) else { break };
            let nearer = (0..HALVINGS).find_map(|halving| {
                let tried = f.lerp(&next, 0.5_f64.powi(halving));
                let then = self.missed(&tried);
                (then < missed).then_some((tried, then))
            });
            let Some((tried, then)) = nearer else { break };
            (*f, missed) = (tried, then);
            if missed <= limit {
                break;
            }
        }
        missed
    }

    /// One Newton step for the equations of the contacts' present states; `None` where there are too many, or they do not determine it.
    fn newton(&self, f: &DVector<f64>) -> Option<DVector<f64>> {
        let d = self.displacements(f);
        let is_active =
            |a: &usize| f[3 * a] - d[3 * a] / self.w.diagonal[*a][(0, 0)].max(f64::MIN_POSITIVE) > 0.0;
        let active: Vec<usize> = (0..self.contacts()).filter(is_active).collect();
        if active.is_empty() || active.len() > NEWTON_CONTACTS {
            return None;
        }
        let size = 3 * active.len();
        let (mut jacobian, mut wrong) = (DMatrix::zeros(size, size), DVector::zeros(size));
        // The forces of open contacts are gone.
        let mut kept = DVector::zeros(f.len());
        active.iter().for_each(|a| kept.fixed_rows_mut::<3>(3 * a).copy_from(&f.fixed_rows::<3>(3 * a)));
        let d = self.displacements(&kept);
        for (i, &a) in active.iter().enumerate() {
            let (own, gap) =
                (kept.fixed_rows::<3>(3 * a).into_owned(), d.fixed_rows::<3>(3 * a).into_owned());
            let (by_force, by_gap, value) = equations(&own, &gap, self.friction[a], self.w.softness(a));
            wrong.fixed_rows_mut::<3>(3 * i).copy_from(&value);
            for (j, &b) in active.iter().enumerate() {
                jacobian.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&(by_gap * self.w.block(a, b)));
            }
            let mut own = jacobian.fixed_view_mut::<3, 3>(3 * i, 3 * i);
            own += by_force;
        }
        let step = solved(jacobian, wrong)?;
        for (i, &a) in active.iter().enumerate() {
            let mut own = kept.fixed_rows_mut::<3>(3 * a);
            own -= step.fixed_rows::<3>(3 * i);
        }
        Some(kept)
    }
}

/// J⁻¹ b, in one thread; `None` where J is singular.
fn solved(mut jacobian: DMatrix<f64>, mut b: DVector<f64>) -> Option<DVector<f64>> {
    let size = b.len();
    let needs = lu_in_place_scratch::<usize, f64>(size, size, Par::Seq, Spec::default())
        .or(solve_in_place_scratch::<usize, f64>(size, 1, Par::Seq));
    let mut memory = MemBuffer::new(needs);
    let stack = MemStack::new(&mut memory);
    let (mut rows, mut inverse) = (vec![0_usize; size], vec![0; size]);
    let matrix = MatMut::from_column_major_slice_mut(jacobian.as_mut_slice(), size, size);
    let (_, rows) = lu_in_place(matrix, &mut rows, &mut inverse, Par::Seq, stack, Spec::default());
    let lu = MatRef::from_column_major_slice(jacobian.as_slice(), size, size);
    solve_in_place(
        lu,
        lu,
        rows,
        MatMut::from_column_major_slice_mut(b.as_mut_slice(), size, 1),
        Par::Seq,
        stack,
    );
    b.iter().all(|x| x.is_finite()).then_some(b)
}

/// The equations of a contact that touches, in metres, and their derivatives by its force and by its displacement.
fn equations(
    force: &Vector3<f64>,
    gap: &Vector3<f64>,
    friction: f64,
    softness: f64,
) -> (Matrix3<f64>, Matrix3<f64>, Vector3<f64>) {
    let (tangent, slip) = (Vector2::new(force.y, force.z), Vector2::new(gap.y, gap.z));
    let aim = tangent - slip / softness;
    let (most, size) = (friction * force.x.max(0.0), aim.norm());
    if size <= most {
        return (Matrix3::zeros(), Matrix3::identity(), *gap);
    }
    let along = aim / size;
    let turning = (Matrix2::identity() - along * along.transpose()) * (most / size);
    let (mut by_force, mut by_gap) = (Matrix3::zeros(), Matrix3::zeros());
    by_gap[(0, 0)] = 1.0;
    by_force.fixed_view_mut::<2, 2>(1, 1).copy_from(&((Matrix2::identity() - turning) * softness));
    by_force.fixed_view_mut::<2, 1>(1, 0).copy_from(&(along * (-friction * softness)));
    by_gap.fixed_view_mut::<2, 2>(1, 1).copy_from(&turning);
    let value = (tangent - along * most) * softness;
    (by_force, by_gap, Vector3::new(gap.x, value.x, value.y))
}

/// The force of a contact by itself: `w` its compliance, `free` its displacement without its force, `old` a force to begin with.
pub fn single(w: &Matrix3<f64>, free: &Vector3<f64>, friction: f64, old: &Vector3<f64>) -> Vector3<f64> {
    if free.x >= 0.0 || w[(0, 0)] <= 0.0 {
        return Vector3::zeros();
    }
    if friction == 0.0 {
        return Vector3::new(-free.x / w[(0, 0)], 0.0, 0.0);
    }
    if let Some(stick) = w.try_inverse().map(|inverse| -(inverse * free))
        && stick.x >= 0.0
        && stick.y.hypot(stick.z) <= friction * stick.x
    {
        return stick;
    }
    let step = 1.0 / (w[(1, 1)] + w[(2, 2)]);
    let mut f = Vector3::new(old.x.max(0.0), old.y, old.z);
    for _ in 0..SLIP_STEPS {
        let last = f;
        f.x = (-(free.x + w[(0, 1)] * f.y + w[(0, 2)] * f.z) / w[(0, 0)]).max(0.0);
        let slip = free + w * f;
        let tangent = within(&Vector2::new(f.y - step * slip.y, f.z - step * slip.z), friction * f.x);
        (f.y, f.z) = (tangent.x, tangent.y);
        if (f - last).norm() <= 1e-14 * f.norm() {
            break;
        }
    }
    f
}

/// The vector, or the nearest that is no longer than `most`.
pub fn within(vector: &Vector2<f64>, most: f64) -> Vector2<f64> {
    let size = vector.norm();
    if size <= most { *vector } else { vector * (most / size) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    fn solved(w: &DMatrix<f64>, d0: &DVector<f64>, friction: &[f64]) -> DVector<f64> {
        let mut f = DVector::zeros(d0.len());
        let reached = Cone { w: &Compliance::of(w), d0, friction }.solve(&mut f);
        assert!(reached.is_solved, "{reached:?}");
        let d = w * &f + d0;
        for (a, mu) in friction.iter().enumerate() {
            let (n, t) = (f[3 * a], Vector2::new(f[3 * a + 1], f[3 * a + 2]));
            let (gap, slip) = (d[3 * a], Vector2::new(d[3 * a + 1], d[3 * a + 2]));
            let (far, strong) = (1e-8 * d0.amax(), 1e-8 * f.amax());
            assert!(
                gap >= -far && n >= 0.0 && t.norm() <= mu * n + strong,
                "contact {a}: {gap:e} m, {n} N, {t}"
            );
            assert!(gap <= far || n <= strong, "contact {a} is open and pressed");
            if n > strong && slip.norm() > far {
                let against = t + slip * (mu * n / slip.norm());
                assert!(
                    against.norm() < 1e-5 * f.amax(),
                    "contact {a}: friction not against its slip by {} N",
                    against.norm()
                );
            }
        }
        f
    }

    /// Compliances G Gᵀ of random bodies, stiff in some directions and soft in others.
    fn random(contacts: usize, seed: u64) -> (DMatrix<f64>, DVector<f64>) {
        let mut random = Random::default();
        let mut number = || 2.0 * random.draw();
        for _ in 0..seed {
            number();
        }
        let g = DMatrix::from_fn(3 * contacts, 3 * contacts + 4, |_, column| {
            number() * if column < 3 { 30.0 } else { 1.0 }
        });
        let w = &g * g.transpose();
        let d0 =
            DVector::from_fn(3 * contacts, |row, _| if row % 3 == 0 { number() - 0.3 } else { number() });
        (w, d0)
    }

    /// Normal and tangential displacements are coupled here more than in any body; with friction of 1 a few are not solved.
    #[test]
    fn conditions_hold_for_random_compliances() {
        for contacts in [1, 2, 5, 20, 40] {
            for (seed, mu) in [(1, 0.0), (2, 0.1), (3, 0.2), (4, 0.4)] {
                let (w, d0) = random(contacts, 100 * contacts as u64 + seed);
                solved(&w, &d0, &vec![mu; contacts]);
            }
        }
    }

    /// Points of a half-space (Boussinesq's 1/r) that shifts and tilts as a whole, from not at all to a thousand times as easily as a
    /// point yields; a ball presses it and rubs.
    #[test]
    fn conditions_hold_for_soft_and_stiff_bodies() {
        for (side, soft) in [(3, 0.0), (6, 1.0), (8, 30.0), (10, 0.0), (10, 1e3)] {
            let n = side * side;
            let place = |i: usize| [(i % side) as f64 + 0.1, (i / side) as f64].map(|x| x / side as f64);
            let away = |i: usize, j: usize| {
                let ([a, b], [c, d]) = (place(i), place(j));
                side as f64 * (a - c).hypot(b - d)
            };
            let near = |i: usize, j: usize| if i == j { 2.0 } else { 0.5 / away(i, j) };
            let moved = |i: usize| {
                let [x, z] = place(i);
                [[1.0, x, z, 0.0, 0.0], [0.1, 0.0, 0.05, 1.0, 0.0], [0.0, 0.05, 0.0, 0.0, 1.0]]
            };
            let w = DMatrix::from_fn(3 * n, 3 * n, |row, column| {
                let own = if row % 3 == column % 3 { near(row / 3, column / 3) } else { 0.0 };
                let both = moved(row / 3)[row % 3].into_iter().zip(moved(column / 3)[column % 3]);
                own + soft * both.map(|(a, b)| a * b).sum::<f64>()
            });
            let d0 = DVector::from_fn(3 * n, |row, _| {
                let [x, z] = place(row / 3);
                [-1.0 + 0.16 * side as f64 * ((x - 0.5).powi(2) + (z - 0.5).powi(2)), 0.7, -0.2][row % 3]
            });
            [0.0, 0.1, 0.4, 1.0].into_iter().for_each(|mu| drop(solved(&w, &d0, &vec![mu; n])));
        }
    }

    /// A stiff plate with 400 nodes lands on a floor that is not quite flat: most of them are open, and their columns are not computed.
    #[test]
    fn open_contacts_cost_nothing() {
        let n = 400;
        let place = |i: usize| [(i % 20) as f64 / 19.0, (i / 20) as f64 / 19.0];
        let moved = |i: usize| {
            let [x, z] = place(i);
            [[1.0, x, z, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0]]
        };
        let w = DMatrix::from_fn(3 * n, 3 * n, |row, column| {
            let both = moved(row / 3)[row % 3].into_iter().zip(moved(column / 3)[column % 3]);
            (if row == column { 0.01 } else { 0.0 }) + both.map(|(a, b)| a * b).sum::<f64>()
        });
        let d0 = DVector::from_fn(3 * n, |row, _| {
            let [x, z] = place(row / 3);
            [0.5 * (x - 0.5).powi(2) + 0.2 * (z - 0.4).powi(2) - 0.9, 0.1, -0.05][row % 3]
        });
        let (friction, whole) = (vec![0.3; n], Compliance::of(&w));
        let mut f = DVector::zeros(3 * n);
        let reached = Cone { w: &whole, d0: &d0, friction: &friction }.solve(&mut f);
        let computed = whole.columns.iter().filter(|column| column.get().is_some()).count();
        let pressed = (0..n).filter(|a| f[3 * a] > 0.0).count();
        println!("{computed} columns of {n}, {pressed} pressed");
        assert!(reached.is_solved && computed < n / 2, "{computed} of {n}, {reached:?}");
        solved(&w, &d0, &friction);
    }

    /// The forces without friction minimise ½ fᵀ W f + d₀ᵀ f over f ≥ 0; all sets of open contacts are tried.
    #[test]
    fn without_friction_it_is_the_minimum_of_the_energy() {
        let (w, d0) = random(8, 7);
        let f = solved(&w, &d0, &[0.0; 8]);
        let normal = |v: &DVector<f64>| DVector::from_fn(8, |a, _| v[3 * a]);
        let (w, d0, f) = (DMatrix::from_fn(8, 8, |a, b| w[(3 * a, 3 * b)]), normal(&d0), normal(&f));
        let energy = |f: &DVector<f64>| 0.5 * f.dot(&(&w * f)) + d0.dot(f);
        let mut least = 0.0_f64;
        for set in 1..1_usize << 8 {
            let active: Vec<usize> = (0..8).filter(|a| set >> a & 1 == 1).collect();
            let part = DMatrix::from_fn(active.len(), active.len(), |i, j| w[(active[i], active[j])]);
            let load = DVector::from_fn(active.len(), |i, _| -d0[active[i]]);
            let Some(found) = part.cholesky().map(|factor| factor.solve(&load)) else { continue };
            if found.iter().all(|f| *f >= 0.0) {
                let mut all = DVector::zeros(8);
                active.iter().zip(found.iter()).for_each(|(a, f)| all[*a] = *f);
                least = least.min(energy(&all));
            }
        }
        assert!(
            least < 0.0 && (energy(&f) - least).abs() < 1e-9 * least.abs(),
            "{} J, least {least} J",
            energy(&f)
        );
    }

    /// A single contact on a spring that is as stiff in all directions, pressed by 1 m and pushed along by s: it sticks up to s = μ.
    #[test]
    fn a_single_contact_slips_beyond_its_cone() {
        let w = DMatrix::identity(3, 3);
        for (shift, force) in [(0.2, 0.2), (0.49, 0.49), (0.51, 0.5), (3.0, 0.5)] {
            let f = solved(&w, &DVector::from_column_slice(&[-1.0, shift, 0.0]), &[0.5]);
            assert!((f[0] - 1.0).abs() < 1e-9 && (f[1] + force).abs() < 1e-9, "{shift} m: {f}");
        }
    }
}
