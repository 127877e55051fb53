//! Comments, reasons and warnings that explain the choices of a proposal, and its control elements with their comments.

use super::super::write::Comments;
use super::super::{Control, Grab, Nodes};

/// Comments, reasons and warnings that explain the choices of a proposal.
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

/// A control element of the proposal, with its comment.
#[derive(Clone, Debug)]
pub struct Held {
    pub name: String,
    pub nodes: Nodes,
    pub grab: Grab,
    /// Comment behind `nodes`.
    pub comment: String,
}

impl Held {
    pub fn control(&self) -> Control {
        Control { nodes: self.nodes.clone(), grab: self.grab }
    }
}
