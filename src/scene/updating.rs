//! Changes of a body while it is shown (released control elements, other moduli), and the body as it was precomputed.

use super::updates::Updates;
use super::{Body, Method, Scene};
use crate::config::unknown_name;
use crate::fem::Dilatation;

impl Body {
    /// Factor of the modulus of each region of `updates.modulus` over the precomputed one.
    pub fn modulus_factors(&self) -> Vec<f64> {
        let Some(updates) = &self.updates else { return Vec::new() };
        let factor = |region: &String| {
            let now = self.region.get(region).map_or(1.0, |material| material.young);
            now / updates.young.get(region).unwrap_or(&now)
        };
        updates.modulus.iter().map(factor).collect()
    }

    /// Whether it differs from what is precomputed of it.
    pub fn is_updated(&self) -> bool {
        let is_loose = self.updates.as_ref().is_some_and(|updates| !updates.loose.is_empty());
        is_loose || self.modulus_factors().iter().any(|factor| *factor != 1.0)
    }

    /// Why a change, of a modulus or of what holds it alone, takes a solve anew; `None` where its columns can be updated.
    pub fn why_anew(&self, changes_modulus: bool) -> Option<String> {
        if self.method == Method::Bem {
            return Some("boundary elements have no stiffness matrix of the inside".to_owned());
        }
        if changes_modulus && self.element.dilatation == Dilatation::Nodal {
            let name = self.element.name;
            return Some(format!("element = \"{name}\" averages the pressure across the border of regions"));
        }
        (changes_modulus && self.surface_compliance.is_some())
            .then(|| "a modulus changes surface_compliance throughout its region".to_owned())
    }

    /// Notes what it is precomputed with, and lets go of what is released to begin with.
    pub(super) fn begin_updates(&mut self) {
        let Some(updates) = &mut self.updates else { return };
        let young = |name: &String| Some((name.clone(), self.region.get(name)?.young));
        updates.young = updates.modulus.iter().filter_map(young).collect();
        for name in updates.released.clone() {
            self.release(&name);
        }
    }

    /// Lets go of a control element; false where it may not be released, or is.
    pub fn release(&mut self, control: &str) -> bool {
        let Some(updates) =
            self.updates.as_mut().filter(|updates| updates.release.iter().any(|n| n == control))
        else {
            return false;
        };
        let Some((place, name, taken)) = self.control.shift_remove_full(control) else { return false };
        // Places count all of them, those that are loose included.
        let among_all =
            updates.loose.iter().fold(place, |place, (loose, ..)| place + usize::from(*loose <= place));
        updates.loose.push((among_all, name, taken));
        updates.loose.sort_by_key(|(place, ..)| *place);
        true
    }

    /// The control element holds again; false where it was not released.
    pub fn hold(&mut self, control: &str) -> bool {
        let Some(updates) = &mut self.updates else { return false };
        let Some(at) = updates.loose.iter().position(|(_, name, _)| name == control) else { return false };
        let (place, name, taken) = updates.loose.remove(at);
        let before = updates.loose.iter().filter(|(other, ..)| *other < place).count();
        self.control.shift_insert(place - before, name, taken);
        true
    }

    /// The body as its written scene would be read: all control elements in their order, and the loose ones by name.
    pub(super) fn as_written(&self) -> Body {
        let mut body = self.clone();
        let loose: Vec<String> = self.updates.iter().flat_map(Updates::loose).map(str::to_owned).collect();
        loose.iter().for_each(|name| {
            body.hold(name);
        });
        if let Some(updates) = &mut body.updates {
            updates.released = loose;
        }
        body
    }

