//! A body that asks for an accuracy or a budget, as the command line answers it.

use crate::common::{attempt, folder};
use std::path::Path;
use std::process::Output;

const SCENE: &str = r#"
[body.bar]
generate = { block = { size = [0.3, 0.1, 0.1], cells = [4, 2, 2] } }
material = { young = 1.0e6, poisson = 0.3 }
DEMAND
[body.bar.control.low]
nodes = { group = "xmin" }
grab = "fixed"
[body.bar.control.high]
nodes = { group = "xmax" }
grab = "dragger"
"#;

fn precompute(folder: &Path, demand: &str, options: &[&str]) -> (Output, String) {
    std::fs::write(folder.join("bar.toml"), SCENE.replace("DEMAND", demand)).unwrap();
    let output = attempt(folder, &[&["precompute", "bar.toml"], options].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

const MEASURING: &str = "measuring what accuracy costs";

/// Measured once; another demand chooses from the same table; another limit measures again.
#[test]
fn a_table_is_kept_and_chosen_from() {
    let folder = folder("plan-kept");
    let said = |demand: &str| {
        let (output, said) = precompute(&folder, demand, &[]);
        assert!(output.status.success(), "{said}");
        assert!(said.contains("body.bar: chosen: "), "{said}");
        said
    };
    assert!(said("accuracy = { displacement = 0.5 }").contains(MEASURING));
    assert!(!said("accuracy = { displacement = 0.3, force = 9.0 }").contains(MEASURING));
    assert!(!said("budget = { frame_ms = 50.0 }").contains(MEASURING));
    assert!(said("accuracy = { displacement = 0.5, largest = 3000 }").contains(MEASURING));
}

/// Nothing is taken in its place, nothing is written, and the setting that is named can be written by hand.
#[test]
fn a_demand_that_nothing_meets_ends_with_1_and_names_the_nearest_setting() {
    let folder = folder("plan-missed");
    for (demand, key) in [
        (
            "accuracy = { displacement = 1e-7 }",
            "body.bar.accuracy: no setting that was measured is as accurate",
        ),
        ("budget = { file_mb = 1e-4 }", "body.bar.budget: no setting that was measured fits the budget"),
    ] {
        let (output, said) = precompute(&folder, demand, &[]);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(key) && said.contains("times as much") && !said.contains("chosen: "), "{said}");
        assert!(!folder.join("bar.green").exists(), "{said}");
        let keys = said.split("name the setting: ").nth(1).unwrap().trim();
        assert!(keys.contains("method = \"cholesky\""), "{keys}");
        let (output, said) =
            precompute(&folder, &keys.replace(", e", "\ne").replace(", s", "\ns").replace(", m", "\nm"), &[]);
        assert!(output.status.success(), "{said}");
        std::fs::remove_file(folder.join("bar.green")).unwrap();
    }
    // What is kept stays as it is.
    assert!(precompute(&folder, "accuracy = { displacement = 0.5 }", &[]).0.status.success());
    let before = std::fs::read(folder.join("bar.green")).unwrap();
    let (output, said) = precompute(&folder, "accuracy = { displacement = 1e-7 }", &[]);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!said.contains(MEASURING), "{said}");
    assert_eq!(std::fs::read(folder.join("bar.green")).unwrap(), before);
}

#[test]
fn a_body_too_large_to_measure_names_its_own_key() {
    let folder = folder("plan-large");
    for (demand, key) in [
        ("accuracy = { displacement = 0.5, largest = 30 }", "raise body.bar.accuracy.largest"),
        ("budget = { file_mb = 5.0, largest = 30 }", "raise body.bar.budget.largest"),
    ] {
        let (output, said) = precompute(&folder, demand, &[]);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(key) && !said.contains("--largest"), "{said}");
    }
}

/// The refusal comes before the measuring, and its remedy works.
#[test]
fn a_damaged_file_is_refused_before_anything_is_measured() {
    let folder = folder("plan-damaged");
    let start = b"\x80\0\0\0\0\0\0\0{\"__metadata__\":{\"greenstage\":\"";
    std::fs::write(folder.join("bar.green"), start).unwrap();
    let (output, said) = precompute(&folder, "accuracy = { displacement = 0.5 }", &[]);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--force") && !said.contains(MEASURING), "{said}");
    let (output, said) = precompute(&folder, "accuracy = { displacement = 0.5 }", &["--force"]);
    assert!(output.status.success() && said.contains(MEASURING), "{said}");
}
