//! The cost of accuracy in time: a body computed with every value of every parameter, each setting with its costs and its error.
//!
//! In: a scene's body and a set of poses ([`measure()`]). Out: a [`Report`], written as JSON, CSV, work-precision plots
//! (SVG) and one self-contained page (HTML).

pub mod measure;

mod bodies;
mod cost_metric;
mod csv;
mod data;
mod drawing;
mod files;
mod headline;
mod page;
mod parameters;
mod pareto;
mod plots;
mod readme_table;
mod recommendation;
pub mod scale;
mod summary;
mod tables;
pub mod units;

pub use cost_metric::{COST_METRICS, CostMetric, FILE, OFFLINE, ONLINE};
pub use data::{
    Cost, EffectCost, Errors, Measurement, ModelError, ModelTrial, ModelTrials, Report, SCHEMA, Setting,
    Shapes, SmoothError, Spread, Timing, TrialMotion,
};
pub use drawing::canvas::Picture;
pub use files::{ReportError, read, try_folder, write};
pub use headline::headline;
pub use measure::{Limits, MeasureError, Request, measure};
pub use page::page;
pub use parameters::{PARAMETERS, Parameter};
pub use plots::{PLOTS, PlotEntry, pictures};
pub use readme_table::readme_table;
pub use recommendation::{cheapest, ladder};
pub use summary::summary;
