//! What must be precomputed for a body beside its basis columns.

/// What a body's model and effects need beside the basis columns; nothing else is computed or stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Needs {
    /// The 12E × 12E handle stiffness S.
    pub stiffness: bool,
}

impl Needs {
    /// What either asks for.
    pub fn and(self, other: Needs) -> Needs {
        Needs { stiffness: self.stiffness || other.stiffness }
    }
}
