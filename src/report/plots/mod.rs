//! The plots of a report: one question and one file each. In: a [`Report`]. Out: pictures in SVG with their captions.

pub mod common;
mod models;
mod parameters;
mod settings;
mod smooth;

pub use common::PlotEntry;

use super::canvas::Picture;
use crate::measure::Report;

/// All plots, in the order of the page.
pub const PLOTS: [&PlotEntry; 13] = [
    &settings::ONLINE,
    &settings::FORCE,
    &settings::SPLIT,
    &parameters::MESH,
    &parameters::SOLVER,
    &parameters::STORAGE,
    &models::MODELS,
    &models::DISPLACEMENT,
    &models::FORCE,
    &models::TORQUE,
    &models::TRADE,
    &smooth::SMOOTH_L2,
    &smooth::SMOOTH_ENERGY,
];

/// Every plot that shows anything.
pub fn pictures(report: &Report) -> Vec<(&'static PlotEntry, Picture)> {
    PLOTS.into_iter().filter_map(|entry| Some((entry, (entry.picture)(report).ok()?))).collect()
}

/// The plots that are left out although there are data for them, and why.
pub fn left_out(report: &Report) -> Vec<(&'static PlotEntry, String)> {
    let why = |entry: &'static PlotEntry| Some((entry, (entry.picture)(report).err()?));
    PLOTS.into_iter().filter_map(why).filter(|(_, why)| !why.is_empty()).collect()
}
