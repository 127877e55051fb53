//! Plain data and services that several rooms share: atomic files, facts of the machine, text for a terminal.
//!
//! It imports no other room.
pub mod by_name;
pub mod cache;
pub mod columns;
pub mod creases;
pub mod diagnostic;
pub mod disjoint;
pub mod extent;
pub mod failure;
pub mod fault;
pub mod fixed;
pub mod guard;
pub mod input;
pub mod lanes;
pub mod legend;
pub mod machine;
pub mod memory;
pub mod output;
pub mod parts;
pub mod peak;
pub mod plates;
pub mod progress;
pub mod quantity;
pub mod random;
pub mod signal;
pub mod slide;
pub mod statistics;
pub mod strips;
pub mod table;
pub mod teams;
pub mod text;
