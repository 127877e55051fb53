//! Writes files so that each is there whole or not at all, and never overwrites a file of another kind.
//!
//! In: a path, the [`Kind`] of the file, and what makes its bytes. Out: a temporary file beside the place, flushed and
//! synced, then renamed, and the folder synced (POSIX rename(2) is atomic within a file system). The file keeps the
//! permissions of the one before it; symbolic links stay and their target is replaced; devices, pipes and open
//! descriptors are written to and never replaced.
//!
//! An existing file is overwritten only where it is empty or its first bytes are those of the kind being written.
//! [`try_path`] checks all of this before the work; [`stage`] and [`put_all`] write several files of which all or none
//! are there; [`stream`] writes a file that grows for a long time.
mod temporary;

pub use temporary::Scratch;

use super::signal::{self, OnEnd};
use std::fs::File;
use std::io::{BufWriter, ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::NamedTempFile;
use temporary::{Place, Renames, folder_of, sync, temporary};

/// A kind of file, by which code decides whether it may overwrite one.
#[derive(Debug)]
pub struct Kind {
    /// The name with its article: "a .green file".
    pub name: &'static str,
    /// Whether these are the first bytes of such a file, at most [`HEAD`]. It is never called for an empty file.
    pub recognizes: fn(&[u8]) -> bool,
}

/// Number of bytes from the start of a file that are read to recognise its kind.
pub const HEAD: u64 = 16 * 1024;

/// The reason why a file is not written, or could not be.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error(
        "{}: the existing file is not {kind} (it begins with \"{begins}\") and is not overwritten; name another file, \
         or remove this one",
        path.display()
    )]
    Foreign { path: PathBuf, kind: &'static str, begins: String },
    #[error("{}: this run reads that file, and does not overwrite it; name another file", path.display())]
    Input { path: PathBuf },
    #[error("{}: another run is writing that file; name another file, or wait until that run ends", path.display())]
    Busy { path: PathBuf },
    #[error("{}: is a folder; name a file in it", path.display())]
    Folder { path: PathBuf },
    #[error("{}: cannot be written: the folder {} is not there; make it, or name another place", path.display(), folder.display())]
    NoFolder { path: PathBuf, folder: PathBuf },
    #[error("{}: cannot be written: {source}; name another place", path.display())]
    Closed { path: PathBuf, source: std::io::Error },
    #[error("cannot make the folder {}: {source}; name another place", path.display())]
    Unmade { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be written: {source}; the existing file is unchanged", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be written to: {source}", path.display())]
    Stream { path: PathBuf, source: std::io::Error },
}

impl OutputError {
    /// Whether the request is to blame, rather than the work: all that is found before the work.
    pub fn is_request(&self) -> bool {
        !matches!(self, OutputError::Write { .. } | OutputError::Stream { .. })
    }

    fn of_place(path: &Path, source: std::io::Error) -> OutputError {
        let path = path.to_owned();
        let folder = || folder_of(&path).to_owned();
        match source.kind() {
            ErrorKind::IsADirectory => OutputError::Folder { path },
            ErrorKind::NotFound if !folder().exists() => OutputError::NoFolder { folder: folder(), path },
            _ => OutputError::Closed { path, source },
        }
    }
}

/// Whether a file of that kind can be written at `path`, without writing it: its folder is there and takes files, what
/// stands there may be overwritten, and is none of the files that the run reads. Commands call this before they work.
pub fn try_path(path: &Path, kind: &Kind, inputs: &[PathBuf]) -> Result<(), OutputError> {
    let Place::File(target) = look(path, kind, inputs)? else { return Ok(()) };
    let closed = |source| OutputError::of_place(path, source);
    match File::options().write(true).open(&target) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(closed(error)),
        _ => {}
    }
    temporary(folder_of(&target)).map(drop).map_err(closed)
}

/// Whether what stands at `path` may be overwritten by a file of that kind, and is none of `inputs`; nothing is tried.
pub fn may_replace(path: &Path, kind: &Kind, inputs: &[PathBuf]) -> Result<(), OutputError> {
    look(path, kind, inputs).map(drop)
}

/// Makes a folder, and those on the way, before the work that is to fill it.
pub fn make_folder(folder: &Path) -> Result<(), OutputError> {
    if folder.as_os_str().is_empty() {
        return Ok(());
    }
    std::fs::create_dir_all(folder).map_err(|source| OutputError::Unmade { path: folder.to_owned(), source })
}

/// The folder that a file of this name is in.
pub fn make_folder_of(path: &Path) -> Result<(), OutputError> {
    make_folder(folder_of(path))
}

/// Whether a file of that kind stands at `path`, by its first bytes.
pub fn is(path: &Path, kind: &Kind) -> bool {
    let Ok(Place::File(target)) = Place::find(path) else { return false };
    File::open(target).and_then(head).is_ok_and(|head| !head.is_empty() && (kind.recognizes)(&head))
}

fn head(file: File) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // No more than it has: some files of /proc wait for ever.
    let length = file.metadata()?.len();
    file.take(HEAD.min(length)).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Finds the place for the bytes of `path`.
