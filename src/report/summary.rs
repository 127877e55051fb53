//! The end of the command's output in a terminal: a table of the efficient settings, and the recommendations.

use super::data::Report;
use super::recommendation::recommendations;
use super::tables::efficient_settings;
use crate::base::table::Table;
use crate::base::text::plain;

/// The settings that are worth their online time, from cheap to accurate, and the recommendations in sentences.
pub fn summary(report: &Report) -> String {
    let settings = efficient_settings(&report.rows);
    let heading: Vec<&str> = settings.first().into_iter().flatten().map(|(name, _)| *name).collect();
    let mut table = Table::new(&heading);
    for setting in &settings {
        let cells: Vec<String> = setting.iter().map(|(_, cell)| plain(&cell.text)).collect();
        table.row(&cells.iter().map(String::as_str).collect::<Vec<_>>());
    }
    format!(
        "{} of {} settings, from fast to accurate, each the cheapest online for its error (relative L2, median of {} poses):\n\n{}\n{}\n",
        settings.len(),
        report.rows.len(),
        report.poses.len(),
        table.text(),
        plain(recommendations(report).join("\n")),
    )
}
