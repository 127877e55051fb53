//! Column families: one entry says how the numbers of a family are made, written, checked and read again.

use super::bytes::Tensor;
use super::error::GreenError;
use super::file::{BodyMeta, GreenFile};
use super::kept::Caching;
use super::prepare::Prepared;
use super::requirements::Family;
use super::solution::{Precomputed, Solution};
use crate::base::columns::ColumnGroup;
use crate::fem::{Lame, NodeFields, Partition, StiffnessMatrix};
use crate::scene::{Body, Scene};
use crate::solve::{Factor, Progress};

/// One column.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnName {
    pub name: String,
    /// Unit of its coefficient; "1" of a pure number.
    pub unit: String,
    pub source: ColumnSource,
}

/// The cause to which a column is the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnSource {
    /// A field of a control element.
    Field {
        control: usize,
        field: usize,
    },
    Load,
    /// No cause alone: its coefficient follows from the others by the model's equilibrium.
    Model,
}

/// The assembled system and the settings from which a family is made, beside the affine fields.
pub struct Assembled<'a> {
    /// `scene: body.name`, for errors.
    pub place: &'a str,
    pub scene: &'a Scene,
    /// The body's name in it.
    pub name: &'a str,
    /// The scene's settings of the body.
    pub body: &'a Body,
    pub lame: &'a [Lame],
    pub k: &'a StiffnessMatrix,
    pub partition: &'a Partition,
    /// The factor of A, for a family with [`FamilyEntry::solves`]; `None` where nothing is free.
    pub factor: Option<&'a dyn Factor>,
    pub caching: Option<Caching>,
    /// Solves A x = b at the free nodes by it.
    pub solve: &'a dyn Fn(&NodeFields, &dyn Progress) -> Result<NodeFields, GreenError>,
}

/// Makes the numbers of a family from what was solved, and leaves them in the solution.
pub type Compute = fn(&Assembled<'_>, &mut Solution, &dyn Progress) -> Result<(), GreenError>;

/// Computes more than the families from the assembled system, while its factor is at hand: what effects need of it.
pub type Further<'a> = &'a dyn Fn(&Assembled<'_>, &mut Solution, &dyn Progress) -> Result<(), GreenError>;

/// Judges a body by what is known before it is solved; `place` is `scene: body.name`, for errors.
pub type Suits = fn(place: &str, body: &Body, prepared: &Prepared) -> Result<(), GreenError>;

/// One entry of the list of families.
pub struct FamilyEntry {
    pub family: Family,
    /// Description of its numbers, in one line.
    pub holds: &'static str,
    /// Refuses bodies that cannot have the family; `None` where every body can.
    pub suits: Option<Suits>,
    /// `None` where its numbers are the solved fields themselves.
    pub compute: Option<Compute>,
    /// Whether it solves with A, whose factor is then kept until it is made.
    pub solves: bool,
    /// Makes its tensors for the .green file, by their names within the body; what it knows of their accuracy goes into the
    /// metadata.
    pub write: fn(&Precomputed, &mut BodyMeta) -> Vec<(String, Tensor)>,
    /// Whether the tensors of a body of this name are there and can be used; the error names the first fault.
    pub check: fn(&GreenFile, &str, &BodyMeta) -> Result<(), String>,
    /// The columns that are summed online, group by group.
    pub groups: for<'a> fn(&'a GreenFile, &str) -> Vec<ColumnGroup<'a>>,
    /// Bytes of those of its numbers that do not grow with the surface, by the number of control elements.
    pub fixed_bytes: fn(usize) -> usize,
    /// Whether it is found again when a control element is released or a modulus changed.
    pub is_derived: bool,
    /// Names of its columns in a body; `None` where they are numbered, or where there are none.
    pub column_names: Option<fn(&BodyMeta) -> Vec<ColumnName>>,
}
