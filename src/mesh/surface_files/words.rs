//! Words of a text, each with its byte offset, line by line where a format needs it, and a surface as its format's reader
//! found it.

use crate::mesh::error::FormatFault;
use nalgebra::Vector3;

/// A token of a text, with its offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Word<'a> {
    pub text: &'a [u8],
    pub at: usize,
}

/// All words of `bytes`, which begin at offset `at` of the file.
pub fn words(bytes: &[u8], at: usize) -> impl Iterator<Item = Word<'_>> {
    bytes
        .split(u8::is_ascii_whitespace)
        .scan(at, |at, text| {
            let word = Word { text, at: *at };
            *at += text.len() + 1;
            Some(word)
        })
        .filter(|word| !word.text.is_empty())
}

/// All lines of `bytes` with their offsets.
pub fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    bytes.split(|&byte| byte == b'\n').scan(0, |at, line| {
        let here = *at;
        *at += line.len() + 1;
        Some((here, line))
    })
}

impl Word<'_> {
    /// The word as people read it, cut short where it is long.
    pub fn shown(&self) -> String {
        String::from_utf8_lossy(&self.text[..self.text.len().min(40)]).into_owned()
    }

    pub fn parse<T: std::str::FromStr>(&self, what: &str) -> Result<T, FormatFault> {
        let parsed = std::str::from_utf8(self.text).ok().and_then(|text| text.parse().ok());
        parsed.ok_or_else(|| FormatFault::at(self.at, format!("{:?} is not {what}", self.shown())))
    }
}

/// The next word as a number; `end` is the offset to name where there is none.
pub fn number<'a>(words: &mut impl Iterator<Item = Word<'a>>, end: usize) -> Result<f64, FormatFault> {
    words.next().ok_or_else(|| FormatFault::at(end, "a coordinate is missing"))?.parse("a number")
}

/// The result of a format's reader: polygons by the indices of their corners, unchecked.
#[derive(Debug, Default)]
pub(super) struct RawSurface {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Corners of all polygons, one polygon after the other.
    pub(super) corners: Vec<u32>,
    /// Number of corners of each polygon, and its byte offset for error messages.
    pub(super) polygons: Vec<(u32, usize)>,
    pub(super) notices: Vec<String>,
}
