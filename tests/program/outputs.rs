//! Files of the program: whole or not at all, tried before the work, and never over a file of another kind.

use crate::common;

use common::{folder, program, text};
use greenstage::green;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const SCENE: &str = r#"
stage = "desktop"
[body.block]
mesh = "block.msh"
material = { young = 1.0e3, poisson = 0.3 }
effects = ["haptics"]
control.high = { nodes = { group = "xmax" }, grab = "dragger" }
control.low = { nodes = { group = "xmin" }, grab = "fixed" }
"#;

const PULL: &str = "[[pose]]\nname = \"pull\"\ncontrol.high = { translation = [0.1, 0.0, 0.0] }\n";

const DEFORM: [&str; 6] = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "out"];
const RECORD: [&str; 5] = ["view", "scene.toml", "--check", "--record", "session.jsonl"];

fn project(name: &str) -> PathBuf {
    common::project(name, None, SCENE, PULL)
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    program(folder, arguments).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap()
}

fn said(output: &Output) -> String {
    text(&output.stderr)
}

fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    said(&output)
}

/// All files of a folder, and what is in them.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.insert(path.clone(), std::fs::read(path).unwrap());
        }
    }
    found
}

/// Status 2, the words, and every file as it was: nothing was made either, so nothing was solved.
fn refuse(folder: &Path, arguments: &[&str], words: &str) {
    let before = contents(folder);
    let output = run(folder, arguments);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(said.contains(words), "{arguments:?}: {words:?} is missing in: {said}");
    assert!(before == contents(folder), "{arguments:?}: {:?}", contents(folder).keys());
}

/// Runs with a limit on the size of files, as on a full disk. `ulimit` counts blocks of 512 or 1024 bytes.
fn limited(folder: &Path, blocks: u32, arguments: &[&str]) -> Output {
    Command::new("sh")
        .current_dir(folder)
        .args(["-c", &format!("ulimit -f {blocks}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_greenstage")])
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn a_full_disk_is_an_error_and_leaves_the_older_results() {
    let folder = project("outputs-full");
    succeed(&folder, &DEFORM);
    let mut old = contents(&folder);
    let poses = PULL.replace("0.1", "0.2") + &PULL.replace("pull", "push").replace("0.1", "-0.1");
    std::fs::write(folder.join("poses.toml"), &poses).unwrap();
    old.insert(folder.join("poses.toml"), poses.into_bytes());
    let mut told = Vec::new();
    for blocks in 1.. {
        let output = limited(&folder, blocks, &DEFORM);
        if output.status.success() {
            break;
        }
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        assert!(contents(&folder) == old, "{blocks} blocks: {:?}", contents(&folder).keys());
        told.push(said(&output));
    }
    for file in ["out.csv: cannot be written", "out.vtu: cannot be written"] {
        assert!(told.iter().any(|said| said.contains(file) && said.contains("File too large")), "{told:?}");
    }
    assert!(contents(&folder) != old, "and all are new in the end");
    assert_eq!(contents(&folder).len(), old.len());
}

#[test]
fn a_recording_on_a_full_disk_ends_with_an_error_and_is_kept_as_far_as_it_came() {
    let folder = folder("outputs-full-recording");
    common::coarse_demo(&folder);
    let record = ["view", "tube.toml", "--check", "--record", "session.jsonl"];
    succeed(&folder, &record);
    let whole = std::fs::read(folder.join("session.jsonl")).unwrap();
    let blocks = (whole.len() / 2048) as u32;
    let output = limited(&folder, blocks, &record);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("cannot write the recording session.jsonl"), "{}", said(&output));
    let kept = std::fs::read(folder.join("session.jsonl")).unwrap();
    assert!(kept.len() > 512 && whole.starts_with(&kept), "{} of {}", kept.len(), whole.len());
    let output = limited(&folder, 1, &record);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert_eq!(std::fs::read(folder.join("session.jsonl")).unwrap(), kept, "the new one's start did not fit");
}

#[test]
fn a_recording_does_not_overwrite_the_scene() {
    let folder = project("outputs-record");
    let onto = |path| ["view", "scene.toml", "--check", "--record", path];
    refuse(&folder, &onto("scene.toml"), "scene.toml: this run reads that file");
    refuse(&folder, &onto("poses.toml"), "poses.toml: the existing file is not a recording");
    refuse(&folder, &onto("no/session.jsonl"), "the folder no is not there; make it");
    refuse(&folder, &onto("."), "is a folder; name a file in it");
    refuse(&folder, &["render", "scene.toml", "-oout", "--record", "scene.toml"], "this run reads that file");
    succeed(&folder, &RECORD);
    succeed(&folder, &RECORD);
    refuse(&folder, &onto("scene.green"), "is not a recording");
    succeed(&folder, &["view", "scene.toml", "--check", "--replay", "session.jsonl"]);
}

