//! Loads on a body and the surface that takes forces, judged before anything is solved.

use super::control::ControlElement;
use super::error::GreenError;
use super::families::{compliance_size, nodal_forces};
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::mesh::TetMesh;
use crate::scene::{LoadSource, Scene};
use std::collections::BTreeSet;

/// Loads and compliances of body `name` that select nothing, or nothing that can move.
pub fn acting(
    scene: &Scene,
    name: &str,
    mesh: &TetMesh,
    controls: &[ControlElement],
) -> Result<Vec<Diagnostic>, GreenError> {
    let body = &scene.body[name];
    let held: BTreeSet<u32> = controls.iter().flat_map(|control| control.nodes.iter().copied()).collect();
    let mut findings = Vec::new();
    for load in body.loads().iter().filter(|load| matches!(load.source, LoadSource::Pattern(_))) {
        let key = format!("body.{name}.load.{}", load.name);
        let forces = nodal_forces(scene, name, mesh, load)?;
        let acts =
            |(node, force): (u32, &nalgebra::Vector3<f64>)| force.norm() > 0.0 && !held.contains(&node);
        if !forces.iter().any(|column| (0..).zip(column).any(acts)) {
            let message = "acts on held nodes alone, so that nothing moves: only the force on the control element changes";
            findings.push(Diagnostic::new(Severity::Warning, key, message));
        }
    }
    if let Some(asked) = &body.surface_compliance {
        let size = compliance_size(mesh, held.iter().copied(), asked);
        size.map_err(|message| scene.invalid(&format!("body.{name}.surface_compliance"), message))?;
    }
    Ok(findings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::green::{Requirements, prepare, solve};
    use crate::solve::Silent;
    use std::path::Path;

    fn found(load: &str) -> Result<Vec<String>, String> {
        let text = format!(
            "[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
             material = {{ young = 1.0, poisson = 0.0 }}\n{load}\n\
             control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
        );
        let scene = Scene::parse(&text, Path::new("any.toml")).unwrap();
        let prepared = prepare(&scene, "a").unwrap();
        let found =
            acting(&scene, "a", &prepared.mesh, &prepared.controls).map_err(|error| error.to_string());
        if found.is_err() {
            assert!(solve(&scene, "a", &Requirements::default(), &Silent).is_err());
        }
        Ok(found?.iter().map(ToString::to_string).collect())
    }

    #[test]
    fn what_selects_nothing_or_nothing_that_moves_is_told_before_the_solve() {
        let load = |group: &str| {
            found(&format!(
                "load.l = {{ nodes = {{ group = \"{group}\" }}, kind = \"pressure\", value = 1.0 }}"
            ))
        };
        assert_eq!(load("xmax").unwrap(), Vec::<String>::new());
        let told = load("xmin").unwrap();
        assert!(
            told.len() == 1 && told[0].contains("body.a.load.l") && told[0].contains("held nodes"),
            "{told:?}"
        );
        let error = load("xmx").unwrap_err();
        assert!(error.contains("body.a.load.l") && error.contains("did you mean \"xmax\"?"), "{error}");
        let error = found("surface_compliance = { nodes = { group = \"xmin\" } }").unwrap_err();
        assert!(error.contains("body.a.surface_compliance: selects no node"), "{error}");
    }
}
