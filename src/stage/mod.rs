//! Where pictures are shown: screens in a room, the viewer's eyes, and the off-axis projection between them.
//!
//! In: a stage file (strict TOML, or one that is built in). Out: a checked [`Stage`], whose screens give an
//! [`EyeView`] for any eye. Lengths in metres in the room's frame: x right, y up, right-handed; f64 until the
//! last step. From R. Kooima, "Generalized Perspective Projection" (2008).

mod fault;
mod file;
mod haptic;
mod lint;
mod overlap;
mod screen;
mod seam;
mod stereo;
mod summary;
pub mod tracking;
mod window;

pub use fault::{Fault, Located, StageError};
pub use file::Survey;
pub use haptic::{GripButton, Haptic, HapticDevice};
pub use lint::{Level, Lint, lint};
pub use screen::{EyeView, Frustum, MIN_EYE_DISTANCE_M, ROOM_LIMIT_M, Screen, Unseen};
pub use seam::{Edge, Seam};
pub use stereo::Stereo;
pub use tracking::Tracking;
pub use window::{Border, Monitor, MonitorId, Tile, Visible, Window};

use crate::config;
use nalgebra::{Isometry3, Point3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// A place of projection: its screens, who looks at them from where, and what space lies before them.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    pub name: String,
    pub description: String,
    pub stereo: Stereo,
    /// Each eye is shown what the other should see, because glasses or projectors have them the other way round.
    pub swap_eyes: bool,
    pub viewer: Viewer,
    pub workspace: Workspace,
    pub grid: Option<Grid>,
    /// At least one; names are unique.
    pub screens: Vec<Screen>,
    /// None: those of [`Stage::usual_layout`].
    pub windows: Vec<Window>,
    /// What the file says of the desktop, for checks where there is no display.
    pub monitors: Vec<Monitor>,
    /// What follows head and hands, force-feedback devices among it; empty where nothing does.
    pub tracking: Tracking,
    /// Force-feedback devices; mostly none.
    pub haptics: Vec<Haptic>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Eye {
    Left,
    Right,
    /// Midway between the two: what a mono stage shows, and where the mouse aims from.
    Centre,
}

/// The viewer's head as long as no tracker reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewer {
    /// The head's x axis points to the right ear and -z to where it looks; its origin is midway between the eyes.
    pub room_from_head: Isometry3<f64>,
    /// Inter-pupillary distance in metres.
    pub ipd_m: f64,
}

/// The ball in which a body is placed and handled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    pub centre: Point3<f64>,
    pub radius_m: f64,
}

/// A horizontal square of lines about the room's vertical axis through the workspace, to see depth by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    pub height_m: f64,
    pub half_size_m: f64,
}

/// The stage files that the program carries within itself, by name.
pub const BUILT_IN: [(&str, &str); 9] = [
    ("workbench", include_str!("../../configs/stages/workbench.toml")),
    ("workbench-one-sided", include_str!("../../configs/stages/workbench-one-sided.toml")),
    ("cyberstage", include_str!("../../configs/stages/cyberstage.toml")),
    ("desktop", include_str!("../../configs/stages/desktop.toml")),
    ("lbench", include_str!("../../configs/stages/lbench.toml")),
    ("cave3", include_str!("../../configs/stages/cave3.toml")),
    ("cave6", include_str!("../../configs/stages/cave6.toml")),
    ("powerwall", include_str!("../../configs/stages/powerwall.toml")),
    ("laptop", include_str!("../../configs/stages/laptop.toml")),
];

impl Stage {
    /// The stage of a built-in name, or of a file: whatever ends in `.toml` is a path.
    pub fn find(name_or_path: &str) -> Result<Self, StageError> {
        let (text, path) = text_of(name_or_path)?;
        Self::parse(&text, &path)
    }

    /// The same with all that is wrong with it, instead of the first fault alone.
    ///
    /// # Errors
    /// [`StageError::File`] and [`StageError::Unknown`]: there is nothing to be surveyed.
    pub fn survey(name_or_path: &str) -> Result<Survey, StageError> {
        let (text, path) = text_of(name_or_path)?;
        file::survey(&text, &path)
    }

    /// Reads and checks a stage file.
    pub fn load(path: &Path) -> Result<Self, StageError> {
        file::load(path)
    }

