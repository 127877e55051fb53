//! A surface as its format's reader found it.

use nalgebra::Vector3;

/// The result of a format's reader: polygons by the indices of their corners, unchecked.
#[derive(Debug, Default)]
pub(super) struct RawSurface {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Corners of all polygons, one polygon after the other.
    pub(super) corners: Vec<u32>,
    /// Number of corners of each polygon, and its byte offset for error messages.
    pub(super) polygons: Vec<(u32, usize)>,
    pub(super) notices: Vec<String>,
}
