//! Bodies that nothing holds: a bar and a ring that ring, and motions that last.

use super::beam_tests::{Ends, nearest, timoshenko};
use super::coupled::Damping;
use super::settings::NAME;
use super::system::System;
use super::tables::Tables;
use super::tests::{CELLS, LENGTH, REST, Rig, SECTION, bar, bar_of, tables, without_damping};
use crate::deform::ControlPose;
use crate::effect::{Resolved, file_of};
use crate::green::GreenFile;
use nalgebra::{DVector, Matrix3, Rotation3, Vector3};
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

/// The system of a body whose only element is released.
fn flying(tables: &Tables, is_linear: bool) -> System {
    System::new(tables, vec![true], is_linear, without_damping())
}

fn first_mode(rig: &Rig) -> usize {
    rig.deformer.first_of_effects() + rig.deformer.coefficients_of(NAME).start
}

/// The node of the surface that is nearest to a place in the mesh.
fn node_at(rig: &Rig, place: Vector3<f64>) -> u32 {
    let from = |x: &[f32; 3]| (Vector3::from(x.map(f64::from)) + rig.deformer.centre - place).norm();
    let rest = rig.deformer.rest();
    (0..rest.len() as u32)
        .min_by(|a, b| from(&rest[*a as usize]).total_cmp(&from(&rest[*b as usize])))
        .unwrap()
}

/// The modes of the reduced M and K come down to those of the free bar: Craig and Bampton's columns with the element's rigid motions span
/// the bar's, as more modes are taken.
#[test]
fn a_bar_that_flies_has_the_frequencies_of_a_free_one() {
    let expected = timoshenko(Ends::FreeFree, SECTION[1], 4);
    let mut before = vec![f64::INFINITY; 4];
    for modes in [12, 24, 48] {
        let keys = format!("element = \"tet10\"\neffect.dynamics.modes = {modes}");
        let tables = tables(&bar([32, 2, 2], &keys, false).1);
        let off_of = |is_linear: bool| -> Vec<f64> {
            let squares: Vec<f64> =
                flying(&tables, is_linear).coupled.modes.iter().map(|mode| mode.square).collect();
            assert!(squares[..6].iter().all(|square| *square < 1e-6 * squares[6]), "{squares:?}");
            let hertz: Vec<f64> = squares.iter().map(|square| square.sqrt() / TAU).collect();
            expected.iter().map(|f| nearest(&hertz, *f) / f - 1.0).collect()
        };
        let [rigid, linear] = [false, true].map(off_of);
        println!("{modes} modes: off Huang's free beam by {rigid:?}, in linear by {linear:?}");
        assert!(rigid.iter().chain(&linear).all(|off| (0.0..0.01).contains(off)), "{modes} modes");
        assert!(rigid.iter().zip(&before).all(|(off, before)| off <= before), "{modes} modes");
        before = rigid;
    }
}

/// Sets the bar in motion by an impulse at a node, N·s: M ż = Nᵀ J.
fn strike(rig: &mut Rig, node: u32, impulse: Vector3<f64>) {
    let shapes = rig.moving.shapes_at(&rig.deformer, first_mode(rig), node);
    let system = flying(&rig.moving.tables, false);
    let mass = &system.mass * &system.all_from_own;
    let kick = (shapes * &system.all_from_own).tr_mul(&impulse);
    let speed = mass.try_inverse().unwrap() * DVector::from_column_slice(kick.as_slice());
    let spin = Vector3::from_column_slice(&speed.as_slice()[3..6]).cross_matrix();
    let motion = &mut rig.moving.motion;
    motion.speeds[..3].copy_from_slice(&speed.as_slice()[..3]);
    (0..9).for_each(|i| motion.speeds[3 + i] = spin[(i / 3, i % 3)]);
    motion.rates.copy_from_slice(&speed.as_slice()[6..]);
}

