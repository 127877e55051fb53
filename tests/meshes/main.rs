//! Meshes and surfaces: formats, faults, geometry, filling.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

#[path = "../common/mod.rs"]
mod common;
mod isosurface_stuffing;
mod mesh_formats;
mod mesh_geometry;
mod mesh_malformed;
mod mesh_quadratic;
mod mesh_roundtrip;
mod mesh_shared;
mod surface_files;
