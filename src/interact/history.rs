//! Undo and redo: a bounded list of entries, newest last.
//!
//! In: an entry when a grab ends. Out: the entry to undo or to redo. The caller decides what an entry contains.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Entries that can be undone, and undone entries that can be redone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct History<T> {
    done: VecDeque<T>,
    undone: Vec<T>,
}

/// The most entries that are kept; the oldest is dropped first.
pub const KEPT: usize = 256;

impl<T> Default for History<T> {
    fn default() -> Self {
        Self { done: VecDeque::new(), undone: Vec::new() }
    }
}

impl<T: Clone> History<T> {
    /// Adds an entry; entries that were undone before can no longer be redone.
    pub fn push(&mut self, entry: T) {
        self.undone.clear();
        if self.done.len() == KEPT {
            self.done.pop_front();
        }
        self.done.push_back(entry);
    }

    /// The newest entry, which the caller undoes.
    pub fn undo(&mut self) -> Option<T> {
        let entry = self.done.pop_back()?;
        self.undone.push(entry.clone());
        Some(entry)
    }

    /// The entry that was undone last, which the caller redoes.
    pub fn redo(&mut self) -> Option<T> {
        let entry = self.undone.pop()?;
        self.done.push_back(entry.clone());
        Some(entry)
    }

    /// A history of other entries, made from these; those that become `None` are dropped.
    pub fn filter_map<U>(&self, mut entry: impl FnMut(&T) -> Option<U>) -> History<U> {
        History {
            done: self.done.iter().filter_map(&mut entry).collect(),
            undone: self.undone.iter().filter_map(&mut entry).collect(),
        }
    }

    /// All entries, those that can be undone first.
    pub fn entries(&self) -> impl Iterator<Item = &T> {
        self.done.iter().chain(&self.undone)
    }

    /// Numbers of entries that can be undone, and redone.
    pub fn depth(&self) -> [usize; 2] {
        [self.done.len(), self.undone.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undo_and_redo_walk_the_same_way_and_a_new_entry_ends_the_redo() {
        let mut history = History::default();
        assert_eq!((history.undo(), history.redo()), (None, None));
        for entry in 1..=3 {
            history.push(entry);
        }
        assert_eq!([history.undo(), history.undo(), history.redo()], [Some(3), Some(2), Some(2)]);
        history.push(4);
        assert_eq!((history.redo(), history.undo(), history.undo()), (None, Some(4), Some(2)));
    }

    #[test]
    fn the_oldest_entries_are_forgotten() {
        let mut history = History::default();
        for entry in 0..KEPT + 10 {
            history.push(entry);
        }
        let back: Vec<usize> = std::iter::from_fn(|| history.undo()).collect();
        assert_eq!((back.len(), back[KEPT - 1]), (KEPT, 10));
        assert_eq!(std::iter::from_fn(|| history.redo()).count(), KEPT);
    }
}
