//! The rod against twists, arcs and rolls in closed form, the elastica, tabulated tips and the twist at which it buckles.

use super::*;
use crate::deform::pose::se3::joined;
use nalgebra::{DMatrix, DVector, Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// EA, GA, GA, GJ, EI, EI.
fn section(stiffness: [f64; 6]) -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::from(stiffness))
}

fn straight(stiffness: [f64; 6], segments: usize) -> Chain {
    let piece = Vector6::new(1.0 / segments as f64, 0.0, 0.0, 0.0, 0.0, 0.0);
    Chain::new(&section(stiffness), &Matrix6::zeros(), piece, segments, Isometry3::identity())
}

/// L = 1, EI = 1, ν = 0.3, as in the shared case `rod`.
const ROUND: [f64; 6] = [1e4, 1e4 / 2.6 * 0.9, 1e4 / 2.6 * 0.9, 1.0 / 1.3, 1.0, 1.0];
/// Stiffness of a rod that is as good as inextensible and rigid in shear.
const ELASTICA: [f64; 6] = [1e6, 1e6, 1e6, 1.0, 1.0, 1.0];

/// The rod clamped at its start, its end free and under a dead force F and a moment M in the room's axes: Newton's
/// iteration for all free sections.
fn load(chain: &mut Chain, force: Vector3<f64>, moment: Vector3<f64>, steps: usize) -> Isometry3<f64> {
    let last = chain.segments();
    for step in 1..=steps {
        let share = step as f64 / steps as f64;
        for iteration in 0.. {
            assert!(iteration < 30, "no equilibrium at {share} of the load");
            chain.assemble();
            let pull = chain.frames[last].rotation.inverse() * force * share;
            let twist = chain.frames[last].rotation.inverse() * moment * share;
            chain.gradient[last] -= joined(&pull, &twist);
            // Along a screw (v, ω) the force's work has the second derivative f · (ω × v).
            let mut corner = chain.diagonal[last].fixed_view_mut::<3, 3>(3, 0);
            corner += pull.cross_matrix() * 0.5;
            let mut corner = chain.diagonal[last].fixed_view_mut::<3, 3>(0, 3);
            corner += pull.cross_matrix().transpose() * 0.5;
            // The room's moment turns against the section.
            let mut corner = chain.diagonal[last].fixed_view_mut::<3, 3>(3, 3);
            corner -= twist.cross_matrix() * 0.5;
            let (mut hessian, mut rest) = (DMatrix::zeros(6 * last, 6 * last), DVector::zeros(6 * last));
            for i in 0..last {
                rest.rows_mut(6 * i, 6).copy_from(&chain.gradient[i + 1]);
                hessian.view_mut((6 * i, 6 * i), (6, 6)).copy_from(&chain.diagonal[i + 1]);
                if i > 0 {
                    let block = chain.beside[i];
                    hessian.view_mut((6 * i - 6, 6 * i), (6, 6)).copy_from(&block);
                    hessian.view_mut((6 * i, 6 * i - 6), (6, 6)).copy_from(&block.transpose());
                }
            }
            let eta = hessian.lu().solve(&-rest).unwrap();
            let excess = (eta.amax() / (0.2 * chain.length)).max(1.0);
            for i in 0..last {
                let step = Vector6::from_iterator(eta.rows(6 * i, 6).iter().map(|x| x / excess));
                chain.frames[i + 1] *= exp(&step);
            }
            if eta.amax() < 1e-8 * chain.length {
                break;
            }
        }
    }
    chain.frames[last]
}

/// Strain energy ½ GJ φ²/L of a twist and ½ EI φ²/L of an arc, for any number of segments; torques GJ φ/L, EI φ/L.
#[test]
fn twists_and_arcs_are_exact() {
    for segments in [4, 32] {
        for degrees in [90f64, 180.0, 360.0, 600.0] {
            let mut chain = straight(ROUND, segments);
            let (mut standing, angle) = (None, degrees.to_radians());
            for step in 1..=20 {
                let turn = angle * f64::from(step) / 20.0;
                let half = Quaternion::new((0.5 * turn).cos(), (0.5 * turn).sin(), 0.0, 0.0);
                let turned = UnitQuaternion::new_unchecked(half);
                let end = Isometry3::from_parts(Vector3::x().into(), turned);
                standing = chain.hold(&[Isometry3::identity(), end]);
            }
            let standing = standing.unwrap();
            let (energy, torque) = (0.5 * angle * angle / 1.3, angle / 1.3);
            assert!((standing.energy / energy - 1.0).abs() < 1e-9, "{degrees}: {standing:?}");
            assert!((standing.wrenches[1] - Vector6::ith(3, torque)).amax() < 1e-7, "{standing:?}");
            assert!(!standing.buckled);
        }
        let mut chain = straight(ROUND, segments);
        let end = exp(&Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.5 * PI));
        let standing = chain.hold(&[Isometry3::identity(), end]).unwrap();
        assert!((standing.energy / (PI * PI / 8.0) - 1.0).abs() < 1e-9, "{standing:?}");
        assert!((standing.wrenches[1] - Vector6::ith(5, 0.5 * PI)).amax() < 1e-6, "{standing:?}");
    }
}

