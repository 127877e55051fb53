//! The bindings, one by one.

use super::*;

fn mouse() -> Mouse {
    Mouse::new(Stage::find("desktop").unwrap())
}

fn stylus(mouse: &Mouse) -> Isometry3<f64> {
    mouse.state(0.0).styli[0].room_from_stylus.cast()
}

fn cursor(x: f64, y: f64) -> MouseInput<'static> {
    MouseInput::Cursor { screen: 0, ndc: [x, y] }
}

const PRESS: MouseInput = MouseInput::Button { button: Button::Left, pressed: true };
const RELEASE: MouseInput = MouseInput::Button { button: Button::Left, pressed: false };
const PRESS_RIGHT: MouseInput = MouseInput::Button { button: Button::Right, pressed: true };

/// A mouse that has grabbed what it points at, the stylus then, and the place of what it holds.
fn grabbing(distance_m: f64) -> (Mouse, Isometry3<f64>, Point3<f64>) {
    let mut mouse = mouse();
    mouse.hit_distance_m = Some(distance_m);
    mouse.handle(PRESS);
    let before = stylus(&mouse);
    (mouse, before, before * Point3::new(0.0, 0.0, -distance_m))
}

/// The place to which a stylus that moved from `before` to now carries the thing that was grabbed at `point`.
fn carried(mouse: &Mouse, before: &Isometry3<f64>, point: &Point3<f64>) -> Point3<f64> {
    stylus(mouse) * (before.inverse() * point)
}

#[test]
fn the_ray_runs_from_between_the_eyes_through_the_cursor() {
    let mut mouse = mouse();
    mouse.handle(cursor(0.5, -0.5));
    let pose = stylus(&mouse);
    let through = Point3::new(0.0864, -0.054, 0.0);
    let eye = Point3::new(0.0, 0.06, 0.60);
    assert!((pose * Point3::origin() - eye).norm() < 1e-6);
    assert!((pose * -Vector3::z() - (through - eye).normalize()).norm() < 1e-6);
    assert!(!mouse.state(0.0).styli[0].pressed);
}

#[test]
fn the_ray_starts_at_the_eye_where_a_tracker_has_the_head() {
    let mut mouse = mouse();
    mouse.tracked_head = Some(Isometry3::translation(0.2, 0.1, 0.5));
    mouse.handle(cursor(0.5, -0.5));
    let (pose, eye) = (stylus(&mouse), Point3::new(0.2, 0.1, 0.5));
    assert!((pose * Point3::origin() - eye).norm() < 1e-6, "{pose}");
    let through = Point3::new(0.0864, -0.054, 0.0);
    assert!((pose * -Vector3::z() - (through - eye).normalize()).norm() < 1e-6, "{pose}");
    mouse.tracked_head = None;
    assert!((stylus(&mouse) * Point3::origin() - Point3::new(0.0, 0.06, 0.60)).norm() < 1e-6);
}

#[test]
fn what_is_grabbed_stays_under_the_cursor_and_parallel_to_the_screen() {
    let (mut mouse, before, point) = grabbing(0.7);
    for x in 0..=10 {
        mouse.handle(cursor(0.06 * f64::from(x), 0.02 * f64::from(x)));
    }
    let now = carried(&mouse, &before, &point);
    assert!((now.z - point.z).abs() < 1e-6, "{now}");
    let stage = Stage::find("desktop").unwrap();
    let view = stage.screens[0].view(&Point3::new(0.0, 0.06, 0.60), 0.05).unwrap();
    let clip = view.clip_from_room * now.cast::<f32>().to_homogeneous();
    assert!((clip.x / clip.w - 0.6).abs() < 1e-5 && (clip.y / clip.w - 0.2).abs() < 1e-5);
    assert!(mouse.state(0.0).styli[0].pressed);
    mouse.handle(RELEASE);
    assert!(!mouse.state(0.0).styli[0].pressed);
}

#[test]
fn the_wheel_carries_along_the_line_of_sight() {
    let (mut mouse, before, point) = grabbing(0.5);
    mouse.handle(MouseInput::Wheel { notches: 2.0 });
    let now = carried(&mouse, &before, &point);
    let eye = Point3::new(0.0, 0.06, 0.60);
    assert!(((now - eye).norm() - 0.5 * 1.05 * 1.05).abs() < 1e-6);
    assert!((now - eye).angle(&(point - eye)) < 1e-4);
}

#[test]
fn turning_leaves_the_grab_point_where_it_is() {
    for hold in [PRESS_RIGHT, MouseInput::Key { name: "Control", pressed: true }] {
        let (mut mouse, before, point) = grabbing(0.5);
        mouse.handle(hold);
        mouse.handle(cursor(0.5, 0.0));
        assert!((carried(&mouse, &before, &point) - point).norm() < 1e-6);
        let turn = stylus(&mouse).rotation * before.rotation.inverse();
        assert!((turn.scaled_axis() - Vector3::new(0.0, TURN_PER_SCREEN / 4.0, 0.0)).norm() < 1e-5);
        mouse.handle(cursor(0.0, 0.0));
        mouse.handle(MouseInput::Wheel { notches: 3.0 });
        let turn = stylus(&mouse).rotation * before.rotation.inverse();
        assert!((turn.scaled_axis() - Vector3::new(0.0, 0.0, 3.0 * TWIST_PER_NOTCH)).norm() < 1e-5);
        assert!((carried(&mouse, &before, &point) - point).norm() < 1e-6);
    }
}

