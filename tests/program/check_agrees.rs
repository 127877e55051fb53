//! `greenstage check` passes no scene that a session refuses, and refuses none that a session shows.

use crate::common;

use common::{folder, program, text};
use greenstage::deform::MODELS;
use greenstage::prepare::Resolved;
use greenstage::session::{Request, Session};
use std::path::Path;

const ENDS: &str = "control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
const MIDDLE: &str = "control.middle = { nodes = { box = { min = [-0.1, -9.0, -9.0], max = [0.1, 9.0, 9.0] } }, grab = \"fixed\" }\n";
const QUARTERS: &str = "control.a = { nodes = { box = { min = [-0.6, -9.0, -9.0], max = [-0.4, 9.0, 9.0] } }, grab = \"fixed\" }\n\
     control.b = { nodes = { box = { min = [0.4, -9.0, -9.0], max = [0.6, 9.0, 9.0] } }, grab = \"fixed\" }\n";
const ALL: &str = "control.all = { nodes = { box = { min = [-9.0, -9.0, -9.0], max = [9.0, 9.0, 9.0] } }, grab = \"dragger\" }\n";
const LEFT: &str = "control.left = { nodes = { group = \"xmin\" }, grab = \"dragger\" }\n";

#[test]
fn check_and_a_session_agree_for_every_model() {
    let place = folder("check-agrees");
    let variants = [
        ("ends", ENDS.to_owned()),
        ("one", LEFT.to_owned()),
        ("three", ENDS.to_owned() + MIDDLE),
        ("five", ENDS.to_owned() + MIDDLE + QUARTERS),
        ("all-held", ALL.to_owned()),
        ("heavy", "material.density = 1000.0\ngravity = [0.0, -9.81, 0.0]\n".to_owned() + ENDS),
        ("quadratic", "element = \"tet10\"\n".to_owned() + ENDS),
        ("iterated", "solver = { method = \"pcg\" }\n".to_owned() + ENDS),
    ];
    let mut refused = 0;
    for model in MODELS {
        for (variant, lines) in &variants {
            let name = format!("{}-{variant}.toml", model.name);
            let scene = format!(
                "[body.b]\ngenerate = {{ block = {{ size = [2.0, 0.5, 0.5], cells = [8, 1, 1] }} }}\n\
                 material.young = 1.0e6\nmaterial.poisson = 0.3\nmodel = \"{}\"\n{lines}",
                model.name
            );
            std::fs::write(place.join(&name), scene).unwrap();
            let output = program(&place, &["check", &name]).output().unwrap();
            let said = text(&output.stdout) + &text(&output.stderr);
            let scene = Resolved::load(&place.join(&name)).unwrap();
            let opened = Session::open(&Request::new(&scene)).map(drop).map_err(|error| error.to_string());
            let has_error = output.status.code() == Some(2);
            let has_warning = said.contains("warning: body.b");
            match &opened {
                Ok(()) => assert!(!has_error, "{name}: check refuses what a session shows\n{said}"),
                // How the parts turn out is known when they are solved.
                Err(why) if why.contains("body.b: part ") => {}
                Err(why) => assert!(
                    has_error || has_warning,
                    "{name}: check passes, a session refuses: {why}\n{said}"
                ),
            }
            refused += usize::from(opened.is_err());
        }
    }
    assert!(refused > 5, "only {refused} scenes were refused");
}

