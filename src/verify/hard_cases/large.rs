//! Case 26: a cube pressed further than its material bears. Newton's iteration finds turned elements and calls it done;
//! here the least det F decides.

use super::case::{CaseRow, CaseRows, ENDS, Must, Outcome};
use crate::deform::{ControlPose, EquilibriumResult, Statics, StaticsError};
use crate::fem::{Law, NEO_HOOKEAN, STVK};
use crate::scene::Scene;
use crate::solve::Silent;
use nalgebra::Vector3;
use std::path::Path;

const CUBE: &str = r#"
[body.b]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [4, 4, 4] } }
material = { young = 1.0e6, poisson = 0.3 }
"#;

pub(super) fn rows() -> CaseRows {
    let scene = Scene::parse(&format!("{CUBE}{ENDS}"), Path::new("hard-cases.toml"))?;
    let cases = [
        (&STVK, 0.8, Must::solve("residual", 1e-10)),
        (&STVK, 0.4, Must { outcome: Outcome::Refused, words: "least det F", ..Must::solve("", 0.0) }),
        (&NEO_HOOKEAN, 0.4, Must::solve("residual", 1e-10)),
    ];
    cases.into_iter().map(|(law, height, must)| Ok(pressed(&scene, law, height, must))).collect()
}

fn pressed(scene: &Scene, law: &'static Law, height: f64, must: Must) -> CaseRow {
    let press = ControlPose { translation: Vector3::z() * (height - 1.0), ..ControlPose::REST };
    let settle = || -> Result<EquilibriumResult, StaticsError> {
        Statics::new(scene, "b", law, &Silent)?.solve(&vec![ControlPose::REST, press], &Silent)
    };
    let (outcome, said, error) = match settle() {
        Ok(settled) if settled.inverted.is_empty() => {
            (Outcome::Solved, String::new(), Some(settled.residual))
        }
        Ok(settled) => (Outcome::Solved, format!("{} inverted", settled.inverted.len()), Some(f64::NAN)),
        Err(error) => (Outcome::Refused, error.to_string(), None),
    };
    CaseRow {
        number: 26,
        case: format!("clamped cube pressed to {:.0} % of its height, {}", 100.0 * height, law.name),
        required: must.outcome,
        outcome,
        words: must.words,
        said,
        measured: must.measured,
        error,
        bound: (must.outcome != Outcome::Refused).then_some(must.bound),
    }
}
