//! The answer in plain words: the costs and the worth of the scene's own setting, the costs of a better one, and the setting that
//! reaches a given error for the least cost.
//!
//! In: the measured rows. Out: sentences, and the three settings that the page compares.

use super::pareto::{COST_METRICS, CostMetric, ONLINE, costs};
use crate::measure::units::{relative, seconds};
use crate::measure::{Measurement, Report, Setting};

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
pub fn ladder_by(
    rows: &[Measurement],
    metric: &CostMetric,
    error: impl Fn(&Measurement) -> f64,
) -> Vec<usize> {
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
                "Within {}: no setting. The most accurate is {}: {}; {}.",
                relative(goal),
                rows[best].setting,
                errors(&rows[best]),
                costs(&rows[best].cost),
            ));
            return sentences;
        };
        sentences.push(format!(
            "Within {}: {}: {}; {}.",
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
    format!("shape to {}, force and torque to {}", relative(row.shape()), relative(row.held()))
}

/// Up to the first of these errors a quantity is trusted, up to the second it is a rough guide.
const GOOD: f64 = 0.05;
const ROUGH: f64 = 0.25;

/// A grade of trust that an error allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trust {
    Good,
    Rough,
    Bad,
}

impl Trust {
    pub fn from_error(error: f64) -> Trust {
        match error {
            error if error <= GOOD => Trust::Good,
            error if error <= ROUGH => Trust::Rough,
            _ => Trust::Bad,
        }
    }

    /// The words of a table.
    pub fn word(self) -> &'static str {
        match self {
            Trust::Good => "trust it",
            Trust::Rough => "rough guide",
            Trust::Bad => "do not trust it",
        }
    }
}

/// A setting that the page shows, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    pub role: String,
    pub row: usize,
}

/// The most accurate setting, the scene's own and the cheapest; where two of them are one, it is shown once.
pub fn shown(report: &Report) -> Vec<Shown> {
    shown_of(&report.rows, &report.own)
}

/// The rows that a headline shows, each with its role, from these rows.
pub fn shown_of(rows: &[Measurement], own: &Setting) -> Vec<Shown> {
    let own = rows.iter().position(|row| row.setting == *own);
    let found = [
        ("most accurate", most_accurate(rows)),
        ("this scene's", own),
        ("cheapest", cheapest(rows, &ONLINE, f64::INFINITY)),
    ];
    let mut shown: Vec<Shown> = Vec::new();
    for (role, row) in found {
        let Some(row) = row else { continue };
        match shown.iter_mut().find(|other| other.row == row) {
            Some(other) => other.role = format!("{} and {role}", other.role),
            None => shown.push(Shown { role: role.into(), row }),
        }
    }
    shown
}

/// The row of the scene's own setting, where it was measured.
fn own(report: &Report) -> Option<usize> {
    report.rows.iter().position(|row| row.setting == report.own)
}

/// The answer in two sentences, true for whatever was measured; empty where there are no rows that can be chosen.
pub fn headline(report: &Report) -> Vec<String> {
    let rows = &report.rows;
    let Some(i) = own(report).or_else(|| cheapest(rows, &ONLINE, f64::INFINITY)) else { return Vec::new() };
    let row = &rows[i];
    let mut said = Vec::new();
    if own(report).is_none() {
        said.push(format!(
            "The scene's own setting ({}) was not measured; this is the cheapest one, {}.",
            report.own, row.setting
        ));
    }
    said.push(verdict(row, report));
    said.extend(not_measured(report));
    said.push(remedy(rows, i));
    said.extend(report.timing.warning());
    said
}

/// Number of poses that are named one by one.
const NAMED: usize = 4;

/// "4.00 s and 6.00 s", or "8 poses, 2.00 s to 9.00 s": those that were compared with a finer equilibrium.
fn named(poses: &[String]) -> String {
    match poses {
        [first, .., last] if poses.len() > NAMED => format!("{} poses, from {first} to {last}", poses.len()),
        [one] => format!("the pose {one}"),
        [first @ .., last] => format!("the poses {} and {last}", first.join(", ")),
        [] => "no pose".into(),
    }
}

