//! An entry of the list of formats (how a mesh file is recognised, read and written), and [`Words`]: the words, numbers and
//! lines of a text file, one after the other.
//!
//! In: a file's bytes, or a [`TetMesh`]. Out: a [`RawMesh`] that is not yet checked, or the bytes of one or two files
//! that the reader of the format gives back as the same nodes, tetrahedra and regions, bit by bit.

use super::gmsh_scan::excerpt;
use crate::base::output::Kind;
use crate::mesh::assemble::RawMesh;
use crate::mesh::error::{FormatFault, MeshError, refuse};
use crate::mesh::tet_mesh::TetMesh;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// One file format.
pub struct Format {
    pub name: &'static str,
    /// Extensions in lower case, without the dot.
    pub extensions: &'static [&'static str],
    /// Whether these are the first bytes of such a file, whatever its name.
    pub recognizes: fn(&[u8]) -> bool,
    /// Finds the other files of a mesh that is stored in several, by their names beside this path.
    pub others: fn(&Path) -> Vec<PathBuf>,
    /// Reads the mesh from the bytes of the named file and of the others, in their order. A reader opens no file itself:
    /// the fingerprint of a precomputed body covers exactly what is passed here.
    pub read: fn(&[u8], &[Part]) -> Result<RawMesh, FormatFault>,
    /// The ways to write it, the usual one first; none where it can only be read.
    pub writers: &'static [Writer],
}

/// Another file of a mesh.
pub struct Part {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
}

/// A writer of a format in one encoding.
pub struct Writer {
    pub name: &'static str,
    pub about: &'static str,
    /// The extension of each file that it makes, and what may stand there and be overwritten. Where there is one file
    /// only, its name is the user's.
    pub files: &'static [(&'static str, Kind)],
    pub encode: fn(&TetMesh) -> Result<Encoded, MeshError>,
}

/// Files in the order of [`Writer::files`].
pub struct Encoded {
    pub files: Vec<Vec<u8>>,
    /// Sentences about what the format cannot hold.
    pub lost: Vec<String>,
}

impl Writer {
    fn has(&self, extension: &str) -> bool {
        self.files.iter().any(|(known, _)| *known == extension)
    }

    /// The files that it makes for `path`, in the order of [`Writer::files`].
    pub fn targets(&self, path: &Path) -> impl Iterator<Item = (PathBuf, &'static Kind)> {
        let is_alone = self.files.len() == 1;
        let name = move |extension| if is_alone { path.to_owned() } else { path.with_extension(extension) };
        self.files.iter().map(move |(extension, kind)| (name(extension), kind))
    }
}

/// The extension of `path` in lower case, without the dot; empty where there is none.
pub fn extension(path: &Path) -> String {
    path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The writer for the extension of `path` among `writers`, or the one called `name` if it has that extension.
pub fn find_writer<'a>(
    writers: impl Iterator<Item = &'a Writer> + Clone,
    path: &Path,
    name: Option<&str>,
) -> Result<&'a Writer, MeshError> {
    let extension = extension(path);
    let mut fitting = writers.clone().filter(|writer| writer.has(&extension));
    fitting.find(|writer| name.is_none_or(|name| writer.name == name)).ok_or_else(|| {
        let listed = |writer: &Writer| {
            let extensions: Vec<&str> = writer.files.iter().map(|(extension, _)| *extension).collect();
            format!("{} (.{})", writer.name, extensions.join(", ."))
        };
        let known: Vec<String> = writers.map(listed).collect();
        let asked = name.map_or(String::new(), |name| format!(" as {name}"));
        let reason = format!("cannot be written{asked}; known are {}", known.join(", "));
        MeshError::Refused { path: path.to_owned(), reason }
    })
}

/// The words of a text with their offsets, or a [`FormatFault`] where something else stands. Nothing is allocated here, so
/// that a forged count cannot cost memory.
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