/// Cantilever with a dead transverse load P L²/EI = α: w/L and the shortening u/L, by Bisshopp and Drucker (1945) and
/// Mattiasson, IJNME 17 (1981) 145-153.
#[test]
fn the_elastica_has_its_tabulated_tip() {
    for (alpha, across, short) in [
        (1.0, 0.30172077379981355, 0.05643323628337688),
        (5.0, 0.7137915236119128, 0.38762836072442985),
        (10.0, 0.8106090248802964, 0.5549955977537513),
    ] {
        let error = |segments: usize| {
            let mut chain = straight(ELASTICA, segments);
            let tip = load(&mut chain, Vector3::y() * alpha, Vector3::zeros(), 20).translation.vector;
            (tip.y - across).hypot(1.0 - tip.x - short)
        };
        let (coarse, fine) = (error(16), error(32));
        assert!(fine < 4e-4, "α = {alpha}: {fine:e}");
        let rate = (coarse / fine).log2();
        assert!((1.8..2.3).contains(&rate), "α = {alpha}: rate {rate}, {coarse:e}, {fine:e}");
    }
}

/// A moment 2π EI/L rolls a cantilever up to a circle (Simo and Vu-Quoc, CMAME 58, 1986).
#[test]
fn a_moment_rolls_the_rod_up() {
    let mut chain = straight(ROUND, 32);
    let tip = load(&mut chain, Vector3::zeros(), Vector3::z() * (2.0 * PI), 60);
    assert!(tip.translation.vector.norm() < 1e-6, "{tip}");
    let half = chain.frames[16].translation.vector;
    assert!((half - Vector3::new(0.0, 1.0 / PI, 0.0)).norm() < 1e-6, "{half}");
}

/// Tips of cantilevers with EI = 1, EA = 10⁴ under a force, and under a force with a torque that bend them out of the
/// plane: a boundary value problem solved to 1e-9 (scipy.integrate.solve_bvp; the shared case `rod`).
#[test]
fn loaded_cantilevers_have_their_tips() {
    let stiffness = [1e4, 3461.5384615384614, 3461.5384615384614, 0.7692307692307692, 1.0, 1.0];
    for (force, moment, expected) in [
        (Vector3::new(0.0, 0.0, 10.0), Vector3::zeros(), [0.44478434649665877, 0.0, 0.8119885696765466]),
        (
            Vector3::new(0.0, 5.0, 3.0),
            Vector3::new(1.0, 0.0, 0.0),
            [0.5729176554064224, 0.5609553586735657, 0.47742289341470445],
        ),
    ] {
        let error = |segments: usize| {
            let mut chain = straight(stiffness, segments);
            let tip = load(&mut chain, force, moment, 10).translation.vector;
            (tip - Vector3::from(expected)).norm()
        };
        let (coarse, fine) = (error(16), error(32));
        assert!(fine < 5e-4, "{force}: {fine:e}");
        let rate = (coarse / fine).log2();
        assert!((1.8..2.2).contains(&rate), "{force}: rate {rate}, {coarse:e}, {fine:e}");
    }
}

/// The bend of 45° of Bathe and Bolourchi, IJNME 14 (1979), with the polar constant 1/6; tips of a boundary value problem
/// solved to 1e-10. Published: (15.79, 47.23, 53.37) at 600 by Simo and Vu-Quoc (1986).
#[test]
fn bathes_bend_has_its_tip() {
    let stiffness = section([1e7, 5e6, 5e6, 1e7 / 12.0, 1e7 / 12.0, 1e7 / 12.0]);
    for (force, expected) in [
        (300.0, [22.24478094536686, 58.779122489682365, 40.19189167014999]),
        (600.0, [15.68480053403855, 47.150438573628904, 53.47485879182502]),
    ] {
        let error = |segments: usize| {
            // Along its own first axis; it starts along +y about a centre at (100, 0, 0).
            let angle = 0.25 * PI / segments as f64;
            let piece = Vector6::new(100.0 * angle, 0.0, 0.0, 0.0, 0.0, -angle);
            let axes = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
            let axes = UnitQuaternion::from_matrix(&axes);
            let first = Isometry3::from_parts(Vector3::zeros().into(), axes);
            let mut chain = Chain::new(&stiffness, &Matrix6::zeros(), piece, segments, first);
            let rest = chain.frames[segments].translation.vector;
            assert!((rest - Vector3::new(29.289, 70.711, 0.0)).amax() < 1e-3, "{rest}");
            let tip = load(&mut chain, Vector3::z() * force, Vector3::zeros(), 60).translation.vector;
            (tip - Vector3::from(expected)).norm()
        };
        let (coarse, fine) = (error(16), error(32));
        assert!(fine < 0.02, "{force} N: {fine:e} m of 78 m");
        let rate = (coarse / fine).log2();
        assert!((1.8..2.2).contains(&rate), "{force} N: rate {rate}, {coarse:e}, {fine:e}");
    }
}

