//! What an exporter is: a kind of file that a result set is written into.

use super::result_set::ResultSet;
use crate::base::output::Kind;

/// One kind of file.
pub struct Exporter {
    /// What follows the name that the user gives, as `.csv`.
    pub suffix: &'static str,
    /// How an earlier file of this exporter is told from others, which are never overwritten.
    pub kind: Kind,
    /// Written where there are forces alone.
    pub needs_forces: bool,
    pub write: fn(&ResultSet) -> Vec<u8>,
}
