//! Quadrilaterals with a shader of their own, by which an effect draws beside the bodies.

/// A kind of strip: one shader, and the numbers that it takes for each instance.
#[derive(Debug)]
pub struct StripKind {
    pub name: &'static str,
    /// WGSL with the entry points `vertex` and `fragment`; `shaders/common/view.wgsl` stands before it. A strip has four
    /// vertices: lower left, lower right, upper left, upper right.
    pub shader: &'static str,
    /// Number of components (1 to 4) of each attribute of an instance, by its location.
    pub attributes: &'static [usize],
}

/// The strips of a kind in one frame, blended in this order.
#[derive(Clone, Debug)]
pub struct Strips {
    pub kind: &'static StripKind,
    /// All attributes of the first instance, then those of the next.
    pub instances: Vec<f32>,
}
