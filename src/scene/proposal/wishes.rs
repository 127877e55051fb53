//! Wishes for a proposal.

use crate::mesh::length_unit::{LengthUnit, Scale};

/// Wishes of the user; all else is guessed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wishes {
    pub unit: Option<&'static LengthUnit>,
    /// Metres in one unit of the file; or else `unit`.
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
    /// Distance by which the ends are to be pulled, m, where forces are asked for.
    pub pull_m: Option<f64>,
    /// Whether an effect presses single points of the body, and whether one cuts it.
    pub is_touched: bool,
    pub is_cut: bool,
    /// Edge of the cells with which a surface is filled, m.
    pub cell: Option<f64>,
}

impl Wishes {
    /// Scale from the file's coordinates to metres, if it is given.
    pub fn asked_scale(&self) -> Option<Scale> {
        self.unit.map(|unit| Scale(unit.metres)).or(self.scale.map(Scale))
    }
}