fn look(path: &Path, kind: &Kind, inputs: &[PathBuf]) -> Result<Place, OutputError> {
    let closed = |source| OutputError::of_place(path, source);
    let place = Place::find(path).map_err(closed)?;
    let Place::File(target) = &place else { return Ok(place) };
    if inputs.iter().any(|input| temporary::is_same(input, target)) {
        return Err(OutputError::Input { path: path.to_owned() });
    }
    let file = match File::open(target) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(place),
        file => file.map_err(closed)?,
    };
    if is_locked(&file) {
        return Err(OutputError::Busy { path: path.to_owned() });
    }
    let head = head(file).map_err(closed)?;
    if head.is_empty() || (kind.recognizes)(&head) {
        return Ok(place);
    }
    let line = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let begins = String::from_utf8_lossy(&line[..line.len().min(40)]).escape_debug().to_string();
    Err(OutputError::Foreign { path: path.to_owned(), kind: kind.name, begins })
}

/// Whether another run holds the lock of a file. A process that is just being started holds for a moment what its parent
/// had open, so a lock counts only when it lasts.
fn is_locked(file: &File) -> bool {
    const TRIES: u32 = 10;
    (0..TRIES).all(|again| {
        if again > 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
        matches!(file.try_lock_shared(), Err(std::fs::TryLockError::WouldBlock))
    })
}

/// A whole file that is not yet in its place; dropping it removes it.
#[derive(Debug)]
pub struct Staged {
    /// The path as the user names it.
    path: PathBuf,
    place: Place,
    file: NamedTempFile,
    /// A signal to end removes the file and says so.
    unwritten: OnEnd,
}

/// Writes a file beside its place and syncs it. The bytes for a device or a pipe wait in the system's folder for
/// temporary files.
pub fn stage(
    path: &Path,
    kind: &Kind,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<Staged, OutputError> {
    let place = look(path, kind, &[])?;
    let mut file = match &place {
        Place::File(target) => temporary(folder_of(target)),
        Place::Stream(_) => NamedTempFile::new(),
    }
    .map_err(|source| OutputError::of_place(path, source))?;
    let (beside, named) = (file.path().to_owned(), path.display().to_string());
    let unwritten = signal::on_end(move || {
        // It may be gone already.
        let _ = std::fs::remove_file(beside);
        Some(format!("{named} was not written"))
    });
    let mut buffer = BufWriter::new(file.as_file_mut());
    let written = write(&mut buffer).and_then(|()| buffer.flush());
    drop(buffer);
    written
        .and_then(|()| file.as_file().sync_all())
        .map_err(|source| OutputError::Write { path: path.to_owned(), source })?;
    Ok(Staged { path: path.to_owned(), place, file, unwritten })
}

impl Staged {
    /// The path of the bytes now, for checking them before they are put in place.
    pub fn now_at(&self) -> &Path {
        self.file.path()
    }

    /// Puts it in its place, for good.
    pub fn put(self) -> Result<(), OutputError> {
        put_all(vec![self], &[]).map(drop)
    }
}

/// Puts all of `staged` in their places and removes `gone`. Returns the files, each open at its end; `None` for those that
/// went into a device or a pipe.
///
/// # Errors
/// Every file stands as before. A device or a pipe may have some of its bytes.
pub fn put_all(staged: Vec<Staged>, gone: &[PathBuf]) -> Result<Vec<Option<File>>, OutputError> {
    let (mut unwritten, mut files, mut new) = (Vec::new(), Vec::new(), Vec::new());
    for Staged { path, place, file, unwritten: act } in staged {
        match place {
            Place::File(target) => {
                temporary::keep_attributes(&target, file.as_file())
                    .map_err(|source| OutputError::Write { path: path.clone(), source })?;
                let (file, beside) = file.into_parts();
                files.push(Some(file));
                new.push((target, beside));
            }
            Place::Stream(to) => {
                let failed = |source| OutputError::Stream { path: path.clone(), source };
                let mut bytes = file.into_file();
                bytes.rewind().map_err(failed)?;
                let mut device = temporary::open_stream(&to).map_err(failed)?;
                std::io::copy(&mut bytes, &mut device).map_err(failed)?;
                files.push(None);
            }
        }
        unwritten.push(act);
    }
    let renames = Renames::prepare(new, gone);
    signal::settle(unwritten, || renames.commit())
        .map_err(|(path, source)| OutputError::Write { path, source })?;
    Ok(files)
}

/// Writes one file by [`stage`] and [`Staged::put`].
pub fn write(
    path: &Path,
    kind: &Kind,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), OutputError> {
    stage(path, kind, write)?.put()
}

/// A file that grows for a long time under its own name.
#[derive(Debug)]
pub struct Stream(File);

/// Starts a file that grows: what stood there is replaced once `head` is written, and all that follows is there as it
/// is handed over, so that a run which is killed keeps it. Nobody else writes the file meanwhile.
pub fn stream(path: &Path, kind: &Kind, head: &[u8]) -> Result<Stream, OutputError> {
    match look(path, kind, &[])? {
        Place::File(_) => {
            let file = put_all(vec![stage(path, kind, |file| file.write_all(head))?], &[])?.pop().flatten();
            let missing = || OutputError::of_place(path, ErrorKind::NotFound.into());
            file.map(Stream).ok_or_else(missing)
        }
        Place::Stream(to) => {
            let failed = |source| OutputError::Stream { path: path.to_owned(), source };
            let mut device = temporary::open_stream(&to).map_err(failed)?;
            device.write_all(head).map_err(failed)?;
            Ok(Stream(device))
        }
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    /// Syncs the file to the disk, if it is on one.
    fn flush(&mut self) -> std::io::Result<()> {
        sync(&self.0)
    }
}

#[cfg(test)]
mod tests;
