//! The fastest setting that is accurate enough, or the most accurate one within a budget, from measured rows.

use crate::deform::MODELS;
use crate::measure::units::{digits, seconds};
use crate::measure::{Measurement, Setting};
use crate::scene::{Accuracy, AccuracyTarget, Budget, Storage};

/// A chosen row, and the next better one.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice<'a> {
    /// The chosen row; where `miss` is above 1, only the one that comes nearest to the demand.
    pub row: &'a Measurement,
    /// The largest ratio of measured to asked: at most 1 where the row reaches what is asked.
    pub miss: f64,
    /// The fastest of those with a worst error of displacement below 0.9 of the chosen one's.
    pub next: Option<&'a Measurement>,
}

/// Times of evaluations within this ratio count as equal.
const SAME_TIME: f64 = 1.1;
/// A setting with at most this part of another's error is more accurate.
const BETTER: f64 = 0.9;
/// Errors, and ratios of measured to asked, within this ratio count as equal.
const SAME_ERROR: f64 = 1.02;

/// The order among settings that count as equal: Cholesky before conjugate gradients, f32 before coarser storage, the
/// simpler model, less memory offline, less error, and at last the order of the settings themselves.
fn preference(a: &Measurement, b: &Measurement) -> std::cmp::Ordering {
    let words = |row: &Measurement| {
        let setting = &row.setting;
        let model = MODELS.iter().position(|model| model == setting.model).unwrap_or(MODELS.len());
        (!setting.solver.method.is_direct, setting.storage != Storage::F32.name(), model)
    };
    let numbers = |row: &Measurement| [row.cost.offline_bytes, row.shape()];
    words(a)
        .cmp(&words(b))
        .then_with(|| numbers(a)[0].total_cmp(&numbers(b)[0]))
        .then_with(|| numbers(a)[1].total_cmp(&numbers(b)[1]))
        .then_with(|| a.setting.cmp(&b.setting))
}

/// The preferred one among the rows whose value is within a ratio of `same` of the least.
fn least<'a>(
    rows: &[&'a Measurement],
    value: impl Fn(&Measurement) -> f64,
    same: f64,
) -> Option<&'a Measurement> {
    let least = rows.iter().map(|row| value(row)).fold(f64::INFINITY, f64::min);
    rows.iter().copied().filter(|row| value(row) <= same * least).min_by(|a, b| preference(a, b))
}

/// Time of one evaluation, s: the same for all settings that differ in the solver alone.
pub fn time(row: &Measurement) -> f64 {
    row.cost.frame_p50_s
}

/// The setting itself, or one that is better in everything that is printed: more accurate by a tenth, and no dearer.
fn undominated<'a>(first: &'a Measurement, met: &[&'a Measurement]) -> &'a Measurement {
    let mut row = first;
    loop {
        let is_better = |other: &&&Measurement| {
            let costs = |row: &Measurement| [time(row), row.cost.offline_s, row.cost.file_bytes];
            let no_dearer = costs(other).iter().zip(costs(row)).all(|(other, own)| *other <= own);
            no_dearer && other.held() <= row.held() && other.shape() < BETTER * row.shape()
        };
        let better: Vec<&Measurement> = met.iter().filter(is_better).copied().collect();
        // Each is better than the one before by a tenth, so this ends.
        match least(&better, time, SAME_TIME) {
            Some(other) => row = other,
            None => return row,
        }
    }
}

/// Everything that is asked: the key, the measured value and the limit, both in the key's unit.
fn asked(row: &Measurement, demand: &AccuracyTarget) -> Vec<(&'static str, f64, f64)> {
    let all = match demand {
        AccuracyTarget::Accuracy(Accuracy { displacement, force, .. }) => {
            vec![("displacement", row.shape(), *displacement), ("force", row.held(), *force)]
        }
        AccuracyTarget::Budget(Budget { frame_ms, file_mb, offline_s, .. }) => vec![
            ("frame_ms", 1e3 * time(row), *frame_ms),
            ("file_mb", 1e-6 * row.cost.file_bytes, *file_mb),
            ("offline_s", row.cost.offline_s, *offline_s),
        ],
    };
    all.into_iter().filter_map(|(key, measured, asked)| Some((key, measured, asked?))).collect()
}

/// The largest ratio of measured to asked: at most 1 where the row reaches what is asked.
pub fn miss(row: &Measurement, demand: &AccuracyTarget) -> f64 {
    asked(row, demand).into_iter().map(|(_, measured, asked)| measured / asked).fold(0.0, f64::max)
}

/// Chooses among the rows that can be chosen ([`Measurement::can_be_chosen`]): the fastest that is as accurate as asked,
/// or the most accurate within the budget. Where no row reaches what is asked, the one that comes nearest, which must
/// not be taken unasked. `None` where there are no rows. The same rows give the same choice.
pub fn choose<'a>(rows: &'a [Measurement], demand: &AccuracyTarget) -> Option<Choice<'a>> {
    choose_among(rows, demand, |_| true)
}

