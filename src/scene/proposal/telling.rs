//! What is said of the choices on the way to a proposal, and the control elements with what is said of them.

use super::super::write::Comments;
use super::super::{Control, Grab, Nodes};

/// What is said of the choices on the way.
#[derive(Default)]
pub struct Telling {
    pub comments: Comments,
    pub reasons: Vec<String>,
    pub warnings: Vec<String>,
}

impl Telling {
    pub fn comment(&mut self, key: &str, text: &str) {
        self.comments.insert(key.to_owned(), text.to_owned());
    }

    pub fn reason(&mut self, text: String) {
        self.reasons.push(text);
    }
}

/// A control element of the proposal, with what is said of it.
#[derive(Clone, Debug)]
pub struct Held {
    pub name: String,
    pub nodes: Nodes,
    pub grab: Grab,
    /// Behind `nodes`.
    pub comment: String,
}

impl Held {
    pub fn control(&self) -> Control {
        Control { nodes: self.nodes.clone(), grab: self.grab }
    }
}
