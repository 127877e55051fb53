//! Errors of meshes: the file, the place in it, the reason and the remedy.

use crate::base::failure::Failure;
use crate::base::output::OutputError;
use std::fmt;
use std::path::{Path, PathBuf};

/// The reason why a mesh could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{}:{place}: {reason}", path.display())]
    Malformed { path: PathBuf, place: Place, reason: String },
    #[error("{}: {reason}", path.display())]
    Refused { path: PathBuf, reason: String },
    #[error("the mesh cannot be written as {encoding}: {reason}")]
    Unwritable { encoding: &'static str, reason: String },
}

/// A place in a file: a 1-based line of a text, a byte offset into a binary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    Line(usize),
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "{line}"),
            Place::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}

/// A [`FormatFault`] at a byte offset, as the result of a reader.
pub fn refuse<T>(at: usize, reason: impl Into<String>) -> Result<T, FormatFault> {
    Err(FormatFault::at(at, reason))
}

/// An objection of a format's reader: at a byte offset, or to the file as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct FormatFault {
    pub at: Option<usize>,
    pub reason: String,
}

impl FormatFault {
    pub fn at(at: usize, reason: impl Into<String>) -> FormatFault {
        FormatFault { at: Some(at), reason: reason.into() }
    }

    pub fn whole(reason: impl Into<String>) -> FormatFault {
        FormatFault { at: None, reason: reason.into() }
    }

    /// The error that names the file and, from its `bytes`, the line. A file with a zero byte is no text:
    /// there the offset itself is named.
    pub fn in_file(self, path: &Path, bytes: &[u8]) -> MeshError {
        let path = path.to_owned();
        let Some(at) = self.at else { return MeshError::Refused { path, reason: self.reason } };
        let place = if bytes.contains(&0) {
            Place::Byte(at)
        } else {
            Place::Line(bytes.iter().take(at).filter(|&&byte| byte == b'\n').count() + 1)
        };
        MeshError::Malformed { path, place, reason: self.reason }
    }
}

impl From<MeshError> for Failure {
    fn from(error: MeshError) -> Failure {
        match error {
            MeshError::Output(error) => error.into(),
            error => Failure::request(error),
        }
    }
}
