//! `greenstage check STAGE`: all that can be found wrong with a stage, at once.

use super::failure::Failure;
use crate::green::{Finding, Severity};
use crate::render::window;
use crate::stage::{Level, Monitor, Stage, Survey, lint};
use std::path::Path;

/// Prints the findings about the stage of this name or file.
pub fn run(name: &Path, json: bool) -> Result<(), Failure> {
    let Survey { stage, faults } = Stage::survey(&name.display().to_string()).map_err(Failure::request)?;
    let mut findings: Vec<Finding> = faults
        .into_iter()
        .map(|fault| Finding::new(Severity::Error, &format!("line {}", fault.line), fault.fault.to_string()))
        .collect();
    if let Some(stage) = stage {
        let (monitors, whose) = monitors(&stage);
        if let Some(whose) = whose {
            findings.push(Finding::new(Severity::Note, "monitors", whose));
        }
        findings.extend(lint(&stage, &monitors).into_iter().map(|found| {
            let severity = match found.level {
                Level::Error => Severity::Error,
                Level::Warning => Severity::Warning,
                Level::Note => Severity::Note,
            };
            Finding::new(severity, &found.entity, found.message)
        }));
    }
    findings.sort_by_key(|finding| finding.severity);
    let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count();
    let errors = count(Severity::Error);
    if json {
        let value = serde_json::json!({ "stage": name, "findings": findings });
        super::print(&format!("{value:#}\n"))?;
    } else {
        let lines: String = findings.iter().map(|finding| format!("{finding}\n")).collect();
        let (warnings, notes) = (count(Severity::Warning), count(Severity::Note));
        super::print(&format!("{lines}{errors} errors, {warnings} warnings, {notes} notes\n"))?;
    }
    match errors {
        0 => Ok(()),
        _ => Err(Failure::wrong(format!("{}: {errors} errors", name.display()))),
    }
}

/// The monitors of the display, else those of the file, and whose they are; a stage without windows needs none.
fn monitors(stage: &Stage) -> (Vec<Monitor>, Option<String>) {
    if stage.windows.is_empty() {
        return (Vec::new(), None);
    }
    let list = |monitors: &[Monitor]| {
        let one = |(i, m): (usize, &Monitor)| {
            format!("{i} is `{}`, {} × {} at ({}, {})", m.name, m.size[0], m.size[1], m.at[0], m.at[1])
        };
        monitors.iter().enumerate().map(one).collect::<Vec<_>>().join("; ")
    };
    match window::monitors() {
        Ok(found) => {
            let own = |m: window::Monitor| Monitor { name: m.name, at: m.at, size: m.size };
            let monitors: Vec<Monitor> = found.into_iter().map(own).collect();
            let whose = format!("of the running display: {}", list(&monitors));
            (monitors, Some(whose))
        }
        Err(_) if !stage.monitors.is_empty() => {
            (stage.monitors.clone(), Some(format!("of the file: {}", list(&stage.monitors))))
        }
        Err(reason) => {
            let whose = format!("{reason}; without [[monitor]] tables the windows' places are not checked");
            (Vec::new(), Some(whose))
        }
    }
}
