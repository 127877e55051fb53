//! All exporters. One more is a file of its own and a line here.

use super::exporter::Exporter;
use super::{csv, vtu};

/// In the order in which they are written and told.
pub const EXPORTERS: &[Exporter] = &[csv::DISPLACEMENTS, csv::FORCES, vtu::SURFACE];
