//! A direction field of a force pattern, from a file: vectors at nodes or at places.
//!
//! In: `direction = { file = "wind.csv" }`. Out: a vector at every place near those of the file. A `.vtu` file has them as an
//! array of its points; a text file has lines `node, x, y, z` (a tag of the mesh), or `place x, y, z, vector x, y, z` (m, the
//! mesh's coordinates). Between places the nearest four count by the inverse square of their distance (Shepard, Proc. 23rd ACM
//! National Conference, 1968, 517-524); at one of them its own vector does. Who has elements about the places asks for their
//! own vectors, and interpolates better.

use crate::base::extent::bounding_box;
use crate::base::input;
use crate::mesh::TetMesh;
use crate::mesh::formats::{PlacedVectors, point_vectors};
use nalgebra::Vector3;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

type V3 = Vector3<f64>;

/// A file of directions, as a scene names it.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DirectionFile {
    /// Relative to the scene.
    pub file: PathBuf,
    /// Array of the points in a `.vtu` file; may be left out where it has one of three components.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub array: Option<String>,
}

/// Vectors at places.
#[derive(Clone, Debug)]
pub struct DirectionField {
    /// Path of the file, for errors.
    path: PathBuf,
    /// Places, m, with their vectors.
    points: RTree<GeomWithData<[f64; 3], V3>>,
    /// Distance from the nearest place beyond which nothing is known, m.
    reach: f64,
}

/// The reach, as part of the mesh's diagonal.
const REACH: f64 = 0.1;
const NEAREST: usize = 4;
/// Distance, as part of the reach, within which a point is at a place: single precision has 1e-7 of the coordinates.
const AT: f64 = 1e-5;

impl DirectionFile {
    pub fn is_vtu(&self) -> bool {
        self.file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vtu"))
    }

    /// Reads the file at `path` for a mesh; errors name it, and the line.
    pub fn load(&self, path: &Path, mesh: &TetMesh) -> Result<DirectionField, String> {
        let bytes = input::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let points = if self.is_vtu() {
            point_vectors(&bytes, self.array.as_deref())
                .map_err(|fault| fault.in_file(path, &bytes).to_string())?
        } else {
            of_text(&bytes, mesh)
                .map_err(|(line, message)| format!("{}:{line}: {message}", path.display()))?
        };
        if !points.iter().any(|(_, vector)| vector.norm() > 0.0) {
            return Err(format!("{}: no vector that is not zero", path.display()));
        }
        let (low, high) = bounding_box(&mesh.nodes);
        let points = points.into_iter().map(|(x, vector)| GeomWithData::new(x.into(), vector)).collect();
        let points = RTree::bulk_load(points);
        Ok(DirectionField { path: path.to_owned(), points, reach: REACH * (high - low).norm() })
    }
}

impl DirectionField {
    /// The vector at a place; the error names the file.
    pub fn at(&self, place: &V3) -> Result<V3, String> {
        let nearest = self.points.nearest_neighbor_iter_with_distance_2((*place).into());
        let near: Vec<(f64, &V3)> = nearest.take(NEAREST).map(|(at, away)| (away, &at.data)).collect();
        let Some(&(least, nearest)) = near.first().filter(|(least, _)| least.sqrt() <= self.reach) else {
            let &[x, y, z] = place.as_ref();
            return Err(format!(
                "{}: no vector within {:.3e} m, a tenth of the body, of ({x:.4e}, {y:.4e}, {z:.4e}) on the \
                 pattern's faces. Give vectors all over them",
                self.path.display(),
                self.reach
            ));
        };
        if least <= (AT * self.reach).powi(2) {
            return Ok(*nearest);
        }
        let (sum, weights) = near
            .iter()
            .map(|(away, vector)| (*vector / *away, 1.0 / away))
            .fold((V3::zeros(), 0.0), |(sum, weights), (v, w)| (sum + v, weights + w));
        Ok(sum / weights)
    }

    /// The vector that the file has at the very place.
    pub fn just_at(&self, place: &V3) -> Option<V3> {
        let nearest = self.points.nearest_neighbor_iter_with_distance_2((*place).into()).next();
        nearest.filter(|(_, away)| *away <= (AT * self.reach).powi(2)).map(|(point, _)| point.data)
    }
}

