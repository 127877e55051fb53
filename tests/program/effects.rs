//! Effects that a scene does not list cost nothing: no precomputation, no section in the file, no memory, no call in the frame,
//! no output.

use crate::common;

use common::{coarse_demo, folder, greenstage, text};
use greenstage::deform::{Deformer, ROTATION};
use greenstage::effect::EFFECTS;
use greenstage::green::GreenFile;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// 12 coefficients of two control elements squared, in f64.
const STIFFNESS_BYTES: usize = 24 * 24 * 8;
/// Bytes for the energy of the model `rotation`, which has a cubic part.
const CUBIC_BYTES: usize = 24 * 25 * 26 / 6 * 8;

/// The demo with few nodes in a separate folder, with or without force and torque.
fn tube(name: &str, effects: &str) -> PathBuf {
    let place = folder(name);
    let scene = coarse_demo(&place);
    let text = std::fs::read_to_string(&scene).unwrap();
    let coarse = "radial = 2, around = 20, along = 31";
    assert!(text.contains("effects = []") && text.contains(coarse));
    let text = text.replace(coarse, "radial = 1, around = 12, along = 16");
    std::fs::write(&scene, text.replace("effects = []", &format!("effects = [{effects}]"))).unwrap();
    let poses = r#"pose = [{ name = "moved", control.right = { translation = [0.01, 0.02, 0.0] } }]"#;
    std::fs::write(place.join("poses.toml"), poses).unwrap();
    place
}

fn said(place: &Path, arguments: &[&str]) -> (String, String) {
    let output = greenstage(place, arguments);
    (text(&output.stdout), text(&output.stderr))
}

/// Bytes of every tensor in the file, and of all together.
fn tensors(path: &Path) -> (BTreeMap<String, Vec<u8>>, usize) {
    let bytes = std::fs::read(path).unwrap();
    let (header, _) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
    let container = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let tensors =
        container.tensors().into_iter().map(|(name, tensor)| (name, tensor.data().to_vec())).collect();
    (tensors, bytes.len() - 8 - header)
}

