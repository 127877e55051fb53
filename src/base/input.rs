//! Files read whole into memory: regular files, and no larger ones than there is memory for.

use super::machine;
use std::fs::File;
use std::io::{self, Read, Take};
use std::path::Path;

/// Bytes of memory per byte of a file while it is read into a mesh: at most 4.7 for tetrahedra in any format.
const MEMORY: f64 = 5.0;

/// The bytes of a regular file. Devices and pipes, which may have no end, and files that do not fit into memory are refused
/// before they are read.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let bytes = regular(path)?;
    machine::expect(format!("reading its {bytes} bytes"), MEMORY * bytes as f64)
        .map_err(|refusal| io::Error::new(io::ErrorKind::OutOfMemory, refusal))?;
    let mut all = Vec::new();
    open(path)?.read_to_end(&mut all)?;
    Ok(all)
}

/// A regular file to read, which ends where the system says that it does: those of /proc, which may wait for ever, have no
/// byte.
pub fn open(path: &Path) -> io::Result<Take<File>> {
    regular(path)?;
    open_any(path)
}

/// Opens a path that may lead to a pipe, such as standard input, which is read to its end.
pub fn open_any(path: &Path) -> io::Result<Take<File>> {
    let file = File::open(path)?;
    let found = file.metadata()?;
    Ok(file.take(if found.is_file() { found.len() } else { u64::MAX }))
}

/// The size of a regular file; an error if `path` is none. Ask this before opening it, because opening a pipe waits.
pub fn regular(path: &Path) -> io::Result<u64> {
    let found = std::fs::metadata(path)?;
    if found.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"));
    }
    if !found.is_file() {
        let reason = "it is a device or a pipe, which may never end: save its contents in a file";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    }
    Ok(found.len())
}
