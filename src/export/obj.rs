//! Wavefront OBJ, text: vertices with normals and triangles, an object for each body of a pose, in m.

use super::exporter::{Exporter, Spread};
use super::result_set::{Needs, ResultSet};
use super::shape::Shape;
use crate::base::output::Kind;
use crate::base::text::one_line;
use std::fmt::Write;

const HEADER: &str = "# greenstage: a deformed surface, metres\n";

pub const SURFACE: Exporter = Exporter {
    suffix: ".obj",
    kind: Kind { name: "an OBJ file by greenstage", recognizes: |head| head.starts_with(HEADER.as_bytes()) },
    needs: Needs::Nothing,
    spread: Spread::EachPose,
    write: |set: &ResultSet| write(&Shape::list(set)),
};

pub fn write(shapes: &[Shape]) -> Vec<u8> {
    let mut text = HEADER.to_owned();
    let mut first = 1;
    for shape in shapes {
        // Writing into a String cannot fail. A name in OBJ ends at a blank.
        let _ = writeln!(text, "o {}", one_line(&shape.body).replace(' ', "_"));
        for (kind, vectors) in [("v", &shape.positions), ("vn", &shape.normals)] {
            for [x, y, z] in vectors {
                let _ = writeln!(text, "{kind} {x} {y} {z}");
            }
        }
        for triangle in &shape.triangles {
            let [a, b, c] = triangle.map(|vertex| first + vertex as usize);
            let _ = writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}");
        }
        first += shape.positions.len();
    }
    text.into_bytes()
}