/// Both tangents clamped, the straight twisted rod loses its stability at M L/B = 8.98682, the first root of
/// tan x = x twice (Greenhill, 1883): a twist of 8.98682 (1 + ν), 669° for a round section with ν = 0.3.
#[test]
fn a_twisted_rod_buckles_at_greenhills_twist() {
    let twisted = |chain: &mut Chain, angle: f64| {
        for (i, frame) in chain.frames.iter_mut().enumerate() {
            let half = 0.5 * angle * i as f64 / 60.0;
            let turn = UnitQuaternion::new_unchecked(Quaternion::new(half.cos(), half.sin(), 0.0, 0.0));
            *frame = Isometry3::from_parts((Vector3::x() * (i as f64 / 60.0)).into(), turn);
        }
    };
    let mut chain = straight(ROUND, 60);
    let (mut stable, mut unstable) = (500f64.to_radians(), 800f64.to_radians());
    while unstable - stable > 1e-4 {
        let middle = 0.5 * (stable + unstable);
        twisted(&mut chain, middle);
        if chain.is_stable() { stable = middle } else { unstable = middle }
    }
    let expected = 8.98681891581813 * 1.3;
    assert!((stable / expected - 1.0).abs() < 5e-3, "{} rad, not {expected}", stable);
    // Above it, the rod does not stay straight, below it does.
    for (angle, buckles) in [(0.97 * expected, false), (1.05 * expected, true)] {
        twisted(&mut chain, angle);
        let (first, last) = (chain.frames[0], chain.frames[60]);
        let straight = 0.5 * angle * angle / 1.3;
        let standing = chain.hold(&[first, last]).unwrap();
        assert_eq!(standing.buckled, buckles);
        assert!(chain.is_stable());
        let off = chain.frames.iter().map(|f| f.translation.vector.yz().norm()).fold(0.0, f64::max);
        assert_eq!(off > 1e-3, buckles, "{off}");
        assert!(!buckles || standing.energy < straight * (1.0 - 1e-6), "{standing:?} {straight}");
    }
}

/// The wrenches are the energy's slopes, with a section that stretches as it bends and twists, and they do not feel a
/// common motion.
#[test]
fn wrenches_are_slopes_of_the_energy() {
    let mut second = Matrix6::zeros();
    second.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::new(3.0, 0.2, 0.1, 0.2, 1.5, 0.0, 0.1, 0.0, 2.0));
    second[(0, 0)] = 1.0;
    let piece = Vector6::new(0.05, 0.0, 0.0, 0.0, 0.0, 0.0);
    let mut chain = Chain::new(
        &section([1e2, 50.0, 50.0, 0.8, 1.0, 1.2]),
        &(second * 1e-2),
        piece,
        20,
        Isometry3::identity(),
    );
    let end = exp(&Vector6::new(0.9, 0.1, 0.05, 0.7, -0.4, 1.1));
    let clamps = |e: usize, eta: Vector6<f64>| {
        let mut clamps = [Isometry3::identity(), end];
        clamps[e] *= exp(&eta);
        clamps
    };
    let standing = chain.hold(&clamps(0, Vector6::zeros())).unwrap();
    for (e, k) in (0..12).map(|i| (i / 6, i % 6)) {
        let mut eta = Vector6::zeros();
        eta[k] = 1e-5;
        let mut energy = |eta| chain.hold(&clamps(e, eta)).unwrap().energy;
        let slope = (energy(eta) - energy(-eta)) / 2e-5;
        let found = standing.wrenches[e][k];
        assert!((found - slope).abs() < 1e-6 * standing.wrenches[e].amax(), "{e} {k}: {found} {slope}");
    }
    let common = exp(&Vector6::new(5.0, -3.0, 2.0, 0.3, 2.0, -1.0));
    let moved = chain.hold(&[common, common * end]).unwrap();
    assert!((moved.energy / standing.energy - 1.0).abs() < 1e-10, "{moved:?} {standing:?}");
    assert!((moved.wrenches[1] - standing.wrenches[1]).amax() < 1e-7 * standing.wrenches[1].amax());
}