#[test]
fn without_haptics_there_is_no_stiffness_step_and_no_section_of_the_file() {
    let (plain, haptic) = (tube("effects-plain", ""), tube("effects-haptic", r#""haptics""#));
    let (table, progress) = said(&plain, &["precompute", "tube.toml", "--verbose"]);
    assert!(table.contains("assembly") && !table.contains("stiffness"), "{table}");
    assert!(progress.contains("assembly") && !progress.contains("stiffness"), "{progress}");
    assert!(!progress.contains("errors of") && !table.contains("errors of the model"), "{progress}\n{table}");
    let (table, progress) = said(&haptic, &["precompute", "tube.toml", "--verbose"]);
    assert!(table.contains("stiffness") && progress.contains("stiffness"), "{table}\n{progress}");
    assert!(!progress.contains("errors of") && !table.contains("errors of the model"), "{progress}\n{table}");

    let [(plain, plain_bytes), (haptic, haptic_bytes)] =
        [plain, haptic].map(|place| tensors(&place.join("tube.green")));
    println!("tensors: {plain_bytes} bytes, with haptics {haptic_bytes}");
    assert_eq!(haptic_bytes - plain_bytes, STIFFNESS_BYTES + CUBIC_BYTES);
    assert_eq!(haptic["tube/cubic"].len(), CUBIC_BYTES);
    assert_eq!(haptic["tube/stiffness"].len(), STIFFNESS_BYTES);
    let others: BTreeMap<_, _> = haptic
        .into_iter()
        .filter(|(name, _)| !["tube/stiffness", "tube/cubic"].contains(&name.as_str()))
        .collect();
    assert_eq!(plain, others, "the other tensors are the same to the byte");
}

/// `check` explains how to measure the errors to expect, and reports them once they are measured.
#[test]
fn check_tells_the_errors_that_were_measured_and_how_to_measure_them() {
    let place = tube("effects-errors", "");
    let (told, _) = said(&place, &["check", "tube.toml"]);
    assert!(told.contains("for effects = [\"expected_errors\"]"), "{told}");
    let scene = place.join("tube.toml");
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, text.replace("effects = []", "effects = [\"expected_errors\"]")).unwrap();
    let (told, _) = said(&place, &["check", "tube.toml"]);
    assert!(told.contains("`greenstage precompute tube.toml` measures them"), "{told}");
    let (made, _) = said(&place, &["precompute", "tube.toml"]);
    assert!(made.contains("tube: errors of the model"), "{made}");
    let (told, _) = said(&place, &["check", "tube.toml"]);
    let rows: Vec<&str> = told.lines().filter(|line| line.starts_with("tube  right")).collect();
    let count = |by: &str, of: &str| rows.iter().filter(|row| row.contains(by) && row.contains(of)).count();
    let turns = ["right  bent to", "right  twisted to", "bent and twisted to", "turned in place, shifted to"];
    let pulls = ["pulled away by", "pressed by", "pushed, free to turn, to"];
    let (turns, pulls) =
        (turns.map(|by| count(by, "model rotation")), pulls.map(|by| count(by, "model rotation")));
    assert!(turns[..3] == [5, 5, 5] && turns[3] >= 4 && pulls == [3, 2, 3], "{turns:?} {pulls:?}: {told}");
    assert!(count("right  bent to", "mesh of tet4") >= 2, "by the equilibria on a finer mesh: {told}");
    assert_eq!(count("in its worst small motion", "mesh of tet4"), 1, "by the linear theory: {told}");
    let (json, _) = said(&place, &["check", "tube.toml", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let model = &json["expected_errors"]["tube"]["moved"][0]["model"]["turned"]["bent"];
    assert_eq!((model[2]["angle"].as_f64(), model.as_array().map(Vec::len)), (Some(30.0), Some(5)));
    assert!(model[2]["force"].as_f64().is_some_and(|force| (0.01..0.5).contains(&force)), "{model}");
    let (shown, _) = said(&place, &["inspect", "tube.green"]);
    assert!(shown.contains("  bent to 30°: forces "), "{shown}");
}

#[test]
fn without_haptics_neither_deform_nor_the_deformer_tells_forces() {
    for (effects, forces) in [("", false), (r#""haptics""#, true)] {
        let place = tube(&format!("effects-deform-{forces}"), effects);
        let (told, _) = said(&place, &["deform", "tube.toml", "--poses", "poses.toml", "-o", "out"]);
        assert!(place.join("out.csv").exists());
        assert_eq!(place.join("out.forces.csv").exists(), forces);
        assert_eq!(told.contains("out.forces.csv"), forces, "{told}");
        assert_eq!(
            told.contains("force error unknown: effect \"expected_errors\" measures it"),
            forces,
            "{told}"
        );

        let file = Arc::new(GreenFile::open(&place.join("tube.green")).unwrap());
        let mut deformer = Deformer::new(file, "tube", &ROTATION).unwrap();
        assert_eq!(deformer.wrenches().is_some(), forces);
        let mut poses = deformer.poses.clone();
        poses[1].translation.x = 0.01;
        deformer.evaluate(&poses).unwrap();
        assert_eq!(deformer.wrenches().is_some(), forces);
    }
}

/// An effect that only draws asks for no number of the file; a curve asks for those of forces, and for no errors.
#[test]
fn ghosts_precompute_nothing_and_a_curve_what_forces_need() {
    let [plain, ghosts, curve] = [
        ("plain-of-ghosts", ""),
        ("ghosts", r#""ghost_rest", "ghost_equilibrium""#),
        ("curve", r#""force_curve""#),
    ]
    .map(|(name, effects)| {
        let place = tube(&format!("effects-{name}"), effects);
        let (table, progress) = said(&place, &["precompute", "tube.toml"]);
        assert!(!progress.contains("errors of") && table.contains("assembly"), "{name}: {progress}");
        tensors(&place.join("tube.green"))
    });
    assert_eq!(plain, ghosts, "the same to the byte");
    assert_eq!(curve.1 - plain.1, STIFFNESS_BYTES + CUBIC_BYTES);
    let place = tube("effects-curve-asked", "");
    let output =
        common::program(&place, &["render", "tube.toml", "-o", "out", "--curve", "c.csv"]).output().unwrap();
    let told = text(&output.stderr);
    assert!(output.status.code() == Some(2) && told.contains("lists the effect \"force_curve\""), "{told}");
}

/// The section of `stress` has no byte where there is one material, the other tensors are the same to the byte; `deform` reports
/// stresses, and where the limit is passed, for the scene that lists it alone.
#[test]
fn without_stress_there_is_no_section_and_no_word_of_a_limit() {
    let listed = |name: &str, effects: &str| {
        let place = tube(name, effects);
        let scene = place.join("tube.toml");
        let text = std::fs::read_to_string(&scene).unwrap();
        let limited = text.replace("poisson = 0.3 }", "poisson = 0.3, limit = { strain = 0.001 } }");
        assert_ne!(text, limited);
        std::fs::write(&scene, limited).unwrap();
        let (told, _) = said(&place, &["deform", "tube.toml", "--poses", "poses.toml", "-o", "out"]);
        (place, told)
    };
    let ((plain, told), (stressed, of_stress)) =
        (listed("stress-plain", ""), listed("stress", r#""stress""#));
    assert!(!told.contains("limit on") && !plain.join("out.stress.csv").exists(), "{told}");
    assert!(of_stress.contains("\n  von Mises stress at most"), "{of_stress}");
    assert!(of_stress.contains("First yield: "), "{of_stress}");
    assert!(of_stress.contains("above its 0.10 % limit on"), "{of_stress}");
    let table = std::fs::read_to_string(stressed.join("out.stress.csv")).unwrap();
    let row: Vec<&str> = table.lines().nth(1).unwrap().split(',').collect();
    let [strain, of_limit, passed] = [3, 5, 6].map(|k: usize| row[k].parse::<f64>().unwrap());
    assert!((of_limit - strain / 0.001).abs() < 1e-6 * of_limit && strain > 0.001 && passed > 0.1, "{table}");
    let vtu = |place: &Path| std::fs::read_to_string(place.join("out.vtu")).unwrap();
    for field in ["von Mises stress moved", "largest principal strain moved", "size of displacement moved"] {
        assert!(vtu(&stressed).contains(field) && !vtu(&plain).contains(field), "{field}");
    }
    let [(plain_tensors, plain_bytes), (mut tensors, bytes)] =
        [&plain, &stressed].map(|place| tensors(&place.join("tube.green")));
    assert_eq!(tensors.remove("tube/stress/material").map(|numbers| numbers.len()), Some(0));
    assert_eq!((plain_tensors, plain_bytes), (tensors, bytes));

    // Another limit is no other body: the file stays.
    let before = std::fs::read(plain.join("tube.green")).unwrap();
    let scene = plain.join("tube.toml");
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, text.replace("strain = 0.001", "strain = 0.5")).unwrap();
    let (_, progress) = said(&plain, &["deform", "tube.toml", "--poses", "poses.toml", "-o", "out"]);
    assert!(
        !progress.contains("stale") && std::fs::read(plain.join("tube.green")).unwrap() == before,
        "{progress}"
    );
    let (told, _) = said(&plain, &["check", "tube.toml"]);
    assert!(told.contains("effects = [\"stress\"] shows"), "{told}");
}

/// A file that was made for other effects is never taken for the scene's own, in either direction.
#[test]
fn another_list_of_effects_makes_the_file_anew() {
    let place = tube("effects-change", "");
    greenstage(&place, &["precompute", "--quiet", "tube.toml"]);
    let scene = place.join("tube.toml");
    let text = std::fs::read_to_string(&scene).unwrap();
    for (effects, forces) in [(r#"effects = ["haptics"]"#, true), ("effects = []", false)] {
        std::fs::write(&scene, text.replace("effects = []", effects)).unwrap();
        greenstage(&place, &["precompute", "--quiet", "tube.toml"]);
        let (tensors, _) = tensors(&place.join("tube.green"));
        assert_eq!(tensors.contains_key("tube/stiffness"), forces, "{effects}");
    }
}

/// The frame names no effect, except in the files that prepare a body and that compute its force; it asks for a force only of a
/// body whose scene lists one (`forces_are_told_only_of_bodies_whose_scene_wants_them` holds it to that).
#[test]
fn the_frame_calls_no_effect_that_is_not_listed() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files: Vec<_> =
        ["application", "bodies", "offscreen"].map(|name| source.join(format!("display/{name}.rs"))).into();
    for folder in ["world", "render"] {
        files.extend(std::fs::read_dir(source.join(folder)).unwrap().map(|entry| entry.unwrap().path()));
    }
    // Of these, the first is entered in the frame and where an overlay or a caption asks, the second before the frame.
    let own = ["force", "force_scale"].map(|name| source.join(format!("world/{name}.rs")));
    let (mut read, mut entered) = (0, 0);
    for file in files.iter().filter(|path| path.is_file() && !own.contains(path)) {
        let text = std::fs::read_to_string(file).unwrap();
        read += 1;
        for name in EFFECTS.iter().map(|effect| effect.name).chain(["wrenches", "effect::"]) {
            // What is cut off a picture is no effect.
            let speaks = match name {
                "cut" => text.contains("\"cut\"") || text.contains("cut::"),
                _ => text.contains(name),
            };
            assert!(!speaks, "{} speaks of {name}", file.display());
        }
        for (at, _) in text.match_indices("force::held_force(") {
            entered += 1;
            let before = &text[at.saturating_sub(160)..at];
            let is_asked = before.contains("if let Some(scale) = self.frame.bodies[b].force_scale");
            assert!(is_asked, "{} does not ask whether it is listed", file.display());
        }
    }
    assert!(
        own.iter().all(|file| file.is_file()) && entered == 1 && read > 12,
        "{read} files, entered {entered} times"
    );
}

/// Effects act in the order of the program's table, whatever the scene's.
#[test]
fn inspect_tells_in_which_order_the_effects_of_a_body_act() {
    let place = tube("effects-order", r#""force_curve", "stress""#);
    let (told, _) = said(&place, &["inspect", "tube.toml"]);
    assert!(told.contains("  its effects act in this order: stress, force_curve\n"), "{told}");
    let place = tube("effects-alone", r#""stress""#);
    let (told, _) = said(&place, &["inspect", "tube.toml"]);
    assert!(told.contains("effects stress") && !told.contains("in this order"), "{told}");
}
