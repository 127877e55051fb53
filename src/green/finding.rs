//! One thing found wrong, or worth a word, in a body.

use crate::mesh::diagnostics::Severity;

/// One thing found without solving.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Finding {
    pub severity: Severity,
    /// The scene's key it belongs to.
    pub entity: String,
    /// What, where, and what to do.
    pub message: String,
}

impl Finding {
    pub fn new(severity: Severity, entity: &str, message: impl Into<String>) -> Finding {
        Finding { severity, entity: entity.to_owned(), message: message.into() }
    }
}

impl std::fmt::Display for Finding {
    /// "warning: body.tube.material: …".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}: {}", self.severity, self.entity, self.message)
    }
}
