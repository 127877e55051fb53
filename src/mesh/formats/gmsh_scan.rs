//! The words and numbers of a Gmsh file, one after the other, text and binary alike, and the element types of Gmsh by their
//! numbers (Gmsh reference manual, section "Node ordering").
//!
//! In: bytes. Out: sections, lines and numbers, or a [`FormatFault`] at the offset where something else stands. Nothing
//! is allocated here, so that a forged count cannot cost memory.

use crate::mesh::assemble::ElementShape;
use crate::mesh::error::{FormatFault, refuse};
use std::str::FromStr;

/// The encoding of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    Text,
    /// `size_bytes` is the width of tags and counts: 4 in Gmsh 2.2, sizeof(size_t) in 4.1.
    Binary {
        big_endian: bool,
        size_bytes: usize,
    },
}

pub struct Scanner<'a> {
    bytes: &'a [u8],
    at: usize,
    pub mode: Mode,
}

impl<'a> Scanner<'a> {
    pub fn new(bytes: &'a [u8]) -> Scanner<'a> {
        const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
        let at = if bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        Scanner { bytes, at, mode: Mode::Text }
    }

    /// The offset of the next byte.
    pub fn at(&self) -> usize {
        self.at
    }

    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// The line from here on, without blanks around it; moves just behind its end, past no binary byte.
    pub fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let end = rest.iter().position(|&byte| byte == b'\n');
        self.at += end.map_or(rest.len(), |end| end + 1);
        rest[..end.unwrap_or(rest.len())].trim_ascii()
    }

    pub fn skip_white(&mut self) {
        self.at += self.rest().iter().take_while(|byte| byte.is_ascii_whitespace()).count();
    }

    fn skip_blanks(&mut self) {
        let is_blank = |byte: &&u8| byte.is_ascii_whitespace() && **byte != b'\n';
        self.at += self.rest().iter().take_while(is_blank).count();
    }

