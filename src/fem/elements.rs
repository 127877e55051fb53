//! The list of elements.

use super::anp::TET4_ANP;
use super::element::Element;
use super::tet4::TET4;
use super::tet10::TET10;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// All elements, from the least accurate on; a new one is one file and one line here.
pub const ELEMENTS: &[&Element] = &[&TET4, &TET4_ANP, &TET10];

const NAMES: &[&str] = &{
    let mut names = [""; ELEMENTS.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = ELEMENTS[i].name;
        i += 1;
    }
    names
};

/// The element called `name`.
pub fn find_element(name: &str) -> Option<&'static Element> {
    ELEMENTS.iter().copied().find(|element| element.name == name)
}

impl Default for &'static Element {
    fn default() -> &'static Element {
        &TET4
    }
}

impl Serialize for Element {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

impl<'de> Deserialize<'de> for &'static Element {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<&'static Element, D::Error> {
        let name = String::deserialize(deserializer)?;
        find_element(&name).ok_or_else(|| D::Error::unknown_variant(&name, NAMES))
    }
}
