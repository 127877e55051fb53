//! Isosurface stuffing on the uniform body-centred cubic lattice.
//!
//! In: a [`Lattice`], how deep its vertices lie, and where its edges are cut. Out: tetrahedra with dihedral angles
//! between 10.7° and 164.8°, the bounds of F. Labelle and J. R. Shewchuk, Isosurface stuffing: fast tetrahedral meshes
//! with good dihedral angles (SIGGRAPH 2007). Without their grading: all cells have the same size.
//!
//! The two constants below are ours: they maximise the least angle over random signs and cut points that belong to no
//! particular surface (`tests/meshes/isosurface_stuffing.rs`: 10.77° to 164.1°).
//!
//! [`fill`] holds the stencils: the part of one lattice tetrahedron that lies inside. [`agree`] corrects the lattice
//! vertices that are on the wrong side of a surface that passes through itself.

use super::lattice::{Lattice, STEPS};
use crate::base::disjoint::DisjointSets;
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

/// A lattice vertex of a tetrahedron: its number, its coordinates in half cells, its sign (1 inside, 0 on the surface,
/// -1 outside).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    pub vertex: usize,
    pub coordinates: [i64; 3],
    pub sign: i8,
}

/// Emits one to three tetrahedra, the part inside of a lattice tetrahedron. Numbers of nodes: `cut(inside, outside)` is the
/// cut point's, a lattice vertex keeps its own.
///
/// The quadrilaterals of cut faces are split by rules that depend on the face alone, so that neighbours conform: a cut point
/// on a long edge takes the diagonal; where both cut points lie on short edges, the parity rule decides (Labelle and
/// Shewchuk 2007, section 3).
pub fn fill(corners: &[Corner; 4], cut: impl Fn(usize, usize) -> usize, mut emit: impl FnMut([usize; 4])) {
    let pick = |sign: i8| corners.iter().filter(move |corner| corner.sign == sign);
    let inside: Vec<&Corner> = pick(1).collect();
    let outside: Vec<&Corner> = pick(-1).collect();
    let mut on = pick(0).map(|corner| corner.vertex);
    let cut = |i: &Corner, o: &Corner| cut(i.vertex, o.vertex);
    match (inside.as_slice(), outside.as_slice()) {
        // Also four vertices on the surface: such a tetrahedron is left out.
        ([], _) => {}
        (_, []) => emit(corners.map(|corner| corner.vertex)),
        ([a], _) => {
            let mut nodes = vec![a.vertex];
            nodes.extend(on);
            nodes.extend(outside.iter().map(|o| cut(a, o)));
            if let Ok(tet) = nodes.try_into() {
                emit(tet);
            }
        }
        ([a, b], [o]) => {
            let Some(z) = on.next() else { return };
            let (ca, cb) = (cut(a, o), cut(b, o));
            let far = if from_first(a, b, o) { cb } else { ca };
            emit([z, a.vertex, b.vertex, far]);
            emit([z, if far == cb { a.vertex } else { b.vertex }, ca, cb]);
        }
        ([a, b], [o, p]) => {
            let bottom = [a.vertex, cut(a, o), cut(a, p)];
            let top = [b.vertex, cut(b, o), cut(b, p)];
            // Between o and p the quadrilateral is the surface's: whatever closes the prism.
            prism(bottom, top, [Some(from_first(a, b, o)), None, Some(!from_first(a, b, p))], emit);
        }
        ([a, b, c], [o]) => {
            let bottom = [a, b, c].map(|corner| corner.vertex);
            let top = [a, b, c].map(|corner| cut(corner, o));
            let diagonals = [(a, b), (b, c), (c, a)].map(|(i, j)| Some(from_first(i, j, o)));
            prism(bottom, top, diagonals, emit);
        }
        _ => {}
    }
}

/// On the face of `i` and `j` inside and `o` outside: whether the diagonal runs from i to the cut point of j, or else
/// from j to the cut point of i.
fn from_first(i: &Corner, j: &Corner, o: &Corner) -> bool {
    let is_long = |p: &Corner, q: &Corner| (p.coordinates[0] - q.coordinates[0]) % 2 == 0;
    if is_long(i, o) {
        false
    } else if is_long(j, o) {
        true
    } else {
        // Of the two ends of a long edge exactly one exceeds o in an even number of coordinates.
        (0..3).filter(|&axis| i.coordinates[axis] > o.coordinates[axis]).count() % 2 == 0
    }
}

