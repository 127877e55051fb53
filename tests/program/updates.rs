//! Released control elements and changed moduli, as a user asks for them.

use crate::common::{attempt, csv_rows, greenstage, project, text};
use greenstage::deform::{LINEAR, MODELS, ModelEntry};
use greenstage::mesh::{self, Block, block};
use std::path::Path;

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
}

/// The largest difference of the columns `part` of two tables, as a part of the largest number there.
fn apart(found: &Path, expected: &Path, part: std::ops::Range<usize>) -> f64 {
    let [found, expected] = [found, expected].map(|path| csv_rows(path, 2));
    assert_eq!(found.len(), expected.len());
    let (mut off, mut largest) = (0.0_f64, 0.0_f64);
    for ((key, a), (same, b)) in found.iter().zip(&expected) {
        assert_eq!(key, same);
        for (a, b) in a[part.clone()].iter().zip(&b[part.clone()]) {
            (off, largest) = (off.max((a - b).abs()), largest.max(b.abs()));
        }
    }
    assert!(largest > 0.0, "{}: only zeros", expected[0].0);
    off / largest
}

/// A body of a model with loads and forces, one half of which becomes softer and whose middle is let go of, against a scene that
/// has it so: the largest relative differences of displacements, forces, moments and energies, and whether the body was solved
/// anew.
fn against_fresh(model: &ModelEntry) -> ([f64; 4], bool) {
    let (is_rod, is_plate) = (model.name == "rod", model.name == "plate");
    // Two control elements are all that they take.
    let has_middle = !is_rod && model.name != "perturbation";
    let (size, cells) =
        if is_plate { ([1.0, 0.03, 0.4], [16, 1, 6]) } else { ([1.0, 0.08, 0.08], [10, 2, 2]) };
    let plane = |name: &str, x: f64| {
        format!(
            "control.{name} = {{ nodes = {{ plane = {{ point = [{x}, 0, 0], normal = [1, 0, 0], distance = 1e-6 }} }}, grab = \"dragger\" }}\n"
        )
    };
    let scene = |young: f64, updates: &str, middle: &str| {
        format!(
            "[body.b]\nmesh = \"m.msh\"\nelement = \"{}\"\nmodel = \"{}\"\neffects = [\"haptics\"]\n\
             material = {{ young = 2e6, poisson = 0.3, density = 900.0 }}\n\
             region.2 = {{ young = {young:e}, poisson = 0.3, density = 700.0 }}\ngravity = true\n\
             thermal = {{ expansion = 1e-4, difference = 20.0 }}\n\
             load.press = {{ nodes = {{ plane = {{ point = [0, {}, 0], normal = [0, 1, 0], distance = 1e-6 }} }}, kind = \"pressure\", value = 5.0 }}\n\
             {updates}\n{}{middle}{}",
            if is_plate { "tet10" } else { "tet4" },
            model.name,
            0.5 * size[1],
            plane("left", -0.5),
            plane("right", 0.5)
        )
    };
    let poses = "[[pose]]\nname = \"rest\"\n[[pose]]\nname = \"bent\"\ncontrol.right = { translation = [0.0, 0.05, 0.0] }\n";
    let (middle, releases) = match has_middle {
        true => (plane("middle", 0.0), "release = [\"middle\"], "),
        false => (String::new(), ""),
    };
    let before = scene(2e6, &format!("updates = {{ {releases}modulus = [\"2\"] }}"), &middle);
    let folder = project(&format!("updates_of_{}", model.name), None, &before, poses);
    let mut block = block(&Block { size, cells }).unwrap();
    // A rod and a plate of one material alone, of which both halves become softer.
    let is_soft = |tet: &[u32; 4]| {
        is_rod || is_plate || tet.iter().map(|&n| block.nodes[n as usize].x).sum::<f64>() > 0.0
    };
    block.regions = block.tets.iter().map(|tet| 1 + u32::from(is_soft(tet))).collect();
    mesh::save(&folder.join("m.msh"), &block, None).unwrap();
    std::fs::write(folder.join("fresh.toml"), scene(5e5, "", "")).unwrap();
    let change = ["--young", "b.2=5e5", "--release", "b.middle"];
    let change = &change[..if has_middle { 4 } else { 2 }];
    let deform = |scene: &str, out: &str, change: &[&str]| {
        greenstage(&folder, &[&["deform", scene, "--poses", "poses.toml", "-o", out][..], change].concat())
    };
    let told = text(&deform("scene.toml", "out", change).stderr);
    deform("fresh.toml", "fresh", &[]);
    let tables = |name: &str, part| {
        apart(&folder.join(format!("out{name}")), &folder.join(format!("fresh{name}")), part)
    };
    let forces = [0..3, 3..6, 6..7].map(|part| tables(".forces.csv", part));
    ([tables(".csv", 0..3), forces[0], forces[1], forces[2]], told.contains("solved anew"))
}

