//! VRPN: bytes of a real server, our client and our server over the loopback device, and what hostile peers cost.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

#[path = "vrpn/bytes.rs"]
mod bytes;
mod common;
#[path = "vrpn/recorded.rs"]
mod recorded;
