//! Puts several files in their places so that all of them are there, or none.
//!
//! In: whole files beside their places, and files of an earlier run that are to go. Out: the files in their places. What
//! stood there keeps a second name until every rename and the folders' sync have succeeded; if one fails, all are
//! taken back. A process that is killed between two renames can leave some of each.

use super::leftovers::aside;
use super::place::{self, Place, folder_of};
use super::{OutputError, Staged, sync};
use crate::base::signal;
use std::fs::File;
use std::io::{Error, Result, Seek};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Puts all of `staged` in their places and removes `gone`. Returns the files, each open at its end; `None` for those that
/// went into a device or a pipe.
///
/// # Errors
/// Every file stands as before. A device or a pipe may have some of its bytes.
pub fn put_all(staged: Vec<Staged>, gone: &[PathBuf]) -> std::result::Result<Vec<Option<File>>, OutputError> {
    let (mut unwritten, mut parts) = (Vec::new(), Vec::new());
    for Staged { path, place, file, unwritten: act } in staged {
        match place {
            Place::File(target) => {
                place::keep_attributes(&target, file.as_file())
                    .map_err(|source| OutputError::Write { path: path.clone(), source })?;
                parts.push(Some((path, target, file)));
            }
            Place::Stream(to) => {
                let failed = |source| OutputError::Stream { path: path.clone(), source };
                let mut bytes = file.into_file();
                bytes.rewind().map_err(failed)?;
                let mut device = place::open_stream(&to).map_err(failed)?;
                std::io::copy(&mut bytes, &mut device).map_err(failed)?;
                parts.push(None);
            }
        }
        unwritten.push(act);
    }
    signal::settle(unwritten, || {
        let (mut done, mut files) = (Done::default(), Vec::new());
        for part in parts {
            let Some((path, target, file)) = part else {
                files.push(None);
                continue;
            };
            let failed = |source| OutputError::Write { path: path.clone(), source };
            done.keep(&target);
            let (file, beside) = file.into_parts();
            rename(beside, &target).map_err(failed)?;
            done.replaced(target);
            files.push(Some(file));
        }
        for path in gone {
            done.remove(path).map_err(|source| OutputError::Write { path: path.clone(), source })?;
        }
        done.sync().map_err(|(path, source)| OutputError::Write { path, source })?;
        done.succeed();
        Ok(files)
    })
}

/// By the C library, as all other calls that a test lets fail.
fn rename(from: TempPath, to: &Path) -> Result<()> {
    std::fs::rename(&from, to)?;
    // Nothing of that name is left to remove, and keeping it cannot fail.
    let _ = from.keep();
    Ok(())
}

/// What was renamed so far; dropping it takes that back.
#[derive(Default)]
struct Done {
    /// A second name of what stands where the next file comes.
    kept: Option<TempPath>,
    /// Each place, and the second name of what stood there.
    changed: Vec<(PathBuf, Option<TempPath>)>,
}

impl Done {
    /// Keeps what stands at `target`, if anything does and its file system has hard links.
    fn keep(&mut self, target: &Path) {
        self.kept = aside(folder_of(target), |path| std::fs::hard_link(target, path)).ok();
    }

    fn replaced(&mut self, target: PathBuf) {
        self.changed.push((target, self.kept.take()));
    }

    fn remove(&mut self, path: &Path) -> Result<()> {
        let kept = aside(folder_of(path), |aside| std::fs::rename(path, aside))?;
        self.changed.push((path.to_owned(), Some(kept)));
        Ok(())
    }

    /// Syncs every folder in which something has changed.
    fn sync(&self) -> std::result::Result<(), (PathBuf, Error)> {
        let mut folders: Vec<(&Path, &PathBuf)> =
            self.changed.iter().map(|(path, _)| (folder_of(path), path)).collect();
        folders.dedup_by_key(|(folder, _)| *folder);
        folders.into_iter().try_for_each(|(folder, path)| {
            File::open(folder).and_then(|folder| sync(&folder)).map_err(|error| (path.clone(), error))
        })
    }

    /// What stood there before is removed for good.
    fn succeed(mut self) {
        self.changed.clear();
    }
}

impl Drop for Done {
    fn drop(&mut self) {
        for (path, kept) in self.changed.drain(..).rev() {
            let back = match kept {
                Some(kept) => rename(kept, &path),
                None => std::fs::remove_file(&path),
            };
            if let Err(error) = back {
                crate::base::notice::notice!(
                    "error: {}: cannot be put back as it was: {error}",
                    path.display()
                );
            }
        }
    }
}
