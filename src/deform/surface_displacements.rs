//! The displaced surface of a body.

use nalgebra::Isometry3;

/// Displacements of the surface nodes: the point X of the body comes to
/// x = body_from_surface · (X + u), both about the body's centre.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceDisplacements {
    pub u: Vec<[f32; 3]>,
    /// Rigid motion that the model took out of the poses; the identity for `linear`.
    pub body_from_surface: Isometry3<f64>,
}

impl SurfaceDisplacements {
    pub fn zeros(nodes: usize) -> SurfaceDisplacements {
        SurfaceDisplacements { u: vec![[0.0; 3]; nodes], body_from_surface: Isometry3::identity() }
    }
}
