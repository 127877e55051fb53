//! Displacements and forces of a scene's bodies in a list of poses, as files.
//!
//! In: a scene and poses. Out: a [`ResultSet`] ([`batch`] makes it, by superposition or by solving anew), and the files
//! that [`EXPORTERS`] write of it. [`basis`] writes the columns themselves, for other programs.
//!
//! To add a format: write a file with an [`Exporter`], declare it below as `pub mod`, add it to [`EXPORTERS`], and name its
//! file in the chapter `deform` of the manual.

mod all_nodes;
pub mod asked;
pub mod basis;
pub mod batch;
pub mod csv;
pub mod exporter;
pub mod exporters;
pub mod files;
pub mod found;
mod free_poses;
pub mod glb;
pub mod obj;
pub mod ply;
pub mod pose_picture;
pub mod pose_text;
pub mod raster;
pub mod result_set;
pub mod shape;
pub mod statics;
pub mod stl;
#[cfg(test)]
mod tests;
pub mod told;
mod unsure;
pub mod vtu;

pub use asked::{PoseRequest, ask, chosen};
pub use basis::{BASIS_FILES, BasisFile, BodyBasis, Choice, Profile, VIEWER_MOTIONS};
pub use exporter::{Exporter, Spread};
pub use exporters::{EXPORTERS, find_surface, surfaces};
pub use files::Files;
pub use result_set::{ControlForces, Geometry, MissedPose, Needs, PoseResult, ResultSet, StressResult};
