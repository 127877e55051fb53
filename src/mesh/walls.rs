//! Measures how thick a body is under its triangles.
//!
//! In: a [`TetMesh`] without tetrahedra, or a closed [`TriangleSurface`]. Out: the walls that are thinner than the edges of the
//! triangles on them; the thickness of the thinnest walls.

use super::surface_body;
use super::surface_files::TriangleSurface;
use super::tet_mesh::TetMesh;
use crate::base::extent::bounding_box;
use glamx::Vec3;
use nalgebra::Vector3;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;
use rayon::prelude::*;

/// Walls thinner than the edges on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinWalls {
    /// Part of the surface's area.
    pub share: f64,
    /// The longest edges of their triangles and the thickness below, m: both where half of their area has a smaller quotient.
    pub edge: f64,
    pub thickness: f64,
}

/// Part of the surface below which thin walls do not count.
pub const FEW: f64 = 0.1;
/// Edges of linear tetrahedra, in thicknesses of the wall, from which on they bend it more than four times too stiffly.
const TOO_LONG: f64 = 3.0;

/// Walls of a body of tetrahedra that linear ones bend too stiffly.
pub fn walls_too_thin(mesh: &TetMesh) -> Option<ThinWalls> {
    thin_walls(&surface_body::of_tetrahedra(mesh), TOO_LONG).filter(|walls| walls.share > FEW)
}

struct Facet {
    corners: [Vector3<f64>; 3],
    centre: Vector3<f64>,
    normal: Vector3<f64>,
    area: f64,
    longest: f64,
}

impl Facet {
    /// Distance of `from` from it along the unit vector `way`, where that hits its inside from behind.
    fn distance(&self, from: &Vector3<f64>, way: &Vector3<f64>) -> Option<f64> {
        let slope = way.dot(&self.normal);
        let far = (self.centre - from).dot(&self.normal) / slope;
        if slope <= 0.0 || far <= 0.0 {
            return None;
        }
        let hit = from + way * far;
        let is_left = |k: usize| {
            let [a, b] = [self.corners[k], self.corners[(k + 1) % 3]];
            (b - a).cross(&(hit - a)).dot(&self.normal) >= 0.0
        };
        (0..3).all(is_left).then_some(far)
    }
}

/// Walls under triangles whose longest edge is more than `times` as long as the body is thick there: from their middle straight
/// inward to the other side.
pub fn thin_walls(mesh: &TetMesh, times: f64) -> Option<ThinWalls> {
    let facet = |t: &[u32; 3]| {
        let corners = t.map(|node| mesh.nodes[node as usize]);
        let [a, b, c] = corners;
        let across = (b - a).cross(&(c - a));
        let longest = [b - a, c - b, a - c].map(|edge| edge.norm()).into_iter().fold(0.0, f64::max);
        let normal = across.try_normalize(0.0)?;
        Some(Facet { corners, centre: (a + b + c) / 3.0, normal, area: across.norm() / 2.0, longest })
    };
    let mut facets: Vec<Facet> = mesh.triangles.iter().filter_map(facet).collect();
    facets.sort_by(|a, b| a.centre.x.total_cmp(&b.centre.x));
    let widest = facets.iter().map(|facet| facet.longest).fold(0.0, f64::max);
    let thickness = |own: &Facet| {
        let reach = own.longest / times;
        let first = facets.partition_point(|other| other.centre.x < own.centre.x - reach - widest);
        let near = facets[first..].iter().take_while(|other| other.centre.x <= own.centre.x + reach + widest);
        let is_in_reach = |other: &&Facet| (other.centre - own.centre).norm() <= reach + other.longest;
        let hits = near.filter(is_in_reach).filter_map(|other| other.distance(&own.centre, &-own.normal));
        hits.fold(reach, f64::min)
    };
    let mut thin: Vec<(f64, &Facet)> = facets
        .par_iter()
        .map(|facet| (thickness(facet), facet))
        .filter(|(thickness, facet)| *thickness < facet.longest / times)
        .collect();
    let all: f64 = facets.iter().map(|facet| facet.area).sum();
    let own: f64 = thin.iter().map(|(_, facet)| facet.area).sum();
    thin.sort_by(|a, b| (a.1.longest / a.0).total_cmp(&(b.1.longest / b.0)));
    let mut below = 0.0;
    let (thickness, facet) = thin.iter().find(|(_, facet)| {
        below += facet.area;
        below >= own / 2.0
    })?;
    Some(ThinWalls { share: own / all, edge: facet.longest, thickness: *thickness })
}

/// Places on the surface where its thickness is measured, and how far inside a ray begins, in parts of the surface's size.
const PLACES: usize = 2000;
const OFF: f64 = 1e-5;

