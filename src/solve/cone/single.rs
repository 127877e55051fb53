//! A contact by itself.
//!
//! In: its compliance and its displacement without its own force. Out: the force that its conditions ask for.

use nalgebra::{Matrix3, Vector2, Vector3};

/// Steps of a contact that slips.
const SLIP_STEPS: usize = 8;

/// The force of a contact by itself: `w` its compliance, `free` its displacement without its force, `old` a force to begin with.
pub fn single(w: &Matrix3<f64>, free: &Vector3<f64>, friction: f64, old: &Vector3<f64>) -> Vector3<f64> {
    if free.x >= 0.0 || w[(0, 0)] <= 0.0 {
        return Vector3::zeros();
    }
    if friction == 0.0 {
        return Vector3::new(-free.x / w[(0, 0)], 0.0, 0.0);
    }
    if let Some(stick) = w.try_inverse().map(|inverse| -(inverse * free))
        && stick.x >= 0.0
        && stick.y.hypot(stick.z) <= friction * stick.x
    {
        return stick;
    }
    let step = 1.0 / (w[(1, 1)] + w[(2, 2)]);
    let mut f = Vector3::new(old.x.max(0.0), old.y, old.z);
    for _ in 0..SLIP_STEPS {
        let last = f;
        f.x = (-(free.x + w[(0, 1)] * f.y + w[(0, 2)] * f.z) / w[(0, 0)]).max(0.0);
        let slip = free + w * f;
        let tangent = within(&Vector2::new(f.y - step * slip.y, f.z - step * slip.z), friction * f.x);
        (f.y, f.z) = (tangent.x, tangent.y);
        if (f - last).norm() <= 1e-14 * f.norm() {
            break;
        }
    }
    f
}

/// The vector, or the nearest that is no longer than `most`.
pub fn within(vector: &Vector2<f64>, most: f64) -> Vector2<f64> {
    let size = vector.norm();
    if size <= most { *vector } else { vector * (most / size) }
}
