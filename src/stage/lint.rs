//! Finds mistakes in a stage that loads without an error, as they occur with display walls.
//!
//! In: a [`Stage`], and the monitors of its desktop if they are known. Out: [`Diagnostic`]s with their numbers: how edges meet,
//! shapes of pixels, where the viewer stands, windows on their monitors, loudspeakers.

use super::description::Stage;
use super::error::{IPD_M, MAX_SKEW, STRAIGHTENED_M};
use super::overlap::{Overlap, overlaps};
use super::screen::{MIN_EYE_DISTANCE_M, Screen};
use super::seam::{Apart, Seam};
use super::stereo::Stereo;
use super::viewer::Eye;
use super::window::{Monitor, Window};
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::table::count;
use nalgebra::Point3;

/// Pixels that differ from squares by more than this are reported.
const PIXEL_RATIO: f64 = 0.01;
/// Distances between the pupils of most adults, m (N. A. Dodgson, "Variation and extrema of human interpupillary distance",
/// 2004: 5 % lie below, 5 % above).
const USUAL_IPD_M: std::ops::RangeInclusive<f64> = 0.055..=0.070;
/// Edges that meet within this are reported as closed, m: a tape measures no better.
pub(super) const CLOSED_M: f64 = 0.0005;
/// Corners that are off a rectangle by more than this are reported, m.
const SKEW_M: f64 = 0.0005;
/// Corners that are off a rectangle by more than this are reported as a warning, not a note, m.
const SLIP_M: f64 = 0.001;
/// Screens that lean forward, or fall to their upper edge, by more than this are reported, degrees.
const LEANS: f64 = 0.5;
/// A viewer farther from every screen than this is reported as an error, m.
const FARTHEST_M: f64 = 20.0;
/// A point up to here from the middle, in half widths and heights of a screen, counts as shown: it may lie behind a bezel.
const ABOUT_SHOWN: f32 = 1.02;
/// Screens that are seen under a smaller angle to their plane are reported, radians.
const GRAZING: f64 = 0.087;

/// All findings about `stage` except for those of the loader. Windows are checked if `monitors` are known.
pub fn lint(stage: &Stage, monitors: &[Monitor]) -> Vec<Diagnostic> {
    let mut found: Vec<Diagnostic> = upright::lint(stage).into_iter().collect();
    let is_upright = found.is_empty();
    for screen in &stage.screens {
        screen_lints(stage, screen, &mut found);
    }
    let overlaps = overlaps(&stage.screens, CLOSED_M);
    for joint in &stage.seams() {
        let pair = joint.edges.map(|(screen, _)| screen);
        if !overlaps.iter().any(|overlap| overlap.screens == pair) {
            found.push(seam_lint(stage, joint));
        }
    }
    let closed = found.iter().filter(|finding| finding.severity == Severity::Detail).count();
    if closed > 0 {
        let message = format!("{} of edges meet within {:.1} mm", count(closed, "pair"), 1e3 * CLOSED_M);
        push(&mut found, Severity::Note, "seams", message);
    }
    found.extend(overlaps.iter().map(|overlap| overlap_lint(stage, overlap)));
    let is_alone =
        |apart: &Apart| !overlaps.iter().any(|overlap| overlap.screens.contains(&apart.screens()[0]));
    found.extend(stage.apart().iter().filter(|&lone| is_alone(lone)).map(|lone| apart_lint(stage, lone)));
    viewer(stage, &mut found);
    eyes(stage, monitors, &mut found);
    windows(stage, monitors, &mut found);
    // Walls that lie flat would be reported as turned pictures, too.
    if is_upright {
        turned::lint(stage, &mut found);
    }
    tracking::lint(stage, &mut found);
    loudspeakers::lint(stage, &mut found);
    found
}

/// The errors of a stage that do not depend on its monitors.
pub fn errors(stage: &Stage) -> impl Iterator<Item = Diagnostic> {
    lint(stage, &[]).into_iter().filter(|finding| finding.severity == Severity::Error)
}

fn push(found: &mut Vec<Diagnostic>, severity: Severity, place: &str, message: impl Into<String>) {
    found.push(Diagnostic::new(severity, place, message));
}

