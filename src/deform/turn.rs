//! How far linear theory is strained: the largest rotation in the part of a deformation that it computes.

use super::deformer::Deformer;
use crate::fem::nearest_turn;
use nalgebra::{Matrix3, Vector3};

/// The largest rotation of a piece of the surface by u alone, rad; what the model took out of the poses as a rigid motion
/// is not in it. Looks at `most` triangles at the most, spread over the surface.
///
/// A triangle with edges a, b and unit normal n that comes to a', b', n' turns by the polar factor of
/// F = [a' b' n'] [a b n]⁻¹. Linear theory takes the strain of u to be ½(∇u + ∇uᵀ), which leaves out the square of this
/// angle (Bathe, Finite Element Procedures, section 6.2).
pub fn local_turn(deformer: &Deformer, most: usize) -> f64 {
    let triangles = deformer.triangles();
    let step = triangles.len().div_ceil(most.max(1)).max(1);
    let turn = |triangle: &[u32; 3]| {
        let rest = triangle.map(|node| Vector3::from(deformer.rest()[node as usize]).cast::<f64>());
        let moved = [0, 1, 2].map(|k| rest[k] + deformer.linear_part(triangle[k] as usize));
        let gradient = frame(&moved)? * frame(&rest)?.try_inverse()?;
        gradient.iter().all(|x| x.is_finite()).then(|| nearest_turn(&gradient).angle())
    };
    triangles.iter().step_by(step).filter_map(turn).fold(0.0, f64::max)
}

/// [a b n]; None for a triangle without area.
fn frame(corners: &[Vector3<f64>; 3]) -> Option<Matrix3<f64>> {
    let (a, b) = (corners[1] - corners[0], corners[2] - corners[0]);
    Some(Matrix3::from_columns(&[a, b, a.cross(&b).try_normalize(0.0)?]))
}
