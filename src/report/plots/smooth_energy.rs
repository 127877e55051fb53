//! The smooth problem in the energy norm.

use super::entry::PlotEntry;
use super::smooth::Norm;

pub const SMOOTH_ENERGY: PlotEntry = PlotEntry {
    name: "smooth-energy",
    heading: "",
    reading: "The same in the energy norm, which falls one order slower.",
    caption: |report| NORM.caption(report),
    picture: |report| NORM.picture(report),
    table: None,
};

const NORM: Norm = Norm {
    title: "Smooth problem: energy error against h",
    label: "relative error in the energy norm",
    error: |row| row.energy,
    rate: |row| row.energy_rate,
    promised: |row| row.promised[1],
};
