//! Plain data and services that several rooms share: atomic files, facts of the machine, text for a terminal.
//!
//! Imports no other room of ours.

pub mod peak;