/// Size of the part of a signal at a frequency, under Hann's window.
fn part_at(signal: &[f64], dt_s: f64, hertz: f64) -> f64 {
    let turn = |k: usize, hertz: f64| TAU * hertz * dt_s * k as f64;
    let window = |k: usize| 1.0 - (TAU * k as f64 / signal.len() as f64).cos();
    let sum = signal.iter().enumerate().fold([0.0, 0.0], |[re, im], (k, x)| {
        let (sin, cos) = turn(k, hertz).sin_cos();
        [re + x * window(k) * cos, im + x * window(k) * sin]
    });
    sum[0].hypot(sum[1]) / signal.len() as f64
}

/// The frequency within 2 % of `near` that a signal has most of, Hz.
fn peak(signal: &[f64], dt_s: f64, near: f64) -> f64 {
    let (mut low, mut high) = (0.98 * near, 1.02 * near);
    for _ in 0..24 {
        let third = (high - low) / 3.0;
        let [a, b] = [low + third, high - third].map(|hertz| part_at(signal, dt_s, hertz));
        if a < b { low += third } else { high -= third }
    }
    0.5 * (low + high)
}

/// The bar turns and flies, and its tip rings about that with the frequencies of a free bar, not with those of a bar that is clamped at its
/// element, of which its columns are made.
#[test]
fn a_bar_that_is_struck_rings_as_a_free_one() {
    let keys = "element = \"tet10\"\nmodel = \"rotation\"\neffect.dynamics.modes = 30";
    let (_, file) = bar([32, 2, 2], keys, false);
    let mut rig = Rig::of(&file, "rotation", without_damping(), 1);
    let tip = node_at(&rig, Vector3::x() * (0.5 * LENGTH));
    strike(&mut rig, tip, Vector3::y() * 0.02);
    let shapes = rig.moving.shapes_at(&rig.deformer, first_mode(&rig), tip);
    let dt_s = 1.0 / 300.0;
    let mut signal = Vec::new();
    for _ in 0..6000 {
        rig.frame(dt_s, &[None]);
        let amplitudes = DVector::from_column_slice(&rig.moving.motion.places);
        signal.push((shapes.columns(rig.moving.tables.fields(), amplitudes.len()) * amplitudes)[1]);
    }
    let turned = Rotation3::from_matrix(&rig.deformer.poses[0].matrix).angle();
    let expected = timoshenko(Ends::FreeFree, SECTION[1], 4);
    let strongest = part_at(&signal, dt_s, expected[0]);
    for (k, f) in expected.iter().enumerate() {
        let off = peak(&signal, dt_s, *f) / f - 1.0;
        println!("mode {}: {f:.4} Hz, found {off:.1e} beside, turned by {turned:.2} rad", k + 1);
        assert!(off.abs() < 1e-2, "mode {}: {off:e}", k + 1);
    }
    let clamped = part_at(&signal, dt_s, timoshenko(Ends::ClampedFree, SECTION[1], 1)[0]) / strongest;
    println!("at the clamped bar's first frequency {clamped:.1e} of the strongest part");
    assert!(clamped < 1e-5 && turned > 0.2, "{clamped:e}, turned by {turned}");
}

/// Frequency of in-plane bending of a free ring of mean radius `radius` and rectangular section with n waves, Hz:
/// ω² = EI n²(n²-1)²/(ρA R⁴(n²+1)) (W. Soedel, Vibrations of Shells and Plates, 3rd ed., section 5.3; the formula is Hoppe's of 1871).
fn thin_ring(n: f64, radius: f64, height: f64, wave_speed: f64) -> f64 {
    let stiff = wave_speed * height / 12.0_f64.sqrt() / (radius * radius);
    stiff * n * (n * n - 1.0) / (n * n + 1.0).sqrt() / TAU
}

