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

/// In the order of the page.
pub const PLOTS: [&PlotEntry; 12] = [
    &online::ONLINE,
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

/// Every plot that the report has data for.
pub fn pictures(report: &Report) -> Vec<(&'static PlotEntry, Picture)> {
    PLOTS.into_iter().filter_map(|entry| Some((entry, (entry.picture)(report)?))).collect()
}
