//! The end of the command's output in a terminal: a table of the efficient settings, the recommendations, and a table of the
//! models by how far a control element turns.

use super::data::Report;
use super::recommendation::recommendations;
use super::tables::{NamedCells, efficient_settings, errors_of, trial_lines};
use crate::base::table::Table;
use crate::base::text::plain;

/// The angles in the table of models, degrees.
const TURNS: [f64; 4] = [10.0, 30.0, 90.0, 180.0];

/// The settings that are worth their online time, from cheap to accurate, and the recommendations in sentences.
pub fn summary(report: &Report) -> String {
    let settings = efficient_settings(&report.rows);
    let motions = trial_lines(report, &|degrees| TURNS.contains(&degrees), &errors_of);
    let models = if motions.is_empty() {
        String::new()
    } else {
        let lead = "Models alone, by what one control element does: error of displacement · larger error of force and \
                    torque";
        format!("\n{lead}:\n\n{}", text(&motions))
    };
    let busy = report.timing.warning().map_or_else(String::new, |warning| format!("{warning}\n\n"));
    format!(
        "{busy}{} of {} settings, from fast to accurate, each the cheapest online for its error (relative L2, median of {} poses):\n\n{}\n{}\n{models}",
        settings.len(),
        report.rows.len(),
        report.poses.len(),
        text(&settings),
        plain(recommendations(report).join("\n")),
    )
}

/// Lines as a table for a terminal.
fn text(lines: &[NamedCells<'_>]) -> String {
    let heading: Vec<&str> = lines.first().into_iter().flatten().map(|(name, _)| *name).collect();
    let mut table = Table::new(&heading);
    for line in lines {
        let cells: Vec<String> = line.iter().map(|(_, cell)| plain(&cell.text)).collect();
        table.row(&cells.iter().map(String::as_str).collect::<Vec<_>>());
    }
    table.text()
}
