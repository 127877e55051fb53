//! Files read whole into memory: regular files, and no larger ones than there is memory for.

use super::machine;
use std::io;
use std::path::Path;

/// Bytes of memory per byte of a file while it is read into a mesh: at most 4.7 for tetrahedra in any format.
const MEMORY: f64 = 5.0;

/// The bytes of a regular file. Devices and pipes, which may have no end, and files that do not fit into memory are refused
/// before they are read.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let bytes = regular(path)?;
    machine::expect(format!("reading its {bytes} bytes"), MEMORY * bytes as f64)
        .map_err(|refusal| io::Error::new(io::ErrorKind::OutOfMemory, refusal))?;
    std::fs::read(path)
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
