//! Limits of the system: signals, a full disk behind its streams, too little memory, files without end.

use super::{greenstage, project, refuse};
use crate::common::{block_text, folder, program, text};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A block of `cells`³ cells, without a mesh file.
fn block(name: &str, cells: u32) -> std::path::PathBuf {
    let folder = folder(name);
    std::fs::write(folder.join("scene.toml"), block_text([cells; 3], "")).unwrap();
    folder
}

/// METIS installs a handler for SIGTERM while it orders, and made "ordering failed" of it.
#[test]
fn a_request_to_end_is_obeyed_whatever_is_computed() {
    let folder = block("cli-ended", 24);
    let (mut orderings, mut interrupted) = (0, 0);
    for kill in 0..10 {
        let mut precompute = program(&folder, &["precompute", "scene.toml", "--verbose"]);
        let mut child = precompute.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let mut told = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("assembly") {
            line.clear();
            assert!(told.read_line(&mut line).unwrap() > 0, "it ended by itself");
        }
        std::thread::sleep(Duration::from_millis(5 + 12 * kill));
        let ended = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
        assert!(ended.success());
        let mut rest = String::new();
        told.read_to_string(&mut rest).unwrap();
        let status = child.wait().unwrap();
        if status.success() {
            // The test was held up until all was computed.
            std::fs::remove_file(folder.join("scene.green")).unwrap();
            continue;
        }
        interrupted += 1;
        assert_eq!(status.signal(), Some(15), "{rest}");
        assert!(rest.contains("interrupted by SIGTERM: scene.green was not written"), "{rest}");
        orderings += usize::from(!rest.contains("ordering"));
        let left = std::fs::read_dir(&folder).unwrap().count();
        assert_eq!(left, 1, "the scene alone");
    }
    println!("{orderings} of {interrupted} in the ordering");
    assert!(interrupted > 0);
}

#[test]
fn what_cannot_be_said_costs_no_work() {
    let folder = project("cli-mute");
    let full = || File::options().write(true).open("/dev/full").unwrap();
    let mut precompute = program(&folder, &["precompute", "scene.toml"]);
    assert!(precompute.stderr(full()).stdout(Stdio::null()).status().unwrap().success());
    assert!(folder.join("scene.green").exists());
    let failed = program(&folder, &["inspect", "scene.green"]).stdout(full()).output().unwrap();
    assert_eq!(failed.status.code(), Some(1));
    assert!(text(&failed.stderr).contains("No space left"), "{}", text(&failed.stderr));
    let mut wrong = program(&folder, &["inspect", "missing.green"]);
    let status = wrong.env("GREENSTAGE_LOG", "trace").stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(2), "and no panic");
}

#[test]
fn a_name_that_is_no_text_is_shown_in_json() {
    let folder = project("cli-bytes");
    let name = OsStr::from_bytes(b"m\xff.msh");
    std::fs::copy(folder.join("block.msh"), folder.join(name)).unwrap();
    let scene = OsStr::from_bytes(b"s\xff.toml");
    std::fs::copy(folder.join("scene.toml"), folder.join(scene)).unwrap();
    for (command, file) in [("inspect", name), ("inspect", scene), ("check", scene)] {
        let output = program(&folder, &[command, "--json"]).arg(file).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap().is_object());
        assert!(text(&output.stdout).contains('\u{fffd}'));
    }
}

#[test]
fn a_hundred_thousand_threads_are_refused() {
    let folder = project("cli-threads");
    let mut precompute = program(&folder, &["precompute", "scene.toml"]);
    let output = precompute.env("RAYON_NUM_THREADS", "100000").output().unwrap();
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("RAYON_NUM_THREADS asks for 100000 threads"), "{message}");
}

/// Runs `precompute` with an address space of `megabytes` MB; returns its status and its message.
fn precompute_within(folder: &Path, megabytes: u32) -> (Option<i32>, String) {
    let command =
        format!("ulimit -v {} && exec \"$0\" precompute scene.toml --force --quiet", 1000 * megabytes);
    let output = Command::new("sh")
        .args(["-c", &command, env!("CARGO_BIN_EXE_greenstage")])
        .current_dir(folder)
        .env("RAYON_NUM_THREADS", "2")
        .output()
        .unwrap();
    (output.status.code(), text(&output.stderr))
}

#[test]
fn too_little_memory_is_told_with_its_figures() {
    let folder = block("cli-memory", 20);
    let mut told = Vec::new();
    for megabytes in [80, 90, 100, 130, 160, 200, 250, 300, 400, 500, 700] {
        let (status, message) = precompute_within(&folder, megabytes);
        if status != Some(0) {
            assert_eq!(status, Some(1), "{megabytes} MB: {message}");
            assert!(message.contains("error: ") && message.contains("memory"), "{megabytes} MB: {message}");
            assert!(!message.contains("panicked"), "{megabytes} MB: {message}");
            told.push((megabytes, message));
        }
    }
    let figures = told.iter().filter(|(_, message)| message.contains("ulimit -v) leaves")).count();
    assert!(figures >= 2, "{told:#?}");
    let (status, message) = precompute_within(&folder, 4000);
    assert_eq!(status, Some(0), "{message}");
}

