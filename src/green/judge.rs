//! Whether a solution may be used: its forward error and what it does with rigid motions, against [`ERROR_LIMITS`].

use super::control::FIELDS;
use super::error::GreenError;
use super::families::AFFINE;
use super::file::{BodyMeta, GreenFile};
use super::rigid::RigidMotion;
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::solve::{ERROR_LIMITS, Method, SolveError, find_method};

const SHIFT: &str = "the error of the displacements when all control elements are shifted alike (the columns of a shift \
                     are not 1 in every node)";
const TURN: &str = "the error of the displacements when all control elements are turned alike (in parts of the displacement at \
                    half the body's extent)";
const SHIFT_FORCE: &str =
    "the force that a shift of all control elements costs one of them, over that of shifting it alone,";

/// A warning for every figure above the first limit; an error where one is above the second or is no number.
pub fn judge(
    entity: &str,
    method: &'static Method,
    forward_error: Option<f64>,
    rigid: &RigidMotion,
) -> Result<Vec<Diagnostic>, SolveError> {
    let mut findings = Vec::new();
    let remedy = method.remedy;
    if let Some(error) = forward_error {
        findings.extend(one(entity, "the bound on the forward error", error, remedy)?);
    }
    findings.extend(one(entity, SHIFT, rigid.shift, remedy)?);
    findings.extend(one(entity, TURN, rigid.turn, remedy)?);
    if let Some(force) = rigid.shift_force {
        findings.extend(one(entity, SHIFT_FORCE, force, remedy)?);
    }
    let turn = rigid.turn_force.filter(|turn| *turn > ERROR_LIMITS[0] || turn.is_nan());
    // Displacements and pulls are judged above: what is left is a moment that S has no digits for.
    findings.extend(turn.map(|turn| {
        let message = format!(
            "moments are uncertain by {turn:.1e} of that of turning one control element (a turn of all \
             should cost 0); forces are right. Make the contrast of stiffness smaller: 10⁶ is as good as \
             rigid"
        );
        Diagnostic::new(Severity::Warning, entity, message)
    }));
    Ok(findings)
}

/// Judges a body as it stands in a .green file: by its columns and S, and the forward error that the file states.
pub fn judge_file(file: &GreenFile, body: &str) -> Result<Vec<Diagnostic>, GreenError> {
    let Some(meta) = file.meta.bodies.get(body) else { return Ok(Vec::new()) };
    let method = find_method(&meta.accuracy.solver).unwrap_or_default();
    let failed = |source| GreenError::Solve { body: format!("{}: body.{body}", file.path.display()), source };
    let rigid = rigid_motion(file, body, meta);
    judge(&format!("body.{body}"), method, meta.accuracy.forward_error, &rigid).map_err(failed)
}

/// Errors of the stored columns and S in rigid motions.
fn rigid_motion(file: &GreenFile, body: &str, meta: &BodyMeta) -> RigidMotion {
    if !meta.requirements.has(AFFINE) {
        return RigidMotion::default();
    }
    let groups: Vec<_> = meta.controls.iter().map(|control| file.basis(body, &control.name)).collect();
    let value = |row: usize, column: usize| {
        f64::from(groups[column / FIELDS].value(meta.surface_nodes, column % FIELDS, row))
    };
    file.rigid_motion_of(body, &meta.controls, &value, file.stiffness(body).as_ref())
}

fn one(
    entity: &str,
    figure: &'static str,
    value: f64,
    remedy: &'static str,
) -> Result<Option<Diagnostic>, SolveError> {
    if value <= ERROR_LIMITS[0] {
        return Ok(None);
    }
    if value > ERROR_LIMITS[1] || value.is_nan() {
        return Err(SolveError::Inexact { figure, value, remedy });
    }
    let message = format!("{figure} is {value:.1e}, above {}; {remedy}", ERROR_LIMITS[0]);
    Ok(Some(Diagnostic::new(Severity::Warning, entity, message)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_warned_of_above_the_first_limit_and_refused_above_the_second() {
        let judged = |forward, shift, force| {
            let rigid = RigidMotion { shift, turn: shift, shift_force: Some(force), turn_force: Some(0.0) };
            let judged = judge("body.b", Default::default(), Some(forward), &rigid);
            judged.map(|findings| findings.len()).map_err(|error| error.to_string())
        };
        assert_eq!(judged(1e-3, 1e-3, 1e-3), Ok(0));
        assert_eq!(judged(1.1e-3, 0.1, 2e-3), Ok(4));
        for (forward, shift, force, words) in [
            (0.11, 0.0, 0.0, "the bound on the forward error is 1.1e-1, above 0.1"),
            (f64::NAN, 0.0, 0.0, "the bound on the forward error is NaN"),
            (0.0, 0.2, 0.0, "the columns of a shift are not 1 in every node) is 2.0e-1"),
            (0.0, 0.0, f64::INFINITY, "over that of shifting it alone, is inf"),
        ] {
            let said = judged(forward, shift, force).unwrap_err();
            assert!(said.contains(words) && said.contains("greenstage check"), "{said}");
        }
        let turn = RigidMotion { turn_force: Some(0.5), ..RigidMotion::default() };
        assert_eq!(judge("body.b", Default::default(), Some(0.0), &turn).unwrap().len(), 1);
    }
}
