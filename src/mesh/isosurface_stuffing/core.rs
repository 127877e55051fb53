//! Isosurface stuffing on the uniform body-centred cubic lattice.
//!
//! In: a [`Lattice`], how deep its vertices lie, and where its edges are cut. Out: tetrahedra with dihedral angles
//! between 10.7° and 164.8°, the bounds of F. Labelle and J. R. Shewchuk, Isosurface stuffing: fast tetrahedral meshes
//! with good dihedral angles (SIGGRAPH 2007). Without their grading: all cells have the same size.
//!
//! The two constants below are ours: they maximise the least angle over random signs and cut points that belong to no
//! particular surface (`tests/meshes/isosurface_stuffing.rs`: 10.77° to 164.1°).

use super::lattice::{Lattice, STEPS};
use super::stencil::{Corner, fill};
use crate::mesh::quality::signed_volume;
use nalgebra::Vector3;
use rayon::prelude::*;

/// A vertex is moved onto the surface where a cut point is nearer to it than this part of a long edge.
pub const ALPHA_LONG: f64 = 0.2845;
/// The limit for short edges, as [`ALPHA_LONG`].
pub const ALPHA_SHORT: f64 = 0.3995;

/// A lattice edge that the surface cuts, seen from the vertex inside.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cut {
    inside: usize,
    outside: usize,
    /// Index into [`STEPS`], from inside to outside.
    step: usize,
    /// Place on the edge: 0 at the inside vertex, 1 at the outside one.
    t: f64,
}

/// The part of the lattice with positive depth. `cut(i, o, …)` gives the place t in (0, 1) of the surface on the edge
/// from vertex i inside to vertex o outside, with their coordinates. Nodes and positively oriented tetrahedra, in the
/// order of the lattice.
pub fn stuff(
    lattice: &Lattice,
    depth: &[f64],
    cut: impl Fn([i64; 3], [i64; 3]) -> f64 + Sync,
) -> (Vec<Vector3<f64>>, Vec<[u32; 4]>) {
    let mut sign: Vec<i8> = depth.iter().map(|&d| i8::from(d > 0.0) - i8::from(d < 0.0)).collect();
    let cuts = cut_points(lattice, &sign, cut);
    let mut moved = vec![usize::MAX; lattice.vertices()];
    warp(&cuts, &mut sign, &mut moved);

    let cut_position = |cut: &Cut| {
        let (from, to) = (lattice.coordinates(cut.inside), lattice.coordinates(cut.outside));
        lattice.position(from).lerp(&lattice.position(to), cut.t)
    };
    let position = |node: usize| match node.checked_sub(lattice.vertices()) {
        Some(index) => cut_position(&cuts[index]),
        None if moved[node] != usize::MAX => cut_position(&cuts[moved[node]]),
        None => lattice.position(lattice.coordinates(node)),
    };
    let find = |inside: usize, outside: usize| {
        let found = cuts.binary_search_by_key(&(inside, outside), |cut| (cut.inside, cut.outside));
        // Every edge between a vertex inside and one outside has its cut point.
        lattice.vertices() + found.unwrap_or(0)
    };
    let mut index = vec![u32::MAX; lattice.vertices() + cuts.len()];
    let (mut nodes, mut tets) = (Vec::new(), Vec::new());
    lattice.for_each_tetrahedron(|vertices| {
        if !vertices.iter().any(|&vertex| sign[vertex] > 0) {
            return;
        }
        let corners = vertices.map(|vertex| Corner {
            vertex,
            coordinates: lattice.coordinates(vertex),
            sign: sign[vertex],
        });
        fill(&corners, find, |tet| {
            let corners = tet.map(position);
            let mut tet = tet.map(|node| {
                if index[node] == u32::MAX {
                    index[node] = nodes.len() as u32;
                    nodes.push(position(node));
                }
                index[node]
            });
            if signed_volume(&corners) < 0.0 {
                tet.swap(2, 3);
            }
            tets.push(tet);
        });
    });
    (nodes, tets)
}

/// All cut points, sorted by their vertex inside, then the one outside.
fn cut_points(lattice: &Lattice, sign: &[i8], cut: impl Fn([i64; 3], [i64; 3]) -> f64 + Sync) -> Vec<Cut> {
    let of_vertex = |inside: usize| {
        let from = lattice.coordinates(inside);
        let mut cuts = Vec::new();
        for (step, by) in STEPS.iter().enumerate() {
            let to = [from[0] + by[0], from[1] + by[1], from[2] + by[2]];
            if let Some(outside) = lattice.vertex(to).filter(|&outside| sign[outside] < 0) {
                cuts.push(Cut { inside, outside, step, t: cut(from, to).clamp(0.0, 1.0) });
            }
        }
        cuts.sort_by_key(|cut| cut.outside);
        cuts
    };
    (0..lattice.vertices())
        .into_par_iter()
        .filter(|&vertex| sign[vertex] > 0)
        .flat_map_iter(of_vertex)
        .collect()
}

/// Moves every vertex that has a cut point too close to the nearest such one: its sign becomes 0, and the cut points
/// on its edges are no more.
fn warp(cuts: &[Cut], sign: &mut [i8], moved: &mut [usize]) {
    let mut ends: Vec<(usize, usize)> =
        cuts.iter().enumerate().flat_map(|(c, cut)| [(cut.inside, c), (cut.outside, c)]).collect();
    ends.par_sort_unstable();
    for of_vertex in ends.chunk_by(|a, b| a.0 == b.0) {
        let vertex = of_vertex[0].0;
        let nearest = of_vertex
            .iter()
            .filter_map(|&(_, c)| {
                let cut = &cuts[c];
                let (other, t) =
                    if cut.inside == vertex { (cut.outside, cut.t) } else { (cut.inside, 1.0 - cut.t) };
                let (alpha, length) =
                    if cut.step < 6 { (ALPHA_LONG, 1.0) } else { (ALPHA_SHORT, 0.75f64.sqrt()) };
                (sign[other] != 0 && t < alpha).then_some((t * length, c))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, c)) = nearest {
            (sign[vertex], moved[vertex]) = (0, c);
        }
    }
}
