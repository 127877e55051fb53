//! Deformed surfaces as programs for pictures and printing take them: triangles with vertex normals and a colour.
//!
//! In: a [`ResultSet`] of one pose. Out: a [`Shape`] for each of its bodies, in the coordinates of its mesh, m. Of a body that
//! was solved over all nodes, the boundary is taken.

use super::result_set::{Geometry, ResultSet};
use crate::deform::vertex_normals;
use crate::mesh::Surface;
use nalgebra::Vector3;

/// Red, green and blue, sRGB, as a body is shown.
pub const COLOUR: [u8; 3] = [96, 142, 186];

/// The deformed surface of one body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    pub body: String,
    /// m.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals.
    pub normals: Vec<[f32; 3]>,
    /// Counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// The bodies of a set that holds one pose; one that the pose does not name is at rest, one that has no equilibrium in it
    /// is left out.
    pub fn list(set: &ResultSet) -> Vec<Shape> {
        let is_missed = |body: &str| set.missed.iter().any(|missed| missed.body == body);
        let shown = set.geometry.iter().filter(|geometry| !is_missed(&geometry.body));
        shown
            .map(|geometry| {
                let result = set.results.iter().find(|result| result.body == geometry.body);
                Shape::deformed(geometry, result.map_or(&[], |result| &result.displacement))
            })
            .collect()
    }

    /// Nodes beyond the end of `displacement` are at rest.
    fn deformed(geometry: &Geometry, displacement: &[Vector3<f64>]) -> Shape {
        let (nodes, triangles) = boundary(geometry);
        let place = |&node: &u32| {
            let node = node as usize;
            let u = displacement.get(node).copied().unwrap_or_default();
            <[f64; 3]>::from(geometry.rest[node] + u).map(|x| x as f32)
        };
        let positions: Vec<[f32; 3]> = nodes.iter().map(place).collect();
        let mut normals = vec![[0.0; 3]; positions.len()];
        vertex_normals(&positions, &triangles, &mut Vec::new(), &mut normals);
        // A vertex without a triangle of any area has none; glTF asks for unit length of all.
        let has_length = |normal: &[f32; 3]| (Vector3::from(*normal).norm() - 1.0).abs() < 1e-3;
        normals.iter_mut().filter(|normal| !has_length(normal)).for_each(|normal| *normal = [0.0, 0.0, 1.0]);
        Shape { body: geometry.body.clone(), positions, normals, triangles }
    }
}

/// The nodes of the boundary, and its triangles, which name them by their order there.
pub fn boundary(geometry: &Geometry) -> (Vec<u32>, Vec<[u32; 3]>) {
    let is_surface = geometry.cells.iter().all(|cell| cell.len() == 3);
    if is_surface {
        let triangles = geometry.cells.iter().map(|cell| [cell[0], cell[1], cell[2]]).collect();
        return ((0..geometry.rest.len() as u32).collect(), triangles);
    }
    let Surface { nodes, triangles } = Surface::from_mesh(&geometry.mesh());
    (nodes, triangles)
}