/// Three tetrahedra of the prism over triangle `bottom`. Side k lies between corners k and k + 1; its diagonal runs
/// from bottom k to top k + 1 (true) or from bottom k + 1 to top k; `None`: either.
fn prism(
    bottom: [usize; 3],
    top: [usize; 3],
    diagonals: [Option<bool>; 3],
    mut emit: impl FnMut([usize; 4]),
) {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let runs = |from: usize, to: usize| {
        let (side, forward) = if (from + 1) % 3 == to { (from, true) } else { (to, false) };
        diagonals[side].is_none_or(|way| way == forward)
    };
    // Diagonals that run round in a circle have no such order; the rules above never make them.
    if let Some([x, y, z]) = ORDERS.into_iter().find(|&[x, y, z]| runs(x, y) && runs(x, z) && runs(y, z)) {
        emit([bottom[x], bottom[y], bottom[z], top[z]]);
        emit([bottom[x], bottom[y], top[y], top[z]]);
        emit([bottom[x], top[x], top[y], top[z]]);
    }
}

/// Part of the vertices on one side that may have the wrong sign; the others outvote them.
const MINORITY: f64 = 0.05;

/// Makes the signs of the depths at the lattice vertices consistent: turns those that the neighbours outvote, with a notice;
/// refuses where too many contradict. The distance of a vertex is always right, but its sign comes from one triangle, which
/// may face the wrong way in a fold. Where the distances of two neighbours together exceed their edge, no surface lies
/// between them, so that they are on one side.
pub fn agree(lattice: &Lattice, depth: &mut [f64]) -> Result<Option<String>, String> {
    let found = contradictions(lattice, depth);
    let Some(at) = found.first() else { return Ok(None) };
    let place = format!("{} places, the first near ({:.6}, {:.6}, {:.6})", found.len(), at.x, at.y, at.z);
    let side = sides(lattice, depth);
    let mut votes = vec![[0u32; 2]; depth.len()];
    for (&side, &d) in side.iter().zip(depth.iter()) {
        votes[side as usize][usize::from(d > 0.0)] += 1;
    }
    for [outside, inside] in &votes {
        if f64::from(*outside.min(inside)) > MINORITY * f64::from(outside + inside) {
            return Err(format!(
                "the surface overlaps itself at {place} by more than a cell. Join the bodies where they were \
                 made, or repair it (`greenstage manual meshes`)"
            ));
        }
    }
    let mut turned = 0;
    for (&side, d) in side.iter().zip(depth.iter_mut()) {
        let [outside, inside] = votes[side as usize];
        if (*d > 0.0) != (inside > outside) {
            *d = -*d;
            turned += 1;
        }
    }
    Ok(Some(format!(
        "the surface passes through itself at {place}: {turned} \
         lattice vertices were outvoted by their neighbours"
    )))
}

/// Whether no surface lies on an edge of this length. parry's choice of the nearest triangle is good to f32.
fn is_clear(lattice: &Lattice, a: f64, b: f64, step: usize) -> bool {
    let length = if step < 6 { lattice.cell } else { 0.75f64.sqrt() * lattice.cell };
    let slack = 1e-5 * lattice.cell * lattice.cubes.iter().copied().max().unwrap_or(1) as f64;
    a.abs() + b.abs() > length + slack
}

fn neighbours(lattice: &Lattice, vertex: usize) -> impl Iterator<Item = (usize, usize)> {
    let from = lattice.coordinates(vertex);
    let steps = STEPS.iter().enumerate();
    steps.filter_map(move |(step, by)| {
        Some((step, lattice.vertex([from[0] + by[0], from[1] + by[1], from[2] + by[2]])?))
    })
}

/// Vertices inside with a clear edge to one outside.
fn contradictions(lattice: &Lattice, depth: &[f64]) -> Vec<Vector3<f64>> {
    (0..lattice.vertices())
        .into_par_iter()
        .filter(|&vertex| {
            depth[vertex] > 0.0
                && neighbours(lattice, vertex).any(|(step, other)| {
                    depth[other] < 0.0 && is_clear(lattice, depth[vertex], depth[other], step)
                })
        })
        .map(|vertex| lattice.position(lattice.coordinates(vertex)))
        .collect()
}

/// The least vertex of the side of each vertex; edges that the surface cannot cut join a side.
fn sides(lattice: &Lattice, depth: &[f64]) -> Vec<u32> {
    let mut sides = DisjointSets::new(depth.len());
    for vertex in 0..depth.len() {
        for (step, other) in neighbours(lattice, vertex) {
            if other < vertex && is_clear(lattice, depth[vertex], depth[other], step) {
                sides.join(vertex as u32, other as u32);
            }
        }
    }
    (0..depth.len() as u32).map(|vertex| sides.root(vertex)).collect()
}
