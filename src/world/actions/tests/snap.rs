//! The way back to rest: where it ends, at any frame rate, by any key, after everything else.

use super::*;
use crate::render::window::Key;
use crate::session::keys;

#[test]
fn snapping_back_ends_exactly_at_rest_at_any_frame_rate() {
    let mut halfway = Vec::new();
    for rate in [7.0, 30.0, 144.0] {
        let mut world = world("");
        carry_right(&mut world, 1.0, [0.1, 0.2, 0.0], [4.0, 0.0, 0.0]);
        world.carry_out(Action::SnapBack);
        let mut time_s = 1.0;
        while time_s + 1.0 / rate < 1.2 {
            time_s += 1.0 / rate;
            step(&mut world, time_s, &[]);
        }
        step(&mut world, 1.2, &[]);
        let half = poses(&world)[RIGHT];
        // Half of 4 rad, the way it was turned.
        let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * 2.0).to_rotation_matrix();
        assert!((half.matrix - turn.matrix()).norm() < 1e-5, "{}", half.matrix);
        halfway.push(half);
        step(&mut world, 1.5, &[]);
        assert_eq!(poses(&world), [ControlPose::REST; 2]);
        let body = &world.bodies[0].deformer;
        let away = (0..body.node_count()).map(|i| body.displacement(i).norm()).fold(0.0, f64::max);
        assert!(away < 1e-6, "{away} m off at {rate} frames/s");
        world.carry_out(Action::Undo);
        step(&mut world, 1.6, &[]);
        assert!(poses(&world)[RIGHT].translation.norm() > 0.1, "it is an entry of the history");
    }
    assert!(halfway.iter().all(|pose| (pose.matrix - halfway[0].matrix).norm() < 1e-12));
}

#[test]
fn a_new_grab_ends_the_way_back() {
    let mut world = world("");
    carry_right(&mut world, 1.0, [0.0, 0.1, 0.0], [0.0; 3]);
    world.carry_out(Action::SnapBack);
    let start = right([0.0; 3], [0.0; 3]);
    step(&mut world, 1.2, &[start]);
    step(&mut world, 1.2, &[pressed(start)]);
    let taken = poses(&world)[RIGHT];
    assert!(taken.translation.y > 0.02 && taken.translation.y < 0.09);
    step(&mut world, 2.0, &[pressed(start)]);
    assert!((poses(&world)[RIGHT].translation - taken.translation).norm() < 1e-9, "it stays in the hand");
}

/// Once Backspace after Ctrl+Z and Ctrl+Y did nothing: Ctrl was still down.
#[test]
fn snapping_back_acts_after_undo_and_redo_with_ctrl_still_down_and_on_its_own_way() {
    let mut world = world("");
    let press = |world: &mut World, time_s: f64, key: Key, control: bool| {
        let action = keys::action(key, control, world);
        action.into_iter().for_each(|action| world.carry_out(action));
        step(world, time_s, &[]);
        action
    };
    carry_right(&mut world, 1.0, [0.1, 0.2, 0.0], [0.0; 3]);
    let bent = poses(&world)[RIGHT];
    for control in [false, true] {
        let start_s = 2.0 + 4.0 * f64::from(control);
        press(&mut world, start_s, Key::Char('z'), true);
        assert_eq!(poses(&world)[RIGHT], ControlPose::REST);
        let at_rest = world.undo_depth();
        assert_eq!(press(&mut world, start_s + 0.1, Key::Backspace, control), Some(Action::SnapBack));
        assert_eq!(world.undo_depth(), at_rest, "there is nothing to do, and the redo stays");
        press(&mut world, start_s + 0.2, Key::Char('y'), true);
        assert_eq!(poses(&world)[RIGHT], bent);
        assert_eq!(press(&mut world, start_s + 0.2, Key::Backspace, control), Some(Action::SnapBack));
        let depth = world.undo_depth();
        step(&mut world, start_s + 0.4, &[]);
        let half = poses(&world)[RIGHT].translation;
        assert!((half - bent.translation * 0.5).norm() < 1e-9, "{half} of {}", bent.translation);
        // Pressed again on the way: anew from there.
        press(&mut world, start_s + 0.4, Key::Backspace, control);
        assert_eq!(world.undo_depth(), [depth[0] + 1, 0]);
        step(&mut world, start_s + 0.9, &[]);
        assert_eq!(poses(&world)[RIGHT], ControlPose::REST);
        press(&mut world, start_s + 1.0, Key::Char('z'), true);
        assert_eq!(poses(&world)[RIGHT].translation, half);
        press(&mut world, start_s + 1.1, Key::Char('z'), true);
        assert_eq!(poses(&world)[RIGHT], bent);
    }
}
