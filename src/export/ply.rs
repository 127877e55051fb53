//! PLY, binary, little endian: vertices with normals and colour, and triangles, all bodies of a pose together, in m.

use super::exporter::{Exporter, Spread};
use super::result_set::{Needs, ResultSet};
use super::shape::{COLOUR, Shape};
use crate::base::output::Kind;

const HEADER: &str = "ply\nformat binary_little_endian 1.0\ncomment greenstage: a deformed surface, metres\n";

pub const SURFACE: Exporter = Exporter {
    suffix: ".ply",
    kind: Kind { name: "a PLY file by greenstage", recognizes: |head| head.starts_with(HEADER.as_bytes()) },
    needs: Needs::Nothing,
    spread: Spread::EachPose,
    write: |set: &ResultSet| write(&Shape::list(set)),
};

pub fn write(shapes: &[Shape]) -> Vec<u8> {
    let vertices: usize = shapes.iter().map(|shape| shape.positions.len()).sum();
    let triangles: usize = shapes.iter().map(|shape| shape.triangles.len()).sum();
    let property = |kind: &str, names: &[&str]| -> String {
        names.iter().map(|name| format!("property {kind} {name}\n")).collect()
    };
    let mut bytes = format!(
        "{HEADER}element vertex {vertices}\n{}{}element face {triangles}\nproperty list uchar uint vertex_indices\nend_header\n",
        property("float", &["x", "y", "z", "nx", "ny", "nz"]),
        property("uchar", &["red", "green", "blue"]),
    )
    .into_bytes();
    for shape in shapes {
        for (position, normal) in shape.positions.iter().zip(&shape.normals) {
            bytes.extend(position.iter().chain(normal).flat_map(|number| number.to_le_bytes()));
            bytes.extend(COLOUR);
        }
    }
    let mut first = 0;
    for shape in shapes {
        for triangle in &shape.triangles {
            bytes.push(3);
            bytes.extend(triangle.iter().flat_map(|vertex| (first + vertex).to_le_bytes()));
        }
        first += shape.positions.len() as u32;
    }
    bytes
}