/// The poses for which nothing is claimed, and how far the reference itself is known.
fn not_measured(report: &Report) -> Vec<String> {
    let mut said = Vec::new();
    if !report.not_compared.is_empty() && !report.compared.is_empty() {
        let first = &report.not_compared[..report.not_compared.len().min(NAMED)];
        let more = match report.not_compared.len() - first.len() {
            0 => String::new(),
            n => format!("; and {n} more"),
        };
        said.push(format!("Not measured: {}{more}.", first.join("; ")));
    }
    if !report.compared.is_empty() {
        said.push(match report.doubt {
            Some([shape, held]) => format!(
                "The finer equilibrium is itself known to {} in shape, and to {} in force and torque.",
                relative(shape),
                relative(held)
            ),
            None => "How far the finer equilibrium is itself from the truth was not measured.".into(),
        });
    }
    said
}

/// "For 43 µs an evaluation, in the poses 4 s and 6 s, the shape is within 2.3 %, and force and torque within 264 %: do not trust
/// the force."
fn verdict(row: &Measurement, report: &Report) -> String {
    let time = seconds(row.cost.frame_p50_s);
    let shape = relative(row.shape());
    if !row.is_trusted() {
        return format!(
            "For {time} an evaluation: do not trust this setting. Its solver ({}) stops before its own estimate of the error is small \
             enough, whatever the measured poses show.",
            row.setting.solver
        );
    }
    if !row.is_mesh_known() {
        let held = relative(row.held());
        let why = report.not_compared.first().map_or_else(String::new, |why| format!(" ({why})"));
        return format!(
            "For {time} an evaluation: what the mesh adds to the error was not measured in any pose{why}. The model alone has \
             {shape} in shape, and {held} in force and torque."
        );
    }
    let poses = named(&report.compared);
    // The finest mesh is compared with itself: the rest of its error is known, that of its mesh is not.
    let (within, and) =
        if row.is_reference() { ("wrong by at least", "by at least") } else { ("within", "within") };
    let verdict = if row.is_reference() && Trust::from_error(row.worst()) == Trust::Good {
        "it is the finest mesh that was measured, so the error of the mesh itself is not known"
    } else {
        both(Trust::from_error(row.shape()), Trust::from_error(row.held()))
    };
    format!(
        "For {time} an evaluation, in {poses}, the shape is {within} {shape}, and force and torque {and} {}: {verdict}.",
        relative(row.held())
    )
}

fn both(shape: Trust, force: Trust) -> &'static str {
    use Trust::{Bad, Good, Rough};
    match (shape, force) {
        (Good, Good) => "there both can be trusted",
        (Good, Rough) => "trust the shape, and take the force as a rough guide",
        (Good, Bad) => "trust the shape, do not trust the force",
        (Rough, Good) => "trust the force, and take the shape as a rough guide",
        (Rough, Rough) => "both are rough guides",
        (Rough, Bad) => "the shape is a rough guide, do not trust the force",
        (Bad, Good) => "trust the force, do not trust the shape",
        (Bad, Rough) => "do not trust the shape; the force is a rough guide",
        (Bad, Bad) => "do not trust either",
    }
}

/// Names the setting that brings everything within 5 %, or comes nearest to that.
fn remedy(rows: &[Measurement], own: usize) -> String {
    let is_good = |row: &Measurement| row.worst() <= GOOD;
    let Some(i) = cheapest_with(rows, &ONLINE, is_good) else {
        let Some(best) = most_accurate(rows) else { return unjudged(rows).trim_start().to_owned() };
        let nearest = if best == own { "This one comes nearest".to_owned() } else { price(&rows[best]) };
        let verb =
            if best == own { String::new() } else { format!(" comes nearest, with {}", errors(&rows[best])) };
        return format!(
            "Nothing that was measured brings both within 5 %. {nearest}{verb}.{}",
            unjudged(rows)
        );
    };
    if i == own {
        return "Nothing cheaper that was measured keeps both within 5 %.".to_owned();
    }
    let (other, time) = (&rows[i], rows[i].cost.frame_p50_s);
    if rows[own].can_be_chosen() && is_good(&rows[own]) {
        if time < rows[own].cost.frame_p50_s {
            return format!("{} keeps both within 5 % too, and is cheaper.", price(other));
        }
        return "Nothing faster that was measured keeps both within 5 %.".to_owned();
    }
    format!("{} brings both within 5 %: {}.", price(other), errors(other))
}

