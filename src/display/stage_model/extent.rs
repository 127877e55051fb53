//! The points that the outside camera must keep in view.

use crate::stage::{Screen, Stage};
use nalgebra::{Point3, Vector3};

/// Corners of all screens, and of boxes about the workspace and the viewer's head.
pub(super) fn outline(stage: &Stage) -> Vec<Point3<f64>> {
    let head = Point3::from(stage.viewer.room_from_head.translation.vector);
    let boxes = [(stage.workspace.centre, stage.workspace.radius_m), (head, 0.2)];
    let of_box = |(middle, half): (Point3<f64>, f64)| {
        (0..8)
            .map(move |k| middle + Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half } else { half }))
    };
    stage.screens.iter().flat_map(corners).chain(boxes.into_iter().flat_map(of_box)).collect()
}

pub(super) fn ball_about(points: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let first = points.first().copied().unwrap_or_else(Point3::origin);
    let (low, high) =
        points.iter().fold((first, first), |(low, high), point| (low.inf(point), high.sup(point)));
    let middle = nalgebra::center(&low, &high);
    (middle, points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max))
}

/// Counter-clockwise from the lower left, as the viewer sees them.
pub(super) fn corners(screen: &Screen) -> [Point3<f64>; 4] {
    [screen.lower_left, screen.lower_right, screen.upper_right(), screen.upper_left]
}
