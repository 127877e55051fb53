//! Helpers of several plots and their captions: names of settings, tips, lists of words.

use crate::measure::units::{bytes, relative, seconds};
use crate::measure::{Measurement, PARAMETERS, Report, Setting};
use crate::report::canvas::Picture;
use crate::report::pareto::OFFLINE;

/// Values in the order of their first appearance.
pub fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

/// "a, b and c".
pub fn listed(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// The values in which settings differ, as their names, and those that they share, as a note.
pub fn names_and_note(settings: &[&Setting]) -> (Vec<String>, String) {
    let all: Vec<_> = settings.iter().map(|setting| setting.values()).collect();
    let Some(first) = all.first() else { return (Vec::new(), String::new()) };
    let (mut varying, shared): (Vec<usize>, Vec<usize>) =
        (0..first.len()).partition(|&k| all.iter().any(|values| values[k] != first[k]));
    let words = |values: &[String], which: &[usize]| -> String {
        which.iter().map(|&k| values[k].as_str()).collect::<Vec<_>>().join(" · ")
    };
    let mut note = String::new();
    if varying.is_empty() {
        varying = shared;
    } else if !shared.is_empty() {
        note = format!("In every labelled setting: {}.", words(first, &shared));
    }
    (all.iter().map(|values| words(values, &varying)).collect(), note)
}

pub fn tip(row: &Measurement) -> String {
    format!(
        "{}: {} an evaluation, {} offline, {}; total error {} (worst pose {}), most of it {}",
        row.setting,
        seconds(row.cost.frame_p50_s),
        seconds(row.cost.offline_s),
        bytes(row.cost.file_bytes),
        relative(row.error.uncancelled.median),
        relative(row.error.uncancelled.worst),
        row.error.largest_part()
    )
}

/// Words for the number of rows in which each part of the error is the largest.
pub fn largest_parts(rows: &[&Measurement], what: &str) -> String {
    let count = |part| rows.iter().filter(|row| row.error.dominating() == Some(part)).count();
    let counts: Vec<String> = (0..PARAMETERS.len())
        .filter(|&part| count(part) > 0)
        .map(|part| format!("{} in {}", PARAMETERS[part].part, count(part)))
        .collect();
    if counts.is_empty() {
        return String::new();
    }
    format!("The largest part of the error is {} of {} {what}.", listed(&counts), rows.len())
}

/// The fastest row for every element and refinement whose solver adds no more than a hundredth of the discretisation error; where
/// no solver does, the row with the least solver error. By element, then refinement.
pub fn fastest_on_each_mesh(rows: &[Measurement]) -> Vec<&Measurement> {
    let meshes = distinct(rows.iter().map(|row| (&row.setting.element, row.setting.refine)));
    let fastest = |(element, refine)| {
        let here = || {
            let is_here =
                move |row: &&Measurement| (&row.setting.element, row.setting.refine) == (element, refine);
            rows.iter().filter(is_here).filter(|row| row.is_trusted())
        };
        let exact = |row: &&Measurement| {
            row.error.discretisation.is_some_and(|mesh| row.error.solver.median <= 0.01 * mesh.median)
        };
        let offline = |row: &Measurement| (OFFLINE.of)(&row.cost);
        here()
            .filter(exact)
            .min_by(|a, b| offline(a).total_cmp(&offline(b)))
            .or_else(|| here().min_by(|a, b| a.error.solver.median.total_cmp(&b.error.solver.median)))
    };
    let mut chosen: Vec<&Measurement> = meshes.into_iter().filter_map(fastest).collect();
    chosen.sort_by_key(|row| row.setting.refine);
    chosen
}

pub struct PlotEntry {
    /// The stem of the plot's file.
    pub name: &'static str,
    /// The heading above it on the page; empty where it continues the plot before it.
    pub heading: &'static str,
    /// Advice for reading it.
    pub reading: &'static str,
    /// Sentences about this body, made from the data; empty where there is nothing to report.
    pub caption: fn(&Report) -> String,
    /// Draws it; the error says why the plot would be empty, and is empty where the report has no data for it.
    pub picture: fn(&Report) -> Result<Picture, String>,
    pub table: Option<TableBelow>,
}

/// A paragraph and a table below a plot.
pub type TableBelow = (&'static str, fn(&Report) -> String);
