//! The layer below the plots: a canvas of SVG, axes with ticks, labels that do not cover each other, and the plot of
//! points on two axes.

pub mod axis;
pub mod canvas;
pub mod labels;
pub mod plot;
pub mod relief;
