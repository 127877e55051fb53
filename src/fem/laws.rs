//! The list of laws of large strain.

use super::corotational::COROTATIONAL;
use super::law::Law;
use super::neo_hookean::NEO_HOOKEAN;
use super::stvk::STVK;
use crate::config::unknown_name;
use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// All laws; a new one is one file and one line here.
pub const LAWS: &[&Law] = &[&STVK, &NEO_HOOKEAN, &COROTATIONAL];

impl<'de> Deserialize<'de> for &'static Law {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<&'static Law, D::Error> {
        let name = String::deserialize(deserializer)?;
        let found = LAWS.iter().copied().find(|law| law.name == name);
        found.ok_or_else(|| D::Error::custom(unknown_name("law", &name, LAWS.iter().map(|law| law.name))))
    }
}
