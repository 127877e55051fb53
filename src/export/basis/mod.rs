//! Exports the contents of a body's .green file for other programs: the surface at rest and every column, so that they can sum.
//!
//! In: [`BodyBasis`] of each body. Out: one file, by one of [`BASIS_FILES`].
//!
//! To add a format: write a file with a [`BasisFile`], add it to the list, and name it in the chapter `export` of the manual.

mod basis_file;
mod basis_files;
mod body_basis;
mod gltf;
mod inventor;

pub use basis_file::{BasisFile, Profile, VIEWER_MOTIONS};
pub use basis_files::{BASIS_FILES, read, refuse};
pub use body_basis::{BodyBasis, Choice, Column, Handle};
