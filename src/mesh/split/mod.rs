//! A mesh that is cut across its edges: which pieces each tetrahedron falls into, and which nodes move apart.
//!
//! In: a mesh, and the edges that are cut, each at a point of it. Out: the pieces of its tetrahedra with their share of the volume, and the
//! copies of nodes that they need (`pieces.rs`); the parts that nothing holds (`hold.rs`); the surface with the cuts in it (`surface.rs`).
//!
//! A tetrahedron is divided where its four nodes, joined by the edges that are not cut, fall apart: a corner with three cut edges, or two
//! pairs with four. Each piece moves with four nodes, the tetrahedron's own on its side and copies of those beyond the cut. Pieces of
//! neighbours share their nodes where they meet on the common face, so that there are no copies at the end of a cut, and it closes there
//! (P. Hansbo and A. Hansbo, Computer Methods in Applied Mechanics and Engineering 193, 2004, 3523-3540; N. Molino, Z. Bao and
//! R. Fedkiw, ACM Transactions on Graphics 23, 2004, 385-392). No tetrahedron is made smaller, so that none becomes a sliver.

mod edges;
mod groups;
mod hold;
mod pieces;
mod surface;
#[cfg(test)]
mod tests;

pub use edges::{CutEdges, edge};
pub use pieces::{LoosePart, Piece, Split, Splitter, TetCorner};
pub use surface::{CutPoint, CutSurface};
