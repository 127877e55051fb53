//! Writes tables between the marks of a Markdown file: the lines `<!-- NAME: begin -->` and `<!-- NAME: end -->`.

use crate::base::failure::Failure;
use crate::base::input;
use crate::base::output::{self, Kind};
use anyhow::Context;
use std::path::Path;

/// Known by the marks in it, which are looked for in the whole file.
const MARKED: Kind = Kind { name: "a Markdown file", recognizes: |_| true };

/// Whether the marks are there and the file can be written, before the tables are measured.
pub fn try_between(path: &Path, name: &str) -> Result<(), Failure> {
    around(path, name)?;
    Ok(output::try_path(path, &MARKED, &[])?)
}

/// Replaces what stands between the marks.
pub fn write_between(path: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let [before, after] = around(path, name)?;
    Ok(output::write(path, &MARKED, |file| file.write_all(format!("{before}{text}{after}").as_bytes()))?)
}

/// Text before and behind the lines between the marks, with the marks.
fn around(path: &Path, name: &str) -> Result<[String; 2], Failure> {
    let (first, last) = (format!("<!-- {name}: begin -->\n"), format!("<!-- {name}: end -->"));
    let text = input::open(path)
        .and_then(std::io::read_to_string)
        .with_context(|| path.display().to_string())
        .map_err(Failure::Request)?;
    match text.find(&first).zip(text.find(&last)) {
        Some((begin, end)) if begin < end => {
            Ok([text[..begin + first.len()].to_owned(), text[end..].to_owned()])
        }
        _ => Err(Failure::wrong(format!("{}: the lines {first}and {last} are missing", path.display()))),
    }
}
