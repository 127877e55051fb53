//! What an engineer asks first: which setting reaches the error that I can bear, for the least cost.

use super::units::{bytes, relative, seconds, times};
use super::{Cost, PARTS, Report, Row};

/// A cost that a choice can be made by.
pub struct Currency {
    pub name: &'static str,
    pub of: fn(&Cost) -> f64,
    pub say: fn(f64) -> String,
}

pub const ONLINE: Currency = Currency { name: "online", of: |cost| cost.frame_p50_s, say: seconds };
pub const OFFLINE: Currency = Currency { name: "offline", of: |cost| cost.offline_s, say: seconds };
pub const FILE: Currency = Currency { name: "file", of: |cost| cost.file_bytes, say: bytes };
pub const CURRENCIES: [&Currency; 3] = [&ONLINE, &OFFLINE, &FILE];

/// Errors that are asked for, the commonest first.
pub const GOALS: [f64; 3] = [0.01, 0.1, 0.001];

/// Costs closer than this are equal: timings spread more.
const SAME_COST: f64 = 1.02;
/// A step of the ladder leaves at most this share of the error before it.
const STEP: f64 = 0.9;

/// What a row is recommended by: its total error, uncancelled, median of the poses.
pub fn error(row: &Row) -> f64 {
    row.error.uncancelled.median
}

/// The row among those that can be chosen that reaches an error of `goal` for the least cost. Of those that cost no
/// more than 2 % above the least, the one with the least product of all three costs.
pub fn cheapest(rows: &[Row], currency: &Currency, goal: f64) -> Option<usize> {
    let reaches = |row: &Row| row.can_be_chosen() && error(row) <= goal;
    let reaching: Vec<usize> = (0..rows.len()).filter(|&i| reaches(&rows[i])).collect();
    let least = reaching.iter().map(|&i| (currency.of)(&rows[i].cost)).fold(f64::INFINITY, f64::min);
    let all = |i: usize| {
        CURRENCIES.iter().map(|by| (by.of)(&rows[i].cost).max(f64::MIN_POSITIVE).ln()).sum::<f64>()
    };
    reaching
        .into_iter()
        .filter(|&i| (currency.of)(&rows[i].cost) <= SAME_COST * least)
        .min_by(|&a, &b| all(a).total_cmp(&all(b)))
}

/// From the cheapest of all rows that can be chosen to the most accurate: each costs over 2 % more than the one before it, and has at
/// most 0.9 of its error.
pub fn ladder(rows: &[Row], currency: &Currency) -> Vec<usize> {
    let cost = |i: usize| (currency.of)(&rows[i].cost);
    let mut rungs: Vec<usize> = Vec::new();
    let mut next = cheapest(rows, currency, f64::INFINITY);
    let mut least = 0.0;
    while let Some(i) = next {
        if !rungs.is_empty() && cost(i) <= SAME_COST * least {
            rungs.pop();
        } else {
            least = cost(i);
        }
        rungs.push(i);
        next = better(rows, currency, i);
    }
    rungs
}

/// The cheapest with at most 0.9 of the error of row `i`.
fn better(rows: &[Row], currency: &Currency, i: usize) -> Option<usize> {
    let own = error(&rows[i]);
    cheapest(rows, currency, STEP * own).filter(|&next| error(&rows[next]) < own)
}

/// "43 µs an evaluation, 0.84 s offline, a file of 1.2 MB".
pub fn costs(cost: &Cost) -> String {
    let (online, offline, file) =
        (seconds(cost.frame_p50_s), seconds(cost.offline_s), bytes(cost.file_bytes));
    format!("{online} an evaluation, {offline} offline, a file of {file}")
}

/// Which part of a row's error is the largest, in words.
pub fn limit(row: &Row) -> &'static str {
    row.error.dominating().map_or("none", |part| PARTS[part])
}

/// The answers in sentences: one for each of three goals, by online cost.
pub fn answers(report: &Report) -> Vec<String> {
    let rows = &report.rows;
    let Some(best) = ladder(rows, &ONLINE).pop() else {
        return Vec::new();
    };
    let mut told = Vec::new();
    for goal in GOALS {
        match cheapest(rows, &ONLINE, goal) {
            Some(i) => told.push(reached(rows, goal, i)),
            None => {
                let (row, goal) = (&rows[best], relative(goal));
                told.push(format!(
                    "No setting that was measured reaches a total error of {goal}. The most accurate to a tenth, {}, has {} \
                     (worst pose {}), most of it {} error, for {}.",
                    row.setting,
                    relative(error(row)),
                    relative(row.error.uncancelled.worst),
                    limit(row),
                    costs(&row.cost),
                ));
                return told;
            }
        }
    }
    told
}

fn reached(rows: &[Row], goal: f64, i: usize) -> String {
    let row = &rows[i];
    let error = row.error.uncancelled;
    let first = format!(
        "For a total error of {} the cheapest online is {}: {}. Its error is {} (worst pose {}), most of it {} error.",
        relative(goal),
        row.setting,
        costs(&row.cost),
        relative(error.median),
        relative(error.worst),
        limit(row),
    );
    let Some(next) = better(rows, &ONLINE, i).map(|j| &rows[j]) else {
        return first + " Nothing that was measured is better by a tenth.";
    };
    let ratio = next.cost.frame_p50_s / row.cost.frame_p50_s;
    let ratio = match ratio {
        r if !r.is_finite() => String::new(),
        r if r <= SAME_COST => " (as fast online)".into(),
        r => format!(" ({} times the time of an evaluation)", times(r)),
    };
    format!(
        "{first} The next better, {}, has {} for {}{ratio}.",
        next.setting,
        relative(next.error.uncancelled.median),
        costs(&next.cost),
    )
}
