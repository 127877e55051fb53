//! Every kind of stereo against pictures that people looked at, as `greenstage render --stereo KIND` makes them.
//!
//! `GREENSTAGE_BLESS=1 cargo test --profile quick --test pictures golden_stereo` writes tests/golden/stereo/*.png anew; look at them then.

use crate::common::{coarse_demo, folder, greenstage};
use crate::golden::{golden_picture, likeness};
use crate::render_common::require_gpu;
use greenstage::stage::Stereo;
use image::RgbImage;
use std::path::{Path, PathBuf};

/// A kind of stereo, and the size of its picture.
struct Kind {
    stereo: Stereo,
    size: [u32; 2],
}

/// Likeness as in tests/pictures/golden.rs, of a monitor of 192 × 120 pixels with the tube bent by 30°. For rows, columns and
/// checkerboard swapped eyes are the same as a parity that is off by one.
///
/// | kind | one sample a pixel | eyes swapped |
/// |---|---|---|
/// | side_by_side | 0.9842 | 0.7596 |
/// | side_by_side_half | 0.9757 | 0.7489 |
/// | top_bottom | 0.9842 | 0.7596 |
/// | top_bottom_half | 0.9683 | 0.7687 |
/// | frame_packing | 0.9841 | 0.7684 |
/// | anaglyph | 0.9830 | 0.9034 |
/// | anaglyph_grey | 0.9826 | 0.9366 |
/// | anaglyph_half_colour | 0.9837 | 0.9209 |
/// | anaglyph_dubois | 0.9826 | 0.9202 |
/// | rows | 0.9832 | 0.7411 |
/// | columns | 0.9857 | 0.7387 |
/// | checkerboard | 0.9791 | 0.7378 |
/// | mono | 0.9834 | 1.0000 |
/// | left | 0.9851 | 0.7596 |
/// | right | 0.9834 | 0.7596 |
///
/// `LEAST` lies between, and both sides are tested.
const LEAST: f64 = 0.955;
const SIZE: [u32; 2] = [192, 120];
const KINDS: [Kind; 15] = [
    Kind { stereo: Stereo::SideBySide, size: [384, 120] },
    Kind { stereo: Stereo::SideBySideHalf, size: SIZE },
    Kind { stereo: Stereo::TopBottom, size: [192, 240] },
    Kind { stereo: Stereo::TopBottomHalf, size: SIZE },
    Kind { stereo: Stereo::FramePacking, size: [192, 245] },
    Kind { stereo: Stereo::Anaglyph, size: SIZE },
    Kind { stereo: Stereo::AnaglyphGrey, size: SIZE },
    Kind { stereo: Stereo::AnaglyphHalfColour, size: SIZE },
    Kind { stereo: Stereo::AnaglyphDubois, size: SIZE },
    Kind { stereo: Stereo::Rows, size: SIZE },
    Kind { stereo: Stereo::Columns, size: SIZE },
    Kind { stereo: Stereo::Checkerboard, size: SIZE },
    Kind { stereo: Stereo::Mono, size: SIZE },
    Kind { stereo: Stereo::Left, size: SIZE },
    Kind { stereo: Stereo::Right, size: SIZE },
];

/// The picture halfway through the script, on a monitor with 5 cm more depth between glass and body than the desktop
/// stage has, so that the eyes differ.
fn picture(place: &Path, stage: &str, stereo: Stereo, samples: &str) -> RgbImage {
    let output = format!("out-{stage}-{}-{samples}", stereo.name());
    let stage = format!("{stage}.toml");
    let fixed = ["render", "tube.toml", "--frames", "3", "--window-scale", "0.15", "-o", &output];
    let varied = ["--stage", &stage, "--samples", samples, "--shadows", "off", "--stereo", stereo.name()];
    greenstage(place, &[&fixed[..], &varied].concat());
    let found: Vec<PathBuf> =
        std::fs::read_dir(place.join(output)).unwrap().map(|e| e.unwrap().path()).collect();
    let halfway: Vec<_> = found
        .iter()
        .filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with("frame0001"))
        .collect();
    assert_eq!(halfway.len(), 1, "{}: one picture for one screen: {found:?}", stereo.name());
    image::open(halfway[0]).unwrap().to_rgb8()
}

#[test]
fn every_kind_of_stereo_matches_its_golden_picture() {
    let Some(_) = require_gpu() else { return };
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
    let mut faults = Vec::new();
    for Kind { stereo, size } in KINDS {
        let name = stereo.name();
        let now = picture(&place, "own", stereo, "4");
        assert_eq!([now.width(), now.height()], size, "{name}");
        let golden = golden_picture(&format!("stereo/{name}"), &now);
        let alike = likeness(&golden, &now);
        let jagged = likeness(&golden, &picture(&place, "own", stereo, "1"));
        let swapped = likeness(&golden, &picture(&place, "swapped", stereo, "4"));
        println!("/// | {name} | {jagged:.4} | {swapped:.4} |");
        if alike < LEAST {
            let actual = place.join(format!("{name}.png"));
            now.save(&actual).unwrap();
            faults
                .push(format!("{name} is {alike:.4} like its golden picture; look at {}", actual.display()));
        }
        if jagged < LEAST {
            faults.push(format!("{name}: too strict, one sample a pixel is {jagged:.4} alike"));
        }
        if stereo != Stereo::Mono && swapped > LEAST {
            faults.push(format!("{name}: too lax, swapped eyes are {swapped:.4} alike"));
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