fn screen_lints(stage: &Stage, screen: &Screen, found: &mut Vec<Diagnostic>) {
    let entity = format!("screen.{}", screen.name);
    let [width_m, height_m] = screen.pixel_size_m();
    let ratio = width_m / height_m;
    if (ratio - 1.0).abs() > PIXEL_RATIO {
        let [w, h] = screen.pixels;
        let message = format!(
            "pixels are {ratio:.3} times as wide as high, {:.3} × {:.3} mm. Unless the projector stretches \
             them, measure again ({w} × {h} square pixels on this width are {:.4} m high)",
            width_m * 1e3,
            height_m * 1e3,
            screen.width_m() * f64::from(h) / f64::from(w)
        );
        push(found, Severity::Warning, &entity, message);
    }
    // The loader refuses larger deviations.
    let off_m = screen.off_rectangle_m();
    if (SKEW_M..=STRAIGHTENED_M).contains(&off_m) && off_m <= MAX_SKEW * screen.height_m() {
        let upright = screen.lower_left + screen.axes()[1] * screen.height_m();
        let message = format!(
            "upper_left is {:.1} mm off a rectangle; the picture is drawn as if it were [{:.4}, {:.4}, \
             {:.4}]. Write that, or measure again",
            off_m * 1e3,
            upright.x,
            upright.y,
            upright.z
        );
        let severity = if off_m > SLIP_M { Severity::Warning } else { Severity::Note };
        push(found, severity, &entity, message);
    }
    push(found, Severity::Note, &entity, screen.measures());
    // The tilt of a picture that is turned in its plane is reported with its corners.
    let tilt = if turned::turned(stage, screen).is_some() { 0.0 } else { screen.tilt_degrees() };
    let up_m = screen.axes()[1] * screen.height_m();
    if (90.0 + LEANS..135.0).contains(&tilt) {
        let message = format!(
            "it {}: its upper edge is {:.0} mm nearer to the viewer. If it leans back, exchange the z of \
             both edges, or write tilt_degrees = {:.1}",
            screen.posture(),
            up_m.xz().norm() * 1e3,
            180.0 - tilt
        );
        push(found, Severity::Warning, &entity, message);
    }
    if (-45.0..-LEANS).contains(&tilt) {
        let message = format!(
            "it {}, {:.0} mm lower than its lower edge: is it tilted the other way?",
            screen.posture(),
            -up_m.y * 1e3
        );
        push(found, Severity::Warning, &entity, message);
    }
    let eye = Point3::from(stage.viewer.room_from_head.translation.vector);
    let distance_m = screen.distance_m(&eye);
    let away = screen.point([0.0, 0.0]) - eye;
    let angle = (distance_m / away.norm()).clamp(-1.0, 1.0).asin();
    if distance_m > MIN_EYE_DISTANCE_M && angle < GRAZING {
        let message =
            format!("the viewer sees it under {:.1}° to its plane: next to nothing", angle.to_degrees());
        push(found, Severity::Warning, &entity, message);
    }
}

fn seam_lint(stage: &Stage, seam: &Seam) -> Diagnostic {
    let [a, b] = [0, 1].map(|k| {
        let (screen, edge) = seam.edges[k];
        format!("{} edge of {}", edge.name(), stage.screens[screen].name)
    });
    // Adding 0.0 prints -0.0 as 0.0.
    let mm = |m: f64| (m * 1e4).round() / 10.0 + 0.0;
    let [first, second] = seam.gap_m;
    let worst_m = seam.widest_m();
    let along_m = seam.along_m[0].abs().max(seam.along_m[1].abs());
    let along = match along_m > CLOSED_M {
        true => ends(seam.along_m.map(mm)),
        false => String::new(),
    };
    let opens = match (first - second).abs() > CLOSED_M {
        true => format!(" ({:.1} mm at one end, {:.1} at the other)", mm(first), mm(second)),
        false => String::new(),
    };
    let (severity, what) = if worst_m <= CLOSED_M {
        (Severity::Detail, format!("meet within {:.1} mm", mm(worst_m)))
    } else if seam.is_overlap {
        (Severity::Warning, format!("overlap by {:.1} mm{opens}", mm(worst_m)))
    } else {
        (Severity::Warning, format!("leave a gap of {:.1} mm{opens}", mm(worst_m)))
    };
    let severity = if along_m > CLOSED_M { Severity::Warning } else { severity };
    let names = seam.edges.map(|(screen, _)| stage.screens[screen].name.as_str());
    Diagnostic::new(severity, format!("seam.{}-{}", names[0], names[1]), format!("{a} and {b} {what}{along}"))
}