    /// Checks the text of a stage file; `path` is only named in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, StageError> {
        file::parse(text, path)
    }

    /// The screens' indices from the highest to the lowest, as pictures of them are stacked: a wall above its table.
    pub fn screens_from_top(&self) -> Vec<usize> {
        let height = |screen: &Screen| screen.point([0.0, 0.0]).y;
        let mut order: Vec<usize> = (0..self.screens.len()).collect();
        order.sort_by(|&a, &b| height(&self.screens[b]).total_cmp(&height(&self.screens[a])));
        order
    }

    /// The screen that the viewer's head is turned to most.
    pub fn faced_screen(&self) -> usize {
        let forward = self.viewer.room_from_head.rotation * -Vector3::z();
        let turned = |screen: &Screen| -screen.axes()[2].dot(&forward);
        let best = |(_, a): &(usize, &Screen), (_, b): &(usize, &Screen)| turned(a).total_cmp(&turned(b));
        self.screens.iter().enumerate().max_by(best).map_or(0, |(index, _)| index)
    }

    /// Names of the styli in the order of their tracker's state; where none is tracked, those of the hands.
    pub fn stylus_names(&self) -> Vec<&str> {
        self.tracking.stylus_names()
    }

    /// The eyes for which each screen is drawn, in the order of drawing.
    pub fn eyes(&self) -> &'static [Eye] {
        self.stereo.eyes()
    }
}

/// The text of a built-in stage or of a file, and the path to be named in errors.
fn text_of(name_or_path: &str) -> Result<(Cow<'static, str>, PathBuf), StageError> {
    if name_or_path.ends_with(".toml") {
        let path = PathBuf::from(name_or_path);
        return Ok((config::read(&path)?.into(), path));
    }
    match BUILT_IN.iter().find(|(name, _)| *name == name_or_path) {
        Some((name, text)) => Ok(((*text).into(), format!("configs/stages/{name}.toml").into())),
        None => Err(fault::unknown(name_or_path)),
    }
}

impl Eye {
    /// The one that swapped eyes show instead.
    pub fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            Self::Centre => Self::Centre,
        }
    }

    /// For file names and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Centre => "centre",
        }
    }
}

impl Viewer {
    /// Where an eye of a head is: ±ipd/2 along the head's x axis.
    pub fn eye_in_room(&self, room_from_head: &Isometry3<f64>, eye: Eye) -> Point3<f64> {
        let x = match eye {
            Eye::Left => -self.ipd_m / 2.0,
            Eye::Right => self.ipd_m / 2.0,
            Eye::Centre => 0.0,
        };
        room_from_head * Point3::new(x, 0.0, 0.0)
    }
}

impl Workspace {
    /// How much of the ball's radius a body's largest half-extent takes up.
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

/// The rotation whose -z axis points along `direction`, with x horizontal and y as upward as can be; then
/// turned by `roll` radians about that -z axis, right-handed. Looking straight up or down, x stays the room's.
/// `None` if the direction has no length or is not finite.
pub fn rotation_towards(direction: &Vector3<f64>, roll: f64) -> Option<UnitQuaternion<f64>> {
    let forward = direction.try_normalize(1e-12).filter(|unit| unit.iter().all(|x| x.is_finite()))?;
    let right = forward.cross(&Vector3::y()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let axes = [right, right.cross(&forward), -forward];
    let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&axes));
    roll.is_finite().then(|| level * UnitQuaternion::from_axis_angle(&-Vector3::z_axis(), roll))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_towards_any_direction_is_level() {
        for direction in
            [[0.0, -0.5, -1.0], [1.0, 0.0, 0.0], [0.3, 0.9, 0.2], [0.0, 1.0, 0.0], [0.0, -2.0, 0.0]]
        {
            let direction = Vector3::from(direction);
            let rotation = rotation_towards(&direction, 0.0).unwrap();
            assert!((rotation * -Vector3::z() - direction.normalize()).norm() < 1e-12);
            assert!((rotation * Vector3::x()).y.abs() < 1e-12);
            assert!((rotation * Vector3::y()).y > -1e-12);
        }
        assert_eq!(rotation_towards(&Vector3::zeros(), 0.0), None);
        assert_eq!(rotation_towards(&Vector3::new(f64::NAN, 0.0, 1.0), 0.0), None);
        assert_eq!(rotation_towards(&Vector3::x(), f64::INFINITY), None);
    }

    #[test]
    fn roll_turns_about_the_ray() {
        let rotation = rotation_towards(&-Vector3::z(), std::f64::consts::FRAC_PI_2).unwrap();
        // Right-handed about -z: x goes to -y.
        assert!((rotation * Vector3::x() + Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn eyes_lie_half_an_ipd_along_the_heads_x() {
        let stage = Stage::find("cyberstage").unwrap();
        let head = stage.viewer.room_from_head;
        let [left, right] = [Eye::Left, Eye::Right].map(|eye| stage.viewer.eye_in_room(&head, eye));
        assert!((right - left - Vector3::new(0.064, 0.0, 0.0)).norm() < 1e-12);
        assert!((stage.viewer.eye_in_room(&head, Eye::Centre) - Point3::new(0.0, 1.7, 0.4)).norm() < 1e-12);
    }

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

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest() {
        let text = Stage::find("workbensh").unwrap_err().to_string();
        assert!(text.contains("did you mean `workbench`?") && text.contains("cyberstage"), "{text}");
        assert!(Stage::find("no/such.toml").unwrap_err().to_string().starts_with("no/such.toml: "));
    }
}
