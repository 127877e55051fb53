//! From a stylus to the pose of a control element: pick ray, hit, dragger.
//!
//! In: a [`StylusState`](crate::track::StylusState), and the deformed surface of each control element. Out: what
//! the ray hits, and the matrix of the element that is held, as translation T and linear part M about its rest
//! origin. The dragger is the MatrixDragger of the paper's Avango: it copies the device's matrix.

mod dragger;
mod pick;
mod pose;

pub use dragger::{Drag, Dragger};
pub use pick::{Hit, PickRay, PickShape, PickTarget, pick};
pub use pose::{control_pose_in_body, room_from_element};
