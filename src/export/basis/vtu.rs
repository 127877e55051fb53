//! A VTU file for ParaView and meshio: the surface of each body, and a point vector for every column.

use super::basis_file::{BasisFile, Profile, full_only, numbers, triangles};
use super::body_basis::{BodyBasis, Column};
use crate::base::output::Kind;
use crate::base::text::one_line;
use crate::mesh::formats::vtu_write::{self, Cell, Piece};
use nalgebra::Vector3;
use std::io::{self, Write};

pub const FILE: BasisFile = BasisFile {
    suffix: ".vtu",
    about: "VTK for ParaView and meshio: one point vector per column",
    // Neither a mesh in this format, nor what `deform` writes.
    kind: Kind {
        name: "a VTU file by `export`",
        recognizes: |head| {
            let mark = b" Vectors=\"column ";
            head.starts_with(b"<VTKFile ") && head.windows(mark.len()).any(|window| window == mark)
        },
    },
    // Numbers of 8 bytes as base64, and seven of each triangle: three nodes, an offset and a type.
    size: |bodies, _| 4 * (8 * numbers(bodies) * bodies.len() as u64 + 33 * triangles(bodies)) / 3,
    most: None,
    check: full_only,
    write,
};

fn write(bodies: &[BodyBasis], _: Profile, out: &mut dyn Write) -> io::Result<()> {
    let points: Vec<Vec<Vector3<f64>>> = bodies
        .iter()
        .map(|body| body.rest.iter().map(|x| Vector3::from(*x).cast() + body.centre).collect())
        .collect();
    let piece =
        |(own, points): (&BodyBasis, &'_ Vec<Vector3<f64>>)| -> (Vec<u32>, Vec<(String, Vec<Vector3<f64>>)>) {
            // Every piece has the fields of all bodies, as VTK asks for: those of others do not move it.
            let fields = bodies.iter().flat_map(|body| {
                let is_own = std::ptr::eq(body, own);
                let label = |name: &str| match bodies.len() {
                    1 => one_line(format_args!("column {name}")),
                    _ => one_line(format_args!("column {}.{name}", body.body)),
                };
                let zero = || vec![Vector3::zeros(); points.len()];
                let field = move |column: &Column| {
                    let values = || column.u.iter().map(|u| Vector3::from(*u).cast()).collect();
                    (label(&column.name.name), if is_own { values() } else { zero() })
                };
                body.columns.iter().map(field).collect::<Vec<_>>()
            });
            let mut fields: Vec<_> = fields.collect();
            if let Some(pose) =
                own.pose.as_ref().or_else(|| bodies.iter().find_map(|body| body.pose.as_ref()))
            {
                fields.push((one_line(format_args!("displacement {pose}")), moved(own)));
            }
            (own.triangles.concat(), fields)
        };
    let parts: Vec<_> = bodies.iter().zip(&points).map(piece).collect();
    let pieces: Vec<Piece<'_>> = parts
        .into_iter()
        .zip(&points)
        .map(|((connectivity, vectors), points)| Piece {
            points,
            cell: Cell::Triangle,
            connectivity,
            vectors,
            scalars: Vec::new(),
            numbers: None,
        })
        .collect();
    out.write_all(&vtu_write::encode(&pieces))
}

/// The displacements of the pose, the motion of the whole body too.
fn moved(body: &BodyBasis) -> Vec<Vector3<f64>> {
    let places = body.rest.iter().map(|x| Vector3::from(*x).cast::<f64>());
    let of = |(x, u): (Vector3<f64>, Vector3<f64>)| {
        let turned = body.motion.rotation * x - x;
        turned + body.motion.rotation * u + body.motion.translation.vector
    };
    places.zip(body.displacements()).map(of).collect()
}
