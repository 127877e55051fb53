//! Resolves the names of a scene, once.
//!
//! In: a scene, whose bodies name a model and effects with settings. Out: [`Resolved`], with their entries and with the settings
//! parsed, or all unknown names, each with the nearest that is known; and the requirements of each body for the precomputation,
//! or why it cannot have what it names.

use super::effects::{EFFECTS, find_among};
use super::entry::{EffectEntry, ListedEffect, Resolved, ResolvedBody};
use super::haptics;
use crate::base::failure::Failure;
use crate::deform::{Bearing, ModelEntry, Statics, find_model, load_refusal};
use crate::fem::Law;
use crate::green::{
    self, AFFINE, COMPLIANCE, COMPRESSED, Family, KEPT_FACTOR, LOADS, Requirements, STIFFNESS, UPDATES,
};
use crate::scene::{Body, KeptForm, Method, Scene, SceneError};
use std::path::Path;

impl Resolved {
    /// Errors name all that the scene names and that there is not, and settings that its effects do not have.
    pub fn new(scene: Scene) -> Result<Resolved, Failure> {
        Resolved::among(scene, EFFECTS)
    }

    /// Resolves a scene with other effects than those of the program.
    pub fn among(mut scene: Scene, effects: &'static [EffectEntry]) -> Result<Resolved, Failure> {
        let (mut bodies, mut unknown) = (indexmap::IndexMap::new(), Vec::new());
        for name in scene.body.keys().cloned().collect::<Vec<_>>() {
            match ResolvedBody::new(&scene, &name, effects) {
                Ok(body) => {
                    body.complete(&mut scene.body[&name]);
                    bodies.insert(name, body);
                }
                Err(mut errors) => unknown.append(&mut errors),
            }
        }
        match unknown.len() {
            0 => Ok(Resolved { scene, bodies }),
            1 => Err(Failure::request(unknown.remove(0))),
            _ => {
                let lines: Vec<String> = unknown.iter().map(SceneError::to_string).collect();
                Err(Failure::wrong(lines.join("\n")))
            }
        }
    }

    /// The scene of a text ([`Scene::parse`]), resolved.
    pub fn parse(text: &str, path: &Path) -> Result<Resolved, Failure> {
        Resolved::new(Scene::parse(text, path)?)
    }

    /// The scene file at a path, or the built-in scene of this name ([`Scene::load`]), resolved.
    pub fn load(path: &Path) -> Result<Resolved, Failure> {
        Resolved::new(Scene::load(path)?)
    }

    /// The models of all bodies, in the order of the scene.
    pub fn models(&self) -> Vec<&'static ModelEntry> {
        self.bodies.values().map(|body| body.model).collect()
    }

    /// The law under which a body is in static equilibrium ([`ResolvedBody::law`]).
    pub fn law(&self, name: &str) -> Result<Option<&'static Law>, Failure> {
        self.bodies[name].law(self, name, &self.body[name])
    }

    /// Families and sections that must be precomputed for a body ([`ResolvedBody::requirements`]).
    pub fn requirements(&self, name: &str) -> Result<Requirements, Failure> {
        self.bodies[name].requirements(self, name, &self.body[name])
    }

    /// [`Resolved::requirements`] for a body that is measured: refuses the models that others are measured against.
    pub fn measured_requirements(&self, name: &str) -> Result<Requirements, Failure> {
        let (scene, body) = (&self.scene, &self.body[name]);
        match self.law(name)? {
            None if body.method == Method::Bem => {
                let message = "what accuracy costs is measured among elements of tetrahedra: leave out method = \"bem\"";
                Err(wrong(scene, name, "method", message.to_owned()))
            }
            None => self.requirements(name),
            Some(law) => {
                let message = format!(
                    "\"{}\" is static equilibrium itself, and has no accuracy to measure: write model = \"rotation\" \
                     or \"linear\"",
                    law.name
                );
                Err(wrong(scene, name, "model", message))
            }
        }
    }

    /// The scene as its bodies are precomputed, before anything is released or changed.
    pub fn as_prepared(&self) -> Resolved {
        Resolved { scene: self.scene.as_prepared(), bodies: self.bodies.clone() }
    }

    /// A copy on another stage.
    #[must_use]
    pub fn with_stage(&self, stage: String) -> Resolved {
        Resolved { scene: Scene { stage, ..self.scene.clone() }, bodies: self.bodies.clone() }
    }

    /// The scene moved by a script.
    #[must_use]
    pub fn with_script(&self, script: &str) -> Resolved {
        let scene = Scene { script: Some(script.into()), ..self.scene.clone() };
        Resolved { scene, bodies: self.bodies.clone() }
    }

    /// A copy with some of the bodies only.
    #[must_use]
    pub fn with_bodies(&self, is_meant: impl Fn(&str) -> bool) -> Resolved {
        let mut part = self.clone();
        part.scene.body.retain(|name, _| is_meant(name));
        part.bodies.retain(|name, _| is_meant(name));
        part
    }

    /// A copy with another model of a body.
    #[must_use]
    pub fn with_model(&self, body: &str, model: &'static ModelEntry) -> Resolved {
        let mut other = self.clone();
        model.name.clone_into(&mut other.scene.body[body].model);
        other.bodies[body].model = model;
        other
    }

    /// A copy with some of a body's effects only.
    #[must_use]
    pub fn with_effects(&self, body: &str, is_meant: impl Fn(&EffectEntry) -> bool) -> Resolved {
        let mut other = self.clone();
        other.bodies[body].effects.retain(|effect| is_meant(effect.entry));
        let names = other.bodies[body].entries().map(|effect| effect.name.to_owned()).collect();
        other.scene.body[body].effects = names;
        other
    }

    /// The scene with every body felt: those that do not list the effect [`haptics`] list it too.
    pub fn felt(&self) -> Result<Resolved, Failure> {
        let mut scene = self.scene.clone();
        for (name, body) in &mut scene.body {
            if !self.bodies[name].lists(&haptics::live::ENTRY) {
                body.effects.push(haptics::live::ENTRY.name.to_owned());
            }
        }
        Resolved::new(scene)
    }
}

