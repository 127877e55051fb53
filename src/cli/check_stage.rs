//! `greenstage check STAGE`: lists all that can be found wrong with a stage.

use super::print::print;
use crate::base::diagnostic::{Diagnostic, Severity, listing, number};
use crate::base::failure::Failure;
use crate::render::window;
use crate::stage::{Monitor, Stage, Survey, lint};
use std::path::Path;

/// Prints the findings about the stage of this name or file.
pub fn run(name: &Path, json: bool) -> Result<(), Failure> {
    let survey = Stage::survey(&name.display().to_string()).map_err(Failure::request)?;
    let Survey { stage, tracking, faults } = survey;
    let mut findings: Vec<Diagnostic> = faults
        .into_iter()
        .chain(crate::track::source_faults(&tracking))
        .map(|fault| {
            let place = format!("{}:{}", name.display(), fault.line);
            Diagnostic::new(Severity::Error, &place, fault.fault.to_string())
        })
        .collect();
    if let Some(stage) = stage {
        let (monitors, whose) = monitors(&stage);
        if let Some(whose) = whose {
            findings.push(Diagnostic::new(Severity::Note, "monitors", whose));
        }
        findings.extend(lint(&stage, &monitors));
    }
    findings.sort_by_key(|finding| finding.severity);
    if json {
        let value = serde_json::json!({ "stage": name, "findings": findings });
        print(&format!("{value:#}\n"))?;
    } else {
        print(&listing(&findings))?;
    }
    verdict(&findings, name)
}

/// A wrong request where a finding about the file is an error.
pub fn verdict(findings: &[Diagnostic], path: &Path) -> Result<(), Failure> {
    if findings.iter().all(|finding| finding.severity != Severity::Error) {
        return Ok(());
    }
    Err(Failure::wrong(format!("{}: {}", path.display(), number(findings, Severity::Error))))
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
