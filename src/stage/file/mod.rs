//! Stage files: strict TOML in; out a [`Stage`] with usable screens, or an error that names file, line, screen and remedy.
//! The checks cover the mistakes that occur when display walls are set up: mirrored and skewed corners, other units.

mod corners;
mod haptic;
mod mount;
mod screen;
mod sides;
mod sound;
mod tracking;
mod values;
mod window;

use self::haptic::HapticFile;
use self::screen::{ScreenFile, TapedScreen, screen};
use self::sound::{LoudspeakerFile, SoundFile};
use self::tracking::{SensorFile, StylusFile, TrackerFile};
use self::values::{check_name, length, point};
use self::window::{MonitorFile, WindowFile};
use super::description::{Grid, Stage, Workspace, text_of};
use super::error::{IPD_M, LocatedFault, MAX_SIDE_M, StageError, StageFault, TrackingFault};
use super::haptic::Haptic;
use super::loudspeaker::{Loudspeaker, Sound};
use super::screen::{ROOM_LIMIT_M, Screen};
use super::stereo::Stereo;
use super::tracking::Tracking;
use super::viewer::{Viewer, rotation_towards};
use super::window::Window;
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
    #[serde(default)]
    swap_eyes: bool,
    viewer: Spanned<ViewerFile>,
    workspace: Spanned<WorkspaceFile>,
    grid: Option<Spanned<GridFile>>,
    #[serde(default, rename = "screen")]
    screens: Vec<Spanned<ScreenFile>>,
    #[serde(default, rename = "window")]
    windows: Vec<Spanned<WindowFile>>,
    #[serde(default, rename = "monitor")]
    monitors: Vec<Spanned<MonitorFile>>,
    #[serde(default)]
    tracker: IndexMap<String, Spanned<TrackerFile>>,
    #[serde(default)]
    sensor: IndexMap<String, Spanned<SensorFile>>,
    #[serde(default)]
    stylus: IndexMap<String, Spanned<StylusFile>>,
    #[serde(default)]
    haptic: IndexMap<String, Spanned<HapticFile>>,
    sound: Option<Spanned<SoundFile>>,
    #[serde(default, rename = "loudspeaker")]
    loudspeakers: Vec<Spanned<LoudspeakerFile>>,
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

impl Stage {
    /// The built-in stage of this name, or the stage in a file: anything that ends in `.toml` is a path. The keys of the
    /// trackers' sources are not checked here, because `stage` does not know the sources: `track::checked` checks them.
    pub fn find(name_or_path: &str) -> Result<Self, StageError> {
        let (text, path) = text_of(name_or_path)?;
        Self::parse(&text, &path)
    }

    /// The text of the built-in stage of this name, or of a file.
    pub fn text(name_or_path: &str) -> Result<std::borrow::Cow<'static, str>, StageError> {
        Ok(text_of(name_or_path)?.0)
    }

    /// Parses a stage and collects all faults instead of the first one only.
    ///
    /// # Errors
    /// [`StageError::File`] and [`StageError::Unknown`], if there is no stage file that can be read.
    pub fn survey(name_or_path: &str) -> Result<Survey, StageError> {
        let (text, path) = text_of(name_or_path)?;
        survey(&text, &path)
    }

    pub fn load(path: &Path) -> Result<Self, StageError> {
        let text = config::read(path)?;
        Self::parse(&text, path)
    }

    /// Checks the text of a stage file; `path` is only named in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, StageError> {
        let Survey { stage, faults, .. } = survey(text, path)?;
        let no_screen = || LocatedFault { line: 1, fault: StageFault::NoScreen };
        match (faults.into_iter().next(), stage) {
            (None, Some(stage)) => Ok(stage),
            (first, _) => {
                let LocatedFault { line, fault } = first.unwrap_or_else(no_screen);
                Err(StageError::Invalid { path: path.to_owned(), line, fault })
            }
        }
    }
}

/// A stage file with all its faults.
pub struct Survey {
    /// The stage without its unusable parts, if that is possible.
    pub stage: Option<Stage>,
    /// The trackers, also if there is no stage.
    pub tracking: Tracking,
    pub faults: Vec<LocatedFault>,
}

/// Collects faults with their lines.
struct FaultList<'a> {
    text: &'a str,
    found: Vec<LocatedFault>,
}

