//! Files read whole into memory: regular files, and no larger ones than there is memory for.

use super::machine;
use std::io;
use std::path::Path;

/// Bytes of memory for one of a file while it becomes a mesh: 4.7 at most of tetrahedra in any format.
const MEMORY: f64 = 5.0;

/// The bytes of a regular file. Refused unread: what has no end (a device, a pipe), and what does not fit into memory.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let bytes = regular(path)?;
    machine::expect(format!("reading its {bytes} bytes"), MEMORY * bytes as f64)
        .map_err(|refusal| io::Error::new(io::ErrorKind::OutOfMemory, refusal))?;
    std::fs::read(path)
}

/// Errors where `path` is no regular file; its size. To be asked before it is opened: opening a pipe waits.
pub fn regular(path: &Path) -> io::Result<u64> {
    let found = std::fs::metadata(path)?;
    if found.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"));
    }
    if !found.is_file() {
        let reason = "it is a device or a pipe, which may have no end: write what comes from it into a file";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    }
    Ok(found.len())
}
