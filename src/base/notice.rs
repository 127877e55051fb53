//! Lines to people, on standard error. One that cannot be written, on a full disk or a closed pipe, is lost; the work
//! that it speaks of is not.

use super::text::plain;
use std::fmt::Arguments;
use std::io::Write;

/// Writes a line to standard error, nothing in it able to steer the terminal ([`plain`]).
pub fn say(line: Arguments<'_>) {
    // In one piece, so that lines of several threads do not mix.
    let _ = std::io::stderr().lock().write_all(format!("{}\n", plain(line)).as_bytes());
}

/// [`say`] with a format, as `eprintln!` has it; `eprintln!` panics where the line cannot be written.
macro_rules! notice {
    ($($part:tt)*) => { $crate::base::notice::say(format_args!($($part)*)) };
}
pub(crate) use notice;
