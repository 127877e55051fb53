//! The cost of accuracy in time: a body computed with every value of every parameter, each setting with its costs and its error.
//!
//! In: a scene's body and a set of poses ([`measure()`]). Out: a [`Report`], written as JSON, CSV, work-precision plots
//! (SVG) and one self-contained page (HTML).

mod answer;
mod axis;
mod canvas;
mod files;
mod labels;
mod page;
mod pareto;
mod plot;
mod plots;
mod relief;
pub mod scale;
mod tables;

pub use answer::{cheapest, headline, ladder};
pub use canvas::Picture;
pub use files::{ReportError, read, try_folder, write};
pub use page::page;
pub use pareto::{COST_METRICS, CostMetric, FILE, OFFLINE, ONLINE};
pub use plots::{PLOTS, PlotEntry, pictures};
pub use tables::{readme_table, summary};

use crate::measure::{self, MeasureError, Measurement, Report, Request, Setting};
use crate::solve::Progress;

/// Measures settings, models, the smooth problem and effects. This takes long; `progress` follows it.
pub fn measure(request: &Request<'_>, progress: &dyn Progress) -> Result<Report, MeasureError> {
    let shown = |rows: &[Measurement], own: &Setting| {
        answer::shown_of(rows, own).into_iter().map(|shown| shown.row).collect()
    };
    measure::measure(request, &shown, progress)
}
