//! Keys of the desk in a window of `greenstage view`: a picture of what is seen, a video, the bodies as glTF, the panel.

use crate::common::{coarse_demo, folder};
use crate::display_common::{Display, wait_for};
use crate::render_common::require_gpu;
use image::codecs::png::PngDecoder;
use image::{AnimationDecoder, RgbImage};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const TAB: u32 = 0xff09;
const F9: u32 = 0xffc6;
const F11: u32 = 0xffc8;
const F12: u32 = 0xffc9;

/// The first file in the folder that has one of these ends and is not `but`.
fn written(place: &Path, ends: &[&str], but: Option<&Path>) -> Option<PathBuf> {
    let files = std::fs::read_dir(place).unwrap().map(|entry| entry.unwrap().path());
    let is_one = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        name.starts_with("greenstage-")
            && ends.iter().any(|end| name.ends_with(end))
            && Some(path.as_path()) != but
    };
    files.into_iter().find(is_one)
}

/// Pixels that differ by more than a rounding.
fn different(a: &RgbImage, b: &RgbImage) -> usize {
    let differs = |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).any(|k| a.0[k].abs_diff(b.0[k]) > 2);
    a.pixels().zip(b.pixels()).filter(differs).count()
}

/// Whether a film can be shown to its end.
fn is_whole(film: &Path) -> bool {
    if film.extension().is_some_and(|end| end == "mp4") {
        let shown = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-i"])
            .arg(film)
            .args(["-f", "null", "-"])
            .output();
        return shown.is_ok_and(|shown| shown.status.success() && shown.stderr.is_empty());
    }
    let decoder = PngDecoder::new(Cursor::new(std::fs::read(film).unwrap()));
    decoder.and_then(|png| png.apng()?.into_frames().collect_frames()).is_ok_and(|frames| !frames.is_empty())
}

#[test]
fn keys_save_what_is_seen_and_open_the_panel() {
    let Some(_) = require_gpu() else { return };
    let Some(display) = Display::start([700, 460]) else { return };
    let place = folder("desk-keys");
    coarse_demo(&place);
    let scene = std::fs::read_to_string(place.join("tube.toml")).unwrap();
    let still: String =
        scene.lines().filter(|line| !line.starts_with("script")).map(|l| format!("{l}\n")).collect();
    std::fs::write(place.join("tube.toml"), still).unwrap();
    // Beside the body, so that what it points at is not lit up.
    const CURSOR: [i16; 2] = [100, 100];
    display.move_cursor(CURSOR);
    let _view = display.run(
        Command::new(env!("CARGO_BIN_EXE_greenstage"))
            .current_dir(&place)
            .args([
                "view",
                "tube.toml",
                "--stage",
                "desktop",
                "--window-scale",
                "0.5",
                "--samples",
                "1",
                "--no-vsync",
            ])
            .stdout(Stdio::null()),
    );
    let window = wait_for("the window", || display.windows().into_iter().next());
    display.focus(window.id);
    let rect = [window.at[0] as u32, window.at[1] as u32, window.size[0], window.size[1]];
    let shows_body = |image: &RgbImage| image.pixels().filter(|p| p.0[0] > 80).count() > 500;
    // A window learns with the focus where the cursor is: before that its green ray starts from the middle.
    let near_cursor = |x: u32, y: u32| {
        let is_near =
            |pixel: u32, origin: i32, cursor: i16| (pixel as i32 + origin).abs_diff(i32::from(cursor)) < 8;
        is_near(x, window.at[0], CURSOR[0]) && is_near(y, window.at[1], CURSOR[1])
    };
    let aims = |image: &RgbImage| {
        let is_ray = |p: &image::Rgb<u8>| p.0[1] > 120 && p.0[0] < 80;
        image.enumerate_pixels().any(|(x, y, p)| near_cursor(x, y) && is_ray(p))
    };
    let mut before = None;
    let seen = wait_for("the body and the ray, standing still", || {
        let now = display.picture(rect);
        let stands = before.replace(now.clone()).is_some_and(|before| before == now);
        (stands && shows_body(&now) && aims(&now)).then_some(now)
    });

    display.type_key(F12);
    let saved = wait_for("the picture", || written(&place, &[".png"], None));
    let picture = image::open(&saved).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (window.size[0], window.size[1]));
    assert_eq!(different(&picture, &seen), 0, "the picture is what was seen");
    wait_for("what is told of it", || (different(&display.picture(rect), &seen) > 300).then_some(()));

    display.type_key(F9);
    let body = wait_for("the bodies", || written(&place, &[".glb"], None));
    assert_eq!(std::fs::read(body).unwrap()[..4], *b"glTF");

    // The panel is dark, where the room is grey.
    let dark = |image: &RgbImage| image.pixels().filter(|p| p.0.iter().all(|value| *value < 28)).count();
    display.type_key(TAB);
    wait_for("the panel", || (dark(&display.picture(rect)) > 20_000).then_some(()));
    display.type_key(F11);
    let film = wait_for("the video", || written(&place, &[".png", ".mp4"], Some(&saved)));
    display.type_key(F11);
    display.type_key(TAB);
    wait_for("the room without the panel", || (dark(&display.picture(rect)) < 10_000).then_some(()));
    wait_for("the end of the video", || is_whole(&film).then_some(()));
}
