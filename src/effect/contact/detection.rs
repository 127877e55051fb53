//! Spots where tools meet a surface: nodes, and points of triangles that are large against the tool.
//!
//! In: places of a surface's nodes, and where the tools are. Out: for each tool the spots that are nearer than a given distance. A node or a
//! triangle whose outside does not face the tool is passed over: the tool has come from within.

use super::candidates::{Nodes, Places};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::world::tool_shape::Shape;
use nalgebra::{Isometry3, Point3, Vector3};

type V3 = Vector3<f64>;

/// Largest cosine between ∇φ, which points from the tool into the body, and the body's outward normal where they meet.
const FACING: f64 = 0.2;
/// A triangle's point counts between its corners if each has a share of at least this.
const BETWEEN: f64 = 0.02;
/// Part of the tool's radius by which a point between nodes must be nearer than they are: flat faces meet at nodes.
const DEEPER: f64 = 0.01;
/// A tool that is blunter than this many longest edges touches nodes alone.
const BLUNT: f64 = 2.0;

/// Spots of a body that a tool reaches, and what else it meets there.
#[derive(Default)]
pub struct Found {
    pub spots: Vec<SurfaceSpot>,
    /// Whether it reaches into the body, which it cannot have entered through its surface.
    pub is_within: bool,
    /// Whether it reaches into nodes that take no forces.
    pub meets_stiff: bool,
}

/// φ and ∇φ in the room of a tool that stands at `room_from_tool`.
pub fn distance(shape: &Shape, room_from_tool: &Isometry3<f64>, x: &V3) -> (f64, V3) {
    let (distance, normal) =
        shape.distance(&room_from_tool.inverse_transform_point(&Point3::from(*x)).coords);
    (distance, room_from_tool.rotation * normal)
}

/// Whether points between nodes of the body can touch the tool before the nodes do.
fn is_sharp(shape: &Shape, body: &TouchedBody) -> bool {
    shape.bluntness() < BLUNT * body.longest()
}

/// Spots of the body nearer than `near` to the tool, m. `nodes` are its candidates, `free` those of all nodes without contact.
pub fn find(
    shape: &Shape,
    room_from_tool: &Isometry3<f64>,
    body: &TouchedBody,
    (nodes, places): (&Nodes, &Places),
    free: &[V3],
    near: f64,
) -> Found {
    let mut found = Found::default();
    let mut meets_back = false;
    let faces = |normal: &V3, outward: &V3| normal.dot(outward) < FACING;
    for node in nodes.iter() {
        let Some(place) = places.get(node) else { continue };
        let (gap, normal) = distance(shape, room_from_tool, &place);
        if gap >= near {
            continue;
        }
        if !body.takes[node as usize] {
            found.meets_stiff |= gap < 0.0;
        } else if faces(&normal, &body.outward(node, &|corner| free[corner as usize])) {
            found.spots.push(SurfaceSpot::node(node));
        } else {
            meets_back |= gap < 0.0;
        }
    }
    if is_sharp(shape, body) {
        for triangle in triangles(body, nodes) {
            let corners = body.triangles[triangle as usize];
            if corners.iter().any(|node| !body.takes[*node as usize]) {
                continue;
            }
            let Some(at) = places_of(corners, places) else { continue };
            let in_tool = at.map(|x| room_from_tool.inverse_transform_point(&Point3::from(x)).coords);
            let weights = shape.nearest_of_triangle(&in_tool);
            if weights.iter().filter(|w| **w >= BETWEEN).count() < 2 {
                continue;
            }
            let place = at[0] * weights[0] + at[1] * weights[1] + at[2] * weights[2];
            let (gap, normal) = distance(shape, room_from_tool, &place);
            let outward = (at[1] - at[0]).cross(&(at[2] - at[0])).normalize();
            let at_nodes =
                at.map(|x| distance(shape, room_from_tool, &x).0).into_iter().fold(f64::INFINITY, f64::min);
            let is_deeper = gap < at_nodes - DEEPER * shape.bluntness();
            if gap < near && is_deeper && faces(&normal, &outward) {
                let spot = on_feature(corners, weights);
                if !found.spots.contains(&spot) {
                    found.spots.push(spot);
                }
            }
        }
    }
    found.is_within = meets_back && found.spots.is_empty();
    found
}

/// The triangles around these nodes.
fn triangles(body: &TouchedBody, nodes: &Nodes) -> Vec<u32> {
    let around = nodes.iter().flat_map(|node| body.around[node as usize].iter().copied());
    let mut all: Vec<u32> = around.collect();
    all.sort_unstable();
    all.dedup();
    all
}

fn places_of([a, b, c]: [u32; 3], places: &Places) -> Option<[V3; 3]> {
    Some([places.get(a)?, places.get(b)?, places.get(c)?])
}

/// The spot of a triangle with these weights; one on an edge is the same for both triangles beside it.
fn on_feature(corners: [u32; 3], weights: [f64; 3]) -> SurfaceSpot {
    let mut pairs: Vec<(u32, f64)> = corners.into_iter().zip(weights).collect();
    pairs.iter_mut().filter(|(_, w)| *w < BETWEEN).for_each(|(_, w)| *w = 0.0);
    let sum: f64 = pairs.iter().map(|(_, w)| w).sum();
    pairs.sort_by(|(a, v), (b, w)| (*v == 0.0, a).cmp(&(*w == 0.0, b)));
    let first = pairs[0].0;
    let node = |k: usize| if pairs[k].1 == 0.0 { first } else { pairs[k].0 };
    // Rounded, so that both triangles beside an edge find the same.
    let weight = |k: usize| (pairs[k].1 / sum * 1e9).round() / 1e9;
    let [b, c] = [weight(1), weight(2)];
    SurfaceSpot { nodes: [first, node(1), node(2)], weights: [1.0 - b - c, b, c] }
}
