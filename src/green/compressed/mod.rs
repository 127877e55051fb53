//! The compliance of a surface in little memory: (K⁻¹)ₛ as an H²-matrix, within an error that is measured.
//!
//! In: the factor of A and the free nodes of the surface. Out: [`Compressed`], bytes for each block of two clusters of nodes.
//! Clusters that are far from each other see only a few of each other's fields: forces in one do there what a few of them do
//! (W. Hackbusch, Hierarchical Matrices, Springer 2015; M. Bebendorf, Hierarchical Matrices, Springer 2008). These fields are
//! nested: those of a cluster are made from those of its parts, so that a far block is a small matrix between two bases.
//! What is left is rounded as coarsely as the error allows, which is found by trying.

mod basis;
mod build;
mod column;
mod encode;
mod exact;
mod memory;
mod packed;
mod samples;
mod tree;

pub use build::BuildError;
pub use column::{Shape, Shapes};
pub use encode::{Compressed, Trial, compress, frames_of, unpack_bases};
pub use packed::unpack;
pub use tree::{Block, Surface, Tree, blocks, order};