impl FaultList<'_> {
    fn push(&mut self, offset: usize, fault: StageFault) {
        let line = config::line_and_column(self.text, offset).0;
        self.found.push(LocatedFault { line, fault });
    }

    fn keep<T>(&mut self, offset: usize, result: Result<T, StageFault>) -> Option<T> {
        result.map_err(|fault| self.push(offset, fault)).ok()
    }
}

/// Reads the whole text of a stage file and continues after a fault; `path` is only named in errors.
pub fn survey(text: &str, path: &Path) -> Result<Survey, StageError> {
    let scene =
        "this is a scene; a stage has [[screen]] tables. Show it with `greenstage view`, without --stage";
    config::refuse_other(text, path, "screen", ["body", "stage"], scene)?;
    let file: StageFile = config::parse(text, path)?;
    let mut faults = FaultList { text, found: Vec::new() };
    faults.keep(0, check_name("stage", &file.name));
    let workspace = faults.keep(file.workspace.span().start, workspace(file.workspace.get_ref()));
    let start = file.viewer.span().start;
    let centre = workspace.map(|workspace| workspace.centre);
    let viewer = faults.keep(start, viewer(file.viewer.get_ref(), centre));
    let grid = file.grid.as_ref().and_then(|found| faults.keep(found.span().start, grid(found.get_ref())));
    if file.screens.is_empty() {
        faults.push(0, StageFault::NoScreen);
    }
    let names: Vec<String> = file.screens.iter().map(|screen| screen.get_ref().name.clone()).collect();
    let screens = screens(file.screens, viewer.as_ref(), workspace.as_ref(), &mut faults);
    let windows = windows(file.windows, &screens, &names, file.stereo, &mut faults);
    let mut kinds = windows.iter().flat_map(|window| &window.tiles).map(|tile| tile.stereo);
    let is_mono = file.stereo == Stereo::Mono && kinds.all(|kind| kind == Stereo::Mono);
    faults.keep(start, check_ipd(file.viewer.get_ref().ipd, is_mono));
    let monitors = file.monitors.into_iter().filter_map(|found| {
        let start = found.span().start;
        faults.keep(start, window::monitor(found.into_inner()))
    });
    let monitors = monitors.collect();
    let head = file.viewer.get_ref().head.as_ref();
    let mut keep = |offset: usize, fault: TrackingFault| faults.push(offset, fault.into());
    let mut tracking = tracking::check(file.tracker, file.sensor, file.stylus, head, (text, path), &mut keep);
    let haptics = file.haptic.iter().filter_map(|(name, found)| {
        let checked = check_name("haptic device", name).and_then(|()| {
            let haptic = haptic::check(name, found.get_ref())?;
            haptic::sense(&haptic, &mut tracking).map(|()| haptic)
        });
        let start = found.span().start;
        Some((start, faults.keep(start, checked)?))
    });
    let haptics: Vec<(usize, Haptic)> = haptics.collect();
    for (i, (start, haptic)) in haptics.iter().enumerate() {
        let others = haptics[..i].iter().map(|(_, other)| other);
        faults.keep(*start, haptic::check_stylus(haptic, others, &tracking));
    }
    let haptics = haptics.into_iter().map(|(_, haptic)| haptic).collect();
    let sound = sound(file.sound, file.loudspeakers, &mut faults);
    let StageFile { name, description, stereo, swap_eyes, .. } = file;
    let stage = match (viewer, workspace) {
        (Some(viewer), Some(workspace)) if !screens.is_empty() => Some(Stage {
            name,
            description,
            stereo,
            swap_eyes,
            viewer,
            workspace,
            grid,
            screens,
            windows,
            monitors,
            tracking: tracking.clone(),
            haptics,
            sound,
        }),
        _ => None,
    };
    Ok(Survey { stage, tracking, faults: faults.found })
}

