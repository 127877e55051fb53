//! The list of files that hold columns, the bodies that are written into them, and the VTU file for ParaView and meshio: the
//! surface of each body, and a point vector for every column.

use super::basis_file::{BasisFile, Profile, numbers, triangles};
use super::body_basis::{BodyBasis, Choice, Column, check_chosen};
use super::{gltf, inventor};
use crate::base::failure::Failure;
use crate::base::output::Kind;
use crate::base::text::one_line;
use crate::export::free_poses;
use crate::green::{AFFINE, GreenFile, column_names_of, is_numbered};
use crate::mesh::formats::vtu_write;
use crate::mesh::formats::vtu_write::{Cell, Piece};
use crate::prepare::Resolved;
use nalgebra::Vector3;
use std::io;
use std::io::Write;
use std::sync::Arc;

/// All basis files; a new one is one file and one line here.
pub const BASIS_FILES: &[BasisFile] = &[inventor::FILE, gltf::FILE, FILE];

/// Refuses columns that no such body has, and a body whose model sums none, even where its effects need some, before anything
/// is solved for it.
pub fn refuse(scene: &Resolved, name: &str, columns: &[String]) -> Result<(), Failure> {
    let body = &scene.body[name];
    check_chosen(columns.iter().filter(|column| !is_numbered(column)), &column_names_of(body))?;
    if scene.law(name)?.is_none() && scene.requirements(name)?.has(AFFINE) {
        return Ok(());
    }
    let message = format!(
        "the model \"{}\" has no columns to write. Write the surface of a pose (-o OUT.stl, --poses, \
         --pose), or take model = \"linear\"",
        body.model
    );
    Err(Failure::request(scene.invalid(&format!("body.{name}.model"), message)))
}

/// The bodies called `names`, from the file; the error says which of them is no sum of columns.
pub fn read(
    scene: &Resolved,
    file: &Arc<GreenFile>,
    names: &[&str],
    choice: Choice<'_>,
) -> Result<Vec<BodyBasis>, Failure> {
    let mut missed = Vec::new();
    let asked = &free_poses::found(scene, choice.asked, Some(file), &mut missed)?[..];
    if let Some(missed) = missed.first() {
        return Err(Failure::work(anyhow::anyhow!("{}", missed.why)));
    }
    names.iter().map(|name| BodyBasis::read(scene, file, name, Choice { asked, ..choice })).collect()
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{ControlRest, find_model};
    use crate::export::basis::{Column, Handle, Profile};
    use crate::green::{ColumnName, ColumnSource};
    use nalgebra::{Isometry3, Vector3};

    /// A sheet of nodes that waves in every column.
    fn sheet(side: u32) -> BodyBasis {
        let at = |node: u32| (node % side, node / side);
        let place = |node: u32| {
            let (x, y) = at(node);
            [x as f32 * 0.0123, y as f32 * 0.0171, (x * y) as f32 * 1.234e-5]
        };
        let rest: Vec<[f32; 3]> = (0..side * side).map(place).collect();
        let corner = |node: &u32| at(*node).0 + 1 < side && at(*node).1 + 1 < side;
        let square = |node: u32| [[node, node + 1, node + side], [node + 1, node + side + 1, node + side]];
        let column = |k: usize| Column {
            name: ColumnName {
                name: format!("c.{k}"),
                unit: "m".into(),
                source: ColumnSource::Field { control: 0, field: k },
            },
            u: rest.iter().map(|x| x.map(|x| (x * (k as f32 + 1.3)).sin())).collect(),
            largest: 1.0,
            coefficient: 0.0,
        };
        BodyBasis {
            body: "sheet".into(),
            model: find_model("linear").unwrap(),
            centre: Vector3::zeros(),
            triangles: (0..side * side).filter(corner).flat_map(square).collect(),
            columns: (0..12).map(column).collect(),
            vanishing: Vec::new(),
            controls: vec![Handle {
                rest: ControlRest { name: "c".into(), origin: Vector3::zeros(), nodes: 1 },
                is_grabbed: true,
                radius: 1.0,
            }],
            is_chosen: false,
            pose: None,
            motion: Isometry3::identity(),
            size: 1.0,
            rest,
        }
    }

    #[test]
    fn files_have_the_size_that_is_told_before_they_are_written() {
        let bodies = [sheet(60)];
        for file in BASIS_FILES {
            let profiles: &[Profile] =
                if file.is_for_viewers { &[Profile::Full, Profile::Viewer] } else { &[Profile::Full] };
            for profile in profiles {
                let mut bytes = Vec::new();
                (file.write)(&bodies, *profile, &mut bytes).unwrap();
                let ratio = (file.size)(&bodies, *profile) as f64 / bytes.len() as f64;
                assert!((0.8..1.25).contains(&ratio), "{} {profile:?}: {ratio}", file.suffix);
                assert!((file.kind.recognizes)(&bytes[..bytes.len().min(16 * 1024)]), "{}", file.suffix);
            }
        }
    }
}
