//! A recorded session comes to the same state in every frame, with any number of threads; another scene, a damaged or a cut file
//! is reported.

use crate::{common, render_common};

use common::{coarse_demo, folder, greenstage, program, text};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Output;

/// The program in `folder`, with `threads` threads.
fn run(folder: &Path, threads: usize, arguments: &[&str]) -> Output {
    program(folder, arguments).env("RAYON_NUM_THREADS", threads.to_string()).output().unwrap()
}

const CHECK: [&str; 5] = ["view", "tube.toml", "--check", "--replay", "session.jsonl"];

/// Status, standard output and standard error of a replay of `session.jsonl`.
fn check(folder: &Path) -> (i32, String, String) {
    let output = run(folder, 2, &CHECK);
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

/// A folder with the coarse demo and its script as a session; and the session's lines.
fn recorded(name: &str) -> (PathBuf, Vec<String>) {
    let folder = folder(name);
    coarse_demo(&folder);
    greenstage(&folder, &["view", "tube.toml", "--check", "--record", "session.jsonl"]);
    let text = std::fs::read_to_string(folder.join("session.jsonl")).unwrap();
    (folder, text.lines().map(str::to_owned).collect())
}

#[test]
fn what_cannot_be_recorded_leaves_an_older_recording_alone() {
    let (folder, lines) = recorded("replay-refused");
    for command in [["view", "tube.toml", "--check"], ["render", "tube.toml", "-oout"]] {
        let arguments = [&command[..], &["--record", "session.jsonl", "--deform", "gpu"]].concat();
        let output = run(&folder, 2, &arguments);
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains("leave --deform out"), "{said}");
    }
    let text = std::fs::read_to_string(folder.join("session.jsonl")).unwrap();
    assert_eq!(text.lines().collect::<Vec<_>>(), lines);
}

fn write(folder: &Path, lines: &[String]) {
    std::fs::write(folder.join("session.jsonl"), lines.join("\n") + "\n").unwrap();
}

/// The end of an organ is cut off, falls onto a table, is pushed aside, picked up and dropped: in a replay with one thread too.
#[test]
fn a_piece_that_falls_off_falls_again_in_a_replay() {
    let folder = folder("replay-resect");
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    for part in ["scenes", "scripts"] {
        std::fs::create_dir(folder.join(part)).unwrap();
        let file = Path::new(part).join("resect.toml");
        std::fs::copy(configs.join(&file), folder.join(&file)).unwrap();
    }
    let scene = "scenes/resect.toml";
    let arguments =
        ["render", scene, "-oout", "--frames=110", "--window-scale=0.05", "--record", "session.jsonl"];
    let output = run(&folder, 2, &arguments);
    let said = text(&output.stdout) + &text(&output.stderr);
    assert!(said.contains("J of work, 1 piece has fallen off") && !said.contains("grabs nothing"), "{said}");
    let output = run(&folder, 1, &["view", scene, "--check", "--replay", "session.jsonl"]);
    let said = text(&output.stdout) + &text(&output.stderr);
    assert!(said.contains("frames, every one in the recorded state"), "{said}");
}

