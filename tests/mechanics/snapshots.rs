//! The state of a session, taken in any frame and put into another session of the same scene: both go on alike, bit by bit.

use greenstage::deform::{ControlPose, Kind, MODELS, ModelEntry, find_model};
use greenstage::effect::EFFECTS;
use greenstage::prepare::Resolved;
use greenstage::render::Drawable;
use greenstage::session::{Request, Session};
use greenstage::world::State;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;

/// Further frames that are compared.
const FRAMES: usize = 150;

/// A leaf, which every model fits, with every effect that computes in frames; models that are solved anew have no dynamics. Touched it
/// lies over a table, in place of dynamics.
fn scene(folder: &Path, model: &ModelEntry, touched: bool) -> Resolved {
    let left_out = |name: &str| match name {
        "expected_errors" => true,
        "dynamics" | "sound" => touched || matches!(model.kind, Kind::Background(_)),
        "contact" => !touched,
        // A body that is cut keeps few others.
        "cut" => true,
        _ => false,
    };
    let tool = "[tool.table]\nshape = \"floor\"\nposition = [0.0, -0.045, 0.0]\n";
    let effects: Vec<String> = EFFECTS
        .iter()
        .filter(|effect| effect.attach.is_some() && !left_out(effect.name))
        .map(|effect| format!("\"{}\"", effect.name))
        .collect();
    let text = format!(
        "{}[body.b]\ngenerate = {{ block = {{ size = [1.0, 0.03, 0.4], cells = [10, 1, 4] }} }}\n\
         material = {{ young = 1.0e6, poisson = 0.3, density = 1000 }}\nmodel = \"{model}\"\neffects = [{}]\n\
         control.left = {{ nodes = {{ box = {{ min = [-9.0, -9.0, -9.0], max = [-0.35, 9.0, 9.0] }} }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ box = {{ min = [0.35, -9.0, -9.0], max = [9.0, 9.0, 9.0] }} }}, grab = \"dragger\" }}\n",
        if touched { tool } else { "" },
        effects.join(", ")
    );
    Resolved::parse(&text, &folder.join("scene.toml")).unwrap()
}

/// The right end lifted, or lowered onto the table, shifted and turned; of a model that is solved anew for every pose, in every
/// 25th frame alone.
fn pose(model: &ModelEntry, touched: bool, frame: usize) -> ControlPose {
    let step = if matches!(model.kind, Kind::Background(_)) { frame / 25 * 25 } else { frame };
    let t = step as f64 / 100.0;
    let height = if touched { -0.15 } else { 0.15 };
    let turn = Vector3::new(0.1 * (0.7 * t).sin(), 0.2 * t.sin(), 0.4 * (0.5 * t).sin());
    ControlPose {
        translation: Vector3::new(-0.05, height * (0.8 * t).sin(), 0.02 * t.cos()),
        matrix: *Rotation3::from_scaled_axis(turn).matrix(),
    }
}

fn open(scene: &Resolved) -> Session {
    let mut session = Session::open(&Request::new(scene)).unwrap();
    session.world.wait_for_background();
    // What the clock of the machine decides is for windows alone.
    session.world.is_for_pictures = true;
    session
}

/// Moves on by a frame, in which the right end comes to `pose`, and says what it shows.
fn shown(session: &mut Session, pose: &ControlPose, frame: usize) -> (String, String, Vec<[u8; 4]>) {
    let field = session.world.fields.bodies[0].poses[1];
    session.world.graph.restore(field, *pose);
    session.advance(frame as f64 / 100.0).unwrap();
    let world = &mut session.world;
    let hash = world.state_hash();
    let plates: Vec<_> = world.frame.all(Drawable::plate).collect();
    (hash, format!("{plates:?}"), world.bodies[0].colours(&world.frame.bodies[0]))
}

#[test]
fn a_session_goes_on_from_its_state_with_every_model_and_effect() {
    let folder = tempfile::tempdir().unwrap();
    let touched = ["linear", "rotation"].map(|name| (find_model(name).unwrap(), true));
    for (model, touched) in MODELS.iter().map(|model| (model, false)).chain(touched) {
        let scene = scene(folder.path(), model, touched);
        let mut first = open(&scene);
        let taken = [30, 120];
        let mut others: Vec<Session> = Vec::new();
        let (mut moved, mut pressed) = (0, 0);
        for frame in 0..taken[1] + FRAMES {
            let pose = pose(model, touched, frame);
            let seen = shown(&mut first, &pose, frame);
            for (of, other) in taken.iter().zip(&mut others) {
                if frame <= of + FRAMES {
                    assert_eq!(
                        shown(other, &pose, frame),
                        seen,
                        "{}, frame {frame}, state of {of}",
                        model.name
                    );
                }
            }
            moved += usize::from(first.world.bodies[0].deformer.largest_turn() > 0.1);
            pressed += usize::from(!first.world.bodies[0].deformer.contribution().points.is_empty());
            if taken.contains(&frame) {
                let text = serde_json::to_string(&first.world.state().unwrap()).unwrap();
                let state: State = serde_json::from_str(&text).unwrap();
                let mut other = open(&scene);
                other.world.set_state(&state).unwrap();
                let again = serde_json::to_string(&other.world.state().unwrap()).unwrap();
                assert_eq!(again, text, "{}, the state of frame {frame}", model.name);
                others.push(other);
            }
        }
        assert!(touched == (pressed > 115), "{}: pressed in {pressed} frames", model.name);
        assert!(moved > 200, "{}: turned in {moved} frames", model.name);
    }
}
