//! A world: bodies at their places, hands, and the graph of fields that joins them. It moves in steps of one frame.
//!
//! In: a [`Scene`](crate::scene::Scene), its .green file ([`prepare`](crate::prepare) finds or makes it), a stage, and an [`Input`] per
//! frame. Out: a [`World`] that [`World::step`] moves on by one frame, and the [`Frame`] that it shows. It knows no window and no device.
//!
//! | type | what it is | lasts for |
//! |---|---|---|
//! | [`Assets`] | what was loaded: the stage, and of each body its model, place, colour, pattern | a session |
//! | [`World`] | the assets, the state, and what follows from both: displacements, factors, threads | a session |
//! | [`State`] | all that changes from frame to frame, as plain data: it is taken, stored and put back between any two frames | a session |
//! | [`Input`] | what comes from outside: head and styli, commands, arrivals from the background | a frame |
//! | [`Frame`] | what is shown: colours, forces, drawables, warnings, times | a frame |
//! | [`RunningEffect`] | what an opt-in effect adds in the four phases of a frame | a session |

pub mod actions;
pub mod assets;
pub mod body;
pub mod body_memory;
pub mod carry_over;
pub mod dissipation;
pub mod edit_state;
pub mod flight;
pub mod flow;
pub mod force;
pub mod force_mark;
pub mod force_scale;
pub mod frame;
pub mod hand;
pub mod inertia;
pub mod measure;
pub mod place;
pub mod ruler;
pub mod running;
pub mod state;
pub mod step;
pub mod tool;
pub mod tool_place;
pub mod tool_shape;
pub mod touch;
pub mod touching;
pub mod turn_limits;
pub mod vibration;

pub use assets::{Assets, BodyAssets};
pub use body::PlacedBody;
pub use edit_state::EditState;
pub use flow::{Bodies, Fields};
pub use force::{WrenchError, why_unknown, wrench_error, wrench_error_of};
pub use frame::{BodyFrame, Frame, HeldForce, Highlight, StepTimes};
pub use hand::shape;
pub use ruler::SurfacePoint;
pub use running::{RunningEffect, World};
pub use state::{Input, State};
pub use tool_place::ToolPlace;
pub use turn_limits::{TurnLimits, Verdict, beyond_law, is_beyond_model, out_of_range, out_of_range_of};

#[cfg(test)]
pub mod tests;
