//! The report's folder: accuracy.json, accuracy.csv, index.html and plots/*.svg. Out of accuracy.json: the report.

use super::{Report, SCHEMA, csv, page, panels};
use crate::mesh::write_atomically;
use serde::Deserialize;
use std::io::Write;
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
    #[error("{} is not a report of this program: {source}", .path.display())]
    Json { path: PathBuf, source: serde_json::Error },
    #[error(
        "{} is written in schema {found}; this program reads schema {SCHEMA}: run `accuracy` again",
        .path.display()
    )]
    Schema { path: PathBuf, found: u32 },
}

/// Writes accuracy.json, accuracy.csv, index.html and plots/*.svg below `dir`, which is made where it does not exist.
/// Each file is written beside its place and renamed: it is there whole or not at all. A plot that this report has no
/// data for is removed. Returns the paths, index.html first.
///
/// Errors: no rows; a number that is none, infinite or negative; a file that cannot be written. The numbers are looked
/// at before anything is written.
pub fn write(dir: &Path, report: &Report) -> Result<Vec<PathBuf>, ReportError> {
    check(report)?;
    let json_path = dir.join("accuracy.json");
    let json = serde_json::to_string_pretty(report)
        .map_err(|source| ReportError::Json { path: json_path.clone(), source })?;
    let pictures = panels(report);
    let plots = dir.join("plots");
    std::fs::create_dir_all(&plots).map_err(|source| ReportError::Io { path: plots.clone(), source })?;
    let mut files = vec![
        (dir.join("index.html"), page(report, &pictures)),
        (json_path, json + "\n"),
        (dir.join("accuracy.csv"), csv::csv(&report.rows)),
    ];
    for picture in &pictures {
        files.push((plots.join(format!("{}.svg", picture.name)), picture.file()));
    }
    for (path, text) in &files {
        write_atomically(path, |file| file.write_all(text.as_bytes()))
            .map_err(|source| ReportError::Io { path: path.clone(), source })?;
    }
    let written: Vec<PathBuf> = files.into_iter().map(|(path, _)| path).collect();
    for name in super::panels::NAMES {
        let path = plots.join(format!("{name}.svg"));
        if !written.contains(&path) && path.exists() {
            std::fs::remove_file(&path).map_err(|source| ReportError::Io { path, source })?;
        }
    }
    Ok(written)
}

/// Reads an accuracy.json that [`write()`] wrote, and looks at its numbers.
pub fn read(path: &Path) -> Result<Report, ReportError> {
    #[derive(Deserialize)]
    struct Version {
        schema: u32,
    }
    let json = |source| ReportError::Json { path: path.to_owned(), source };
    let text =
        std::fs::read_to_string(path).map_err(|source| ReportError::Io { path: path.to_owned(), source })?;
    let Version { schema } = serde_json::from_str(&text).map_err(json)?;
    if schema != SCHEMA {
        return Err(ReportError::Schema { path: path.to_owned(), found: schema });
    }
    let report = serde_json::from_str(&text).map_err(json)?;
    check(&report)?;
    Ok(report)
}

/// Every number is one, and not negative (fitted slopes may be).
fn check(report: &Report) -> Result<(), ReportError> {
    if report.rows.is_empty() {
        return Err(ReportError::Empty);
    }
    let number = |place: &str, name: &str, value: f64| {
        if value.is_finite() && value >= 0.0 {
            return Ok(());
        }
        Err(ReportError::Number { place: place.to_owned(), name: name.to_owned(), value })
    };
    number("report", "size", report.size)?;
    for (i, row) in report.rows.iter().enumerate() {
        let place = format!("row {} ({})", i + 1, row.setting);
        for (name, value) in csv::numbers(row) {
            number(&place, &name, value.unwrap_or(0.0))?;
        }
    }
    for of in &report.models {
        let place = format!("model {}, pose {}", of.model, of.pose);
        for (name, value) in
            [("rotation", of.rotation), ("error", of.error), ("displacement_m", of.displacement_m)]
        {
            number(&place, name, value)?;
        }
    }
    for of in &report.smooth {
        let place = format!("smooth problem, {}, refined {} times", of.element, of.refine);
        let slopes = [of.l2_rate, of.energy_rate].map(|rate| rate.map_or(0.0, f64::abs));
        for (name, value) in [
            ("h", of.h),
            ("l2", of.l2),
            ("energy", of.energy),
            ("l2_rate", slopes[0]),
            ("energy_rate", slopes[1]),
            ("promised", of.promised[0]),
            ("promised", of.promised[1]),
        ] {
            number(&place, name, value)?;
        }
    }
    for of in &report.effects {
        let place = format!("effect {}", of.effect);
        for (name, value) in [
            ("offline_s", of.offline_s),
            ("file_bytes", of.file_bytes),
            ("memory_bytes", of.memory_bytes),
            ("frame_s", of.frame_s),
        ] {
            number(&place, name, value)?;
        }
    }
    Ok(())
}
