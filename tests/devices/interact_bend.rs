//! The scripted bend on every stage: stylus → ray → hit → hands → pose of the control element, against the
//! analytic arc; and what becomes of damaged scripts.

use crate::common::damaged;
use greenstage::interact::{
    Element, Hands, PickRay, PickShape, PickTarget, control_pose_in_body, pick, room_from_element,
};
use greenstage::stage::{BUILT_IN, Screen, Stage};
use greenstage::track::Script;
use nalgebra::{Matrix3, Point3, Vector3};
use proptest::prelude::*;
use std::path::Path;

const BEND: &str = greenstage::track::script::BUILT_IN[0].1;

/// The right control element of a tube of length 1.9 and radius 0.1 about the x axis: x from 0.85 to 0.95.
fn tube_end() -> (Vec<Vector3<f32>>, PickShape) {
    let around = 24;
    let mut positions = Vec::new();
    for x in [0.85, 0.95] {
        positions.extend((0..around).map(|i| {
            let angle = i as f32 / around as f32 * std::f32::consts::TAU;
            Vector3::new(x, 0.1 * angle.cos(), 0.1 * angle.sin())
        }));
    }
    let ring = |i: u32| {
        [[i, (i + 1) % around, i + around], [(i + 1) % around, (i + 1) % around + around, i + around]]
    };
    let triangles = (0..around).flat_map(ring).collect();
    (positions, PickShape { triangles, points: vec![] })
}

#[test]
fn the_script_bends_a_tube_along_its_arc_on_every_stage() {
    let script = Script::find("bend").unwrap();
    assert_eq!(script.duration_s, 4.0);
    let (positions, shape) = tube_end();
    let origin = Point3::new(0.9, 0.0, 0.0);
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        assert_eq!(script.stylus_names(&stage).collect::<Vec<_>>(), ["hand"]);
        let body = (Point3::new(-0.95, -0.1, -0.1), Point3::new(0.95, 0.1, 0.1));
        let room_from_body = stage.workspace.room_from_body(body.0, body.1).unwrap();
        let rest = room_from_element(&room_from_body, &origin, &Vector3::zeros(), &Matrix3::identity());
        let mut hands = Hands::new(stage.workspace.radius_m);
        let mut room_from_end = rest;
        let mut last = None;
        let mut largest_deviation: f64 = 0.0;
        let mut frames_held = 0;
        for frame in 0..=240 {
            let state = script.sample(&stage, f64::from(frame) / 60.0);
            let stylus = &state.styli[0];
            let target =
                PickTarget { shape: &shape, positions: &positions, ball_radius_m: 0.01, room_from_body };
            let hit = PickRay::from_stylus(stylus).and_then(|ray| pick(&ray, &[target]));
            let element = |_| Some(Element { room_from_body, room_from_element: room_from_end });
            let asked = hands.step(&[Some(*stylus)], state.time_s, &[hit], element);
            let Some(drag) = asked.drags.first() else {
                continue;
            };
            room_from_end = drag.room_from_element;
            frames_held += 1;
            let (translation, matrix) =
                control_pose_in_body(&drag.room_from_element, &room_from_body, &origin).unwrap();
            let angle = matrix[(1, 0)].atan2(matrix[(0, 0)]);
            let (x, y) = match angle.abs() < 1e-9 {
                true => (1.8, 0.0),
                false => (1.8 * angle.sin() / angle, 1.8 * (1.0 - angle.cos()) / angle),
            };
            let expected = Vector3::new(-0.9 + x, y, 0.0) - origin.coords;
            largest_deviation = largest_deviation.max((translation - expected).norm());
            last = Some((angle, matrix));
        }
        println!("{name}: farthest from the arc {largest_deviation:.2e} of 1.8, {frames_held} frames held");
        assert!(largest_deviation < 0.005, "{name}: {largest_deviation}");
        assert_eq!(frames_held, 156, "{name}: from 0.8 s to 3.4 s at 60 Hz");
        let (angle, matrix) = last.unwrap();
        assert!((angle.to_degrees() - 60.0).abs() < 0.01, "{name}: {}", angle.to_degrees());
        assert!((matrix.transpose() * matrix - Matrix3::identity()).norm() < 1e-6, "{name}: {matrix}");
        assert!(hands.held().is_empty(), "{name}: the stylus lets go");
    }
}

