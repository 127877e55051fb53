//! Finds the side of each screen on which the viewer stands: each fault once, with the one remedy that the rest of the file
//! supports.
//!
//! In: the screens of a file, the viewer's place, the workspace. Out: a viewer behind a screen, a screen that faces away, or a
//! file in another system than x right, y up, z towards the viewer. They differ in the side of a screen on which the workspace
//! lies, and in the pictures of the other screens.

use super::screen::{TapedScreen, odd_number};
use crate::stage::description::Workspace;
use crate::stage::error::{StageFault, place};
use crate::stage::screen::{MIN_EYE_DISTANCE_M, Screen};
use nalgebra::Point3;

/// A screen with both sides longer than this, and the viewer behind it, is in another unit, m.
const HUGE_M: f64 = 12.0;
/// Lengths that no display's side has in metres, but may have in these.
const UNITS: [(&str, f64); 4] =
    [("inches", 0.0254), ("centimetres", 0.01), ("feet", 0.3048), ("millimetres", 0.001)];
/// A viewer whose y is below this was given in a system whose z points up, m.
const BELOW_M: f64 = -0.3;
/// Distance of a picture's middle from a screen's plane below which it does not show the screen's sides, m.
const FLAT_M: f64 = 0.05;

/// The faults of the screens that are rectangles, by index into `screens`.
pub fn check(
    screens: &[&TapedScreen],
    viewer: &Point3<f64>,
    workspace: Option<&Workspace>,
) -> Vec<(usize, StageFault)> {
    let scene = Surroundings { screens, viewer: *viewer, workspace };
    if let Some(fault) = scene.left_handed() {
        return vec![(0, fault)];
    }
    let mut faults = Vec::new();
    let mut behind = Vec::new();
    for (i, TapedScreen { screen, .. }) in screens.iter().enumerate() {
        let distance_m = screen.distance_m(viewer);
        if distance_m >= MIN_EYE_DISTANCE_M {
            continue;
        }
        let fault = if distance_m > -MIN_EYE_DISTANCE_M {
            StageFault::EdgeOn { screen: screen.name.clone(), distance_m }
        } else if let Some(unit) = odd_number(screen).or_else(|| other_unit(screen, -distance_m)) {
            unit
        } else if let Some(front) = scene.front(screen) {
            behind.push((i, front));
            continue;
        } else {
            scene.faces_away(i)
        };
        faults.push((i, fault));
    }
    faults.extend(scene.behind(&behind));
    faults.sort_by_key(|(i, _)| *i);
    faults
}

struct Surroundings<'a> {
    screens: &'a [&'a TapedScreen],
    viewer: Point3<f64>,
    workspace: Option<&'a Workspace>,
}

