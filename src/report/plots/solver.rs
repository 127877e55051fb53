//! Offline time against the solver error: a line a mesh.

use super::entry::PlotEntry;
use super::one_parameter::OneParameter;
use crate::report::cost_metric::OFFLINE;
use crate::report::parameters;

pub const SOLVER: PlotEntry = PlotEntry {
    name: "solver",
    heading: "Solver and tolerance",
    reading: "Offline time against the error that the solver adds on the same mesh. It is small enough where it lies a \
              decade below the discretisation error of that mesh.",
    caption: |report| PLOT.caption(report),
    picture: |report| PLOT.picture(report),
    table: None,
};

const PLOT: OneParameter = OneParameter {
    parameter: parameters::SOLVER,
    metric: OFFLINE,
    title: "What the solver and its tolerance cost",
    multiples: "Offline times as multiples of the fastest on the same mesh",
};
