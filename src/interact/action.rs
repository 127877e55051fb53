//! What a user commands at once, apart from poses and buttons: keys become these, and recordings keep them.

use super::mode::Mode;
use serde::{Deserialize, Serialize};

/// A command. Those of one frame are carried out in order, before the styli are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Every hand lets go of what it holds; a button that is down grabs again.
    LetGo,
    /// All lets go and stands as at the start; nothing can be undone.
    Reset,
    /// Takes back the last grab; what is held is let go first.
    Undo,
    Redo,
    /// All control elements go back to rest; one entry of the history.
    SnapBack,
    /// The scene and all bodies set aside go back to where the stage has them.
    ResetNavigation,
    SetMode(Mode),
    /// Sets the body of this number aside, or brings it back.
    SetAside(usize),
    /// Scales the scene about the workspace's centre by this factor.
    ScaleScene(f64),
}
