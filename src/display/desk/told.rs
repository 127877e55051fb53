//! Messages about the result of a change of a scene, or why it was refused.

use crate::base::failure::Failure;
use crate::deform::load_refusal;
use crate::prepare::Resolved;
use crate::scene::Scene;

/// Lists the differences: `tube: model rod, effects stress; stage workbench.`
pub fn changes(before: &Scene, after: &Scene) -> String {
    let mut told: Vec<String> = Vec::new();
    for (name, body) in &after.body {
        let Some(old) = before.body.get(name) else { continue };
        let mut parts = Vec::new();
        if body.model != old.model {
            parts.push(format!("model {}", body.model));
        }
        if body.material != old.material {
            parts.push(match body.material.known {
                Some(known) => format!("material {}", known.name),
                None => "another material".to_owned(),
            });
        }
        if body.effects != old.effects {
            parts.push(match body.effects.is_empty() {
                true => "no effects".to_owned(),
                false => format!("effects {}", body.effects.join(", ")),
            });
        }
        if body.control != old.control {
            parts.push("other control elements".to_owned());
        }
        if !parts.is_empty() {
            told.push(format!("{name}: {}", parts.join(", ")));
        }
    }
    if before.stage != after.stage {
        told.push(format!("stage {}", after.stage));
    }
    match told.is_empty() {
        true => "The scene is shown as the panel has it.".to_owned(),
        false => format!("Now {}.", told.join("; ")),
    }
}

/// Refuses a model for a body with a compliance of its surface, which the panel cannot take away.
pub fn try_compliance(scene: &Resolved) -> Result<(), Failure> {
    for ((name, body), model) in scene.body.iter().zip(scene.models()) {
        if load_refusal(model, body.surface_compliance.is_some()).is_some() {
            return Err(Failure::wrong(format!(
                "{name} has points that can be pulled, which the model {} does not have: choose rotation or linear here, or take \
                 surface_compliance out of the scene's file",
                model.name
            )));
        }
    }
    Ok(())
}

/// A failure without the path of the scene, which the panel shows.
pub fn refused(failure: &Failure, scene: Option<&Scene>) -> String {
    let text = failure.to_string();
    let of_scene = scene.map(|scene| format!("{}: ", scene.path.display()));
    let short = of_scene.as_ref().and_then(|path| text.strip_prefix(path));
    format!("Not changed: {}", short.unwrap_or(&text))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "stage = \"desktop\"\n\
        [body.hose]\n\
        mesh = \"hose.msh\"\n\
        model = \"rotation\"\n\
        material = { young = 3.0e5, poisson = 0.4, density = 1100 }\n\
        gravity = true\n\
        surface_compliance = { nodes = \"surface\" }\n\
        [body.hose.control]\n\
        low = { nodes = { group = \"low\" }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"high\" }, grab = \"dragger\" }\n";

    #[test]
    fn a_change_is_told_by_what_is_other() {
        let before = Scene::parse(SCENE, std::path::Path::new("cache/stylus.toml")).unwrap();
        let mut after = before.clone();
        after.body["hose"].model = "linear".into();
        after.body["hose"].effects = vec!["stress".into()];
        after.stage = "workbench".into();
        assert_eq!(changes(&before, &after), "Now hose: model linear, effects stress; stage workbench.");
        assert_eq!(changes(&before, &before), "The scene is shown as the panel has it.");
    }

    #[test]
    fn a_refusal_fits_the_panel() {
        let mut scene = Scene::parse(SCENE, std::path::Path::new("cache/stylus.toml")).unwrap();
        let resolved = |scene: &Scene| Resolved::of(scene.clone()).unwrap();
        assert!(try_compliance(&resolved(&scene)).is_ok());
        scene.body["hose"].model = "rod".into();
        let told = refused(&try_compliance(&resolved(&scene)).unwrap_err(), Some(&scene));
        assert!(
            told.starts_with("Not changed: hose has points") && told.contains("choose rotation"),
            "{told}"
        );
        let failure = Failure::wrong("cache/stylus.toml: body.hose.model: no such model");
        assert_eq!(refused(&failure, Some(&scene)), "Not changed: body.hose.model: no such model");
    }
}
