//! The tables of `verify together`, from its trials.

use super::{Outcome, Trial, run};
use crate::base::failure::Failure;
use crate::base::table::Table;
use crate::config::unknown_name;
use crate::deform::MODELS;
use crate::effect::EFFECTS;
use crate::verify::studies::Study;
use indexmap::{IndexMap, IndexSet};
use serde_json::json;
use std::time::Instant;

/// The row of the most effects that go together with a model.
const MOST: &str = "all that go together";

/// All sets of effects with the models of these names, or with all, for so many frames each; `told` hears of each model as it ends.
pub fn study(names: &[String], frames: usize, told: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    let known = || MODELS.iter().map(|model| model.name);
    if let Some(unknown) = names.iter().find(|name| known().all(|known| known != *name)) {
        return Err(Failure::wrong(unknown_name("model", unknown, known())));
    }
    let is_meant = |name: &str| names.is_empty() || names.iter().any(|meant| meant == name);
    let models: Vec<&str> = known().filter(|name| is_meant(name)).collect();
    let mut trials = Vec::new();
    for model in MODELS.iter().filter(|model| is_meant(model.name)) {
        let started = Instant::now();
        let of_model = run(model, frames).map_err(Failure::wrong)?;
        told(format!(
            "{model}: {} sets of effects in {:.0} s",
            of_model.len(),
            started.elapsed().as_secs_f64()
        ));
        trials.extend(of_model);
    }
    let failed: Vec<String> = trials.iter().flat_map(failures).collect();
    let verdict = match failed.len() {
        0 => Ok(Some(format!("all scenes that are not refused ran {frames} frames"))),
        count => Err(format!("{count} scenes failed:\n{}", failed.join("\n"))),
    };
    let [pairs, legend] = pairs(&trials, &models);
    let [times, refusals] = times(&trials, &models);
    let tables = vec![
        headed(
            "Two effects in one body, or, after \"apart\", in two bodies of a scene: the models with which they run",
            pairs,
        ),
        headed("Models", legend),
        headed(&format!("Milliseconds of a frame, mean of {frames}, or the number of the refusal"), times),
        headed("Refusals", refusals),
    ];
    Ok(Study { tables, json: json!({ "frames": frames, "trials": trials }), verdict })
}

fn headed(heading: &str, table: Table) -> ([String; 2], Table) {
    ([heading.to_owned(), format!("{heading}:")], table)
}

fn failures(trial: &Trial) -> impl Iterator<Item = String> {
    let outcomes = [Some(&trial.together), trial.apart.as_ref()].into_iter().flatten();
    outcomes.filter_map(|outcome| match outcome {
        Outcome::Failed(failed) => {
            let effects = trial.effects.join(" + ");
            Some(format!("{effects}, {}: frame {}: {}", trial.model, failed.frame, failed.why))
        }
        _ => None,
    })
}

/// The models with which a set of effects runs.
fn models_of(
    trials: &[Trial],
    effects: &[&str],
    outcome: fn(&Trial) -> Option<&Outcome>,
) -> Vec<&'static str> {
    let own = trials.iter().filter(|trial| trial.effects == effects);
    own.filter(|trial| matches!(outcome(trial), Some(Outcome::Ran(_)))).map(|trial| trial.model).collect()
}

/// Effects × effects, with a letter for the models with which a pair runs; and the models of each letter.
fn pairs(trials: &[Trial], meant: &[&str]) -> [Table; 2] {
    let mut letters: IndexSet<Vec<&str>> = IndexSet::new();
    let mut letter = |models: Vec<&'static str>| {
        (!models.is_empty()).then(|| char::from(b'A' + letters.insert_full(models).0 as u8).to_string())
    };
    let names: Vec<&str> = EFFECTS.iter().map(|effect| effect.name).collect();
    let mut table = Table::new(&[&[""], &names[..]].concat());
    for (i, first) in names.iter().enumerate() {
        let cell = |(j, second): (usize, &&'static str)| {
            let effects = if i == j { vec![*first] } else { vec![*second, *first] };
            let together = letter(models_of(trials, &effects, |trial| Some(&trial.together)));
            let apart = letter(models_of(trials, &effects, |trial| trial.apart.as_ref()));
            [together, apart.map(|models| format!("apart {models}"))]
                .into_iter()
                .flatten()
                .collect::<Vec<_>>()
                .join(", ")
        };
        let mut row: Vec<String> = names[..=i].iter().enumerate().map(cell).collect();
        row.insert(0, (*first).to_owned());
        row.resize(names.len() + 1, String::new());
        table.rows.push(row);
    }
    let mut legend = Table::new(&["", "models"]);
    for (i, models) in letters.iter().enumerate() {
        let all = if models.len() == meant.len() { "all" } else { &models.join(", ") };
        legend.row(&[&char::from(b'A' + i as u8).to_string(), all]);
    }
    [table, legend]
}

/// Sets of effects × models, with the time of a frame or the number of the refusal; and the sentences of the refusals.
fn times(trials: &[Trial], models: &[&str]) -> [Table; 2] {
    let mut table = Table::new(&[&["effects"], models].concat());
    let mut refusals: IndexSet<String> = IndexSet::new();
    let mut cell = |model: &str, outcome: &Outcome| match outcome {
        Outcome::Ran(ran) => format!("{:.2}", 1e3 * ran.frame_s),
        Outcome::Refused(why) => {
            let alike = why.replace(&format!("\"{model}\""), "this model");
            format!("({})", refusals.insert_full(alike).0 + 1)
        }
        Outcome::Failed(failed) => format!("FAILED at {}", failed.frame),
    };
    let mut rows: IndexMap<String, Vec<String>> = IndexMap::new();
    for Trial { effects, model, together, apart } in trials {
        let apart = apart.as_ref().map(|apart| format!(", apart {}", cell(model, apart)));
        let cell = cell(model, together) + &apart.unwrap_or_default();
        let row = if effects.len() > 2 { MOST.to_owned() } else { effects.join(" + ") };
        rows.entry(row).or_default().push(cell);
    }
    table.rows.extend(rows.into_iter().map(|(effects, cells)| [vec![effects], cells].concat()));
    let mut sentences = Table::new(&["", "refusal"]);
    refusals.iter().enumerate().for_each(|(i, why)| sentences.row(&[&format!("({})", i + 1), why]));
    [table, sentences]
}
