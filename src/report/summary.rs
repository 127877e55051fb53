//! What the command says at its end, for a terminal.

use super::answer::{ONLINE, answers, ladder, limit};
use super::units::{bytes, relative, seconds};
use super::{Report, Row};
use crate::base::table::Table;
use crate::base::text::plain;

/// The settings that are worth their online time, from cheap to accurate, and the answers in sentences.
pub fn summary(report: &Report) -> String {
    let mut table = Table::new(&[
        "mesh and element",
        "solver",
        "storage",
        "model",
        "online",
        "offline",
        "file",
        "total error",
        "worst pose",
        "most of it",
    ]);
    for i in ladder(&report.rows, &ONLINE) {
        let Row { setting, cost, error, .. } = &report.rows[i];
        let knobs = setting.knobs().map(plain);
        let [mesh, solver, storage, model] = knobs.each_ref().map(String::as_str);
        table.row(&[
            mesh,
            solver,
            storage,
            model,
            &seconds(cost.frame_p50_s),
            &seconds(cost.offline_s),
            &bytes(cost.file_bytes),
            &relative(error.uncancelled.median),
            &relative(error.uncancelled.worst),
            limit(&report.rows[i]),
        ]);
    }
    let answers = answers(report).join("\n");
    format!(
        "{} of {} settings, from fast to accurate, each the cheapest online for its error (relative L2, median of {} poses):\n\n{}\n{}\n",
        table.rows.len() - 1,
        report.rows.len(),
        report.poses.len(),
        table.text(),
        plain(answers),
    )
}
