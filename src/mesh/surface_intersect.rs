//! Finds where a triangle surface passes through itself.
//!
//! In: a [`TriangleSurface`]. Out: [`Intersections`]. Pairs whose boxes overlap come from parry's tree; a pair counts
//! when an edge of one passes through the inside of the other, judged by the signs of volumes in f64 (Guigue and
//! Devillers, J. Graphics Tools 8, 2003, without their case of coplanar triangles: those are not found).

use super::surface_files::TriangleSurface;
use glamx::Vec3;
use nalgebra::Vector3;
use parry3d::bounding_volume::Aabb;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;
use serde::Serialize;

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Intersections {
    pub pairs: usize,
    /// False where too many triangles overlap to test all of them.
    pub is_complete: bool,
    /// The triangles of the first pair, from 0.
    pub first: [usize; 2],
    /// Places of the first few pairs.
    pub places: Vec<[f64; 3]>,
}

/// Overlapping boxes that are looked at for one triangle, and pairs that are counted, before the search is given up.
const MOST_NEIGHBOURS: usize = 10_000;
const MOST_PAIRS: usize = 100_000;
const MOST_PLACES: usize = 20;

pub fn intersections(surface: &TriangleSurface) -> Intersections {
    // parry is f32: everything is brought to a box of size 1 about the origin, boxes grown by the rounding.
    let (low, high) = crate::base::extent::bounding_box(&surface.vertices);
    let (centre, size) = ((low + high) / 2.0, (high - low).amax());
    if size <= 0.0 {
        return Intersections { is_complete: true, ..Intersections::default() };
    }
    let boxes: Vec<Aabb> = (0..surface.triangles.len())
        .map(|t| {
            let corners = surface.corners(t).map(|x| (x - centre) / size);
            let (low, high) = crate::base::extent::bounding_box(&corners);
            let part = |v: Vector3<f64>| Vec3::new(v.x as f32, v.y as f32, v.z as f32);
            let slack = Vec3::splat(1e-6);
            Aabb::new(part(low) - slack, part(high) + slack)
        })
        .collect();
    let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
    let partners = |t: usize| -> Vec<usize> {
        let near = tree.intersect_aabb(&boxes[t]).take(MOST_NEIGHBOURS).map(|other| other as usize);
        let mut found: Vec<usize> =
            near.filter(|&other| other > t && cross(surface, t, other).is_some()).collect();
        found.sort_unstable();
        found
    };
    let mut result = Intersections { is_complete: true, ..Intersections::default() };
    // In portions, so that a file of overlapping triangles is given up early.
    let all: Vec<usize> = (0..surface.triangles.len()).collect();
    for portion in all.chunks(256) {
        let rows: Vec<Vec<usize>> = portion.par_iter().map(|&t| partners(t)).collect();
        for (t, others) in portion.iter().zip(rows) {
            for other in others {
                if result.pairs == 0 {
                    result.first = [*t, other];
                }
                result.pairs += 1;
                if let (true, Some(at)) = (result.places.len() < MOST_PLACES, cross(surface, *t, other)) {
                    result.places.push(at.into());
                }
            }
        }
        if result.pairs > MOST_PAIRS {
            result.is_complete = false;
            break;
        }
    }
    result
}

/// A place where an edge of one triangle passes through the inside of the other. Vertices in common do not count.
fn cross(surface: &TriangleSurface, t: usize, other: usize) -> Option<Vector3<f64>> {
    let (first, second) = (surface.triangles[t], surface.triangles[other]);
    let shared = first.iter().filter(|vertex| second.contains(vertex)).count();
    if shared >= 2 {
        return None;
    }
    let through = |edges: [u32; 3], face: [u32; 3]| {
        let corners = face.map(|vertex| surface.vertices[vertex as usize]);
        (0..3).find_map(|k| {
            let (from, to) = (edges[k], edges[(k + 1) % 3]);
            if face.contains(&from) || face.contains(&to) {
                return None;
            }
            pierce(&surface.vertices[from as usize], &surface.vertices[to as usize], &corners)
        })
    };
    through(first, second).or_else(|| through(second, first))
}

/// The point at which the segment passes through the inside of the triangle; touching does not count.
fn pierce(from: &Vector3<f64>, to: &Vector3<f64>, [a, b, c]: &[Vector3<f64>; 3]) -> Option<Vector3<f64>> {
    // Six times a tetrahedron's volume, 0 where rounding could have made its sign.
    let side = |p: &Vector3<f64>, q: &Vector3<f64>, r: &Vector3<f64>, s: &Vector3<f64>| {
        let (u, v, w) = (q - p, r - p, s - p);
        let volume = u.dot(&v.cross(&w));
        let doubt = 1e-13 * u.norm() * v.norm() * w.norm();
        if volume.abs() <= doubt { 0.0 } else { volume }
    };
    let (above, below) = (side(a, b, c, from), side(a, b, c, to));
    if above * below >= 0.0 {
        return None;
    }
    let turns = [side(from, to, a, b), side(from, to, b, c), side(from, to, c, a)];
    let inside = turns.iter().all(|&turn| turn > 0.0) || turns.iter().all(|&turn| turn < 0.0);
    inside.then(|| from + (to - from) * (above / (above - below)))
}
