//! Requirements of a body on the precomputation: column families by name, and the sections of effects.
//!
//! In: the families that a model and effects declare. Out: [`Requirements`], their union with all that they are made from.
//! The precomputation, the .green file, its fingerprint and the online stage know a body's families from nowhere else.

use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A family of precomputed numbers, as models and effects name it.
#[derive(Clone, Copy, Debug)]
pub struct Family {
    /// Name in the .green file.
    pub name: &'static str,
    /// The families that it is made from.
    pub from: &'static [Family],
}

/// Requirements of a body's model and effects; nothing else is computed, stored or uploaded.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Requirements {
    families: BTreeSet<String>,
    /// Names of the effects that own tensors.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    sections: BTreeSet<String>,
}

impl Requirements {
    /// Requirements for `families`, and for those from which they are made.
    pub fn new(families: &[Family]) -> Requirements {
        let mut all = Requirements::default();
        families.iter().for_each(|family| all.add(*family));
        all
    }

    fn add(&mut self, family: Family) {
        self.families.insert(family.name.to_owned());
        family.from.iter().for_each(|other| self.add(*other));
    }

    /// Adds a section of the .green file that the effect of this name fills.
    pub fn with_section(mut self, effect: &str) -> Requirements {
        self.sections.insert(effect.to_owned());
        self
    }

    /// Union of both.
    pub fn and(mut self, other: Requirements) -> Requirements {
        self.families.extend(other.families);
        self.sections.extend(other.sections);
        self
    }

    /// The families alone.
    pub fn without_sections(&self) -> Requirements {
        Requirements { families: self.families.clone(), sections: BTreeSet::new() }
    }

    /// All but this family.
    pub fn without(&self, family: Family) -> Requirements {
        let mut rest = self.clone();
        rest.families.remove(family.name);
        rest
    }

    /// The families alone, without what effects own.
    pub fn only_families(&self) -> Requirements {
        Requirements { sections: BTreeSet::new(), ..self.clone() }
    }

    pub fn has(&self, family: Family) -> bool {
        self.families.contains(family.name)
    }

    /// Names of the families.
    pub fn families(&self) -> impl Iterator<Item = &str> {
        self.families.iter().map(String::as_str)
    }

    /// Names of the effects that own tensors.
    pub fn sections(&self) -> impl Iterator<Item = &str> {
        self.sections.iter().map(String::as_str)
    }

    /// List of the names for messages: `affine, stiffness`.
    pub fn describe(&self) -> String {
        self.families().chain(self.sections()).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: Family = Family { name: "first", from: &[] };
    const SECOND: Family = Family { name: "second", from: &[FIRST] };
    const OTHER: Family = Family { name: "other", from: &[] };

    #[test]
    fn a_family_brings_what_it_is_made_from() {
        let second = Requirements::new(&[SECOND]);
        assert!(second.has(FIRST) && second.has(SECOND) && !second.has(OTHER));
        assert_eq!(second, Requirements::new(&[SECOND, FIRST]));
        assert!(!Requirements::new(&[FIRST]).has(SECOND));
    }

    #[test]
    fn requirements_are_joined_and_come_back_from_a_file() {
        let both = Requirements::new(&[SECOND]).and(Requirements::new(&[OTHER]).with_section("gravity"));
        assert_eq!(both.describe(), "first, other, second, gravity");
        let text = serde_json::to_string(&both).unwrap();
        assert_eq!(serde_json::from_str::<Requirements>(&text).unwrap(), both);
        assert_eq!(both.clone().and(Requirements::default()), both);
        let plain = serde_json::to_string(&Requirements::new(&[FIRST])).unwrap();
        assert_eq!(plain, r#"{"families":["first"]}"#);
    }
}
