//! VRPN, the protocol that most trackers speak: a client, which is a [`Source`](super::Source), and a server.
//!
//! [`codec`] frames messages, [`payload`] reads what they carry, [`listener`] turns a server's messages into the state of
//! one device, [`client`] keeps the connection; [`server`] serves any source to several clients, each a [`peer`]. Written
//! from the protocol's description and from the recorded bytes of a vrpn_server 07.38; each file says which of its facts
//! were verified against those bytes.

pub mod address;
pub mod client;
pub mod codec;
mod connection;
pub mod force;
pub mod listener;
pub mod payload;
pub mod peer;
pub mod server;

pub use address::{Address, AddressError, Transport};
pub use client::{Client, Timing};
pub use force::ForceSender;
pub use payload::ForceField;
pub use server::{Server, ServerCounters, Serving};