/// The screens that can be used, including skewed and mirrored ones.
fn screens(
    files: Vec<Spanned<ScreenFile>>,
    viewer: Option<&Viewer>,
    workspace: Option<&Workspace>,
    faults: &mut FaultList<'_>,
) -> Vec<Screen> {
    let eye = viewer.map(|viewer| Point3::from(viewer.room_from_head.translation.vector));
    let mut lines = BTreeMap::new();
    let mut screens: Vec<(usize, TapedScreen)> = Vec::new();
    for found in files {
        let start = found.span().start;
        let Some(screen) = faults.keep(start, screen(found.into_inner())) else { continue };
        screens.push((start, screen));
    }
    let mut rectangles = Vec::new();
    for (start, measured) in &screens {
        let screen = &measured.screen;
        if faults.keep(*start, corners::check(screen, eye.as_ref())).is_some() {
            rectangles.push((*start, measured));
        }
        let line = config::line_and_column(faults.text, *start).0;
        if let Some(first_line) = lines.insert(screen.name.clone(), line) {
            faults.push(*start, StageFault::Duplicate { screen: screen.name.clone(), first_line });
        }
    }
    if let Some(eye) = eye {
        let shapes: Vec<&TapedScreen> = rectangles.iter().map(|(_, measured)| *measured).collect();
        for (i, fault) in sides::check(&shapes, &eye, workspace) {
            faults.push(rectangles[i].0, fault);
        }
    }
    screens.into_iter().map(|(_, measured)| measured.screen).collect()
}

/// The loudspeakers that can be used, and the rest of the sound as it usually is where it is at fault.
fn sound(
    file: Option<Spanned<SoundFile>>,
    loudspeakers: Vec<Spanned<LoudspeakerFile>>,
    faults: &mut FaultList<'_>,
) -> Sound {
    let mut usable: Vec<Loudspeaker> = Vec::new();
    for (i, found) in loudspeakers.iter().enumerate() {
        usable.extend(faults.keep(found.span().start, sound::loudspeaker(found.get_ref(), i + 1)));
    }
    let start = file.as_ref().map_or(0, |found| found.span().start);
    let file = file.map(Spanned::into_inner).unwrap_or_default();
    faults.keep(start, sound::sound(&file, usable, loudspeakers.len())).unwrap_or_default()
}

/// The windows of usable screens; `names` are those of all screens in the file.
fn windows(
    files: Vec<Spanned<WindowFile>>,
    screens: &[Screen],
    names: &[String],
    stereo: Stereo,
    faults: &mut FaultList<'_>,
) -> Vec<Window> {
    let mut windows: Vec<Window> = Vec::new();
    for (i, found) in files.into_iter().enumerate() {
        let start = found.span().start;
        // A screen that is refused is one fault, not another one in each of its windows.
        let is_refused = |name: &str| {
            names.iter().any(|known| known == name) && screens.iter().all(|screen| screen.name != name)
        };
        if found.get_ref().shows().any(is_refused) {
            continue;
        }
        let made = window::window(found.into_inner(), i + 1, screens, stereo);
        let Some(window) = faults.keep(start, made) else { continue };
        if windows.iter().any(|other| other.name == window.name) {
            faults.push(start, StageFault::DuplicateWindow { window: window.name.clone() });
        }
        windows.push(window);
    }
    windows
}

fn workspace(file: &WorkspaceFile) -> Result<Workspace, StageFault> {
    Ok(Workspace {
        centre: point("the workspace's centre", file.centre)?,
        radius_m: length("the workspace's radius", file.radius, 0.001, MAX_SIDE_M)?,
    })
}

fn grid(file: &GridFile) -> Result<Grid, StageFault> {
    Ok(Grid {
        height_m: length("the grid's height", file.height, -ROOM_LIMIT_M, ROOM_LIMIT_M)?,
        half_size_m: length("the grid's half_size", file.half_size, 0.001, ROOM_LIMIT_M)?,
    })
}

fn viewer(file: &ViewerFile, workspace: Option<Point3<f64>>) -> Result<Viewer, StageFault> {
    let position = point("the viewer's position", file.position)?;
    let direction = match (file.target, file.direction) {
        (Some(_), Some(_)) => return Err(StageFault::TwoDirections),
        (Some(target), None) => point("the viewer's target", target)? - position,
        (None, Some(direction)) => point("the viewer's direction", direction)?.coords,
        (None, None) => workspace.map_or(-Vector3::z(), |centre| centre - position),
    };
    let rotation = rotation_towards(&direction, 0.0).ok_or(StageFault::NoDirection)?;
    let room_from_head = Isometry3::from_parts(Translation3::from(position.coords), rotation);
    Ok(Viewer { room_from_head, ipd_m: file.ipd })
}

fn check_ipd(ipd_m: f64, is_mono: bool) -> Result<(), StageFault> {
    match IPD_M.contains(&ipd_m) || ipd_m == 0.0 && is_mono {
        true => Ok(()),
        false => Err(StageFault::Ipd { ipd_m }),
    }
}

#[cfg(test)]
mod tests;
