//! The state of a session, taken in any frame and put into another session of the same scene: both go on alike, bit by bit.

use greenstage::deform::MODELS;
use greenstage::effect::EFFECTS;
use greenstage::scene::Scene;
use greenstage::session::{Request, Session};
use greenstage::world::State;
use std::path::Path;

/// Further frames that are compared.
const FRAMES: usize = 1000;

/// A leaf, which every model fits, with every effect that computes in frames.
fn scene(folder: &Path, model: &str) -> Scene {
    let effects: Vec<String> = EFFECTS
        .iter()
        .filter(|effect| effect.attach.is_some() && effect.name != "expected_errors")
        .map(|effect| format!("\"{}\"", effect.name))
        .collect();
    let text = format!(
        "[body.b]\ngenerate = {{ block = {{ size = [1.0, 0.03, 0.4], cells = [10, 1, 4] }} }}\n\
         material = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"{model}\"\neffects = [{}]\n\
         control.left = {{ nodes = {{ box = {{ min = [-9.0, -9.0, -9.0], max = [-0.35, 9.0, 9.0] }} }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ box = {{ min = [0.35, -9.0, -9.0], max = [9.0, 9.0, 9.0] }} }}, grab = \"dragger\" }}\n",
        effects.join(", ")
    );
    Scene::parse(&text, &folder.join("scene.toml")).unwrap()
}

/// A hand takes the right end from above, lifts it, turns it by 22°, and lets go.
const SCRIPT: &str = "frame = \"workspace\"\n\
    [[key]]\ntime = 0.0\nstylus.hand = { position = [0.85, 1.2, 0.1], target = [0.85, 0.0, 0.1] }\n\
    [[key]]\ntime = 0.6\nstylus.hand = { pressed = true }\n\
    [[key]]\ntime = 0.8\nstylus.hand = { position = [0.85, 1.2, 0.1], target = [0.85, 0.0, 0.1] }\n\
    [[key]]\ntime = 2.5\nstylus.hand = { position = [0.5, 1.5, 0.1], target = [0.9, 0.5, 0.1] }\n\
    [[key]]\ntime = 3.5\nstylus.hand = { pressed = false }\n\
    [[key]]\ntime = 4.0\nstylus.hand = { pressed = false }\n";

fn open(scene: &Scene) -> Session {
    let script = scene.path.with_file_name("script.toml");
    std::fs::write(&script, SCRIPT).unwrap();
    let mut session = Session::open(&Request { script: Some(&script), ..Request::of(scene) }).unwrap();
    session.world.wait_for_background();
    // What the clock of the machine decides is for windows alone.
    session.world.is_for_pictures = true;
    session
}

/// What a frame shows.
fn shown(session: &mut Session) -> (String, String, Vec<[u8; 4]>) {
    let world = &mut session.world;
    let hash = world.state_hash();
    (hash, format!("{:?}", world.frame.plates), world.bodies[0].colours())
}

#[test]
fn a_session_goes_on_from_its_state_with_every_model_and_effect() {
    let folder = tempfile::tempdir().unwrap();
    for model in MODELS {
        let scene = scene(folder.path(), model.name);
        let mut first = open(&scene);
        let time_s = |frame: usize| frame as f64 / 100.0;
        // Before the grab, in the bend, and after the hand has let go.
        let taken = [30, 170, 380];
        let mut others: Vec<Session> = Vec::new();
        let mut moved = 0;
        for frame in 0..taken[2] + FRAMES {
            first.advance(time_s(frame)).unwrap();
            let seen = shown(&mut first);
            for (of, other) in taken.iter().zip(&mut others) {
                if frame <= of + FRAMES {
                    other.advance(time_s(frame)).unwrap();
                    assert_eq!(shown(other), seen, "{}, frame {frame}, state of {of}", model.name);
                }
            }
            moved += usize::from(first.world.bodies[0].deformer.largest_turn() > 0.1);
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
        assert!(moved > 100, "{}: the script moves the body in {moved} frames", model.name);
    }
}
