//! Changes to a body while it is shown: `updates = { release = ["right"] }`.

use super::select::Control;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields, expecting = "a table like { release = [\"right\"] }")]
pub struct Updates {
    /// Control elements that may be released and hold again.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub release: Vec<String>,
    /// Regions whose Young's modulus may be changed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub modulus: Vec<String>,
    /// Control elements of `release` that hold nothing to begin with.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub released: Vec<String>,
    /// The control elements that hold nothing now, each with its place in the order of the body's.
    #[serde(skip)]
    pub(super) loose: Vec<(usize, String, Control)>,
    /// Young's modulus with which the body is precomputed in every region of `modulus`, Pa.
    #[serde(skip)]
    pub(super) young: BTreeMap<String, f64>,
}

impl Updates {
    /// The control elements that hold nothing now.
    pub fn loose(&self) -> impl Iterator<Item = &str> {
        self.loose.iter().map(|(_, name, _)| name.as_str())
    }
}