/// [`choose`] among the rows that `is_known` lets through.
pub fn choose_among<'a>(
    rows: &'a [Measurement],
    demand: &AccuracyTarget,
    is_known: impl Fn(&Measurement) -> bool,
) -> Option<Choice<'a>> {
    let can_be_chosen = |row: &&Measurement| row.can_be_chosen() && is_known(row);
    let candidates: Vec<&Measurement> = rows.iter().filter(can_be_chosen).collect();
    let met: Vec<&Measurement> = candidates.iter().copied().filter(|row| miss(row, demand) <= 1.0).collect();
    let fastest = |of: &[&'a Measurement]| least(of, time, SAME_TIME);
    let best = match demand {
        AccuracyTarget::Accuracy(_) => fastest(&met).map(|first| undominated(first, &met)),
        AccuracyTarget::Budget(_) => least(&met, Measurement::shape, SAME_ERROR),
    };
    let row = best.or_else(|| least(&candidates, |row| miss(row, demand), SAME_ERROR))?;
    let better: Vec<&Measurement> =
        candidates.into_iter().filter(|other| other.shape() < BETTER * row.shape()).collect();
    Some(Choice { row, miss: miss(row, demand), next: fastest(&better) })
}

/// The lines with which measured rows answer a question.
pub fn answer(rows: &[Measurement], demand: &AccuracyTarget) -> Vec<String> {
    let Some(choice) = choose(rows, demand) else {
        return vec!["nothing that was measured can be chosen".into()];
    };
    if let Some(missed) = choice.missed(demand) {
        return vec![missed];
    }
    let mut lines = choice.sentences();
    lines.push(format!("as keys of the body: {}", keys(&choice.row.setting)));
    lines
}

/// A setting as a sentence names it.
pub fn name(setting: &Setting) -> String {
    let refined = match setting.refine {
        0 => String::new(),
        times => format!(", refined {times}×"),
    };
    format!("{}{refined}, {}, {}, {}", setting.element, setting.solver, setting.storage, setting.model.name)
}

impl Choice<'_> {
    /// Sentences about the choice, its errors and costs, and what the next better would cost.
    pub fn sentences(&self) -> Vec<String> {
        let row = self.row;
        let next = match self.next {
            Some(next) => {
                format!("the next better: {}: {}; {}", name(&next.setting), errors(next), price(next))
            }
            None => "nothing that was measured is better".into(),
        };
        vec![format!("chosen: {}: {} at worst; {}", name(&row.setting), errors(row), price(row)), next]
    }

    /// Says that no setting reaches what is asked, which one comes nearest, by how much it misses, and how to take it all
    /// the same; `None` where a setting was chosen.
    pub fn missed(&self, demand: &AccuracyTarget) -> Option<String> {
        if self.miss <= 1.0 {
            return None;
        }
        let key = demand.key();
        let what = match demand {
            AccuracyTarget::Accuracy(_) => "no setting that was measured is as accurate as asked",
            AccuracyTarget::Budget(_) => "no setting that was measured fits the budget",
        };
        let missed: Vec<String> = asked(self.row, demand)
            .into_iter()
            .filter(|(_, measured, asked)| measured > asked)
            .map(|(key, measured, asked)| {
                format!(
                    "{key} = {} where {asked} is asked, {:.2} times as much",
                    digits(measured, 3),
                    measured / asked
                )
            })
            .collect();
        Some(format!(
            "{what}. The nearest is {}: {}. It has {} at worst, and costs {}. Raise {key}, or name the \
             setting: {}",
            name(&self.row.setting),
            missed.join("; "),
            errors(self.row),
            price(self.row),
            keys(&self.row.setting)
        ))
    }
}

fn errors(row: &Measurement) -> String {
    format!(
        "displacement to {:.2} %, force and torque to {:.2} % of the largest wrench",
        100.0 * row.shape(),
        100.0 * row.held()
    )
}

