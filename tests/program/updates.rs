//! Released control elements and changed moduli, as a user asks for them.

use crate::common::{attempt, csv_rows, greenstage, project, text};

const SCENE: &str = "[body.bar]\n\
    generate = { block = { size = [1.0, 0.2, 0.2], cells = [10, 2, 2] } }\n\
    material = { young = 1.0e6, poisson = 0.3 }\n\
    effects = [\"haptics\"]\n\
    UPDATES\
    control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
    control.middle = { nodes = { plane = { point = [0, 0, 0], normal = [1, 0, 0], distance = 0.01 } }, grab = \"dragger\" }\n";
const RIGHT: &str = "control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
const POSES: &str = "[[pose]]\nname = \"bent\"\ncontrol.middle = { translation = [0.01, 0.02, 0.0] }\n";

/// What is released is not there: the same as of a scene that never had it, in a separate precomputation.
#[test]
fn a_released_end_is_an_end_that_is_not_held() {
    let all = SCENE.replace("UPDATES", "updates = { release = [\"right\"] }\n") + RIGHT;
    let with = project("updates_with", None, &all, POSES);
    let without = project("updates_without", None, &SCENE.replace("UPDATES", ""), POSES);
    let arguments = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "out"];
    greenstage(&without, &arguments);
    greenstage(&with, &[&arguments[..], &["--release", "bar.right"]].concat());
    let read = |name: &str, keys: usize| [&with, &without].map(|folder| csv_rows(&folder.join(name), keys));
    let [u, expected] = read("out.csv", 2);
    assert_eq!(u.len(), expected.len());
    for ((node, u), (same, expected)) in u.iter().zip(&expected) {
        assert_eq!(node, same);
        assert!(u.iter().zip(expected).all(|(a, b)| (a - b).abs() < 2e-8), "{node}: {u:?} {expected:?}");
    }
    let [forces, expected] = read("out.forces.csv", 2);
    let largest = expected[0].1.iter().chain(&expected[1].1).fold(0.0_f64, |a, b| a.max(b.abs()));
    assert_eq!((forces.len(), expected.len()), (2, 2), "left and middle");
    for ((_, force), (_, expected)) in forces.iter().zip(&expected) {
        assert!(
            force.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-8 * largest),
            "{force:?} {expected:?}"
        );
    }
    // Held, the end would resist.
    greenstage(&with, &arguments);
    let held = csv_rows(&with.join("out.forces.csv"), 2);
    assert!(
        held.len() == 3 && held[1].1.iter().zip(&expected[1].1).any(|(a, b)| (a - b).abs() > 0.1 * largest)
    );
}

#[test]
fn what_was_not_prepared_is_refused_with_the_key_to_write() {
    let folder = project("updates_refused", None, &(SCENE.replace("UPDATES", "") + RIGHT), POSES);
    let arguments = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "out", "--release", "bar.right"];
    let output = attempt(&folder, &arguments);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("write updates = { release = [\"right\"] } into [body.bar]"), "{told}");
    let bent =
        (SCENE.replace("UPDATES", "model = \"reduced\"\nupdates = { release = [\"right\"] }\n")) + RIGHT;
    let folder = project("updates_model", None, &bent, POSES);
    let output = attempt(&folder, &arguments);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("body.bar.updates") && told.contains("write model = \"linear\""), "{told}");
}
