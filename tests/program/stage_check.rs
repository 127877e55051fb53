//! `greenstage check STAGE` reports all faults at once, and has an exit status.

use crate::common;

use common::{folder, program, text};
use greenstage::stage::BUILT_IN;

/// Exit status and what was said, without a display.
fn check(arguments: &[&str], place: &std::path::Path) -> (i32, String) {
    let mut check = program(place, &[&["check"], arguments].concat());
    let output = check.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    (output.status.code().unwrap(), text(&output.stdout))
}

#[test]
fn every_built_in_stage_is_without_errors() {
    let place = folder("check-built-in");
    for (name, _) in BUILT_IN {
        let (status, said) = check(&[name], &place);
        println!("{name}\n{said}");
        assert!(status == 0 && said.contains("\n0 errors, "), "{name}: {said}");
    }
}

#[test]
fn all_that_is_wrong_with_a_stage_is_told_at_once() {
    let place = folder("check-stage");
    let bench = BUILT_IN[0].1;
    // An eye distance of 9 cm, a skewed wall, a table that is too wide by 20 mm, a window beyond the monitor, and one
    // of a screen that is not there.
    let text = bench
        .replace("ipd = 0.064", "ipd = 0.09")
        .replace("upper_left = [-0.80, 2.18, 0.00]", "upper_left = [-0.75, 2.18, 0.00]")
        .replace("[-0.80, 0.90, 0.00]      # the shared edge\npixels", "[-0.82, 0.90, 0.00]\npixels")
        .replace("[-0.80, 0.90, 1.28]", "[-0.82, 0.90, 1.28]")
        + "[[window]]\nscreen = \"wall\"\nstereo = \"rows\"\nat = [2000, 0]\n\
           [[window]]\nscreen = \"floor\"\nstereo = \"rows\"\n\
           [[monitor]]\nname = \"DP-1\"\nat = [0, 0]\nsize = [1920, 1080]\n";
    std::fs::write(place.join("bench.toml"), &text).unwrap();
    let (status, said) = check(&["bench.toml"], &place);
    println!("{said}");
    assert_eq!(status, 2);
    let line = |needle: &str| 1 + text.lines().position(|line| line == needle).unwrap();
    for part in [
        &format!("error: bench.toml:{}: ipd is 0.09 m", line("[viewer]")),
        "screen `wall`: edges meet at 87.76°",
        "window `window 2`: unknown screen \"floor\"",
        "100 % of its 1280 × 1024 pixels at (2000, 0) lie on no monitor",
        "the second ends 20.0 mm short of the first at one end",
        "warning: screen.table: no window shows it",
        "of the file: 0 is `DP-1`, 1920 × 1080 at (0, 0)",
        "4 errors, 3 warnings, 4 notes",
    ] {
        assert!(said.contains(part), "no `{part}` in\n{said}");
    }
    let (status, said) = check(&["bench.toml", "--json"], &place);
    let value: serde_json::Value = serde_json::from_str(&said).unwrap();
    let errors =
        value["findings"].as_array().unwrap().iter().filter(|finding| finding["severity"] == "error");
    assert_eq!((status, errors.count()), (2, 4));
}

#[test]
fn a_misspelt_stage_is_answered_with_the_nearest() {
    let place = folder("check-misspelt");
    for command in ["check", "inspect"] {
        let output = program(&place, &[command, "worbench"]).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2));
        assert!(
            said.contains("no stage is named `worbench`; did you mean `workbench`?"),
            "{command}: {said}"
        );
    }
}

/// Tables of trackers alone are a part of a stage, and a head whose sensors are refused is no head without one.
#[test]
fn faults_of_tracking_are_told_as_a_stage_s() {
    let place = folder("check-tracking");
    let tracking =
        "[tracker.lab]\nvrpn = \"Tracker0@127.0.0.1\"\n[sensor.head]\ntracker = \"labb\"\nid = 0\n";
    std::fs::write(place.join("part.toml"), tracking).unwrap();
    let said = text(&program(&place, &["check", "part.toml"]).output().unwrap().stderr);
    assert!(said.contains("part.toml:1:1: missing field `name`"), "{said}");
    let whole = BUILT_IN[0].1.replace("ipd = 0.064", "ipd = 0.064\nhead = \"head\"") + tracking;
    std::fs::write(place.join("whole.toml"), whole).unwrap();
    let (status, said) = check(&["whole.toml"], &place);
    assert!(status == 2 && said.contains("did you mean \"lab\"?"), "{said}");
    assert!(!said.contains("no sensor"), "{said}");
}
