//! The body-centred cubic lattice (corners and centres of cubes, all with the same tetrahedra), and the depth of a point
//! inside a closed triangle surface ([`Depth`]).
//!
//! Vertices have integer coordinates in half cells: all even (corners) or all odd (centres). Long edges join
//! neighbours of one kind (length 1 cell), short ones a corner and a centre (√3/2 cells). Every tetrahedron has two
//! opposite long edges and four short ones; all its dihedral angles are 60° or 90°.

use crate::base::extent::bounding_box;
use crate::mesh::surface_files::TriangleSurface;
use glamx::Vec3;
use nalgebra::Vector3;
use parry3d::query::PointQueryWithLocation;
use parry3d::shape::{TriMesh, TriMeshFlags, TrianglePointLocation};

/// A box of lattice cubes. Vertices are numbered corners first, x fastest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    pub origin: Vector3<f64>,
    /// Edge of a cube, m.
    pub cell: f64,
    /// Cubes along each axis.
    pub cubes: [usize; 3],
}

/// Steps to the neighbours along long edges, then along short ones, in half cells.
pub const STEPS: [[i64; 3]; 14] = [
    [-2, 0, 0],
    [2, 0, 0],
    [0, -2, 0],
    [0, 2, 0],
    [0, 0, -2],
    [0, 0, 2],
    [-1, -1, -1],
    [1, -1, -1],
    [-1, 1, -1],
    [1, 1, -1],
    [-1, -1, 1],
    [1, -1, 1],
    [-1, 1, 1],
    [1, 1, 1],
];

impl Lattice {
    /// The lattice about a box, with a margin of a cell or more on every side. `None` where it has more than `most`
    /// vertices.
    pub fn around(low: &Vector3<f64>, high: &Vector3<f64>, cell: f64, most: usize) -> Option<Lattice> {
        let mut cubes = [0; 3];
        for axis in 0..3 {
            // A body of whole cells must not get one more where its coordinates are rounded.
            let count = ((high[axis] - low[axis]) / cell - 1e-6).ceil() + 2.0;
            // Also refuses what is not a number.
            if !(count >= 2.0 && count < most as f64) {
                return None;
            }
            cubes[axis] = count as usize;
        }
        let size = Vector3::from(cubes.map(|count| count as f64 * cell));
        let lattice = Lattice { origin: (low + high - size) / 2.0, cell, cubes };
        let vertices =
            |extra: usize| cubes.iter().try_fold(1usize, |product, count| product.checked_mul(count + extra));
        vertices(0)?.checked_add(vertices(1)?).filter(|&count| count <= most)?;
        Some(lattice)
    }

    fn corners(&self) -> usize {
        self.cubes.iter().map(|count| count + 1).product()
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.corners() + self.cubes.iter().product::<usize>()
    }

    /// Coordinates of a vertex in half cells.
    pub fn coordinates(&self, vertex: usize) -> [i64; 3] {
        let (index, extra) = match vertex.checked_sub(self.corners()) {
            None => (vertex, 0),
            Some(index) => (index, 1),
        };
        let [nx, ny, _] = self.cubes.map(|count| count + 1 - extra);
        [index % nx, index / nx % ny, index / nx / ny].map(|i| (2 * i + extra) as i64)
    }

    /// The vertex at these coordinates, where the lattice has one.
    pub fn vertex(&self, coordinates: [i64; 3]) -> Option<usize> {
        let extra = (coordinates[0] & 1) as usize;
        let counts = self.cubes.map(|count| count + 1 - extra);
        let mut index = [0; 3];
        for axis in 0..3 {
            index[axis] = usize::try_from(coordinates[axis]).ok()? / 2;
            if index[axis] >= counts[axis] {
                return None;
            }
        }
        Some(extra * self.corners() + (index[2] * counts[1] + index[1]) * counts[0] + index[0])
    }

    pub fn position(&self, coordinates: [i64; 3]) -> Vector3<f64> {
        self.origin + Vector3::from(coordinates.map(|i| i as f64)) * (self.cell / 2.0)
    }

    /// Calls `visit` with the vertices of every tetrahedron; the first two are corners and end a long edge, the other
    /// two are centres and end another. Positively oriented.
    pub fn for_each_tetrahedron(&self, mut visit: impl FnMut([usize; 4])) {
        const RING: [[i64; 2]; 5] = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]];
        for corner in 0..self.corners() {
            let here = self.coordinates(corner);
            for axis in 0..3 {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut next = here;
                next[axis] += 2;
                let Some(next) = self.vertex(next) else { continue };
                let centre = |[du, dv]: [i64; 2]| {
                    let mut at = here;
                    at[axis] += 1;
                    at[u] += du;
                    at[v] += dv;
                    self.vertex(at)
                };
                for pair in RING.windows(2) {
                    if let (Some(r), Some(s)) = (centre(pair[0]), centre(pair[1])) {
                        visit([corner, next, r, s]);
                    }
                }
            }
        }
    }
}

/// Measures the distance of a point from an oriented [`TriangleSurface`], positive inside, m. The nearest triangle is found
/// by parry in f32, in a box of size 1; the distance to it is then taken in f64. On edges and vertices angle-weighted
/// pseudo-normals decide the side: Baerentzen and Aanaes (IEEE TVCG 11, 2005).
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
