//! Making control elements on a body's surface with a ray: painted, as a ball or a box, grown along the surface, or a node
//! group of the mesh.
//!
//! In: a body's mesh ([`Canvas`]), the points that a ray touches, and the [`Tool`] of a [`Sketch`]. Out: the control elements
//! of a [`Scene`](crate::scene::Scene), each in the form that says most: a ball stays a ball in the file, what was painted is a
//! list of node tags. [`save`] writes the scene as a file.

pub mod canvas;
pub mod roads;
pub mod save;
pub mod sketch;

pub use canvas::{Canvas, Touch};
pub use roads::Roads;
pub use sketch::{Element, Sketch, Tool};