#[test]
fn the_head_sways_ten_centimetres_on_every_stage() {
    let script = Script::find("bend").unwrap();
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        let head_x = |t: f64| f64::from(script.sample(&stage, t).head.unwrap().translation.x);
        assert!((head_x(2.0) - head_x(0.0) - 0.1).abs() < 1e-6, "{name}");
        assert!((head_x(4.0) - stage.viewer.room_from_head.translation.x).abs() < 1e-6, "{name}");
    }
}

#[test]
fn stylus_and_tube_stay_within_the_pictures_of_every_stage() {
    let script = Script::find("bend").unwrap();
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        let tube =
            [-0.95, 0.0, 0.95].map(|x| stage.workspace.centre + Vector3::x() * x * stage.workspace.radius_m);
        for frame in 0..=40 {
            let state = script.sample(&stage, f64::from(frame) / 10.0);
            let head = state.head.unwrap().cast();
            let stylus = Point3::from(state.styli[0].room_from_stylus.translation.vector.cast::<f64>());
            for (point, &eye) in tube
                .iter()
                .chain([&stylus])
                .flat_map(|point| stage.stereo.eyes().iter().map(move |eye| (point, eye)))
            {
                let eye = stage.viewer.eye_in_room(&head, eye);
                let is_on = |point: Point3<f64>, screen: &Screen| {
                    let clip = screen.view(&eye, 0.05).unwrap().clip_from_room
                        * point.cast::<f32>().to_homogeneous();
                    clip.w > 0.0 && clip.x.abs() <= clip.w && clip.y.abs() <= clip.w
                };
                let is_shown =
                    |by: Vector3<f64>| stage.screens.iter().any(|screen| is_on(point + by, screen));
                // A seam or a bezel hides what is behind it, and nothing 14 mm to either side.
                let across = [Vector3::y(), Vector3::x(), Vector3::x() + Vector3::y()].map(|way| way * 0.014);
                let is_in_seam = across.iter().any(|way| is_shown(*way) && is_shown(-way));
                let is_seen = is_shown(Vector3::zeros()) || is_in_seam;
                assert!(is_seen, "{name}, frame {frame}: {point} is on no screen");
            }
        }
    }
}

fn parse_and_use(text: &str) {
    let stage = Stage::find("workbench").expect("built in");
    let Ok(script) = Script::parse(text, Path::new("any.toml")) else { return };
    for part in [-1.0, 0.0, 0.1, 0.35, 0.5, 0.77, 1.0, 2.0, f64::NAN] {
        let state = script.sample(&stage, part * script.duration_s);
        let poses = state.styli.iter().map(|stylus| stylus.room_from_stylus).chain(state.head);
        for pose in poses {
            assert!(pose.translation.vector.iter().all(|x| x.is_finite()), "{text}");
            assert!((pose.rotation.coords.norm() - 1.0).abs() < 1e-5, "{text}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_text_panics(text in "\\PC*") {
        parse_and_use(&text);
    }

    #[test]
    fn no_damaged_script_panics(
        from in any::<prop::sample::Index>(),
        length in 0..80usize,
        filling in "[\\[\\]{}=\"., \n0-9a-z-]{0,20}",
    ) {
        parse_and_use(&damaged(BEND, &from, length, &filling));
    }

    #[test]
    fn any_numbers_give_usable_poses_or_an_error(
        times in prop::collection::vec(0.0..20.0f64, 1..6),
        numbers in prop::collection::vec(prop_oneof![8 => -4.0..4.0f64, 1 => Just(0.0), 1 => any::<f64>()], 42),
    ) {
        let mut times = times;
        times.sort_by(f64::total_cmp);
        let mut text = "frame = \"workspace\"\n".to_owned();
        for (i, time) in times.iter().enumerate() {
            let n = |k: usize| format!("{:?}", numbers[7 * i + k]).to_lowercase();
            let orientation = ["target", "direction", "rotation"][i % 3];
            text += &format!("[[key]]\ntime = {time:?}\nhead = {{ offset = [{}, 0, 0] }}\n", n(6));
            text += &format!("stylus.a = {{ position = [{}, {}, {}], ", n(0), n(1), n(2));
            text += &format!("{orientation} = [{}, {}, {}] }}\n", n(3), n(4), n(5));
        }
        parse_and_use(&text);
    }
}
