//! The cache folder: files for scenes that have no folder of their own. All of them can be made again.

use super::diagnostic::notice;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

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
}
