//! The parts of a stage: its screens, windows, viewer, workspace, trackers and force-feedback devices.

use super::haptic::Haptic;
use super::screen::Screen;
use super::stereo::Stereo;
use super::tracking::Tracking;
use super::viewer::Viewer;
use super::window::{Monitor, Window};
use super::workspace::{Grid, Workspace};
use nalgebra::Vector3;

/// A display installation: its screens, the viewer, the workspace before the screens, windows, trackers and devices.
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_stand_above_tables_and_floors() {
        let order = |name: &str| -> Vec<String> {
            let stage = Stage::find(name).unwrap();
            stage.screens_from_top().into_iter().map(|screen| stage.screens[screen].name.clone()).collect()
        };
        assert_eq!(order("workbench"), ["wall", "table"]);
        assert_eq!(order("cyberstage"), ["left", "front", "right", "floor"]);
    }
}
