//! Edges of two surfaces that cross between their nodes, as those of bars that lie across each other.
//!
//! In: two edges and the places of their nodes. Out: the points where their lines are nearest, with the gap d = n·(x - y) along the normal
//! n of both, which points out of the second body.

use super::meeting::{Meeting, face_each_other};
use super::touched_body::{SurfaceSpot, TouchedBody};
use nalgebra::Vector3;

type V3 = Vector3<f64>;

/// Sine of the angle between two edges below which they run along each other, and do not cross.
const CROSSING: f64 = 0.1;

/// Places of a body's nodes, and the body.
pub struct Side<'a> {
    pub body: &'a TouchedBody,
    pub place: &'a dyn Fn(u32) -> V3,
}

impl Side<'_> {
    /// Corners of the triangles beside an edge.
    fn beside(&self, [i, j]: [u32; 2]) -> impl Iterator<Item = [V3; 3]> {
        let triangles = &self.body.triangles;
        let around = self.body.around[i as usize].iter().map(|number| triangles[*number as usize]);
        around.filter(move |corners| corners.contains(&j)).map(|corners| corners.map(self.place))
    }

    /// Each edge once, with its middle and half its length.
    fn balls(&self, mut edges: Vec<[u32; 2]>) -> Vec<([u32; 2], V3, f64)> {
        edges.sort_unstable();
        edges.dedup();
        let ball = |edge: [u32; 2]| {
            let [a, b] = edge.map(self.place);
            (edge, (a + b) * 0.5, (b - a).norm() * 0.5)
        };
        edges.into_iter().map(ball).collect()
    }

    /// Mean outward normal of the triangles beside an edge.
    fn outward(&self, edge: [u32; 2]) -> V3 {
        let normal =
            |[a, b, c]: [V3; 3]| (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(V3::zeros);
        self.beside(edge).map(normal).sum::<V3>().try_normalize(0.0).unwrap_or_else(V3::zeros)
    }
}

/// Nodes of an edge on which a spot lies; `None` for a spot of a triangle or a node.
pub fn edge_of(spot: &SurfaceSpot) -> Option<[u32; 2]> {
    let [i, j, k] = spot.nodes;
    (i != j && k == i).then_some([i, j])
}

fn spot_on([i, j]: [u32; 2], share: f64) -> SurfaceSpot {
    SurfaceSpot { nodes: [i, j, i], weights: [1.0 - share, share, 0.0] }
}

/// Direction in which two edges that cross come apart: that of the first out of the second.
pub fn apart(sides: &[Side<'_>; 2], edges: [[u32; 2]; 2]) -> V3 {
    let [a, b] = [0, 1].map(|k| (sides[k].place)(edges[k][1]) - (sides[k].place)(edges[k][0]));
    let outward = sides[1].outward(edges[1]);
    match a.cross(&b).try_normalize(CROSSING * a.norm() * b.norm()) {
        Some(normal) if normal.dot(&outward) < 0.0 => -normal,
        Some(normal) => normal,
        None => outward,
    }
}

/// Spots at which two edges cross, and their gap; `None` where they pass each other beyond their ends.
pub fn crossing(sides: &[Side<'_>; 2], edges: [[u32; 2]; 2]) -> Option<([SurfaceSpot; 2], f64)> {
    let [a, b] = [0, 1].map(|k| edges[k].map(sides[k].place));
    let (u, v, w) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let [uu, uv, vv] = [u.dot(&u), u.dot(&v), v.dot(&v)];
    let determinant = uu * vv - uv * uv;
    if determinant <= CROSSING * CROSSING * uu * vv {
        return None;
    }
    let share = (uv * v.dot(&w) - vv * u.dot(&w)) / determinant;
    let other = (uu * v.dot(&w) - uv * u.dot(&w)) / determinant;
    if !((0.0..=1.0).contains(&share) && (0.0..=1.0).contains(&other)) {
        return None;
    }
    let normal = apart(sides, edges);
    let [own, across] = [0, 1].map(|k| sides[k].outward(edges[k]));
    if !(face_each_other(&normal, &own) && face_each_other(&-normal, &across)) {
        return None;
    }
    let gap = normal.dot(&(a[0] + u * share - b[0] - v * other));
    Some(([spot_on(edges[0], share), spot_on(edges[1], other)], gap))
}

/// Whether each of two edges passes through a triangle beside the other.
pub fn pass_through(sides: &[Side<'_>; 2], edges: [[u32; 2]; 2]) -> bool {
    let passes = |own: usize, other: usize| {
        let ends = edges[own].map(sides[own].place);
        sides[other].beside(edges[other]).any(|corners| pierces(&ends, &corners))
    };
    passes(0, 1) && passes(1, 0)
}

/// Whether a line between two points passes through a triangle, by the signs of volumes.
fn pierces([p, q]: &[V3; 2], [a, b, c]: &[V3; 3]) -> bool {
    let volume = |x: &V3, y: &V3, z: &V3| (x - p).cross(&(y - p)).dot(&(z - p));
    let normal = (b - a).cross(&(c - a));
    let sides = [normal.dot(&(p - a)), normal.dot(&(q - a))];
    let around = [volume(q, a, b), volume(q, b, c), volume(q, c, a)];
    sides[0] * sides[1] < 0.0 && (around.iter().all(|v| *v > 0.0) || around.iter().all(|v| *v < 0.0))
}

/// Pairs of edges of a meeting, of which one is at its node and one of its triangles, that are nearer than `reach`, m.
pub fn near_edges(meeting: &Meeting, sides: &[Side<'_>; 2], reach: f64) -> Vec<[[u32; 2]; 2]> {
    let sorted = |i: u32, j: u32| [i.min(j), i.max(j)];
    let node = meeting.node;
    let around = sides[0].body.with_neighbours(node).filter(|other| *other != node);
    let own = sides[0].balls(around.map(|other| sorted(node, other)).collect());
    let corners = meeting.triangles().map(|number| sides[1].body.triangles[number as usize]);
    let others = corners.flat_map(|[i, j, k]| [sorted(i, j), sorted(j, k), sorted(k, i)]);
    let others = sides[1].balls(others.collect());
    let is_same = meeting.body == meeting.other;
    // Of a body itself each pair counts once, and edges with a node in common not at all.
    let counts = |one: &[u32; 2], two: &[u32; 2]| {
        !is_same || (one < two && !one.iter().any(|node| two.contains(node)))
    };
    let mut pairs = Vec::new();
    for (one, middle, half) in &own {
        for (two, centre, radius) in &others {
            let far = half + radius + reach;
            if (middle - centre).norm_squared() < far * far && counts(one, two) {
                pairs.push([*one, *two]);
            }
        }
    }
    pairs
}
