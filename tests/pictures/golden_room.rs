//! Pictures for lab engineers against those that people looked at: rooms from outside, and the test pattern.
//!
//! `GREENSTAGE_BLESS=1 cargo test --profile quick --test pictures golden_room` writes tests/golden/room-*.png and pattern-*.png anew;
//! look at them then.

use crate::common::{folder, greenstage};
use crate::golden::{golden_picture, likeness, save};
use crate::render_common::require_gpu;
use image::RgbImage;
use std::path::Path;

/// Likeness as in tests/pictures/golden.rs. A picture must be within this of its golden one, and at least three times nearer to
/// it than a wrong picture is: letters and lines cover little, so wrong ones are alike too.
const LEAST: f64 = 0.985;

fn compare(name: &str, now: &RgbImage, wrong: &RgbImage) {
    let golden = golden_picture(name, now);
    let [alike, wrong] = [now, wrong].map(|picture| likeness(&golden, picture));
    println!("{name}: {alike:.4}; the wrong one {wrong:.4}");
    if alike < LEAST || 3.0 * (1.0 - alike) > 1.0 - wrong {
        let actual = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("golden-{name}-actual.png"));
        save(&actual, now);
        panic!(
            "{name} is {alike:.4} like its golden picture, a wrong one {wrong:.4}; look at {}",
            actual.display()
        );
    }
}

fn room(place: &Path, stage: &str, output: &str) -> RgbImage {
    greenstage(place, &["stage-view", stage, "-o", output, "--size", "480x360", "--samples", "4"]);
    image::open(place.join(output)).unwrap().to_rgb8()
}

/// The wrong picture: the viewer stands 20 cm further left.
fn room_matches(stage: &str, viewer: &str, moved: &str) {
    let Some(_) = require_gpu() else { return };
    let place = folder(&format!("golden-room-{stage}"));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("configs/stages/{stage}.toml"));
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(viewer), "{stage}");
    std::fs::write(place.join("moved.toml"), text.replacen(viewer, moved, 1)).unwrap();
    compare(
        &format!("room-{stage}"),
        &room(&place, stage, "now.png"),
        &room(&place, "moved.toml", "moved.png"),
    );
}

#[test]
fn the_workbench_from_outside_matches_its_golden_picture() {
    room_matches("workbench", "position = [0.0, 1.70, 1.50]", "position = [-0.2, 1.70, 1.50]");
}

#[test]
fn the_cyberstage_from_outside_matches_its_golden_picture() {
    room_matches("cyberstage", "position = [0.0, 1.70, 0.40]", "position = [-0.2, 1.70, 0.40]");
}

/// The wrong picture: the other eye's.
#[test]
fn the_pattern_matches_its_golden_picture() {
    let Some(_) = require_gpu() else { return };
    let place = folder("golden-pattern");
    greenstage(&place, &["pattern", "workbench", "-o", "out"]);
    let [left, right] = ["left", "right"]
        .map(|eye| image::open(place.join(format!("out/table-{eye}.png"))).unwrap().to_rgb8());
    compare("pattern-table", &left, &right);
}
