//! Hands against a picture that people looked at: a held element with its ray bent and the arrow of its force, and one
//! that another hand points at.
//!
//! `GREENSTAGE_BLESS=1 cargo test --profile quick --test pictures golden_hands` writes tests/golden/hands.png anew; look at it then.

use crate::common::{coarse_demo, folder, greenstage};
use crate::golden::{golden_picture, likeness};
use crate::render_common::require_gpu;
use image::RgbImage;
use std::path::Path;

/// Likeness as in tests/pictures/golden.rs.
const LEAST: f64 = 0.985;

/// Three clicks of the second button go to the mode along and about the body's x; then the right hand pulls along x and
/// up, where the element does not follow. The other hand points at the left end.
fn script(clicks: u32) -> String {
    let start = "position = [0.75, 0.85, 0.9], target = [0.9, 0.05, 0.05]";
    let mut text = format!(
        "frame = \"workspace\"\n[[key]]\ntime = 0.0\nstylus.right = {{ {start} }}\n\
         stylus.left = {{ position = [-0.5, 0.8, 0.9], target = [-0.9, 0.05, 0.05] }}\n\
         [[key]]\ntime = 0.2\nstylus.right = {{ pressed = true }}\n"
    );
    for click in 0..clicks {
        for (time, second) in [(0.4, true), (0.5, false)] {
            let time = time + 0.3 * f64::from(click);
            text += &format!("[[key]]\ntime = {time:.1}\nstylus.right = {{ second = {second} }}\n");
        }
    }
    text + &format!(
        "[[key]]\ntime = 1.5\nstylus.right = {{ {start} }}\n\
         [[key]]\ntime = 2.5\nstylus.right = {{ position = [0.35, 0.75, 0.9], direction = [0.6, -0.2, -0.75] }}\n"
    )
}

fn picture(name: &str, clicks: u32) -> RgbImage {
    let place = folder(&format!("golden-hands-{name}"));
    coarse_demo(&place);
    let path = place.join("tube.toml");
    let scene = std::fs::read_to_string(&path).unwrap();
    let left = "nodes = { group = \"left\" }\ngrab = \"fixed\"";
    assert!(scene.contains("effects = []") && scene.contains(left));
    let scene = scene.replace("effects = []", "effects = [\"haptics\"]");
    std::fs::write(&path, scene.replace(left, &left.replace("fixed", "dragger"))).unwrap();
    std::fs::write(place.join("bend.toml"), script(clicks)).unwrap();
    let stage = ["--stage", "desktop", "--window-scale", "0.375", "--samples", "4", "--shadows", "off"];
    let arguments = ["render", "tube.toml", "-o", "out", "--frames", "2"];
    greenstage(&place, &[&arguments[..], &stage[..]].concat());
    image::open(place.join("out/frame0001-monitor-centre.png")).unwrap().to_rgb8()
}

/// The wrong picture: no mode, so that the tube follows the hand and the ray is straight.
#[test]
fn a_hand_that_pulls_along_an_axis_matches_its_golden_picture() {
    let Some(_) = require_gpu() else { return };
    let (now, free) = (picture("now", 3), picture("free", 0));
    let golden = golden_picture("hands", &now);
    let [alike, wrong] = [&now, &free].map(|picture| likeness(&golden, picture));
    println!("hands: {alike:.4}; the wrong one {wrong:.4}");
    if alike < LEAST {
        now.save(Path::new(env!("CARGO_TARGET_TMPDIR")).join("golden-hands-actual.png")).unwrap();
    }
    assert!(alike > LEAST && 3.0 * (1.0 - alike) < 1.0 - wrong, "{alike:.4}; the wrong one {wrong:.4}");
}
