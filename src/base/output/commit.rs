//! Renames several files into their places so that all of them are there, or none.
//!
//! In: whole files beside their places, and files of an earlier run that are to go. What stands in the places gets a second name
//! first; if a rename or the sync of a folder fails, all are taken back. Between the first rename and the last nothing is
//! allocated. A process that is killed between two renames can leave some of each.

use super::leftovers::aside;
use super::place::{folder_of, sync};
use std::fs::File;
use std::io::{Error, Result};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Renames that are prepared; dropping them takes back those that are done.
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
                crate::base::notice::notice!(
                    "error: {}: cannot be put back as it was: {error}",
                    place.display()
                );
            }
        }
    }
}
