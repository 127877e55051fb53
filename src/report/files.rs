//! The report's folder: writes accuracy.json, accuracy.csv (a line a setting), models.csv (a line a model and motion), index.html
//! and plots/*.svg, and reads accuracy.json. The names of the columns in CSV hold their units (RFC 4180).

use super::page::page;
use super::pareto::COLUMNS;
use super::plots::{PLOTS, pictures};
use crate::base::failure::Failure;
use crate::base::input;
use crate::base::output::{self, Kind, OutputError};
use crate::base::table::quoted;
use crate::measure::{Measurement, ModelTrial, Report, SCHEMA, Spread};
use serde::Deserialize;
use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error("the report has no rows: nothing was measured")]
    Empty,
    #[error(
        "{place}: {name} is {value}; a finite number of at least 0 was expected: \
         what was measured there went wrong"
    )]
    Number { place: String, name: String, value: f64 },
    #[error("{}: {source}", .path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{} is not a report of this program: {source}", .path.display())]
    Json { path: PathBuf, source: serde_json::Error },
    #[error(
        "{} is written in schema {found}; this program reads schema {SCHEMA}: run `accuracy` again",
        .path.display()
    )]
    Schema { path: PathBuf, found: u32 },
}

const JSON: Kind =
    Kind { name: "a report of `accuracy`", recognizes: |head| head.starts_with(b"{\n  \"schema\": ") };
const CSV: Kind = Kind {
    name: "a table of `accuracy`",
    recognizes: |head| head.starts_with(b"refine,element,solver,storage,model,"),
};
const MODELS: Kind = Kind {
    name: "a table of models of `accuracy`",
    recognizes: |head| head.starts_with(b"model,motion,degrees,"),
};
const PAGE: Kind = Kind {
    name: "a page of `accuracy`",
    recognizes: |head| contains(head, b"<title>What accuracy costs in time: "),
};
const PLOT: Kind =
    Kind { name: "a plot of `accuracy`", recognizes: |head| contains(head, b" class=\"gs-plot\" ") };

fn contains(head: &[u8], mark: &[u8]) -> bool {
    head.windows(mark.len()).any(|window| window == mark)
}

/// The names of a report's files below its folder.
const NAMES: [(&str, &Kind); 4] =
    [("index.html", &PAGE), ("accuracy.json", &JSON), ("accuracy.csv", &CSV), ("models.csv", &MODELS)];

fn plot_path(dir: &Path, name: &str) -> PathBuf {
    dir.join("plots").join(format!("{name}.svg"))
}

/// Makes the folders of a report and checks that its files may be written there ([`output::try_path`]).
pub fn try_folder(dir: &Path, inputs: &[PathBuf]) -> Result<(), OutputError> {
    output::make_folder(&dir.join("plots"))?;
    let plots = PLOTS.into_iter().map(|entry| (plot_path(dir, entry.name), &PLOT));
    let files = NAMES.into_iter().map(|(name, kind)| (dir.join(name), kind));
    files.chain(plots).try_for_each(|(path, kind)| output::try_path(&path, kind, inputs))
}

/// Writes accuracy.json, accuracy.csv, models.csv, index.html and plots/*.svg below `dir`, which is made where it does not exist.
/// Either all files are written whole, or none is ([`output::put_all`]). An older plot that this report has no data for is
/// removed. Returns the paths, index.html first.
///
/// Errors: no rows; a number that is NaN, infinite or negative; a file that cannot be written, or that would replace one
/// that belongs to no report. The numbers are checked before anything is written.
pub fn write(dir: &Path, report: &Report) -> Result<Vec<PathBuf>, ReportError> {
    check(report)?;
    let json = serde_json::to_string_pretty(report)
        .map_err(|source| ReportError::Json { path: dir.join("accuracy.json"), source })?;
    let pictures = pictures(report);
    output::make_folder(&dir.join("plots"))?;
    let texts =
        [page(report, &pictures), json + "\n", settings_csv(&report.rows), trials_csv(&report.trials.rows)];
    let named = NAMES.into_iter().map(|(name, kind)| (dir.join(name), kind));
    let plots = pictures.iter().map(|(entry, picture)| ((plot_path(dir, entry.name), &PLOT), picture.file()));
    let (mut staged, mut written) = (Vec::new(), Vec::new());
    for ((path, kind), text) in named.zip(texts).chain(plots) {
        staged.push(output::stage(&path, kind, |file| file.write_all(text.as_bytes()))?);
        written.push(path);
    }
    let plots = PLOTS.into_iter().map(|entry| plot_path(dir, entry.name));
    let old: Vec<PathBuf> = plots.filter(|path| !written.contains(path) && output::is(path, &PLOT)).collect();
    output::put_all(staged, &old)?;
    Ok(written)
}

/// Reads an accuracy.json that [`write()`] wrote, and checks its numbers.
pub fn read(path: &Path) -> Result<Report, ReportError> {
    #[derive(Deserialize)]
    struct Version {
        schema: u32,
    }
    let json = |source| ReportError::Json { path: path.to_owned(), source };
    let text = input::open(path)
        .and_then(std::io::read_to_string)
        .map_err(|source| ReportError::Io { path: path.to_owned(), source })?;
    let Version { schema } = serde_json::from_str(&text).map_err(json)?;
    if schema != SCHEMA {
        return Err(ReportError::Schema { path: path.to_owned(), found: schema });
    }
    let report = serde_json::from_str(&text).map_err(json)?;
    check(&report)?;
    Ok(report)
}

