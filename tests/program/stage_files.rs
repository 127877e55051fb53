//! Stage files: the four built in, and what becomes of damaged ones.

use crate::common::damaged;
use greenstage::stage::{BUILT_IN, Eye, Stage, Stereo};
use proptest::prelude::*;
use std::path::Path;

#[test]
fn the_built_in_stages_have_the_dimensions_they_claim() {
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        assert_eq!(stage.name, name);
        assert!(!stage.description.is_empty() && stage.grid.is_some());
        for screen in &stage.screens {
            let [width_m, height_m] = screen.pixel_size_m();
            let is_square = (width_m / height_m - 1.0).abs() < 2e-3;
            let is_wide = (name, screen.name.as_str()) == ("cyberstage", "floor");
            assert_eq!(is_square, !is_wide, "{name}, {}", screen.name);
        }
    }
    let screens = |name: &str| Stage::find(name).unwrap().screens;
    assert!(screens("cyberstage").iter().all(|screen| screen.pixels == [1280, 1024]));
    let slope = screens("workbench-one-sided")[0].axes()[1].y.asin().to_degrees();
    assert!((slope - 20.0).abs() < 1e-9, "{slope}");
    assert_eq!(Stage::find("desktop").unwrap().stereo, Stereo::Mono);
    assert_eq!(Stage::find("desktop").unwrap().stereo.eyes(), [Eye::Centre]);
}

#[test]
fn a_path_is_loaded_from_disk_even_if_it_is_named_like_a_built_in() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("workbench.toml");
    std::fs::write(&path, BUILT_IN[0].1.replace("ipd = 0.064", "ipd = 0.060")).unwrap();
    assert_eq!(Stage::find(path.to_str().unwrap()).unwrap().viewer.ipd_m, 0.060);
    assert_eq!(Stage::find("workbench").unwrap().viewer.ipd_m, 0.064);
}

/// Whatever is accepted can be projected on: every eye of the viewer sees every screen through finite numbers.
fn parse_and_use(text: &str) {
    let Ok(stage) = Stage::parse(text, Path::new("any.toml")) else { return };
    assert!(!stage.to_string().is_empty());
    for screen in &stage.screens {
        let head = stage.viewer.room_from_head;
        let view = screen
            .view(&stage.viewer.eye_in_room(&head, Eye::Centre), 0.05)
            .expect("an accepted screen is seen from the viewer's start");
        assert!(view.clip_from_room.iter().all(|x| x.is_finite()), "{text}");
        assert!(view.near_m > 0.0, "{text}");
    }
}

/// A built-in file with one number replaced by another.
fn with_number(text: &str, nth: usize, number: &str) -> String {
    let is_part = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let starts: Vec<usize> = text
        .char_indices()
        .filter(|&(i, c)| c.is_ascii_digit() && !text[..i].ends_with(is_part))
        .map(|(i, _)| i)
        .collect();
    let start = starts[nth % starts.len()];
    let end = text[start..].find(|c: char| !is_part(c)).map_or(text.len(), |length| start + length);
    format!("{}{number}{}", &text[..start], &text[end..])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_text_panics(text in "\\PC*") {
        parse_and_use(&text);
    }

    #[test]
    fn no_damaged_file_panics(
        which in 0..BUILT_IN.len(),
        from in any::<prop::sample::Index>(),
        length in 0..60usize,
        filling in "[\\[\\]=\"., \n0-9a-z-]{0,20}",
    ) {
        parse_and_use(&damaged(BUILT_IN[which].1, &from, length, &filling));
    }

    #[test]
    fn no_number_panics(which in 0..BUILT_IN.len(), nth in 0..200usize, number in any::<f64>()) {
        parse_and_use(&with_number(BUILT_IN[which].1, nth, &format!("{number:?}").to_lowercase()));
    }

    #[test]
    fn small_changes_of_numbers_are_judged_without_panic(
        which in 0..BUILT_IN.len(), nth in 0..200usize, number in -3.0..3.0f64
    ) {
        parse_and_use(&with_number(BUILT_IN[which].1, nth, &number.to_string()));
    }
}
