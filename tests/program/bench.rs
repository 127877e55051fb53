//! `greenstage bench --sizes` and `--effects` as JSON.

use crate::common::{block_text, folder, greenstage};
use crate::render_common;

use greenstage::base::machine::IS_TEST_BUILD;
use greenstage::effect::EFFECTS;
use render_common::require_gpu;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[test]
fn sizes_are_told_as_json_by_where_the_body_deforms() {
    if require_gpu().is_none() {
        return;
    }
    let asked = ["bench", "--sizes", "300,3000", "--stage", "desktop", "--frames", "1", "--storage", "int16"];
    let output = Command::new(env!("CARGO_BIN_EXE_greenstage"))
        .args(asked)
        .args(["--json", "--test-build"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&told["stage"], &told["columns"], &told["storage"]),
        (&"desktop".into(), &24.into(), &"int16".into())
    );
    let rows = told["sizes"].as_array().unwrap();
    let places: Vec<_> = rows.iter().map(|row| row["deformed_on"].as_str().unwrap()).collect();
    assert_eq!(places, ["cpu", "device", "cpu", "device"]);
    for row in rows {
        let number = |name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
        assert!(number("nodes") >= 300.0 && number("buffer_bytes") > 24.0 * number("nodes"), "{row}");
        assert!(number("shapes_drawn") >= 1.0 && number("shapes_culled") >= 0.0);
        let parts = row["steps_s"].as_object().unwrap();
        let sum: f64 = parts.values().map(|time| time.as_f64().unwrap()).sum();
        assert!(parts.len() == 4 && sum > 0.0, "{row}");
        // Of one frame, so the medians add up.
        assert!((number("frame_s") - sum).abs() < 1e-9 * sum + 1e-12, "{row}");
        assert!((number("frames_per_s") * number("frame_s") - 1.0).abs() < 1e-9);
    }
}

/// "no force is known of this body": the scene lists no effect that needs the stiffness of the body.
#[test]
fn the_force_loop_of_a_scene_without_forces_is_measured_and_its_file_stays() {
    if require_gpu().is_none() {
        return;
    }
    let folder = folder("bench-forces");
    let scene = format!("stage = \"desktop\"\n{}", block_text([2; 3], "model = \"rotation\""));
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    greenstage(&folder, &["precompute", "scene.toml", "--quiet"]);
    let file = || std::fs::read(folder.join("scene.green")).unwrap();
    let before = file();
    let asked = ["bench", "scene.toml", "--haptics", "--frames", "6", "--json", "--test-build"];
    let told: Value = serde_json::from_slice(&greenstage(&folder, &asked).stdout).unwrap();
    // Without a script nothing was moved, and the deformation took 0.0 µs.
    assert!(told["frames"][0]["steps_s"]["deform"].as_f64().unwrap() > 0.0, "{told}");
    let [row] = &told["haptic_ticks"].as_array().unwrap()[..] else { panic!("{told}") };
    assert_eq!((&row["body"], &row["model"]), (&"block".into(), &"rotation".into()));
    assert!(row["work_p50_s"].as_f64().unwrap() > 0.0, "{row}");
    assert!(file() == before, "what only the measurement needs is not written beside the scene");
}

/// Costs of effects on a block of 225 nodes, from the JSON.
fn costs_of_effects(test: &str, arguments: &[&str]) -> Value {
    let asked = [&["bench", "--nodes", "225", "--frames", "6", "--json", "--test-build"], arguments].concat();
    let told: Value = serde_json::from_slice(&greenstage(&folder(test), &asked).stdout).unwrap();
    told["sizes"][0].clone()
}

#[test]
fn every_effect_is_measured_beside_the_same_block_without_it() {
    // Errors take long to measure.
    let effects: Vec<_> = EFFECTS.iter().filter(|effect| !effect.measures_errors).collect();
    let asked: Vec<&str> = effects.iter().map(|effect| effect.name).collect();
    let told = costs_of_effects("bench-effects", &[&format!("--effects={}", asked.join(","))]);
    let file_bytes = |costs: &Value| costs["file_bytes"].as_f64().unwrap();
    let plain = file_bytes(&told["without"]);
    assert_eq!((told["nodes"].as_u64(), told["without"]["surface_nodes"].as_u64()), (Some(225), Some(162)));
    assert_eq!(file_bytes(&told["again"][0]["with"]), plain, "no effect costs no byte");
    let rows = told["effects"].as_array().unwrap();
    let names: Vec<_> = rows.iter().map(|row| row["effect"].as_str().unwrap()).collect();
    assert_eq!(names, asked);
    for (row, effect) in rows.iter().zip(&effects) {
        let (without, with) = (&row["without"], &row["with"]);
        let number = |key: &str| with[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"));
        assert!(number("precompute_s") > 0.0 && number("frame_mean_s") > 0.0, "{row}");
        assert!(number("frame_worst_s") >= number("frame_mean_s"), "{row}");
        let adds = !effect.requirements.is_empty() || effect.precompute.is_some();
        assert_eq!(file_bytes(with) > file_bytes(without), adds, "{row}");
        assert_eq!(row["beside"].as_array().unwrap().len(), usize::from(effect.is_heard), "{row}");
    }
}

#[test]
fn an_effect_that_a_model_refuses_and_a_block_that_takes_too_long_say_so() {
    let cut = EFFECTS.iter().find(|effect| effect.is_cut).unwrap().name;
    let told = costs_of_effects("bench-refused", &[&format!("--effects={cut}"), "--model", "stvk"]);
    let [row] = &told["effects"].as_array().unwrap()[..] else { panic!("{told}") };
    let why = row["why_not"].as_str().unwrap();
    assert!(why.starts_with("refused: body.block.model: ") && why.contains("\"stvk\""), "{why}");
    let slow = EFFECTS.iter().find(|effect| effect.measures_errors).unwrap().name;
    let told = costs_of_effects("bench-late", &[&format!("--effects={slow}"), "--limit", "2"]);
    assert_eq!(told["effects"][0]["why_not"], "not within 2 s", "{told}");
}

#[test]
fn a_test_build_measures_nothing() {
    let program = env!("CARGO_BIN_EXE_greenstage");
    let is_in_release = Path::new(program).parent().unwrap().ends_with("release");
    assert_eq!(
        IS_TEST_BUILD, !is_in_release,
        "{program}: README calls target/release/greenstage the program"
    );
    if is_in_release {
        return;
    }
    for command in [
        &["bench", "--sizes", "300"][..],
        &["bench", "--effects"],
        &["scale", "--up-to", "1000"],
        &["bench", "tube"],
    ] {
        let output = Command::new(program).args(command).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{command:?}: {said}");
        assert!(said.contains("target/release/greenstage"), "{command:?}: {said}");
        assert!(output.stdout.is_empty(), "{command:?}: {}", String::from_utf8_lossy(&output.stdout));
    }
}