impl ResolvedBody {
    /// Finds the entries that a body of a scene names, among these effects. The errors are all names that do not exist, and
    /// settings that its effects do not have.
    pub fn new(
        scene: &Scene,
        name: &str,
        known: &'static [EffectEntry],
    ) -> Result<ResolvedBody, Vec<SceneError>> {
        let (body, mut effects, mut wrong) = (&scene.body[name], Vec::new(), Vec::new());
        for effect in &body.effects {
            let entry = match find_among(known, effect) {
                Ok(entry) => entry,
                Err(message) => {
                    wrong.push(("effects".to_owned(), message));
                    continue;
                }
            };
            match entry.settings.map(|read| read(body.effect.get(effect))).transpose() {
                Ok(settings) => effects.push(ListedEffect { entry, settings }),
                Err(message) => wrong.push((format!("effect.{effect}"), message)),
            }
        }
        let model = find_model(&body.model).map_err(|message| wrong.push(("model".to_owned(), message)));
        for effect in body.effect.keys() {
            let message = match find_among(known, effect) {
                Err(message) => message,
                Ok(_) if !body.effects.contains(effect) => {
                    format!(
                        "the body does not list this effect: add \"{effect}\" to effects, or leave this out"
                    )
                }
                Ok(entry) if entry.settings.is_none() => "this effect has no settings".to_owned(),
                Ok(_) => continue,
            };
            wrong.push((format!("effect.{effect}"), message));
        }
        match model {
            Ok(model) if wrong.is_empty() => Ok(ResolvedBody { model, effects }),
            _ => {
                let error = |(key, message)| scene.invalid(&format!("body.{name}.{key}"), message);
                Err(wrong.into_iter().map(error).collect())
            }
        }
    }

    /// Adds to the body what its effects need and its scene does not say: the compliance of its surface.
    pub fn complete(&self, body: &mut Body) {
        if self.entries().any(|effect| effect.presses_points) && load_refusal(self.model, true).is_none() {
            body.be_pressed();
        }
    }

    pub fn entries(&self) -> impl Iterator<Item = &'static EffectEntry> {
        self.effects.iter().map(|effect| effect.entry)
    }

    /// Whether the body lists this effect.
    pub fn lists(&self, effect: &EffectEntry) -> bool {
        self.entries().any(|entry| entry == effect)
    }

    /// The settings of the effect of this name that the body lists, as the scene has them or by default.
    pub fn settings<T: 'static>(&self, effect: &str) -> Option<&T> {
        let listed = self.effects.iter().find(|listed| listed.entry.name == effect)?;
        listed.settings.as_ref()?.downcast_ref()
    }

    /// Whether one of its effects requires the family.
    pub fn effects_require(&self, family: Family) -> bool {
        self.entries().any(|effect| effect.requirements().has(family))
    }

    /// The law under which the body of this name and these settings is in static equilibrium, found anew for every pose; `None` for
    /// a model that is summed from the .green file. Errors name what it cannot have.
    pub fn law(&self, scene: &Scene, name: &str, body: &Body) -> Result<Option<&'static Law>, Failure> {
        match self.model.law() {
            Some(law) if body.method == Method::Bem => {
                let message = format!(
                    "\"{}\" finds equilibrium in tetrahedra, which boundary elements do not have: write model = \"linear\", or \
                     leave out method = \"bem\"",
                    law.name
                );
                Err(wrong(scene, name, "model", message))
            }
            // Solved anew it has its loads whatever the columns are.
            Some(law) => Ok(Some(law)),
            None => loads_required(scene, name, body, self.model).map(|_| None),
        }
    }

    /// Families and sections that must be precomputed for the model and the effects of the body of this name and these settings.
    /// Errors name what it cannot have.
    pub fn requirements(&self, scene: &Scene, name: &str, body: &Body) -> Result<Requirements, Failure> {
        if let Some(law) = self.law(scene, name, body)? {
            Statics::suits(scene, name, law).map_err(Failure::request)?;
        }
        let loads = loads_required(scene, name, body, self.model)?;
        let required = requirements(self.model, self.entries()).and(loads);
        self.check_method(scene, name, body, &required)?;
        for suits in self.entries().filter_map(|effect| effect.suits) {
            suits(scene, name, body, self).map_err(Failure::request)?;
        }
        let can_update = |changes_modulus| green::why_anew(body, &required, changes_modulus).is_none();
        let is_of_use = body.updates.as_ref().is_some_and(|updates| {
            !updates.release.is_empty() && can_update(false)
                || !updates.modulus.is_empty() && can_update(true)
        });
        Ok(if is_of_use { required.and(Requirements::new(&[UPDATES])) } else { required })
    }

    /// Errors name what a body of boundary elements cannot have.
    fn check_method(
        &self,
        scene: &Scene,
        name: &str,
        body: &Body,
        required: &Requirements,
    ) -> Result<(), Failure> {
        if body.method == Method::Fem {
            return Ok(());
        }
        let remedy = "leave out method = \"bem\", and fill a surface by tetrahedralise = { cell = … }";
        if let Some(effect) = self.entries().find(|effect| effect.needs_inside) {
            let message = format!(
                "\"{}\" looks inside the body, of which boundary elements know the surface alone: leave the effect out, or {remedy}",
                effect.name
            );
            return Err(wrong(scene, name, "effects", message));
        }
        let is_known = |family: &&str| [AFFINE.name, STIFFNESS.name].contains(family);
        let Some(family) = required.families().find(|family| !is_known(family)) else { return Ok(()) };
        let message = format!(
            "\"{}\" with these effects needs the family {family}, which is made from tetrahedra: write model \
             = \"linear\", or {remedy}",
            self.model.name
        );
        Err(wrong(scene, name, "model", message))
    }
}