#[test]
fn a_heavy_body_of_large_strain_passes_the_check_and_opens_in_a_session() {
    let place = folder("check-heavy");
    let scene = format!(
        "[body.b]\ngenerate = {{ block = {{ size = [1.0, 0.2, 0.2], cells = [5, 1, 1] }} }}\n\
         material = {{ young = 1.0e6, poisson = 0.3, density = 1000.0 }}\nmodel = \"stvk\"\n\
         gravity = [0.0, -9.81, 0.0]\n{ENDS}"
    );
    std::fs::write(place.join("heavy.toml"), scene).unwrap();
    std::fs::write(place.join("poses.toml"), "[[pose]]\nname = \"rest\"\n").unwrap();
    let run = |arguments: &[&str]| program(&place, arguments).output().unwrap();
    assert_eq!(run(&["deform", "heavy.toml", "--poses", "poses.toml", "-o", "out"]).status.code(), Some(0));
    let check = run(&["check", "heavy.toml"]);
    assert_eq!(check.status.code(), Some(0), "{}", text(&check.stdout));
    assert!(!text(&check.stdout).contains("warning: body.b"), "{}", text(&check.stdout));
    let scene = Resolved::load(&place.join("heavy.toml")).unwrap();
    assert!(Session::open(&Request::new(&scene)).is_ok());
}

/// What `check` says of a bar with these keys, with its status.
fn checked(place: &Path, lines: &str) -> (Option<i32>, String) {
    let scene = format!(
        "[body.b]\ngenerate = {{ block = {{ size = [2.0, 0.5, 0.5], cells = [8, 2, 2] }} }}\n\
         material.young = 1.0e6\n{lines}\n{ENDS}"
    );
    std::fs::write(place.join("scene.toml"), scene).unwrap();
    let output = program(place, &["check", "scene.toml"]).output().unwrap();
    (output.status.code(), text(&output.stdout))
}

/// The elements that were advised gave errors.
#[test]
fn the_elements_that_are_advised_against_locking_are_taken() {
    let place = folder("check-locking");
    let of = |lines: &str| checked(&place, &format!("material.poisson = 0.49\n{lines}"));
    let mut advised = 0;
    for model in MODELS {
        let name = model.name;
        let (status, said) = of(&format!("model = \"{name}\""));
        if status == Some(2) {
            continue;
        }
        for element in ["tet10", "tet4_anp"].into_iter().filter(|name| said.contains(&format!("\"{name}\"")))
        {
            let (status, said) = of(&format!("model = \"{name}\"\nelement = \"{element}\""));
            assert_eq!(status, Some(0), "{name}, {element}: {said}");
            advised += 1;
        }
    }
    assert!(advised > 10, "{advised}");
    let (_, said) = of("element = \"tet10\"\neffects = [\"expected_errors\"]");
    assert!(said.contains("coarse meshes are too stiff") && !said.contains("measures by how much"), "{said}");
}

/// Each passed the check, and a solve refused it.
#[test]
fn an_element_without_a_quartic_and_a_texture_that_is_not_there_are_errors() {
    let place = folder("check-refused");
    for model in ["reduced", "reduced_neo_hookean", "perturbation"] {
        let lines = format!("material.poisson = 0.3\nmodel = \"{model}\"\nelement = \"tet4_anp\"");
        let (status, said) = checked(&place, &lines);
        assert!(status == Some(2) && said.contains("is no quartic"), "{model}: {said}");
    }
    let (status, said) = checked(&place, "material.poisson = 0.3\ntexture = \"none.png\"");
    assert!(status == Some(2) && said.contains("body.b.texture") && said.contains("none.png"), "{said}");
}

/// A model was recommended that the body refuses.
#[test]
fn no_model_is_recommended_that_the_body_refuses() {
    let place = folder("check-recommended");
    for (lines, other) in
        [("", true), ("method = \"bem\"", false), ("surface_compliance = { nodes = \"surface\" }", false)]
    {
        let (_, said) = checked(&place, &format!("material.poisson = 0.3\nmodel = \"linear\"\n{lines}"));
        assert!(said.contains("model linear: its shape is good"), "{said}");
        assert_eq!(said.contains("; reduced"), other, "{lines}: {said}");
    }
}

