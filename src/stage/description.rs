//! What a stage consists of: its screens, windows, viewer, workspace, trackers and force-feedback devices.

use super::haptic::Haptic;
use super::screen::Screen;
use super::stereo::Stereo;
use super::tracking::Tracking;
use super::viewer::{Eye, Viewer};
use super::window::{Monitor, Window};
use super::workspace::{Grid, Workspace};
use nalgebra::Vector3;

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

impl Stage {
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
