//! `greenstage view` under an X server of its own, without a window manager: windows stand where the stage file has
//! them, and interlaced rows follow the desktop's parity when a window is moved.

#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod common;
mod render_common;

use common::{coarse_demo, folder};
use image::RgbImage;
use render_common::require_gpu;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A process that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An X server with this screen, and its name; None, aloud, where a program that is needed is not there.
fn display(size: &str) -> Option<(Running, String)> {
    for program in ["Xvfb", "xwininfo", "xdotool", "import"] {
        if Command::new(program).arg("-help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
            eprintln!("SKIPPED: {program} is not installed");
            return None;
        }
    }
    let server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", &format!("{size}x24"), "-nolisten", "tcp"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let mut server = Running(server.unwrap());
    let mut number = String::new();
    BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut number).unwrap();
    assert!(!number.trim().is_empty(), "Xvfb did not start");
    Some((server, format!(":{}", number.trim())))
}

fn view(place: &Path, display: &str, arguments: &[&str]) -> Running {
    let child = Command::new(env!("CARGO_BIN_EXE_greenstage"))
        .current_dir(place)
        .args(["view", "tube.toml", "--no-vsync", "--samples", "1"])
        .args(arguments)
        .env("DISPLAY", display)
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    Running(child.unwrap())
}

fn said(display: &str, program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).env("DISPLAY", display).output().unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Asks again until the answer is there; a busy machine takes its time.
fn wait_for<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + Duration::from_secs(120);
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(Instant::now() < end, "waited two minutes for {what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Name, and size and place as X writes them: `640x512+0+512`.
type Placed = (String, String);

/// Every window that the program has open, sorted by name.
fn windows(display: &str) -> Vec<Placed> {
    let tree = said(display, "xwininfo", &["-root", "-tree"]);
    let of = |line: &str| {
        let name = line.split('"').nth(1)?.split(" – ").nth(2)?.to_owned();
        let place = line.split_whitespace().rev().nth(1)?;
        Some((name, place.to_owned()))
    };
    let mut found: Vec<_> =
        tree.lines().filter(|line| line.contains("greenstage – ")).filter_map(of).collect();
    found.sort();
    found
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
    if require_gpu().is_none() {
        return;
    }
    let Some((_server, display)) = display("2560x2048") else { return };
    let place = demo("windows-places");
    let own = "[[window]]\nname = \"top\"\nscreen = \"wall\"\nstereo = \"rows\"\nat = [700, 10]\nsize = [640, 512]\n\
               [[window]]\nname = \"bottom\"\nscreen = \"table\"\nstereo = \"anaglyph\"\nmonitor = 0\nat = [3, 600]\n\
               size = [320, 256]\nborder = \"unmanaged\"\n";
    let bench = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/stages/workbench.toml");
    std::fs::write(place.join("own.toml"), std::fs::read_to_string(bench).unwrap() + own).unwrap();
    let at = |name: &str, size: &str, x: i32, y: i32| (name.to_owned(), format!("{size}+{x}+{y}"));
    let cyberstage = |name: &str, column: i32, row: i32| at(name, "320x256", 320 * column, 256 * row);
    let cases: [(&str, &str, Vec<Placed>); 3] = [
        (
            "workbench",
            "0.5",
            vec![
                at("table left", "640x512", 0, 512),
                at("table right", "640x512", 640, 512),
                at("wall left", "640x512", 0, 0),
                at("wall right", "640x512", 640, 0),
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
        ("own.toml", "1", vec![at("bottom", "320x256", 3, 600), at("top", "640x512", 700, 10)]),
    ];
    for (stage, scale, expected) in cases {
        let _view = view(&place, &display, &["--stage", stage, "--scale", scale]);
        let mut seen = Vec::new();
        wait_for(&format!("the windows of {stage}"), || {
            seen = windows(&display);
            println!("{stage}: {seen:?}");
            (seen == expected).then_some(())
        });
    }
}

fn capture(place: &Path, display: &str, rect: [u32; 4]) -> RgbImage {
    let path = place.join("screen.png");
    let [x, y, width, height] = rect;
    let crop = format!("{width}x{height}+{x}+{y}");
    said(display, "import", &["-window", "root", "-crop", &crop, "+repage", path.to_str().unwrap()]);
    image::open(&path).unwrap().to_rgb8()
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
    if require_gpu().is_none() {
        return;
    }
    let Some((_server, display)) = display("640x480") else { return };
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
    said(&display, "xdotool", &["mousemove", "639", "479"]);
    let rect = |top: u32| [20, top, size[0], size[1]];
    let shows_body = |image: &RgbImage| image.pixels().filter(|p| p.0[0] > 80).count() > 500;
    let eyes = ["left", "right"].map(|eye| {
        let _view = view(&place, &display, &["--stage", &format!("{eye}.toml")]);
        wait_for(&format!("the {eye} eye's picture"), || {
            let image = capture(&place, &display, rect(31));
            shows_body(&image).then_some(image)
        })
    });
    let _view = view(&place, &display, &["--stage", "rows.toml"]);
    for top in [31, 44, 31] {
        let id = wait_for("the window", || {
            said(&display, "xdotool", &["search", "--name", "greenstage"]).lines().next().map(str::to_owned)
        });
        said(&display, "xdotool", &["windowmove", &id, "20", &top.to_string()]);
        let rows = wait_for(&format!("rows by the desktop's parity with the window at {top}"), || {
            let rows = rows_of(&capture(&place, &display, rect(top)), &eyes);
            is_right(&rows, top).then_some(rows)
        });
        let differing = rows.iter().filter(|is| is[0] != is[1]).count();
        println!("at {top}: {differing} of {} rows tell the eyes apart", rows.len());
        assert!(differing > 60 && !is_right(&rows, top + 1), "a parity that is off by one goes unseen");
    }
}
