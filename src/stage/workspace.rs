//! The space before the screens: the ball in which a body is placed, and the grid that shows depth.

use nalgebra::{Point3, Similarity3, Translation3, UnitQuaternion};

/// The ball in which a body is placed and handled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    pub centre: Point3<f64>,
    pub radius_m: f64,
}

/// A horizontal square of grid lines around the workspace's vertical axis, as a depth cue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    pub height_m: f64,
    pub half_size_m: f64,
}

impl Workspace {
    /// A body's largest half-extent as a fraction of the ball's radius.
    pub const FILL: f64 = 0.95;

    /// Places a body with the bounds `min..max` (body frame, metres): its middle at the centre, its largest
    /// extent scaled to 0.95 of the ball's diameter, its axes parallel to the room's. `None` for bounds
    /// without extent, or not finite.
    pub fn room_from_body(&self, min: Point3<f64>, max: Point3<f64>) -> Option<Similarity3<f64>> {
        let half_extent = (max - min).max() / 2.0;
        let scale = Self::FILL * self.radius_m / half_extent;
        let middle = nalgebra::center(&min, &max);
        let shift = self.centre.coords - middle.coords * scale;
        let is_usable =
            half_extent > 0.0 && scale > 0.0 && scale.is_finite() && shift.iter().all(|x| x.is_finite());
        is_usable
            .then(|| Similarity3::from_parts(Translation3::from(shift), UnitQuaternion::identity(), scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_fills_the_workspace() {
        let workspace = Workspace { centre: Point3::new(0.0, 1.15, 0.55), radius_m: 0.35 };
        let room_from_body =
            workspace.room_from_body(Point3::new(10.0, -0.1, -0.1), Point3::new(12.0, 0.1, 0.1)).unwrap();
        let end = room_from_body * Point3::new(12.0, 0.0, 0.0);
        assert!((end - Point3::new(0.3325, 1.15, 0.55)).norm() < 1e-12, "{end}");
        let point = Point3::new(1.0, 2.0, 3.0);
        assert_eq!(workspace.room_from_body(point, point), None);
        assert_eq!(workspace.room_from_body(point, Point3::new(f64::NAN, 3.0, 4.0)), None);
        assert_eq!(workspace.room_from_body(point, Point3::new(f64::INFINITY, 3.0, 4.0)), None);
    }
}
