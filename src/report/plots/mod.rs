//! The plots of a report: one question and one file each. In: a [`Report`]. Out: pictures in SVG with their captions.

pub mod common;
mod entry;
mod mesh;
mod models;
mod one_parameter;
mod online;
mod smooth;
mod split;
mod trials;

pub use entry::PlotEntry;

use super::data::Report;
use super::drawing::canvas::Picture;

/// All plots, in the order of the page.
pub const PLOTS: [&PlotEntry; 13] = [
    &online::ONLINE,
    &online::FORCE,
    &split::SPLIT,
    &mesh::MESH,
    &one_parameter::SOLVER,
    &one_parameter::STORAGE,
    &models::MODELS,
    &trials::DISPLACEMENT,
    &trials::FORCE,
    &trials::TORQUE,
    &trials::TRADE,
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
