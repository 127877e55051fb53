//! Pieces in a world: they fall off, land, and are carried; what is left weighs less.

use super::operated::{BOTH, ONE, Operated, parsed, stylus, text};
use crate::effect::file_of;
use crate::interact::Action;
use crate::track::StylusState;
use nalgebra::Vector3;

type V3 = Vector3<f64>;

/// A blade through a block that is held at one end alone, under gravity: the other half comes off and falls by g t²/2, and a world that takes
/// the state meanwhile goes on with the same bits. What is left weighs half as much. Undo joins both.
#[test]
fn what_nothing_holds_falls_off() {
    let scene = parsed(&text(ONE, "gravity = true", "").replace("1.0e5", "1.0e12")).unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    let weight = |operated: &Operated| operated.world.bodies[0].deformer.wrenches().unwrap().0[0].force.y;
    let at = f64::from(0.011_f32);
    let (above, below) = (V3::new(at, 0.08, -0.1), V3::new(at, -0.08, -0.1));
    first.put(above);
    let before = weight(&first);
    let came_off = (0..30).position(|k| {
        first.put(above.lerp(&below, f64::from(k.min(16)) / 16.0));
        !first.pieces().is_empty()
    });
    assert!(came_off.is_some());
    // The piece's middle, between the cut and the end.
    let start = V3::new(0.5 * (at + 0.15), 0.0, 0.0);
    let off = (first.pieces()[0] - start).norm();
    println!("comes off {off:e} m beside its place");
    assert!(off < 1e-7, "{off}");
    let left = weight(&first) / before;
    println!("weight off by {:e}", left - (at + 0.15) / 0.3);
    assert!((left - (at + 0.15) / 0.3).abs() < 8e-10, "{left}");
    let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
    let mut second = Operated::new(&scene, &file);
    second.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
    second.frame = first.frame;
    for k in 1..=30 {
        [&mut first, &mut second].into_iter().for_each(|operated| operated.put(below));
        assert_eq!(first.world.state_hash(), second.world.state_hash(), "frame {k}");
        let t = f64::from(k) / 60.0;
        let expected = start - V3::y() * (0.5 * 9.80665 * t * t);
        let off = (first.pieces()[0] - expected).norm();
        assert!(off < 3e-7, "{off} m after {t} s");
    }
    assert!(first.is_quiet(), "{:?}", first.world.warnings);
    first.act(Action::Undo, below);
    first.wait(below);
    assert!(first.pieces().is_empty() && (weight(&first) / before - 1.0).abs() < 1e-12);
    first.act(Action::Redo, below);
    first.wait(below);
    assert_eq!(first.pieces().len(), 1);
}

/// A piece without gravity stays where it came off; with contact and gravity it lands on the floor.
#[test]
fn what_falls_off_lands_on_the_floor() {
    let floor = "[tool.floor]\nshape = \"floor\"\nposition = [0.0, -0.1, 0.0]\n";
    let contact = "effects = [\"cut\", \"contact\"]\n";
    for (keys, height) in [(contact.to_owned(), 0.0), (format!("{contact}gravity = true\n"), -0.05)] {
        let scene = parsed(&text(ONE, &keys, floor).replace("1.0e5", "1.0e12")).unwrap();
        let mut operated = Operated::new(&scene, &file_of(&scene).unwrap());
        operated.pass(V3::new(0.011, 0.08, -0.1), V3::new(0.011, -0.08, -0.1), 16);
        (0..120).for_each(|_| operated.put(V3::new(0.3, 0.2, -0.1)));
        let pieces = operated.pieces();
        assert_eq!(pieces.len(), 1);
        println!(
            "{keys}: lies at {} m, {:e} and {:e} off",
            pieces[0].y,
            pieces[0].y - height,
            pieces[0].x - 0.0805
        );
        assert!((pieces[0].y - height).abs() < 7e-9 && (pieces[0].x - 0.0805).abs() < 8e-8, "{}", pieces[0]);
    }
}

/// A piece keeps its place beside the body when the scene is scaled, in a world that takes the state meanwhile too.
#[test]
fn a_piece_follows_the_scene() {
    let scene = parsed(&text(ONE, "", "").replace("1.0e5", "1.0e12")).unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    let away = V3::new(0.3, 0.2, -0.1);
    first.pass(V3::new(0.011, 0.08, -0.1), V3::new(0.011, -0.08, -0.1), 16);
    first.put(away);
    let in_body = |operated: &Operated| {
        let room_from_body = operated.world.bodies[0].room_from_body;
        (room_from_body.inverse() * nalgebra::Point3::from(operated.pieces()[0])).coords
    };
    let before = in_body(&first);
    let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
    let mut second = Operated::new(&scene, &file);
    second.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
    second.frame = first.frame;
    for operated in [&mut first, &mut second] {
        operated.act(Action::ScaleScene(0.5), away);
        operated.put(away);
        let (scale, off) =
            (operated.world.bodies[0].room_from_body.scaling(), (in_body(operated) - before).norm());
        println!("scale {scale}: {off:e} m off");
        assert!(scale < 0.6 && off < 7.6e-9, "{scale}: {off}");
    }
}

