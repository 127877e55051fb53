//! The list of all exporters.

use super::exporter::Exporter;
use super::{csv, vtu};

/// In the order in which their files are written and named.
pub const EXPORTERS: &[Exporter] = &[csv::DISPLACEMENTS, csv::FORCES, csv::STRESSES, vtu::BODIES];