/// Thickness, m, that a closed surface falls below under `share` of its area: measured straight inward to the other side, from
/// places spread evenly over the area. `None` where nothing is met.
pub fn wall_thickness(surface: &TriangleSurface, share: f64) -> Option<f64> {
    let (low, high) = bounding_box(&surface.vertices);
    let (centre, size) = ((low + high) / 2.0, (high - low).amax());
    let unit = |v: &Vector3<f64>| Vec3::new(v.x as f32, v.y as f32, v.z as f32);
    let at = |x: &Vector3<f64>| (x - centre) / size;
    let corners = surface.vertices.iter().map(|x| unit(&at(x))).collect();
    let tree = TriMesh::new(corners, surface.triangles.clone()).ok()?;
    let across = |[a, b, c]: &[u32; 3]| {
        let [a, b, c] = [a, b, c].map(|&node| surface.vertices[node as usize]);
        (b - a).cross(&(c - a))
    };
    let areas: Vec<f64> = surface.triangles.iter().map(|triangle| across(triangle).norm()).collect();
    let step = areas.iter().sum::<f64>() / PLACES as f64;
    let (mut triangle, mut below) = (0, 0.0);
    let mut found = Vec::with_capacity(PLACES);
    for place in 0..PLACES {
        while triangle + 1 < areas.len() && below + areas[triangle] < (place as f64 + 0.5) * step {
            below += areas[triangle];
            triangle += 1;
        }
        // Roberts' sequence spreads the places over the triangle.
        let [mut u, mut v] =
            [0.754_877_666_246_693, 0.569_840_290_998_053].map(|r| (r * place as f64).fract());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let [a, b, c] = surface.triangles[triangle].map(|node| at(&surface.vertices[node as usize]));
        let Some(inward) = (-across(&surface.triangles[triangle])).try_normalize(0.0) else { continue };
        // Off the triangle itself by more than f32 rounds.
        let from = a + (b - a) * u + (c - a) * v + inward * OFF;
        let ray = Ray::new(unit(&from), unit(&inward));
        found.extend(tree.cast_local_ray(&ray, f32::MAX, false).map(|way| (f64::from(way) + OFF) * size));
    }
    found.sort_by(f64::total_cmp);
    found.get((share * found.len() as f64) as usize).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, Surface, block};

    #[test]
    fn the_thinnest_wall_of_a_block_is_its_shortest_side() {
        let mesh = block(&Block { size: [80.0, 40.0, 6.0], cells: [3, 2, 1] }).unwrap();
        let Surface { triangles, nodes } = Surface::from_mesh(&mesh);
        let vertices = nodes.iter().map(|&node| mesh.nodes[node as usize]).collect();
        let found = wall_thickness(&TriangleSurface { vertices, triangles }, 0.05).unwrap();
        assert!((found - 6.0).abs() < 1e-4, "{found}");
    }

    #[test]
    fn a_plates_thickness_is_found_under_its_large_triangles() {
        let plate = block(&Block { size: [1.0, 1.0, 0.05], cells: [5, 5, 1] }).unwrap();
        let plate = surface_body::of_tetrahedra(&plate);
        let found = thin_walls(&plate, 2.0).unwrap();
        assert!((found.share - 2.0 / 2.2).abs() < 1e-12, "{found:?}");
        assert!((found.thickness - 0.05).abs() < 1e-12, "{found:?}");
        assert!((found.edge - 0.08f64.sqrt()).abs() < 1e-12, "{found:?}");
        assert_eq!(thin_walls(&plate, 5.7), None);
    }

    #[test]
    fn a_hollow_cubes_wall_is_found_and_a_full_one_has_none() {
        let cube = |side: f64, cells: u32| {
            surface_body::of_tetrahedra(&block(&Block { size: [side; 3], cells: [cells; 3] }).unwrap())
        };
        let mut hollow = cube(1.0, 4);
        assert_eq!(thin_walls(&hollow, 1.0), None);
        let (first, inner) = (hollow.nodes.len() as u32, cube(0.9, 4));
        hollow.nodes.extend(inner.nodes);
        hollow.triangles.extend(inner.triangles.iter().map(|[a, b, c]| [a + first, c + first, b + first]));
        let found = thin_walls(&hollow, 2.0).unwrap();
        assert!((found.thickness - 0.05).abs() < 1e-12 && found.share > 0.9, "{found:?}");
    }

    /// A cube without thin walls, and a plate beside it that has less than half of the area.
    #[test]
    fn the_thickness_is_that_of_the_thin_walls_alone() {
        let body = |size: [f64; 3], cells: [u32; 3]| {
            surface_body::of_tetrahedra(&block(&Block { size, cells }).unwrap())
        };
        let (mut both, plate) = (body([1.0; 3], [4; 3]), body([1.0, 1.0, 0.05], [5, 5, 1]));
        let first = both.nodes.len() as u32;
        both.nodes.extend(plate.nodes.iter().map(|x| x + Vector3::new(3.0, 0.0, 0.0)));
        both.triangles.extend(plate.triangles.iter().map(|triangle| triangle.map(|node| node + first)));
        let found = thin_walls(&both, 2.0).unwrap();
        assert!((found.share - 2.0 / 8.2).abs() < 1e-12, "{found:?}");
        assert!((found.thickness - 0.05).abs() < 1e-12, "{found:?}");
    }
}
