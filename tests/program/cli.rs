//! The command line as a user types it: what works, and what is refused with status 2, file, entity and remedy.

mod cases;
mod limits;
mod propose;
use crate::common;

use common::{csv_rows, greenstage as succeed, program, text};
use greenstage::mesh::{self, TetMesh, generate};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;

const SCENE: &str = r#"
stage = "desktop"
[body.block]
mesh = "block.msh"
material = { young = 1.0e3, poisson = 0.3 }
effects = ["haptics"]
[body.block.control.high]
nodes = { group = "xmax" }
grab = "dragger"
[body.block.control.low]
nodes = { box = { min = [-0.6, -0.6, -0.6], max = [-0.4, 0.6, 0.6] } }
grab = "fixed"
"#;

const POSES: &str = r#"
[[pose]]
name = "rest"
[[pose]]
name = "pull"
control.high = { translation = [0.1, 0.0, 0.0] }
"#;

const DEFORM: [&str; 6] = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "out"];

fn greenstage(folder: &Path, arguments: &[&str]) -> Output {
    program(folder, arguments).output().unwrap()
}

fn block() -> TetMesh {
    generate::block(&generate::Block { size: [1.0; 3], cells: [3, 2, 2] }).unwrap()
}

fn project(name: &str) -> PathBuf {
    common::project(name, Some("msh22"), SCENE, POSES)
}

/// Rows of a table by pose and node, or pose and control element.
fn table(path: &Path) -> Vec<(String, Vec<f64>)> {
    csv_rows(path, 2)
}