/// Words for the distances of the ends of the second edge from those of the first, mm.
fn ends(along_mm: [f64; 2]) -> String {
    let place = |mm: f64| match mm {
        mm if mm > 0.0 => format!("{mm:.1} mm beyond the first"),
        mm => format!("{:.1} mm short of the first", -mm),
    };
    let [first, last] = along_mm;
    if (first + last).abs() < 0.05 {
        return format!("; the second is shifted by {:.1} mm along the first", first.abs());
    }
    match (place(first), place(last)) {
        (one, other) if one == other => format!("; the second ends {one} at both ends"),
        (one, _) if last == 0.0 => format!("; the second ends {one} at one end"),
        (_, other) if first == 0.0 => format!("; the second ends {other} at one end"),
        (one, other) => format!("; the second ends {one} at one end, {other} at the other"),
    }
}

/// The finding about a screen that meets no other.
fn apart_lint(stage: &Stage, apart: &Apart) -> Diagnostic {
    let names = apart.edges.map(|(screen, _)| stage.screens[screen].name.as_str());
    let message = format!(
        "it meets no other screen: the nearest edges, {}, are {:.0} mm apart. Unless it stands alone, \
         measure both again",
        apart.told(stage),
        apart.distance_m * 1e3
    );
    Diagnostic::new(Severity::Warning, format!("screen.{}", names[0]), message)
}

/// The finding about two screens that show part of one plane, or all of it, twice.
fn overlap_lint(stage: &Stage, overlap: &Overlap) -> Diagnostic {
    let [a, b] = overlap.screens.map(|screen| stage.screens[screen].name.as_str());
    let entity = format!("seam.{a}-{b}");
    if overlap.is_same {
        let remedy = "measure again; for two projectors on one screen, give it once and a window for each";
        let message = format!("screens {a} and {b} have the same corners: {remedy}");
        return Diagnostic::new(Severity::Error, entity, message);
    }
    let [width_mm, height_mm] = overlap.size_m.map(|side| side * 1e3);
    let message = format!(
        "screens {a} and {b} overlap by {width_mm:.1} × {height_mm:.1} mm in one plane. Unless the \
         projectors blend their edges, measure again"
    );
    Diagnostic::new(Severity::Warning, entity, message)
}

fn viewer(stage: &Stage, found: &mut Vec<Diagnostic>) {
    let ipd_m = stage.viewer.ipd_m;
    if ipd_m > 0.0 && !USUAL_IPD_M.contains(&ipd_m) && IPD_M.contains(&ipd_m) {
        let message = format!(
            "eyes {:.1} mm apart are rare: nine of ten people have {:.0} to {:.0} mm",
            ipd_m * 1e3,
            USUAL_IPD_M.start() * 1e3,
            USUAL_IPD_M.end() * 1e3
        );
        push(found, Severity::Note, "viewer.ipd", message);
    }
    let eye = Point3::from(stage.viewer.room_from_head.translation.vector);
    let to_glass = stage.screens.iter().map(|screen| (screen.point([0.0, 0.0]) - eye).norm());
    let nearest_m = to_glass.fold(f64::INFINITY, f64::min);
    if nearest_m > 10.0 {
        let message = format!("the nearest screen is {nearest_m:.1} m away: are all numbers metres?");
        let severity = if nearest_m > FARTHEST_M { Severity::Error } else { Severity::Warning };
        push(found, severity, "viewer.position", message);
    }
    let centre = stage.workspace.centre;
    let is_shown = |screen: &Screen| {
        screen.view(&eye, 0.01).is_ok_and(|view| {
            let clip = view.clip_from_room * centre.cast::<f32>().to_homogeneous();
            clip.w > 0.0 && clip.x.abs().max(clip.y.abs()) <= ABOUT_SHOWN * clip.w
        })
    };
    if !stage.screens.iter().any(is_shown) {
        let place = format!("({:.3}, {:.3}, {:.3})", centre.x, centre.y, centre.z);
        let message = format!("{place} is on no screen as the viewer stands: bodies there may not be seen");
        push(found, Severity::Warning, "workspace.centre", message);
    }
    if stage.tracking.head.is_none() {
        let message = "no sensor: the head stays where the file has it";
        push(found, Severity::Note, "viewer.head", message);
    }
}