/// A hand takes the piece that its ray hits, carries it, presses it onto the floor, which stops it, and throws it: it flies on with the hand's
/// speed. A world that takes the state while it is carried goes on with the same bits.
#[test]
fn a_hand_carries_a_piece_and_throws_it() {
    let tools = "[tool.floor]\nshape = \"floor\"\nposition = [0.0, -0.1, 0.0]\n";
    let keys = "effects = [\"cut\", \"contact\"]\ngravity = true\n";
    let scene = parsed(&text(ONE, keys, tools).replace("1.0e5", "1.0e12")).unwrap();
    let file = file_of(&scene).unwrap();
    let mut first = Operated::new(&scene, &file);
    first.pass(V3::new(0.011, 0.08, -0.1), V3::new(0.011, -0.08, -0.1), 16);
    let away = stylus(&V3::new(-0.3, 0.3, -0.1));
    let grasp = V3::new(0.1, -0.04, 0.2);
    let hand = |by: V3, pressed: bool| StylusState { pressed, ..stylus(&(grasp + by)) };
    let frames = |operated: &mut Operated, count: usize, hand: StylusState| {
        (0..count).for_each(|_| operated.step_styli(vec![away, hand], Vec::new()));
    };
    frames(&mut first, 60, hand(V3::zeros(), false));
    let lies = first.pieces()[0];
    let mut second = Operated::new(&scene, &file);
    let mut most = 0.0_f64;
    for k in 0..=30 {
        let by = V3::y() * (0.01 * f64::from(k));
        frames(&mut first, 1, hand(by, true));
        most = most.max((first.pieces()[0] - lies - by).norm());
        if k == 15 {
            let state = serde_json::to_string(&first.world.state().unwrap()).unwrap();
            second.world.set_state(&serde_json::from_str(&state).unwrap()).unwrap();
            second.frame = first.frame;
        } else if k > 15 {
            frames(&mut second, 1, hand(by, true));
            assert_eq!(first.world.state_hash(), second.world.state_hash(), "frame {k}");
        }
    }
    println!("carried, {most:e} m off");
    assert!(most < 1e-7, "{most:e}");
    let (thrown, speed) = (first.pieces()[0], 0.6);
    let mut most = 0.0_f64;
    for k in 1..=12 {
        frames(&mut first, 1, hand(V3::y() * 0.3, false));
        let t = f64::from(k) / 60.0;
        let expected = thrown + V3::y() * (speed * t - 0.5 * 9.80665 * t * t);
        most = most.max((first.pieces()[0] - expected).norm());
    }
    println!("thrown, {most:e} m off");
    assert!(most < 1e-6, "{most:e}");
    frames(&mut first, 90, hand(V3::zeros(), false));
    frames(&mut first, 1, hand(V3::zeros(), true));
    (1..=30).for_each(|k| frames(&mut first, 1, hand(V3::y() * (-0.01 * f64::from(k)), true)));
    let pressed = first.pieces()[0];
    println!("pressed onto the floor: {:e} m off", pressed.y - lies.y);
    assert!((pressed.y - lies.y).abs() < 1e-12, "{pressed}");
}

/// Gravity on a block that is cut in two beside its middle: each end carries the weight of its half, about the half's own centre of mass.
#[test]
fn each_end_carries_the_weight_of_its_half() {
    // So stiff that it does not sag: a blade that comes down passes a plane of the block at rest.
    let scene = parsed(&text(BOTH, "gravity = true", "").replace("1.0e5", "1.0e12")).unwrap();
    let mut operated = Operated::new(&scene, &file_of(&scene).unwrap());
    // A tracker's numbers are f32.
    let at = f64::from(0.011_f32);
    operated.pass(V3::new(at, 0.08, -0.1), V3::new(at, -0.08, -0.1), 16);
    assert!(operated.is_quiet(), "{:?}", operated.world.warnings);
    let (wrenches, _) = operated.world.bodies[0].deformer.wrenches().unwrap();
    // 1000 kg/m³ · 0.1 m · 0.06 m, from -0.15 and from 0.15 to the cut.
    let per_length = 1000.0 * 0.1 * 0.06 * 9.80665;
    for (wrench, (end, length)) in wrenches.iter().zip([(-0.15, at + 0.15), (0.15, 0.15 - at)]) {
        let weight = per_length * length;
        let middle = 0.5 * (end + at);
        let expected = V3::new(0.0, 0.0, (middle - end) * weight);
        println!("{} N of {weight}, {} N m of {}", wrench.force.y, wrench.moment.z, expected.z);
        assert!((wrench.force - V3::new(0.0, weight, 0.0)).norm() < 1e-10 * weight, "{:?}", wrench.force);
        assert!((wrench.moment - expected).norm() < 2e-11 * weight, "{:?}", wrench.moment);
    }
}