/// Two threads share one moved control element's columns at this body's 20,200 surface nodes.
#[test]
fn a_session_comes_to_the_same_state_in_every_frame_with_any_number_of_threads() {
    let folder = folder("replay-threads");
    let path = coarse_demo(&folder);
    let scene = std::fs::read_to_string(&path).unwrap();
    let scene = scene.replace("radial = 2, around = 20, along = 31", "radial = 1, around = 100, along = 100");
    std::fs::write(&path, scene).unwrap();
    for threads in [1, 2] {
        let file = format!("session{threads}.jsonl");
        let output = run(&folder, threads, &["view", "tube.toml", "--check", "--record", &file]);
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
    assert_eq!(read("session1.jsonl"), read("session2.jsonl"), "two recordings of one script, byte for byte");
    let session = read("session1.jsonl");
    let hashes: BTreeSet<&str> = session.lines().filter_map(|line| line.split("\"hash\":").nth(1)).collect();
    assert!(hashes.len() > 150, "the tube moves: {} states of 240 frames", hashes.len());
    for threads in [1, 2] {
        for _ in 0..2 {
            let arguments = ["view", "tube.toml", "--check", "--replay", "session1.jsonl"];
            let output = run(&folder, threads, &arguments);
            let said = text(&output.stdout);
            assert!(output.status.success(), "{}", text(&output.stderr));
            assert!(said.contains("session1.jsonl: 240 frames, every one in the recorded state"), "{said}");
        }
    }
}

#[test]
fn a_session_of_another_scene_stage_or_program_is_refused() {
    let (folder, lines) = recorded("replay-other");
    let scene = std::fs::read_to_string(folder.join("tube.toml")).unwrap();
    for (from, to) in [
        ("\"rotation\"", "\"linear\""),
        ("young = 1.0e6", "young = 2.0e6"),
        ("grab = \"fixed\"", "grab = \"dragger\""),
    ] {
        assert!(scene.contains(from));
        std::fs::write(folder.join("tube.toml"), scene.replace(from, to)).unwrap();
        let (status, _, said) = check(&folder);
        assert_eq!(status, 2, "{to}: {said}");
        assert!(said.contains("session.jsonl: it was recorded with another scene than tube.toml"), "{said}");
    }
    std::fs::write(folder.join("tube.toml"), scene).unwrap();
    let other_stage = run(&folder, 1, &[&CHECK[..], &["--stage", "cyberstage"]].concat());
    let said = text(&other_stage.stderr);
    assert_eq!(other_stage.status.code(), Some(2));
    let refusal = "it was recorded on the stage workbench, not on cyberstage: leave out --stage";
    assert!(said.contains(refusal), "{said}");

    let mut other = lines.clone();
    other[0] = lines[0].replace(env!("CARGO_PKG_VERSION"), "0.0.7");
    write(&folder, &other);
    let (status, _, said) = check(&folder);
    assert_eq!(status, 2);
    assert!(said.contains("it was recorded by greenstage 0.0.7, this is "), "{said}");
    write(&folder, &lines);
    assert_eq!(check(&folder).0, 0);
}

/// The stage file is named from the recording's folder: both are replayed from anywhere, and moved together.
#[test]
fn a_session_on_a_stage_file_is_replayed_from_another_folder() {
    let folder = folder("replay-elsewhere");
    for place in ["lab/stages", "lab/sessions", "lab/else"] {
        std::fs::create_dir_all(folder.join(place)).unwrap();
    }
    coarse_demo(&folder.join("lab"));
    let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/stages/workbench.toml");
    std::fs::copy(built_in, folder.join("lab/stages/bench.toml")).unwrap();
    let record =
        ["view", "tube.toml", "--stage", "stages/bench.toml", "--check", "--record", "sessions/a.jsonl"];
    greenstage(&folder.join("lab"), &record);
    let replay = |from: &str, scene: &str, session: &str| {
        let output = run(&folder.join(from), 2, &["view", scene, "--check", "--replay", session]);
        (output.status.code(), text(&output.stderr))
    };
    assert_eq!(replay("lab/else", "../tube.toml", "../sessions/a.jsonl").0, Some(0));
    std::fs::rename(folder.join("lab"), folder.join("moved")).unwrap();
    let (status, said) = replay(".", "moved/tube.toml", "moved/sessions/a.jsonl");
    assert_eq!(status, Some(0), "{said}");
    std::fs::rename(folder.join("moved/stages"), folder.join("moved/else/stages")).unwrap();
    let (status, said) = replay("moved", "tube.toml", "sessions/a.jsonl");
    assert_eq!(status, Some(2), "{said}");
    assert!(said.contains("is not at sessions/../stages/bench.toml"), "{said}");
    assert!(said.contains("by --stage"), "{said}");
}

#[test]
fn a_window_may_be_elsewhere_at_the_replay_but_not_the_workspace() {
    let folder = folder("replay-stage");
    coarse_demo(&folder);
    let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/stages/workbench.toml");
    let stage = std::fs::read_to_string(built_in).unwrap();
    let write = |stage: &str| std::fs::write(folder.join("bench.toml"), stage).unwrap();
    write(&stage);
    let arguments = ["view", "tube.toml", "--stage", "bench.toml", "--check"];
    greenstage(&folder, &[&arguments[..], &["--record", "session.jsonl"]].concat());
    let replay = || run(&folder, 2, &[&arguments[..], &["--replay", "session.jsonl"]].concat());
    for (from, to, status) in
        [("pixels = [1280, 1024]", "pixels = [1279, 1024]", 0), ("radius = ", "radius = 1.1e-0 # ", 2)]
    {
        assert!(stage.contains(from), "{from}");
        write(&stage.replace(from, to));
        let output = replay();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{to}: {said}");
        assert!(status == 0 || said.contains("the stage bench.toml has changed"), "{said}");
    }
}

#[test]
fn a_recording_without_frames_is_no_success() {
    let (folder, lines) = recorded("replay-empty");
    write(&folder, &lines[..lines.len() - 240]);
    let (status, _, said) = check(&folder);
    assert!(status == 1, "{status}: {said}");
    assert!(said.contains("session.jsonl: none of its 0 frames was played"), "{status}: {said}");
}

#[test]
fn a_cut_session_is_replayed_up_to_the_cut() {
    let (folder, lines) = recorded("replay-cut");
    let whole = lines.join("\n") + "\n";
    let cut = |bytes: usize| {
        std::fs::write(folder.join("session.jsonl"), &whole.as_bytes()[..bytes]).unwrap();
        check(&folder)
    };
    let before_last = whole.len() - lines[lines.len() - 1].len() - 1;
    for bytes in [whole.len() - 1, whole.len() - 30, before_last + 1] {
        let (status, said, noted) = cut(bytes);
        assert_eq!(status, 0, "{noted}");
        assert!(said.contains("239 frames, every one in the recorded state"), "{said}");
        assert!(noted.contains("it ends in the middle of frame 239, which is left out"), "{noted}");
    }
    let (status, said, noted) = cut(before_last);
    assert!(status == 0 && said.contains("239 frames, every one"), "{said}{noted}");
    assert!(!noted.contains("middle"), "{said}{noted}");
    for (bytes, told) in
        [(0, "line 1: not a recording"), (40, "line 1"), (lines[0].len() + 30, "line 2: the stream ends")]
    {
        let (status, _, said) = cut(bytes);
        assert!(status == 2 && said.contains(told), "{bytes}: {said}");
    }
}

#[test]
fn a_changed_session_is_told_by_its_first_frame() {
    let (folder, lines) = recorded("replay-changed");
    let first = lines.len() - 240;
    // The stylus of a frame in the middle of the bend, moved by hand.
    let frame: serde_json::Value = serde_json::from_str(&lines[first + 100]).unwrap();
    let mut moved = frame.clone();
    moved["input"]["trackers"]["styli"][0]["room_from_stylus"][1] = serde_json::json!(0.5);
    let mut changed = lines.clone();
    changed[first + 100] = moved.to_string();
    write(&folder, &changed);
    let (status, _, said) = check(&folder);
    assert_eq!(status, 1, "{said}");
    let first_fault =
        "of 240 frames are in another state than was recorded, the first of them frame 100 at 1.67";
    assert!(said.contains(first_fault), "{said}");

    for (text, told) in [
        (lines[first + 101].clone(), "frame 101 stands where 100 should"),
        ("{}".to_owned(), "not a frame: missing field"),
        (lines[first + 100].replace("\"pressed\"", "\"presed\""), "not a frame: unknown field `presed`"),
        (
            lines[first + 100].replace("\"signal\":\"live\"", "\"signal\":\"dead\""),
            "not a frame: unknown variant `dead`",
        ),
        ("x".repeat(1 << 21), "is longer than 1048576 bytes"),
        (
            lines[first + 100].replace("\"styli\":[", &format!("\"styli\":[{}", "[".repeat(100_000))),
            "not a frame",
        ),
    ] {
        changed[first + 100] = text;
        write(&folder, &changed);
        let (status, _, said) = check(&folder);
        assert_eq!(status, 2, "{said}");
        assert!(said.contains(told) && said.contains(&format!("line {}", first + 101)), "{told}: {said}");
    }
}

#[test]
fn no_mutated_session_panics() {
    let (folder, lines) = recorded("replay-mutated");
    let whole = lines.join("\n") + "\n";
    // Knuth's linear congruential generator.
    let mut seed = 7u64;
    let mut below = |n: usize| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as usize % n
    };
    let mut seen = BTreeSet::new();
    for round in 0..40 {
        let mut bytes = whole.clone().into_bytes();
        for _ in 0..1 + below(4) {
            let at = below(if round % 2 == 0 { lines[0].len() + 4000 } else { bytes.len() });
            bytes[at] = match below(3) {
                0 => below(256) as u8,
                1 => b"0123456789-e."[below(13)],
                _ => bytes[at] ^ (1 << below(8)),
            };
        }
        std::fs::write(folder.join("session.jsonl"), &bytes).unwrap();
        let (status, _, said) = check(&folder);
        assert!((0..=2).contains(&status) && !said.contains("panicked"), "{status}: {said}");
        seen.insert(status);
    }
    assert!(seen.contains(&2), "{seen:?}");
}

