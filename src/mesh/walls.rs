//! How thick a body is under its triangles.
//!
//! In: a [`TetMesh`] without tetrahedra. Out: the walls that are thinner than the edges of the triangles on them.

use super::tet_mesh::TetMesh;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Walls thinner than the edges on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinWalls {
    /// Of the surface's area.
    pub share: f64,
    /// The longest edges of their triangles and the thickness below, m: both where half of their area has a smaller quotient.
    pub edge: f64,
    pub thickness: f64,
}

struct Facet {
    corners: [Vector3<f64>; 3],
    centre: Vector3<f64>,
    normal: Vector3<f64>,
    area: f64,
    longest: f64,
}

impl Facet {
    /// How far `from` is from it along the unit vector `way`, where that hits its inside from behind.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block, surface_body};

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
}
