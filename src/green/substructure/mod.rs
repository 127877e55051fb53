//! A body cut into parts, each with Green's functions and an energy of its own.
//!
//! In: mesh, materials, control elements, the scene's key `parts`. Out: what the model `substructured` is made from.
//! [`cut()`] finds the parts, [`solve`] solves each with what surrounds it, and shares the
//! surface among them; [`tables`] keeps them for the .green file.

mod body;
mod cut;
mod part;
mod second_order;
mod series;
mod stored;
mod strain_point;

pub use body::{Body, BodyError, Joint, SolvedBody, SolvedPart, solve, suits};
pub use cut::{Cut, Interface, cut};
pub use part::{PartError, PartSolution, coordinates, symmetric};
pub use second_order::pairs;
pub use stored::{StoredPart, StoredParts, TABLES, tables};