#[test]
fn pictures_follow_a_session() {
    if render_common::require_gpu().is_none() {
        return;
    }
    let (folder, lines) = recorded("replay-pictures");
    let render = |from: &[&str], out: &str| {
        let arguments = ["render", "tube.toml", "--frames", "3", "--window-scale", "0.1", "-o", out];
        let output = greenstage(&folder, &[&arguments, from].concat());
        (text(&output.stdout), std::fs::read(folder.join(out).join("contact-sheet.png")).unwrap())
    };
    let (said, replayed) = render(&["--replay", "session.jsonl"], "replayed");
    assert!(said.contains("240 frames, every one in the recorded state"), "{said}");
    let (_, scripted) = render(&[], "scripted");
    let pixels = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().to_rgb8();
    let (replayed, scripted) = (pixels(&replayed), pixels(&scripted));
    let apart = replayed.iter().zip(scripted.iter()).filter(|(a, b)| a.abs_diff(**b) > 60).count();
    let part = apart as f64 / scripted.len() as f64;
    assert!(replayed.dimensions() == scripted.dimensions() && part < 0.02, "{part} of the pixels differ");
    let one = [
        "render",
        "tube.toml",
        "--frames",
        "1",
        "--window-scale",
        "0.05",
        "-o",
        "one",
        "--replay",
        "session.jsonl",
    ];
    let said = text(&greenstage(&folder, &one).stdout);
    assert!(
        said.contains("240 frames, every one in the recorded state"),
        "one picture is of the end: {said}"
    );
    // Where a state differs, the pictures are made, and the exit status tells.
    let mut changed = lines.clone();
    let last = changed.len() - 1;
    changed[last] = changed[last].replace("\"hash\":\"", "\"hash\":\"0");
    write(&folder, &changed);
    let [.., replay, session] = one;
    let other =
        ["render", "tube.toml", "--frames", "2", "--window-scale", "0.05", "-o", "other", replay, session];
    assert_eq!(run(&folder, 2, &other).status.code(), Some(1));
    assert!(folder.join("other/contact-sheet.png").exists());
}

