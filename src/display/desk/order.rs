//! Orders of a person at the desk, by the panel or by a key.

use std::path::PathBuf;

/// An order of a person in the panel.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Show the draft of the panel.
    Apply,
    /// Give up the computation under way; the scene is shown on.
    GiveUp,
    /// Reset the draft to what is shown.
    Reset,
    Picture,
    Video,
    /// Record the session, or end that.
    Record,
    /// The bodies as they are, in the format of this name.
    Export(&'static str),
    Close,
    /// Let go of the control element under the cursor, or hold the one again that was let go of last.
    Release,
    /// Make control elements on the body of this name, or end that.
    Edit(Option<String>),
    /// Write the scene to the file of this name.
    Save(PathBuf),
}

/// Changes that windows have to follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum After {
    Nothing,
    /// The bodies are others.
    NewBodies,
    /// The bodies and the stage are others, and the windows have to be opened anew.
    NewWindows,
}
