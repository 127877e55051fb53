//! Plain data and services that several rooms share: atomic files, facts of the machine, text for a terminal.
//!
//! Imports no other room of ours.

pub mod columns;
pub mod disjoint;
pub mod input;
pub mod last_word;
pub mod machine;
pub mod memory;
pub mod notice;
pub mod output;
pub mod parts;
pub mod peak;
pub mod signal;
pub mod statistics;
pub mod text;
