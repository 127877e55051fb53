//! What is asked of a proposal.

use crate::mesh::length_unit::{LengthUnit, Scale};

/// What is asked for; all else is guessed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wishes {
    pub unit: Option<&'static LengthUnit>,
    /// Or else `unit`.
    pub scale: Option<f64>,
    /// A name of the library.
    pub material: Option<String>,
    pub model: Option<String>,
    pub stage: Option<String>,
    /// Names of effects.
    pub effects: Vec<String>,
    /// Node groups of the file.
    pub fixed: Vec<String>,
    pub grab: Vec<String>,
    /// How far the ends are to be pulled, m, where forces are asked for.
    pub pull_m: Option<f64>,
    /// Of a surface: the cell that it is filled with, m.
    pub cell: Option<f64>,
}

impl Wishes {
    /// By what the file's coordinates become metres, if that was said.
    pub fn asked_scale(&self) -> Option<Scale> {
        self.unit.map(|unit| Scale(unit.metres)).or(self.scale.map(Scale))
    }
}
