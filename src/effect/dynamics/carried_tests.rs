//! Bars that a hand draws along by one end, the other being free.

use super::coupled::Damping;
use super::tests::{CELLS, DENSITY, LENGTH, Rig, SECTION, bar_of};
use crate::deform::{AppliedLoads, ControlPose};
use nalgebra::{Rotation3, Vector3};

const DT_S: f64 = 1.0 / 60.0;
/// m/s
const SPEED: f64 = 0.2;

/// The force along the way on the hand that draws the bar evenly from rest on, N, frame by frame.
fn felt(young: f64, model: &str, along: Vector3<f64>, (ratio, frames): (f64, u32)) -> Vec<f64> {
    let (_, file) = bar_of(young, CELLS, &format!("model = \"{model}\""), true);
    let mut rig = Rig::of(&file, model, Damping::Ratio(ratio), 2);
    let drawn =
        |k: u32| ControlPose { translation: along * (SPEED * DT_S * f64::from(k)), ..ControlPose::REST };
    (1..=frames)
        .map(|k| {
            rig.frame(DT_S, &[Some(drawn(k)), None]);
            rig.deformer.slopes().unwrap()[0].translation.dot(&along)
        })
        .collect()
}

/// The impulse of the hand is the momentum of the bar in `linear`, however stiff it is: the elastic force was that at the end of a frame, and
/// missed what swings within one.
#[test]
fn the_impulse_of_a_hand_is_the_momentum_of_what_it_draws() {
    let momentum = LENGTH * SECTION[0] * SECTION[1] * DENSITY * SPEED;
    for young in [2.0e5, 2.0e6, 2.0e7, 2.0e9] {
        for along in [Vector3::x(), Vector3::y()] {
            let impulse = felt(young, "linear", along, (0.2, 1200)).iter().sum::<f64>() * DT_S;
            println!("{young:e} Pa: impulse {:.2e} off", impulse / momentum - 1.0);
            assert!((impulse / momentum - 1.0).abs() < 7.5e-5, "{young:e} Pa: {impulse} of {momentum} N·s");
        }
    }
}

/// A bar that is drawn evenly takes no force once it swings no more: the work of the hand was summed from forces that swing within a leg.
#[test]
fn an_even_motion_takes_no_force() {
    for model in ["rod", "reduced"] {
        for young in [2.0e7, 1.0e9] {
            let all = felt(young, model, Vector3::x(), (0.02, 240));
            let steady = all[120..].iter().fold(0.0, |most: f64, force| most.max(force.abs()));
            let first = all.iter().fold(0.0, |most: f64, force| most.max(force.abs()));
            println!("{model}, {young:e} Pa: {first} N at first, {steady:e} N in the end");
            assert!(steady < 1e-3 * first, "{model}, {young:e} Pa: {steady} of {first} N");
        }
    }
}

/// A soft bar that is held aslant, sags, and is let go: its weight turns it no more than its sag springs back.
#[test]
fn the_weight_of_a_soft_body_does_not_turn_it_in_flight() {
    let keys = |model: &str| format!("model = \"{model}\"\ngravity = [-6.0, -6.0, 0.0]");
    for model in ["rotation", "reduced"] {
        let (_, file) = bar_of(2.0e6, CELLS, &keys(model), false);
        let mut rig = Rig::of(&file, model, Damping::Ratio(0.5), 1);
        let weight = AppliedLoads { coefficients: vec![-6.0, -6.0, 0.0], points: Vec::new() };
        assert!(rig.deformer.apply(&weight));
        (0..10).for_each(|_| rig.frame(DT_S, &[Some(ControlPose::REST)]));
        let turn = |rig: &Rig| Rotation3::from_matrix(&rig.deformer.poses[0].matrix).angle();
        let mut turned = Vec::new();
        for _ in 0..60 {
            rig.frame(DT_S, &[None]);
            turned.push(turn(&rig));
        }
        println!("{model}: turned by {} rad after half a second, {} rad after one", turned[29], turned[59]);
        assert!((turned[59] - turned[29]).abs() < 1.4e-5, "{model}: {} {}", turned[29], turned[59]);
    }
}
