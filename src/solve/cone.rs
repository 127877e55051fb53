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

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::lu::partial_pivoting::solve::{solve_in_place, solve_in_place_scratch};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};

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
const SLIP_STEPS: usize = 30;

/// A problem.
pub struct Cone<'a> {
    pub w: &'a DMatrix<f64>,
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
        self.missed > FAR * self.largest
    }
}

impl Cone<'_> {
    fn contacts(&self) -> usize {
        self.friction.len()
    }

    fn block(&self, a: usize) -> Matrix3<f64> {
        self.w.fixed_view::<3, 3>(3 * a, 3 * a).into_owned()
    }

    /// Improves `f` until the conditions hold.
    pub fn solve(&self, f: &mut DVector<f64>) -> Reached {
        let largest = self.d0.amax();
        let limit = TOLERANCE * largest;
        let mut reached = Reached { sweeps: 0, missed: self.missed(f), largest, is_solved: false };
        while reached.missed > limit && reached.sweeps < MOST_SWEEPS {
            for _ in 0..BETWEEN {
                (0..self.contacts()).for_each(|a| self.relax(a, f));
            }
            reached.sweeps += BETWEEN;
            let before = reached.missed;
            reached.missed = self.missed(f);
            if reached.missed > limit.max(NEARER * before) {
                self.polish(f, limit);
                reached.missed = self.missed(f);
            }
        }
        reached.is_solved = reached.missed <= limit;
        reached
    }

    /// Solves one contact while the others keep their forces.
    fn relax(&self, a: usize, f: &mut DVector<f64>) {
        let own = self.block(a);
        let at = 3 * a;
        let old = f.fixed_rows::<3>(at).into_owned();
        let row = |i: usize| self.d0[at + i] + self.w.column(at + i).dot(f);
        // W is symmetric, and its columns are contiguous.
        let free = Vector3::new(row(0), row(1), row(2)) - own * old;
        f.fixed_rows_mut::<3>(at).copy_from(&single(&own, &free, self.friction[a], &old));
    }

    /// Largest displacement by which the conditions are missed: of what f - ρ d, put into its cone, differs from f.
    pub fn missed(&self, f: &DVector<f64>) -> f64 {
        let d = self.w * f + self.d0;
        let of = |a: usize| {
            let softness = self.block(a).trace().max(f64::MIN_POSITIVE) / 3.0;
            let (own, gap) = (f.fixed_rows::<3>(3 * a).into_owned(), d.fixed_rows::<3>(3 * a));
            let moved = own - gap / softness;
            let normal = moved.x.max(0.0);
            let tangent = within(&Vector2::new(moved.y, moved.z), self.friction[a] * own.x.max(0.0));
            softness * (own - Vector3::new(normal, tangent.x, tangent.y)).norm()
        };
        (0..self.contacts()).map(of).fold(0.0, f64::max)
    }

    /// Newton steps, shortened until each is nearer than the last.
    fn polish(&self, f: &mut DVector<f64>, limit: f64) {
        let mut missed = self.missed(f);
        for _ in 0..NEWTON_STEPS {
            let Some(next) = self.newton(f) else { return };
            let nearer = (0..HALVINGS).find_map(|halving| {
                let tried = f.lerp(&next, 0.5_f64.powi(halving));
                let then = self.missed(&tried);
                (then < missed).then_some((tried, then))
            });
            let Some((tried, then)) = nearer else { return };
            (*f, missed) = (tried, then);
            if missed <= limit {
                return;
            }
        }
    }

    /// One Newton step for the equations of the contacts' present states; `None` where there are too many, or they do not determine it.
    fn newton(&self, f: &DVector<f64>) -> Option<DVector<f64>> {
        let d = self.w * f + self.d0;
        let is_active = |a: &usize| f[3 * a] - d[3 * a] / self.w[(3 * a, 3 * a)].max(f64::MIN_POSITIVE) > 0.0;
        let active: Vec<usize> = (0..self.contacts()).filter(is_active).collect();
        if active.is_empty() || active.len() > NEWTON_CONTACTS {
            return None;
        }
        let size = 3 * active.len();
        let (mut jacobian, mut wrong) = (DMatrix::zeros(size, size), DVector::zeros(size));
        // The forces of open contacts are gone.
        let mut kept = DVector::zeros(f.len());
        active.iter().for_each(|a| kept.fixed_rows_mut::<3>(3 * a).copy_from(&f.fixed_rows::<3>(3 * a)));
        let d = self.w * &kept + self.d0;
        for (i, &a) in active.iter().enumerate() {
            let (own, gap) =
                (kept.fixed_rows::<3>(3 * a).into_owned(), d.fixed_rows::<3>(3 * a).into_owned());
            let (by_force, by_gap, value) =
                equations(&own, &gap, self.friction[a], self.block(a).trace() / 3.0);
            wrong.fixed_rows_mut::<3>(3 * i).copy_from(&value);
            for (j, &b) in active.iter().enumerate() {
                let w = self.w.fixed_view::<3, 3>(3 * a, 3 * b);
                jacobian.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&(by_gap * w));
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
        let reached = Cone { w, d0, friction }.solve(&mut f);
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
