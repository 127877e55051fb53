//! The demo: its numbers against closed formulas, its pictures without a display, and the program far from its own folder.

use crate::common;

use common::{folder, program, text};
use greenstage::demo::CHAPTERS;
use greenstage::prepare::Resolved;
use greenstage::session::{Request, Session};
use greenstage::stage::Stage;
use std::path::{Path, PathBuf};
use std::process::Output;

/// The session of a built-in scene on the demo's stage; its .green file goes to a folder of the test.
fn session(name: &str, place: &Path) -> (Resolved, Session) {
    let text = greenstage::scene::built_in::BUILT_IN.iter().find(|(known, _)| *known == name).unwrap().1;
    let scene = Resolved::parse(text, &place.join(name).with_extension("toml")).unwrap();
    let session = Session::open(&Request { stage: Some("demo"), ..Request::new(&scene) }).unwrap();
    (scene, session)
}

/// Linear theory without lateral contraction: F = E A ΔL / L to all digits, whatever the mesh and however the ends are clamped.
#[test]
fn the_bar_of_the_demo_pulls_as_its_formula_says() {
    let (scene, mut session) = session("bar", &folder("demo-bar"));
    let chapter = CHAPTERS.iter().find(|chapter| chapter.name == "bar").unwrap();
    let duration_s = session.input.script.as_ref().unwrap().duration_s;
    let mut longest = 0.0_f64;
    for step in 0..=300 {
        session.advance(0.8 * duration_s * f64::from(step) / 300.0).unwrap();
        let body = &session.world.bodies[0];
        let longer = body.deformer.poses[1].translation.x;
        let force = body.deformer.wrenches().unwrap().0[1].force;
        let formula = 1.0e5 * 0.03 * 0.03 * longer / 0.2;
        assert!((force.x - formula).abs() < 1e-6 * (1.0 + formula.abs()), "{} against {formula}", force.x);
        assert!(force.yz().norm() < 1e-6, "{force}");
        longest = longest.max(longer);
    }
    assert!((0.015..0.025).contains(&longest), "pulled by {longest} m");
    let told = (chapter.numbers)(&scene, &session.world, 0.0);
    let newtons = format!(
        "{:.2} N",
        1.0e5 * 0.03 * 0.03 * session.world.bodies[0].deformer.poses[1].translation.x / 0.2
    );
    assert_eq!(told.matches(&newtons).count(), 2, "ours and theirs are {newtons}: {told}");
}

/// Every chapter has a scene, a script that moves it, and a stage of one window of one size.
#[test]
fn every_chapter_can_be_told_in_one_window() {
    for chapter in CHAPTERS {
        let scene = chapter.scene().unwrap();
        let stage = Stage::find(chapter.stage).unwrap();
        let script = greenstage::session::open::script(&scene, None).unwrap().unwrap();
        assert!(script.duration_s >= *chapter.stills_s.last().unwrap(), "{}", chapter.name);
        if chapter.name != "room" {
            let layout = stage.layout();
            assert_eq!((layout.len(), layout[0].size), (1, [1280, 800]), "{}", chapter.name);
        }
        assert!(chapter.text.len() < 240, "two lines of a caption: {}", chapter.text);
    }
}

fn far_away(name: &str, arguments: &[&str]) -> (PathBuf, Output) {
    let place = folder(name);
    let (empty, home) = (place.join("empty"), place.join("home"));
    std::fs::create_dir_all(&empty).unwrap();
    std::fs::create_dir_all(&home).unwrap();
    let mut command = program(&empty, arguments);
    command
        .env("HOME", &home)
        .env_remove("XDG_CACHE_HOME")
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY");
    (place, command.output().unwrap())
}

/// Draws what `make demo` draws, but small and without the film.
#[test]
fn every_chapter_is_drawn_and_needs_no_file_of_the_package() {
    let (place, output) = far_away("demo-far", &["demo", "--width", "160", "--no-film", "-o", "out"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let names: Vec<String> = (1..)
        .zip(CHAPTERS)
        .flat_map(|(number, chapter)| {
            (1..=chapter.stills_s.len()).map(move |still| format!("{number}-{}-{still}.png", chapter.name))
        })
        .collect();
    let said = text(&output.stdout);
    assert!(said.contains(&format!("{} pictures in out", names.len())), "{said}");
    for name in names.iter().map(String::as_str).chain(["contact-sheet.png"]) {
        let picture = image::open(place.join("empty/out").join(name)).unwrap().to_rgb8();
        let first = *picture.get_pixel(0, 0);
        assert!(picture.width() >= 160, "{name}");
        assert!(picture.pixels().any(|pixel| *pixel != first), "{name} is of one colour");
    }
    assert!(place.join("home/.cache/greenstage/bar.green").is_file());
    let left: Vec<_> =
        std::fs::read_dir(place.join("empty")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["out"], "nothing else is left in the folder");
}

#[test]
fn shells_and_man_know_every_command() {
    for shell in ["bash", "zsh", "fish"] {
        let (_, output) = far_away("demo-shells", &["completions", shell]);
        let script = text(&output.stdout);
        assert!(["stage-view", "precompute", "demo"].iter().all(|name| script.contains(name)), "{shell}");
    }
    let (place, output) = far_away("demo-man", &["man", "-o", "man"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let page = std::fs::read_to_string(place.join("empty/man/greenstage-render.1")).unwrap();
    assert!(page.contains(".TH") && page.contains("contact sheet"), "{page}");
    assert!(place.join("empty/man/greenstage-man.1").exists(), "every command of the help has a page");
}