/// Families and sections that must be precomputed for a body of this model with these effects.
pub fn requirements<'a>(
    model: &ModelEntry,
    effects: impl IntoIterator<Item = &'a EffectEntry>,
) -> Requirements {
    let of_model = Requirements::new(model.requirements);
    effects.into_iter().fold(of_model, |all, effect| {
        let energy = model.energy.filter(|_| effect.needs_energy).unwrap_or_default();
        all.and(effect.requirements()).and(Requirements::new(energy))
    })
}

/// The families of a body's loads; errors name what cannot be together with them.
fn loads_required(
    scene: &Scene,
    name: &str,
    body: &Body,
    model: &ModelEntry,
) -> Result<Requirements, Failure> {
    let (loads, compliance) = (!body.loads().is_empty(), body.surface_compliance.is_some());
    if let Some(message) = load_refusal(model, compliance) {
        return Err(wrong(scene, name, "model", message));
    }
    if let Bearing::Forces(families) = model.loads {
        return Ok(if loads { Requirements::new(families) } else { Requirements::default() });
    }
    let of_surface = body.surface_compliance.as_ref().map(|of| match of.kept {
        KeptForm::Inverse => COMPLIANCE,
        KeptForm::Compressed(_) => COMPRESSED,
        KeptForm::Factor => KEPT_FACTOR,
    });
    let families: Vec<_> = loads.then_some(LOADS).into_iter().chain(of_surface).collect();
    Ok(Requirements::new(&families))
}

fn wrong(scene: &Scene, name: &str, key: &str, message: String) -> Failure {
    Failure::request(scene.invalid(&format!("body.{name}.{key}"), message))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mistake in one body hid those in the next.
    #[test]
    fn every_unknown_name_of_a_scene_is_told_with_the_nearest() {
        let body = |name: &str, keys: &str| {
            format!(
                "[body.{name}]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
                 material = {{ young = 1.0, poisson = 0.0 }}\n{keys}\n\
                 control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
            )
        };
        let of = |a: &str, b: &str| {
            Resolved::parse(&(body("a", a) + &body("b", b)), Path::new("two.toml")).map_err(|e| e.to_string())
        };
        let told = of("model = \"rotatoin\"\neffects = [\"stres\"]", "effects = [\"cutting\"]").unwrap_err();
        let lines: Vec<&str> = told.lines().collect();
        let parts = [
            ["two.toml: body.a.effects: ", "did you mean \"stress\""],
            ["two.toml: body.a.model: ", "did you mean \"rotation\""],
            ["two.toml: body.b.effects: ", "there is no effect \"cutting\""],
        ];
        assert_eq!(lines.len(), parts.len(), "{told}");
        for (line, [place, fact]) in lines.iter().zip(parts) {
            assert!(line.starts_with(place) && line.contains(fact), "{line}");
        }
        let found = of("model = \"stvk\"\neffects = [\"haptics\"]", "").unwrap();
        assert_eq!(found.models().iter().map(|model| model.name).collect::<Vec<_>>(), ["stvk", "linear"]);
        let names = |body: &str| found.bodies[body].entries().map(|effect| effect.name).collect::<Vec<_>>();
        assert_eq!((names("a"), names("b")), (vec!["haptics"], vec![]));
    }
}
