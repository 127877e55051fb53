//! A VTU file for ParaView and meshio: the surface of each body, and a point vector for every column.

use super::basis_file::{BasisFile, Profile, numbers, triangles};
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
    is_for_viewers: false,
    write,
};

fn write(bodies: &[BodyBasis], _: Profile, out: &mut dyn Write) -> io::Result<()> {
    let place = |body: &BodyBasis| -> Vec<Vector3<f64>> {
        body.rest.iter().map(|x| Vector3::from(*x).cast() + body.centre).collect()
    };
    let points: Vec<Vec<Vector3<f64>>> = bodies.iter().map(place).collect();
    let pieces = bodies.iter().zip(&points).map(|(body, points)| Piece {
        points,
        cell: Cell::Triangle,
        connectivity: body.triangles.concat(),
        vectors: fields(bodies, body),
        scalars: Vec::new(),
        numbers: None,
    });
    let pieces: Vec<Piece<'_>> = pieces.collect();
    out.write_all(&vtu_write::encode(&pieces))
}

/// The fields of one body: every piece has those of all bodies, as VTK asks for, and what belongs to others does not move it.
fn fields(bodies: &[BodyBasis], own: &BodyBasis) -> Vec<(String, Vec<Vector3<f64>>)> {
    let mut fields = Vec::new();
    for body in bodies {
        for Column { name, u, .. } in &body.columns {
            let label = match bodies.len() {
                1 => one_line(format_args!("column {}", name.name)),
                _ => one_line(format_args!("column {}.{}", body.body, name.name)),
            };
            let field = match std::ptr::eq(body, own) {
                true => u.iter().map(|u| Vector3::from(*u).cast()).collect(),
                false => vec![Vector3::zeros(); own.rest.len()],
            };
            fields.push((label, field));
        }
    }
    if let Some(pose) = bodies.iter().find_map(|body| body.pose.as_ref()) {
        fields.push((one_line(format_args!("displacement {pose}")), moved(own)));
    }
    fields
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
