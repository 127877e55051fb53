//! Errors to expect of bodies, for `check`, `precompute` and `inspect`: a table, and a few lines for each body.

use crate::base::table::Table;
use crate::deform::{ErrorsAt, ExpectedErrors, MotionErrors, MovedErrors, percent};
use crate::effect::{ResolvedBody, expected, name_of};
use crate::green::GreenError;
use crate::prepare;
use crate::scene::{Method, Scene};

/// Turns that the lines name, °: up to which `rotation` and up to which all may serve.
const NAMED: [f64; 2] = [30.0, 90.0];

type Of = fn(&MotionErrors) -> &[ErrorsAt];

/// Motions of a control element, by their names in the table, with the errors that belong to each.
const MOTIONS: [(&str, Of); 6] = [
    ("bent", |errors| &errors.turned.bent),
    ("twisted", |errors| &errors.turned.twisted),
    ("bent and twisted", |errors| &errors.turned.both),
    ("turned in place, shifted", |errors| &errors.shifted),
    ("pulled away", |errors| &errors.pulled),
    ("pressed", |errors| &errors.pressed),
];
const PUSHED: &str = "pushed, free to turn,";

/// A row for each angle of each control element that was moved, and one for what the mesh adds.
pub fn table<'a>(bodies: impl IntoIterator<Item = (&'a str, &'a ExpectedErrors)>) -> Table {
    let mut table = Table::new(&["body", "moved", "by", "errors of", "force", "torque", "shape"]);
    for (name, errors) in bodies {
        let of_model = format!("model {}", errors.model);
        let parts = |at: &ErrorsAt| {
            let part = |part: Option<f64>| part.map_or("none".into(), percent);
            [part(at.force), part(at.torque), percent(at.shape)]
        };
        if let Some(loaded) = &errors.loaded {
            let [force, torque, shape] = parts(loaded);
            table.row(&[name, "none", "the scene's loads alone", &of_model, &force, &torque, &shape]);
        }
        for moved in &errors.moved {
            let mut rows = |what: &str, by: &str, all: &[ErrorsAt]| {
                for at in all {
                    let [force, torque, shape] = parts(at);
                    let by = format!("{by} {}", far(at));
                    table.row(&[name, &moved.control, &by, what, &force, &torque, &shape]);
                }
            };
            for (motion, of) in MOTIONS {
                rows(&of_model, motion, of(&moved.model));
            }
            rows(&of_model, PUSHED, pushed(moved));
            if let Some(finer) = &moved.finer {
                let of_mesh = format!("mesh of {}", errors.element);
                for (motion, of) in MOTIONS {
                    rows(&of_mesh, motion, of(&finer.mesh));
                }
            }
            if let Some(mesh) = &moved.mesh {
                let (wrench, shape) = (percent(mesh.wrench), percent(mesh.shape));
                let of = format!("mesh of {}", errors.element);
                table.row(&[
                    name,
                    &moved.control,
                    "in its worst small motion",
                    &of,
                    &wrench,
                    &wrench,
                    &shape,
                ]);
            }
        }
    }
    table
}

/// Reach of a motion; pulls and presses have no angle.
fn far(at: &ErrorsAt) -> String {
    match at.angle {
        0.0 => format!("by {}", percent(at.off)),
        angle => format!("to {angle}°"),
    }
}

/// Explanation of the table's numbers: the wholes of which they are parts.
pub const PARTS: &str = "model: force, and torque over the length, as parts of the largest of both in static equilibrium on the \
                         same mesh, shape as a part of the length; mesh: the same of that equilibrium against one on a finer mesh, in small motions \
                         relative, by a better solution of the linear body";

/// A line for each kind of motion, for the loads and the mesh, and for what could not be measured.
pub fn lines(name: &str, errors: &ExpectedErrors) -> String {
    let mut lines: Vec<String> = MOTIONS
        .into_iter()
        .filter_map(|(motion, of)| line(errors, motion, |moved| of(&moved.model)))
        .chain(line(errors, PUSHED, pushed))
        .collect();
    lines.extend(errors.loaded.iter().map(|loaded| format!("under the loads alone: {}", within(loaded))));
    lines.extend(errors.mesh().map(|mesh| {
        let (wrench, shape) = (percent(mesh.wrench), percent(mesh.shape));
        format!("mesh of {}, in its worst motion: forces {wrench}, shape {shape}", errors.element)
    }));
    lines.extend(errors.left_out.iter().map(|why| format!("not measured: {why}")));
    let lines: String = lines.iter().map(|line| format!("  {line}\n")).collect();
    format!("{name}: errors of the model {}, against static equilibrium:\n{lines}", errors.model)
}

