//! Finds faults in the shape that a screen's corners span: one fault, with one remedy.
//!
//! In: a screen, and the viewer's place. Out: corners that were named for each other, or that span no rectangle.

use super::screen::odd_number;
use crate::stage::error::{MAX_SKEW, STRAIGHTENED_M, StageFault};
use crate::stage::screen::Screen;
use nalgebra::{Point3, Vector3};

/// The fault of a screen that spans an area, but no rectangle.
pub fn check(screen: &Screen, viewer: Option<&Point3<f64>>) -> Result<(), StageFault> {
    check_shape(screen).map_err(|skewed| {
        odd_number(screen).or_else(|| named_for_each_other(screen, viewer?)).unwrap_or(skewed)
    })
}

fn cosine(corners: &[Point3<f64>; 3]) -> f64 {
    let (across, upward) = (corners[1] - corners[0], corners[2] - corners[0]);
    across.dot(&upward) / (across.norm() * upward.norm())
}

fn check_shape(screen: &Screen) -> Result<(), StageFault> {
    let cosine = cosine(&[screen.lower_left, screen.lower_right, screen.upper_left]);
    let off_m = screen.off_rectangle_m();
    if cosine.abs() > MAX_SKEW || off_m > STRAIGHTENED_M {
        let up: Vector3<f64> = screen.axes()[1];
        return Err(StageFault::Skewed {
            screen: screen.name.clone(),
            degrees: cosine.acos().to_degrees(),
            off_m,
            sides_m: [screen.width_m(), screen.height_m()],
            upper_left: Box::new(screen.lower_left + up * screen.height_m()),
        });
    }
    Ok(())
}

/// Corners of a screen that is no rectangle, but would be one that the viewer stands before if two were named the other way
/// round, or one for its neighbour.
fn named_for_each_other(screen: &Screen, viewer: &Point3<f64>) -> Option<StageFault> {
    let Screen { lower_left: a, lower_right: b, upper_left: c, .. } = *screen;
    let readings = [
        ("lower_left and upper_left are named for each other", [c, b, a]),
        ("lower_left and lower_right are named for each other", [b, a, c]),
        ("what is called upper_left is the upper right corner", [a, b, a + (c - b)]),
        ("what is called lower_right is the upper right corner", [a, a + (b - c), c]),
    ];
    let is_right = |corners: &[Point3<f64>; 3]| {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let is_upright = corners[2].y - corners[0].y > -1e-3 * (corners[2] - corners[0]).norm();
        cosine(corners).abs() <= MAX_SKEW && (viewer - corners[0]).dot(&normal) > 0.0 && is_upright
    };
    let (what, corners) = readings.into_iter().find(|(_, corners)| is_right(corners))?;
    Some(StageFault::Corners { screen: screen.name.clone(), what, corners: Box::new(corners) })
}
