//! Prints results on standard output.

use crate::base::failure::Failure;
use crate::base::text::plain;
use std::io::{ErrorKind, Write};

/// Writes a result to standard output, without anything that could control the terminal ([`plain`]). It is no error if the
/// reader has gone, as after `| head`.
pub fn print(text: &str) -> Result<(), Failure> {
    print_over(0, text)
}

/// [`print()`] over the last `lines` lines of a terminal.
pub fn print_over(lines: usize, text: &str) -> Result<(), Failure> {
    let up = if lines > 0 { format!("\x1b[{lines}A\x1b[J") } else { String::new() };
    let mut out = std::io::stdout().lock();
    match out.write_all((up + &plain(text)).as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::work(error)),
        _ => Ok(()),
    }
}
