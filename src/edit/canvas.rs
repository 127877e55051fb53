//! The surface of a body at rest, on which control elements are made.
//!
//! In: a mesh. Out: its surface with vertex normals, distances along it, and what a ray touches of it.

use super::roads::Roads;
use crate::base::extent::bounding_box;
use crate::interact::{PickRay, PickShape, PickTarget, pick};
use crate::mesh::{Surface, TetMesh};
use nalgebra::{Point3, Similarity3, Vector3};

/// The surface of a body at rest.
pub struct Canvas {
    pub mesh: TetMesh,
    /// The mesh's node of each vertex, ascending.
    pub nodes: Vec<u32>,
    /// m, as the mesh has them.
    pub places: Vec<Vector3<f64>>,
    /// The places in f32, for drawing and picking.
    pub positions: Vec<[f32; 3]>,
    pub shape: PickShape,
    pub roads: Roads,
    /// Corners of the box around it, m.
    pub bounds: [Vector3<f64>; 2],
}

/// The point where a ray touches the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The point in the mesh's frame, m.
    pub point: Vector3<f64>,
    /// The nearest vertex.
    pub vertex: u32,
}

impl Canvas {
    pub fn new(mesh: TetMesh) -> Canvas {
        let Surface { nodes, triangles } = Surface::from_mesh(&mesh);
        let places: Vec<_> = nodes.iter().map(|&node| mesh.nodes[node as usize]).collect();
        let (low, high) = bounding_box(&mesh.nodes);
        Canvas {
            roads: Roads::new(&places, &triangles),
            positions: places.iter().map(|place| <[f64; 3]>::from(*place).map(|x| x as f32)).collect(),
            shape: PickShape { triangles, points: Vec::new() },
            bounds: [low, high],
            nodes,
            places,
            mesh,
        }
    }

    /// The longest extent, m.
    pub fn extent(&self) -> f64 {
        (self.bounds[1] - self.bounds[0]).amax()
    }

    pub fn touch(&self, ray: &PickRay, room_from_mesh: &Similarity3<f64>) -> Option<Touch> {
        let target = PickTarget {
            shape: &self.shape,
            positions: bytemuck::cast_slice(&self.positions),
            ball_radius_m: 0.0,
            room_from_body: *room_from_mesh,
        };
        let hit = pick(ray, &[target])?;
        let point: Point3<f64> = room_from_mesh.inverse_transform_point(&hit.point_in_room.cast());
        let distance =
            |(place, vertex): (&Vector3<f64>, u32)| ((place - point.coords).norm_squared(), vertex);
        let nearest = self.places.iter().zip(0..).map(distance).min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Touch { point: point.coords, vertex: nearest.1 })
    }

    /// The vertices of nodes of the mesh, ascending.
    pub fn vertices(&self, nodes: &[u32]) -> Vec<u32> {
        nodes
            .iter()
            .filter_map(|node| self.nodes.binary_search(node).ok())
            .map(|vertex| vertex as u32)
            .collect()
    }
}
