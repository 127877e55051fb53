//! Stage files: strict TOML in, a [`Stage`] that can be projected on out, or an error that names file, line,
//! screen and remedy. The faults checked are those that display walls are really set up with: mirrored and
//! skewed corners, other units, swapped eyes.

use super::fault::{Fault, IPD_M, MAX_PIXELS, MAX_SIDE_M, MAX_SKEW, MIN_SIDE_M, StageError};
use super::haptic::{self, HapticFile};
use super::tracking::{self, SensorFile, StylusFile, TrackerFile};
use super::{Grid, MIN_EYE_DISTANCE_M, ROOM_LIMIT_M, Screen, Stage, Stereo, Viewer, Workspace};
use crate::config;
use indexmap::IndexMap;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;
use toml::Spanned;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct StageFile {
    name: String,
    #[serde(default)]
    description: String,
    stereo: Stereo,
    viewer: Spanned<ViewerFile>,
    workspace: Spanned<WorkspaceFile>,
    grid: Option<Spanned<GridFile>>,
    #[serde(default, rename = "screen")]
    screens: Vec<Spanned<ScreenFile>>,
    #[serde(default)]
    tracker: IndexMap<String, Spanned<TrackerFile>>,
    #[serde(default)]
    sensor: IndexMap<String, Spanned<SensorFile>>,
    #[serde(default)]
    stylus: IndexMap<String, Spanned<StylusFile>>,
    #[serde(default)]
    haptic: IndexMap<String, Spanned<HapticFile>>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewerFile {
    position: [f64; 3],
    target: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    #[serde(default = "usual_ipd")]
    ipd: f64,
    head: Option<Spanned<String>>,
}

fn usual_ipd() -> f64 {
    0.064
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct WorkspaceFile {
    centre: [f64; 3],
    radius: f64,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct GridFile {
    height: f64,
    half_size: f64,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct ScreenFile {
    name: String,
    lower_left: [f64; 3],
    lower_right: [f64; 3],
    upper_left: [f64; 3],
    pixels: [u32; 2],
}

pub fn load(path: &Path) -> Result<Stage, StageError> {
    let text = config::read(path)?;
    parse(&text, path)
}

pub fn parse(text: &str, path: &Path) -> Result<Stage, StageError> {
    let file: StageFile = config::parse(text, path)?;
    let invalid = |offset: usize, fault: Fault| StageError::Invalid {
        path: path.to_owned(),
        line: config::line_and_column(text, offset).0,
        fault,
    };
    check_name("stage", &file.name).map_err(|fault| invalid(0, fault))?;
    let workspace =
        workspace(file.workspace.get_ref()).map_err(|fault| invalid(file.workspace.span().start, fault))?;
    let viewer = viewer(file.viewer.get_ref(), &workspace, file.stereo)
        .map_err(|fault| invalid(file.viewer.span().start, fault))?;
    let grid = match &file.grid {
        Some(found) => Some(grid(found.get_ref()).map_err(|fault| invalid(found.span().start, fault))?),
        None => None,
    };
    if file.screens.is_empty() {
        return Err(invalid(0, Fault::NoScreen));
    }
    let eye = Point3::from(viewer.room_from_head.translation.vector);
    let mut lines = BTreeMap::new();
    let mut screens = Vec::new();
    for found in file.screens {
        let start = found.span().start;
        let line = config::line_and_column(text, start).0;
        let screen = screen(found.into_inner(), &eye).map_err(|fault| invalid(start, fault))?;
        if let Some(first_line) = lines.insert(screen.name.clone(), line) {
            return Err(invalid(start, Fault::Duplicate { screen: screen.name, first_line }));
        }
        screens.push(screen);
    }
    let head = file.viewer.get_ref().head.as_ref();
    let tracking = tracking::check(file.tracker, file.sensor, file.stylus, head)
        .map_err(|(offset, fault)| invalid(offset, fault.into()))?;
    let haptics = file.haptic.iter().map(|(name, found)| {
        let checked = check_name("haptic device", name).and_then(|()| haptic::check(name, found.get_ref()));
        checked.map_err(|fault| invalid(found.span().start, fault))
    });
    let haptics = haptics.collect::<Result<_, _>>()?;
    let StageFile { name, description, stereo, .. } = file;
    Ok(Stage { name, description, stereo, viewer, workspace, grid, screens, tracking, haptics })
}

fn check_name(what: &'static str, name: &str) -> Result<(), Fault> {
    let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if is_plain && (1..=64).contains(&name.len()) {
        Ok(())
    } else {
        Err(Fault::Name { what, name: name.chars().take(64).collect() })
    }
}

fn length(what: &str, value: f64, min: f64, max: f64) -> Result<f64, Fault> {
    if (min..=max).contains(&value) {
        Ok(value)
    } else {
        Err(Fault::Length { what: what.to_owned(), value, min, max })
    }
}

fn point(what: &str, coordinates: [f64; 3]) -> Result<Point3<f64>, Fault> {
    for (axis, value) in ["x", "y", "z"].into_iter().zip(coordinates) {
        length(&format!("{axis} of {what}"), value, -ROOM_LIMIT_M, ROOM_LIMIT_M)?;
    }
    Ok(coordinates.into())
}

fn workspace(file: &WorkspaceFile) -> Result<Workspace, Fault> {
    Ok(Workspace {
        centre: point("the workspace's centre", file.centre)?,
        radius_m: length("the workspace's radius", file.radius, 0.001, MAX_SIDE_M)?,
    })
}

fn grid(file: &GridFile) -> Result<Grid, Fault> {
    Ok(Grid {
        height_m: length("the grid's height", file.height, -ROOM_LIMIT_M, ROOM_LIMIT_M)?,
        half_size_m: length("the grid's half_size", file.half_size, 0.001, ROOM_LIMIT_M)?,
    })
}

fn viewer(file: &ViewerFile, workspace: &Workspace, stereo: Stereo) -> Result<Viewer, Fault> {
    let position = point("the viewer's position", file.position)?;
    let direction = match (file.target, file.direction) {
        (Some(_), Some(_)) => return Err(Fault::TwoDirections),
        (Some(target), None) => point("the viewer's target", target)? - position,
        (None, Some(direction)) => point("the viewer's direction", direction)?.coords,
        (None, None) => workspace.centre - position,
    };
    let rotation = super::rotation_towards(&direction, 0.0).ok_or(Fault::NoDirection)?;
    if !(IPD_M.contains(&file.ipd) || file.ipd == 0.0 && stereo == Stereo::Mono) {
        return Err(Fault::Ipd { ipd_m: file.ipd });
    }
    let room_from_head = Isometry3::from_parts(Translation3::from(position.coords), rotation);
    Ok(Viewer { room_from_head, ipd_m: file.ipd })
}

fn screen(file: ScreenFile, viewer: &Point3<f64>) -> Result<Screen, Fault> {
    let ScreenFile { name, lower_left, lower_right, upper_left, pixels } = file;
    check_name("screen", &name)?;
    let corner = |corner: &str, coordinates| point(&format!("{corner} of screen `{name}`"), coordinates);
    let screen = Screen {
        lower_left: corner("lower_left", lower_left)?,
        lower_right: corner("lower_right", lower_right)?,
        upper_left: corner("upper_left", upper_left)?,
        pixels,
        name,
    };
    let name = || screen.name.clone();
    let [width, height] = pixels;
    if !(1..=MAX_PIXELS).contains(&width) || !(1..=MAX_PIXELS).contains(&height) {
        return Err(Fault::Pixels { screen: name(), width, height });
    }
    check_shape(&screen)?;
    let distance_m = screen.distance_m(viewer);
    if distance_m.abs() < MIN_EYE_DISTANCE_M {
        return Err(Fault::EdgeOn { screen: name(), distance_m });
    }
    if distance_m < 0.0 {
        let (swap, corners) = unmirrored(&screen);
        let corners = Box::new(corners);
        return Err(Fault::Mirrored {
            screen: name(),
            viewer: *viewer,
            distance_m: -distance_m,
            swap,
            corners,
        });
    }
    Ok(screen)
}

fn check_shape(screen: &Screen) -> Result<(), Fault> {
    let side = MIN_SIDE_M..=MAX_SIDE_M;
    let (width_m, height_m) = (screen.width_m(), screen.height_m());
    let across = screen.lower_right - screen.lower_left;
    let upward = screen.upper_left - screen.lower_left;
    let area = across.cross(&upward).norm();
    if !side.contains(&width_m) || !side.contains(&height_m) || area < 1e-6 * width_m * height_m {
        return Err(Fault::Size { screen: screen.name.clone(), width_m, height_m });
    }
    let cosine = across.dot(&upward) / (width_m * height_m);
    if cosine.abs() > MAX_SKEW {
        let up: Vector3<f64> = screen.axes()[1];
        return Err(Fault::Skewed {
            screen: screen.name.clone(),
            degrees: cosine.acos().to_degrees(),
            upper_left: screen.lower_left + up * height_m,
        });
    }
    Ok(())
}

/// The same rectangle with its face on the other side. A picture that stood upside down is turned about its
/// horizontal axis, any other about its vertical one.
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

#[cfg(test)]
mod tests {
    use super::super::BUILT_IN;
    use super::*;

    /// The workbench with one piece of its text replaced.
    fn workbench_with(from: &str, to: &str) -> Result<Stage, StageError> {
        let text = BUILT_IN[0].1;
        assert!(text.contains(from), "`{from}` is not in the file");
        parse(&text.replacen(from, to, 1), Path::new("bench.toml"))
    }

    fn refusal(from: &str, to: &str) -> String {
        workbench_with(from, to).unwrap_err().to_string()
    }

    fn line_of(needle: &str) -> usize {
        BUILT_IN[0].1.lines().position(|line| line.contains(needle)).unwrap() + 1
    }

    const WALL_LEFT: &str = "lower_left = [-0.80, 0.90, 0.00]";
    const WALL_UP: &str = "upper_left = [-0.80, 2.18, 0.00]";

    #[test]
    fn a_mirrored_screen_is_named_with_the_corners_to_swap() {
        let text = BUILT_IN[0].1.replace("[-0.80, 0.90, 0.00]      # the", "[0.80, 0.90, 0.00]  # the");
        let text = text.replace("lower_right = [0.80, 0.90, 0.00]", "lower_right = [-0.80, 0.90, 0.00]");
        let text = text.replace(WALL_UP, "upper_left = [0.80, 2.18, 0.00]");
        // The table's upper edge is the wall's lower: put it back.
        let text = text.replace("upper_left = [0.80, 0.90, 0.00]", "upper_left = [-0.80, 0.90, 0.00]");
        let error = parse(&text, Path::new("bench.toml")).unwrap_err().to_string();
        let line = line_of("name = \"wall\"") - 1;
        assert!(error.starts_with(&format!("bench.toml:{line}: screen `wall` is mirrored")), "{error}");
        assert!(error.contains("Swap the left corners with the right ones"), "{error}");
        assert!(error.contains("lower_left = [-0.8000, 0.9000, 0.0000], lower_right = [0.8000,"), "{error}");
    }

    #[test]
    fn an_upside_down_mirrored_screen_is_told_from_one_that_is_left_to_right() {
        let text = BUILT_IN[0].1.replace(WALL_UP, "upper_left = [-0.80, 0.90, 0.00]");
        let text = text.replace(WALL_LEFT, "lower_left = [-0.80, 2.18, 0.00]");
        let text = text.replace("lower_right = [0.80, 0.90, 0.00]", "lower_right = [0.80, 2.18, 0.00]");
        let error = parse(&text, Path::new("bench.toml")).unwrap_err().to_string();
        assert!(
            error.contains("`wall` is mirrored") && error.contains("Swap lower_left with upper_left"),
            "{error}"
        );
        assert!(error.contains("upper_left = [-0.8000, 2.1800, 0.0000]"), "{error}");
    }

    #[test]
    fn skewed_and_degenerate_screens_are_named_with_the_remedy() {
        let error = refusal(WALL_UP, "upper_left = [-0.75, 2.18, 0.00]");
        assert!(error.contains("screen `wall` is no rectangle") && error.contains("87.76°"), "{error}");
        assert!(error.contains("upper_left [-0.8000, 2.1810, 0.0000]"), "{error}");
        assert!(
            workbench_with(WALL_UP, "upper_left = [-0.7995, 2.18, 0.00]").is_ok(),
            "half a millimetre is no skew"
        );
        for corner in
            ["[-0.80, 0.90, 0.00]", "[0.80, 0.90, 0.00]", "[2.0, 0.90, 0.00]", "[-800.0, 900.0, 0.0]"]
        {
            let error = refusal(WALL_UP, &format!("upper_left = {corner}"));
            assert!(
                error.contains("screen `wall` is ") && error.contains("three different corners"),
                "{error}"
            );
        }
    }

    #[test]
    fn numbers_outside_the_human_and_the_physical_range_are_refused() {
        assert!(refusal("ipd = 0.064", "ipd = 0.64").contains("0.045 to 0.080"));
        assert!(refusal("ipd = 0.064", "ipd = -0.064").contains("ipd is -0.064 m"));
        assert!(refusal("ipd = 0.064", "ipd = nan").contains("0.045 to 0.080"));
        assert!(refusal("ipd = 0.064", "ipd = 0").contains("only with stereo = \"mono\""));
        assert!(refusal("[1280, 1024]", "[0, 1024]").contains("`table` has 0 × 1024 pixels"));
        assert!(refusal("[1280, 1024]", "[1280, 102400]").contains("between 1 and 16384"));
        assert!(refusal("radius = 0.35", "radius = -1").contains("the workspace's radius is -1"));
        assert!(
            refusal(WALL_UP, "upper_left = [-0.8, inf, 0.0]")
                .contains("y of upper_left of screen `wall` is inf")
        );
        assert!(
            refusal("[0.0, 1.70, 1.50]", "[0.0, nan, 1.5]").contains("y of the viewer's position is NaN")
        );
        assert!(refusal("half_size = 0.80", "half_size = 0").contains("half_size is 0"));
    }

    #[test]
    fn a_mono_stage_needs_no_distance_between_the_eyes() {
        let desktop = BUILT_IN[3].1.replace("ipd = 0.064", "ipd = 0");
        assert_eq!(parse(&desktop, Path::new("d.toml")).unwrap().viewer.ipd_m, 0.0);
    }

    #[test]
    fn names_counts_and_directions_are_checked() {
        let error = refusal("name = \"wall\"", "name = \"table\"");
        let first = line_of("name = \"table\"") - 1;
        assert!(error.contains(&format!("named `table` (the first stands in line {first})")), "{error}");
        assert!(refusal("name = \"wall\"", "name = \"../wall\"").contains("cannot name a screen"));
        assert!(refusal("name = \"workbench\"", "name = \"\"").contains("cannot name a stage"));
        assert!(
            refusal("target = [0.0, 1.20, 0.50]", "target = [0.0, 1.70, 1.50]").contains("looks nowhere")
        );
        assert!(refusal("ipd = 0.064", "direction = [0, 0, -1]").contains("keep one"));
        assert!(
            refusal("[0.0, 1.70, 1.50]", "[0.0, 0.905, 1.50]")
                .contains("plane of screen `table` (5.0 mm away)")
        );
        let head = BUILT_IN[0].1.split("[[screen]]").next().unwrap();
        assert!(parse(head, Path::new("a.toml")).unwrap_err().to_string().contains("no screen"));
    }

    #[test]
    fn unknown_keys_name_the_line_and_the_nearest_key() {
        let error = refusal("upper_left", "uper_left");
        assert!(error.contains("did you mean `upper_left`?"), "{error}");
        let error = refusal("stereo = \"separate\"", "stereo = \"side-by-side\"");
        assert!(error.contains("did you mean `side_by_side`?"), "{error}");
    }

    #[test]
    fn without_a_direction_the_viewer_looks_at_the_workspace() {
        let stage = workbench_with("target = [0.0, 1.20, 0.50]", "").unwrap();
        let gaze = stage.viewer.room_from_head.rotation * -Vector3::z();
        assert!(gaze.cross(&(Vector3::new(0.0, 1.15, 0.55) - Vector3::new(0.0, 1.70, 1.50))).norm() < 1e-12);
    }
}
