//! Depths to which bodies reach into each other where they stand at rest.
//!
//! In: closed surfaces in one frame, m, oriented outward. Out: each pair of which one has a vertex inside the other, with
//! the depth of the deepest one below the other's surface, m.

use crate::mesh::isosurface_stuffing::distance::Depth;
use crate::mesh::quality::bounding_box;
use crate::mesh::surface_files::TriangleSurface;

/// Bodies that touch, or stand in each other by less than this part of the smaller one's size, are not reported.
const TOUCHING: f64 = 0.01;

/// Pairs of surfaces, by their numbers, and how deep they reach into each other, m.
pub fn overlaps(surfaces: &[TriangleSurface]) -> Vec<([usize; 2], f64)> {
    let boxes: Vec<_> = surfaces.iter().map(|surface| bounding_box(&surface.vertices)).collect();
    let depths: Vec<Option<Depth<'_>>> = surfaces.iter().map(|surface| Depth::new(surface).ok()).collect();
    let reach = |from: usize, into: usize| -> f64 {
        let (Some(depth), (low, high)) = (&depths[into], &boxes[into]) else { return 0.0 };
        let is_near = |x: &&nalgebra::Vector3<f64>| (0..3).all(|i| low[i] < x[i] && x[i] < high[i]);
        surfaces[from].vertices.iter().filter(is_near).map(|x| depth.at(x)).fold(0.0, f64::max)
    };
    let size = |of: usize| (boxes[of].1 - boxes[of].0).amax();
    let mut found = Vec::new();
    for one in 0..surfaces.len() {
        for other in one + 1..surfaces.len() {
            let depth = reach(one, other).max(reach(other, one));
            if depth > TOUCHING * size(one).min(size(other)) {
                found.push(([one, other], depth));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, Surface, block};
    use nalgebra::Vector3;

    fn cube(corner: f64, side: f64) -> TriangleSurface {
        let mesh = block(&Block { size: [side; 3], cells: [4; 3] }).unwrap();
        let Surface { triangles, nodes } = Surface::of(&mesh);
        let (low, _) = bounding_box(&mesh.nodes);
        let at = |node: &u32| mesh.nodes[*node as usize] - low + Vector3::repeat(corner);
        TriangleSurface { vertices: nodes.iter().map(at).collect(), triangles }
    }

    #[test]
    fn bodies_in_each_other_are_found_with_their_depth() {
        let found = overlaps(&[cube(0.0, 1.0), cube(0.75, 1.0), cube(5.0, 1.0), cube(5.4, 0.2)]);
        let pairs: Vec<[usize; 2]> = found.iter().map(|(pair, _)| *pair).collect();
        assert_eq!(pairs, [[0, 1], [2, 3]]);
        // The corner (0.75, 0.75, 0.75) is a quarter below three faces; the small cube's corners nearest to the middle 0.4.
        assert!((found[0].1 - 0.25).abs() < 1e-6, "{}", found[0].1);
        assert!((found[1].1 - 0.4).abs() < 1e-6, "{}", found[1].1);
    }

    #[test]
    fn bodies_that_touch_pass() {
        assert_eq!(overlaps(&[cube(0.0, 1.0), cube(1.0, 1.0), cube(1.995, 1.0)]), []);
    }
}
