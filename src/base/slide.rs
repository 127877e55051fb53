//! The matrix by which a screw motion carries its slide: exp (v, ω) = (exp \[ω\], V(ω) v).

use nalgebra::{Matrix3, Vector3};

/// V(ω) = I + (1 - cos θ)/θ² \[ω\] + (θ - sin θ)/θ³ \[ω\]², θ = |ω| (Murray, Li and Sastry, A Mathematical Introduction to Robotic
/// Manipulation, section 2.3).
pub fn slide_matrix(turn: &Vector3<f64>) -> Matrix3<f64> {
    let (square, cross) = (turn.norm_squared(), turn.cross_matrix());
    let (first, second) = if square < 1e-4 {
        (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0)
    } else {
        let angle = square.sqrt();
        ((1.0 - angle.cos()) / square, (angle - angle.sin()) / (angle * square))
    };
    Matrix3::identity() + cross * first + cross * cross * second
}
