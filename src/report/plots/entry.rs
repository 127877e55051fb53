//! An entry of [`PLOTS`](super::PLOTS).

use crate::report::data::Report;
use crate::report::drawing::canvas::Picture;

pub struct PlotEntry {
    /// The stem of the plot's file.
    pub name: &'static str,
    /// The heading above it on the page; empty where it continues the plot before it.
    pub heading: &'static str,
    /// Advice for reading it.
    pub reading: &'static str,
    /// Sentences about this body, made from the data; empty where there is nothing to report.
    pub caption: fn(&Report) -> String,
    /// Draws it; the error says why the plot would be empty, and is empty where the report has no data for it.
    pub picture: fn(&Report) -> Result<Picture, String>,
    pub table: Option<TableBelow>,
}

/// A paragraph and a table below a plot.
pub type TableBelow = (&'static str, fn(&Report) -> String);
