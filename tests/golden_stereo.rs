//! Every kind of stereo against pictures that people looked at, as `greenstage render --stereo KIND` makes them.
//!
//! `GREENSTAGE_BLESS=1 cargo test --release --test golden_stereo` writes tests/golden/stereo/*.png anew; look at them then.

#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod common;
mod render_common;

use common::{coarse_demo, folder, greenstage};
use greenstage::stage::Stereo;
use image::RgbImage;
use render_common::require_gpu;
use std::path::{Path, PathBuf};

/// A kind of stereo, the size of its picture, and how alike it must be.
struct Kind {
    stereo: Stereo,
    size: [u32; 2],
    least: f64,
}

/// Likeness as in tests/golden.rs, of a monitor of 192 × 120 pixels with the tube bent by 30°. For rows, columns and
/// checkerboard swapped eyes are the same as a parity that is off by one.
///
/// | kind | one sample a pixel | eyes swapped |
/// |---|---|---|
/// TABLE
const SIZE: [u32; 2] = [192, 120];
const KINDS: [Kind; 15] = [
    Kind { stereo: Stereo::SideBySide, size: [384, 120], least: 0.97 },
    Kind { stereo: Stereo::SideBySideHalf, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::TopBottom, size: [192, 240], least: 0.97 },
    Kind { stereo: Stereo::TopBottomHalf, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::FramePacking, size: [192, 245], least: 0.97 },
    Kind { stereo: Stereo::Anaglyph, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::AnaglyphGrey, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::AnaglyphHalfColour, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::AnaglyphDubois, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::Rows, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::Columns, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::Checkerboard, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::Mono, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::Left, size: SIZE, least: 0.97 },
    Kind { stereo: Stereo::Right, size: SIZE, least: 0.97 },
];

/// The picture halfway through the script, on a monitor with 5 cm more depth between glass and body than the desktop
/// stage has, so that the eyes differ.
fn picture(place: &Path, stage: &str, stereo: Stereo, samples: &str) -> RgbImage {
    let output = format!("out-{stage}-{}-{samples}", stereo.name());
    let stage = format!("{stage}.toml");
    greenstage(
        place,
        &[
            "render",
            "tube.toml",
            "-o",
            &output,
            "--frames",
            "3",
            "--stage",
            &stage,
            "--scale",
            "0.15",
            "--samples",
            samples,
            "--stereo",
            stereo.name(),
        ],
    );
    let found: Vec<PathBuf> =
        std::fs::read_dir(place.join(output)).unwrap().map(|e| e.unwrap().path()).collect();
    let halfway: Vec<_> = found
        .iter()
        .filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with("frame0001"))
        .collect();
    assert_eq!(halfway.len(), 1, "{}: one picture for one screen: {found:?}", stereo.name());
    image::open(halfway[0]).unwrap().to_rgb8()
}

fn likeness(a: &RgbImage, b: &RgbImage) -> f64 {
    image_compare::rgb_hybrid_compare(a, b).unwrap().score
}

#[test]
fn every_kind_of_stereo_matches_its_golden_picture() {
    if require_gpu().is_none() {
        return;
    }
    let place = folder("golden-stereo");
    coarse_demo(&place);
    let stage = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/stages/desktop.toml");
    let stage = std::fs::read_to_string(stage).unwrap();
    let deep = "centre = [0.0, -0.035, -0.05]";
    assert!(stage.contains(deep));
    let stage = stage.replace(deep, "centre = [0.0, -0.035, -0.10]");
    std::fs::write(place.join("own.toml"), &stage).unwrap();
    std::fs::write(place.join("swapped.toml"), stage.replace("[viewer]", "swap_eyes = true\n[viewer]"))
        .unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/stereo");
    std::fs::create_dir_all(&folder).unwrap();
    let mut faults = Vec::new();
    for Kind { stereo, size, least } in KINDS {
        let name = stereo.name();
        let now = picture(&place, "own", stereo, "4");
        assert_eq!([now.width(), now.height()], size, "{name}");
        let path = folder.join(format!("{name}.png"));
        if std::env::var("GREENSTAGE_BLESS").as_deref() == Ok("1") {
            now.save(&path).unwrap();
        }
        let golden = image::open(&path).unwrap().to_rgb8();
        let alike = likeness(&golden, &now);
        let jagged = likeness(&golden, &picture(&place, "own", stereo, "1"));
        let swapped = likeness(&golden, &picture(&place, "swapped", stereo, "4"));
        println!("/// | {name} | {jagged:.4} | {swapped:.4} |");
        if alike < least {
            let actual = place.join(format!("{name}.png"));
            now.save(&actual).unwrap();
            faults
                .push(format!("{name} is {alike:.4} like its golden picture; look at {}", actual.display()));
        }
        if jagged < least {
            faults.push(format!("{name}: too strict, one sample a pixel is {jagged:.4} alike"));
        }
        if stereo != Stereo::Mono && swapped > least {
            faults.push(format!("{name}: too lax, swapped eyes are {swapped:.4} alike"));
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
