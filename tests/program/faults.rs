//! Every write, sync, rename, thread and allocation of a command fails once: it does not panic, and of its files all are
//! those of this run, or all those of the one before.
//!
//! `GREENSTAGE_FAULTS=all` lets each call fail (of the allocations some hundreds), in some minutes; else some of each are taken.

use crate::common::{folder, text};
use crate::render_common::require_gpu;
use greenstage::mesh::{self, generate};
use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A command whose files are those of `scene.toml`, `poses.toml` and `part.msh`, of which there are two states.
struct Case {
    name: &'static str,
    arguments: &'static [&'static str],
    /// Prefixes of the files that it writes, which are those of the set.
    set: &'static [&'static str],
    kind: Kind,
}

/// The way in which the files of a command can be compared.
#[derive(PartialEq)]
enum Kind {
    /// All are there at once, with the same bytes in every run.
    Whole,
    /// Files come one by one, the first with the end of the older ones.
    Growing,
    /// All at once, with times that were measured.
    Timed,
}

const CASES: [Case; 9] = [
    Case::whole(&["deform", "scene.toml", "--poses", "poses.toml", "-o", "o", "--surface", "stl"], &["o."]),
    Case::whole(&["precompute", "scene.toml", "--force"], &["scene.green"]),
    Case::whole(&["convert", "part.msh", "out.node"], &["out."]),
    Case::whole(&["export", "scene.toml", "-o", "shown.glb"], &["shown.glb"]),
    Case::whole(&["pack", "kept.green", "-o", "small.green.zst"], &["small."]),
    Case {
        name: "unpack",
        ..Case::whole(&["pack", "kept.green.zst", "-o", "again.green"], &["again.green"])
    },
    Case::whole(&["new", "part.msh", "--pull", "20mm", "-o", "made.toml", "--force"], &["made."]),
    Case {
        kind: Kind::Growing,
        ..Case::whole(
            &["render", "scene.toml", "--frames", "2", "--window-scale", "0.02", "-o", "shots"],
            &["shots/frame", "shots/contact"],
        )
    },
    Case {
        kind: Kind::Timed,
        ..Case::whole(
            &[
                "accuracy",
                "scene.toml",
                "--poses",
                "poses.toml",
                "--quick",
                "--largest",
                "500",
                "-o",
                "report",
            ],
            &["report/accuracy.", "report/index."],
        )
    },
];

impl Case {
    const fn whole(arguments: &'static [&'static str], set: &'static [&'static str]) -> Case {
        Case { name: arguments[0], arguments, set, kind: Kind::Whole }
    }

    /// Whether files are those of this run, all or, where it failed, the first of those that come one by one.
    fn are_new(&self, now: &Files, old: &Files, new: &Files, is_done: bool) -> bool {
        match self.kind {
            Kind::Whole => now == new,
            Kind::Growing => {
                (now.len() == new.len() || !is_done && !now.is_empty())
                    && now.iter().all(|(path, bytes)| new.get(path) == Some(bytes))
            }
            Kind::Timed => {
                now.keys().eq(new.keys()) && now.iter().all(|(path, bytes)| old.get(path) != Some(bytes))
            }
        }
    }

    /// Number of calls, of `all`, that are let fail: fewer of a report, which takes seconds.
    fn most(&self, all: usize) -> usize {
        if self.kind == Kind::Timed { all.div_ceil(4).min(20) } else { all }
    }
}

/// The kinds of calls, and how many of each are let fail in the short run.
const KINDS: [(&str, usize); 5] = [("write", 8), ("sync", 6), ("rename", 8), ("thread", 3), ("alloc", 12)];
/// Largest number of allocations that are let fail.
const MOST: usize = 400;