/// Errors unless every number is finite and not negative; fitted slopes may be negative.
fn check(report: &Report) -> Result<(), ReportError> {
    if report.rows.is_empty() {
        return Err(ReportError::Empty);
    }
    let numbers = |place: &str, named: &[(&str, f64)]| match named
        .iter()
        .find(|(_, value)| !value.is_finite() || *value < 0.0)
    {
        Some((name, value)) => {
            Err(ReportError::Number { place: place.to_owned(), name: (*name).to_owned(), value: *value })
        }
        None => Ok(()),
    };
    numbers("report", &[("size", report.size)])?;
    for (i, row) in report.rows.iter().enumerate() {
        let place = format!("row {} ({})", i + 1, row.setting);
        for (name, value) in numbers_of(row) {
            numbers(&place, &[(&name, value.unwrap_or(0.0))])?;
        }
    }
    for of in &report.models {
        let place = format!("model {}, pose {}", of.model, of.pose);
        let (rotation, error) = (("rotation", of.rotation), ("error", of.error));
        numbers(&place, &[rotation, error, ("displacement_m", of.displacement_m)])?;
    }
    for of in &report.trials.rows {
        let place = format!("model {}, {} by {}°", of.model, of.motion.name(), of.degrees);
        for (name, value) in trial_numbers(of) {
            // An energy may be negative.
            let value = value.map_or(0.0, |value| if name == "energy_ratio" { value.abs() } else { value });
            numbers(&place, &[(name, value)])?;
        }
    }
    for of in &report.smooth {
        let place = format!("smooth problem, {}, refined {} times", of.element, of.refine);
        let slopes = [of.l2_rate, of.energy_rate].map(|rate| rate.map_or(0.0, f64::abs));
        numbers(&place, &[("h", of.h), ("l2", of.l2), ("energy", of.energy)])?;
        numbers(&place, &[("l2_rate", slopes[0]), ("energy_rate", slopes[1])])?;
        numbers(&place, &of.promised.map(|rate| ("promised", rate)))?;
    }
    for of in &report.effects {
        let place = format!("effect {}", of.effect);
        numbers(&place, &[("offline_s", of.offline_s), ("file_bytes", of.file_bytes)])?;
        numbers(&place, &[("memory_bytes", of.memory_bytes), ("frame_s", of.frame_s)])?;
    }
    Ok(())
}

impl From<ReportError> for Failure {
    fn from(error: ReportError) -> Failure {
        match error {
            ReportError::Output(error) => error.into(),
            error => Failure::work(error),
        }
    }
}

/// Every number of a row by its name, in the order of the columns; `None` where it was not measured.
fn numbers_of(row: &Measurement) -> Vec<(String, Option<f64>)> {
    let error = &row.error;
    let errors: [(&str, &str, Option<Spread>); 13] = [
        ("discretisation", "relative", error.discretisation),
        ("energy", "relative", error.energy),
        ("solver", "relative", Some(error.solver)),
        ("storage", "relative", error.storage),
        ("model", "relative", Some(error.model)),
        ("total", "relative", Some(error.total)),
        ("uncancelled", "relative", Some(error.uncancelled)),
        ("displacement", "m", Some(error.displacement_m)),
        ("force", "relative", Some(error.force)),
        ("torque", "relative", Some(error.torque)),
        ("mesh_held", "relative", error.mesh_held),
        ("model_held", "relative", Some(error.model_held)),
        ("uncancelled_held", "relative", Some(error.uncancelled_held)),
    ];
    let plain = COLUMNS.iter().map(|column| (column.name.to_owned(), (column.of)(row)));
    let forward_error = ("forward_error_relative".to_owned(), row.forward_error);
    let spreads = errors.into_iter().flat_map(|(name, unit, spread)| {
        [("median", spread.map(|s| s.median)), ("worst", spread.map(|s| s.worst))]
            .map(|(which, value)| (format!("{name}_{which}_{unit}"), value))
    });
    plain.chain([forward_error]).chain(spreads).collect()
}

/// Every number of a trial by its name.
fn trial_numbers(row: &ModelTrial) -> [(&'static str, Option<f64>); 6] {
    [
        ("degrees", Some(row.degrees)),
        ("displacement_relative", Some(row.displacement)),
        ("force_relative", row.force),
        ("torque_relative", row.torque),
        ("energy_ratio", row.energy),
        ("frame_s", Some(row.frame_s)),
    ]
}

/// The trials of the models, as [`settings_csv`].
fn trials_csv(rows: &[ModelTrial]) -> String {
    let mut text =
        "model,motion,degrees,displacement_relative,force_relative,torque_relative,energy_ratio,frame_s\r\n"
            .to_owned();
    for row in rows {
        let numbers = trial_numbers(row).map(|(_, value)| value.map_or_else(String::new, |v| v.to_string()));
        text += &format!("{},{},{}\r\n", quoted(&row.model), row.motion.name(), numbers.join(","));
    }
    text
}

/// Lines end with CR LF. Numbers are the shortest that read back as the same f64; a cell without one was not measured.
fn settings_csv(rows: &[Measurement]) -> String {
    let mut text = String::new();
    for (i, row) in rows.iter().enumerate() {
        let setting = &row.setting;
        let (refine, solver) = (setting.refine.to_string(), setting.solver.to_string());
        let words = [
            ("refine", refine.as_str()),
            ("element", &setting.element),
            ("solver", &solver),
            ("storage", &setting.storage),
            ("model", setting.model.name),
        ];
        let words = words.into_iter().map(|(name, word)| (name.to_owned(), quoted(word)));
        let numbers = numbers_of(row).into_iter();
        let numbers = numbers.map(|(name, value)| (name, value.map_or_else(String::new, |v| v.to_string())));
        let (names, cells): (Vec<String>, Vec<String>) = words.chain(numbers).unzip();
        if i == 0 {
            text.push_str(&names.join(","));
            text.push_str("\r\n");
        }
        text.push_str(&cells.join(","));
        text.push_str("\r\n");
    }
    text
}
