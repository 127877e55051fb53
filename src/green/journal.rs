//! Finished results of a precomputation, kept next to its .green file until that is written: `tube.green.part`.
//!
//! In: results of solves, each with a key that says what was solved. Out: those of a run that was killed, in the next one.
//! The file holds a head and records, one behind the other, and is only ever appended to:
//!
//! ```text
//! head     "greenstage columns, format 1\n", blake3 of the scene's fingerprints                29 + 32 bytes
//! record   blake3 of all that follows, key, length of the content, content                     32 + 32 + 8 + … bytes
//! ```
//!
//! A process that is killed leaves a torn record at the end, which is cut off; the system keeps what was written (unless its
//! power fails, against which the checksums stand). A journal of another state of the scene or another version is dropped.

use crate::base::diagnostic::notice;
use crate::base::input;
use crate::base::output::Kind;
use crate::base::table::bytes;
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A run that takes no longer keeps nothing, and pays nothing.
pub const KEPT_AFTER: Duration = Duration::from_secs(2);

const KIND: Kind = Kind { name: "a list of finished columns", recognizes: is_journal };
const MAGIC: &[u8] = b"greenstage columns, format ";
const FORMAT: &[u8] = b"1\n";
const HEAD: usize = MAGIC.len() + FORMAT.len() + 32;
/// Checksum, key and length.
const RECORD: usize = 32 + 32 + 8;

fn is_journal(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// Key of a result.
pub type Key = [u8; 32];

/// The finished results of a run and of those before it that were killed.
pub struct Journal<'a> {
    path: PathBuf,
    /// blake3 of the fingerprints of all bodies, found when it is needed.
    identity: &'a dyn Fn() -> Option<Key>,
    started: Instant,
    kept_after: Duration,
    state: Mutex<State>,
}

enum State {
    /// A journal without a file yet.
    Empty,
    Open(Records),
    /// A journal that keeps nothing in this run.
    Closed,
}

struct Records {
    file: File,
    /// Offset of the next record.
    end: u64,
    /// Offset and length of each content.
    contents: BTreeMap<Key, (u64, usize)>,
}

