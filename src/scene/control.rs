//! A control element of a body, as a scene names it.

use super::select::Nodes;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { nodes = { group = \"left\" }, grab = \"dragger\" }")]
pub struct Control {
    pub nodes: Nodes,
    pub grab: Grab,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Grab {
    /// Stays where it is.
    Fixed,
    /// Can be taken by a stylus.
    Dragger,
}

impl Grab {
    /// Name in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Grab::Fixed => "fixed",
            Grab::Dragger => "dragger",
        }
    }
}
