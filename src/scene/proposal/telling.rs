//! Comments, reasons and warnings that explain the choices of a proposal, and its control elements with their comments.

use super::super::write::Comments;
use super::super::{Control, Grab, Nodes};

/// Comments, reasons and warnings that explain the choices of a proposal.
#[derive(Default)]
pub struct Explanations {
    pub comments: Comments,
    pub reasons: Vec<String>,
    pub warnings: Vec<String>,
}

impl Explanations {
    pub fn comment(&mut self, key: &str, text: &str) {
        self.comments.insert(key.to_owned(), text.to_owned());
    }

    pub fn reason(&mut self, text: String) {
        self.reasons.push(text);
    }
}

/// A control element of the proposal, with its comment.
#[derive(Clone, Debug)]
pub struct HeldElement {
    pub name: String,
    pub nodes: Nodes,
    pub grab: Grab,
    /// Comment behind `nodes`.
    pub comment: String,
}

impl HeldElement {
    pub fn control(&self) -> Control {
        Control { nodes: self.nodes.clone(), grab: self.grab }
    }
}