/// q L⁴/(384 EI) + q L²/(8 GA) in the middle of a rod between two clamps, q L/2 and q L²/12 on each (Timoshenko, Strength of Materials I,
/// 3rd ed. 1955, sections 38 and 39); n pieces with the load at their ends have 4/n² less of the first and 1/n² less of the last. A rod
/// that is longer by e and held at its length presses with EA e.
#[test]
fn a_rod_between_clamps_sags_and_presses_as_the_book_says() {
    let q = 1e-3;
    let loaded = |n: usize| {
        let mut chain = straight(ELASTICA, n);
        let weight = |i: usize| if i == 0 || i == n { 0.5 } else { 1.0 } * q / n as f64;
        chain
            .bear((0..=n).map(|i| Borne { force: Vector3::y() * weight(i), moments: Matrix3::zeros() }), 1.0);
        let clamps = [chain.frames[0], chain.frames[n]];
        (chain, clamps)
    };
    for n in [16, 32, 64] {
        let (mut chain, clamps) = loaded(n);
        let (standing, pieces) = (chain.hold(&clamps).unwrap(), (n * n) as f64);
        let sag = chain.frames[n / 2].translation.vector.y * 384.0 / q;
        let expected = 1.0 - 4.0 / pieces + 384.0 / 8.0 / ELASTICA[1];
        assert!((sag - expected).abs() < 2e-6, "{n}: {sag}, not {expected}");
        let [first, last] = standing.wrenches.map(|wrench| (-wrench[1] * 2.0 / q, -wrench[5] * 12.0 / q));
        assert!((first.0 - 1.0).abs() < 4e-8 && (last.0 - 1.0).abs() < 4e-8, "{first:?} {last:?}");
        let moment = 1.0 - 1.0 / pieces;
        assert!((first.1 - moment).abs() < 2e-6 && (last.1 + moment).abs() < 2e-6, "{first:?} {last:?}");
    }
    let n = 32;
    let (mut chain, clamps) = loaded(n);
    chain.hold(&clamps).unwrap();
    chain.bear(std::iter::empty(), 1.0 + 1e-6);
    let warm = chain.hold(&clamps).unwrap();
    assert!((warm.wrenches[1][0] + 1e6 * 1e-6).abs() < 1e-5, "{:?}", warm.wrenches);
    assert!(chain.frames[n / 2].translation.vector.y.abs() < 1e-9, "nothing of the load is left");
}

/// Energy, gradient and Hessian with loads on every section, against differences along a motion of all inner sections.
#[test]
fn loads_are_part_of_the_slopes_and_the_hessian() {
    let mut chain = straight([1e2, 50.0, 50.0, 0.8, 1.0, 1.2], 6);
    let number = |i: usize| ((i * 2_654_435_761 % 1000) as f64 - 500.0) * 1e-3;
    let borne = |i: usize| {
        let moments = Matrix3::from_fn(|a, b| number(29 * i + 3 * a + b));
        Borne { force: Vector3::new(number(7 * i), number(7 * i + 3), number(7 * i + 5)), moments }
    };
    chain.bear((0..7).map(borne), 1.02);
    let step = |i: usize| Vector6::from_fn(|k, _| number(31 * i + 5 * k + 2));
    for i in 1..6 {
        chain.frames[i] *= exp(&(step(i + 11) * 0.3));
    }
    chain.assemble();
    let slope: f64 = (1..6).map(|i| chain.gradient[i].dot(&step(i))).sum();
    let second: f64 = (1..6)
        .map(|i| {
            let across = if i < 5 { 2.0 * step(i).dot(&(chain.beside[i] * step(i + 1))) } else { 0.0 };
            step(i).dot(&(chain.diagonal[i] * step(i))) + across
        })
        .sum();
    let at = |by: f64| {
        let mut frames = chain.frames.clone();
        (1..6).for_each(|i| frames[i] *= exp(&(step(i) * by)));
        chain.energy_of(&frames)
    };
    let h = 1e-4;
    let (high, low, here) = (at(h), at(-h), at(0.0));
    let (found, curved) = ((high - low) / (2.0 * h), (high - 2.0 * here + low) / (h * h));
    assert!((found - slope).abs() < 1e-6 * slope.abs().max(1.0), "{found} {slope}");
    assert!((curved - second).abs() < 1e-5 * second.abs().max(1.0), "{curved} {second}");
}

#[test]
fn what_cannot_be_held_leaves_the_rod_as_it_was() {
    let mut chain = straight(ROUND, 8);
    let frames = chain.frames.clone();
    let nowhere = Isometry3::translation(f64::NAN, 0.0, 0.0);
    assert_eq!(chain.hold(&[Isometry3::identity(), nowhere]), None);
    assert_eq!(chain.frames, frames);
}
