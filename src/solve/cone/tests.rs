//! Problems with known conditions, and solutions found otherwise.

use super::compliance::Compliance;
use super::problem::Cone;
use crate::base::random::Random;
use nalgebra::{DMatrix, DVector, Vector2};

fn solved(w: &DMatrix<f64>, d0: &DVector<f64>, friction: &[f64]) -> DVector<f64> {
    let mut f = DVector::zeros(d0.len());
    let reached = Cone { w: &Compliance::of(w), d0, friction }.solve(&mut f);
    assert!(reached.is_solved, "{reached:?}");
    let d = w * &f + d0;
    for (a, mu) in friction.iter().enumerate() {
        let (n, t) = (f[3 * a], Vector2::new(f[3 * a + 1], f[3 * a + 2]));
        let (gap, slip) = (d[3 * a], Vector2::new(d[3 * a + 1], d[3 * a + 2]));
        let (far, strong) = (1e-8 * d0.amax(), 1e-8 * f.amax());
        assert!(gap >= -far && n >= 0.0 && t.norm() <= mu * n + strong, "contact {a}: {gap:e} m, {n} N, {t}");
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
    let d0 = DVector::from_fn(3 * contacts, |row, _| if row % 3 == 0 { number() - 0.3 } else { number() });
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
    let computed = whole.computed();
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

/// Forces by a great many small steps: of one contact after the other against its displacement, and back into its cone.
fn slowly(w: &DMatrix<f64>, d0: &DVector<f64>, friction: &[f64], most: usize) -> DVector<f64> {
    let (rows, mut f) = (w.nrows(), vec![0.0; w.nrows()]);
    let moved = |row: usize, f: &[f64]| {
        let column = &w.as_slice()[row * rows..(row + 1) * rows];
        d0[row] + column.iter().zip(f).map(|(w, f)| w * f).sum::<f64>()
    };
    for _ in 0..most {
        let before = f.clone();
        for (a, mu) in friction.iter().enumerate() {
            let [x, y, z] = [3 * a, 3 * a + 1, 3 * a + 2];
            f[x] = (f[x] - moved(x, &f) / w[(x, x)]).max(0.0);
            let step = 1.0 / (w[(y, y)] + w[(z, z)]);
            let [u, v] = [f[y] - step * moved(y, &f), f[z] - step * moved(z, &f)];
            let back = (mu * f[x] / u.hypot(v).max(f64::MIN_POSITIVE)).min(1.0);
            (f[y], f[z]) = (u * back, v * back);
        }
        let change = f.iter().zip(&before).map(|(new, old)| (new - old).abs()).fold(0.0, f64::max);
        if change <= 1e-12 * f.iter().fold(0.0, |most: f64, f| most.max(f.abs())) {
            break;
        }
    }
    DVector::from_vec(f)
}

/// Compliances of springs that a soft body of 20 motions joins, and random gaps and slips.
fn joined(contacts: usize) -> (DMatrix<f64>, DVector<f64>) {
    let mut random = Random::default();
    let g = DMatrix::from_fn(3 * contacts, 20, |_, _| 0.4 * random.draw());
    let w = &g * g.transpose() + DMatrix::identity(3 * contacts, 3 * contacts);
    let d0 = DVector::from_fn(3 * contacts, |row, _| match row % 3 {
        0 => random.draw() - 0.3,
        _ => 0.5 * random.draw(),
    });
    (w, d0)
}

#[test]
fn hundreds_of_contacts_have_the_forces_that_slow_steps_find() {
    let (w, d0) = joined(300);
    for mu in [0.0, 0.3] {
        let friction = vec![mu; 300];
        let (f, slow) = (solved(&w, &d0, &friction), slowly(&w, &d0, &friction, 100_000));
        let pressed = (0..300).filter(|a| f[3 * a] > 0.0).count();
        let slips = |a: &usize| {
            let tangent = f[3 * a + 1].hypot(f[3 * a + 2]);
            f[3 * a] > 0.0 && tangent > (1.0 - 1e-6) * mu * f[3 * a]
        };
        let slipping = (0..300).filter(slips).count();
        println!("{pressed} pressed, {slipping} slip, off by {:e} N", (&f - &slow).amax());
        assert!(pressed > 150 && pressed < 290 && (mu == 0.0 || (slipping > 20 && slipping < pressed - 20)));
        assert!((&f - &slow).amax() < 1e-6 * f.amax(), "{:e} of {} N", (&f - &slow).amax(), f.amax());
    }
}

/// Contacts that stand for one another: how they share the force is open, their sum is not, nor what it does.
#[test]
fn contacts_that_are_there_three_times_move_as_one() {
    let (w, d0) = joined(20);
    let row = |row: usize| 3 * (row / 9) + row % 3;
    let thrice = DMatrix::from_fn(180, 180, |r, c| w[(row(r), row(c))]);
    let d0_thrice = DVector::from_fn(180, |r, _| d0[row(r)]);
    let f = solved(&w, &d0, &[0.3; 20]);
    let shared = solved(&thrice, &d0_thrice, &[0.3; 60]);
    let sum = DVector::from_fn(60, |r, _| (0..3).map(|k| shared[9 * (r / 3) + 3 * k + r % 3]).sum());
    assert!((&f - &sum).amax() < 1e-6 * f.amax(), "{:e} of {} N", (&f - &sum).amax(), f.amax());
}

/// A body that does not yield, and numbers that are none: it ends, whatever it finds.
#[test]
fn what_is_no_compliance_ends() {
    for bad in [0.0, f64::NAN, f64::INFINITY, -1.0] {
        for (w_is_bad, d0_is_bad) in [(true, false), (false, true), (true, true)] {
            let w = DMatrix::from_fn(30, 30, |r, c| {
                if r != c {
                    0.0
                } else if w_is_bad {
                    bad
                } else {
                    1.0
                }
            });
            let d0 = DVector::from_fn(30, |r, _| if r < 4 && d0_is_bad { bad } else { -1.0 });
            let mut f = DVector::zeros(30);
            let reached = Cone { w: &Compliance::of(&w), d0: &d0, friction: &[0.3; 10] }.solve(&mut f);
            let is_sound = !w_is_bad && (bad == 0.0 || bad == -1.0);
            assert!(!is_sound || reached.is_solved, "{bad}: {reached:?}");
        }
    }
}
