//! The element types of Gmsh by their numbers, after the Gmsh reference manual, section "Node ordering".

use crate::mesh::assemble::ElementShape;
use crate::mesh::error::FormatFault;

/// Dimension and nodes of Gmsh's element type `number`.
fn kind(number: i32) -> Option<ElementShape> {
    let (dimension, nodes) = match number {
        15 => (0, 1),
        1 => (1, 2),
        8 => (1, 3),
        26 => (1, 4),
        27 => (1, 5),
        28 => (1, 6),
        2 => (2, 3),
        9 => (2, 6),
        20 => (2, 9),
        21 => (2, 10),
        22 => (2, 12),
        23 | 24 => (2, 15),
        25 => (2, 21),
        3 => (2, 4),
        16 => (2, 8),
        10 => (2, 9),
        4 => (3, 4),
        11 => (3, 10),
        29 => (3, 20),
        30 => (3, 35),
        31 => (3, 56),
        5 => (3, 8),
        17 => (3, 20),
        12 => (3, 27),
        6 => (3, 6),
        18 => (3, 15),
        13 => (3, 18),
        7 => (3, 5),
        19 => (3, 13),
        14 => (3, 14),
        92 => (3, 64),
        93 => (3, 125),
        _ => return None,
    };
    Some(ElementShape { dimension, nodes, is_tetrahedron: matches!(number, 4 | 11 | 29 | 30 | 31) })
}

/// [`kind`], refused at `at` when unknown.
pub fn known_kind(number: i32, at: usize) -> Result<ElementShape, FormatFault> {
    kind(number).ok_or_else(|| FormatFault::at(at, format!("element type {number} is not known")))
}
