//! Which setting reaches a given error for the least cost: the first question of an engineer.

use super::cost_metric::{COST_METRICS, CostMetric, ONLINE, costs};
use super::data::{Measurement, Report};
use super::units::{relative, times};

/// Total errors that recommendations are made for, the commonest first.
pub const GOALS: [f64; 3] = [0.01, 0.1, 0.001];

/// Costs within this ratio count as equal: timings scatter by more.
const SAME_COST: f64 = 1.02;
/// Each step of the ladder reduces the error to at most this share of the one before.
const STEP: f64 = 0.9;

/// The error that recommendations are made by: total, uncancelled, median of the poses.
fn error(row: &Measurement) -> f64 {
    row.error.uncancelled.median
}

/// Among the rows that can be chosen, the one that reaches an error of `goal` for the least cost. Of those whose cost is
/// within 2 % of the least, the one with the least product of all three costs.
pub fn cheapest(rows: &[Measurement], metric: &CostMetric, goal: f64) -> Option<usize> {
    let reaches = |row: &Measurement| row.can_be_chosen() && error(row) <= goal;
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

/// From the cheapest of all rows that can be chosen to the most accurate: each costs over 2 % more than the one before it,
/// and has at most 0.9 of its error.
pub fn ladder(rows: &[Measurement], metric: &CostMetric) -> Vec<usize> {
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
        next = better(rows, metric, i);
    }
    rungs
}

/// The cheapest with at most 0.9 of the error of row `i`.
fn better(rows: &[Measurement], metric: &CostMetric, i: usize) -> Option<usize> {
    let own = error(&rows[i]);
    cheapest(rows, metric, STEP * own).filter(|&next| error(&rows[next]) < own)
}

/// Recommendations in sentences, one for each of [`GOALS`], by the online cost.
pub fn recommendations(report: &Report) -> Vec<String> {
    let rows = &report.rows;
    let Some(best) = ladder(rows, &ONLINE).pop() else { return Vec::new() };
    let mut sentences = Vec::new();
    for goal in GOALS {
        match cheapest(rows, &ONLINE, goal) {
            Some(i) => sentences.push(recommendation(rows, goal, i)),
            None => {
                let (row, goal) = (&rows[best], relative(goal));
                sentences.push(format!(
                    "No setting that was measured reaches a total error of {goal}. The most accurate, {}, has {} \
                     (worst pose {}), most of it {} error, for {}.",
                    row.setting,
                    relative(error(row)),
                    relative(row.error.uncancelled.worst),
                    row.error.largest_part(),
                    costs(&row.cost),
                ));
                return sentences;
            }
        }
    }
    sentences
}

fn recommendation(rows: &[Measurement], goal: f64, i: usize) -> String {
    let row = &rows[i];
    let error = row.error.uncancelled;
    let first = format!(
        "For a total error of {} the cheapest online is {}: {}. Its error is {} (worst pose {}), most of it {} error.",
        relative(goal),
        row.setting,
        costs(&row.cost),
        relative(error.median),
        relative(error.worst),
        row.error.largest_part(),
    );
    let Some(next) = better(rows, &ONLINE, i).map(|j| &rows[j]) else {
        return first + " No other setting that was measured has an error smaller by a tenth.";
    };
    let ratio = next.cost.frame_p50_s / row.cost.frame_p50_s;
    let ratio = match ratio {
        r if !r.is_finite() => String::new(),
        r if r <= SAME_COST => " (as fast online)".into(),
        r => format!(" ({} times the time of an evaluation)", times(r)),
    };
    format!(
        "{first} The next better setting, {}, has an error of {} for {}{ratio}.",
        next.setting,
        relative(next.error.uncancelled.median),
        costs(&next.cost),
    )
}