#[test]
fn the_middle_button_holds_the_scene_with_the_second_button_and_shift_scales_what_is_held() {
    let middle = |pressed| MouseInput::Button { button: Button::Middle, pressed };
    let shift = |pressed| MouseInput::Key { name: "Shift", pressed };
    let buttons = |mouse: &Mouse| {
        let stylus = mouse.state(0.0).styli[0];
        (stylus.pressed, stylus.second)
    };
    let mut mouse = mouse();
    mouse.handle(middle(true));
    assert_eq!(buttons(&mouse), (false, true));
    let before = stylus(&mouse);
    let centre = mouse.stage.workspace.centre;
    mouse.handle(cursor(0.5, 0.0));
    assert!((carried(&mouse, &before, &centre) - centre).norm() < 1e-6, "turned about the middle");
    let turn = (stylus(&mouse).rotation * before.rotation.inverse()).scaled_axis();
    assert!((turn - Vector3::new(0.0, TURN_PER_SCREEN / 4.0, 0.0)).norm() < 1e-5);
    mouse.handle(shift(true));
    let turned = stylus(&mouse).rotation;
    mouse.handle(cursor(0.6, 0.0));
    assert_eq!(stylus(&mouse).rotation, turned, "Shift carries it");
    assert!((carried(&mouse, &before, &centre) - centre).x > 1e-3);
    mouse.handle(RELEASE);
    assert_eq!(buttons(&mouse), (false, true), "the left button is not the one that holds it");
    mouse.handle(middle(false));
    assert_eq!(buttons(&mouse), (false, false));
    mouse.handle(PRESS);
    assert_eq!(buttons(&mouse), (true, true), "Shift is still down");
    mouse.handle(shift(false));
    assert_eq!(buttons(&mouse), (true, false));
}

#[test]
fn keys_move_the_head_and_r_puts_it_back() {
    let place = |mouse: &Mouse| mouse.state(0.0).head.unwrap().translation.vector.cast::<f64>();
    for (name, direction) in [
        ("w", -Vector3::z()),
        ("S", Vector3::z()),
        ("ArrowLeft", -Vector3::x()),
        ("d", Vector3::x()),
        ("q", -Vector3::y()),
        ("E", Vector3::y()),
    ] {
        let mut mouse = mouse();
        let start = place(&mouse);
        mouse.handle(MouseInput::Key { name, pressed: true });
        mouse.advance(0.1);
        let moved = place(&mouse) - start;
        assert!((moved - direction * (HEAD_SPEED * 0.10 * 0.1)).norm() < 1e-6, "{name}: {moved}");
        mouse.handle(MouseInput::Key { name, pressed: false });
        mouse.advance(0.1);
        assert!((place(&mouse) - start - moved).norm() < 1e-6);
        mouse.handle(MouseInput::Key { name: "r", pressed: true });
        assert!((place(&mouse) - start).norm() < 1e-6);
    }
}

#[test]
fn losing_the_focus_lets_everything_go() {
    let mut mouse = mouse();
    for input in [PRESS, PRESS_RIGHT, MouseInput::Key { name: "w", pressed: true }, MouseInput::FocusLost] {
        mouse.handle(input);
    }
    let before = mouse.state(0.0);
    mouse.advance(0.1);
    assert_eq!(mouse.state(0.0), before);
    assert!(!before.styli[0].pressed);
}

#[test]
fn no_event_makes_a_pose_unusable() {
    let values = [f64::NAN, f64::INFINITY, -1e300, 1e300, 3.0, -0.5];
    let mut mouse = Mouse::new(Stage::find("cyberstage").unwrap());
    for round in 0..200 {
        let value = values[round % values.len()];
        mouse.hit_distance_m = Some(values[(round / 3) % values.len()].min(1e3));
        mouse.handle(if round % 7 == 0 { RELEASE } else { PRESS });
        mouse.handle(MouseInput::Cursor {
            screen: round % 6,
            ndc: [value, values[(round / 5) % values.len()]],
        });
        mouse.handle(MouseInput::Button { button: Button::Right, pressed: round % 2 == 0 });
        mouse.handle(MouseInput::Wheel { notches: value });
        mouse.handle(MouseInput::Key { name: "d", pressed: true });
        mouse.advance(value);
        let state = mouse.state(0.0);
        let head = state.head.unwrap();
        assert!(
            super::super::state::usable(&head).is_some()
                && super::super::state::usable(&state.styli[0].room_from_stylus).is_some()
        );
    }
}
