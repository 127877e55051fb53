//! Measures the depth of a point inside a closed triangle surface.
//!
//! In: an oriented [`TriangleSurface`] and a point. Out: the distance to the surface, positive inside, m. The nearest triangle is
//! found by parry in f32, in a box of size 1; the distance to it is then taken in f64. On edges and vertices angle-weighted
//! pseudo-normals decide the side: Baerentzen and Aanaes (IEEE TVCG 11, 2005).

use crate::mesh::quality::bounding_box;
use crate::mesh::surface_files::TriangleSurface;
use glamx::Vec3;
use nalgebra::Vector3;
use parry3d::query::PointQueryWithLocation;
use parry3d::shape::{TriMesh, TriMeshFlags, TrianglePointLocation};

pub struct Depth<'a> {
    surface: &'a TriangleSurface,
    tree: TriMesh,
    centre: Vector3<f64>,
    size: f64,
}

impl<'a> Depth<'a> {
    /// The error is parry's reason.
    pub fn new(surface: &'a TriangleSurface) -> Result<Depth<'a>, String> {
        let (low, high) = bounding_box(&surface.vertices);
        let (centre, size) = ((low + high) / 2.0, (high - low).amax());
        if size <= 0.0 {
            return Err("it has no extent".into());
        }
        let vertices = surface.vertices.iter().map(|x| unit((x - centre) / size)).collect();
        let tree = TriMesh::with_flags(vertices, surface.triangles.clone(), TriMeshFlags::ORIENTED)
            .map_err(|error| error.to_string())?;
        Ok(Depth { surface, tree, centre, size })
    }

    /// Depth of the point below the surface, m; negative outside.
    pub fn at(&self, point: &Vector3<f64>) -> f64 {
        let scaled = unit((point - self.centre) / self.size);
        let (nearest, (triangle, location)) = self.tree.project_local_point_and_get_location(scaled, false);
        let corners = self.surface.corners(triangle as usize);
        let sign = if nearest.is_inside { 1.0 } else { -1.0 };
        let [a, b, c] = corners;
        match location {
            TrianglePointLocation::OnVertex(i) => sign * (point - corners[i as usize % 3]).norm(),
            TrianglePointLocation::OnEdge(i, _) => {
                let from = corners[i as usize % 3];
                let along = corners[(i as usize + 1) % 3] - from;
                let t = along.dot(&(point - from)) / along.norm_squared().max(f64::MIN_POSITIVE);
                sign * (point - from - along * t.clamp(0.0, 1.0)).norm()
            }
            TrianglePointLocation::OnFace(..) | TrianglePointLocation::OnSolid => {
                match (b - a).cross(&(c - a)).try_normalize(0.0) {
                    Some(normal) => -normal.dot(&(point - a)),
                    None => sign * (point - a).norm(),
                }
            }
        }
    }
}

/// Measures distances of points from triangles, without a side.
pub struct Distance {
    tree: TriMesh,
    centre: Vector3<f64>,
    size: f64,
}

impl Distance {
    /// The error is parry's reason.
    pub fn new(vertices: &[Vector3<f64>], triangles: Vec<[u32; 3]>) -> Result<Distance, String> {
        let (low, high) = bounding_box(vertices);
        let (centre, size) = ((low + high) / 2.0, (high - low).amax().max(f64::MIN_POSITIVE));
        let vertices = vertices.iter().map(|x| unit((x - centre) / size)).collect();
        let tree = TriMesh::new(vertices, triangles).map_err(|error| error.to_string())?;
        Ok(Distance { tree, centre, size })
    }

    pub fn at(&self, point: &Vector3<f64>) -> f64 {
        let scaled = unit((point - self.centre) / self.size);
        let (nearest, _) = self.tree.project_local_point_and_get_location(scaled, false);
        f64::from((nearest.point - scaled).length()) * self.size
    }
}

fn unit(v: Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}
