//! Diagnostics (errors, warnings and notes about a mesh, a scene, a stage or a solution), and the lines for people that a
//! program writes to standard error.
//!
//! A line that cannot be written, because a disk is full or a pipe is closed, is lost; the work goes on.

use super::table::count;
use super::text::plain;
use std::fmt::Arguments;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

static VERBOSE: AtomicBool = AtomicBool::new(false);

/// Shows details too from here on (`--verbose`).
pub fn show_details() {
    VERBOSE.store(true, Ordering::Relaxed);
}

/// Whether details are shown.
pub fn is_verbose() -> bool {
    VERBOSE.load(Ordering::Relaxed)
}

/// The severity of a diagnostic, the most severe first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The body is refused.
    Error,
    /// The scene is solved, but the answer may not be what was meant.
    Warning,
    /// Something was repaired, or is worth knowing.
    Note,
    /// A figure or an explanation that only `--verbose` shows; JSON has it always.
    Detail,
}

impl std::fmt::Display for Severity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
            Severity::Detail => "detail",
        })
    }
}

/// A finding: its severity, place and message.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Diagnostic {
    pub severity: Severity,
    /// A key of the scene or the stage, or a file and a line; empty where the message says it all.
    #[serde(rename = "entity", skip_serializing_if = "String::is_empty")]
    pub place: String,
    /// The finding, with the numbers, and what to do about it.
    pub message: String,
}

impl Diagnostic {
    pub fn new(severity: Severity, place: impl Into<String>, message: impl Into<String>) -> Diagnostic {
        Diagnostic { severity, place: place.into(), message: message.into() }
    }

    pub fn is_shown(&self) -> bool {
        self.severity < Severity::Detail || is_verbose()
    }
}

impl std::fmt::Display for Diagnostic {
    /// "warning: body.tube.material: …".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: ", self.severity)?;
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        f.write_str(&self.message)
    }
}

/// A line for each finding that is shown, and their numbers: "1 error, 0 warnings, 2 notes".
pub fn listing(found: &[Diagnostic]) -> String {
    let lines: String =
        found.iter().filter(|finding| finding.is_shown()).map(|finding| format!("{finding}\n")).collect();
    let numbers =
        [Severity::Error, Severity::Warning, Severity::Note].map(|severity| number(found, severity));
    let hidden: Vec<Diagnostic> = found.iter().filter(|finding| !finding.is_shown()).cloned().collect();
    let more = match hidden.is_empty() {
        true => String::new(),
        false => format!("; --verbose shows {}", number(&hidden, Severity::Detail)),
    };
    format!("{lines}{}{more}\n", numbers.join(", "))
}

/// "2 warnings": those of one severity.
pub fn number(found: &[Diagnostic], severity: Severity) -> String {
    let matching = found.iter().filter(|diagnostic| diagnostic.severity == severity).count();
    count(matching, &severity.to_string())
}

/// Writes the findings that are shown to standard error, each with `before` in front.
pub fn report(before: &str, found: &[Diagnostic]) {
    found
        .iter()
        .filter(|finding| finding.is_shown())
        .for_each(|finding| say(format_args!("{before}{finding}")));
}

/// Writes a line to standard error, without anything that could control the terminal ([`plain`]).
pub fn say(line: Arguments<'_>) {
    // In one piece, so that lines of several threads do not mix.
    let _ = std::io::stderr().lock().write_all(format!("{}\n", plain(line)).as_bytes());
}

/// [`say`] with a format, as `eprintln!` has it; `eprintln!` panics where the line cannot be written.
macro_rules! notice {
    ($($part:tt)*) => { $crate::base::diagnostic::say(format_args!($($part)*)) };
}
pub(crate) use notice;
