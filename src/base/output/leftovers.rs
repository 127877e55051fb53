//! Temporary files beside the results, and those that killed runs left behind.
//!
//! `.greenstage-XXXXXX.part` is a file, `.greenstage-XXXXXX.scratch` a folder of files for one run. The
//! process that makes one holds a lock on it, which the system releases however the process ends. The next
//! run that writes into the folder removes everything of such a name that is not locked and was not changed for a minute.

use std::collections::BTreeSet;
use std::fs::{DirEntry, File, Permissions};
use std::io::Result;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tempfile::{Builder, NamedTempFile, TempDir, TempPath};

const PREFIX: &str = ".greenstage-";
const FILE: &str = ".part";
const FOLDER: &str = ".scratch";
const RANDOM: usize = 6;
/// A file younger than this may not have its lock yet.
const MADE_WITHIN: Duration = Duration::from_secs(60);

/// A temporary file in `folder`, with the permissions that a new file has.
pub fn temporary(folder: &Path) -> Result<NamedTempFile> {
    sweep_once(folder);
    let file = Builder::new()
        .prefix(PREFIX)
        .suffix(FILE)
        .rand_bytes(RANDOM)
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)?;
    hold(file.as_file());
    Ok(file)
}

/// A temporary name in `folder` for a file that `make` puts there.
pub fn aside(folder: &Path, make: impl FnMut(&Path) -> Result<()>) -> Result<TempPath> {
    let made = Builder::new().prefix(PREFIX).suffix(FILE).rand_bytes(RANDOM).make_in(folder, make)?;
    Ok(made.into_temp_path())
}

/// A folder for files that are needed during one run; removed with all that is in it.
#[derive(Debug)]
pub struct Scratch {
    folder: TempDir,
    /// Locked as long as the folder is there.
    _held: File,
}

impl Scratch {
    pub fn in_folder(folder: &Path) -> Result<Scratch> {
        sweep_once(folder);
        let folder = Builder::new().prefix(PREFIX).suffix(FOLDER).rand_bytes(RANDOM).tempdir_in(folder)?;
        let held = File::open(folder.path())?;
        hold(&held);
        Ok(Scratch { folder, _held: held })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Locks a temporary file. On a file system without locks nothing is removed, because a leftover cannot be distinguished from a
/// file in use there.
fn hold(file: &File) {
    if let Err(error) = file.try_lock() {
        tracing::debug!("a temporary file is not locked: {error}");
    }
}

fn sweep_once(folder: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned()) {
        sweep(folder);
    }
}

/// Removes leftovers of killed runs in `folder`; those that cannot be removed stay.
pub fn sweep(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if let Err(error) = remove_leftover(&entry) {
            tracing::debug!("{}: a leftover stays: {error}", entry.path().display());
        }
    }
}

fn remove_leftover(entry: &DirEntry) -> Result<()> {
    let (name, found) = (entry.file_name(), entry.file_type()?);
    let bears = |suffix| name.to_str().is_some_and(|name| is_ours(name, suffix));
    let (is_file, is_folder) = (found.is_file() && bears(FILE), found.is_dir() && bears(FOLDER));
    if !is_file && !is_folder {
        return Ok(());
    }
    let (path, file) = (entry.path(), File::open(entry.path())?);
    let is_old = file.metadata()?.modified()?.elapsed().is_ok_and(|age| age > MADE_WITHIN);
    if !is_old || file.try_lock().is_err() {
        return Ok(());
    }
    if is_folder { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }
}

fn is_ours(name: &str, suffix: &str) -> bool {
    let random = name.strip_prefix(PREFIX).and_then(|rest| rest.strip_suffix(suffix));
    random.is_some_and(|text| text.len() == RANDOM && text.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}
