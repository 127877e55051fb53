//! VRPN: bytes of a real server, our client and our server over the loopback device, and what hostile peers cost.

mod bytes;
mod command;
mod force;
mod lab;
mod loopback;
mod recorded;
