//! What a person asks for at the desk, by the panel or by a key.

use std::path::PathBuf;

/// What a person asks for in the panel.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Show what the panel says.
    Apply,
    /// Show on; what is being computed is forgotten.
    GiveUp,
    /// The panel says what is shown again.
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

/// What windows have to do after a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum After {
    Nothing,
    /// The bodies are others.
    NewBodies,
    /// So is the stage, and the windows have to be opened anew.
    NewWindows,
}
