//! One hand, two hands, modes, the second button, lost signals; without bodies.

use super::super::mode::{Axis, AxisOf, Freedom};
use super::*;
use nalgebra::{Translation3, UnitQuaternion};

fn hit(target: usize, place: [f32; 3]) -> Option<Hit> {
    Some(Hit { target, point_in_room: place.into(), distance_m: 1.0 })
}

fn stylus(pose: Isometry3<f32>, pressed: bool) -> StylusState {
    StylusState { room_from_stylus: pose, pressed, ..Default::default() }
}

fn rest() -> Matrix4<f64> {
    Matrix4::new_translation(&Vector3::new(0.5, 1.0, -0.25))
        * Matrix4::new_nonuniform_scaling(&Vector3::new(1.0, 2.0, 0.5))
}

fn element(_: usize) -> Option<Element> {
    Some(Element { room_from_body: Similarity3::identity(), room_from_element: rest() })
}

fn pose(t: f32) -> Isometry3<f32> {
    Isometry3::new(Vector3::new(t.sin(), 0.3 * t, 1.0), Vector3::new(0.2, t.cos(), -t))
}

/// A pressed stylus at this height above the element, and its second button.
fn at(z: f32, second: bool) -> StylusState {
    StylusState { second, ..stylus(Isometry3::translation(0.1, 0.2, z), true) }
}

/// Hands over one element that really follows.
struct Bench {
    hands: Hands,
    element: Matrix4<f64>,
    time_s: f64,
}

impl Bench {
    fn new() -> Bench {
        Bench { hands: Hands::new(0.5), element: rest(), time_s: 0.0 }
    }

    fn step(&mut self, styli: &[StylusState]) -> HandRequests {
        self.time_s += 0.1;
        let hits = vec![hit(3, [0.6, 1.1, -0.2]); styli.len()];
        let element = Element { room_from_body: Similarity3::identity(), room_from_element: self.element };
        let styli: Vec<_> = styli.iter().copied().map(Some).collect();
        let asked = self.hands.step(&styli, self.time_s, &hits, |_| Some(element));
        for drag in &asked.drags {
            assert_eq!(drag.target, 3);
            self.element = drag.room_from_element;
        }
        asked
    }
}

#[test]
fn the_element_follows_rigidly_and_keeps_its_scale() {
    let mut bench = Bench::new();
    bench.step(&[stylus(pose(0.0), true)]);
    assert!((bench.element - rest()).norm() < 1e-14);
    bench.step(&[stylus(pose(0.7), true)]);
    let motion = pose(0.7).cast::<f64>() * pose(0.0).cast::<f64>().inverse();
    assert!((bench.element - motion.to_homogeneous() * rest()).norm() < 1e-6);
    let scales = bench.element.fixed_view::<3, 3>(0, 0).into_owned().singular_values();
    assert!((scales - Vector3::new(2.0, 1.0, 0.5)).norm() < 1e-12, "{scales}");
    assert_eq!(bench.hands.held(), BTreeSet::from([3]));
    assert_eq!(bench.step(&[stylus(pose(0.8), false)]), HandRequests::default());
    assert!(bench.hands.held().is_empty());
}

#[test]
fn a_press_beside_everything_grabs_nothing_until_the_next_press() {
    let mut hands = Hands::new(0.5);
    let mut drags =
        |pressed, hit| hands.step(&[Some(stylus(pose(0.0), pressed))], 0.0, &[hit], element).drags.len();
    let there = hit(3, [0.0; 3]);
    let steps = [(true, None), (true, there), (false, there), (true, there)];
    assert_eq!(steps.map(|(pressed, hit)| drags(pressed, hit)), [0, 0, 0, 1]);
}

#[test]
fn nothing_drifts_over_a_million_updates() {
    let mut bench = Bench::new();
    bench.step(&[stylus(pose(0.0), true)]);
    for i in 0..1_000_000 {
        bench.step(&[stylus(pose(i as f32 * 1e-3), true)]);
    }
    bench.step(&[stylus(pose(0.0), true)]);
    assert!((bench.element - rest()).norm() < 1e-14, "{}", bench.element - rest());
}

#[test]
fn unusable_poses_hold_the_last_one_and_are_counted() {
    let bad = Isometry3::from_parts(Translation3::new(f32::NAN, 0.0, 0.0), UnitQuaternion::identity());
    let mut bench = Bench::new();
    assert_eq!(bench.step(&[stylus(bad, true)]).drags, []);
    assert_eq!(bench.step(&[stylus(pose(0.0), true)]).drags.len(), 1, "the press waits for a usable pose");
    let moved = bench.step(&[stylus(pose(0.4), true)]);
    assert_eq!(bench.step(&[stylus(bad, true)]), moved);
    assert_eq!(bench.hands.invalid(0), 2);
    assert_eq!(bench.step(&[stylus(bad, false)]).drags, [], "a release counts at once");
}

#[test]
fn a_lost_stylus_lets_go_softly_and_must_press_anew_and_a_held_one_holds() {
    let mut bench = Bench::new();
    let signal = |signal, pressed| StylusState { signal, ..stylus(pose(0.3), pressed) };
    bench.step(&[stylus(pose(0.0), true)]);
    bench.step(&[stylus(pose(0.3), true)]);
    let there = bench.element;
    assert_eq!(bench.step(&[signal(Signal::Held { age_s: 0.5 }, true)]).drags.len(), 1);
    assert_eq!(bench.step(&[signal(Signal::Lost { age_s: 3.0 }, true)]).drags, []);
    assert_eq!(bench.step(&[stylus(pose(2.0), true)]).drags, [], "back, still pressed");
    assert_eq!(bench.element, there, "the element stays where it was");
    bench.step(&[stylus(pose(2.0), false)]);
    assert_eq!(bench.step(&[signal(Signal::Lost { age_s: 3.0 }, true)]).drags, []);
    bench.step(&[stylus(pose(2.0), false)]);
    assert_eq!(bench.step(&[stylus(pose(2.0), true)]).drags.len(), 1);
}

