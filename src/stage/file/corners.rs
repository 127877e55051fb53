//! What is wrong with a screen's corners, or with where the viewer stands: one fault, with one remedy.
//!
//! In: a screen, the viewer's place, and what else tells on which side of it people stand: the workspace and the other
//! screens. Out: corners that were named for each other, a viewer behind the screen, or a mirrored screen.

use super::screen::odd_number;
use crate::stage::error::{MAX_SKEW, STRAIGHTENED_M, StageFault};
use crate::stage::screen::{MIN_EYE_DISTANCE_M, Screen};
use crate::stage::workspace::Workspace;
use nalgebra::{Point3, Vector3};

/// Where people are, as far as the file tells.
pub struct Surroundings<'a> {
    pub viewer: Option<Point3<f64>>,
    pub workspace: Option<&'a Workspace>,
    /// On how many other screens the viewer stands before, and behind.
    pub others: [usize; 2],
}

/// The first fault of a screen that spans an area.
pub fn check(screen: &Screen, around: &Surroundings<'_>) -> Result<(), StageFault> {
    if let Err(skewed) = check_shape(screen) {
        let better = odd_number(screen).or_else(|| named_for_each_other(screen, around));
        return Err(better.unwrap_or(skewed));
    }
    match around.viewer {
        Some(viewer) => {
            check_side(screen, &viewer, around).map_err(|fault| odd_number(screen).unwrap_or(fault))
        }
        None => Ok(()),
    }
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
fn named_for_each_other(screen: &Screen, around: &Surroundings<'_>) -> Option<StageFault> {
    let viewer = around.viewer?;
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

/// Checks that the viewer stands before the screen.
fn check_side(screen: &Screen, viewer: &Point3<f64>, around: &Surroundings<'_>) -> Result<(), StageFault> {
    let distance_m = screen.distance_m(viewer);
    let name = || screen.name.clone();
    if distance_m.abs() < MIN_EYE_DISTANCE_M {
        return Err(StageFault::EdgeOn { screen: name(), distance_m });
    }
    if distance_m > 0.0 {
        return Ok(());
    }
    let (viewer, behind_m) = (*viewer, -distance_m);
    let before = viewer + screen.axes()[2] * (2.0 * behind_m);
    let (swap, corners) = unmirrored(screen);
    let [lower_left, lower_right, upper_left] = corners;
    let places = Box::new([lower_left, lower_right, upper_left, before]);
    // A ball about the glass tells nothing.
    let workspace_m = around.workspace.map_or(0.0, |workspace| {
        let distance_m = screen.distance_m(&workspace.centre);
        if distance_m.abs() > workspace.radius_m { distance_m } else { 0.0 }
    });
    let behind = |front| StageFault::ViewerBehind {
        screen: name(),
        viewer,
        distance_m: behind_m,
        front,
        before: Box::new(before),
    };
    let corners = Box::new(corners);
    let mirrored = StageFault::Mirrored { screen: name(), viewer, distance_m: behind_m, swap, corners };
    Err(match around.others {
        _ if workspace_m > 0.0 => behind("the workspace"),
        [0, others] if others > 0 => behind("where those of the other screens are"),
        _ if workspace_m < 0.0 => mirrored,
        [others, 0] if others > 0 => mirrored,
        _ => StageFault::EitherSide { screen: name(), viewer, distance_m: behind_m, swap, places },
    })
}

/// The corners of the same rectangle facing the other way, and which corners to swap. A picture that stood upside down is
/// turned about its horizontal axis, any other about its vertical one.
fn unmirrored(screen: &Screen) -> (&'static str, [Point3<f64>; 3]) {
    if screen.upper_left.y < screen.lower_left.y - 1e-9 {
        ("lower_left with upper_left", [screen.upper_left, screen.upper_right(), screen.lower_left])
    } else {
        (
            "the left corners with the right ones",
            [screen.lower_right, screen.lower_left, screen.upper_right()],
        )
    }
}
