//! The cache folder: files for scenes that have no folder of their own. All of them can be made again.

use super::diagnostic::notice;
use std::fs::File;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::SystemTime;

/// A folder that this user can write to, made where it is missing: `greenstage` in `$XDG_CACHE_HOME`, else in `~/.cache`, else,
/// with a note, a folder of this user's below that for temporary files.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let absolute =
            |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
        let usual = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")));
        let usual = usual.map(|folder| folder.join("greenstage"));
        if let Some(folder) = usual.clone().filter(|folder| is_ours(folder)) {
            return folder;
        }
        // SAFETY: getuid reads a number of the process and cannot fail.
        let user = unsafe { libc::getuid() };
        let temporary = std::env::temp_dir().join(format!("greenstage-{user}"));
        let why =
            usual.map_or("no HOME is set".into(), |folder| format!("{} cannot be written", folder.display()));
        notice!("note: {why}: what is computed goes to {}", temporary.display());
        is_ours(&temporary);
        temporary
    })
}

/// Whether the folder is there, belongs to this user, and takes files.
fn is_ours(folder: &Path) -> bool {
    let made = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder);
    // SAFETY: geteuid reads a number of the process and cannot fail.
    let user = unsafe { libc::geteuid() };
    let owned = std::fs::symlink_metadata(folder).is_ok_and(|found| found.is_dir() && found.uid() == user);
    made.is_ok() && owned && tempfile::tempfile_in(folder).is_ok()
}

/// Version, size, time and number of the file of the running program, even where another has taken its place: they differ between two
/// builds, and results of one are nothing to another. `None` where the system does not tell.
pub fn program() -> Option<String> {
    let file = std::fs::metadata("/proc/self/exe").or_else(|_| std::env::current_exe()?.metadata()).ok()?;
    let [seconds, nanoseconds] = [file.mtime(), file.mtime_nsec()];
    Some(format!("{} {} {seconds} {nanoseconds} {}", env!("CARGO_PKG_VERSION"), file.len(), file.ino()))
}

/// Removes files whose names begin with `prefix`, the least recently used ones first, until all of them take no more than `most` bytes.
/// `used` stays, and counts as used now.
pub fn trim(prefix: &str, used: &str, most: u64) {
    trim_in(folder(), prefix, used, most);
}

fn trim_in(folder: &Path, prefix: &str, used: &str, most: u64) {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Ok(found) = entry.metadata() else { continue };
        let name = entry.file_name();
        if !found.is_file() || !name.as_encoded_bytes().starts_with(prefix.as_bytes()) {
            continue;
        }
        let mut time = found.modified().ok();
        if name == used {
            time = Some(SystemTime::now());
            // A failure changes no result.
            let _ = File::options()
                .append(true)
                .open(entry.path())
                .and_then(|file| file.set_modified(SystemTime::now()));
        }
        all.push((time, found.len(), entry.path()));
    }
    all.sort();
    let mut total: u64 = all.iter().map(|(_, size, _)| size).sum();
    for (_, size, path) in all {
        if total <= most || path.ends_with(used) {
            break;
        }
        // Another process may have removed it.
        let _ = std::fs::remove_file(path);
        total -= size;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_made_and_a_file_is_none() {
        let place = tempfile::tempdir().unwrap();
        assert!(is_ours(&place.path().join("a/b")));
        std::fs::write(place.path().join("file"), "").unwrap();
        assert!(!is_ours(&place.path().join("file")) && !is_ours(&place.path().join("file/c")));
    }

    #[test]
    fn the_files_not_used_for_longest_are_removed() {
        let place = tempfile::tempdir().unwrap();
        for (name, age) in [("a-1", 4), ("a-2", 3), ("b", 2), ("a-3", 1)] {
            std::fs::write(place.path().join(name), [0; 10]).unwrap();
            let file = File::options().append(true).open(place.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - std::time::Duration::from_secs(age)).unwrap();
        }
        let left = || {
            let names = std::fs::read_dir(place.path()).unwrap().map(|entry| entry.unwrap().file_name());
            let mut names: Vec<_> = names.map(|name| name.into_string().unwrap()).collect();
            names.sort();
            names
        };
        trim_in(place.path(), "a-", "a-1", 30);
        assert_eq!(left(), ["a-1", "a-2", "a-3", "b"]);
        trim_in(place.path(), "a-", "a-4", 20);
        assert_eq!(left(), ["a-1", "a-3", "b"]);
        trim_in(place.path(), "a-", "a-3", 5);
        assert_eq!(left(), ["a-3", "b"]);
    }
}