#[test]
fn keys_that_nothing_reads_are_told() {
    let place = folder("check-unread");
    let keys =
        "material.poisson = 0.3\nparts = { along = 2 }\nsolver = { method = \"cholesky\", tolerance = 1e-4 }";
    let (_, said) = checked(&place, keys);
    assert!(said.contains("body.b.parts: is not used: the model \"linear\""), "{said}");
    assert!(said.contains("\"cholesky\" does not iterate"), "{said}");
    let (_, said) =
        checked(&place, "material.poisson = 0.3\nmodel = \"substructured\"\nparts = { along = 2 }");
    assert!(!said.contains("is not used"), "{said}");
}

/// Two blocks, the second at `x` from the first.
fn two_blocks(x: f64) -> String {
    let body = |name: &str, x: f64| {
        format!(
            "[body.{name}]\ngenerate = {{ block = {{ size = [0.2, 0.2, 0.2], cells = [3, 3, 3] }} }}\n\
             material = {{ young = 1.0e6, poisson = 0.3 }}\n\
             place = {{ position = [{x}, 1.2, 0.4], rotation = [0.0, 0.0, 0.0], scale = 1.0 }}\n{ENDS}"
        )
    };
    format!("stage = \"workbench\"\n{}{}", body("one", 0.0), body("other", x))
}

#[test]
fn bodies_through_each_other_are_a_warning() {
    let place = folder("check-overlap");
    for (name, x, is_doubted) in
        [("apart.toml", 0.3, false), ("touching.toml", 0.2, false), ("inside.toml", 0.1, true)]
    {
        std::fs::write(place.join(name), two_blocks(x)).unwrap();
        let said = text(&program(&place, &["check", name]).output().unwrap().stdout);
        assert_eq!(said.contains("m into body other. Give one of them another place"), is_doubted, "{said}");
    }
}

#[test]
fn what_is_not_there_is_said_in_one_sentence() {
    let place = folder("check-absent");
    let scene = |lines: &str| {
        format!(
            "[body.b]\ngenerate = {{ block = {{ size = [1.0, 0.2, 0.2], cells = [5, 1, 1] }} }}\n\
             material = {{ young = 1.0e6, poisson = 0.3 }}\n{lines}\n{ENDS}"
        )
    };
    for (lines, part) in [
        ("effects = [\"contact\"]", "nothing touches the body: add a tool"),
        ("effects = [\"cut\"]", "nothing cuts the body: add a blade"),
        (
            "effects = [\"cutting\"]",
            "there is no effect \"cutting\": blades cut bodies by the effect \"cut\"",
        ),
        ("effects = [\"audio\"]", "there is no effect \"audio\": bodies are heard by the effect \"sound\""),
        (
            "effects = [\"gravity\"]",
            "\"gravity\" is no effect but a key: write gravity = … below [body.NAME]",
        ),
        (
            "effect.ghost_equilibrium.law = \"stvk\"",
            "the body does not list this effect: add \"ghost_equilibrium\" to effects",
        ),
        ("effects = [\"stress\"]\neffect.stress.most = 1.0", "this effect has no settings"),
        (
            "effects = [\"ghost_equilibrium\"]\neffect.ghost_equilibrium.lav = 1",
            "unknown field `lav`, expected `law`",
        ),
        (
            "effects = [\"ghost_equilibrium\"]\neffect.ghost_equilibrium.law = \"stvc\"",
            "unknown law \"stvc\"",
        ),
        ("accuracy = { force = 0.1 }\nmodel = \"linear\"", "model is chosen by it: leave it out"),
        (
            "budget = { file_mb = 1.0 }\nelement = \"tet4\"\nrefine = 0",
            "element, refine are chosen by it: leave them out",
        ),
    ] {
        std::fs::write(place.join("scene.toml"), scene(lines)).unwrap();
        for command in ["check", "view"] {
            let output = program(&place, &[command, "scene.toml"]).output().unwrap();
            let said = text(&output.stdout) + &text(&output.stderr);
            assert!(
                output.status.code() == Some(2) && said.contains(part),
                "{command}: no `{part}` in {said}"
            );
        }
    }
}
