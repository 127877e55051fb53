//! The steps of writing a file: a temporary file beside the result, the place where its bytes go, and the renaming; and the
//! removal of temporary files that killed runs left behind.
//!
//! `.greenstage-XXXXXX.part` is a file, `.greenstage-XXXXXX.scratch` a folder of files for one run. The
//! process that makes one holds a lock on it, which the system releases however the process ends. The next
//! run that writes into the folder removes everything of such a name that is not locked and was not changed for a minute.
//!
//! A [`Place`] is the file at the end of all symbolic links, or a device or pipe. [`Renames`] puts several files into their
//! places so that all of them are there, or none.

use std::collections::BTreeSet;
use std::fs::{DirEntry, File, Permissions};
use std::io::{Error, ErrorKind, Result};
use std::os::fd::AsFd;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
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

/// Renames of whole files into their places, and of files of an earlier run that are removed. What stands in a place gets a
/// second name first; if a rename or the sync of a folder fails, or these are dropped, all renames are taken back. Between
/// the first rename and the last nothing is allocated. A process that is killed between two renames can leave some of each.
pub struct Renames(Vec<Rename>);

struct Rename {
    place: PathBuf,
    /// The new file, until it is in its place; `None` where nothing takes the place.
    beside: Option<TempPath>,
    /// A second name of the former file, if there was any and its file system has hard links.
    kept: Option<TempPath>,
    is_done: bool,
}

impl Renames {
    /// `new` are places with the files that come there, `gone` those of files that are removed.
    pub fn prepare(new: Vec<(PathBuf, TempPath)>, gone: &[PathBuf]) -> Renames {
        let one = |place: PathBuf, beside: Option<TempPath>| {
            let kept = aside(folder_of(&place), |path| std::fs::hard_link(&place, path)).ok();
            Rename { place, beside, kept, is_done: false }
        };
        let new = new.into_iter().map(|(place, beside)| one(place, Some(beside)));
        let (mut all, old): (Vec<Rename>, Vec<Rename>) =
            (new.collect(), gone.iter().map(|place| one(place.clone(), None)).collect());
        all.extend(old);
        Renames(all)
    }

    /// Puts all in their places.
    ///
    /// # Errors
    /// The place at which it failed; every file stands as before.
    pub fn commit(mut self) -> std::result::Result<(), (PathBuf, Error)> {
        for rename in &mut self.0 {
            let put = match rename.beside.take() {
                Some(beside) => put(beside, &rename.place),
                None => std::fs::remove_file(&rename.place),
            };
            put.map_err(|error| (rename.place.clone(), error))?;
            rename.is_done = true;
        }
        let mut synced = None;
        for rename in &self.0 {
            let folder = folder_of(&rename.place);
            if synced != Some(folder) {
                let sync = File::open(folder).and_then(|folder| sync(&folder));
                sync.map_err(|error| (rename.place.clone(), error))?;
                synced = Some(folder);
            }
        }
        // What stood there before is removed for good.
        self.0.clear();
        Ok(())
    }
}

/// Renames by the C library, whose calls a test lets fail.
fn put(from: TempPath, to: &Path) -> Result<()> {
    std::fs::rename(&from, to)?;
    // Nothing of that name is left to remove, and keeping it cannot fail.
    let _ = from.keep();
    Ok(())
}

impl Drop for Renames {
    fn drop(&mut self) {
        for Rename { place, kept, .. } in self.0.drain(..).rev().filter(|rename| rename.is_done) {
            let back = match kept {
                Some(kept) => put(kept, &place),
                None => std::fs::remove_file(&place),
            };
            if let Err(error) = back {
                crate::base::diagnostic::notice!(
                    "error: {}: cannot be put back as it was: {error}",
                    place.display()
                );
            }
        }
    }
}