/// The ruler is laid with the mouse, and one of its ends is then carried: the replay lays it on the same material, and it shows
/// the same distance in every frame.
#[test]
fn a_ruler_is_replayed_to_the_same_distance() {
    use greenstage::interact::Action;
    use greenstage::prepare::Resolved;
    use greenstage::session::{Request, Session};
    use greenstage::stage::Eye;
    use greenstage::track::MouseInput;
    use greenstage::track::mouse::Button;
    let folder = folder("replay-ruler");
    let scene = Resolved::load(&coarse_demo(&folder)).unwrap();
    let recording = folder.join("ruler.jsonl");
    let request = Request { stage: Some("desktop"), ..Request::new(&scene) };
    let mut session = Session::open(&Request { record: Some(&recording), ..request }).unwrap();
    session.take_over();
    session.attach_mouse();
    // The cursor before a place of the workspace, in its units.
    let aim = |session: &mut Session, [x, y]: [f64; 2]| {
        let stage = &session.world.assets.stage;
        let place = stage.workspace.centre + nalgebra::Vector3::new(x, y, 0.0) * stage.workspace.radius_m;
        let eye = stage.viewer.eye_in_room(&stage.viewer.room_from_head, Eye::Centre);
        let clip =
            stage.screens[0].view(&eye, 0.05).unwrap().clip_from_room.cast::<f64>() * place.to_homogeneous();
        session.mouse(MouseInput::Cursor { screen: 0, ndc: [clip.x / clip.w, clip.y / clip.w] });
    };
    let mut lengths = Vec::new();
    let mut frame = 0;
    let mut advance = |session: &mut Session| {
        session.advance(f64::from(frame) / 20.0).unwrap();
        frame += 1;
        lengths.extend(session.world.measured().map(|measured| measured.now_m));
    };
    for x in [-0.5, 0.9] {
        aim(&mut session, [x, 0.0]);
        advance(&mut session);
        session.act(Action::Measure);
    }
    let hold = |pressed| MouseInput::Button { button: Button::Left, pressed };
    advance(&mut session);
    session.mouse(hold(true));
    for step in 0..10 {
        aim(&mut session, [0.9, 0.03 * f64::from(step)]);
        advance(&mut session);
    }
    session.mouse(hold(false));
    assert_eq!(lengths.len(), 11);
    let (first, last) = (lengths[0], lengths[10]);
    assert!((0.6..0.9).contains(&first) && (last - first).abs() > 1e-3, "{first} m, {last} m");
    session.report().unwrap();
    let mut replayed = Session::open(&Request { replay: Some(&recording), ..request }).unwrap();
    let mut again = Vec::new();
    while replayed.play_frame().unwrap() {
        again.extend(replayed.world.measured().map(|measured| measured.now_m));
    }
    assert_eq!(lengths, again, "in every frame");
    replayed.report().unwrap();
}

