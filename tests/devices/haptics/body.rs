//! The force is that of the body: the one that `deform` writes, the slope of its energy, and none left after a circle.

use super::{bent, deformer, elastic, hold, stylus};
use greenstage::deform::{ControlPose, Wrench};
use greenstage::effect::haptics::Elastic;
use greenstage::effect::haptics::grasp::{device_from_handle, room_from_handle};
use greenstage::stage::Haptic;
use nalgebra::{Isometry3, Rotation3, Translation3, Vector3};

const ANGLES: [f64; 5] = [0.0, 0.05, 0.4, 1.0, 1.6];

#[test]
fn the_force_is_that_of_deform() {
    for model in ["linear", "rotation"] {
        let (mut body, mut loops) = (deformer(model), elastic(model));
        let mut worst: f64 = 0.0;
        for angle in ANGLES {
            let poses = bent(angle);
            body.evaluate(&poses);
            let (wrenches, energy) = body.wrenches().unwrap();
            for held in [0, 1] {
                loops.set(held, &poses);
                let response = loops.respond(&poses[held]);
                assert!(response.is_defined);
                let (expected, found) = (wrenches[held], Wrench::from_slope(&response.slope, &poses[held]));
                let error = (expected.force - found.force).norm() / expected.force.norm();
                let moment = (expected.moment - found.moment).norm() / expected.moment.norm();
                let energy = (response.energy - energy).abs() / energy;
                worst = worst.max(error).max(moment).max(energy);
            }
        }
        println!("{model}: largest relative difference from deform {worst:.1e}");
        assert!(worst < 1e-6, "{model}: {worst}");
    }
}

/// The push in the hand against central differences of the energy that `deform` writes, through body, room and device.
#[test]
fn the_push_is_minus_the_slope_of_the_energy() {
    let haptic = Haptic {
        force: 1.7,
        motion: 2.5,
        room_from_device: Isometry3::new(Vector3::new(0.1, 0.9, 0.2), Vector3::new(-0.3, 0.5, 0.2)),
        ..Haptic::simulated("right")
    };
    for model in ["linear", "rotation"] {
        for angle in ANGLES {
            let mut body = deformer(model);
            let poses = bent(angle);
            body.evaluate(&poses);
            let held = hold(&body, 1, &poses, &stylus());
            let mut loops = elastic(model);
            loops.set(1, &poses);
            let origin = body.controls[1].origin;
            let push_at = |handle: &Isometry3<f64>, loops: &mut Elastic| {
                let room = room_from_handle(&haptic, handle);
                let reach = held.reach(&room, &origin).unwrap();
                (held.push(&haptic, &reach, &loops.respond(&reach.pose)).unwrap(), reach.pose)
            };
            let handle = device_from_handle(&haptic, &stylus());
            let (push, pose) = push_at(&handle, &mut loops);
            assert!((pose.matrix - poses[1].matrix).norm() < 1e-12, "the hold begins where the element is");
            let mut energy_at = |motion: &Isometry3<f64>| {
                let moved = Isometry3::from_parts(
                    Translation3::from(handle.translation.vector + motion.translation.vector),
                    motion.rotation * handle.rotation,
                );
                let (_, pose) = push_at(&moved, &mut loops);
                body.evaluate(&[poses[0], pose]);
                body.wrenches().unwrap().1 * held.energy_scale(&haptic)
            };
            let h = 1e-5;
            let mut slope = |v: Vector3<f64>, w: Vector3<f64>| {
                (energy_at(&Isometry3::new(v * h, w * h)) - energy_at(&Isometry3::new(-v * h, -w * h)))
                    / (2.0 * h)
            };
            let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
            let force = Vector3::from(axes.map(|axis| -slope(axis, Vector3::zeros())));
            let torque = Vector3::from(axes.map(|axis| -slope(Vector3::zeros(), axis)));
            let off = (push.force - force).norm() / push.force.norm();
            let off_torque = (push.torque - torque).norm() / push.torque.norm();
            let (force, torque) = (force.norm(), torque.norm());
            println!("{model} {angle}: {force:.1} N, {torque:.2} N m, off by {off:.1e} and {off_torque:.1e}");
            assert!(off < 1e-5 && off_torque < 1e-5, "{model} {angle}: {off} {off_torque}");
        }
    }
}

/// A slow circle of the hand in all six degrees of freedom gives its work back.
#[test]
fn a_circle_of_the_hand_gives_no_energy() {
    let round = |model: &str, steps: u32| {
        let mut loops = elastic(model);
        loops.set(1, &bent(0.8));
        let (mut work, mut spent) = (0.0, 0.0);
        let pose = |i: u32| {
            let phase = f64::from(i) * std::f64::consts::TAU / f64::from(steps);
            let turn = Vector3::new(0.6 * phase.sin(), 0.5 * phase.cos(), 0.8);
            ControlPose {
                translation: Vector3::new(-0.1, 0.15 * phase.cos(), 0.1 * (2.0 * phase).sin()),
                matrix: *Rotation3::new(turn).matrix(),
            }
        };
        let mut last = (pose(0), loops.respond(&pose(0)).slope);
        for i in 1..=steps {
            let now = (pose(i), loops.respond(&pose(i)).slope);
            let (dt, dm) = (now.0.translation - last.0.translation, now.0.matrix - last.0.matrix);
            let step = 0.5
                * ((now.1.translation + last.1.translation).dot(&dt)
                    + (now.1.matrix + last.1.matrix).dot(&dm));
            work += step;
            spent += step.abs();
            last = now;
        }
        work / spent
    };
    for model in ["linear", "rotation"] {
        let (coarse, fine) = (round(model, 500), round(model, 1000));
        println!("{model}: of the work spent a circle keeps {fine:.1e}");
        assert!(fine.abs() < 1e-4, "{model}: {fine}");
        // The trapezoidal rule's error, not the force's: it falls with the square of the step.
        assert!(fine.abs() < 0.3 * coarse.abs() || fine.abs() < 1e-9, "{model}: {coarse} to {fine}");
    }
}
