//! STL, binary: the triangles of a pose with their normals, all bodies together, in m. Slicers and CAD programs read it; the
//! file itself names no unit.

use super::exporter::{Exporter, Spread};
use super::result_set::{Needs, ResultSet};
use super::shape::Shape;
use crate::base::output::Kind;
use nalgebra::Vector3;

/// The first bytes of the 80 that a binary STL file has for any text; they must not begin with "solid".
const HEADER: &[u8] = b"greenstage: a deformed surface, metres";

pub const SURFACE: Exporter = Exporter {
    suffix: ".stl",
    kind: Kind { name: "an STL file by greenstage", recognizes: |head| head.starts_with(HEADER) },
    needs: Needs::Nothing,
    spread: Spread::EachPose,
    write: |set: &ResultSet| write(&Shape::list(set)),
};

pub fn write(shapes: &[Shape]) -> Vec<u8> {
    let mut bytes = HEADER.to_vec();
    bytes.resize(80, 0);
    let count: usize = shapes.iter().map(|shape| shape.triangles.len()).sum();
    bytes.extend((count as u32).to_le_bytes());
    for shape in shapes {
        for triangle in &shape.triangles {
            let corners = triangle.map(|vertex| Vector3::from(shape.positions[vertex as usize]));
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            let unit = normal.try_normalize(0.0).unwrap_or_default();
            for number in [unit].iter().chain(&corners).flat_map(|v| v.iter()) {
                bytes.extend(number.to_le_bytes());
            }
            bytes.extend([0, 0]);
        }
    }
    bytes
}