/// Expects exit status 2 and all of `expected` in the message.
fn refuse(folder: &Path, arguments: &[&str], expected: &[&str]) {
    let output = greenstage(folder, arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    for part in expected {
        assert!(message.contains(part), "{arguments:?}: {part:?} is missing in: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

fn refuse_scene(name: &str, from: &str, to: &str, expected: &[&str]) {
    let folder = project(name);
    let scene = SCENE.replace(from, to);
    assert_ne!(scene, SCENE, "{from:?} must stand in the scene");
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    refuse(&folder, &["precompute", "scene.toml"], expected);
}

#[test]
fn precompute_deform_inspect() {
    let folder = project("cli-works");
    let made = text(&succeed(&folder, &["precompute", "scene.toml"]).stdout);
    for part in ["assembly", "ordering", "factor", "solves", "residual", "peak memory", "scene.green"] {
        assert!(made.contains(part), "{part} is missing in: {made}");
    }
    let again = text(&succeed(&folder, &["precompute", "scene.toml"]).stdout);
    assert!(again.contains("is fresh"), "{again}");

    succeed(&folder, &["deform", "scene.toml", "--poses", "poses.toml", "-o", "out/result.csv"]);
    let csv = std::fs::read_to_string(folder.join("out/result.csv")).unwrap();
    assert_eq!(csv.lines().next(), Some("pose,node,ux,uy,uz"));
    let rows = table(&folder.join("out/result.csv"));
    let pulled: Vec<f64> =
        rows.iter().filter(|(key, _)| key.starts_with("pull,")).map(|(_, u)| u[0]).collect();
    assert_eq!(pulled.len(), 4 * 9 - 2, "all surface nodes of 3 × 2 × 2 cells, and only those");
    assert!(pulled.iter().all(|u| (-0.001..=0.1001).contains(u)), "stretched between 0 and 0.1 m");
    let forces = table(&folder.join("out/result.forces.csv"));
    let force = forces.iter().find(|(key, _)| key == "pull,high").unwrap().1[0];
    assert!((100.0..130.0).contains(&force), "E A u / L = 100 N, more with clamped faces: {force}");
    let vtu = std::fs::read_to_string(folder.join("out/result.vtu")).unwrap();
    let head = "<Piece NumberOfPoints=\"34\" NumberOfCells=\"64\">\n<PointData Vectors=\"displacement ";
    assert_eq!(vtu.matches(head).count(), 1, "{vtu}");

    for file in ["block.msh", "scene.green", "scene.toml"] {
        let shown = text(&succeed(&folder, &["inspect", file]).stdout);
        assert!(shown.contains("nodes"), "{shown}");
        let json = text(&succeed(&folder, &["inspect", file, "--json"]).stdout);
        serde_json::from_str::<serde_json::Value>(&json).unwrap();
    }
}

/// A mesh from somebody else whose group is named to clear the screen: its name is shown, not obeyed, wherever it comes
/// to a terminal.
#[test]
fn names_from_files_do_not_steer_the_terminal() {
    let folder = project("steering");
    let evil = "\u{1b}[2Jevil";
    let mut mesh = block();
    let nodes = mesh.groups["xmax"].clone();
    mesh.groups.insert("fiend".into(), nodes);
    mesh::save(&folder.join("block.msh"), &mesh, Some("msh22")).unwrap();
    let written = std::fs::read_to_string(folder.join("block.msh")).unwrap();
    std::fs::write(folder.join("block.msh"), written.replace("fiend", evil)).unwrap();
    assert!(mesh::load(&folder.join("block.msh")).unwrap().mesh.groups.contains_key(evil));

    let shown = text(&succeed(&folder, &["inspect", "block.msh"]).stdout);
    assert!(shown.contains("\\u001b[2Jevil") && !shown.contains('\u{1b}'), "{shown}");
    let json = text(&succeed(&folder, &["inspect", "block.msh", "--json"]).stdout);
    let value: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(value["mesh"].to_string().contains("\\u001b[2Jevil"), "{json}");

    let lost = text(&succeed(&folder, &["convert", "block.msh", "a.vtu"]).stderr);
    assert!(lost.contains("lost: \\u001b[2Jevil") && !lost.contains('\u{1b}'), "{lost}");

    let scene = SCENE.replace("[body.block", "[body.\"\\u001b[2Jbody\"");
    std::fs::write(folder.join("scene.toml"), &scene).unwrap();
    let told = succeed(&folder, &["precompute", "scene.toml", "--verbose"]);
    for said in [text(&told.stdout), text(&told.stderr)] {
        assert!(said.contains("\\u001b[2Jbody") && !said.contains('\u{1b}'), "{said}");
    }
    std::fs::write(folder.join("scene.toml"), scene.replace("\"xmax\"", "\"none\"")).unwrap();
    let output = greenstage(&folder, &["check", "scene.toml"]);
    let said = text(&output.stdout) + &text(&output.stderr);
    assert!(!output.status.success());
    assert!(said.contains("known: \\u001b[2Jevil") && !said.contains('\u{1b}'), "{said}");
}

/// The hash of a forged file is right, and its control elements are not the scene's.
#[test]
fn a_green_file_of_another_scene_is_refused_though_it_bears_this_ones_fingerprint() {
    let folder = project("forged-green");
    succeed(&folder, &["precompute", "scene.toml"]);
    let path = folder.join("scene.green");
    let bytes = std::fs::read(&path).unwrap();
    let container = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let (_, header) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
    let sealed: serde_json::Value =
        serde_json::from_str(&header.metadata().as_ref().unwrap()["greenstage"]).unwrap();
    let mut content = sealed["content"].clone();
    content["bodies"]["block"]["controls"].as_array_mut().unwrap().reverse();
    let seal = blake3::hash(content.to_string().as_bytes()).to_hex().to_string();
    let sealed = format!("{{\"blake3\":\"{seal}\",\"content\":{content}}}");
    let metadata = std::collections::HashMap::from([("greenstage".to_owned(), sealed)]);
    std::fs::write(&path, safetensors::serialize(container.tensors(), Some(metadata)).unwrap()).unwrap();
    let render = ["render", "scene.toml", "--stage", "desktop", "--frames", "1", "-o", "out"];
    for command in [&DEFORM[..], &render[..]] {
        let told = ["bodies.block.controls is [\"low\", \"high\"]", "greenstage precompute --force"];
        refuse(&folder, command, &told);
    }
}

#[test]
fn convert_says_what_is_lost_and_inspect_what_is_wrong() {
    let folder = project("convert");
    for (out, lost) in [
        ("a.msh", ""),
        ("a.inp", ""),
        ("a.vtu", "note: the format holds no node groups; lost: xmax, xmin"),
        ("a.mesh", "note: the format holds no node groups"),
        ("a.node", "note: the format holds no node groups"),
    ] {
        let output = succeed(&folder, &["convert", "block.msh", out]);
        let told = text(&output.stderr);
        assert!(told.starts_with(lost) && (told.is_empty() == lost.is_empty()), "{out}: {told}");
        let made = text(&output.stdout);
        assert!(made.starts_with("block.msh: 36 nodes, 60 tetrahedra"), "{made}");
        let shown = text(&succeed(&folder, &["inspect", out]).stdout);
        let is_sound = shown.contains("36 nodes, 60 tetrahedra") && shown.contains("nothing wrong is found");
        assert!(is_sound, "{shown}");
    }
    assert!(folder.join("a.ele").exists());
    let mut names = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(names.all(|name| !name.to_string_lossy().starts_with(".mesh-")));
    succeed(&folder, &["convert", "a.inp", "b.msh", "--encoding", "msh22"]);
    let text_of = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    assert_eq!(text_of("b.msh"), text_of("block.msh"));
    let known = "a.stl: cannot be written; known are msh41 (.msh)";
    refuse(&folder, &["convert", "block.msh", "a.stl"], &[known]);
    let other = ["convert", "block.msh", "a.vtu", "--encoding", "msh22"];
    refuse(&folder, &other, &["cannot be written as msh22"]);
    refuse(&folder, &["convert", "no.msh", "a.vtu"], &["no.msh: cannot be read"]);

    let mut twice = block();
    let (nodes, second) = (twice.nodes.len() as u32, block());
    twice.nodes.extend(second.nodes.iter().map(|node| node + nalgebra::Vector3::x()));
    twice.tags.extend(second.tags.iter().map(|tag| tag + 100));
    twice.tets.extend(second.tets.iter().map(|tet| tet.map(|node| node + nodes)));
    twice.regions.extend(second.regions);
    mesh::save(&folder.join("twice.msh"), &twice, None).unwrap();
    let shown = text(&succeed(&folder, &["inspect", "twice.msh"]).stdout);
    assert!(shown.contains("what is wrong\n  warning: 9 pairs of nodes lie at the same place"), "{shown}");
    assert!(shown.contains("  note: 2 pieces that share no face"), "{shown}");
}

#[test]
fn all_nodes_are_solved_in_f64() {
    let folder = project("cli-all-nodes");
    succeed(&folder, &DEFORM);
    let surface = table(&folder.join("out.csv"));
    std::fs::remove_file(folder.join("scene.green")).unwrap();
    succeed(&folder, &[&DEFORM[..], &["--all-nodes"]].concat());
    assert!(!folder.join("scene.green").exists(), "nothing is precomputed for it");
    let all: BTreeMap<_, _> = table(&folder.join("out.csv")).into_iter().collect();
    assert_eq!(all.len(), 2 * 36);
    for (key, u) in &surface {
        assert!((0..3).all(|axis| (u[axis] - all[key][axis]).abs() < 1e-8), "{key}: {u:?} {:?}", all[key]);
    }
    // 0.1 is no f32: these numbers never were one.
    let exact = all.iter().filter(|(key, u)| key.starts_with("pull") && u[0] == 0.1).count();
    assert_eq!(exact, 9, "the nodes of the moved face");
}

#[test]
fn scene_mistakes_are_refused() {
    let cases: [(&str, &str, &str, &[&str]); 11] = [
        (
            "key",
            "effects =",
            "efects =",
            &["scene.toml:6:1", "unknown field `efects`", "did you mean `effects`?"],
        ),
        (
            "model",
            "effects =",
            "model = \"rotaton\"\neffects =",
            &["body.block.model", "did you mean \"rotation\"?"],
        ),
        ("effect", "\"haptics\"", "\"haptic\"", &["body.block.effects", "did you mean \"haptics\"?"]),
        ("poisson", "poisson = 0.3", "poisson = 0.5", &["scene.toml", "body.block.material", "0.5", "0.49"]),
        ("mesh", "block.msh", "blok.msh", &["scene.toml", "body.block.mesh", "blok.msh"]),
        ("group", "\"xmax\"", "\"xmxa\"", &["body.block.control.high", "did you mean \"xmax\"?"]),
        ("empty", "min = [-0.6,", "min = [-0.41,", &["body.block.control.low", "selects no node", "spans"]),
        (
            "overlap",
            "max = [-0.4,",
            "max = [0.6,",
            &["body.block.control.low", "overlaps control high", "9 nodes"],
        ),
        (
            "region",
            "effects =",
            "region.7 = { young = 1.0, poisson = 0.3 }\neffects =",
            &["body.block.region.7", "regions 0"],
        ),
        ("stage", "stage = \"desktop\"", "stge = \"desktop\"", &["scene.toml:2:1", "did you mean `stage`?"]),
        ("file", "group = \"xmax\"", "file = \"tags.txt\"", &["body.block.control.high", "tags.txt"]),
    ];
    for (name, from, to, expected) in cases {
        refuse_scene(&format!("cli-scene-{name}"), from, to, expected);
    }
    refuse(&project("cli-absent"), &["precompute", "other.toml"], &["other.toml"]);
    refuse(&project("cli-folder"), &["precompute", "."], &["."]);
}

#[test]
fn bad_meshes_are_refused() {
    let out_of_range = project("cli-range");
    let file = out_of_range.join("block.msh");
    let good = std::fs::read_to_string(&file).unwrap();
    let is_tetrahedron = |line: &str| line.split(' ').nth(1) == Some("4") && line.split(' ').count() > 7;
    let (line, first) = good.lines().enumerate().find(|(_, line)| is_tetrahedron(line)).unwrap();
    let (start, _) = first.rsplit_once(' ').unwrap();
    std::fs::write(&file, good.replacen(first, &format!("{start} 99999"), 1)).unwrap();
    refuse(&out_of_range, &["precompute", "scene.toml"], &[&format!("block.msh:{}", line + 1), "99999"]);

    // A second block, far away, that no control element reaches.
    let floating = project("cli-floating");
    let (mut both, other) = (block(), block());
    let count = both.nodes.len() as u32;
    both.tets.extend(other.tets.iter().map(|tet| tet.map(|node| node + count)));
    both.regions.extend(&other.regions);
    both.nodes.extend(other.nodes.iter().map(|x| x + nalgebra::Vector3::new(0.0, 3.0, 0.0)));
    both.tags.extend(other.tags.iter().map(|tag| tag + u64::from(count)));
    mesh::save(&floating.join("block.msh"), &both, Some("msh41-binary")).unwrap();
    let expected = ["body.block", "piece 2 of 2", "36 nodes", "held by no control element", "tags 37"];
    refuse(&floating, &["precompute", "scene.toml"], &expected);

    let hinge = project("cli-hinge");
    let edge = SCENE.replace("group = \"xmax\"", "box = { min = [0.4, 0.4, -1.0], max = [0.6, 0.6, 1.0] }");
    let only = edge.split("[body.block.control.low]").next().unwrap();
    std::fs::write(hinge.join("scene.toml"), only).unwrap();
    refuse(&hinge, &["precompute", "scene.toml"], &["3 nodes on one line", "turn freely"]);

    let flat = project("cli-flat");
    let mut squashed = block();
    let tet = squashed.tets[0].map(|node| node as usize);
    squashed.nodes[tet[3]] = (squashed.nodes[tet[0]] + squashed.nodes[tet[1]] + squashed.nodes[tet[2]]) / 3.0;
    mesh::save(&flat.join("block.msh"), &squashed, Some("msh22")).unwrap();
    refuse(&flat, &["precompute", "scene.toml"], &["body.block", "1 tetrahedra have no volume", "nodes ["]);
}

/// Each was ignored, and the run did something else than was asked for.
#[test]
fn options_that_a_run_does_not_use_are_refused() {
    let folder = project("cli-options");
    for (arguments, option) in [
        ("bench scene.toml --model rod", "--model"),
        ("bench scene.toml --nodes 50", "--nodes"),
        ("bench scene.toml --limit 3", "--limit"),
        ("bench scene.toml --storage f16", "--storage"),
        ("bench --effects=haptic", "'--effects"),
        ("verify haptics --bodies 3", "--bodies"),
        ("track desktop --once --rate 5", "--script"),
        ("view scene.toml --check --seconds 0.1", "--seconds"),
        ("view scene.toml --check --overlay", "--overlay"),
        ("view scene.toml --check --samples 4", "--samples"),
        ("stage-view desktop --time 5", "--output"),
        ("stage-view desktop -o x.png --time 5", "--time"),
        ("stage-view desktop -o x.png --green nix.green", "--green"),
        ("stage-view desktop -o x.png --tracker nope=1", "--tracker"),
        ("pattern desktop -o pat --window-scale 0.1", "--window-scale"),
    ] {
        refuse(&folder, &arguments.split(' ').collect::<Vec<_>>(), &[option]);
    }
}

#[test]
fn damaged_and_stale_green_files_are_refused() {
    let folder = project("cli-damaged");
    succeed(&folder, &["precompute", "scene.toml"]);
    let path = folder.join("scene.green");
    let good = std::fs::read(&path).unwrap();

    std::fs::write(&path, &good[..good.len() / 2]).unwrap();
    refuse(&folder, &DEFORM, &["scene.green", "cut short or damaged", "greenstage precompute"]);
    let mut flipped = good.clone();
    let late = good.len() - 1000;
    flipped[late] ^= 1;
    std::fs::write(&path, flipped).unwrap();
    refuse(&folder, &DEFORM, &["scene.green", "damaged", "blake3", "greenstage precompute"]);
    refuse(&folder, &["inspect", "scene.green"], &["scene.green", "damaged"]);
    let remade = succeed(&folder, &["precompute", "scene.toml", "--force"]);
    assert!(text(&remade.stdout).contains("written"));

    std::fs::write(&path, &good).unwrap();
    std::fs::write(folder.join("scene.toml"), SCENE.replace("young = 1.0e3", "young = 2.0e3")).unwrap();
    refuse(&folder, &[&DEFORM[..], &["--green", "scene.green"]].concat(), &["scene.green", "is stale"]);
    let output = succeed(&folder, &DEFORM);
    assert!(text(&output.stderr).contains("is stale"), "made anew, and said: {}", text(&output.stderr));
}

#[test]
fn pose_mistakes_are_refused() {
    let folder = project("cli-poses");
    for (poses, expected) in [
        ("control.hihg = {}", ["pose \"a\"", "did you mean \"high\"?"]),
        ("control.high = { translation = [nan, 0, 0] }", ["control high", "not finite"]),
        ("control.high = { translation = [0.0, 0.0] }", ["poses.toml:3", "length 3"]),
        ("body = \"blok\"", ["pose \"a\"", "did you mean \"block\"?"]),
        ("[[pose]]\nname = \"a\"", ["poses.toml", "two poses are called \"a\""]),
        ("[[pose]]\nname = \"a\"\nbody = \"block\"", ["poses.toml", "two poses are called \"a\""]),
    ] {
        std::fs::write(folder.join("poses.toml"), format!("[[pose]]\nname = \"a\"\n{poses}\n")).unwrap();
        refuse(&folder, &DEFORM, &expected);
    }
}

/// What a report would not measure was taken for an element that is held at rest.
#[test]
fn a_report_refuses_poses_that_it_cannot_measure() {
    let folder = project("cli-report-poses");
    const MOVED: &str = "control.high = { translation = [0.1, 0.0, 0.0] }";
    let of = |pose: &str| format!("[[pose]]\nname = \"pull\"\n{pose}\n");
    for (poses, expected) in [
        (POSES.to_owned(), "pose \"rest\" moves nothing"),
        (of("control.high = { translation = [1e-17, 0.0, 0.0] }"), "pose \"pull\" moves nothing"),
        (of("control.high = { force = [0.0, 0.0, -5.0] }"), "pose \"pull\" has free directions or is pushed"),
        (of("control.high = { translation = [0.1, 0.0, 0.0], free = [\"y\"] }"), "has free directions"),
        (
            of("[[pose.force]]\nat = [0.5, 0.0, 0.0]\nforce = [0.0, 0.0, 1.0]"),
            "pose \"pull\" has forces at points",
        ),
        (
            of(MOVED) + &of(&format!("after = \"pull\"\n{MOVED}")).replacen("pull", "more", 1),
            "pose \"more\" goes on",
        ),
    ] {
        std::fs::write(folder.join("poses.toml"), &poses).unwrap();
        let arguments = ["accuracy", "scene.toml", "--poses", "poses.toml", "-o", "out"];
        refuse(&folder, &arguments, &[expected, "moved from rest and held"]);
    }
}

/// A pose in a batch stands alone, whatever was before it: also where the mean rotation is followed on line.
#[test]
fn a_pose_does_not_depend_on_the_one_before() {
    let folder = project("cli-alone");
    std::fs::write(folder.join("scene.toml"), SCENE.replace("effects =", "model = \"rotation\"\neffects ="))
        .unwrap();
    let turn = |name: &str, degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        let matrix = format!("[[1.0, 0.0, 0.0], [0.0, {c}, {}], [0.0, {s}, {c}]]", -s);
        format!("[[pose]]\nname = \"{name}\"\ncontrol.high = {{ matrix = {matrix} }}\n")
    };
    let rows = |poses: String| {
        std::fs::write(folder.join("poses.toml"), poses).unwrap();
        succeed(&folder, &DEFORM);
        let rows = table(&folder.join("out.csv")).into_iter().filter(|(key, _)| key.starts_with("last"));
        rows.collect::<Vec<_>>()
    };
    for degrees in [40.0, 200.0] {
        let alone = rows(turn("last", degrees));
        assert_eq!(alone, rows(turn("a", 90.0) + &turn("b", 150.0) + &turn("last", degrees)), "{degrees}°");
    }
    // Half a turn has no mean rotation; the pose before is not written in its place.
    let half = turn("a", 90.0) + &turn("last", 180.0);
    std::fs::write(folder.join("poses.toml"), half).unwrap();
    let output = greenstage(&folder, &DEFORM);
    let said = text(&output.stderr);
    assert!(said.contains("pose \"last\"") && said.contains("has no result for this pose"), "{said}");
    assert_eq!(output.status.code(), Some(1), "{said}");
    let written = table(&folder.join("out.csv"));
    assert!(!written.is_empty() && written.iter().all(|(key, _)| key.starts_with('a')), "{written:?}");
}

/// Numbers that TOML can hold and no body can have: every one ends in an error with its file, or in finite numbers.
#[test]
fn absurd_numbers_are_refused_or_harmless() {
    let folder = project("cli-absurd");
    let mut refused = 0;
    for number in ["0.0", "-1.0", "1e300", "-1e300", "1e-300", "nan", "inf", "1e39", "4000000000", "1e-45"] {
        for (from, to) in [
            ("young = 1.0e3", format!("young = {number}")),
            ("poisson = 0.3", format!("poisson = {number}")),
            ("effects =", format!("place = {{ position = [{number}, 0.0, 0.0] }}\neffects =")),
            ("effects =", format!("place = {{ position = [0.0, 0.0, 0.0], scale = {number} }}\neffects =")),
            ("effects =", format!("solver = {{ method = \"pcg\", tolerance = {number} }}\neffects =")),
            ("max = [-0.4,", format!("max = [{number},")),
            ("group = \"xmax\"", format!("sphere = {{ centre = [0.5, 0.0, 0.0], radius = {number} }}")),
            (
                "group = \"xmax\"",
                format!("plane = {{ point = [0.5, 0, 0], normal = [{number}, 0, 0], distance = 1e-9 }}"),
            ),
            (
                "mesh = \"block.msh\"",
                format!("generate = {{ block = {{ size = [1.0, {number}, 1.0], cells = [3, 2, 2] }} }}"),
            ),
        ] {
            let scene = SCENE.replace(from, &to);
            assert_ne!(scene, SCENE);
            std::fs::write(folder.join("scene.toml"), scene).unwrap();
            let output = greenstage(&folder, &DEFORM);
            let message = text(&output.stderr);
            assert!(!message.contains("panicked"), "{to}: {message}");
            match output.status.code() {
                Some(0) => {
                    let rows = table(&folder.join("out.csv"));
                    assert!(rows.iter().all(|(_, u)| u.iter().all(|u| u.is_finite())), "{to}");
                    let is_pulled = rows.iter().any(|(key, u)| key.starts_with("pull") && u[0] > 0.05);
                    assert!(is_pulled, "{to}: nothing moves");
                }
                Some(2) => {
                    refused += 1;
                    assert!(message.contains("scene.toml"), "{to}: {message}");
                }
                other => panic!("{to}: status {other:?}: {message}"),
            }
        }
    }
    assert!(refused > 50, "{refused} of 90 refused");
}

#[test]
fn check_lists_everything_without_solving() {
    let folder = project("cli-check");
    let fine = text(&succeed(&folder, &["check", "scene.toml"]).stdout);
    assert!(fine.contains("0 errors, 0 warnings, 0 notes; --verbose shows 1 detail"), "{fine}");
    assert!(!fine.contains("planar") && !fine.contains("not listed"), "{fine}");
    let verbose = text(&succeed(&folder, &["check", "scene.toml", "--verbose"]).stdout);
    assert!(verbose.contains("detail: scene.toml:3: body.block: control high, low: planar"), "{verbose}");
    assert!(verbose.contains("not listed"), "{verbose}");
    let scene = SCENE.replace("poisson = 0.3", "poisson = 0.49").replace("max = [-0.4,", "max = [0.6,");
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    refuse(&folder, &["check", "scene.toml"], &["scene.toml: 1 error"]);
    let output = greenstage(&folder, &["check", "scene.toml"]);
    let lines: Vec<String> = text(&output.stdout).lines().map(str::to_owned).collect();
    for (at, severity) in ["error", "warning"].into_iter().enumerate() {
        assert!(lines[at].starts_with(&format!("{severity}: scene.toml:")), "{lines:?}");
    }
    assert!(lines[0].contains(": body.block.control.low: overlaps control high"), "{lines:?}");
    assert!(lines[1].contains(": body.block.material: Poisson's ratio 0.49"), "{lines:?}");
    let json = greenstage(&folder, &["check", "scene.toml", "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(value["findings"][0]["severity"], "error");
    assert!(!folder.join("scene.green").exists());
}

#[test]
fn stage_and_script_mistakes_are_refused() {
    let folder = project("cli-stages");
    let with = |stage: &str, expected: &[&str]| {
        refuse(&folder, &["render", "scene.toml", "--stage", stage, "-o", "out"], expected);
    };
    with("workbensh", &["workbensh", "did you mean `workbench`?"]);
    with("none.toml", &["none.toml"]);
    let bench = include_str!("../../configs/stages/workbench.toml");
    // The wall's lower corners exchanged: a mirrored picture.
    let mirrored = bench
        .replace("lower_left = [-0.80, 0.90, 0.00]", "lower_left = [0.80, 0.90, 0.00]")
        .replace("lower_right = [0.80, 0.90, 0.00]", "lower_right = [-0.80, 0.90, 0.00]")
        .replace("upper_left = [-0.80, 2.18, 0.00]", "upper_left = [0.80, 2.18, 0.00]");
    assert_ne!(mirrored, bench);
    std::fs::write(folder.join("mirrored.toml"), mirrored).unwrap();
    with("mirrored.toml", &["mirrored.toml", "wall", "mirrored"]);
    refuse(&folder, &["inspect", "mirrored.toml"], &["mirrored.toml", "wall"]);
    std::fs::write(folder.join("script.toml"), "[[key]]\ntime = 0.0\n[[key]]\ntime = -1.0\n").unwrap();
    let render = ["render", "scene.toml", "--script", "script.toml", "-o", "out"];
    refuse(&folder, &render, &["script.toml"]);
}
