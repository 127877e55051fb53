//! What a column family is: one entry says how its numbers are made, written, checked and read again.

use super::error::GreenError;
use super::file::{BodyMeta, GreenFile};
use super::prepare::Prepared;
use super::requirements::Family;
use super::solution::{Precomputed, Solution};
use super::tensor::Tensor;
use crate::base::columns::ColumnGroup;
use crate::fem::{Lame, NodeFields, Partition, StiffnessMatrix};
use crate::scene::{Body, Scene};
use crate::solve::{Factor, Progress};

/// One column.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnName {
    pub name: String,
    /// Of its coefficient; "1" of a pure number.
    pub unit: String,
    pub source: ColumnSource,
}

/// What a column is the answer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnSource {
    /// A field of a control element.
    Field {
        control: usize,
        field: usize,
    },
    Load,
    /// Nothing by itself: its coefficient follows from the others by the model's equilibrium.
    Model,
}

/// What a family is made from beside the affine fields.
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
    /// That of A, for a family with [`FamilyEntry::solves`]; `None` where nothing is free.
    pub factor: Option<&'a dyn Factor>,
    /// Solves A x = b at the free nodes by it.
    pub solve: &'a dyn Fn(&NodeFields, &dyn Progress) -> Result<NodeFields, GreenError>,
}

/// Makes the numbers of a family from what was solved, and leaves them in the solution.
pub type Compute = fn(&Assembled<'_>, &mut Solution, &dyn Progress) -> Result<(), GreenError>;

/// Judges a body by what is known before it is solved; `place` is `scene: body.name`, for errors.
pub type Suits = fn(place: &str, body: &Body, prepared: &Prepared) -> Result<(), GreenError>;

/// One entry of the list of families.
pub struct FamilyEntry {
    pub family: Family,
    /// What its numbers are, in one line.
    pub holds: &'static str,
    /// Refuses bodies that cannot have the family; `None` where every body can.
    pub suits: Option<Suits>,
    /// `None` where its numbers are the solved fields themselves.
    pub compute: Option<Compute>,
    /// Whether it solves with A, whose factor is then kept until it is made.
    pub solves: bool,
    /// Its tensors in the .green file, by their names within the body; what it knows of their accuracy goes into the
    /// metadata.
    pub write: fn(&Precomputed, &mut BodyMeta) -> Vec<(String, Tensor)>,
    /// Whether the tensors of a body of this name are there and can be used; the error names the first fault.
    pub check: fn(&GreenFile, &str, &BodyMeta) -> Result<(), String>,
    /// The columns that are summed online, group by group.
    pub groups: for<'a> fn(&'a GreenFile, &str) -> Vec<ColumnGroup<'a>>,
    /// Bytes of those of its numbers that do not grow with the surface, of a body of so many control elements.
    pub fixed_bytes: fn(usize) -> usize,
    /// Whether it is found again when a control element is released or a modulus changed.
    pub is_derived: bool,
    /// What its columns are called in a body; `None` where they are numbered, or where there are none.
    pub column_names: Option<fn(&BodyMeta) -> Vec<ColumnName>>,
}
