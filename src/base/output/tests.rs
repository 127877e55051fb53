//! Files are written whole or not at all, only over files of their kind, through links and into pipes; leftovers go.

use super::*;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::time::{Duration, SystemTime};
use tempfile::TempDir;

const LIST: Kind = Kind { name: "a list", recognizes: |head| head.starts_with(b"list") };

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn put(path: &Path, text: &str) -> Result<(), OutputError> {
    write(path, &LIST, |file| file.write_all(text.as_bytes()))
}

fn names(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn a_file_of_another_kind_is_never_overwritten() {
    let folder = folder();
    let path = folder.path().join("a");
    put(&path, "list 1").unwrap();
    put(&path, "list 2").unwrap();
    std::fs::write(&path, "").unwrap();
    put(&path, "list 3").unwrap();
    std::fs::write(&path, "[scene]\nlist").unwrap();
    for refused in [try_path(&path, &LIST, &[]), may_replace(&path, &LIST, &[]), put(&path, "list 4")] {
        let error = refused.unwrap_err();
        let said = error.to_string();
        assert!(said.contains("is not a list (it begins with \"[scene]\")") && error.is_request(), "{said}");
        assert!(said.contains("name another file, or remove this one"), "{said}");
    }
    assert_eq!(text(&path), "[scene]\nlist");
    assert_eq!(names(folder.path()), ["a"]);
}

#[test]
fn what_a_run_reads_is_not_overwritten_under_any_name() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    put(&at("read"), "list").unwrap();
    symlink("read", at("link")).unwrap();
    std::fs::hard_link(at("read"), at("twin")).unwrap();
    for name in ["read", "./read", "link", "twin"] {
        let refused = try_path(&at(name), &LIST, &[at("missing"), at("read")]);
        assert!(matches!(refused, Err(OutputError::Input { .. })), "{name}: {refused:?}");
    }
    try_path(&at("read"), &LIST, &[at("other")]).unwrap();
}

#[test]
fn a_write_that_fails_leaves_what_was_there() {
    let folder = folder();
    let (first, second) = (folder.path().join("a"), folder.path().join("b"));
    put(&first, "list 1").unwrap();
    let full = |file: &mut dyn Write| {
        file.write_all(b"list, half of it")?;
        Err(ErrorKind::StorageFull.into())
    };
    let error = write(&first, &LIST, full).unwrap_err();
    assert!(!error.is_request(), "{error}");
    // Of several files none is put where one fails.
    let staged = stage(&first, &LIST, |file| file.write_all(b"list 2")).unwrap();
    assert!(stage(&second, &LIST, full).is_err());
    assert_eq!(names(folder.path()).len(), 2, "the staged one and the old one");
    drop(staged);
    assert_eq!(names(folder.path()), ["a"]);
    assert_eq!(text(&first), "list 1");
}

/// The first file was new and the second old.
#[test]
fn a_rename_that_fails_takes_the_others_back() {
    let folder = folder();
    let [first, second, third, gone] = ["a", "b", "c", "d"].map(|name| folder.path().join(name));
    for path in [&first, &gone] {
        put(path, "list 1").unwrap();
    }
    let staged: Vec<Staged> = [&first, &second, &third]
        .map(|path| stage(path, &LIST, |file| file.write_all(b"list 2")).unwrap())
        .into();
    std::fs::create_dir(&third).unwrap();
    assert!(put_all(staged, std::slice::from_ref(&gone)).is_err());
    assert_eq!((text(&first).as_str(), text(&gone).as_str()), ("list 1", "list 1"));
    assert_eq!(names(folder.path()), ["a", "c", "d"]);
    let staged = stage(&first, &LIST, |file| file.write_all(b"list 2")).unwrap();
    put_all(vec![staged], &[gone]).unwrap();
    assert_eq!(
        (text(&first).as_str(), names(folder.path())),
        ("list 2", vec!["a".to_owned(), "c".to_owned()])
    );
}

#[test]
fn links_stay_and_permissions_are_kept() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("there")).unwrap();
    symlink("there/second", at("first")).unwrap();
    symlink("target", at("there/second")).unwrap();
    put(&at("first"), "list 1").unwrap();
    assert_eq!(text(&at("there/target")), "list 1", "a link to nothing yet");
    std::fs::set_permissions(at("there/target"), std::fs::Permissions::from_mode(0o640)).unwrap();
    put(&at("first"), "list 2").unwrap();
    assert_eq!(text(&at("there/target")), "list 2");
    assert_eq!(std::fs::metadata(at("there/target")).unwrap().permissions().mode() & 0o7777, 0o640);
    assert!(["first", "there/second"].iter().all(|name| at(name).symlink_metadata().unwrap().is_symlink()));
    assert_eq!(names(folder.path()), ["first", "there"]);

    std::fs::write(at("usual"), "").unwrap();
    put(&at("new"), "list").unwrap();
    let mode = |name: &str| std::fs::metadata(at(name)).unwrap().permissions().mode();
    assert_eq!(mode("new"), mode("usual"), "as the umask says");
    symlink("circle", at("circle")).unwrap();
    assert!(put(&at("circle"), "list").unwrap_err().to_string().contains("circle of symbolic links"));
}

