//! The parts of a stage (screens, windows, viewer, workspace, trackers, force-feedback devices and sound), the built-in stages,
//! and the space before the screens: the ball in which a body is placed, and the grid that shows depth.

use super::error::StageError;
use super::haptic::Haptic;
use super::loudspeaker::Sound;
use super::screen::Screen;
use super::stereo::Stereo;
use super::tracking::Tracking;
use super::viewer::Viewer;
use super::window::{Monitor, Window};
use crate::config;
use nalgebra::{Point3, Similarity3, Translation3, UnitQuaternion, Vector3};
use std::borrow::Cow;
use std::path::PathBuf;

/// A display installation: its screens, the viewer, the workspace before the screens, windows, trackers, devices
/// and sound.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    pub name: String,
    pub description: String,
    pub stereo: Stereo,
    /// Each eye gets the other's picture, because glasses or projectors have them the other way round.
    pub swap_eyes: bool,
    pub viewer: Viewer,
    pub workspace: Workspace,
    pub grid: Option<Grid>,
    /// One screen or more; names are unique.
    pub screens: Vec<Screen>,
    /// Windows; if empty, those of [`Stage::usual_layout`].
    pub windows: Vec<Window>,
    /// The desktop's monitors by the file, for checks without a display.
    pub monitors: Vec<Monitor>,
    /// Trackers of head and hands, including force-feedback devices; empty if there are none.
    pub tracking: Tracking,
    /// Force-feedback devices; most stages have none.
    pub haptics: Vec<Haptic>,
    /// Loudspeakers or headphones.
    pub sound: Sound,
}

impl Stage {
    /// The screens' indices from the highest to the lowest, in the order of their pictures: a wall above its table.
    pub fn screens_from_top(&self) -> Vec<usize> {
        let height = |screen: &Screen| screen.point([0.0, 0.0]).y;
        let mut order: Vec<usize> = (0..self.screens.len()).collect();
        order.sort_by(|&a, &b| height(&self.screens[b]).total_cmp(&height(&self.screens[a])));
        order
    }

    /// The screen that the viewer's head faces most directly.
    pub fn faced_screen(&self) -> usize {
        let forward = self.viewer.room_from_head.rotation * -Vector3::z();
        let turned = |screen: &Screen| -screen.axes()[2].dot(&forward);
        let best = |(_, a): &(usize, &Screen), (_, b): &(usize, &Screen)| turned(a).total_cmp(&turned(b));
        self.screens.iter().enumerate().max_by(best).map_or(0, |(index, _)| index)
    }

    /// Whether a force-feedback device moves the stylus of this name.
    pub fn is_felt_in(&self, stylus: &str) -> bool {
        self.haptics.iter().any(|device| device.stylus == stylus)
    }
}

/// The files of the built-in stages, by name.
pub const BUILT_IN: [(&str, &str); 11] = [
    ("workbench", include_str!("../../configs/stages/workbench.toml")),
    ("workbench-one-sided", include_str!("../../configs/stages/workbench-one-sided.toml")),
    ("cyberstage", include_str!("../../configs/stages/cyberstage.toml")),
    ("desktop", include_str!("../../configs/stages/desktop.toml")),
    ("lbench", include_str!("../../configs/stages/lbench.toml")),
    ("cave3", include_str!("../../configs/stages/cave3.toml")),
    ("cave6", include_str!("../../configs/stages/cave6.toml")),
    ("powerwall", include_str!("../../configs/stages/powerwall.toml")),
    ("laptop", include_str!("../../configs/stages/laptop.toml")),
    ("demo", include_str!("../../configs/stages/demo.toml")),
    ("workbench-in-a-window", include_str!("../../configs/stages/workbench-in-a-window.toml")),
];

/// The text of a built-in stage or of a file, and the path that errors name.
pub fn text_of(name_or_path: &str) -> Result<(Cow<'static, str>, PathBuf), StageError> {
    if name_or_path.ends_with(".toml") {
        let path = PathBuf::from(name_or_path);
        return Ok((config::read(&path)?.into(), path));
    }
    match BUILT_IN.iter().find(|(name, _)| *name == name_or_path) {
        Some((name, text)) => Ok(((*text).into(), format!("configs/stages/{name}.toml").into())),
        None => {
            let (name, names) = (name_or_path.to_owned(), BUILT_IN.map(|(name, _)| name));
            let known = names.map(|name| format!("`{name}`")).join(", ");
            Err(StageError::Unknown { nearest: config::nearest(&name, names), name, known })
        }
    }
}

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
    use crate::stage::Stage;

    #[test]
    fn walls_stand_above_tables_and_floors() {
        let order = |name: &str| -> Vec<String> {
            let stage = Stage::find(name).unwrap();
            stage.screens_from_top().into_iter().map(|screen| stage.screens[screen].name.clone()).collect()
        };
        assert_eq!(order("workbench"), ["wall", "table"]);
        assert_eq!(order("cyberstage"), ["left", "front", "right", "floor"]);
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest() {
        let text = Stage::find("workbensh").unwrap_err().to_string();
        assert!(text.contains("did you mean `workbench`?") && text.contains("cyberstage"), "{text}");
        assert!(Stage::find("no/such.toml").unwrap_err().to_string().starts_with("no/such.toml: "));
    }

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
