//! Methods by which a body is solved.

use serde::{Deserialize, Serialize};

/// `method = "bem"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Finite elements in tetrahedra.
    #[default]
    Fem,
    /// Boundary elements on the triangles of the surface.
    Bem,
}

impl Method {
    /// Name in scenes and .green files.
    pub fn name(self) -> &'static str {
        match self {
            Method::Fem => "fem",
            Method::Bem => "bem",
        }
    }
}