const SCENE: &str = r#"
[body.block]
generate = { block = { size = [2.0, 1.0, 1.0], cells = [3, 2, 2] } }
material = { young = 1e4, POISSON
control.low = { nodes = { group = "xmin" }, grab = "fixed" }
control.high = { nodes = { group = "xmax" }, grab = "dragger" }
"#;

fn command(place: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_greenstage"));
    command.current_dir(place).args(arguments).stdin(Stdio::null()).env("RUST_BACKTRACE", "0");
    command
}

fn succeeded(place: &Path, arguments: &[&str]) {
    let output = command(place, arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
}

/// The files of a user before the run: state 0 or 1.
fn prepare(place: &Path, state: usize) {
    let keys = [
        "poisson = 0.3 }\neffects = [\"haptics\", \"stress\"]",
        "poisson = 0.2 }\ncolor = [230, 50, 25]\neffects = [\"haptics\"]",
    ];
    std::fs::write(place.join("scene.toml"), SCENE.replace("POISSON", keys[state])).unwrap();
    let lift = ["0.01", "0.02"][state];
    let poses = format!("[[pose]]\nname = \"lift\"\ncontrol.high = {{ translation = [0.0, {lift}, 0.0] }}\n");
    std::fs::write(place.join("poses.toml"), poses).unwrap();
    let block = generate::Block { size: [1.0; 3], cells: [2 + state as u32, 1, 1] };
    let mut mesh = generate::block(&block).unwrap();
    // `new` names its poses after a group.
    if state == 1
        && let Some(nodes) = mesh.groups.remove("xmax")
    {
        mesh.groups.insert("tip".to_owned(), nodes);
    }
    mesh::save(&place.join("part.msh"), &mesh, None).unwrap();
}

type Files = BTreeMap<PathBuf, Vec<u8>>;

fn files(place: &Path) -> Files {
    let entries = std::fs::read_dir(place).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| match path.is_dir() {
            true => files(&path),
            false => Files::from([(path.clone(), std::fs::read(path).unwrap())]),
        })
        .collect()
}

fn of_set(case: &Case, place: &Path, files: &Files) -> Files {
    let is_one = |path: &&PathBuf| {
        let name = path.strip_prefix(place).unwrap().to_str().unwrap();
        case.set.iter().any(|begin| name.starts_with(begin))
    };
    files.keys().filter(is_one).map(|path| (path.clone(), files[path].clone())).collect()
}

fn restore(place: &Path, to: &Files) {
    files(place)
        .keys()
        .filter(|path| !to.contains_key(*path))
        .for_each(|path| std::fs::remove_file(path).unwrap());
    to.iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
}

/// `kept.green` and its packed form, of the scene as it is.
fn pack(place: &Path) {
    succeeded(place, &["precompute", "scene.toml"]);
    std::fs::copy(place.join("scene.green"), place.join("kept.green")).unwrap();
    succeeded(place, &["pack", "kept.green"]);
}

/// The shim as a library.
fn shim() -> PathBuf {
    let place = folder("faults-shim");
    let (source, library) =
        (Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/faults.c"), place.join("faults.so"));
    let made = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .arg(&library)
        .arg(&source)
        .arg("-ldl")
        .status();
    assert!(made.unwrap().success());
    library
}

/// Runs with one call that fails; how many there were where it came to its end.
fn run(place: &Path, case: &Case, shim: &Path, (kind, at): (&str, usize)) -> (Output, Option<usize>) {
    let count = place.with_extension("count");
    let _ = std::fs::remove_file(&count);
    let output = command(place, case.arguments)
        .envs([("LD_PRELOAD", shim), ("FAULT_COUNT", count.as_path())])
        .env("FAULT_KIND", kind)
        .env("FAULT_AT", at.to_string())
        .output()
        .unwrap();
    let count = std::fs::read_to_string(count).ok().and_then(|count| count.trim().parse().ok());
    (output, count)
}

#[test]
fn whatever_fails_there_is_no_panic_and_no_mixed_set() {
    let is_all = std::env::var("GREENSTAGE_FAULTS").as_deref() == Ok("all");
    let shim = shim();
    for case in &CASES {
        if case.name == "render" && require_gpu().is_none() {
            continue;
        }
        let place = folder(&format!("faults-{}", case.name));
        prepare(&place, 0);
        pack(&place);
        succeeded(&place, case.arguments);
        let old = of_set(case, &place, &files(&place));
        prepare(&place, 1);
        if case.arguments[0] == "pack" {
            pack(&place);
        }
        let before = files(&place);
        succeeded(&place, case.arguments);
        let new = of_set(case, &place, &files(&place));
        let same = new.iter().find(|(path, bytes)| old.get(*path) == Some(bytes));
        assert!(
            !old.is_empty() && same.is_none(),
            "{}: {:?} hides a mixed set",
            case.name,
            same.map(|(path, _)| path)
        );
        for (kind, some) in KINDS {
            restore(&place, &before);
            let (_, count) = run(&place, case, &shim, (kind, 0));
            let count = count.unwrap();
            let all = MOST.max(if kind == "alloc" { 0 } else { count });
            let most = case.most(if is_all { all } else { some });
            let (mut refused, mut replaced) = (0, 0);
            for i in 0..most.min(count) {
                let at = 1 + i * count / most.min(count);
                restore(&place, &before);
                let (output, _) = run(&place, case, &shim, (kind, at));
                let told = text(&output.stderr);
                let what = format!("{}: {kind} {at} of {count}: {:?}\n{told}", case.name, output.status);
                assert!(!told.contains("panicked"), "{what}");
                // Before `main` Rust itself aborts where memory is refused.
                let is_aborted = kind == "alloc" && output.status.signal() == Some(libc::SIGABRT);
                assert!(is_aborted || matches!(output.status.code(), Some(0..=2)), "{what}");
                let now = of_set(case, &place, &files(&place));
                let is_done = output.status.success();
                let is_new = case.are_new(&now, &old, &new, is_done);
                assert!(is_new || now == old, "mixed: {what}\n{:?}", now.keys());
                assert!(!is_done || is_new, "not written: {what}");
                refused += usize::from(!is_done);
                replaced += usize::from(is_new);
            }
            println!(
                "{}: {kind}: {count} calls, {} let fail: {refused} refused, {replaced} replaced",
                case.name,
                most.min(count)
            );
        }
    }
}

/// The paths were written between the renames: the first file was new and the second old.
#[test]
fn results_that_cannot_be_printed_are_all_there() {
    let place = folder("faults-full");
    prepare(&place, 1);
    let arguments = ["deform", "scene.toml", "--poses", "poses.toml", "-o", "o"];
    succeeded(&place, &arguments);
    let names = |files: Files| {
        files.into_keys().filter(|path| path.to_str().unwrap().contains("/o.")).collect::<Vec<_>>()
    };
    let all = names(files(&place));
    all.iter().for_each(|path| std::fs::remove_file(path).unwrap());
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let status = command(&place, &arguments).stdout(full).stderr(Stdio::null()).status().unwrap();
    assert_eq!(status.code(), Some(1));
    assert_eq!(names(files(&place)), all);
}
