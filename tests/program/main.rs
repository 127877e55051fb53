//! The program as a user runs it, the files it brings, and the structure of its source.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod architecture;
mod bench;
mod check_agrees;
mod cli;
#[path = "../common/mod.rs"]
mod common;
mod configs;
mod demo;
mod effects;
mod export;
mod faults;
mod kills;
mod outputs;
mod point_forces;
#[path = "../render_common/mod.rs"]
mod render_common;
mod replay;
mod stage_check;
mod stage_files;
mod stage_seams;
mod surface_export;
mod updates;