impl Surroundings<'_> {
    /// The workspace's distance before the screen, m; 0 if the ball is about the glass, which shows neither side.
    fn workspace_m(&self, screen: &Screen) -> f64 {
        self.workspace.map_or(0.0, |workspace| {
            let distance_m = screen.distance_m(&workspace.centre);
            if distance_m.abs() > workspace.radius_m { distance_m } else { 0.0 }
        })
    }

    /// The screens whose pictures' middles lie before (1) or behind (-1) this one's plane.
    fn others(&self, screen: &Screen, side: f64) -> Vec<&str> {
        let others = self.screens.iter().map(|other| &other.screen).filter(|other| other.name != screen.name);
        let is_there = |other: &&Screen| side * screen.distance_m(&other.point([0.0, 0.0])) > FLAT_M;
        others.filter(is_there).map(|other| other.name.as_str()).collect()
    }

    /// Words for the evidence that a screen faces the right way, though the viewer stands behind it.
    fn front(&self, screen: &Screen) -> Option<String> {
        let workspace_m = self.workspace_m(screen);
        let [before, behind] = [1.0, -1.0].map(|side| self.others(screen, side));
        if workspace_m > 0.0 {
            return Some("the workspace".into());
        }
        let is_proved = workspace_m == 0.0 && !before.is_empty() && behind.is_empty();
        is_proved.then(|| named(&before))
    }

    /// One fault for a viewer who stands behind these screens, which face the right way.
    fn behind(&self, screens: &[(usize, String)]) -> Option<(usize, StageFault)> {
        let (first, front) = screens.first()?;
        let screen = &self.screens[*first].screen;
        let others: Vec<&str> =
            screens[1..].iter().map(|(i, _)| self.screens[*i].screen.name.as_str()).collect();
        let also =
            if others.is_empty() { String::new() } else { format!(" (and behind {})", named(&others)) };
        let fault = StageFault::ViewerBehind {
            screen: screen.name.clone(),
            viewer: Box::new(self.viewer),
            distance_m: -screen.distance_m(&self.viewer),
            front: format!("{front}{also}").into(),
            remedy: self.where_to_stand().into(),
        };
        Some((*first, fault))
    }

    fn where_to_stand(&self) -> String {
        let is_before = |place: &Point3<f64>| {
            self.screens.iter().all(|known| known.screen.distance_m(place) >= MIN_EYE_DISTANCE_M)
        };
        let [x, y, z]: [f64; 3] = self.viewer.coords.into();
        let turned = Point3::new(x, z, -y);
        if y < BELOW_M && z > 0.0 && is_before(&turned) {
            return format!(
                "in this file y points up. If the viewer was measured with z up, write position = {}, and turn \
                 all other points likewise: (x, z, -y)",
                place(&turned)
            );
        }
        // Reflected in the planes that the viewer stands behind, one after the other.
        let reflected = self.screens.iter().fold(self.viewer, |at, known| {
            let distance_m = known.screen.distance_m(&at);
            if distance_m < 0.0 { at - known.screen.axes()[2] * (2.0 * distance_m) } else { at }
        });
        match is_before(&reflected) {
            true => format!("move the viewer before it: position = {}", place(&reflected)),
            false => "move the viewer to where all screens are seen from the front".into(),
        }
    }

    /// The fault of a screen whose back is to the viewer, and to all other evidence.
    fn faces_away(&self, index: usize) -> StageFault {
        let measured = self.screens[index];
        let screen = &measured.screen;
        let (name, viewer, distance_m) = (screen.name.clone(), self.viewer, -screen.distance_m(&self.viewer));
        let by_tape = measured.facing(|other| {
            other.distance_m(&viewer) >= MIN_EYE_DISTANCE_M
                && (self.workspace_m(screen) >= 0.0 || self.workspace_m(other) >= 0.0)
        });
        let (what, remedy) = match by_tape {
            Some(keys) => ("faces away", format!("write {keys}")),
            None => {
                let (swap, [lower_left, lower_right, upper_left]) = unmirrored(screen);
                let remedy = format!(
                    "swap {swap}: lower_left = {}, lower_right = {}, upper_left = {}",
                    place(&lower_left),
                    place(&lower_right),
                    place(&upper_left)
                );
                ("is mirrored", remedy)
            }
        };
        let remedy = remedy.into();
        let others = self.screens.iter().filter(|other| other.screen.name != screen.name);
        let stands_before_others = others.clone().count() > 0
            && others.into_iter().all(|other| other.screen.distance_m(&viewer) > 0.0);
        let is_proved = self.workspace_m(screen) < 0.0
            || stands_before_others
            || !self.others(screen, -1.0).is_empty() && self.others(screen, 1.0).is_empty();
        if is_proved {
            return StageFault::Mirrored { screen: name, viewer: Box::new(viewer), distance_m, what, remedy };
        }
        let before = Box::new(viewer + screen.axes()[2] * (2.0 * distance_m));
        StageFault::EitherSide { screen: name, viewer: Box::new(viewer), distance_m, what, remedy, before }
    }

    /// All screens face away from the viewer, the workspace and each other, and the viewer looks along z.
    fn left_handed(&self) -> Option<StageFault> {
        let workspace = self.workspace?;
        let is_outward = |known: &&TapedScreen| {
            let screen = &known.screen;
            screen.distance_m(&self.viewer) < 0.0
                && self.workspace_m(screen) <= 0.0
                && self.others(screen, 1.0).is_empty()
                && !self.others(screen, -1.0).is_empty()
        };
        let looks_along_z = workspace.centre.z > self.viewer.z;
        if self.screens.is_empty() || !looks_along_z || !self.screens.iter().all(is_outward) {
            return None;
        }
        let [x, y, z]: [f64; 3] = self.viewer.coords.into();
        let names: Vec<&str> = self.screens.iter().map(|known| known.screen.name.as_str()).collect();
        let viewer = Box::new(Point3::new(x, y, -z));
        Some(StageFault::LeftHanded { screens: named(&names).into(), viewer })
    }
}

/// "screens `left` and `floor`".
fn named(screens: &[&str]) -> String {
    let quoted: Vec<String> = screens.iter().map(|name| format!("`{name}`")).collect();
    match quoted.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("screens {} and {last}", rest.join(", ")),
        Some((last, _)) => format!("screen {last}"),
        None => String::new(),
    }
}

/// A screen as large as a house, with the viewer behind it.
fn other_unit(screen: &Screen, behind_m: f64) -> Option<StageFault> {
    let (width_m, height_m) = (screen.width_m(), screen.height_m());
    if width_m.min(height_m) < HUGE_M {
        return None;
    }
    let fits = |side: f64| (0.5..=10.0).contains(&side);
    let readings: Vec<String> = UNITS
        .iter()
        .filter(|(_, unit_m)| fits(width_m * unit_m) && fits(height_m * unit_m))
        .map(|(unit, unit_m)| format!("in {unit} {:.3} × {:.3} m", width_m * unit_m, height_m * unit_m))
        .collect();
    let message = format!(
        "it is {width_m:.3} × {height_m:.3} m, with the viewer {behind_m:.3} m behind it. Is it in \
         another unit than metres? It would be {}",
        readings.join(", ")
    );
    (!readings.is_empty()).then(|| StageFault::Screen { screen: screen.name.clone(), message })
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