#[test]
fn a_pipe_is_written_to_and_stays_a_pipe() {
    let folder = folder();
    let pipe = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let link = folder.path().join("link");
    symlink("pipe", &link).unwrap();
    try_path(&pipe, &LIST, std::slice::from_ref(&pipe)).unwrap();
    assert!(!is(&pipe, &LIST), "and nobody waits for its reader");
    for path in [&pipe, &link] {
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || std::fs::read_to_string(pipe).unwrap()
        });
        put(path, "anything").unwrap();
        assert_eq!(reader.join().unwrap(), "anything");
    }
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || std::fs::read_to_string(pipe).unwrap()
    });
    let mut growing = stream(&pipe, &LIST, b"one").unwrap();
    growing.write_all(b", two").and_then(|()| growing.flush()).unwrap();
    drop(growing);
    assert_eq!(reader.join().unwrap(), "one, two");
    assert!(pipe.symlink_metadata().unwrap().file_type().is_fifo());
    assert_eq!(names(folder.path()), ["link", "pipe"]);
}

#[test]
fn a_place_that_takes_no_file_is_refused_before_the_work() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let refused = |path: &Path| {
        let error = try_path(path, &LIST, &[]).unwrap_err();
        assert!(error.is_request());
        error.to_string()
    };
    let said = refused(&at("no/a"));
    assert!(said.contains("no is not there; make it, or name another place"), "{said}");
    std::fs::create_dir(at("yes")).unwrap();
    for path in [at("yes"), at("new/"), at("yes/..")] {
        assert!(refused(&path).contains("is a folder; name a file in it"), "{}", path.display());
    }
    put(&at("file"), "list").unwrap();
    assert!(refused(&at("file/a")).contains("cannot be written"));
    if cfg!(target_os = "linux") {
        // Even root makes no files there.
        assert!(refused(Path::new("/proc/a")).contains("cannot be written"));
    }
    make_folder_of(&at("made/on/the/way")).unwrap();
    try_path(&at("made/on/the/way"), &LIST, &[]).unwrap();
    assert!(make_folder(&at("file/a")).unwrap_err().to_string().contains("cannot make the folder"));
    assert_eq!(names(&at("made/on/the")), [""; 0], "trying leaves nothing");
}

#[test]
fn what_a_killed_run_left_is_removed_and_nothing_else() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let left = [".greenstage-0aB9zZ.part", ".greenstage-000000.scratch/in/a"];
    let held = [".greenstage-held00.part", ".greenstage-held00.scratch/a"];
    let foreign =
        [".greenstage-notes.part", ".greenstage-0aB9z-.part", ".greenstage-abcdef", "greenstage-abcdef.part"];
    for name in left.iter().chain(&held).chain(&foreign).chain(&[".greenstage-young0.part"]) {
        std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
        std::fs::write(at(name), "list").unwrap();
    }
    std::fs::create_dir(at(".greenstage-folder.part")).unwrap();
    symlink("greenstage-abcdef.part", at(".greenstage-link00.part")).unwrap();
    let long_ago = SystemTime::now() - Duration::from_secs(3600);
    let all = names(folder.path());
    for name in all.iter().filter(|name| !name.contains("young")) {
        File::open(at(name)).unwrap().set_modified(long_ago).unwrap();
    }
    let locks = held.map(|name| File::open(at(name.split('/').next().unwrap())).unwrap());
    locks.iter().for_each(|lock| lock.try_lock().unwrap());
    put(&at("a"), "list").unwrap();
    let gone = |name: &String| left.iter().any(|left| left.split('/').next() == Some(name));
    let mut expected: Vec<String> = all.into_iter().filter(|name| !gone(name)).collect();
    expected.push("a".into());
    expected.sort();
    assert_eq!(names(folder.path()), expected);
}

#[test]
fn a_scratch_folder_goes_with_all_that_is_in_it() {
    let folder = folder();
    let scratch = Scratch::in_folder(folder.path()).unwrap();
    std::fs::write(scratch.path().join("a"), "list").unwrap();
    assert!(File::open(scratch.path()).unwrap().try_lock().is_err(), "nobody sweeps it meanwhile");
    drop(scratch);
    assert!(names(folder.path()).is_empty());
}

#[test]
fn what_grows_is_there_as_it_is_handed_over_and_has_one_writer() {
    let folder = folder();
    let path = folder.path().join("a");
    put(&path, "list of an earlier run").unwrap();
    let mut growing = stream(&path, &LIST, b"list 1\n").unwrap();
    assert_eq!(text(&path), "list 1\n");
    growing.write_all(b"2\n").unwrap();
    assert_eq!(text(&path), "list 1\n2\n", "a run that is killed now keeps it");
    for refused in [try_path(&path, &LIST, &[]), stream(&path, &LIST, b"list").map(drop)] {
        assert!(matches!(refused, Err(OutputError::Busy { .. })), "{refused:?}");
    }
    growing.flush().unwrap();
    drop(growing);
    assert_eq!(names(folder.path()), ["a"]);
    stream(&path, &LIST, b"list 3").unwrap();
    assert_eq!(text(&path), "list 3");
}
