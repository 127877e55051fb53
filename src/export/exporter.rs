//! An exporter: one kind of file into which a result set is written.

use super::result_set::{Needs, ResultSet};
use crate::base::output::Kind;

/// One kind of file.
pub struct Exporter {
    /// Is appended to the name that the user gives, as `.csv`.
    pub suffix: &'static str,
    /// Recognises an earlier file of this exporter; files of other kinds are never overwritten.
    pub kind: Kind,
    /// Its file is only written if the results have this.
    pub needs: Needs,
    pub write: fn(&ResultSet) -> Vec<u8>,
}
