//! The overlay as a picture, from readings that never change.

use super::*;
use crate::base::fixed::LETTERS;
use crate::base::plates::Words;
use crate::deform::{ControlPose, LINEAR, ROTATION, Wrench};
use crate::effect::haptics::{HapticReading, LoopState, LoopTiming, Push};
use crate::render::{COLOR_FORMAT, FrameContents, Gpu, Offscreen, Overlay, RenderError, Renderer, Viewport};
use crate::track::Signal;
use crate::world::{BodyAssets, BodyFrame, TurnLimits, WrenchError};
use egui::{Rect, pos2};
use image::RgbImage;
use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;

const SIZE: [u32; 2] = [960, 600];

/// A force device that pushes.
fn pen(turn: f64) -> HapticReading {
    HapticReading {
        name: "pen".into(),
        state: LoopState {
            room_from_handle: Some(nalgebra::Isometry3::identity()),
            push: Push { force: Vector3::new(0.0, -3.0, 1.0) * turn, torque: Vector3::zeros() },
            gain: 1.0,
            limited: true,
            stiffer: 3.25,
            ..LoopState::default()
        },
        timing: LoopTiming {
            ticks: 61_234,
            rate_hz: 999.8,
            late: 12,
            missed: 3,
            work_p50_s: 1.1e-6,
            work_p99_s: 2.4e-6,
            ..LoopTiming::default()
        },
        max_force_n: 3.3,
        holds: true,
    }
}

fn readings(turn: f64) -> Readings {
    let control = |name: &str, turn: f64| ControlReading {
        name: name.to_owned(),
        pose: ControlPose {
            translation: Vector3::new(-0.0825, 0.3276, 0.0) * turn,
            matrix: Rotation3::from_axis_angle(&Vector3::z_axis(), turn) * Matrix3::identity(),
        },
        held: turn > 0.0,
        force: Some(ForceReading {
            wrench: Wrench { force: Vector3::new(1.5, -12.25, 0.0), moment: Vector3::new(0.0, 0.25, -3.0) },
            error: (turn > 0.0).then_some(WrenchError {
                force: 0.3,
                moment: 0.08,
                is_whole: true,
                part: 0.0,
                parts: [None; 2],
            }),
        }),
    };
    let sensor = |name: &str, age_s: f64, signal| SensorReading {
        name: name.into(),
        rate_hz: 119.9,
        age_s,
        signal,
        heard: true,
    };
    Readings {
        stage: "workbench".into(),
        device: "a device by Vulkan".into(),
        deformation: "deformed on the CPU".into(),
        source: String::new(),
        sensors: vec![
            sensor("head", 0.004, Signal::Live),
            sensor("wand", 0.31, Signal::Held { age_s: 0.31 }),
            sensor("other", 62.0, Signal::Lost { age_s: 62.0 }),
        ],
        devices: vec![pen(turn).rows()],
        mode: "translate along the body's x".into(),
        hands: [
            ("pen", HandDoes::Holds("tube.right".into())),
            ("wand", HandDoes::PointsAt("tube.left".into())),
            ("other", HandDoes::Lost),
        ]
        .map(|(name, does)| HandReading { name: name.into(), does })
        .to_vec(),
        undo: [4, 1],
        bodies: vec![BodyReading {
            age: None,
            name: "tube".into(),
            model: "linear".into(),
            effects: vec!["haptics".into()],
            controls: vec![control("left", 0.0), control("right", turn)],
            turn,
            limits: TurnLimits::of_model(&LINEAR),
            doubt: None,
            energy: Some(0.1234),
            errors: None,
        }],
        warnings: vec![(
            12.3,
            "left eye: screen `table` stays black: the eye is 0.120 m behind its plane".into(),
        )],
        time_s: 0.0,
    }
}

fn history() -> History {
    let mut history = History::default();
    for k in 0..90 {
        let ms = |mean: f64| 1e-3 * mean * (1.0 + 0.3 * f64::from(k % 7));
        let steps = [0.02, 0.05, 0.4, 0.3, 0.2, 1.5, 0.1, 4.0].map(ms);
        history.push(FrameSteps { steps, whole_s: steps.iter().sum::<f64>() * 1.1 });
    }
    history
}

