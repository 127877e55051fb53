//! `greenstage view` under a separate X server, without a window manager: windows stand where the stage file has them, and
//! interlaced rows follow the desktop's parity when a window is moved.

use crate::common::{self, coarse_demo, folder};
use crate::display_common::{Display, Running, wait_for};
use crate::render_common::require_gpu;
use image::RgbImage;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn view(place: &Path, display: &Display, arguments: &[&str]) -> Running {
    display.run(
        Command::new(env!("CARGO_BIN_EXE_greenstage"))
            .current_dir(place)
            .args(["view", "tube.toml", "--no-vsync", "--samples", "1"])
            .args(arguments)
            .stdout(Stdio::null()),
    )
}

/// Name, place and size.
type Placed = (String, [i32; 2], [u32; 2]);

/// Every window that the program has open, sorted by name.
fn windows(display: &Display) -> Vec<Placed> {
    let windows = display.windows().into_iter();
    windows
        .map(|window| (window.title.split(" – ").nth(2).unwrap().to_owned(), window.at, window.size))
        .collect()
}

fn demo(name: &str) -> PathBuf {
    let place = folder(name);
    coarse_demo(&place);
    // Without the script nothing moves.
    let scene = std::fs::read_to_string(place.join("tube.toml")).unwrap();
    let still: String =
        scene.lines().filter(|line| !line.starts_with("script")).map(|l| format!("{l}\n")).collect();
    assert!(still.len() < scene.len());
    std::fs::write(place.join("tube.toml"), still).unwrap();
    place
}

#[test]
fn the_windows_of_the_workbench_and_the_cyberstage_stand_where_they_should() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([2560, 2048]) else { return };
    let place = demo("windows-places");
    let own = "[[window]]\nname = \"top\"\nscreen = \"wall\"\nstereo = \"rows\"\nat = [700, 10]\nsize = [640, 512]\n\
               [[window]]\nname = \"bottom\"\nscreen = \"table\"\nstereo = \"anaglyph\"\nmonitor = 0\nat = [3, 600]\n\
               size = [320, 256]\nborder = \"unmanaged\"\n";
    let bench = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/stages/workbench.toml");
    std::fs::write(place.join("own.toml"), std::fs::read_to_string(bench).unwrap() + own).unwrap();
    let half = |name: &str, x, y| (name.to_owned(), [x, y], [640, 512]);
    let cyberstage = |name: &str, column, row| (name.to_owned(), [320 * column, 256 * row], [320, 256]);
    let cases: [(&str, &str, Vec<Placed>); 3] = [
        (
            "workbench",
            "0.5",
            vec![
                half("table left", 0, 512),
                half("table right", 640, 512),
                half("wall left", 0, 0),
                half("wall right", 640, 0),
            ],
        ),
        (
            "cyberstage",
            "0.25",
            vec![
                cyberstage("floor left", 0, 3),
                cyberstage("floor right", 1, 3),
                cyberstage("front left", 0, 1),
                cyberstage("front right", 1, 1),
                cyberstage("left left", 0, 0),
                cyberstage("left right", 1, 0),
                cyberstage("right left", 0, 2),
                cyberstage("right right", 1, 2),
            ],
        ),
        ("own.toml", "1", vec![("bottom".to_owned(), [3, 600], [320, 256]), half("top", 700, 10)]),
    ];
    for (stage, scale, expected) in cases {
        let _view = view(&place, &display, &["--stage", stage, "--window-scale", scale]);
        let mut seen = Vec::new();
        wait_for(&format!("the windows of {stage}"), || {
            seen = windows(&display);
            println!("{stage}: {seen:?}");
            (seen == expected).then_some(())
        });
    }
}

/// Whether rows of `picture` (the window's) are those of the left eye's and of the right eye's picture alone: but for
/// up to four pixels, since the ray ends in the very surface that it hits, and either may win there.
fn rows_of(picture: &RgbImage, eyes: &[RgbImage; 2]) -> Vec<[bool; 2]> {
    let is_row_of = |eye: &RgbImage, y: u32| {
        let differs = |x: &u32| {
            let (a, b) = (picture.get_pixel(*x, y).0, eye.get_pixel(*x, y).0);
            (0..3).any(|k| a[k].abs_diff(b[k]) > 1)
        };
        (0..picture.width()).filter(differs).count() <= 4
    };
    (0..picture.height()).map(|y| [0, 1].map(|eye| is_row_of(&eyes[eye], y))).collect()
}

/// Whether every row is that of the eye whose turn it is, in a window whose top is at `top` on the desktop.
fn is_right(rows: &[[bool; 2]], top: u32) -> bool {
    rows.iter().enumerate().all(|(y, is)| is[(y as u32 + top) as usize % 2])
}