#[test]
fn precompute_does_not_overwrite_the_mesh_with_force_either() {
    let folder = project("outputs-precompute");
    std::fs::copy(folder.join("block.msh"), folder.join("other.msh")).unwrap();
    let onto = |path| ["precompute", "scene.toml", "--force", "-o", path];
    refuse(&folder, &onto("block.msh"), "block.msh: this run reads that file");
    refuse(&folder, &onto("other.msh"), "other.msh: the existing file is not a .green file (it begins with");
    std::fs::write(folder.join("scene.green"), "a list of plants\n").unwrap();
    for command in [&DEFORM[..], &RECORD, &["precompute", "scene.toml", "--force"]] {
        refuse(&folder, command, "scene.green: the existing file is not a .green file");
    }
    refuse(&folder, &onto("poses.toml/a.green"), "cannot make the folder poses.toml");
    std::fs::write(folder.join("scene.green"), "").unwrap();
    for _ in 0..2 {
        succeed(&folder, &["precompute", "scene.toml", "--force"]);
        succeed(&folder, &onto("new/copy.green"));
    }
}

#[test]
fn deform_overwrites_and_removes_its_own_results_alone() {
    let folder = project("outputs-deform");
    std::fs::write(folder.join("out.forces.csv"), "mine\n").unwrap();
    refuse(&folder, &DEFORM, "out.forces.csv: the existing file is not a table of forces by `deform`");
    let plain = SCENE.replace("effects = [\"haptics\"]", "");
    std::fs::write(folder.join("plain.toml"), plain).unwrap();
    let without = [&["deform", "plain.toml"], &DEFORM[2..]].concat();
    succeed(&folder, &without);
    assert_eq!(std::fs::read(folder.join("out.forces.csv")).unwrap(), b"mine\n");
    std::fs::remove_file(folder.join("out.forces.csv")).unwrap();
    succeed(&folder, &DEFORM);
    succeed(&folder, &DEFORM);
    let told = succeed(&folder, &without);
    assert!(
        told.contains("out.forces.csv is left over from an earlier run that wrote more, and is removed"),
        "{told}"
    );
    assert!(!folder.join("out.forces.csv").exists());

    // A mesh is a VTU file too, but not one of displacements.
    succeed(&folder, &["convert", "block.msh", "part.vtu"]);
    let onto = |path| [&DEFORM[..5], &[path]].concat();
    refuse(&folder, &onto("part"), "part.vtu: the existing file is not a VTU file by `deform`");
    for path in ["new/", "..", "pipe"] {
        let is_pipe = path == "pipe";
        let made = is_pipe.then(|| Command::new("mkfifo").arg(folder.join(path)).status().unwrap().success());
        assert_ne!(made, Some(false));
        let output = run(&folder, &onto(path));
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains("OUT names files in a folder"), "{}", said(&output));
    }
    std::fs::remove_file(folder.join("pipe")).unwrap();
    refuse(&folder, &onto("poses.toml/out"), "cannot make the folder poses.toml");
}

/// A pose file was removed by the run that was given it, as one that an earlier run had left.
#[test]
fn deform_keeps_the_pose_file_that_it_reads() {
    let folder = project("outputs-poses");
    std::fs::write(folder.join("free.toml"), PULL.replace("0.0] }", "0.0], free = [\"rotation\"] }"))
        .unwrap();
    succeed(&folder, &["deform", "scene.toml", "--poses", "free.toml", "-o", "b"]);
    let found = std::fs::read(folder.join("b.poses.toml")).unwrap();
    let told = succeed(&folder, &["deform", "scene.toml", "--poses", "b.poses.toml", "-o", "b"]);
    assert!(!told.contains("is removed"), "{told}");
    assert_eq!(std::fs::read(folder.join("b.poses.toml")).unwrap(), found);
}

/// Both were called damaged, to be made anew by force.
#[test]
fn an_empty_file_counts_as_absent_and_a_foreign_one_is_told() {
    let folder = project("outputs-empty");
    std::fs::write(folder.join("scene.green"), "").unwrap();
    succeed(&folder, &DEFORM);
    std::fs::write(folder.join("other.green"), "").unwrap();
    succeed(&folder, &["precompute", "scene.toml", "-o", "other.green"]);
    refuse(&folder, &["pack", "poses.toml"], "poses.toml: is not a .green file");
    std::fs::write(folder.join("scene.green"), "hallo").unwrap();
    let checked = text(&run(&folder, &["check", "scene.toml"]).stdout);
    assert!(checked.contains("warning: scene.green: is not a .green file"), "{checked}");
}

