//! The list of elements.

use super::anp::TET4_ANP;
use super::element::Element;
use super::tet4::TET4;
use super::tet10::TET10;
use crate::base::by_name::by_name;
use crate::config::unknown_name;

/// All elements, from the least accurate on; a new one is one file and one line here.
pub const ELEMENTS: &[&Element] = &[&TET4, &TET4_ANP, &TET10];

/// The element called `name`; the error lists the known ones.
pub fn find_element(name: &str) -> Result<&'static Element, String> {
    let found = ELEMENTS.iter().copied().find(|element| element.name == name);
    found.ok_or_else(|| unknown_name("element", name, ELEMENTS.iter().map(|element| element.name)))
}

impl Default for &'static Element {
    fn default() -> &'static Element {
        &TET4
    }
}

by_name!(Element, find_element);