#[test]
fn no_change_of_mode_or_of_hands_makes_the_element_jump() {
    let mut bench = Bench::new();
    let modes = [
        Mode::FREE,
        Mode { freedom: Freedom::Translate, axis: None },
        Mode { freedom: Freedom::Rotate, axis: None },
        Mode::FREE.along(Axis::Y),
        Mode { freedom: Freedom::Rotate, axis: Some((Axis::X, AxisOf::Element)) },
    ];
    let mut now = [pose(0.0), pose(1.0)];
    bench.step(&[stylus(now[0], true), stylus(now[1], false)]);
    for i in 0..40 {
        let t = i as f32 * 0.05;
        now = [pose(t), pose(1.0 - t)];
        let second = i % 6 > 2;
        bench.step(&[stylus(now[0], true), stylus(now[1], second)]);
        let before = bench.element;
        // The hands rest while mode and number of hands change.
        bench.hands.mode = modes[i % modes.len()];
        bench.step(&[stylus(now[0], true), stylus(now[1], i % 4 == 0)]);
        assert!((bench.element - before).norm() < 1e-12, "{i}: {}", bench.element - before);
    }
    assert!((bench.element - rest()).norm() > 0.1, "it did move in between");
}

#[test]
fn two_hands_on_one_element_scale_it_and_a_third_is_refused() {
    let mut hands = Hands::new(0.5);
    let at = |x: f32| Isometry3::translation(x, 1.0, 0.5);
    let hits = [hit(3, [0.4, 1.0, -0.2]), hit(3, [0.6, 1.0, -0.2]), hit(3, [0.5, 1.0, -0.2])];
    let three = |a, b, c| [a, b, c].map(|x| Some(stylus(at(x), true)));
    hands.step(&three(0.4, 0.6, 0.5), 0.0, &hits, element);
    assert_eq!((hands.grip(1).is_some(), hands.grip(2).is_some()), (true, false));
    let asked = hands.step(&three(0.3, 0.7, 3.0), 0.1, &hits, element);
    let expected = Matrix4::new_translation(&Vector3::new(0.5, 1.0, -0.2))
        * Matrix4::new_scaling(2.0)
        * Matrix4::new_translation(&-Vector3::new(0.5, 1.0, -0.2))
        * rest();
    assert!((asked.drags[0].room_from_element - expected).norm() < 1e-6);
    assert_eq!(asked.drags.len(), 1);
}

#[test]
fn the_second_button_scales_by_the_push_along_the_ray_and_does_not_move() {
    let mut bench = Bench::new();
    bench.step(&[at(1.0, false)]);
    bench.step(&[at(1.0, true)]);
    for _ in 0..5 {
        bench.step(&[at(0.75, true)]);
    }
    // A quarter of a metre along -z, half the radius of 0.5 m.
    let expected = rest() * Matrix4::new_scaling(0.5_f64.exp());
    assert!((bench.element - expected).norm() < 1e-6, "{}", bench.element);
    bench.step(&[at(0.75, false)]);
    assert!((bench.element - expected).norm() < 1e-6, "released, it neither jumps nor scales");
    assert_eq!(bench.hands.mode, Mode::FREE, "that was no click");
    bench.step(&[at(0.65, false)]);
    let moved = Matrix4::new_translation(&Vector3::new(0.0, 0.0, -0.1)) * expected;
    assert!((bench.element - moved).norm() < 1e-6, "and follows again");
}

#[test]
fn a_click_of_the_second_button_goes_to_the_next_mode_and_scales_nothing() {
    let mut bench = Bench::new();
    bench.step(&[at(1.0, false)]);
    bench.step(&[at(1.0, true)]);
    bench.step(&[at(0.99, true)]);
    assert!((bench.element - rest()).norm() > 1e-3);
    bench.step(&[at(0.99, false)]);
    assert_eq!(bench.hands.mode, Mode { freedom: Freedom::Translate, axis: None });
    assert!((bench.element - rest()).norm() < 1e-12, "back at what it was before the press");
    bench.step(&[at(0.89, false)]);
    let moved = Matrix4::new_translation(&Vector3::new(0.0, 0.0, -0.1)) * rest();
    assert!((bench.element - moved).norm() < 1e-6);
}

#[test]
fn with_nothing_in_the_hand_the_second_button_navigates_and_two_presses_are_told() {
    let mut hands = Hands::new(0.5);
    let mut step = |time_s: f64, pressed, second, hit| {
        let state = StylusState { second, ..stylus(pose(0.0), pressed) };
        hands.step(&[Some(state)], time_s, &[hit], element)
    };
    assert_eq!(step(0.0, false, true, None).navigating.len(), 1);
    assert_eq!(step(0.1, false, false, None), HandRequests::default());
    let again = step(0.2, false, true, None);
    assert_eq!((again.double_pressed, again.navigating.len()), (vec![0], 1));
    step(0.3, false, false, None);
    assert_eq!(step(0.4, false, true, None).double_pressed, [0; 0], "a third press is a new first");
    // It grabs while it navigates: the scene stands, and the second button does not scale until pressed anew.
    let grabbed = step(0.5, true, true, hit(3, [0.6, 1.1, -0.2]));
    assert_eq!((grabbed.navigating.len(), grabbed.drags.len()), (0, 1));
    assert_eq!(step(0.6, false, true, None).navigating.len(), 0, "nor does it navigate again");
}