/// Checks the eyes' tiles: both eyes or neither, and the left eye's left of the right eye's or above it.
fn eyes(stage: &Stage, monitors: &[Monitor], found: &mut Vec<Diagnostic>) {
    if stage.swap_eyes {
        push(found, Severity::Note, "swap_eyes", "each eye is shown what the other should see");
    }
    for window in &stage.windows {
        let swapped: Vec<&str> = window
            .tiles
            .iter()
            .filter(|tile| tile.swap_eyes)
            .map(|tile| stage.screens[tile.screen].name.as_str())
            .collect();
        if !swapped.is_empty() {
            let message = format!("on {}, each eye is shown what the other should see", swapped.join(", "));
            push(found, Severity::Note, &format!("window.{}.swap_eyes", window.name), message);
        }
    }
    let layout = stage.layout();
    let mut orders: Vec<(String, bool)> = Vec::new();
    for (index, screen) in stage.screens.iter().enumerate() {
        let tiles = layout.iter().flat_map(|window| window.tiles.iter().map(move |tile| (window, tile)));
        let mine: Vec<_> = tiles.filter(|(_, tile)| tile.screen == index).collect();
        let entity = format!("screen.{}", screen.name);
        if mine.is_empty() {
            push(found, Severity::Warning, &entity, "no window shows it");
            continue;
        }
        let sees = |eye: Eye| mine.iter().any(|(_, tile)| tile.stereo.eyes().contains(&eye));
        for (eye, other) in [(Eye::Left, Eye::Right), (Eye::Right, Eye::Left)] {
            if sees(eye) && !sees(other) {
                let message = format!("its windows show it to the {} eye alone", eye.name());
                push(found, Severity::Warning, &entity, message);
            }
        }
        let place = |kind: Stereo| {
            let (window, tile) = mine.iter().find(|(_, tile)| tile.stereo == kind)?;
            let (at, size) = window.on_desktop(monitors)?;
            let rect = window.rect(tile, size);
            let is_swapped = tile.swap_eyes != stage.swap_eyes;
            let shown_to = if is_swapped { kind.swapped() } else { kind };
            Some((shown_to, [0, 1].map(|axis| at[axis].saturating_add_unsigned(rect[axis]))))
        };
        if let (Some(first), Some(second)) = (place(Stereo::Left), place(Stereo::Right)) {
            let [left, right] =
                if first.0 == Stereo::Left { [first.1, second.1] } else { [second.1, first.1] };
            if left != right {
                orders.push((screen.name.clone(), left < right));
            }
        }
    }
    let others = orders.iter().filter(|(_, is_left_first)| *is_left_first).count();
    for (screen, _) in orders.iter().filter(|(_, is_left_first)| !is_left_first) {
        let message = format!(
            "the left eye's window stands right of the right eye's{}: are the eyes swapped?",
            if others > 0 { format!(", unlike those of {others} other screen(s)") } else { String::new() }
        );
        push(found, Severity::Warning, &format!("screen.{screen}"), message);
    }
}

