//! `greenstage verify bent`: a hand lets go of bodies that are bent by up to 90°, by every model of the .green file that has
//! forces: does the loop make energy?

use super::marks;
use super::print::print;
use super::stability::{NOTHING_J, device, settled_cell};
use crate::base::failure::Failure;
use crate::base::table::Table;
use crate::deform::MODELS;
use crate::effect::haptics::bent::{BENDS_DEG, beam, let_go};
use crate::effect::haptics::settling::{MODULI, SettlingResult};
use crate::effect::haptics::{Hand, Reports};
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;

/// Asks for this instead of problems.
pub const NAME: &str = "bent";

/// Prints a table or JSON, and writes the table into a Markdown file where one is named.
pub fn run(json: bool, readme: Option<&Path>) -> Result<(), Failure> {
    let (table, found) = bent()?;
    print(&if json { format!("{:#}\n", json!(found)) } else { format!("{}\n", table.text()) })?;
    if let Some(path) = readme {
        marks::write_between(path, NAME, &table.markdown())?;
    }
    judge_bent(&found)
}

/// Reports of the device on bent bodies: a thousand times a second, and two hundred times with jitter.
const BENT_REPORTS: [Reports; 2] = [
    Reports { every_s: 1e-3, delay_s: 0.0, jitter_s: 0.0 },
    Reports { every_s: 5e-3, delay_s: 0.0, jitter_s: 5e-3 },
];

/// A row for each model that has forces, way of reporting and bend, a column for each body.
fn bent() -> Result<(Table, Vec<serde_json::Value>), Failure> {
    let heading = ["model", "reports", "bent by"].map(str::to_owned);
    let moduli = MODULI.map(|young| format!("{young:.0e} Pa"));
    let mut table = Table { rows: vec![heading.into_iter().chain(moduli).collect()] };
    let mut found = Vec::new();
    let models = MODELS.iter().filter(|model| model.energy.is_some() && model.law().is_none());
    for model in models {
        let ways: Vec<(Reports, f64)> =
            BENT_REPORTS.into_iter().flat_map(|r| BENDS_DEG.map(|degrees| (r, degrees))).collect();
        let of_body = |&young: &f64| -> Result<Vec<SettlingResult>, Failure> {
            let body = beam(model, young)?;
            let way = |&(reports, degrees)| let_go(&body, degrees, &device(1000.0), reports, Hand::NONE);
            ways.iter().map(way).collect()
        };
        let runs = MODULI.par_iter().map(of_body).collect::<Result<Vec<_>, _>>()?;
        for (way, (reports, degrees)) in ways.iter().enumerate() {
            let head =
                [model.name.to_owned(), format!("{:.0} Hz", 1.0 / reports.every_s), format!("{degrees}°")];
            table
                .rows
                .push(head.into_iter().chain(runs.iter().map(|runs| settled_cell(&runs[way]))).collect());
            for (young, run) in MODULI.iter().zip(runs.iter().map(|runs| runs[way])) {
                found.push(json!({
                    "model": model.name, "every_s": reports.every_s, "jitter_s": reports.jitter_s,
                    "degrees": degrees, "young_pa": young, "swing_m": run.swing_m,
                    "turned_rad": run.turned_rad, "speed": run.speed, "made_j": run.made_j,
                }));
            }
        }
    }
    Ok((table, found))
}

/// No model's loop may generate energy on a bent body.
fn judge_bent(bent: &[serde_json::Value]) -> Result<(), Failure> {
    let makes = |run: &&serde_json::Value| run["made_j"].as_f64().is_none_or(|made| made >= NOTHING_J);
    match bent.iter().find(makes) {
        None => Ok(()),
        Some(run) => Err(Failure::Work(anyhow::anyhow!("a loop on a bent body generates energy: {run}"))),
    }
}
