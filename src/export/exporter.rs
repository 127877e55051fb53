//! An exporter: one kind of file into which a result set is written.

use super::result_set::{Needs, ResultSet};
use crate::base::output::Kind;

/// One kind of file.
pub struct Exporter {
    /// The suffix that is appended to the name that the user gives, as `.csv`.
    pub suffix: &'static str,
    /// Recognises an earlier file of this exporter; files of other kinds are never overwritten.
    pub kind: Kind,
    pub spread: Spread,
    /// Results without which its file is not written.
    pub needs: Needs,
    pub write: fn(&ResultSet) -> Vec<u8>,
}

/// The distribution of a result set's poses over files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// One file of all poses, always written.
    AllPoses,
    /// A file OUT.POSE.suffix for each pose, written where it is asked for.
    EachPose,
}

impl Exporter {
    /// The name by which it is asked for: its suffix without the dot.
    pub fn name(&self) -> &'static str {
        self.suffix.trim_start_matches('.')
    }
}
