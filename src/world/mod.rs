//! All that moves in one frame: bodies at their places, hands, the graph of fields that joins them.
//!
//! In: a [`Scene`](crate::scene::Scene), its .green file ([`prepare`](crate::prepare) finds or makes it), a stage, and what the trackers
//! say. Out: a [`World`] that [`World::step`] moves on by one frame. It knows no window and no device.

pub mod actions;
pub mod body;
pub mod body_memory;
pub mod carry_over;
pub mod edit_state;
pub mod flow;
pub mod force;
pub mod force_scale;
pub mod frame;
pub mod hand;
pub mod highlight;
pub mod measure;
pub mod overlap;
pub mod place;
pub mod ruler;
pub mod running;
pub mod state;
pub mod state_hash;
pub mod times;
pub mod touch;
pub mod touching;
pub mod turn_limits;
pub mod wrench_error;

pub use body::PlacedBody;
pub use edit_state::EditState;
pub use flow::{Bodies, Fields};
pub use force::HeldForce;
pub use frame::{Frame, RunningEffect, World};
pub use hand::shape;
pub use highlight::Highlight;
pub use ruler::SurfacePoint;
pub use state::State;
pub use times::StepTimes;
pub use turn_limits::{TurnLimits, Verdict, out_of_range, out_of_range_of};
pub use wrench_error::{WrenchError, why_unknown, wrench_error, wrench_error_of};

#[cfg(test)]
pub mod tests;