#[test]
fn convert_overwrites_meshes_of_the_format_but_not_what_it_reads() {
    let folder = project("outputs-convert");
    for out in ["a.msh", "a.vtu", "a.mesh", "a.inp", "a.ele", "a.node"] {
        succeed(&folder, &["convert", "block.msh", out]);
        succeed(&folder, &["convert", "block.msh", out]);
    }
    refuse(&folder, &["convert", "block.msh", "block.msh"], "block.msh: this run reads that file");
    refuse(&folder, &["convert", "a.node", "a.ele"], "this run reads that file");
    refuse(&folder, &["convert", "block.msh", "no/a.msh"], "the folder no is not there");
    std::fs::write(folder.join("b.ele"), "mine\n").unwrap();
    let stands = "b.ele: the existing file is not a TetGen .ele file";
    refuse(&folder, &["convert", "block.msh", "b.node"], stands);
    std::fs::write(folder.join("b.inp"), "mine\n").unwrap();
    refuse(&folder, &["convert", "block.msh", "b.inp"], "is not an Abaqus mesh");
}

#[test]
fn what_does_not_unpack_to_a_sound_file_replaces_nothing() {
    let folder = project("outputs-unpack");
    for _ in 0..2 {
        succeed(&folder, &["precompute", "scene.toml", "--force"]);
        succeed(&folder, &["pack", "scene.green"]);
        succeed(&folder, &["pack", "scene.green.zst"]);
    }
    let mut bytes = std::fs::read(folder.join("scene.green")).unwrap();
    let late = bytes.len() - 100;
    bytes[late] ^= 1;
    std::fs::write(folder.join("bad.green.zst"), green::packed(&bytes).unwrap()).unwrap();
    let onto = ["pack", "bad.green.zst", "-o", "scene.green"];
    refuse(&folder, &onto, "bad.green.zst: what it unpacks to is no sound .green file");
    let packed = std::fs::read(folder.join("scene.green.zst")).unwrap();
    std::fs::write(folder.join("bad.green.zst"), &packed[..packed.len() - 50]).unwrap();
    refuse(&folder, &onto, "bad.green.zst: it does not unpack");
    refuse(&folder, &["pack", "scene.green", "-o", "scene.green"], "this run reads that file");
    refuse(&folder, &["pack", "scene.green", "-o", "block.msh"], "is not a packed .green file");
}

/// Through /proc, where nothing can be replaced.
#[test]
#[cfg(target_os = "linux")]
fn standard_output_is_written_to() {
    let folder = project("outputs-stdout");
    succeed(&folder, &["precompute", "scene.toml"]);
    succeed(&folder, &["pack", "scene.green"]);
    let packed = std::fs::read(folder.join("scene.green.zst")).unwrap();
    let to_output = ["pack", "scene.green", "-o", "/proc/self/fd/1"];
    assert!(run(&folder, &to_output).stdout.starts_with(&packed), "into a pipe");
    let file = std::fs::File::create(folder.join("file")).unwrap();
    assert!(program(&folder, &to_output).stdout(Stdio::from(file)).status().unwrap().success());
    assert!(std::fs::read(folder.join("file")).unwrap().starts_with(&packed), "into an open file");
}

#[test]
fn pictures_reports_and_tables_are_tried_before_the_work() {
    let folder = project("outputs-tried");
    std::fs::create_dir_all(folder.join("out/plots")).unwrap();
    for (name, command, kind) in [
        ("out/contact-sheet.png", &["render", "scene.toml", "-oout"][..], "a PNG file"),
        ("out/frame0001-front-left.png", &["render", "scene.toml", "-oout"], "a PNG file"),
        ("out/contact-sheet.png", &["view", "scene.toml", "--offscreen", "out"], "a PNG file"),
        ("room.png", &["stage-view", "scene.toml", "-oroom.png"], "a PNG file"),
        ("out/monitor-centre.png", &["pattern", "desktop", "-oout"], "a PNG file"),
        ("out/index.html", &["accuracy", "scene.toml", "-oout", "--quick"], "a page of `accuracy`"),
        (
            "out/models.csv",
            &["accuracy", "scene.toml", "-oout", "--quick"],
            "a table of models of `accuracy`",
        ),
        ("out/plots/online.svg", &["accuracy", "scene.toml", "-oout", "--quick"], "a plot of `accuracy`"),
    ] {
        std::fs::write(folder.join(name), "mine\n").unwrap();
        refuse(&folder, command, &format!("{name}: the existing file is not {kind}"));
        std::fs::remove_file(folder.join(name)).unwrap();
    }
    for command in [
        &["bench", "scene.toml", "--readme", "poses.toml"][..],
        &["accuracy", "scene.toml", "-oout", "--readme", "poses.toml"],
        &["verify", "--readme", "poses.toml"],
    ] {
        refuse(&folder, command, "are missing");
    }
}
