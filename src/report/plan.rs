//! The cheapest setting that is accurate enough, or the most accurate one within a budget, from measured rows.

use super::{Row, Setting};
use crate::deform::MODELS;
use crate::scene::{Accuracy, Budget, Demand};

/// What was chosen, and what it was chosen from.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice<'a> {
    pub row: &'a Row,
    /// By how much the best row misses the demand: the largest ratio of measured to asked; 1 or less where it is met.
    pub miss: f64,
    /// The cheapest of those with a worst error below 0.9 of the chosen one's.
    pub next: Option<&'a Row>,
}

/// What a setting costs, in the order in which costs count: bytes read per frame, the model's place in the list (its
/// arithmetic), bytes held offline. All are counted, not timed, so the choice is the same in every run.
pub fn cost(row: &Row) -> [f64; 3] {
    let model = MODELS.iter().position(|model| model.name == row.setting.model).unwrap_or(MODELS.len());
    [row.cost.frame_bytes, model as f64, row.cost.offline_bytes]
}

/// The worst error of forces and torques.
fn held(row: &Row) -> f64 {
    [row.error.force, row.error.torque].into_iter().flatten().map(|spread| spread.worst).fold(0.0, f64::max)
}

/// The largest ratio of what was measured to what was asked; met where it is at most 1.
pub fn miss(row: &Row, demand: &Demand) -> f64 {
    let ratio = |measured: f64, asked: Option<f64>| asked.map_or(0.0, |asked| measured / asked);
    match demand {
        Demand::Accuracy(Accuracy { displacement, force, .. }) => {
            ratio(row.error.total.worst, *displacement).max(ratio(held(row), *force))
        }
        Demand::Budget(Budget { frame_ms, file_mb, offline_s, .. }) => {
            ratio(1e3 * row.cost.frame_p99_s, *frame_ms)
                .max(ratio(1e-6 * row.cost.file_bytes, *file_mb))
                .max(ratio(row.cost.offline_s, *offline_s))
        }
    }
}

/// Chooses among `rows`; `None` of none. Of equal costs the least error wins. Where no row meets the demand, the one
/// that misses it least.
pub fn choose<'a>(rows: &'a [Row], demand: &Demand) -> Option<Choice<'a>> {
    let error = |row: &Row| row.error.total.worst;
    let cheaper = |a: &&Row, b: &&Row| compare(&cost(a), &cost(b)).then(error(a).total_cmp(&error(b)));
    let rows = || rows.iter().filter(|row| !row.is_reference());
    let met = || rows().filter(|row| miss(row, demand) <= 1.0);
    let best = match demand {
        Demand::Accuracy(_) => met().min_by(cheaper),
        Demand::Budget(_) => met().min_by(|a, b| error(a).total_cmp(&error(b)).then_with(|| cheaper(a, b))),
    };
    let least =
        || rows().min_by(|a, b| miss(a, demand).total_cmp(&miss(b, demand)).then_with(|| cheaper(a, b)));
    let row = best.or_else(least)?;
    let better = rows().filter(|other| error(other) < 0.9 * error(row));
    Some(Choice { row, miss: miss(row, demand), next: better.min_by(cheaper) })
}

fn compare(a: &[f64; 3], b: &[f64; 3]) -> std::cmp::Ordering {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.total_cmp(b))
        .find(|order| order.is_ne())
        .unwrap_or(std::cmp::Ordering::Equal)
}

/// A setting as a sentence names it.
pub fn name(setting: &Setting) -> String {
    let refined = match setting.refine {
        0 => String::new(),
        times => format!(", refined {times}×"),
    };
    format!("{}{refined}, {}, {}, {}", setting.element, setting.solver, setting.storage, setting.model)
}

impl Choice<'_> {
    /// What was chosen and why, and what the next better would cost.
    pub fn sentences(&self, demand: &Demand) -> Vec<String> {
        let worst = |row: &Row| {
            let displacement = 100.0 * row.error.total.worst;
            format!("displacement to {displacement:.2} %, force and torque to {:.2} %", 100.0 * held(row))
        };
        let price = |row: &Row| {
            format!(
                "{:.3} ms a frame, {:.2} MB, {:.2} s offline",
                1e3 * row.cost.frame_p50_s,
                1e-6 * row.cost.file_bytes,
                row.cost.offline_s
            )
        };
        let row = self.row;
        let mut said =
            vec![format!("chosen: {}: {} at worst; {}", name(&row.setting), worst(row), price(row))];
        if self.miss > 1.0 {
            let what = match demand {
                Demand::Accuracy(_) => "no setting is as accurate as asked",
                Demand::Budget(_) => "no setting fits the budget",
            };
            said.push(format!("{what}: the best misses it by a factor of {:.2}", self.miss));
        }
        said.push(match self.next {
            Some(next) => {
                format!("the next better: {}: {}; {}", name(&next.setting), worst(next), price(next))
            }
            None => "nothing that was measured is better".into(),
        });
        said
    }
}
