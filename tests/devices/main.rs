//! Trackers, hands, the field graph and force devices.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

#[path = "../common/mod.rs"]
mod common;
#[path = "../display_common/mod.rs"]
mod display_common;
mod ends;
mod field;
mod haptics;
mod haptics_devices;
mod haptics_passive;
mod haptics_touch;
mod interact_bend;
mod interact_pick;
#[path = "../render_common/mod.rs"]
mod render_common;
mod tracking;
mod vrpn;
