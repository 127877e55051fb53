//! Trackers, hands, the field graph and force devices.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

#[path = "../common/mod.rs"]
mod common;
mod field;
mod haptics;
mod haptics_devices;
mod haptics_passive;
mod interact_bend;
mod interact_pick;
mod tracking;
mod vrpn;