/// The rows that may be within 5 %, but of whose mesh nothing is known; empty where there are none.
fn unjudged(rows: &[Measurement]) -> String {
    let may_be = |row: &&Measurement| row.is_reference() && row.is_trusted() && row.worst() <= GOOD;
    let references: Vec<&Measurement> = rows.iter().filter(may_be).collect();
    let Some(first) = references.first() else { return String::new() };
    let (count, mesh) = (references.len(), first.setting.mesh());
    let settings = if count == 1 { "setting" } else { "settings" };
    format!(
        " Not judged: {count} {settings} on {mesh}, the finest mesh that was measured: a report without --quick, or \
         of more unknowns, judges them."
    )
}

/// "tet10 h · cholesky · f32 · reduced (900 µs an evaluation, 12 s offline)".
fn price(row: &Measurement) -> String {
    let (time, offline) = (seconds(row.cost.frame_p50_s), seconds(row.cost.offline_s));
    format!("{} ({time} an evaluation, {offline} offline)", row.setting)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::{Cost, Errors, Spread};

    fn row(model: &str, time_us: f64, shape: f64, held: f64) -> Measurement {
        let spread = |worst: f64| Spread { median: 0.5 * worst, worst };
        Measurement {
            setting: Setting {
                refine: 0,
                element: "tet4".into(),
                solver: Default::default(),
                storage: "f32".into(),
                model: crate::deform::find_model(model).unwrap(),
            },
            forward_error: Some(1e-12),
            cost: Cost { frame_p50_s: 1e-6 * time_us, offline_s: 2.0, file_bytes: 1e6, ..Cost::default() },
            error: Errors {
                discretisation: Some(spread(1e-3)),
                uncancelled: spread(shape),
                uncancelled_held: spread(held),
                ..Errors::default()
            },
            ..Measurement::default()
        }
    }

    /// Poses that no finer equilibrium was found for are named with the reason, and nothing is claimed of them.
    #[test]
    fn the_headline_names_the_poses_for_which_it_speaks() {
        let rows = vec![row("rotation", 43.0, 0.01, 0.02)];
        let own = rows[0].setting.clone();
        let of = |compared: &[&str], not_compared: &[&str]| {
            let [compared, not_compared] =
                [compared, not_compared].map(|all| all.iter().map(|name| (*name).to_owned()).collect());
            headline(&Report {
                own: own.clone(),
                rows: rows.clone(),
                compared,
                not_compared,
                ..Report::default()
            })
            .join(" ")
        };
        let text = of(&["2 s", "4 s"], &["6 s: no equilibrium beyond 40 % of the way"]);
        assert!(text.contains("in the poses 2 s and 4 s, the shape"), "{text}");
        assert!(text.contains("Not measured: 6 s: no equilibrium beyond 40 % of the way."), "{text}");
        assert!(text.contains("from the truth was not measured"), "{text}");
        assert!(of(&["a", "b", "c", "d", "e"], &[]).contains("in 5 poses, from a to e, the shape"));
    }

    fn said(rows: Vec<Measurement>) -> String {
        let own = row("rotation", 0.0, 0.0, 0.0).setting;
        let compared = vec!["bent by 60°".into()];
        let mut report = Report { own, rows, compared, doubt: Some([0.003, 0.01]), ..Report::default() };
        report.body = "tube".into();
        headline(&report).join(" ")
    }

    #[test]
    fn the_headline_says_what_can_be_trusted() {
        let reduced = || row("reduced", 900.0, 0.01, 0.02);
        assert_eq!(
            said(vec![row("rotation", 43.0, 0.023, 2.64), reduced()]),
            "For 43 µs an evaluation, in the pose bent by 60°, the shape is within 2.3 %, and force and torque within 264 %: trust \
             the shape, do not trust the force. The finer equilibrium is itself known to 0.3 % in shape, and to 1 % in force and \
             torque. tet4 h · cholesky · f32 · reduced (900 µs an evaluation, 2 s offline) brings both within 5 %: shape to \
             1 %, force and torque to 2 %."
        );
        assert_eq!(
            said(vec![row("rotation", 43.0, 0.023, 0.04), reduced()]),
            "For 43 µs an evaluation, in the pose bent by 60°, the shape is within 2.3 %, and force and torque within 4 %: there \
             both can be trusted. The finer equilibrium is itself known to 0.3 % in shape, and to 1 % in force and torque. Nothing \
             cheaper that was measured keeps both within 5 %."
        );
        let all = [0.01, 0.1, 1.0];
        for (shape, force) in all.iter().flat_map(|a| all.iter().map(move |b| (*a, *b))) {
            let text = said(vec![row("rotation", 43.0, shape, force)]);
            assert_eq!(text.contains("do not trust"), shape > 0.25 || force > 0.25, "{text}");
            assert_eq!(text.contains("both can be trusted"), shape.max(force) <= 0.05, "{text}");
            assert_eq!(text.contains("This one comes nearest."), shape.max(force) > 0.05, "{text}");
        }
    }

    #[test]
    fn what_is_not_known_is_not_claimed() {
        // The scene's setting was not measured.
        let text = said(vec![row("linear", 20.0, 0.3, 0.6), row("reduced", 900.0, 0.01, 0.02)]);
        assert!(
            text.starts_with("The scene's own setting (tet4 h · cholesky · f32 · rotation) was not measured"),
            "{text}"
        );
        assert!(
            text.contains("do not trust either. ") && text.contains(". tet4 h · cholesky · f32 · reduced ("),
            "{text}"
        );
        // A solver that its own estimate does not trust.
        let loose = Measurement { forward_error: Some(4.0), ..row("rotation", 43.0, 0.01, 0.01) };
        let text = said(vec![loose, row("reduced", 900.0, 0.01, 0.02)]);
        assert!(text.contains("do not trust this setting") && text.contains("reduced (900 µs"), "{text}");
        // The finest mesh has no discretisation error that is known.
        let mut finest = row("rotation", 43.0, 0.01, 0.02);
        finest.error.discretisation = Some(Spread::default());
        let text = said(vec![finest.clone(), row("reduced", 900.0, 0.01, 0.02)]);
        assert!(text.contains("wrong by at least 1 %") && !text.contains("within 1 %"), "{text}");
        assert!(!text.contains("Not judged"), "{text}");
        let text = said(vec![row("reduced", 900.0, 0.01, 0.2), finest]);
        assert!(text.contains("to 20 %. Not judged: 1 setting on tet4 h, the finest mesh"), "{text}");
        assert_eq!(said(Vec::new()), "");
        // No pose has a finer equilibrium.
        let mut alone = row("rotation", 43.0, 0.01, 0.02);
        alone.error.discretisation = None;
        let text = said(vec![alone]);
        assert!(text.contains("what the mesh adds to the error was not measured"), "{text}");
        assert!(!text.contains("can be trusted") && !text.contains("within"), "{text}");
    }

    #[test]
    fn a_cheaper_setting_that_is_as_good_is_named() {
        let text = said(vec![row("rotation", 43.0, 0.01, 0.01), row("linear", 20.0, 0.02, 0.02)]);
        assert!(
            text.contains(
                "linear (20 µs an evaluation, 2 s offline) keeps both within 5 % too, and is cheaper."
            ),
            "{text}"
        );
    }

    #[test]
    fn settings_that_are_one_are_shown_once() {
        let own = row("rotation", 0.0, 0.0, 0.0).setting;
        let report = |rows| Report { own: own.clone(), rows, ..Default::default() };
        let roles = |rows| shown(&report(rows)).into_iter().map(|s| (s.role, s.row)).collect::<Vec<_>>();
        assert_eq!(
            roles(vec![
                row("rotation", 43.0, 0.1, 0.3),
                row("reduced", 900.0, 0.01, 0.02),
                row("linear", 20.0, 0.3, 4.0)
            ]),
            [("most accurate".into(), 1), ("this scene's".into(), 0), ("cheapest".into(), 2)]
        );
        assert_eq!(
            roles(vec![row("rotation", 43.0, 0.1, 0.3)]),
            [("most accurate and this scene's and cheapest".into(), 0)]
        );
    }
}
