//! The mechanics: elements, solvers, Green's functions, models, statics, and what accuracy costs.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod accuracy;
mod background;
mod branches;
#[path = "../common/mod.rs"]
mod common;
mod compliance_file;
mod conditioning;
mod deform_models;
mod faults;
mod fem;
mod forged_files;
mod green_file;
mod hard_cases;
mod home;
mod loads;
mod loads_in_models;
mod loads_solved;
mod memory;
mod oracles;
mod plan;
mod refine;
mod report;
#[path = "../report_common/mod.rs"]
mod report_common;
mod series;
mod snapshots;
mod statics;
mod update_chains;
mod updates;
mod verify;