impl<'a> Journal<'a> {
    /// The journal next to a .green file, with the results that a killed run left there, which a notice reports. `identity`
    /// computes the hash of the scene's state.
    pub fn new(green: &Path, kept_after: Duration, identity: &'a dyn Fn() -> Option<Key>) -> Journal<'a> {
        let is_place =
            std::fs::metadata(green).map_or_else(|e| e.kind() == ErrorKind::NotFound, |m| m.is_file());
        let path = path_of(green);
        if !is_place {
            return Journal::of(path, kept_after, identity, State::Closed);
        }
        let journal = Journal::at(path, kept_after, identity);
        if let State::Open(records) = &*journal.state()
            && !records.contents.is_empty()
        {
            let (count, size) = (records.contents.len(), bytes(records.end as f64));
            let results = if count == 1 { "result" } else { "results" };
            notice!(
                "{}: {count} finished {results} of a run that was ended ({size}) are taken up",
                journal.path.display()
            );
        }
        journal
    }

    /// The journal at this path, with what is there.
    pub fn at(path: PathBuf, kept_after: Duration, identity: &'a dyn Fn() -> Option<Key>) -> Journal<'a> {
        let state = found(&path, identity);
        Journal::of(path, kept_after, identity, state)
    }

    fn of(
        path: PathBuf,
        kept_after: Duration,
        identity: &'a dyn Fn() -> Option<Key>,
        state: State,
    ) -> Journal<'a> {
        Journal { path, identity, started: Instant::now(), kept_after, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether there may be something to find.
    pub fn has_records(&self) -> bool {
        matches!(&*self.state(), State::Open(records) if !records.contents.is_empty())
    }

    /// Whether there is a content under this key.
    pub fn has(&self, key: &Key) -> bool {
        matches!(&*self.state(), State::Open(records) if records.contents.contains_key(key))
    }

    /// Whether a result that is finished now is kept.
    pub fn is_kept(&self) -> bool {
        match &*self.state() {
            State::Closed => false,
            State::Empty | State::Open(_) => self.started.elapsed() >= self.kept_after,
        }
    }

    /// The content under this key.
    pub fn find(&self, key: &Key) -> Option<Vec<u8>> {
        let state = self.state();
        let State::Open(records) = &*state else { return None };
        let (at, length) = *records.contents.get(key)?;
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(length).ok()?;
        bytes.resize(length, 0);
        records.file.read_exact_at(&mut bytes, at).ok()?;
        Some(bytes)
    }

    /// Appends a content, given in parts. Where that fails nothing more is kept, and the file is removed: the .green file may
    /// need its place.
    pub fn keep(&self, key: &Key, content: &[&[u8]]) {
        let mut state = self.state();
        let kept = match &mut *state {
            State::Closed => return,
            State::Open(records) => records.append(key, content),
            State::Empty => created(&self.path, self.identity).and_then(|mut records| {
                let kept = records.append(key, content);
                *state = State::Open(records);
                kept
            }),
        };
        if let Err(error) = kept {
            if matches!(&*state, State::Open(_)) {
                // It may be gone already.
                let _ = std::fs::remove_file(&self.path);
            }
            *state = State::Closed;
            // Another run may have it.
            if ![ErrorKind::ResourceBusy, ErrorKind::AlreadyExists].contains(&error.kind()) {
                notice!("{}: finished results are not kept: {error}", self.path.display());
            }
        }
    }

    /// Removes the file, when the .green file is there.
    pub fn remove(&self) {
        let mut state = self.state();
        if matches!(&*state, State::Open(_)) {
            let _ = std::fs::remove_file(&self.path);
        }
        *state = State::Closed;
    }
}

/// The journal's place.
pub fn path_of(green: &Path) -> PathBuf {
    let mut name = green.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

/// Removes the journal of a .green file that is finished or to be made from the beginning; says so where asked.
pub fn drop_journal(green: &Path, why: Option<&str>) {
    let path = path_of(green);
    if !crate::base::output::is(&path, &KIND) || File::open(&path).is_ok_and(|file| lock(&file).is_err()) {
        return;
    }
    if std::fs::remove_file(&path).is_ok()
        && let Some(why) = why
    {
        notice!("{} is dropped: {why}", path.display());
    }
}

/// Only one process has a journal; a file system without locks is trusted.
fn lock(file: &File) -> Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(ErrorKind::ResourceBusy.into()),
        _ => Ok(()),
    }
}

/// The journal that stands there already, as a state.
fn found(path: &Path, identity: &dyn Fn() -> Option<Key>) -> State {
    // Opening a pipe waits.
    let opened = input::regular(path).and_then(|_| File::options().read(true).write(true).open(path));
    let file = match opened {
        Err(error) if error.kind() == ErrorKind::NotFound => return State::Empty,
        Err(error) => {
            notice!("{}: finished results are not kept: {error}", path.display());
            return State::Closed;
        }
        Ok(file) => file,
    };
    let mut head = Vec::new();
    let read = (&file).take(HEAD as u64).read_to_end(&mut head);
    if read.is_err() || !(head.is_empty() || is_journal(&head) || MAGIC.starts_with(&head)) {
        notice!("{} is not {}: finished results are not kept", path.display(), KIND.name);
        return State::Closed;
    }
    if lock(&file).is_err() {
        return State::Closed;
    }
    let Some(own) = identity() else { return State::Closed };
    let is_whole = head.len() == HEAD;
    let is_known = is_whole && head[MAGIC.len()..].starts_with(FORMAT);
    if !is_known || !head.ends_with(&own) {
        let why = match (is_whole, is_known) {
            (false, _) => "it is torn",
            (true, false) => "another version of the program has written it",
            (true, true) => "it belongs to another state of the scene",
        };
        return match std::fs::remove_file(path) {
            Ok(()) => {
                notice!("{} is dropped: {why}", path.display());
                State::Empty
            }
            Err(_) => State::Closed,
        };
    }
    match Records::read(file) {
        Ok(records) => State::Open(records),
        Err(error) => {
            notice!("{}: finished results are not kept: {error}", path.display());
            State::Closed
        }
    }
}

/// A new file. Another process may have made one meanwhile.
fn created(path: &Path, identity: &dyn Fn() -> Option<Key>) -> Result<Records> {
    let identity = identity().ok_or_else(|| Error::other("the scene's files cannot be read"))?;
    let mut file = File::options().read(true).write(true).create_new(true).open(path)?;
    let begun = lock(&file).and_then(|()| file.write_all(&[MAGIC, FORMAT, &identity].concat()));
    if let Err(error) = begun {
        std::fs::remove_file(path)?;
        return Err(error);
    }
    Ok(Records { file, end: HEAD as u64, contents: BTreeMap::new() })
}

impl Records {
    /// All whole records; what is torn behind them is cut off.
    fn read(mut file: File) -> Result<Records> {
        let size = file.metadata()?.len();
        let mut records = Records { file: file.try_clone()?, end: HEAD as u64, contents: BTreeMap::new() };
        file.seek(SeekFrom::Start(records.end))?;
        let mut input = std::io::BufReader::with_capacity(1 << 20, file);
        while let Some((key, length)) = record(&mut input, size - records.end)? {
            let at = records.end + RECORD as u64;
            records.contents.insert(key, (at, length));
            records.end = at + length as u64;
        }
        if records.end < size {
            records.file.set_len(records.end)?;
        }
        Ok(records)
    }

    fn append(&mut self, key: &Key, content: &[&[u8]]) -> Result<()> {
        let length: usize = content.iter().map(|part| part.len()).sum();
        let size = (length as u64).to_le_bytes();
        let mut hasher = blake3::Hasher::new();
        hasher.update(key).update(&size);
        content.iter().for_each(|part| {
            hasher.update(part);
        });
        let head = [hasher.finalize().as_bytes(), &key[..], &size].concat();
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(&head)?;
        content.iter().try_for_each(|part| self.file.write_all(part))?;
        self.contents.insert(*key, (self.end + RECORD as u64, length));
        self.end += (RECORD + length) as u64;
        Ok(())
    }
}

/// Key and length of the record that begins here, of which `left` bytes are there; `None` where it is not whole. The input
/// then stands behind it.
fn record(input: &mut impl Read, left: u64) -> Result<Option<(Key, usize)>> {
    let mut head = [0; RECORD];
    if left < RECORD as u64 {
        return Ok(None);
    }
    input.read_exact(&mut head)?;
    let (checksum, rest) = head.split_at(32);
    let (key, size) = rest.split_at(32);
    let length = size.iter().rev().fold(0, |sum: u64, &byte| sum << 8 | u64::from(byte));
    if length > left - RECORD as u64 {
        return Ok(None);
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(rest);
    hasher.update_reader(input.by_ref().take(length))?;
    let (Ok(key), Ok(length)) = (key.try_into(), usize::try_from(length)) else { return Ok(None) };
    Ok((hasher.finalize().as_bytes() == checksum).then_some((key, length)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NOW: Duration = Duration::ZERO;

    fn contents(count: usize) -> Vec<Vec<u8>> {
        (0..count).map(|i| (0..37 * i).map(|k| (k * i) as u8).collect()).collect()
    }

    proptest! {
        /// Cut anywhere, or with any byte changed, a journal gives back records that were written, from the first on, and
        /// takes new ones behind them.
        #[test]
        fn what_is_whole_comes_back(at in 0.0..1.0, change in 0u8..=255, is_cut: bool) {
            let folder = tempfile::tempdir().unwrap();
            let green = folder.path().join("a.green");
            let identity = || Some([7; 32]);
            let written = contents(6);
            let journal = Journal::new(&green, NOW, &identity);
            for (i, content) in written.iter().enumerate() {
                journal.keep(&[i as u8; 32], &[&content[..content.len() / 2], &content[content.len() / 2..]]);
            }
            drop(journal);
            let mut bytes = std::fs::read(path_of(&green)).unwrap();
            let place = (at * bytes.len() as f64) as usize;
            if is_cut { bytes.truncate(place) } else { bytes[place] = bytes[place].wrapping_add(change) }
            let is_same = !is_cut && change == 0;
            std::fs::write(path_of(&green), &bytes).unwrap();
            let journal = Journal::new(&green, NOW, &identity);
            let found = |journal: &Journal<'_>| -> Vec<Vec<u8>> {
                (0..6).map_while(|i| journal.find(&[i as u8; 32])).collect()
            };
            let before = found(&journal);
            prop_assert_eq!(&before[..], &written[..before.len()]);
            prop_assert!(before.len() == 6 || !is_same);
            // A foreign file, by a change in its first bytes, is left alone.
            if journal.is_kept() {
                journal.keep(&[9; 32], &[b"more"]);
                drop(journal);
                let journal = Journal::new(&green, NOW, &identity);
                prop_assert_eq!(journal.find(&[9; 32]).unwrap(), b"more");
                prop_assert_eq!(found(&journal).len(), before.len());
                journal.remove();
                prop_assert!(!path_of(&green).exists());
            }
        }
    }

    #[test]
    fn another_state_of_the_scene_finds_nothing_and_a_second_run_keeps_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let green = folder.path().join("a.green");
        let [one, other] = [[1; 32], [2; 32]].map(|state| move || Some(state));
        let first = Journal::new(&green, NOW, &one);
        first.keep(&[3; 32], &[b"x"]);
        let second = Journal::new(&green, NOW, &one);
        assert!(!second.is_kept() && second.find(&[3; 32]).is_none(), "the first has the lock");
        drop((first, second));
        assert!(Journal::new(&green, NOW, &one).has_records());
        assert!(!Journal::new(&green, NOW, &other).has_records());
        assert!(!path_of(&green).exists());
        std::fs::write(path_of(&green), "notes of my own").unwrap();
        let journal = Journal::new(&green, NOW, &one);
        journal.keep(&[3; 32], &[b"x"]);
        drop_journal(&green, None);
        assert_eq!(std::fs::read(path_of(&green)).unwrap(), b"notes of my own");
        assert!(Journal::new(Path::new("/dev/null"), NOW, &one).state().is_closed());
    }

    impl State {
        fn is_closed(&self) -> bool {
            matches!(self, State::Closed)
        }
    }
}