    /// Errors name the key below `updates` and what is wrong with it.
    pub(super) fn check_updates(&self) -> Result<(), (String, String)> {
        let Some(updates) = &self.updates else { return Ok(()) };
        if updates.release.is_empty() && updates.modulus.is_empty() {
            let message =
                "name what may be changed: release = [\"a control element\"], modulus = [\"a region\"]";
            return Err((String::new(), message.to_owned()));
        }
        let known = |kind: &str, list: &str, names: &[String], all: &[&str]| {
            for (i, name) in names.iter().enumerate() {
                if !all.contains(&name.as_str()) {
                    return Err((format!(".{list}"), unknown_name(kind, name, all.iter().copied())));
                }
                if names[..i].contains(name) {
                    return Err((format!(".{list}"), format!("\"{name}\" stands there twice")));
                }
            }
            Ok(())
        };
        let controls: Vec<&str> = self.control.keys().map(String::as_str).chain(updates.loose()).collect();
        let regions: Vec<&str> = self.region.keys().map(String::as_str).collect();
        let release: Vec<&str> = updates.release.iter().map(String::as_str).collect();
        known("control element", "release", &updates.release, &controls)?;
        known("region", "modulus", &updates.modulus, &regions).map_err(|(key, message)| {
            let more =
                "; a region whose modulus may be changed has a table [body.NAME.region.REGION] of its own";
            (key, if message.starts_with("unknown") { message + more } else { message })
        })?;
        known("control element of release", "released", &updates.released, &release)
    }

    fn as_prepared(&self) -> Body {
        let mut body = self.as_written();
        let young = self.updates.iter().flat_map(|updates| &updates.young);
        for (name, young) in young {
            if let Some(region) = body.region.get_mut(name) {
                region.young = *young;
            }
        }
        body
    }
}

impl Scene {
    /// The scene as its bodies are precomputed, before anything is released or changed.
    pub fn as_prepared(&self) -> Scene {
        let mut scene = self.clone();
        scene.body.values_mut().for_each(|body| *body = body.as_prepared());
        scene
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SceneError;
    use std::path::Path;

    fn scene(updates: &str) -> Result<Scene, SceneError> {
        let text = format!(
            "[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
             material = {{ young = 1.0, poisson = 0.0 }}\nregion.1 = {{ young = 2.0, poisson = 0.0 }}\n\
             updates = {{ {updates} }}\n\
             control.x = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.y = {{ nodes = {{ group = \"ymin\" }}, grab = \"dragger\" }}\n\
             control.z = {{ nodes = {{ group = \"zmin\" }}, grab = \"dragger\" }}\n"
        );
        Scene::parse(&text, Path::new("any.toml"))
    }

    fn names(body: &Body) -> String {
        body.control.keys().cloned().collect()
    }

    #[test]
    fn what_is_released_holds_again_in_its_place() {
        let scene = scene("release = [\"x\", \"y\", \"z\"], released = [\"y\"]").unwrap();
        let mut body = scene.body["a"].clone();
        assert_eq!((names(&body).as_str(), body.is_updated()), ("xz", true));
        assert_eq!(names(&scene.as_prepared().body["a"]), "xyz");
        assert!(body.release("x") && body.release("z") && !body.release("z"));
        assert_eq!(body.updates.as_ref().unwrap().loose().collect::<String>(), "xyz");
        assert_eq!(names(&body.as_prepared()), "xyz");
        assert!(body.hold("z") && body.hold("x") && !body.hold("x"));
        assert_eq!(names(&body), "xz");
        assert!(body.hold("y") && !body.is_updated());
        assert_eq!(names(&body), "xyz");
    }

    #[test]
    fn a_modulus_is_told_as_a_factor_of_what_was_precomputed() {
        let scene = scene("modulus = [\"1\"]").unwrap();
        let mut body = scene.body["a"].clone();
        assert_eq!((body.modulus_factors(), body.is_updated()), (vec![1.0], false));
        body.region.get_mut("1").unwrap().young = 5.0;
        assert_eq!((body.modulus_factors(), body.is_updated()), (vec![2.5], true));
        assert_eq!(body.as_prepared().region["1"].young, 2.0);
    }

    #[test]
    fn unknown_names_are_refused() {
        for (updates, expected) in [
            ("", "name what may be changed"),
            ("release = [\"q\"]", "body.a.updates.release: unknown control element \"q\" (known: x, y, z)"),
            ("release = [\"x\", \"x\"]", "stands there twice"),
            ("modulus = [\"q\"]", "unknown region \"q\" (known: 1)"),
            (
                "release = [\"x\"], released = [\"y\"]",
                "updates.released: unknown control element of release \"y\"",
            ),
        ] {
            let error = scene(updates).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