#[test]
fn interlaced_rows_follow_the_desktop_when_the_window_is_moved() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([640, 480]) else { return };
    let place = demo("windows-parity");
    let desktop = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/stages/desktop.toml");
    let desktop = std::fs::read_to_string(desktop).unwrap();
    let size = [320, 200];
    for kind in ["left", "right", "rows"] {
        let window = "[[window]]\nscreen = \"monitor\"\nat = [20, 31]\nsize = [320, 200]\n";
        let stage = desktop.replace("\"mono\"", &format!("\"{kind}\"")) + window;
        std::fs::write(place.join(format!("{kind}.toml")), stage).unwrap();
    }
    // The ray of the stylus follows the cursor: it stays in the corner.
    display.move_cursor([639, 479]);
    let rect = |top: u32| [20, top, size[0], size[1]];
    let shows_body = |image: &RgbImage| image.pixels().filter(|p| p.0[0] > 80).count() > 500;
    let eyes = ["left", "right"].map(|eye| {
        let _view = view(&place, &display, &["--stage", &format!("{eye}.toml")]);
        // Until the scene is there, the window shows what is computed.
        let mut before = Vec::new();
        wait_for(&format!("the {eye} eye's picture"), || {
            let image = display.picture(rect(31));
            let stands = before.iter().filter(|earlier| **earlier == image).count() >= 5;
            before.push(image.clone());
            (stands && shows_body(&image) && place.join("tube.green").exists()).then_some(image)
        })
    });
    let _view = view(&place, &display, &["--stage", "rows.toml"]);
    for top in [31, 44, 31] {
        let id = wait_for("the window", || Some(display.windows().first()?.id));
        display.move_window(id, [20, top as i32]);
        let rows = wait_for(&format!("rows by the desktop's parity with the window at {top}"), || {
            let rows = rows_of(&display.picture(rect(top)), &eyes);
            is_right(&rows, top).then_some(rows)
        });
        let differing = rows.iter().filter(|is| is[0] != is[1]).count();
        println!("at {top}: {differing} of {} rows tell the eyes apart", rows.len());
        assert!(differing > 60 && !is_right(&rows, top + 1), "a parity that is off by one goes unseen");
    }
}

/// The coarse demo with its script, and the first frames of a session of it.
fn recorded(name: &str) -> PathBuf {
    let place = folder(name);
    coarse_demo(&place);
    common::greenstage(&place, &["view", "tube.toml", "--check", "--record", "all.jsonl"]);
    let text = std::fs::read_to_string(place.join("all.jsonl")).unwrap();
    let end = text.match_indices("{\"frame\":").nth(20).unwrap().0;
    std::fs::write(place.join("session.jsonl"), &text[..end]).unwrap();
    place
}

/// The status of `view` with these arguments, and what it said on both outputs.
fn viewed(place: &Path, display: &Display, arguments: &[&str]) -> (Option<i32>, String) {
    let log = std::fs::File::create(place.join("said.txt")).unwrap();
    let mut running = display.run(
        Command::new(env!("CARGO_BIN_EXE_greenstage"))
            .current_dir(place)
            .args(["view", "tube.toml", "--no-vsync", "--samples", "1", "--window-scale", "0.1"])
            .args(arguments)
            .stdout(log.try_clone().unwrap())
            .stderr(log),
    );
    let status = running.0.wait().unwrap();
    (status.code(), std::fs::read_to_string(place.join("said.txt")).unwrap())
}

#[test]
fn a_session_that_is_replayed_in_windows_ends_with_its_last_frame() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([640, 480]) else { return };
    let place = recorded("windows-replay");
    let (status, said) = viewed(&place, &display, &["--replay", "session.jsonl"]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("20 frames, every one in the recorded state"), "{said}");
}

/// The file of a recording goes away while windows are open: an error of a frame, with a message.
#[test]
fn an_error_inside_a_frame_ends_with_a_message_and_its_status() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([640, 480]) else { return };
    let place = recorded("windows-error");
    let pipe = place.join("pipe.jsonl");
    let path = std::ffi::CString::new(pipe.to_str().unwrap()).unwrap();
    // SAFETY: the path outlives the call.
    assert_eq!(unsafe { libc::mkfifo(path.as_ptr(), 0o600) }, 0);
    // Takes some frames, and goes.
    let reader = std::thread::spawn(move || {
        let mut pipe = std::fs::File::open(pipe).unwrap();
        std::io::copy(&mut std::io::Read::take(&mut pipe, 20_000), &mut std::io::sink()).unwrap()
    });
    let (status, said) = viewed(&place, &display, &["--record", "pipe.jsonl", "--seconds", "200"]);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("error: cannot write the recording pipe.jsonl"), "{said}");
    assert_eq!(reader.join().unwrap(), 20_000);
}