    /// The name of the section that begins here; `None` at the end of the file.
    pub fn section(&mut self) -> Result<Option<&'a str>, FormatFault> {
        self.skip_white();
        let at = self.at;
        if self.rest().is_empty() {
            return Ok(None);
        }
        let line = self.line();
        let name = line.strip_prefix(b"$").and_then(|name| std::str::from_utf8(name).ok());
        let Some(name) = name.filter(|name| !name.is_empty()) else {
            return refuse(at, format!("expected a section ($Name), found `{}`", excerpt(line)));
        };
        if self.mode == Mode::Text {
            self.skip_white();
        }
        Ok(Some(name))
    }

    /// Expects `$EndNAME`.
    pub fn end_section(&mut self, name: &str) -> Result<(), FormatFault> {
        self.skip_white();
        let at = self.at;
        let line = self.line();
        match line.strip_prefix(b"$End") {
            Some(end) if end == name.as_bytes() => Ok(()),
            _ if line.is_empty() => refuse(at, format!("the file ends before $End{name}")),
            _ => refuse(at, format!("expected $End{name}, found `{}`", excerpt(line))),
        }
    }

    /// Moves behind `$EndNAME`, whatever stands before it; the section began at `start`.
    pub fn skip_section(&mut self, start: usize, name: &str) -> Result<(), FormatFault> {
        let end = format!("$End{name}");
        loop {
            let rest = self.rest();
            let Some(found) = rest.windows(end.len()).position(|window| window == end.as_bytes()) else {
                return refuse(start, format!("the section has no {end}"));
            };
            self.at += found;
            if self.line() == end.as_bytes() {
                return Ok(());
            }
        }
    }

    /// A line that holds one count; it is text in binary files too.
    pub fn count_line(&mut self) -> Result<u64, FormatFault> {
        let at = self.at;
        let line = self.line();
        if self.mode == Mode::Text {
            self.skip_white();
        }
        let count = std::str::from_utf8(line).ok().and_then(|text| text.parse().ok());
        count.ok_or_else(|| FormatFault::at(at, format!("expected a count, found `{}`", excerpt(line))))
    }

    /// A 32-bit number: a type, a dimension, an entity or a physical group.
    pub fn int(&mut self) -> Result<i32, FormatFault> {
        match self.mode {
            Mode::Text => self.number("a whole number"),
            Mode::Binary { big_endian, .. } => {
                let bytes = self.take()?;
                Ok(if big_endian { i32::from_be_bytes(bytes) } else { i32::from_le_bytes(bytes) })
            }
        }
    }

    /// A count or a tag.
    pub fn size(&mut self) -> Result<u64, FormatFault> {
        match self.mode {
            Mode::Text => self.number("a count or tag"),
            Mode::Binary { big_endian, size_bytes: 8 } => {
                let bytes = self.take()?;
                Ok(if big_endian { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) })
            }
            Mode::Binary { .. } => {
                let (at, size) = (self.at, self.int()?);
                u64::try_from(size)
                    .map_err(|_negative| FormatFault::at(at, format!("{size} is no count or tag")))
            }
        }
    }

    pub fn real(&mut self) -> Result<f64, FormatFault> {
        match self.mode {
            Mode::Text => self.number("a number"),
            Mode::Binary { big_endian, .. } => {
                let bytes = self.take()?;
                Ok(if big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
            }
        }
    }

    /// Expects the end of the line in a text; binary files have none.
    pub fn end_line(&mut self) -> Result<(), FormatFault> {
        if self.mode == Mode::Text {
            self.skip_blanks();
            if !matches!(self.rest().first(), None | Some(b'\n')) {
                let at = self.at;
                return refuse(at, format!("the line should end before `{}`", excerpt(self.line())));
            }
            self.skip_white();
        }
        Ok(())
    }

    /// The next `N` bytes.
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], FormatFault> {
        let bytes = self.rest().first_chunk();
        let bytes = *bytes.ok_or_else(|| FormatFault::at(self.bytes.len(), "the file ends too early"))?;
        self.at += N;
        Ok(bytes)
    }

    /// The next word of this line as a number.
    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, FormatFault> {
        self.skip_blanks();
        let (at, rest) = (self.at, self.rest());
        let length = rest.iter().take_while(|byte| !byte.is_ascii_whitespace()).count();
        let word = &rest[..length];
        self.at += length;
        if let Some(number) = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()) {
            return Ok(number);
        }
        refuse(
            at,
            match word {
                [] if rest.is_empty() => "the file ends too early".to_owned(),
                [] => format!("the line ends where {what} is expected"),
                [b'$', ..] => format!("fewer entries than the section's count says: `{}`", excerpt(word)),
                _ => format!("expected {what}, found `{}`", excerpt(word)),
            },
        )
    }
}

/// The start of `bytes` in printable characters.
pub fn excerpt(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST)]).escape_debug().to_string();
    if bytes.len() > LONGEST { shown + "…" } else { shown }
}

/// Dimension and nodes of Gmsh's element type `number`.
fn kind(number: i32) -> Option<ElementShape> {
    let (dimension, nodes) = match number {
        15 => (0, 1),
        1 => (1, 2),
        8 => (1, 3),
        26 => (1, 4),
        27 => (1, 5),
        28 => (1, 6),
        2 => (2, 3),
        9 => (2, 6),
        20 => (2, 9),
        21 => (2, 10),
        22 => (2, 12),
        23 | 24 => (2, 15),
        25 => (2, 21),
        3 => (2, 4),
        16 => (2, 8),
        10 => (2, 9),
        4 => (3, 4),
        11 => (3, 10),
        29 => (3, 20),
        30 => (3, 35),
        31 => (3, 56),
        5 => (3, 8),
        17 => (3, 20),
        12 => (3, 27),
        6 => (3, 6),
        18 => (3, 15),
        13 => (3, 18),
        7 => (3, 5),
        19 => (3, 13),
        14 => (3, 14),
        92 => (3, 64),
        93 => (3, 125),
        _ => return None,
    };
    Some(ElementShape { dimension, nodes, is_tetrahedron: matches!(number, 4 | 11 | 29 | 30 | 31) })
}

/// [`kind`], refused at `at` when unknown.
pub fn known_kind(number: i32, at: usize) -> Result<ElementShape, FormatFault> {
    kind(number).ok_or_else(|| FormatFault::at(at, format!("element type {number} is not known")))
}