fn price(row: &Measurement) -> String {
    let (time, megabytes) = (seconds(row.cost.frame_p50_s), 1e-6 * row.cost.file_bytes);
    format!("{time} an evaluation, {megabytes:.2} MB, {:.2} s offline", row.cost.offline_s)
}

/// A setting as a scene's body names it.
fn keys(setting: &Setting) -> String {
    let Setting { refine, element, solver, storage, model } = setting;
    let tolerance =
        solver.tolerance().map_or(String::new(), |tolerance| format!(", tolerance = {tolerance:e}"));
    let solver = format!("{{ method = \"{}\"{tolerance} }}", solver.method.name);
    format!(
        "refine = {refine}, element = \"{element}\", solver = {solver}, storage = \"{storage}\", model = \"{model}\""
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::{Cost, Errors, Spread};

    /// A row of tet4 with the model `linear`: solver, storage, µs of an evaluation, worst error.
    fn row(solver: &str, storage: &str, time_us: f64, error: f64) -> Measurement {
        let spread = Spread { median: error, worst: error };
        Measurement {
            setting: Setting {
                element: "tet4".into(),
                solver: solver.parse().unwrap(),
                storage: storage.into(),
                model: &crate::deform::LINEAR,
                ..Setting::default()
            },
            forward_error: Some(1e-12),
            cost: Cost { frame_p50_s: 1e-6 * time_us, file_bytes: 1e6, ..Cost::default() },
            error: Errors {
                discretisation: Some(spread),
                storage: Some(Spread::default()),
                total: spread,
                uncancelled: spread,
                uncancelled_held: spread,
                ..Errors::default()
            },
            ..Measurement::default()
        }
    }

    fn accuracy(displacement: f64) -> AccuracyTarget {
        AccuracyTarget::Accuracy(Accuracy { displacement: Some(displacement), force: None, largest: None })
    }

    fn chosen<'a>(rows: &'a [Measurement], demand: &AccuracyTarget) -> Choice<'a> {
        choose(rows, demand).unwrap()
    }

    #[test]
    fn of_equal_bytes_and_errors_the_faster_is_taken() {
        let mut rows = [
            row("cholesky", "f16", 136.0, 0.02),
            row("cholesky", "int16", 26.0, 0.02),
            row("cholesky", "f32", 60.0, 0.02),
        ];
        assert_eq!(chosen(&rows, &accuracy(0.05)).row.setting.storage, "int16");
        rows.reverse();
        assert_eq!(chosen(&rows, &accuracy(0.05)).row.setting.storage, "int16");
    }

    #[test]
    fn ties_go_to_cholesky_and_f32() {
        let rows = [
            row("pcg 1e-8", "f32", 27.0, 0.0199),
            row("cholesky", "int16", 25.0, 0.02),
            row("cholesky", "f32", 27.0, 0.02),
        ];
        for demand in [
            accuracy(0.05),
            AccuracyTarget::Budget(Budget {
                frame_ms: None,
                file_mb: Some(2.0),
                offline_s: None,
                largest: None,
            }),
        ] {
            let setting = &chosen(&rows, &demand).row.setting;
            assert_eq!((&*setting.solver.to_string(), &*setting.storage), ("cholesky", "f32"), "{demand:?}");
        }
    }

    /// On the demo's tube a tolerance of 1e-2 was taken, with a forward error of 4.0, where nothing met the demand.
    #[test]
    fn a_solver_that_is_not_trusted_is_never_taken_nor_named() {
        let loose = row("pcg 1e-2", "f32", 1.0, 1e-6);
        let uncertain = Measurement { forward_error: Some(4.0), ..row("pcg 1e-4", "f32", 1.0, 1e-6) };
        let rows = [loose.clone(), uncertain.clone(), row("cholesky", "f32", 60.0, 0.7)];
        let choice = chosen(&rows, &accuracy(0.05));
        assert_eq!((&*choice.row.setting.solver.to_string(), choice.next), ("cholesky", None));
        let said = choice.missed(&accuracy(0.05)).unwrap();
        assert!(said.contains("displacement = 0.7 where 0.05 is asked, 14.00 times as much"), "{said}");
        assert!(
            said.contains("element = \"tet4\", solver = { method = \"cholesky\" }, storage = \"f32\""),
            "{said}"
        );
        assert_eq!(choose(&[loose, uncertain], &accuracy(0.05)), None);
        assert!(chosen(&rows, &accuracy(0.8)).missed(&accuracy(0.8)).is_none());
    }

    /// A bar's report took tet4 for 191 µs and 1.83 %, and named tet4_anp for 149 µs and 1.19 % as the next better.
    #[test]
    fn what_is_better_in_everything_is_taken() {
        let anp = |time_us, error| {
            let mut row = row("cholesky", "f32", time_us, error);
            "tet4_anp".clone_into(&mut row.setting.element);
            row.cost.offline_bytes = 1e9;
            row
        };
        let rows = [row("cholesky", "f32", 155.0, 0.0183), anp(149.0, 0.0119)];
        let choice = chosen(&rows, &accuracy(0.05));
        assert_eq!((&*choice.row.setting.element, choice.next), ("tet4_anp", None));
        // Where the better one takes longer, the simpler one stays.
        let rows = [row("cholesky", "f32", 155.0, 0.0183), anp(160.0, 0.0119)];
        assert_eq!(chosen(&rows, &accuracy(0.05)).row.setting.element, "tet4");
    }

    #[test]
    fn a_budget_is_compared_with_the_time_that_is_printed() {
        let mut slow = row("cholesky", "f32", 30.6, 0.01);
        slow.cost.frame_p99_s = 5e-4;
        let demand: AccuracyTarget = "frame_ms = 0.031".parse().unwrap();
        assert!(answer(std::slice::from_ref(&slow), &demand)[0].starts_with("chosen: tet4"));
        let demand: AccuracyTarget = "frame_ms = 0.03".parse().unwrap();
        let said = answer(&[slow], &demand).concat();
        assert!(
            said.contains("frame_ms = 0.0306 where 0.03 is asked, 1.02 times")
                && said.contains("30.6 µs an ev"),
            "{said}"
        );
    }

    /// The rounding error of a rod was shown as zero: int16 was taken for its smaller file.
    #[test]
    fn a_storage_whose_error_is_not_known_is_not_taken() {
        let mut rows = [row("cholesky", "int16", 20.0, 0.02), row("cholesky", "f32", 60.0, 0.02)];
        rows.iter_mut().for_each(|row| row.error.storage = None);
        assert_eq!(chosen(&rows, &accuracy(0.05)).row.setting.storage, "f32");
    }

    #[test]
    fn errors_that_cancel_do_not_meet_a_demand() {
        let mut lucky = row("cholesky", "int16", 1.0, 0.2);
        lucky.error.total = Spread { median: 0.001, worst: 0.001 };
        let rows = [lucky, row("cholesky", "f32", 60.0, 0.04)];
        assert_eq!(chosen(&rows, &accuracy(0.05)).row.setting.storage, "f32");
    }

    #[test]
    fn a_table_that_was_kept_gives_the_same_choice() {
        let rows: Vec<Measurement> = (0..40)
            .map(|i| {
                let storage = Storage::ALL[i % 3].name();
                let (time_us, error) = (20.0 + ((7 * i) % 11) as f64, 0.01 * (1 + i % 5) as f64);
                let mut row = row(["cholesky", "pcg 1e-6"][i % 2], &storage, time_us, error);
                row.setting.refine = i as u32 / 2;
                row
            })
            .collect();
        let kept: Vec<Measurement> = serde_json::from_str(&serde_json::to_string(&rows).unwrap()).unwrap();
        assert_eq!(kept, rows);
        let backwards: Vec<Measurement> = rows.iter().rev().cloned().collect();
        for demand in [0.005, 0.015, 0.03, 0.1].map(accuracy) {
            let of = |rows: &[Measurement]| chosen(rows, &demand).row.clone();
            assert_eq!(of(&rows), of(&kept));
            assert_eq!(of(&rows), of(&backwards));
        }
    }

    /// Better in shape and no dearer, but worse in force: it does not take the place of the first choice.
    #[test]
    fn what_has_worse_forces_does_not_replace_the_choice() {
        let mut other = row("cholesky", "f32", 149.0, 0.0119);
        "tet4_anp".clone_into(&mut other.setting.element);
        other.cost.offline_bytes = 1e9;
        other.error.uncancelled_held = Spread { median: 0.5, worst: 0.5 };
        let rows = [row("cholesky", "f32", 155.0, 0.0183), other];
        assert_eq!(chosen(&rows, &accuracy(0.05)).row.setting.element, "tet4");
    }
}
