//! A report in one Markdown table, for a README: each knob turned alone, the others as in the first row.

use super::table::Table;
use super::units::{bytes, relative, seconds};
use super::{Report, Row};

/// One line for each setting that differs from the first row's in one knob only.
pub fn digest(report: &Report) -> String {
    let mut table = Table::new(&[
        "knob",
        "setting",
        "offline",
        "file",
        "one evaluation",
        "its part of the error",
        "worst pose",
    ]);
    let Some(base) = report.rows.first() else { return String::new() };
    let mut add = |knob: &str, name: &str, row: &Row, part: super::Spread| {
        let cost = &row.cost;
        let is_reference = knob == "mesh and element" && row.is_reference();
        let error = |value: f64| if is_reference { "reference".to_owned() } else { relative(value) };
        table.row(&[
            knob,
            name,
            &seconds(cost.offline_s),
            &bytes(cost.file_bytes),
            &seconds(cost.frame_p50_s),
            &error(part.median),
            &error(part.worst),
        ]);
    };
    let turned = |row: &&Row, knob: usize| {
        let (own, first) = (row.setting.knobs(), base.setting.knobs());
        (0..own.len()).all(|other| other == knob || own[other] == first[other])
    };
    for row in report.rows.iter().filter(|row| turned(row, 0)) {
        add("mesh and element", &row.setting.mesh(), row, row.error.discretisation);
    }
    for row in report.rows.iter().filter(|row| turned(row, 1)) {
        add("solver", &row.setting.solver.to_string(), row, row.error.solver);
    }
    for row in report.rows.iter().filter(|row| turned(row, 2)) {
        add("storage", &row.setting.storage, row, row.error.storage);
    }
    for row in report.rows.iter().filter(|row| turned(row, 3)) {
        add("model", &row.setting.model, row, row.error.model);
    }
    let references: String = report.references.iter().map(|line| format!("- {line}\n")).collect();
    format!(
        "{}, {} poses from {}; errors are relative L2, median and worst over the poses:\n\n{}\nErrors are against:\n\n{references}",
        report.machine,
        report.poses.len(),
        report.pose_source,
        table.markdown()
    )
}
