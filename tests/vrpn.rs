//! VRPN: bytes of a real server, our client and our server over the loopback device, and what hostile peers cost.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

#[path = "vrpn/bytes.rs"]
mod bytes;
#[path = "vrpn/command.rs"]
mod command;
mod common;
#[path = "vrpn/force.rs"]
mod force;
#[path = "vrpn/lab.rs"]
mod lab;
#[path = "vrpn/loopback.rs"]
mod loopback;
#[path = "vrpn/recorded.rs"]
mod recorded;
