//! All that is wrong with a scene file, and what can be looked at all the same.
//!
//! In: the file. Out: its faults, of unknown keys, of values and of sections, and the bodies that are sound or whose mesh can be
//! loaded. What only an earlier fault brings about is no fault.

use super::{Body, Scene, SceneError, of_a_body};
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::config::every::parse_every;
use std::path::Path;

/// A scene file as far as it can be read.
pub struct Survey {
    /// `None` where nothing of it can be looked at.
    pub scene: Option<Scene>,
    pub faults: Vec<SceneError>,
    /// State of each body, in the order of the scene.
    pub states: Vec<State>,
}

/// State of a body: whether it is sound, or can be looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    Sound,
    /// The mesh is what the file says, and its selections and regions can be looked at.
    HasMesh,
    /// A fault affects the mesh itself, so that the body cannot be looked at.
    Faulty,
}

/// Keys of a body on which its mesh does not depend.
const BESIDE_THE_MESH: [&str; 21] = [
    "material",
    "region",
    "model",
    "updates",
    "parts",
    "effects",
    "storage",
    "solver",
    "accuracy",
    "budget",
    "gravity",
    "centrifugal",
    "thermal",
    "load",
    "surface_compliance",
    "control",
    "place",
    "color",
    "texture",
    "lines",
    "crease",
];

impl Scene {
    /// Reads the scene file at `path`, or the built-in scene of this name, with all of its faults. Errors where there is none.
    pub fn survey(path: &Path) -> Result<Survey, SceneError> {
        let (text, path) = Scene::text(path)?;
        let parsed = parse_every::<Scene>(&text, &path);
        let mut faults: Vec<SceneError> =
            parsed.faults.into_iter().map(|fault| of_a_body(fault).into()).collect();
        let taken = parsed.taken;
        let Some(mut scene) = parsed.value else {
            return Ok(Survey { scene: None, faults, states: Vec::new() });
        };
        scene.path = path;
        // What a body lacks may have been taken out of it.
        let has_lost = |entity: &str| match entity.strip_prefix("body.") {
            None => entity == "body" && !taken.is_empty(),
            Some(name) => taken.iter().any(|keys| keys.get(..2).is_some_and(|keys| keys == ["body", name])),
        };
        let is_own =
            |fault: &SceneError| !matches!(fault, SceneError::Invalid { entity, .. } if has_lost(entity));
        faults.extend(scene.faults().into_iter().filter(is_own));
        let entity = |fault: &SceneError| match fault {
            SceneError::Invalid { entity, .. } => Some(entity.clone()),
            _ => None,
        };
        let known: Vec<_> = faults.iter().filter_map(entity).collect();
        let is_new = |fault: &SceneError| entity(fault).is_none_or(|entity| !known.contains(&entity));
        faults.extend(scene.chosen_and_written(&text).into_iter().filter(is_new));
        let states = scene.body.keys().map(|name| state(name, &taken, &faults)).collect();
        scene.body.values_mut().for_each(Body::begin_updates);
        Ok(Survey { scene: Some(scene), faults, states })
    }
}

/// State of a body, by the keys that were taken out and by the faults of sections.
fn state(name: &str, taken: &[Vec<String>], faults: &[SceneError]) -> State {
    let is_own = |keys: &&Vec<String>| keys.len() > 1 && keys[0] == "body" && keys[1] == name;
    let lost = taken.iter().filter(is_own).map(|keys| keys.get(2).map_or("", String::as_str));
    let wrong = faults.iter().filter_map(|fault| match fault {
        SceneError::Invalid { entity, .. } => key_of(entity, name),
        _ => None,
    });
    let keys: Vec<&str> = lost.chain(wrong).collect();
    match keys.iter().all(|key| BESIDE_THE_MESH.contains(key)) {
        _ if keys.is_empty() => State::Sound,
        true => State::HasMesh,
        false => State::Faulty,
    }
}

/// Key of a body that an entity is about, empty for the body itself; `None` for an entity outside the body.
fn key_of<'a>(entity: &'a str, body: &str) -> Option<&'a str> {
    let rest = entity.strip_prefix("body.")?.strip_prefix(body)?;
    if rest.is_empty() { Some("") } else { rest.strip_prefix('.')?.split('.').next() }
}

impl SceneError {
    /// The error as a finding, with the key as its place.
    pub fn finding(&self) -> Diagnostic {
        match self {
            SceneError::Invalid { entity, message, .. } => Diagnostic::new(Severity::Error, entity, message),
            SceneError::Mesh { body, source, .. } => {
                Diagnostic::new(Severity::Error, format!("body.{body}.mesh"), source.to_string())
            }
            SceneError::Generate { entity, source, .. } => {
                Diagnostic::new(Severity::Error, entity, source.to_string())
            }
            other => Diagnostic::new(Severity::Error, "", other.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "[body.a]\ngenerate = { block = { size = [1, 1, 1], cells = [2, 2, 2] } }\n\
                         material = { young = 1.0, poisson = 0.0 }\n\
                         control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n";

    fn survey(text: &str) -> (Vec<String>, Vec<State>) {
        let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
        std::fs::write(file.path(), text).unwrap();
        let found = Scene::survey(file.path()).unwrap();
        let name = file.path().display().to_string();
        (found.faults.iter().map(|fault| fault.to_string().replace(&name, "f")).collect(), found.states)
    }

    /// Mistakes of five kinds in three bodies: all are reported, and each once.
    #[test]
    fn all_faults_of_a_scene_are_told_at_once() {
        let a = SCENE.replace("young = 1.0", "young = -1.0")
            + "solver = { method = \"pcg\", tolerance = 1.0 }\nmodle = \"rod\"\n";
        let b = SCENE.replace("body.a", "body.b").replace("generate", "genrate") + "place = { scale = 0 }\n";
        let c = SCENE.replace("body.a", "body.c");
        let (faults, states) = survey(&format!("modle = 1\n{a}{b}{c}"));
        for start in [
            "f:1:1: unknown field `modle`",
            "f:7:1: unknown field `modle`",
            "f:9:1: unknown field `genrate`",
            "f:4: body.a.material: Young's modulus -1 Pa",
            "f:6: body.a.solver: tolerance 1 must",
            "f:12: body.b.place: position",
        ] {
            assert_eq!(
                faults.iter().filter(|fault| fault.contains(start)).count(),
                1,
                "{start}: {faults:#?}"
            );
        }
        assert_eq!(faults.len(), 6, "{faults:#?}");
        assert_eq!(states, [State::HasMesh, State::Faulty, State::Sound]);
    }

    #[test]
    fn what_was_taken_out_is_not_missed() {
        let (faults, states) = survey(&SCENE.replace("poisson = 0.0", "poisson = \"a\""));
        assert!(faults.len() == 1 && faults[0].contains("f:3:37: invalid type"), "{faults:#?}");
        assert_eq!(states, []);
        assert_eq!(survey(SCENE), (Vec::new(), vec![State::Sound]));
        let (faults, _) = survey("stage = \"x\"\n");
        assert!(faults.len() == 1 && faults[0].contains("missing field `body`"), "{faults:#?}");
    }
}