/// Lines of four or six numbers between commas or spaces; a heading of words and comments after # are passed over. Errors with
/// their line.
fn of_text(bytes: &[u8], mesh: &TetMesh) -> Result<PlacedVectors, (usize, String)> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        let before = bytes.utf8_chunks().next().map_or("", |chunk| chunk.valid());
        return Err((before.lines().count().max(1), "this is no text".to_owned()));
    };
    let index: BTreeMap<u64, u32> = mesh.tags.iter().copied().zip(0..).collect();
    let (mut points, mut columns) = (Vec::new(), 0);
    for (line, row) in (1..).zip(text.lines()) {
        let row = row.split('#').next().unwrap_or("");
        let cells: Vec<&str> =
            row.split([',', ';', ' ', '\t']).map(str::trim).filter(|cell| !cell.is_empty()).collect();
        let numbers: Option<Vec<f64>> = cells.iter().map(|cell| cell.parse().ok()).collect();
        let is_heading = points.is_empty() && cells.iter().all(|cell| cell.parse::<f64>().is_err());
        if cells.is_empty() || is_heading {
            continue;
        }
        let wrong = |message: String| Err((line, message));
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number| number.abs() <= 1e15));
        let Some(numbers) = numbers.filter(|numbers| matches!(numbers.len(), 4 | 6)) else {
            return wrong(format!(
                "`{}`: write a node's tag and the vector, node, x, y, z; or a place and the vector, x, y, z, x, y, z",
                row.trim().chars().take(60).collect::<String>()
            ));
        };
        if columns != 0 && columns != numbers.len() {
            return wrong(format!("{} numbers in a file whose other lines have {columns}", numbers.len()));
        }
        columns = numbers.len();
        let vector = V3::from_column_slice(&numbers[columns - 3..]);
        let place = match columns {
            6 => V3::from_column_slice(&numbers[..3]),
            _ => {
                // As programs for numbers write it, 1.000e+00, too.
                let is_tag = numbers[0] >= 0.0 && numbers[0].fract() == 0.0;
                let tag = is_tag.then(|| index.get(&(numbers[0] as u64))).flatten();
                let Some(node) = tag else {
                    return wrong(format!("the mesh has no used node with tag {}", cells[0]));
                };
                mesh.nodes[*node as usize]
            }
        };
        points.push((place, vector));
    }
    if points.is_empty() {
        return Err((1, "no line with a vector".to_owned()));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::formats::vtu_write::{self, Cell, Piece};
    use crate::mesh::{Block, block};
    use proptest::prelude::*;

    fn mesh() -> TetMesh {
        block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap()
    }

    fn field(name: &str, bytes: &[u8]) -> Result<DirectionField, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        DirectionFile { file: name.into(), array: None }.load(&path, &mesh())
    }

    #[test]
    fn vectors_are_read_by_node_by_place_and_from_vtu() {
        let mesh = mesh();
        let vector = |x: &V3| V3::new(x.y, -x.x, 1.0);
        let by = |heading: &str, row: &dyn Fn(usize, &V3) -> String| {
            let rows: Vec<String> = mesh.nodes.iter().enumerate().map(|(i, x)| row(i, x)).collect();
            format!("{heading}\n{}\n", rows.join("\n"))
        };
        let of = |v: V3| format!("{:?}, {:?}, {:?}", v.x, v.y, v.z);
        let tagged = by("node, x, y, z # turns", &|i, x| format!("{}, {}", mesh.tags[i], of(vector(x))));
        let placed = by("# x y z then the vector", &|_, x| format!("{}, {}", of(*x), of(vector(x))));
        let vectors: Vec<V3> = mesh.nodes.iter().map(vector).collect();
        let vtu = vtu_write::encode(&[Piece {
            scalars: Vec::new(),
            points: &mesh.nodes,
            cell: Cell::Tetra,
            connectivity: mesh.tets.as_flattened().to_vec(),
            vectors: vec![("wind".to_owned(), vectors)],
            numbers: None,
        }]);
        for (name, bytes) in [("a.csv", tagged.into_bytes()), ("b.txt", placed.into_bytes()), ("c.vtu", vtu)]
        {
            let field = field(name, &bytes).unwrap();
            for x in &mesh.nodes {
                assert!((field.at(x).unwrap() - vector(x)).norm() < 1e-6, "{name}");
            }
            let between = field.at(&V3::new(0.4, 0.5, 0.5)).unwrap();
            assert!((between.z - 1.0).abs() < 1e-6, "{name}: what is the same all over is so between");
            assert!(field.at(&V3::repeat(3.0)).unwrap_err().contains("no vector within"));
        }
    }

    #[test]
    fn mistakes_name_the_line() {
        let told = |text: &str| field("a.csv", text.as_bytes()).unwrap_err();
        for (text, expected) in [
            ("node,x,y,z\n1,0,0,1\n999999,0,0,1\n", ":3: the mesh has no used node with tag 999999"),
            ("1,0,0,1\n\n1,0,0\n", ":3: `1,0,0`: write a node's tag"),
            ("1,0,0,1\n0,0,0,0,0,1\n", ":2: 6 numbers in a file whose other lines have 4"),
            ("1,0,0,nan\n", ":1: `1,0,0,nan`"),
            ("x,y\n", ":1: no line with a vector"),
            ("1,0,0,0\n", "no vector that is not zero"),
            ("1.5,0,0,1\n", ":1: the mesh has no used node with tag 1.5"),
            ("1.000e+00 0.0e+00 0.0e+00 0.0e+00\n", "no vector that is not zero"),
        ] {
            let error = told(text);
            assert!(error.contains(expected), "{error}");
        }
        assert!(
            field("a.vtu", b"<VTKFile type=\"UnstructuredGrid\"></VTKFile>").unwrap_err().contains("a.vtu")
        );
    }

    proptest! {
        #[test]
        fn no_file_makes_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200), text in "[0-9,. \n-]{0,80}") {
            let _ = field("any.csv", &bytes);
            let _ = field("any.vtu", &bytes);
            let _ = field("any.csv", text.as_bytes());
        }
    }
}
