//! What errors to expect of bodies, for `check`, `precompute` and `inspect`: a table, and a sentence for each body.

use crate::base::table::Table;
use crate::deform::{ErrorsAt, ExpectedErrors, MovedErrors, percent};
use crate::effect::expected;
use crate::green::{GreenError, GreenFile};
use crate::prepare;
use crate::scene::{Body, Scene};

/// Turns that the sentence names, °: up to which `rotation` and up to which all may serve.
const NAMED: [f64; 2] = [30.0, 90.0];

/// A row for each angle of each control element that was moved, and one for what the mesh adds.
pub fn table<'a>(bodies: impl IntoIterator<Item = (&'a str, &'a ExpectedErrors)>) -> Table {
    let heading = ["body", "moved", "by", "errors of", "force", "torque", "shape"];
    let mut table = Table::new(&heading);
    for (name, errors) in bodies {
        for MovedErrors { control, model, mesh } in &errors.moved {
            for at in model {
                let [force, torque] = [at.force, at.torque].map(|part| part.map_or("none".into(), percent));
                let of = format!("model {}", errors.model);
                let by = format!("up to {}°", at.angle);
                table.row(&[name, control, &by, &of, &force, &torque, &percent(at.shape)]);
            }
            if let Some(mesh) = mesh {
                let (wrench, shape) = (percent(mesh.wrench), percent(mesh.shape));
                let of = format!("mesh of {}", errors.element);
                table.row(&[name, control, "a little", &of, &wrench, &wrench, &shape]);
            }
        }
    }
    table
}

/// What the table's numbers are parts of.
pub const PARTS: &str = "model: force, and torque over the length, as parts of the largest of both in static equilibrium on the \
                         same mesh, shape as a part of the length; mesh: relative, by a better solution of the linear body";

/// One sentence on the model, one on the mesh, and what could not be measured.
pub fn sentences(name: &str, errors: &ExpectedErrors) -> String {
    let mut text = String::new();
    let worst = |angle: f64| {
        let at = |moved: &MovedErrors| moved.model.iter().find(|at| at.angle == angle).copied();
        let found = errors.moved.iter().map(at).collect::<Option<Vec<ErrorsAt>>>()?;
        found.into_iter().reduce(|a, b| a.and(&b))
    };
    let parts: Vec<String> = NAMED.into_iter().filter_map(worst).map(|at| within(&at)).collect();
    if !parts.is_empty() {
        let (parts, model) = (parts.join(", "), &errors.model);
        text.push_str(&format!(
            "{name}: bent or twisted {parts}: model {model} against static equilibrium, measured on this body\n"
        ));
    }
    if let Some(mesh) = errors.mesh() {
        let (element, wrench, shape) = (&errors.element, percent(mesh.wrench), percent(mesh.shape));
        text.push_str(&format!(
            "{name}: the mesh of {element} itself adds about {wrench} to forces and {shape} to displacements, estimated \
             by a better solution of this body\n"
        ));
    }
    for why in &errors.left_out {
        text.push_str(&format!("{name}: expected errors: {why}\n"));
    }
    text
}

fn within(at: &ErrorsAt) -> String {
    let forces =
        at.wrench().map_or("no forces".into(), |wrench| format!("errors of {} in forces", percent(wrench)));
    format!("by up to {}° expect {forces} and of {} in shapes", at.angle, percent(at.shape))
}

/// What is known of a scene's body by its .green file; or what to do to know it.
pub fn known(scene: &Scene, name: &str, body: &Body) -> Result<ExpectedErrors, String> {
    let Ok(requirements) = prepare::requirements(scene, name, body) else {
        return Err("the body is refused".into());
    };
    let path = prepare::green_path(scene);
    let to_do = if requirements.sections().next().is_some() {
        format!("`greenstage precompute {}` measures them", scene.path.display())
    } else {
        format!("list effects = [\"{}\"], and `greenstage precompute` measures them", expected::NAME)
    };
    let read = || -> Result<Option<ExpectedErrors>, GreenError> {
        let file = GreenFile::open(&path)?;
        file.check_belongs(scene, name, &requirements)?;
        expected::read(&file, name)
    };
    match read() {
        Ok(Some(errors)) if errors.model == body.model => Ok(errors),
        Err(damaged @ GreenError::Damaged { .. }) => Err(damaged.to_string()),
        _ => Err(to_do),
    }
}
