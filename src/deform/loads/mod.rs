//! Loads on a body: coefficients of further columns, forces at single points, and what all of them do to control elements.
//!
//! In: the state that a model makes of the poses, and the [`AppliedLoads`]. Out: the same state with the loads' coefficients
//! behind the model's own, the displacements that point forces cause, and the potential energy
//!
//! ```text
//! V = ½ cᵀ S c - fᵀ U c - ½ fᵀ A⁻¹ f - (work in the body's rigid motion)
//! ```
//!
//! (f: all nodal forces in the frame of the columns, U: the affine fields over all nodes). Its derivative by the poses is that
//! of the model's energy less the forces' virtual work, f · δ(R (X + u_c + u_f) + t) with u_f held: by reciprocity that by c is
//! -Uᵀ f. Loads that turn with the body have no potential; theirs is the virtual work alone. A point that is held gets the
//! force that brings it to its place, by the compliance of all held points together.

pub mod applied;
mod in_frame;
mod loaded;
pub mod lumped;
pub mod pose_loads;

pub use applied::{AppliedLoads, PointLoad, Pull, SharedLoads, set};
pub use in_frame::{FrameForces, LoadedPotential};
pub use loaded::{Loaded, refusal};
pub use lumped::{Borne, Lumped, SLOTS};
