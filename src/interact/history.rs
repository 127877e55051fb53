//! What was done and can be undone: a bounded list of entries, newest last.
//!
//! In: an entry when a grab is let go. Out: the entry to take back or to do again. What an entry holds is its
//! owner's business.

use std::collections::VecDeque;

/// Entries done, and entries undone that can be done again.
#[derive(Clone, Debug, PartialEq)]
pub struct History<T> {
    done: VecDeque<T>,
    undone: Vec<T>,
}

/// Entries kept; the oldest is forgotten first.
pub const KEPT: usize = 256;

impl<T> Default for History<T> {
    fn default() -> Self {
        Self { done: VecDeque::new(), undone: Vec::new() }
    }
}

impl<T: Clone> History<T> {
    /// A new entry; what was undone before it cannot be done again.
    pub fn push(&mut self, entry: T) {
        self.undone.clear();
        if self.done.len() == KEPT {
            self.done.pop_front();
        }
        self.done.push_back(entry);
    }

    /// The newest entry, to be taken back by the caller.
    pub fn undo(&mut self) -> Option<T> {
        let entry = self.done.pop_back()?;
        self.undone.push(entry.clone());
        Some(entry)
    }

    /// The entry undone last, to be done again by the caller.
    pub fn redo(&mut self) -> Option<T> {
        let entry = self.undone.pop()?;
        self.done.push_back(entry.clone());
        Some(entry)
    }

    /// How many entries can be undone, and how many done again.
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
