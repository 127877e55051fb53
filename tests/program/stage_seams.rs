//! A point on an edge that two screens share is shown at the same physical place by both, for both eyes, from
//! any head pose; and a point on a screen is shown where it is.

use greenstage::measure::poses::Random;
use greenstage::stage::{BUILT_IN, Eye, EyeView, Screen, Stage};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Each coordinate up to `half` either way.
fn vector(random: &mut Random, half: [f64; 3]) -> Vector3<f64> {
    Vector3::from(half.map(|h| h * (2.0 * random.number() - 1.0)))
}

/// A head anywhere within 0.8 m of the viewer's start, turned any way, no eye nearer than 0.1 m to a screen.
fn head(stage: &Stage, random: &mut Random) -> Isometry3<f64> {
    loop {
        let place = stage.viewer.room_from_head.translation.vector + vector(random, [0.8, 0.5, 0.8]);
        let turn = UnitQuaternion::from_scaled_axis(vector(random, [3.0, 3.0, 3.0]));
        let head = Isometry3::from_parts(Translation3::from(place), turn);
        let is_before = |screen: &Screen| {
            [Eye::Left, Eye::Right]
                .iter()
                .all(|&eye| screen.distance_m(&stage.viewer.eye_in_room(&head, eye)) > 0.1)
        };
        if stage.screens.iter().all(is_before) {
            return head;
        }
    }
}

/// The place where the picture shows a point: through the f32 matrix, as a GPU does, to pixels and back onto the glass.
fn shown_at(screen: &Screen, view: &EyeView, point: &Point3<f64>) -> Point3<f64> {
    let clip = view.clip_from_room * point.cast::<f32>().to_homogeneous();
    let [width, height] = screen.pixels.map(f64::from);
    let pixel = [
        (f64::from(clip.x / clip.w) + 1.0) / 2.0 * width,
        (1.0 - f64::from(clip.y / clip.w)) / 2.0 * height, //
    ];
    screen.point([pixel[0] / width * 2.0 - 1.0, 1.0 - pixel[1] / height * 2.0])
}

#[test]
fn a_point_on_a_seam_lands_on_one_physical_place_from_1000_head_poses() {
    let mut random = Random(1);
    let mut seams_seen = 0;
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        let seams = stage.seams();
        seams_seen += seams.iter().filter(|seam| seam.widest_m() < 1e-9).count();
        if seams.is_empty() {
            continue;
        }
        let mut worst_m: f64 = 0.0;
        for _ in 0..1000 {
            let head = head(&stage, &mut random);
            let part = random.number();
            for eye in [Eye::Left, Eye::Right].map(|eye| stage.viewer.eye_in_room(&head, eye)) {
                for seam in seams.iter().filter(|seam| seam.widest_m() < 1e-9) {
                    let point = seam.ends[0] + (seam.ends[1] - seam.ends[0]) * part;
                    let shown = seam.edges.map(|(i, _)| {
                        let screen = &stage.screens[i];
                        shown_at(screen, &screen.view(&eye, 0.05).unwrap(), &point)
                    });
                    for place in shown {
                        worst_m = worst_m.max((place - point).norm());
                    }
                    worst_m = worst_m.max((shown[0] - shown[1]).norm());
                }
            }
        }
        println!("{name}: {} seams, worst place {:.2e} m", seams.len(), worst_m);
        assert!(worst_m < 1e-5, "{name}: {worst_m} m");
    }
    assert_eq!(
        seams_seen,
        2 + 5 + 3 + 12,
        "the workbench's seam, with its windows and in one, the CyberStage's and those of the two CAVEs"
    );
}

#[test]
fn a_point_on_a_screen_is_shown_at_its_own_place() {
    let mut random = Random(2);
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        for _ in 0..1000 {
            let head = head(&stage, &mut random);
            for screen in &stage.screens {
                let point = screen.point([2.0 * random.number() - 1.0, 2.0 * random.number() - 1.0]);
                let view = screen.view(&stage.viewer.eye_in_room(&head, Eye::Right), 0.05).unwrap();
                let error_m = (shown_at(screen, &view, &point) - point).norm();
                assert!(error_m < 1e-5, "{name}, {}: {error_m} m", screen.name);
            }
        }
    }
}

#[test]
fn any_point_is_shown_where_the_line_of_sight_meets_the_glass() {
    let mut random = Random(3);
    let stage = Stage::find("cyberstage").unwrap();
    for _ in 0..1000 {
        let head = head(&stage, &mut random);
        let eye = stage.viewer.eye_in_room(&head, Eye::Left);
        for screen in &stage.screens {
            let on_glass = screen.point([2.0 * random.number() - 1.0, 2.0 * random.number() - 1.0]);
            let point = eye + (on_glass - eye) * (0.3 + 3.0 * random.number());
            let view = screen.view(&eye, 0.05).unwrap();
            let error_m = (shown_at(screen, &view, &point) - on_glass).norm();
            assert!(error_m < 3e-5, "{}: {error_m} m", screen.name);
        }
    }
}