/// The line of a motion: the worst of all control elements, by levels; `None` where nothing was measured.
fn line(errors: &ExpectedErrors, motion: &str, of: impl Fn(&MovedErrors) -> &[ErrorsAt]) -> Option<String> {
    let worst = |i: usize| {
        let found = errors.moved.iter().map(|moved| of(moved).get(i).copied());
        found.collect::<Option<Vec<ErrorsAt>>>()?.into_iter().reduce(|a, b| a.and(&b))
    };
    let is_named = |at: &ErrorsAt| at.angle == 0.0 || NAMED.contains(&at.angle);
    let levels = (0..).map_while(worst).filter(is_named);
    let levels: Vec<String> = levels.map(|at| format!("{}: {}", far(&at), within(&at))).collect();
    (!levels.is_empty()).then(|| format!("{motion} {}", levels.join("; ")))
}

fn pushed(moved: &MovedErrors) -> &[ErrorsAt] {
    moved.hung.as_ref().map_or(&[], |hung| &hung.at)
}

fn within(at: &ErrorsAt) -> String {
    let forces = at.wrench().map_or("no forces".into(), |wrench| format!("forces {}", percent(wrench)));
    format!("{forces}, shape {}", percent(at.shape))
}

/// The reason why nothing is known of a body that is refused, whether or not `deform` solves it.
pub const NOT_SHOWN: &str = "no session shows the body as it is";

/// Expected errors of a scene's body from its .green file; the error says how to obtain them.
pub fn known(scene: &Scene, name: &str, resolved: &ResolvedBody) -> Result<ExpectedErrors, String> {
    let body = &scene.body[name];
    let Ok(requirements) = resolved.requirements(scene, name, body) else {
        return Err(NOT_SHOWN.into());
    };
    if body.method == Method::Bem {
        return Err(expected::finer_mesh(body));
    }
    if let Some(why) = expected::unmeasurable(body) {
        return Err(why.to_owned());
    }
    if !resolved.entries().any(|effect| effect.measures_errors) {
        let name = name_of(|effect| effect.measures_errors);
        return Err(format!("`greenstage precompute` measures them for effects = [\"{name}\"]"));
    }
    if body.accuracy_target().is_some() {
        let path = prepare::green_path(scene);
        let path = path.display();
        return Err(format!(
            "`greenstage precompute` chooses its settings, and `greenstage inspect {path}` then prints them"
        ));
    }
    match prepare::measured_errors(scene, name, &requirements) {
        Ok(Some(errors)) if errors.model == resolved.model => Ok(errors),
        Err(damaged @ GreenError::Damaged { .. }) => Err(damaged.to_string()),
        _ => Err(format!("`greenstage precompute {}` measures them", scene.path.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Resolved;
    use std::path::Path;

    /// `check` sent users to `precompute`, which measured nothing for `stress` and `haptics`.
    #[test]
    fn only_a_body_that_lists_expected_errors_is_said_to_be_measured() {
        for (effects, said) in [
            (
                "[\"haptics\", \"stress\"]",
                "`greenstage precompute` measures them for effects = [\"expected_errors\"]",
            ),
            ("[\"stress\", \"expected_errors\"]", "`greenstage precompute missing/part.toml` measures them"),
        ] {
            let text = format!(
                "[body.a]\ngenerate = {{ block = {{ size = [1, 1, 1], cells = [2, 2, 2] }} }}\n\
                 material = {{ young = 1.0, poisson = 0.0 }}\neffects = {effects}\n\
                 control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
                 control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
            );
            let scene = Resolved::parse(&text, Path::new("missing/part.toml")).unwrap();
            let to_do = known(&scene, "a", &scene.bodies["a"]).unwrap_err();
            assert!(to_do.starts_with(said), "{effects}: {to_do}");
        }
    }
}
