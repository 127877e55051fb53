//! Poses of control elements and what is made of them.
//!
//! In: affine motions x ↦ o + T + M (x - o), as hands or pose files give them. Out: their frames, turns and stretches, rigid motions
//! and the screws between them, the way from one pose to another, poses within limits; and forces by a pose from those by its frame.

pub mod follow;
pub mod frame;
pub mod screw;
pub mod se3;
