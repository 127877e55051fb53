//! A report as one Markdown table for a README: each parameter changed alone, the others as in the first row.

use super::data::{Report, Spread};
use super::parameters::PARAMETERS;
use super::units::{bytes, relative, seconds};
use crate::base::table::Table;

/// A table with a line, for each parameter, for every setting that differs from the first row's in that parameter only.
pub fn readme_table(report: &Report) -> String {
    let heading =
        ["parameter", "setting", "offline", "file", "one evaluation", "its part of the error", "worst pose"];
    let mut table = Table::new(&heading);
    let Some(first) = report.rows.first() else { return String::new() };
    let first = first.setting.values();
    for (changed, parameter) in PARAMETERS.iter().enumerate() {
        for row in &report.rows {
            let values = row.setting.values();
            if (0..values.len()).any(|other| other != changed && values[other] != first[other]) {
                continue;
            }
            let part = (parameter.error)(&row.error);
            let is_reference = changed == 0 && row.is_reference();
            let error = |of: fn(Spread) -> f64| match part {
                _ if is_reference => "reference".to_owned(),
                None => "–".to_owned(),
                Some(part) => relative(of(part)),
            };
            table.row(&[
                parameter.name,
                &values[changed],
                &seconds(row.cost.offline_s),
                &bytes(row.cost.file_bytes),
                &seconds(row.cost.frame_p50_s),
                &error(|part| part.median),
                &error(|part| part.worst),
            ]);
        }
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
