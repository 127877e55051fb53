//! Tensors that stay in the file: what a body needs of them is read when it is needed, and checked then.
//!
//! In: an opened file and the places of such tensors. Out: pieces of them; and the file without them, to be read into memory.
//! Reading at a place fails with an error where the file was cut short meanwhile; a memory map would end the program by
//! SIGBUS.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex, PoisonError};

/// Strips that are kept: the corners of a triangle may lie in three.
const RECENT: usize = 4;

#[derive(Debug)]
pub struct OnDisk {
    file: File,
    places: BTreeMap<String, Range<u64>>,
}

impl OnDisk {
    pub fn new(file: File, places: BTreeMap<String, Range<u64>>) -> OnDisk {
        OnDisk { file, places }
    }

    pub fn holds(&self, tensor: &str) -> bool {
        self.places.contains_key(tensor)
    }

    /// Bytes of a tensor.
    pub fn read(&self, tensor: &str, part: Range<u64>) -> Result<Vec<u8>> {
        let fits = |place: &&Range<u64>| part.start <= part.end && part.end <= place.end - place.start;
        let place = self.places.get(tensor).filter(fits).ok_or(ErrorKind::InvalidInput)?;
        let mut bytes = Vec::new();
        let length = usize::try_from(part.end - part.start).map_err(Error::other)?;
        bytes.try_reserve_exact(length)?;
        bytes.resize(length, 0);
        self.file.read_exact_at(&mut bytes, place.start + part.start)?;
        Ok(bytes)
    }

    /// A reader of the file without these tensors, from its beginning.
    pub fn others(&self) -> impl Read {
        let mut left: Vec<Range<u64>> = self.places.values().cloned().collect();
        left.sort_by_key(|place| place.start);
        Others { file: &self.file, left, at: 0 }
    }
}

/// A file without some of its bytes.
struct Others<'a> {
    file: &'a File,
    left: Vec<Range<u64>>,
    at: u64,
}

impl Read for Others<'_> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize> {
        for place in self.left.iter().filter(|place| !place.is_empty()) {
            if place.start == self.at {
                self.at = place.end;
            }
        }
        let next =
            self.left.iter().filter(|place| place.start > self.at).map(|place| place.start - self.at).min();
        let most =
            next.map_or(into.len(), |next| usize::try_from(next).map_or(into.len(), |n| n.min(into.len())));
        let read = self.file.read_at(&mut into[..most], self.at)?;
        self.at += read as u64;
        Ok(read)
    }
}

/// Numbers that were used last, those dropped first that were not used for longest, by their tensor and their place in it.
#[derive(Debug, Default)]
pub struct Recent(Mutex<VecDeque<Strip>>);

#[derive(Debug)]
struct Strip {
    tensor: String,
    place: usize,
    numbers: Arc<Vec<f32>>,
}

impl Recent {
    /// The numbers of this place, made where they are not kept.
    pub fn get<E>(
        &self,
        tensor: &str,
        place: usize,
        make: impl FnOnce() -> std::result::Result<Vec<f32>, E>,
    ) -> std::result::Result<Arc<Vec<f32>>, E> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let take = |kept: &mut VecDeque<Strip>| {
            let at = kept.iter().position(|strip| (strip.tensor.as_str(), strip.place) == (tensor, place))?;
            let strip = kept.remove(at)?;
            kept.push_front(strip);
            kept.front().map(|strip| strip.numbers.clone())
        };
        if let Some(numbers) = take(&mut kept()) {
            return Ok(numbers);
        }
        let numbers = Arc::new(make()?);
        let mut kept = kept();
        kept.truncate(RECENT - 1);
        kept.push_front(Strip { tensor: tensor.to_owned(), place, numbers: numbers.clone() });
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_and_the_rest_of_a_file_are_read_and_a_cut_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, b"0123456789abcdef").unwrap();
        let places = [("a".to_owned(), 2..6), ("b".to_owned(), 6..8), ("c".to_owned(), 14..16)].into();
        let disk = OnDisk::new(File::open(&path).unwrap(), places);
        let mut others = Vec::new();
        disk.others().read_to_end(&mut others).unwrap();
        assert_eq!(others, b"0189abcd");
        assert_eq!(disk.read("a", 1..3).unwrap(), b"34");
        assert!(disk.read("a", 1..5).is_err() && disk.read("d", 0..1).is_err());
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(5).unwrap();
        assert_eq!(disk.read("a", 0..3).unwrap(), b"234");
        assert_eq!(disk.read("a", 0..4).unwrap_err().kind(), ErrorKind::UnexpectedEof);
    }

    #[test]
    fn what_was_used_last_is_not_read_again() {
        let recent = Recent::default();
        let get = |place: usize| {
            let mut made = false;
            let numbers = recent.get::<()>("t", place, || {
                made = true;
                Ok(vec![place as f32])
            });
            assert_eq!(*numbers.unwrap(), [place as f32]);
            made
        };
        let made: Vec<bool> = [0, 1, 2, 3, 0, 4, 0, 1].map(get).into();
        assert_eq!(made, [true, true, true, true, false, true, false, true]);
    }
}
