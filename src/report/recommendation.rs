//! Recommends the setting that reaches a given error for the least cost: the first question of an engineer.

use super::cost_metric::{COST_METRICS, CostMetric, ONLINE, costs};
use super::data::{Measurement, Report};
use super::units::relative;

/// Errors that recommendations are made for, from lax to strict.
pub const GOALS: [f64; 3] = [0.1, 0.01, 0.001];

/// Costs within this ratio count as equal: timings scatter by more.
const SAME_COST: f64 = 1.02;
/// Each step of the ladder reduces the error to at most this share of the one before.
const STEP: f64 = 0.9;

/// The error that recommendations are made by: total, uncancelled, median of the poses.
fn error(row: &Measurement) -> f64 {
    row.error.uncancelled.median
}

/// The row that can be chosen and reaches an error of `goal` for the least cost. Of those whose cost is within 2 % of the least,
/// the one with the least product of all three costs.
pub fn cheapest(rows: &[Measurement], metric: &CostMetric, goal: f64) -> Option<usize> {
    cheapest_with(rows, metric, |row| error(row) <= goal)
}

/// [`cheapest`] among the rows that are good enough by another measure.
pub fn cheapest_with(
    rows: &[Measurement],
    metric: &CostMetric,
    is_good: impl Fn(&Measurement) -> bool,
) -> Option<usize> {
    let reaches = |row: &Measurement| row.can_be_chosen() && is_good(row);
    let reaching: Vec<usize> = (0..rows.len()).filter(|&i| reaches(&rows[i])).collect();
    let least = reaching.iter().map(|&i| (metric.of)(&rows[i].cost)).fold(f64::INFINITY, f64::min);
    let all = |i: usize| {
        COST_METRICS.iter().map(|by| (by.of)(&rows[i].cost).max(f64::MIN_POSITIVE).ln()).sum::<f64>()
    };
    reaching
        .into_iter()
        .filter(|&i| (metric.of)(&rows[i].cost) <= SAME_COST * least)
        .min_by(|&a, &b| all(a).total_cmp(&all(b)))
}

/// The rows from the cheapest that can be chosen to the most accurate: each costs over 2 % more than the one before it, and has
/// at most 0.9 of its error.
pub fn ladder(rows: &[Measurement], metric: &CostMetric) -> Vec<usize> {
    ladder_by(rows, metric, error)
}

/// [`ladder`] by another error.
pub fn ladder_by(rows: &[Measurement], metric: &CostMetric, error: fn(&Measurement) -> f64) -> Vec<usize> {
    let cost = |i: usize| (metric.of)(&rows[i].cost);
    let mut rungs: Vec<usize> = Vec::new();
    let mut next = cheapest(rows, metric, f64::INFINITY);
    let mut least = 0.0;
    while let Some(i) = next {
        if !rungs.is_empty() && cost(i) <= SAME_COST * least {
            rungs.pop();
        } else {
            least = cost(i);
        }
        rungs.push(i);
        let own = error(&rows[i]);
        next = cheapest_with(rows, metric, |row| error(row) <= STEP * own && error(row) < own);
    }
    rungs
}

/// The row with the least error of shape, force and torque together; of those within 2 % of it the fastest.
pub fn most_accurate(rows: &[Measurement]) -> Option<usize> {
    let known = rows.iter().filter(|row| row.can_be_chosen());
    let least = known.map(Measurement::worst).fold(f64::INFINITY, f64::min);
    cheapest_with(rows, &ONLINE, |row| row.worst() <= SAME_COST * least)
}

/// Recommendations in sentences, one for each of [`GOALS`], by the online cost and the worst pose.
pub fn recommendations(report: &Report) -> Vec<String> {
    let rows = &report.rows;
    let Some(best) = most_accurate(rows) else { return Vec::new() };
    let mut sentences = Vec::new();
    for goal in GOALS {
        let Some(i) = cheapest_with(rows, &ONLINE, |row| row.worst() <= goal) else {
            sentences.push(format!(
                "Within {}: nothing that was measured. The most accurate is {}, with {}; it costs {}.",
                relative(goal),
                rows[best].setting,
                errors(&rows[best]),
                costs(&rows[best].cost),
            ));
            return sentences;
        };
        sentences.push(format!(
            "Within {}: {}, with {}; it costs {}.",
            relative(goal),
            rows[i].setting,
            errors(&rows[i]),
            costs(&rows[i].cost)
        ));
    }
    sentences
}

/// "shape to 0.3 %, force and torque to 1.2 %": in the worst pose.
pub fn errors(row: &Measurement) -> String {
    let held =
        row.held().map_or("no forces".into(), |held| format!("force and torque to {}", relative(held)));
    format!("shape to {}, {held}", relative(row.shape()))
}
