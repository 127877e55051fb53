//! Commands of the user besides poses and buttons. Keys are turned into them, and recordings contain them.

use super::mode::Mode;
use serde::{Deserialize, Serialize};

/// The grip of a hand that points at no control element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceGrip {
    /// No grip: hands take control elements only.
    #[default]
    Elements,
    /// The point of the surface, by a spring.
    Force,
    /// The point of the surface, which then is where the hand is.
    Place,
}

impl SurfaceGrip {
    /// The next one in turn.
    pub fn next(self) -> SurfaceGrip {
        match self {
            SurfaceGrip::Elements => SurfaceGrip::Force,
            SurfaceGrip::Force => SurfaceGrip::Place,
            SurfaceGrip::Place => SurfaceGrip::Elements,
        }
    }

    /// Words for an overlay.
    pub fn words(self) -> &'static str {
        match self {
            SurfaceGrip::Elements => "",
            SurfaceGrip::Force => ", pulls points",
            SurfaceGrip::Place => ", holds points",
        }
    }
}

/// A command. The commands of a frame are executed in order, before the styli are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Every hand lets go of what it holds; a button that is down grabs again.
    LetGo,
    /// Every hand lets go and everything is as at the start; nothing can be undone.
    Reset,
    /// Undoes the last grab, after letting go of what is held.
    Undo,
    Redo,
    /// All control elements go back to rest; one entry of the history.
    SnapBack,
    /// The scene and all bodies that were set aside return to their places.
    ResetNavigation,
    SetMode(Mode),
    /// Sets the grip of a hand that points at a body with `surface_compliance`.
    SetTaking(SurfaceGrip),
    /// Sets one column of the loads of a body, by their numbers.
    SetLoad {
        body: usize,
        column: usize,
        value: f64,
    },
    /// Sets the body of this number aside, or brings it back.
    SetAside(usize),
    /// Scales the scene by this factor.
    ScaleScene(f64),
    /// Sets the next end of the ruler where the ray hits a surface; takes a whole ruler away.
    Measure,
    /// Shows the next field in colours.
    NextField,
    /// Effects forget what they draw of the past: curves, and the largest value so far.
    Clear,
}
