//! The words, numbers and lines of a text file, one after the other.
//!
//! In: bytes. Out: words with their offsets, or a [`FormatFault`] where something else stands. Nothing is allocated here,
//! so that a forged count cannot cost memory.

use super::gmsh_scan::excerpt;
use crate::mesh::error::{FormatFault, refuse};
use std::str::FromStr;

#[derive(Clone, Copy)]
pub struct Words<'a> {
    pub bytes: &'a [u8],
    /// Offset of the next byte.
    pub at: usize,
    /// This byte begins a comment, which ends with the line.
    comment: Option<u8>,
}

impl<'a> Words<'a> {
    pub fn new(bytes: &'a [u8], comment: Option<u8>) -> Words<'a> {
        Words { bytes, at: 0, comment }
    }

    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// Skips white space and comments, up to the next word or the end.
    pub fn skip_white(&mut self) {
        loop {
            self.at += self.rest().iter().take_while(|byte| byte.is_ascii_whitespace()).count();
            if self.comment.is_none() || self.rest().first().copied() != self.comment {
                return;
            }
            self.at += self.rest().iter().take_while(|&&byte| byte != b'\n').count();
        }
    }

    /// The next word, on this line or a later one; `None` at the end of the file.
    pub fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_white();
        let rest = self.rest();
        let is_inside = |byte: &&u8| !byte.is_ascii_whitespace() && Some(**byte) != self.comment;
        let length = rest.iter().take_while(is_inside).count();
        self.at += length;
        (length > 0).then(|| &rest[..length])
    }

    pub fn number<T: FromStr>(&mut self, what: &str) -> Result<T, FormatFault> {
        self.skip_white();
        let at = self.at;
        let Some(word) = self.word() else {
            return refuse(at, format!("the file ends where {what} is expected"));
        };
        parsed(word, at, what)
    }

    /// Takes the remainder of this line without surrounding blanks, and its offset; moves to the next line. `None` at the end of
    /// the file.
    pub fn line(&mut self) -> Option<(usize, &'a [u8])> {
        let (at, rest) = (self.at, self.rest());
        if rest.is_empty() {
            return None;
        }
        let end = rest.iter().position(|&byte| byte == b'\n');
        self.at += end.map_or(rest.len(), |end| end + 1);
        let line = &rest[..end.unwrap_or(rest.len())];
        Some((at, line.trim_ascii()))
    }

    /// The next line that is not empty, without its comment.
    pub fn full_line(&mut self) -> Option<(usize, &'a [u8])> {
        self.skip_white();
        let (at, line) = self.line()?;
        let end = line.iter().position(|&byte| Some(byte) == self.comment).unwrap_or(line.len());
        Some((at, line[..end].trim_ascii()))
    }
}

/// Parses a number.
pub fn parsed<T: FromStr>(word: &[u8], at: usize, what: &str) -> Result<T, FormatFault> {
    let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
    number.ok_or_else(|| FormatFault::at(at, format!("expected {what}, found `{}`", excerpt(word))))
}
