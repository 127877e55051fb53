//! A solver as the text that it displays, for serde's `with`; by itself it is a table, as scenes have it.

use super::solver::Solver;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

pub fn serialize<S: Serializer>(solver: &Solver, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(solver)
}

pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Solver, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}