/// Frequency with shear, rotatory inertia, stretch and the shorter inner side: the least root of Ritz's 3 × 3 problem with the radial
/// displacement w cos nθ and the tangential one (v + zφ) sin nθ at r = R + z, whose strains at ν = 0 are ε = (n (v + zφ) + w)/r and
/// γ = φ - (n w + v + zφ)/r, with the shear coefficient 10/12.
fn thick_ring(n: f64, radius: f64, height: f64, wave_speed: f64) -> f64 {
    let (mut stiffness, mut mass) = (Matrix3::zeros(), Matrix3::zeros());
    // Gauss's three points.
    for (place, weight) in [(-0.6_f64.sqrt(), 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.6_f64.sqrt(), 5.0 / 18.0)] {
        let z = 0.5 * height * place;
        let r = radius + z;
        let strain = Vector3::new(1.0, n, n * z) / r;
        let shear = Vector3::new(-n / r, -1.0 / r, 1.0 - z / r);
        let along = Vector3::new(0.0, 1.0, z);
        let by_shear = shear * shear.transpose() * (0.5 * 10.0 / 12.0);
        stiffness += (strain * strain.transpose() + by_shear) * (r * weight);
        mass += (Vector3::x() * Vector3::x().transpose() + along * along.transpose()) * (r * weight);
    }
    let unit = mass.cholesky().unwrap().l().try_inverse().unwrap();
    let least = (unit * stiffness * unit.transpose()).symmetric_eigenvalues().min();
    wave_speed * least.sqrt() / TAU
}

#[test]
fn a_thin_ring_has_the_frequencies_of_the_formula() {
    for n in [2.0, 3.0, 4.0] {
        let off = thick_ring(n, 0.1, 1e-3, 50.0) / thin_ring(n, 0.1, 1e-3, 50.0) - 1.0;
        println!("{n} waves: {off:.1e} beside");
        assert!(off.abs() < 5e-4, "{n}: {off:e}");
    }
}

/// A ring of rectangular section whose only element is its section at θ = 0.
fn ring(radius: f64, height: f64, around: usize, modes: usize) -> Arc<GreenFile> {
    let [inner, outer] = [radius - 0.5 * height, radius + 0.5 * height];
    let text = format!(
        "[body.bar]\n\
         generate = {{ tube = {{ inner_radius = {inner:?}, outer_radius = {outer:?}, length = 0.02, radial = 1, \
         around = {around}, along = 1, control_length = 0.0 }} }}\n\
         element = \"tet10\"\nmodel = \"rotation\"\n\
         material = {{ young = 2.5e6, poisson = 0.0, density = 1000.0 }}\n\
         effects = [\"dynamics\"]\neffect.dynamics.modes = {modes}\n\
         control.root = {{ nodes = {{ box = {{ min = [-1.0, 0.0, -1e-6], max = [1.0, 1.0, 1e-6] }} }}, grab = \"fixed\" }}\n"
    );
    file_of(&Resolved::parse(&text, Path::new("ring.toml")).unwrap()).unwrap()
}

/// Frequencies of the modes that stay in the plane of a ring that flies, Hz.
fn in_plane(file: &Arc<GreenFile>) -> Vec<f64> {
    let rig = Rig::of(file, "rotation", without_damping(), 1);
    let system = flying(&rig.moving.tables, false);
    let modes = rig.moving.vibration_modes(&system, &rig.deformer, first_mode(&rig));
    let along = |shape: &[Vector3<f32>]| {
        let sum = |of: &dyn Fn(&Vector3<f32>) -> f32| shape.iter().map(of).sum::<f32>();
        sum(&|u| u.x * u.x) / sum(&|u| u.norm_squared())
    };
    let largest = modes.squares.iter().copied().fold(0.0, f64::max);
    let found = modes.squares.iter().zip(&modes.shapes);
    let found = found.filter(|(square, shape)| **square > 1e-8 * largest && along(shape) < 1e-3);
    found.map(|(square, _)| square.sqrt() / TAU).collect()
}