/// Displacements, forces, moments and energies under gravity, warmth and pressure.
#[test]
fn a_changed_body_of_every_model_is_a_fresh_one() {
    // The body has three control elements, and that model takes two.
    for model in MODELS.iter().filter(|model| model.name != "reduced_neo_hookean") {
        let (off, is_anew) = against_fresh(model);
        println!("{}: {:?} {is_anew}", model.name, off.map(|off| format!("{off:.1e}")));
        assert!(off.iter().all(|off| *off < 1e-6), "{}: {off:?}", model.name);
        assert_eq!(is_anew, *model != LINEAR && model.law().is_none(), "{}", model.name);
    }
}

/// What the update cannot have is solved for: a modulus beside a compliance of the surface, or with averaged pressures, and all of
/// boundary elements.
#[test]
fn what_cannot_be_updated_is_solved_anew_and_said() {
    let body = |keys: &str, young: f64| {
        format!(
            "[body.b]\ngenerate = {{ block = {{ size = [1.0, 0.2, 0.2], cells = [6, 2, 2] }} }}\neffects = [\"haptics\"]\n\
             material = {{ young = 1e6, poisson = 0.3 }}\nREGION{keys}\n\
             control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
        )
        .replace("REGION", &if young > 0.0 { format!("region.0 = {{ young = {young:e}, poisson = 0.3 }}\n") } else { String::new() })
    };
    let top = "control.top = { nodes = { box = { min = [-0.1, 0.05, -1], max = [0.1, 1, 1] } }, grab = \"dragger\" }\n";
    let poses = "[[pose]]\nname = \"r\"\ncontrol.right = { translation = [0.0, 0.02, 0.0] }\n";
    let modulus = "updates = { modulus = [\"0\"] }\n";
    let young = ["--young", "b.0=3e5"];
    for (name, before, after, change, why) in [
        (
            "compliance",
            body(&format!("surface_compliance = {{ nodes = \"surface\" }}\n{modulus}"), 1e6),
            body("surface_compliance = { nodes = \"surface\" }", 3e5),
            young,
            "surface_compliance",
        ),
        (
            "averaged",
            body(&format!("element = \"tet4_anp\"\n{modulus}"), 1e6),
            body("element = \"tet4_anp\"", 3e5),
            young,
            "averages the pressure",
        ),
        (
            "boundary",
            body("method = \"bem\"\nupdates = { release = [\"top\"] }", 0.0) + top,
            body("method = \"bem\"", 0.0),
            ["--release", "b.top"],
            "boundary elements",
        ),
    ] {
        let folder = project(&format!("updates_anew_{name}"), None, &before, poses);
        std::fs::write(folder.join("fresh.toml"), after).unwrap();
        let deform = |scene: &str, out: &str, change: &[&str]| {
            greenstage(
                &folder,
                &[&["deform", scene, "--poses", "poses.toml", "-o", out][..], change].concat(),
            )
        };
        let told = text(&deform("scene.toml", "out", &change).stderr);
        assert!(told.contains(why) && told.contains("solved anew"), "{name}: {told}");
        deform("fresh.toml", "fresh", &[]);
        for (table, part) in [("csv", 0..3), ("forces.csv", 0..7)] {
            let off =
                apart(&folder.join(format!("out.{table}")), &folder.join(format!("fresh.{table}")), part);
            assert!(off < 1e-6, "{name}, {table}: {off:e}");
        }
    }
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
    assert!(told.contains("region 2 floats, 1.0e14 times stiffer than what is around it"), "{told}");
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
