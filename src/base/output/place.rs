//! Finds where the bytes for a path go: into a file at the end of all symbolic links, or into a device or pipe.

use std::fs::{File, Permissions};
use std::io::{Error, ErrorKind, Result};
use std::os::fd::AsFd;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
use std::path::{Path, PathBuf};

#[derive(Debug)]
pub enum Place {
    /// A file, or nothing yet; the file is replaced.
    File(PathBuf),
    /// A device, a pipe, a socket, or an open descriptor (`/dev/stdout`); the bytes are written to it.
    Stream(PathBuf),
}

/// Number of symbolic links that are followed, as in Linux.
const LINKS: usize = 40;

impl Place {
    pub fn find(path: &Path) -> Result<Place> {
        let names_a_folder = path.as_os_str().as_bytes().ends_with(b"/") || path.file_name().is_none();
        if names_a_folder {
            return Err(ErrorKind::IsADirectory.into());
        }
        let mut place = path.to_owned();
        for _ in 0..LINKS {
            if is_descriptor(&place) {
                return Ok(Place::Stream(place));
            }
            match std::fs::symlink_metadata(&place) {
                Ok(found) if found.is_symlink() => {
                    place = folder_of(&place).join(std::fs::read_link(&place)?);
                }
                Ok(found) if found.is_file() => return Ok(Place::File(place)),
                Ok(found) if found.is_dir() => return Err(ErrorKind::IsADirectory.into()),
                Ok(_) => return Ok(Place::Stream(place)),
                Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Place::File(place)),
                Err(error) => return Err(error),
            }
        }
        Err(Error::other(format!("it is a circle of symbolic links, or more than {LINKS}")))
    }
}

/// The links of /proc/PID/fd lead to open files without a name of their own.
fn is_descriptor(path: &Path) -> bool {
    let folder = folder_of(path);
    folder.ends_with("fd") && folder.canonicalize().is_ok_and(|folder| folder.starts_with("/proc"))
}

pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether both paths exist and lead to one file.
pub fn is_same(a: &Path, b: &Path) -> bool {
    let identity = |path| std::fs::metadata(path).map(|found| (found.dev(), found.ino()));
    matches!((identity(a), identity(b)), (Ok(a), Ok(b)) if a == b)
}

/// Gives `new` the permissions of the file that it is about to replace, and its owner and group where this process may.
pub fn keep_attributes(old: &Path, new: &File) -> Result<()> {
    let found = match std::fs::metadata(old) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        found => found?,
    };
    let own = new.metadata()?;
    // Another's file in a folder of ours becomes ours, as by any editor.
    let is_owned = (own.uid(), own.gid()) == (found.uid(), found.gid())
        || fchown(new, Some(found.uid()), Some(found.gid())).is_ok();
    let kept = if is_owned { 0o7777 } else { 0o777 };
    new.set_permissions(Permissions::from_mode(found.mode() & kept))
}

/// Standard output and error, under any name, are written to from where they stand, among everything else that is printed.
pub fn open_stream(path: &Path) -> Result<File> {
    let is_own = is_descriptor(path) && folder_of(path).canonicalize()? == Path::new(OWN).canonicalize()?;
    let descriptor = match path.file_name().and_then(|name| name.to_str()) {
        Some("1") if is_own => std::io::stdout().as_fd().try_clone_to_owned()?,
        Some("2") if is_own => std::io::stderr().as_fd().try_clone_to_owned()?,
        _ => return File::options().append(true).open(path),
    };
    Ok(descriptor.into())
}

/// Devices, pipes and folders of some file systems have nothing to sync.
pub fn sync(file: &File) -> Result<()> {
    match file.sync_all() {
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        synced => synced,
    }
}

const OWN: &str = "/proc/self/fd";