fn windows(stage: &Stage, monitors: &[Monitor], found: &mut Vec<Diagnostic>) {
    for window in &stage.windows {
        for tile in &window.tiles {
            tile_lints(stage, window, tile, found);
        }
    }
    if monitors.is_empty() {
        return;
    }
    let places: Vec<_> = stage.windows.iter().map(|window| (window, window.on_desktop(monitors))).collect();
    for (i, (window, place)) in places.iter().enumerate() {
        let entity = format!("window.{}", window.name);
        if let (Some(id), None) = (&window.monitor, place) {
            let names: Vec<String> = monitors.iter().map(|monitor| format!("`{}`", monitor.name)).collect();
            let message = format!("there is no monitor {id}; there are {}", names.join(", "));
            push(found, Severity::Error, &entity, message);
        }
        let Some((at, size)) = *place else { continue };
        let area = i64::from(size[0]) * i64::from(size[1]);
        let hidden = uncovered(at, size, monitors);
        if hidden > 0 {
            let severity = if hidden == area { Severity::Error } else { Severity::Warning };
            let share = 100.0 * hidden as f64 / area as f64;
            let message = format!(
                "{share:.0} % of its {} × {} pixels at ({}, {}) lie on no monitor",
                size[0], size[1], at[0], at[1]
            );
            push(found, severity, &entity, message);
        }
        for (other, place) in &places[..i] {
            let shared = place.map_or(0, |(other_at, other_size)| common(at, size, other_at, other_size));
            let other_area = place.map_or(0, |(_, [width, height])| i64::from(width) * i64::from(height));
            if shared > 0 {
                let (severity, message) = match shared == area && shared == other_area {
                    true => (
                        Severity::Error,
                        format!("it and window `{}` stand in one place: one hides the other", other.name),
                    ),
                    false => (
                        Severity::Warning,
                        format!("{shared} of its pixels lie under or over window `{}`", other.name),
                    ),
                };
                push(found, severity, &entity, message);
            }
        }
    }
}

fn tile_lints(stage: &Stage, window: &Window, tile: &super::window::Tile, found: &mut Vec<Diagnostic>) {
    let entity = format!("window.{}", window.name);
    let screen = &stage.screens[tile.screen];
    let [.., width, height] = tile.rect;
    let wanted = tile.stereo.window_size([tile.crop[2], tile.crop[3]]);
    if !window.fills && [width, height] != wanted {
        let message = format!(
            "screen {} is drawn with {width} × {height} pixels; its own are {} × {} in this kind of stereo",
            screen.name, wanted[0], wanted[1]
        );
        push(found, Severity::Note, &entity, message);
    }
    let packed = [[1920, 2205], [1280, 1470]];
    if tile.stereo == Stereo::FramePacking && !packed.contains(&[width, height]) {
        let message =
            format!("frame packing takes 1920 × 2205 or 1280 × 1470 pixels, not {width} × {height}");
        push(found, Severity::Warning, &entity, message);
    }
}

/// Pixels of a rectangle that lie on no monitor; monitors may mirror each other.
fn uncovered(at: [i32; 2], size: [u32; 2], monitors: &[Monitor]) -> i64 {
    let span = |axis: usize, at: [i32; 2], size: [u32; 2]| {
        let start = i64::from(at[axis]);
        [start, start + i64::from(size[axis])]
    };
    // Lines along the edges of all monitors cut it into cells, each of which is on a monitor or is not.
    let cuts = |axis: usize| {
        let [low, high] = span(axis, at, size);
        let edges = monitors.iter().flat_map(|monitor| span(axis, monitor.at, monitor.size));
        let mut cuts: Vec<i64> = edges.map(|edge| edge.clamp(low, high)).chain([low, high]).collect();
        cuts.sort_unstable();
        cuts
    };
    let holds = |monitor: &Monitor, cell: [i64; 2]| {
        (0..2).all(|axis| {
            let [low, high] = span(axis, monitor.at, monitor.size);
            (low..high).contains(&cell[axis])
        })
    };
    let (columns, rows) = (cuts(0), cuts(1));
    let cells = columns.windows(2).flat_map(|x| rows.windows(2).map(move |y| (x, y)));
    let hidden = cells.filter(|(x, y)| !monitors.iter().any(|monitor| holds(monitor, [x[0], y[0]])));
    hidden.map(|(x, y)| (x[1] - x[0]) * (y[1] - y[0])).sum()
}

/// Pixels that two rectangles share.
fn common(at: [i32; 2], size: [u32; 2], other_at: [i32; 2], other_size: [u32; 2]) -> i64 {
    let along = |axis: usize| {
        let end = |start: i32, length: u32| i64::from(start) + i64::from(length);
        let low = i64::from(at[axis].max(other_at[axis]));
        (end(at[axis], size[axis]).min(end(other_at[axis], other_size[axis])) - low).max(0)
    };
    along(0) * along(1)
}

mod loudspeakers;
mod tracking;
mod turned;
mod upright;

#[cfg(test)]
mod tests;
