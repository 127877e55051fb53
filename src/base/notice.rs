//! Writes lines for people to standard error. A line that cannot be written, because a disk is full or a pipe is closed, is
//! lost; the work goes on.

use super::text::plain;
use std::fmt::Arguments;
use std::io::Write;

/// Writes a line to standard error, without anything that could control the terminal ([`plain`]).
pub fn say(line: Arguments<'_>) {
    // In one piece, so that lines of several threads do not mix.
    let _ = std::io::stderr().lock().write_all(format!("{}\n", plain(line)).as_bytes());
}

/// [`say`] with a format, as `eprintln!` has it; `eprintln!` panics where the line cannot be written.
macro_rules! notice {
    ($($part:tt)*) => { $crate::base::notice::say(format_args!($($part)*)) };
}
pub(crate) use notice;