/// Whatever the solver and the limit, a run ends with status 0 or with a refusal, and a refusal of a factor names what fits.
#[test]
fn every_solver_is_refused_in_order_or_fits() {
    for (solver, limits) in
        [("pcg", [90, 130, 170, 210]), ("mixed", [90, 160, 240, 400]), ("auto", [90, 130, 170, 210])]
    {
        let folder = folder(&format!("cli-memory-{solver}"));
        let extra = format!("solver = {{ method = \"{solver}\" }}");
        std::fs::write(folder.join("scene.toml"), block_text([14; 3], &extra)).unwrap();
        for megabytes in limits {
            let (status, message) = precompute_within(&folder, megabytes);
            assert!(matches!(status, Some(0 | 1)), "{solver}, {megabytes} MB: {status:?} {message}");
            assert!(
                status == Some(0) || message.contains("of memory"),
                "{solver}, {megabytes} MB: {message}"
            );
            assert!(!message.contains("panicked"), "{solver}, {megabytes} MB: {message}");
            if message.contains(" needs ") && message.contains("a factor of") {
                assert!(
                    message.contains("what would fit: ") && message.contains("thousand nodes"),
                    "{message}"
                );
            }
        }
    }
}

/// The figures of `peak memory 152.33 MB, where 160.12 MB were planned`, MB.
fn planned(folder: &Path) -> [f64; 2] {
    let mut precompute = program(folder, &["precompute", "scene.toml", "--force", "--quiet"]);
    // Each thread has buffers of its own.
    let output = precompute.env("RAYON_NUM_THREADS", "2").output().unwrap();
    let told = text(&output.stdout);
    let of = |before: &str| -> f64 {
        let (_, rest) = told.split_once(before).unwrap();
        rest.split(' ').next().unwrap().parse().unwrap()
    };
    assert!(told.contains(" MB, where ") && told.contains(" MB were planned"), "{told}");
    [of("peak memory "), of(", where ")]
}

#[test]
fn memory_is_planned_as_it_is_used() {
    let solver = |method: &str| format!("solver = {{ method = \"{method}\" }}");
    let model = |name: &str| format!("model = \"{name}\"");
    for (cells, extra) in [
        (20, solver("cholesky")),
        (20, solver("pcg")),
        // 211 MB were used where 134 MB were planned: for the body alone, without the fields that its model takes.
        (8, model("reduced")),
        (8, model("reduced_neo_hookean")),
        (10, model("perturbation")),
    ] {
        let folder = folder("cli-planned");
        std::fs::write(folder.join("scene.toml"), block_text([cells; 3], &extra)).unwrap();
        let [real, plan] = planned(&folder);
        println!("{cells}³, {extra}: {real} MB, planned {plan}");
        assert!((0.75..1.4).contains(&(plan / real)), "{cells}³, {extra}: {real} MB, planned {plan}");
    }
}

#[test]
fn a_compressed_compliance_takes_no_more_memory_than_planned() {
    for error in ["1e-2", "1e-4"] {
        let folder = folder(&format!("cli-planned-{error}"));
        let extra = format!("surface_compliance = {{ nodes = \"surface\", kept = {{ error = {error} }} }}");
        std::fs::write(folder.join("scene.toml"), block_text([14; 3], &extra)).unwrap();
        let [real, plan] = planned(&folder);
        println!("{error}: {real} MB, planned {plan}");
        assert!((1.0..1.5).contains(&(plan / real)), "{error}: {real} MB, planned {plan}");
    }
}

#[test]
fn files_without_end_are_no_meshes() {
    let folder = project("cli-endless");
    let pipe = folder.join("pipe.msh");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let scene = std::fs::read_to_string(folder.join("scene.toml")).unwrap();
    for mesh in ["/dev/zero", "/dev/urandom", "pipe.msh"] {
        std::fs::write(folder.join("scene.toml"), scene.replace("block.msh", mesh)).unwrap();
        for command in ["check", "precompute"] {
            refuse_in_time(&folder, &[command, "scene.toml"], "device or a pipe");
        }
        refuse_in_time(&folder, &["inspect", mesh], "device or a pipe");
    }
    refuse(&folder, &["inspect", "."], &["folder"]);
    assert!(greenstage(&folder, &["inspect", "block.msh"]).status.success());
}

/// The file is a regular one by its mode, and reading waits for the next message of the kernel.
#[test]
fn files_of_the_system_that_wait_are_not_waited_for() {
    let folder = project("cli-waiting");
    refuse_in_time(&folder, &["inspect", "/proc/kmsg"], "/proc/kmsg");
    refuse_in_time(&folder, &["check", "/proc/kmsg"], "/proc/kmsg");
}

/// The stack overflowed in the first thread, whose size is what the shell allows.
#[test]
fn a_small_stack_of_the_shell_is_enough() {
    let folder = block("cli-stack", 6);
    for arguments in ["precompute scene.toml", "check scene.toml", "render scene.toml -o picture"] {
        let command = format!("ulimit -s 64 && exec \"$0\" {arguments}");
        let mut shell = Command::new("sh");
        shell.args(["-c", &command, env!("CARGO_BIN_EXE_greenstage")]).current_dir(&folder);
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{arguments}: {:?} {}", output.status, text(&output.stderr));
    }
}

/// [`refuse`] of a program that may hang.
fn refuse_in_time(folder: &Path, arguments: &[&str], expected: &str) {
    let mut command = program(folder, arguments);
    let mut child = command.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if started.elapsed() > Duration::from_secs(120) {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("{arguments:?} did not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let mut message = String::new();
    child.stderr.take().unwrap().read_to_string(&mut message).unwrap();
    child.stdout.take().unwrap().read_to_string(&mut message).unwrap();
    assert_eq!(status.code(), Some(2), "{arguments:?}: {message}");
    assert!(message.contains(expected), "{arguments:?}: {message}");
}
