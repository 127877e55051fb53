//! A surface as its format's reader found it.

use nalgebra::Vector3;

/// What a format's reader found: polygons by the indices of their corners, unchecked.
#[derive(Debug, Default)]
pub(super) struct RawSurface {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Corners of all polygons, one polygon after the other.
    pub(super) corners: Vec<u32>,
    /// How many corners each polygon has, and its byte offset for error messages.
    pub(super) polygons: Vec<(u32, usize)>,
    pub(super) notices: Vec<String>,
}