fn picture(gpu: &Gpu, readings: &Readings) -> RgbImage {
    picture_of(gpu, readings, SIZE, &[])
}

fn picture_of(gpu: &Gpu, readings: &Readings, size: [u32; 2], clear: &[Rect]) -> RgbImage {
    let mut renderer = Renderer::new(gpu, COLOR_FORMAT, 1).unwrap();
    let target = Offscreen::new(gpu, &renderer, size).unwrap();
    renderer.draw(gpu, &[target.picture(&Viewport::full(size, None))], &FrameContents::default()).unwrap();
    let history = history();
    let paint = |painter: &egui::Painter| {
        let rect = painter.clip_rect();
        let panel = Panel { painter, rect, readings, history: &history, clear, taken: &[] };
        panel.paint(&mut Seats::default());
    };
    Overlay::new(COLOR_FORMAT).paint(gpu, &target.image.view, size, paint).unwrap();
    image::DynamicImage::from(target.read(gpu).unwrap().0).to_rgb8()
}

fn gpu() -> Option<Gpu> {
    match Gpu::headless() {
        Ok(gpu) => Some(gpu),
        Err(error @ RenderError::NoAdapter(_)) => {
            assert!(std::env::var("GREENSTAGE_REQUIRE_GPU").as_deref() != Ok("1"), "{error}");
            eprintln!("SKIPPED: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A held thing is never covered; in small windows the least rows are left out, and letters are as large as ever.
#[test]
fn no_pixel_is_over_what_is_held_in_windows_of_any_size() {
    let Some(gpu) = gpu() else { return };
    for (size, held) in [
        ([960, 600], Rect::from_min_max(pos2(30.0, 40.0), pos2(130.0, 140.0))),
        ([960, 600], Rect::from_min_max(pos2(700.0, 10.0), pos2(900.0, 500.0))),
        ([640, 400], Rect::from_min_max(pos2(10.0, 150.0), pos2(250.0, 220.0))),
        ([320, 200], Rect::from_min_max(pos2(300.0, 180.0), pos2(330.0, 260.0))),
        ([200, 120], Rect::from_min_max(pos2(0.0, 0.0), pos2(200.0, 120.0))),
    ] {
        let picture = picture_of(&gpu, &readings(0.3), size, &[held]);
        if let Ok(folder) = std::env::var("GREENSTAGE_PICTURES") {
            picture
                .save(Path::new(&folder).join(format!("overlay-{}x{}-{}.png", size[0], size[1], held.min.x)))
                .unwrap();
        }
        let is_held = |x: u32, y: u32| held.contains(pos2(x as f32 + 0.5, y as f32 + 0.5));
        let drawn = |over: bool| {
            let pixels = picture.enumerate_pixels();
            pixels.filter(|(x, y, pixel)| is_held(*x, *y) == over && pixel.0 != [0; 3]).count()
        };
        assert_eq!(drawn(true), 0, "{size:?}");
        assert!(drawn(false) > 1000 || size == [200, 120], "{size:?}: there is an overlay");
    }
}

fn text(row: &row::Row) -> String {
    match row {
        row::Row::Words(words) => words.iter().map(|(text, _)| text.as_str()).collect(),
        _ => String::new(),
    }
}

/// All lines of a row.
fn texts(row: &row::Row) -> Vec<String> {
    let line = |words: &row::Words| words.iter().map(|(text, _)| text.as_str()).collect();
    match row {
        row::Row::Table(rows) => rows.iter().map(line).collect(),
        _ => vec![text(row)],
    }
}

proptest! {
    /// Whatever the numbers are: no two of them run together, no row is longer than its column, and a row of a kind is as long
    /// as ever.
    #[test]
    fn rows_never_collide_and_never_jump(bits in proptest::collection::vec(any::<u64>(), 24), plain in -1e6..1e6f64) {
        let number = |k: usize| if k.is_multiple_of(2) { f64::from_bits(bits[k]) } else { plain * f64::from_bits(bits[k]).sin() };
        let vector = |k: usize| Vector3::new(number(k), number(k + 1), number(k + 2));
        let control = ControlReading {
            name: "right".into(),
            pose: ControlPose { translation: vector(0), matrix: Matrix3::from_fn(|i, k| number(3 + 3 * i + k)) },
            held: true,
            force: Some(ForceReading {
                wrench: Wrench { force: vector(12), moment: vector(15) },
                error: Some(WrenchError { force: number(18).abs(), moment: number(19).abs(), is_whole: plain > 0.0, part: 0.0, parts: [None; 2] }),
            }),
        };
        let rows = body_rows::control_rows(&control);
        let of = |rest: ControlReading| -> Vec<usize> {
            body_rows::control_rows(&rest).iter().flat_map(|(_, row)| texts(row)).map(|text| text.chars().count()).collect()
        };
        let lengths: Vec<usize> =
            rows.iter().flat_map(|(_, row)| texts(row)).map(|text| text.chars().count()).collect();
        let rest = Wrench { force: Vector3::zeros(), moment: Vector3::zeros() };
        let force = ForceReading { wrench: rest, error: control.force.unwrap().error };
        let at_rest = ControlReading { pose: ControlPose::REST, force: Some(force), ..control };
        prop_assert_eq!(&lengths, &of(at_rest), "as long at rest");
        let mut haptic = pen(0.3);
        haptic.timing.rate_hz = number(20);
        haptic.timing.work_p99_s = number(21);
        haptic.state.observer.braked = number(22);
        haptic.state.push.force = vector(1);
        let haptic = haptic.rows();
        let device = |words: &Words| words.iter().map(|(text, _)| text.as_str()).collect::<String>();
        let all = rows.iter().flat_map(|(_, row)| texts(row)).chain(haptic.iter().map(device));
        for row in all {
            prop_assert!(row.chars().count() <= LETTERS, "{:?}", row);
            for word in row.split_whitespace() {
                let points = word.matches('.').count();
                prop_assert!(points <= 1, "{:?}", row);
            }
        }
    }
}

#[test]
fn forces_stand_with_their_error_or_without_one() {
    let control = |error| ControlReading {
        force: Some(ForceReading { error, ..force() }),
        ..readings(0.3).bodies[0].controls[1].clone()
    };
    fn force() -> ForceReading {
        readings(0.3).bodies[0].controls[1].force.unwrap()
    }
    let told = |error| -> Vec<String> {
        body_rows::control_rows(&control(error)).iter().flat_map(|(_, row)| texts(row)).collect()
    };
    let measured =
        told(Some(WrenchError { force: 0.3, moment: 0.08, is_whole: true, part: 0.0, parts: [None; 2] }));
    assert_eq!(measured[5], "force    12.34 N  ±   0.30");
    assert_eq!(measured[6], "  x y z     1.5  -12.2    0.0");
    assert_eq!(measured[7], "torque    3.01 N·m  ±   0.08");
    let partly =
        told(Some(WrenchError { force: 1300.0, moment: 0.08, is_whole: false, part: 0.0, parts: [None; 2] }));
    assert_eq!(partly[5], "force     0.01 kN ±>  1.30");
    let unknown = told(None);
    assert_eq!(unknown[5], "force    12.34 N  error unknown");
    assert_eq!(unknown[6], "  x y z     1.5  -12.2    0.0");
    assert_eq!(unknown[7], "torque    3.01 N·m  error unknown");
}

/// Golden picture, as in tests/pictures/golden.rs; `GREENSTAGE_BLESS=1` writes tests/golden/overlay.png anew. The wrong picture:
/// bent further.
#[test]
fn the_overlay_matches_its_golden_picture_and_leaves_the_middle_free() {
    let Some(gpu) = gpu() else { return };
    let [now, wrong] = [0.3, 1.0].map(|turn| picture(&gpu, &readings(turn)));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/overlay.png");
    if std::env::var("GREENSTAGE_BLESS").as_deref() == Ok("1") {
        now.save(&path).unwrap();
    }
    let golden = image::open(&path).unwrap().to_rgb8();
    let [alike, wrong] =
        [&now, &wrong].map(|picture| image_compare::rgb_hybrid_compare(&golden, picture).unwrap().score);
    println!("overlay: {alike:.4}; the wrong one {wrong:.4}");
    assert!(alike > 0.985 && 3.0 * (1.0 - alike) < 1.0 - wrong, "{alike:.4}; the wrong one {wrong:.4}");
    let [width, height] = SIZE;
    let middle = now.enumerate_pixels().filter(|(x, y, _)| {
        (width / 3..2 * width / 3).contains(x) && (height / 4..3 * height / 4).contains(y)
    });
    assert!(middle.into_iter().all(|(.., pixel)| pixel.0 == [0; 3]), "the middle is free");
}

#[test]
fn the_history_keeps_the_last_120_frames() {
    let mut history = History::default();
    for k in 0..500 {
        history.push(FrameSteps { whole_s: f64::from(k), ..FrameSteps::default() });
    }
    assert_eq!((history.frames.len(), history.worst_s()), (120, 499.0));
    assert_eq!(history.mean(|frame| frame.whole_s), 439.5);
    assert_eq!(History::default().mean(|frame| frame.whole_s), 0.0);
}

/// Numbers between those that were measured, none beyond, and no row for a body of which nothing was.
#[test]
fn errors_are_told_as_they_were_measured_and_nowhere_else() {
    use crate::deform::{
        ErrorsAt, ExpectedErrors, FinerErrors, MeshErrors, MotionErrors, MovedErrors, TurnErrors,
    };
    let mut world = crate::world::tests::world();
    let body = &mut world.bodies[0];
    let mut told = |expected: Option<ExpectedErrors>, degrees: f64| {
        let shown = BodyFrame { expected: expected.map(Arc::new), ..world.frame.bodies[0].clone() };
        let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), degrees.to_radians()).matrix();
        body.deformer.evaluate(&[ControlPose::REST, ControlPose { matrix, ..ControlPose::REST }]);
        let reading = readings::body_reading(body, &shown);
        reading.errors.iter().flat_map(body_rows::error_rows).map(|row| text(&row)).collect::<Vec<_>>()
    };
    let at = |degrees: f64, force: f64| ErrorsAt {
        angle: degrees,
        turn: f64::to_radians(degrees),
        stretch: 10.0,
        off: 0.0,
        force: Some(force),
        torque: Some(0.01),
        shape: 0.1 * force,
    };
    let of = |bent: Vec<ErrorsAt>, shifted| {
        let turned = TurnErrors { twisted: bent.clone(), both: bent.clone(), bent, about: vec![] };
        MotionErrors { turned, shifted, ..MotionErrors::default() }
    };
    let moved = MovedErrors {
        control: "right".into(),
        model: of(vec![at(10.0, 0.02), at(30.0, 0.12)], vec![at(10.0, 0.01), at(30.0, 0.03)]),
        mesh: Some(MeshErrors { wrench: 0.09, shape: 0.01, stiffness: None, loads: vec![] }),
        finer: Some(FinerErrors {
            mesh: of(vec![at(60.0, 0.05)], vec![at(60.0, 0.05)]),
            ..FinerErrors::default()
        }),
        ..MovedErrors::default()
    };
    let measured = Some(ExpectedErrors { moved: vec![moved], ..ExpectedErrors::default() });
    assert_eq!(told(None, 5.0), Vec::<String>::new());
    assert_eq!(told(Some(ExpectedErrors::default()), 5.0), Vec::<String>::new());
    let [first, mesh] = &told(measured.clone(), 5.0)[..] else { panic!() };
    assert_eq!((&first[..], &mesh[..]), ("errors ~2.0 %  force  0.2 %  shape", "of mesh ~9.0 %  force"));
    let between = told(measured.clone(), 20.0);
    assert!(between[0].starts_with("errors ~7."), "{between:?}");
    assert_eq!(told(measured, 35.0), ["of mesh ~9.0 %  force", "error unknown: beyond the measured poses"]);
}

/// `shape good, forces off by 27 %` ran out of its plate.
#[test]
fn a_doubtful_force_is_told_within_the_column() {
    use crate::deform::ErrorsAt;
    for (wrench, mesh, told) in [
        (0.25, Some(0.02), "forces ±27 %"),
        (0.27, None, "forces ±>27 %"),
        (9.9, None, "forces ±>990 %"),
        (1e4, None, "forces wrong"),
    ] {
        for turn in [0.01, 0.5, 3.0] {
            let mut body = readings(turn).bodies.remove(0);
            let at = ErrorsAt {
                angle: 1.0,
                turn: 1.0,
                stretch: 1.0,
                off: 0.0,
                force: Some(wrench),
                torque: Some(wrench),
                shape: 0.0,
            };
            body.errors = Some(ErrorReading { model: Some(at), mesh, unknown: None });
            let row = text(&body_rows::gauge_rows(&body)[0].1);
            assert!(row.chars().count() <= LETTERS, "{row}");
            assert!(row.contains(told), "{row}");
        }
    }
}

/// A body of which nothing was measured had no newtons: the overlay said "force not measured here".
#[test]
fn a_force_without_a_measured_error_is_a_number_and_says_what_to_list() {
    use crate::effect::ghost_equilibrium::tests::bar;
    let (scene, file, mut world) = bar("linear", &["haptics"]);
    let effects = crate::effect::attach(crate::effect::EFFECTS, &scene, &file, &mut world).unwrap();
    world.join(effects).unwrap();
    let pull = ControlPose { translation: Vector3::new(0.01, 0.0, 0.0), ..ControlPose::REST };
    world.bodies[0].deformer.evaluate(&[ControlPose::REST, pull]);
    let reading = readings::body_reading(&world.bodies[0], &world.frame.bodies[0]);
    let force = reading.controls[1].force.unwrap();
    assert!(force.wrench.force.norm() > 0.0 && force.error.is_none());
    let rows: Vec<String> = body_rows::body_rows(&reading).iter().flat_map(|(_, row)| texts(row)).collect();
    let forces: Vec<&String> = rows.iter().filter(|row| row.starts_with("force")).collect();
    let shown = |row: &&String| row.contains("N  error unknown");
    assert!(forces.len() == 2 && forces.iter().all(shown), "{rows:?}");
    assert!(rows.contains(&"error unknown: list expected_errors".to_owned()), "{rows:?}");
}

#[test]
fn a_measured_range_goes_before_the_models_table() {
    let mut world = crate::world::tests::world();
    let body = &mut world.bodies[0];
    let aside = ControlPose { translation: Vector3::new(0.0, 0.5, 0.0), ..ControlPose::REST };
    body.deformer.evaluate(&[ControlPose::REST, aside]);
    let (turn, limits) = TurnLimits::of_body(body);
    assert_eq!(limits, TurnLimits::of_model(&ROTATION));
    assert!(turn > 0.1 && limits.good < limits.fair && !limits.is_measured, "the middle turns: {turn}");
    body.assets = Arc::new(BodyAssets { range: Some(0.7), ..(*body.assets).clone() });
    let (turn, limits) = TurnLimits::of_body(body);
    assert_eq!((turn, limits), (0.0, TurnLimits { good: 0.7, fair: 0.7, is_measured: true }));
}

fn gauge(body: &crate::world::PlacedBody) -> String {
    text(&body_rows::gauge_rows(&readings::body_reading(body, &BodyFrame::default()))[0].1)
}

/// Two whole turns, followed in steps: the poses are those at rest, and the overlay knows better; undone, it is at rest.
#[test]
fn whole_turns_are_counted_and_not_called_good() {
    for range in [None, Some(0.7)] {
        let mut world = crate::world::tests::world();
        let body = &mut world.bodies[0];
        body.assets = Arc::new(BodyAssets { range, ..(*body.assets).clone() });
        for degrees in (0..=720).step_by(10) {
            let angle = f64::from(degrees).to_radians();
            let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), angle).matrix();
            body.deformer.evaluate(&[ControlPose::REST, ControlPose { matrix, ..ControlPose::REST }]);
            let (turn, limits) = TurnLimits::of_body(body);
            let is_followed = degrees > 180 || range.is_some();
            assert!(!is_followed || (turn - angle).abs() < 1e-9, "{degrees}°: {}°", turn.to_degrees());
            assert!(degrees <= 180 || turn > limits.fair, "{degrees}°: {}°", turn.to_degrees());
        }
        let shown = gauge(body);
        assert_eq!(shown, "turn  720.0°  2.00 turns · too far");
        let holds = if range.is_some() { 40 } else { 45 };
        let told = format!("turned 2.0 times round; the model rotation holds up to {holds}°");
        assert_eq!(crate::world::out_of_range(body), Some(told));
        body.deformer.set_turn(1, crate::deform::FollowedTurn::REST);
        body.deformer.evaluate(&[ControlPose::REST; 2]);
        let shown = gauge(body);
        assert_eq!(shown, "turn    0.0°  good");
    }
}
