//! `greenstage render --windows`: each window's picture as `view` presents it, against the pictures of single eyes.

use crate::common::{attempt, coarse_demo, folder, greenstage};
use crate::render_common::require_gpu;
use greenstage::render::Composite;
use image::{RgbaImage, imageops};
use std::path::Path;

/// Pictures by name of the bent body, the middle one of three frames.
fn pictures(place: &Path, stage: &str, more: &[&str]) -> Vec<(String, RgbaImage)> {
    let output = place.join(format!("out-{}", more.concat()));
    let fixed = ["render", "tube.toml", "--frames", "3", "--samples", "1", "--stage", stage, "-o"];
    greenstage(place, &[&fixed[..], &[output.to_str().unwrap()], more].concat());
    let named = |path: std::path::PathBuf| {
        let file = path.file_name()?.to_str()?.to_owned();
        let name = file.strip_prefix("frame0001-")?.strip_suffix(".png")?.to_owned();
        Some((name, image::open(&path).unwrap().to_rgba8()))
    };
    let mut found: Vec<_> =
        std::fs::read_dir(output).unwrap().filter_map(|entry| named(entry.unwrap().path())).collect();
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

fn named<'a>(pictures: &'a [(String, RgbaImage)], name: &str) -> &'a RgbaImage {
    let names: Vec<_> = pictures.iter().map(|(name, _)| name.as_str()).collect();
    &pictures.iter().find(|(found, _)| found == name).unwrap_or_else(|| panic!("no {name} in {names:?}")).1
}

/// Pixels that differ by more than a rounding of the colour.
fn different(a: &RgbaImage, b: &RgbaImage) -> usize {
    assert_eq!(a.dimensions(), b.dimensions());
    let differs =
        |(a, b): &(&image::Rgba<u8>, &image::Rgba<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 2);
    a.pixels().zip(b.pixels()).filter(differs).count()
}

#[test]
fn the_windows_of_a_two_sided_workbench_are_its_pictures() {
    let Some(_) = require_gpu() else { return };
    let place = folder("render-windows-workbench");
    coarse_demo(&place);
    let eyes = pictures(&place, "workbench", &["--window-scale", "0.25"]);
    let windows = pictures(&place, "workbench", &["--window-scale", "0.25", "--windows"]);
    let names: Vec<_> = eyes.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["table-left", "table-right", "wall-left", "wall-right"]);
    for (name, picture) in &eyes {
        assert!(picture == named(&windows, name), "{name}");
    }
    assert_eq!(windows.len(), 4);
    assert!(different(named(&eyes, "table-left"), named(&eyes, "table-right")) > 500, "the eyes differ");
}

/// One window whose rows take turns, by their place on the desktop, and one with a part of the other screen, its eyes
/// swapped: each is made of the eyes' own pictures.
#[test]
fn windows_of_a_stage_file_are_joined_cropped_and_swapped_as_they_are_presented() {
    let Some(_) = require_gpu() else { return };
    let place = folder("render-windows-own");
    coarse_demo(&place);
    let bench = include_str!("../../configs/stages/workbench.toml");
    let own = "[[window]]\nname = \"beamer: one\"\nscreen = \"wall\"\nstereo = \"rows\"\nat = [100, 33]\n\
               size = [320, 256]\n\
               [[window]]\nname = \"part\"\nscreen = \"table\"\nstereo = \"side_by_side\"\nswap_eyes = true\n\
               crop = [320, 0, 640, 512]\nsize = [320, 128]\nat = [500, 0]\n";
    std::fs::write(place.join("own.toml"), format!("{bench}\n{own}")).unwrap();
    let eyes = pictures(&place, "own.toml", &["--window-scale", "0.25"]);
    let windows = pictures(&place, "own.toml", &["--windows"]);
    assert_eq!(windows.len(), 2);

    let wall = [named(&eyes, "wall-left"), named(&eyes, "wall-right")];
    let rows = named(&windows, "beamer--one");
    let joined = |top: i32| Composite::interlaced([320, 256], [0, 1]).compose(wall, [320, 256], [100, top]);
    assert_eq!(different(rows, &joined(33)), 0);
    assert!(different(rows, &joined(34)) > 300, "the parity of the desktop's rows is seen");

    let part = named(&windows, "part");
    for (half, eye) in [(0, "table-right"), (160, "table-left")] {
        let shown = imageops::crop_imm(part, half, 0, 160, 128).to_image();
        let of = |eye: &str| imageops::crop_imm(named(&eyes, eye), 80, 0, 160, 128).to_image();
        let (off, other) = (different(&shown, &of(eye)), different(&shown, &of("table-left")));
        println!("{eye}: {off} pixels differ");
        assert!(off < 40, "{eye}: {off} pixels differ");
        assert!(half == 160 || other > 500, "the eyes differ: {other}");
    }
}

#[test]
fn a_kind_of_stereo_is_not_asked_of_windows_that_have_their_own() {
    let place = folder("render-windows-stereo");
    let output = attempt(&place, &["render", "none.toml", "-o", "out", "--windows", "--stereo", "rows"]);
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("--windows") && said.contains("--stereo"), "{said}");
}
