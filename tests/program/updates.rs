//! Released control elements and changed moduli, as a user asks for them.

use crate::common::{attempt, csv_rows, greenstage, project, text};
use greenstage::mesh::{self, Block, block};

const SCENE: &str = "[body.bar]\n\
    generate = { block = { size = [1.0, 0.2, 0.2], cells = [10, 2, 2] } }\n\
    material = { young = 1.0e6, poisson = 0.3 }\n\
    effects = [\"haptics\"]\n\
    UPDATES\
    control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
    control.middle = { nodes = { plane = { point = [0, 0, 0], normal = [1, 0, 0], distance = 0.01 } }, grab = \"dragger\" }\n";
const RIGHT: &str = "control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
const POSES: &str = "[[pose]]\nname = \"bent\"\ncontrol.middle = { translation = [0.01, 0.02, 0.0] }\n";

/// A released element is not there: the result is that of a scene that never had it, in a separate precomputation.
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

/// A region in the middle of a block, made stiffer by fourteen decades, floats in the rest: a shift of all by 1 m cost 41 kN.
#[test]
fn an_update_passes_the_check_of_a_fresh_solve() {
    let scene = "[body.b]\nmesh = \"m.msh\"\nmaterial = { young = 1e6, poisson = 0.3 }\n\
        region.2 = { young = 1e6, poisson = 0.3 }\nupdates = { modulus = [\"2\"] }\n\
        control.L = { nodes = { plane = { point = [-1, 0, 0], normal = [1, 0, 0], distance = 0.01 } }, grab = \"dragger\" }\n\
        control.R = { nodes = { plane = { point = [1, 0, 0], normal = [1, 0, 0], distance = 0.01 } }, grab = \"dragger\" }\n";
    let poses = "[[pose]]\nname = \"r\"\ncontrol.R = { translation = [1.0, 0.0, 0.0] }\n\
        control.L = { translation = [1.0, 0.0, 0.0] }\n";
    let folder = project("updates_decades", None, scene, poses);
    let mut block = block(&Block { size: [2.0, 1.0, 1.0], cells: [6, 2, 2] }).unwrap();
    let middle =
        |tet: &[u32; 4]| tet.iter().map(|&n| block.nodes[n as usize].x).sum::<f64>().abs() < 4.0 / 3.0;
    block.regions = block.tets.iter().map(|tet| 1 + u32::from(middle(tet))).collect();
    mesh::save(&folder.join("m.msh"), &block, None).unwrap();
    let deform = |young: &str| {
        let young = format!("b.2={young}");
        attempt(&folder, &["deform", "scene.toml", "--poses", "poses.toml", "-o", "out", "--young", &young])
    };
    let output = deform("1e20");
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("region 2 floats inside material that is 1.0e14 times softer"), "{told}");
    // Where the update has too few digits and a fresh solve has enough, the body is solved anew.
    let output = deform("1e13");
    let told = text(&output.stderr);
    assert!(output.status.success() && told.contains("the body is solved anew"), "{told}");
    let rows = csv_rows(&folder.join("out.csv"), 2);
    assert!(rows.iter().all(|(_, u)| (u[0] - 1.0).abs() < 1e-6), "a shift of all is a shift");
    let output = deform("3e6");
    let told = text(&output.stderr);
    assert!(output.status.success() && !told.contains("solved anew"), "{told}");
}

/// Three nodes within 1e-7 m of a line do not hold a body, whether it is solved for or updated.
#[test]
fn a_release_that_leaves_a_hinge_is_refused() {
    let control =
        |name: &str, nodes: &str| format!("control.{name} = {{ nodes = {nodes}, grab = \"dragger\" }}\n");
    let folder = project("updates_hinge", None, "", POSES);
    let mut block = block(&Block { size: [2.0, 1.0, 1.0], cells: [4, 2, 2] }).unwrap();
    let line: Vec<usize> =
        (0..block.nodes.len()).filter(|&n| block.nodes[n].x < -0.99 && block.nodes[n].y < -0.49).collect();
    assert_eq!(line.len(), 3);
    block.nodes[line[1]].y -= 1e-7;
    mesh::save(&folder.join("m.msh"), &block, None).unwrap();
    let tags: Vec<u64> = line.iter().map(|&n| block.tags[n]).collect();
    let scene = "[body.b]\nmesh = \"m.msh\"\nmaterial = { young = 1e6, poisson = 0.3 }\nupdates = { release = [\"R\"] }\n"
        .to_owned()
        + &control("middle", &format!("{{ list = {tags:?} }}"))
        + &control("R", "{ plane = { point = [1, 0, 0], normal = [1, 0, 0], distance = 0.01 } }");
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    let arguments = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "out"];
    greenstage(&folder, &arguments);
    let output = attempt(&folder, &[&arguments[..], &["--release", "b.R"]].concat());
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("is held at 3 nodes on one line, about which it can turn freely"), "{told}");
}
