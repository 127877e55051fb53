//! Turns styli into poses of control elements: pick ray and reach, hands, modes, history, navigation.
//!
//! In: [`StylusState`](crate::track::StylusState)s, and the deformed surface of each control element. Out: what each
//! hand points at, the matrix of every element that is held, as translation T and linear part M about its rest
//! origin, and where the user has put the scene. The hand is the MatrixDragger of the paper's Avango: it copies the
//! device's matrix.

mod action;
mod carry;
mod curve;
mod ease;
mod hands;
mod history;
mod mode;
mod navigate;
mod pick;
mod pose;

pub use action::{Action, SurfaceGrip};
pub use carry::{Carrying, HandMotion, carry, held_line};
pub use curve::{ForceArrow, bend, force_arrow};
pub use ease::{EASE_S, Ease, between, towards_rest};
pub use hands::{CLICK_S, Drag, Element, Grip, HandRequests, Hands};
pub use history::{History, KEPT};
pub use mode::{Axis, AxisOf, Freedom, Mode, twist};
pub use navigate::{Aside, MovingHand, Navigation, place_aside};
pub use pick::{Hit, PickRay, PickShape, PickTarget, pick, reach};
pub use pose::{control_pose_in_body, room_from_element};
