//! Reasons why it is unknown how sure the forces of a body are.

use crate::deform::{COMPONENTS, ExpectedErrors, Freedom, MovedErrors, percent};
use crate::effect::expected::{CHANGED, finer_mesh, unmeasurable};
use crate::effect::{Resolved, name_of};
use crate::fem::TET10;
use crate::scene::Method;

/// The place where measured errors were looked for.
#[derive(Clone, Copy, Debug)]
pub(super) enum ErrorSource<'a> {
    /// The .green file, which may hold none.
    InFile(Option<&'a ExpectedErrors>),
    /// The body was solved without one.
    Nowhere,
}

/// The reason why a body's errors are unknown at a pose with this freedom of its control elements, and how to find them.
pub(super) fn why(scene: &Resolved, name: &str, looked: ErrorSource<'_>, freedom: &[Freedom]) -> String {
    let (body, resolved) = (&scene.body[name], &scene.bodies[name]);
    if body.method == Method::Bem {
        return finer_mesh(body);
    }
    if resolved.model.law().is_some() {
        let measured = match looked {
            ErrorSource::InFile(errors) => errors.and_then(ExpectedErrors::mesh),
            ErrorSource::Nowhere => None,
        };
        let of_mesh = match measured {
            Some(mesh) => format!("the mesh adds up to {} in small motions", percent(mesh.wrench)),
            None if *body.element == TET10 => format!("for the mesh's part {}", finer_mesh(body)),
            None => "for the mesh's part solve again with element = \"tet10\", and compare".to_owned(),
        };
        return format!("none by the model; {of_mesh}");
    }
    if body.is_updated() {
        return CHANGED.to_owned();
    }
    if let Some(why) = unmeasurable(body) {
        return format!("{why}; solve again on a finer mesh, and compare");
    }
    match looked {
        ErrorSource::InFile(Some(errors)) if freedom.iter().any(Freedom::is_any) => of_free_ends(errors),
        ErrorSource::InFile(Some(errors)) if !errors.moved.is_empty() => {
            let pose = "the pose is beyond those measured";
            match body.loads().is_empty() && body.surface_compliance.is_none() {
                true => pose.to_owned(),
                false => {
                    format!("{pose}, or under other loads")
                }
            }
        }
        ErrorSource::InFile(Some(errors)) if !errors.left_out.is_empty() => errors.left_out.join("; "),
        ErrorSource::Nowhere if resolved.entries().any(|effect| effect.measures_errors) => {
            "leave --all-nodes out: the .green file has it".to_owned()
        }
        _ => {
            let effect = name_of(|effect| effect.measures_errors);
            format!("effect \"{effect}\" measures it")
        }
    }
}

/// Words about poses with free ends, which are another kind than those of held ends.
fn of_free_ends(errors: &ExpectedErrors) -> String {
    let measured = |moved: &MovedErrors| {
        let hung = moved.hung.as_ref().filter(|hung| !hung.at.is_empty())?;
        Some(format!("{} along {}", moved.control, COMPONENTS[hung.along]))
    };
    let measured: Vec<String> = errors.moved.iter().filter_map(measured).collect();
    match measured.is_empty() {
        true => "no free end could be measured".to_owned(),
        false => format!(
            "free ends were measured by pushing {} alone, not so far or not in this way",
            measured.join(" or ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{Deviation, ErrorsAt, Hung, MeshErrors, Reach};
    use crate::scene::Scene;
    use std::path::Path;

    fn scene(keys: &str, ends: &[&str]) -> Scene {
        let end = |group: &&str| {
            format!("control.{group} = {{ nodes = {{ group = \"{group}\" }}, grab = \"dragger\" }}\n")
        };
        let text = format!(
            "[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
             material = {{ young = 1.0, poisson = 0.0 }}\n{keys}\n{}",
            ends.iter().map(end).collect::<String>()
        );
        Scene::parse(&text, Path::new("any.toml")).unwrap()
    }

    fn why_of(scene: &Scene, looked: ErrorSource<'_>, freedom: &[Freedom]) -> String {
        why(&Resolved::new(scene.clone()).unwrap(), "a", looked, freedom)
    }

    const BOTH: [&str; 2] = ["xmin", "xmax"];

    #[test]
    fn no_effect_is_advised_that_would_not_help() {
        let listed = |scene: &Scene, looked: ErrorSource<'_>| {
            why_of(scene, looked, &[]).starts_with("effect \"expected_errors\"")
        };
        let plain = scene("", &BOTH);
        assert!(listed(&plain, ErrorSource::InFile(None)) && listed(&plain, ErrorSource::Nowhere));
        let one = scene("", &["xmin"]);
        assert!(why_of(&one, ErrorSource::InFile(None), &[]).starts_with("it has one control element"));
        let mut changed = scene("updates = { release = [\"xmax\"] }", &BOTH);
        assert!(listed(&changed, ErrorSource::InFile(None)));
        assert!(changed.body["a"].release("xmax"));
        assert_eq!(why_of(&changed, ErrorSource::InFile(None), &[]), CHANGED);
        let lists = scene("effects = [\"expected_errors\"]", &BOTH);
        assert!(why_of(&lists, ErrorSource::Nowhere, &[]).contains("--all-nodes"));
    }

    /// The part of the mesh was called unknown where `check` knew it.
    #[test]
    fn of_a_model_of_equilibrium_the_measured_part_of_the_mesh_is_told() {
        let scene = scene("model = \"stvk\"", &BOTH);
        let mesh = MeshErrors { wrench: 3.92, shape: 0.072, stiffness: None, loads: Vec::new() };
        let moved = MovedErrors { mesh: Some(mesh), ..MovedErrors::default() };
        let errors = ExpectedErrors { moved: vec![moved], ..ExpectedErrors::default() };
        assert_eq!(
            why_of(&scene, ErrorSource::InFile(Some(&errors)), &[]),
            "none by the model; the mesh adds up to 392 % in small motions"
        );
        assert!(why_of(&scene, ErrorSource::Nowhere, &[]).contains("solve again with element"));
    }

    #[test]
    fn what_the_file_tells_comes_first() {
        let lists = scene("effects = [\"expected_errors\"]", &BOTH);
        let mut errors = ExpectedErrors { left_out: vec!["too large".into()], ..ExpectedErrors::default() };
        assert_eq!(why_of(&lists, ErrorSource::InFile(Some(&errors)), &[]), "too large");
        let control = "xmax".to_owned();
        errors.moved.push(MovedErrors { control, ..MovedErrors::default() });
        assert!(why_of(&lists, ErrorSource::InFile(Some(&errors)), &[]).contains("beyond those"));
        let free = [Freedom { free: [true; 6], ..Freedom::default() }];
        let told = |errors: &ExpectedErrors| why_of(&lists, ErrorSource::InFile(Some(errors)), &free);
        assert!(told(&errors).contains("no free end"));
        let none = Deviation { force: None, torque: None, energy: None, shape: 0.0 };
        let at = vec![ErrorsAt::new(5.0, Reach::default(), &none)];
        errors.moved[0].hung = Some(Hung { along: 2, at, mesh: None });
        assert!(told(&errors).contains("pushing xmax along z alone"));
    }
}
