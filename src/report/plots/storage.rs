//! Size of the file against the storage error: a line a mesh.

use super::entry::PlotEntry;
use super::one_parameter::OneParameter;
use crate::report::cost_metric::FILE;
use crate::report::parameters;

pub const STORAGE: PlotEntry = PlotEntry {
    name: "storage",
    heading: "Storage",
    reading: "Size of the file against the error of rounding its columns. Hollow marks buy nothing on their mesh.",
    caption: |report| PLOT.caption(report),
    picture: |report| PLOT.picture(report),
    table: None,
};

const PLOT: OneParameter = OneParameter {
    parameter: parameters::STORAGE,
    metric: FILE,
    title: "What the storage of the columns costs",
    multiples: "File sizes as multiples of the smallest on the same mesh",
};