/// The recording begins while a hand bends the bar and the curve is half drawn. The solved bar is then some frames behind the
/// hand; the graphics device deforms the part of the other that is not pointed at.
#[test]
fn a_recording_that_begins_in_the_middle_is_replayed_from_there() {
    use greenstage::prepare::Resolved;
    use greenstage::session::{Request, Session};
    let advance = |session: &mut Session, frames: std::ops::Range<u32>| {
        for frame in frames {
            session.advance(f64::from(frame) / 50.0).unwrap();
        }
    };
    let curve = |session: &Session| session.world.effects.iter().find_map(|effect| effect.table()).unwrap().1;
    for model in ["rotation", "neo_hookean"] {
        let folder = folder(&format!("replay-middle-{model}"));
        let text = format!(
            "script = \"bend\"\n[body.bar]\n\
             generate = {{ block = {{ size = [1.0, 0.1, 0.1], cells = [10, 1, 1] }} }}\n\
             material = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"{model}\"\neffects = [\"stress\", \"force_curve\"]\n\
             control.left = {{ nodes = {{ box = {{ min = [-9.0, -9.0, -9.0], max = [-0.35, 9.0, 9.0] }} }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ box = {{ min = [0.35, -9.0, -9.0], max = [9.0, 9.0, 9.0] }} }}, grab = \"dragger\" }}\n"
        );
        let scene = Resolved::parse(&text, &folder.join("bar.toml")).unwrap();
        let mut session = Session::open(&Request::new(&scene)).unwrap();
        session.world.wait_for_background();
        advance(&mut session, 0..90);
        session.world.bodies[0].deformer.be_patient(std::time::Duration::ZERO);
        advance(&mut session, 90..100);
        if model == "rotation" {
            let body = &mut session.world.bodies[0];
            body.deformer.sum_only_at(body.pickable());
        }
        let (half, recording) = (curve(&session), folder.join("bar-1.jsonl"));
        session.record(&recording).unwrap();
        advance(&mut session, 100..150);
        let seen = (session.world.state_hash(), curve(&session));
        assert!(half.lines().count() > 20 && seen.1.lines().count() > half.lines().count(), "{half}");
        let told = session.stop_recording().unwrap();
        assert_eq!(told, format!("50 frames recorded in {}\n", recording.display()));
        advance(&mut session, 150..160);
        assert_ne!(session.world.state_hash(), seen.0, "it goes on, and nothing more is recorded");

        let mut replayed =
            Session::open(&Request { replay: Some(&recording), ..Request::new(&scene) }).unwrap();
        assert_eq!(curve(&replayed), half);
        while replayed.play_frame().unwrap() {}
        assert_eq!((replayed.world.state_hash(), curve(&replayed)), seen);
        let told = replayed.report().unwrap();
        assert!(told.contains("50 frames, every one in the recorded state"), "{told}");
    }
}
