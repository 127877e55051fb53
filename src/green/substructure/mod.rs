//! Parts into which a body is cut, each with its own Green's functions and energy.
//!
//! In: mesh, materials, control elements, the scene's key `parts`. Out: the tables from which the model `substructured` is made.
//! [`cut()`] finds the parts, [`solve`] solves each with its surroundings, and shares the surface among them; [`fit`] makes their
//! linear limit exact; [`tables`] keeps them for the .green file.

mod body;
mod cut;
mod linear;
mod part;
mod second_order;
mod stored;

pub use body::{Body, BodyError, Joint, SolvedBody, SolvedPart, solve, suits};
pub use cut::{Cut, Interface, cut};
pub use linear::fit;
pub use part::{PartError, PartSolution, coordinates, symmetric};
pub use second_order::pairs;
pub use stored::{StoredPart, StoredParts, TABLES, tables};