/// The modes come in pairs, with two, three and four waves around. That the wall is one curved element thick makes a coarse ring too stiff, by
/// an error of nearly the fourth order.
#[test]
fn a_ring_that_flies_has_the_frequencies_of_a_free_ring() {
    let (radius, height, wave_speed) = (0.1, 0.004, 50.0);
    let [coarse, fine] = [48, 96].map(|around| in_plane(&ring(radius, height, around, 30)));
    for (k, n) in [2.0, 3.0, 4.0].into_iter().enumerate() {
        let [thin, thick] = [thin_ring, thick_ring].map(|hertz| hertz(n, radius, height, wave_speed));
        let off = |found: &[f64]| [found[2 * k], found[2 * k + 1]].map(|hertz| hertz / thick - 1.0);
        let [coarse, fine] = [off(&coarse), off(&fine)];
        println!(
            "{n} waves: thin ring {thin:.4} Hz, thick {thick:.4} Hz; coarse {coarse:?}, fine {fine:?} beside"
        );
        assert!(fine.iter().all(|off| off.abs() < 1e-2), "{n} waves: {fine:?}");
        assert!(fine.iter().zip(coarse).all(|(fine, coarse)| fine.abs() < coarse / 6.0), "{n} waves");
    }
}

/// A hundred thousand frames of a tip that rings beside a held root, undamped.
#[test]
fn many_frames_keep_the_energy_of_a_plucked_tip() {
    let (_, file) = bar(CELLS, "effect.dynamics.modes = 2", true);
    let mut rig = Rig::new(&file, "linear", without_damping());
    let bent = |y: f64| Some(ControlPose { translation: Vector3::y() * y, ..ControlPose::REST });
    (1..=20).for_each(|k| rig.frame(1.0, &[REST, bent(1e-3 * f64::from(k))]));
    rig.frame(1.0 / 60.0, &[REST, None]);
    let before: f64 = rig.energy().iter().sum();
    let mut drift = 0.0_f64;
    for frame in 0..100_000 {
        rig.frame(1.0 / 60.0, &[REST, None]);
        if frame % 1000 == 999 {
            drift = drift.max((rig.energy().iter().sum::<f64>() / before - 1.0).abs());
        }
    }
    println!("10⁵ frames: energy {drift:.1e} beside");
    assert!(drift < 2e-9, "{drift:e}");
}

/// A hundred thousand frames of a rigid body that tumbles about its middle axis without torque: momentum, angular momentum and energy.
#[test]
fn many_frames_keep_the_momenta_of_a_top() {
    let (_, file) = bar_of(2.0e9, CELLS, "model = \"rotation\"\neffect.dynamics.modes = 0", false);
    let mut rig = Rig::of(&file, "rotation", Damping::Ratio(0.01), 1);
    let dt_s = 1.0 / 60.0;
    let thrown = |t: f64| ControlPose {
        translation: Vector3::new(0.03, 0.01, -0.02) * t,
        matrix: *Rotation3::from_scaled_axis(Vector3::new(0.05, 0.1, 2.0) * t).matrix(),
    };
    (1..=30).for_each(|k| rig.frame(dt_s, &[Some(thrown(f64::from(k) * dt_s))]));
    rig.frame(dt_s, &[None]);
    let energy = |rig: &Rig| {
        let turn = rig.deformer.state.body_from_surface().rotation;
        let ([push, spin], twist) = (rig.momenta(), rig.moving.twist(&turn).unwrap());
        0.5 * (push.dot(&twist.velocity) + spin.dot(&twist.spin))
    };
    let (before, energy_before) = (rig.momenta(), energy(&rig));
    let mut most = [0.0_f64; 3];
    for frame in 0..100_000 {
        rig.frame(dt_s, &[None]);
        if frame % 1000 == 999 {
            let now = rig.momenta();
            for k in 0..2 {
                most[k] = most[k].max((now[k] - before[k]).norm() / before[k].norm());
            }
            most[2] = most[2].max((energy(&rig) / energy_before - 1.0).abs());
        }
    }
    println!("10⁵ frames: momentum, angular momentum and energy {most:?} beside");
    assert!(most.iter().all(|off| *off < 5e-10), "{most:?}");
}
