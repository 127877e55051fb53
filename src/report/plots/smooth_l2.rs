//! The smooth problem in the L2 norm.

use super::entry::PlotEntry;
use super::smooth::Norm;

pub const SMOOTH_L2: PlotEntry = PlotEntry {
    name: "smooth-l2",
    heading: "Smooth problem",
    reading: "A smooth displacement whose exact solution is known, solved on the body's own mesh: the error must fall \
              as the theory says, line parallel to triangle. Where it does not, the elements or the mesh are at \
              fault, not the body's corners.",
    caption: |report| NORM.caption(report),
    picture: |report| NORM.picture(report),
    table: None,
};

const NORM: Norm = Norm {
    title: "Smooth problem: L2 error against h",
    label: "relative error in L2",
    error: |row| row.l2,
    rate: |row| row.l2_rate,
    promised: |row| row.promised[0],
};
