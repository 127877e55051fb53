//! Surfaces that meet: nodes of one against triangles of another, or of the same.
//!
//! In: places of the nodes. Out: once a frame the triangles that each node can reach ([`meetings`]); in every round the point of them that
//! faces a node, with the gap d = n·(x - y), negative where the node has passed through ([`Meeting::met`]). The normal n is smooth across
//! edges that are not creases, so that a node slides from triangle to triangle without a jerk.

use super::candidates::Places;
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::base::extent::extent;
use crate::world::tool_shape::nearest_weights;
use glamx::Vec3;
use nalgebra::Vector3;
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

type V3 = Vector3<f64>;

/// Largest cosine between the outward normals of surfaces that meet.
const FACING: f64 = -0.2;
/// Part of an edge by which a node may stand beside the end of a surface and still touch it, and that part of its gap.
const BESIDE: f64 = 1e-3;
const LEANING: f64 = 1.7;
/// Part of an edge by which a node that is outside may seem to be within.
const ROUNDING: f64 = 1e-6;
/// Part of a wall's thickness up to which a surface may pass into another one, and into itself: more is taken for its own other side.
const DEEPEST: f64 = 1.0;
const DEEPEST_ITSELF: f64 = 0.6;
/// Sine of the angle by which a triangle beside a node may stand out of its plane by rounding.
const FLAT: f64 = 1e-6;
/// Thicknesses within which two sides at rest belong to one wall.
const ONE_WALL: f64 = 1.5;

/// A node of a body, and the triangles of another that it can meet in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Meeting {
    pub body: usize,
    pub node: u32,
    pub other: usize,
    triangles: Vec<u32>,
}

/// The place where a node meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met {
    pub spot: SurfaceSpot,
    /// m, in the room.
    pub gap: f64,
    /// Whether the node is in front of the place: not beside the surface, and not come from its other side.
    pub is_before: bool,
    /// Whether the triangle, or the node, yields to forces.
    pub yields: bool,
}

/// Nodes of two bodies and the triangles of the other that are nearer than `reach`, m. `places` are those of all nodes of every body, in
/// the room.
pub fn meetings(bodies: &[TouchedBody], [a, b]: [usize; 2], places: &[Vec<V3>], reach: f64) -> Vec<Meeting> {
    let mut all = towards(bodies, [a, b], places, reach);
    if a != b && !all.is_empty() {
        all.extend(towards(bodies, [b, a], places, reach));
    }
    all
}

fn towards(bodies: &[TouchedBody], [a, b]: [usize; 2], places: &[Vec<V3>], reach: f64) -> Vec<Meeting> {
    let own = around(places[a].iter().copied(), reach);
    let triangles = &bodies[b].triangles;
    let boxes = (0..triangles.len() as u32).filter_map(|number| {
        let bounds = around(triangles[number as usize].iter().map(|node| places[b][*node as usize]), reach);
        own.intersects(&bounds).then_some((number, bounds))
    });
    let (numbers, boxes): (Vec<u32>, Vec<Aabb>) = boxes.unzip();
    if numbers.is_empty() {
        return Vec::new();
    }
    let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
    let root = tree.root_aabb();
    let meeting = |node: u32| {
        let at = around(std::iter::once(places[a][node as usize]), 0.0);
        if !root.intersects(&at) {
            return None;
        }
        let near = tree.intersect_aabb(&at).map(|leaf| numbers[leaf as usize]);
        let is_met = |number: &u32| a != b || bodies[a].can_meet_itself(node, *number);
        let mut triangles: Vec<u32> = near.filter(is_met).collect();
        triangles.sort_unstable();
        (!triangles.is_empty()).then_some(Meeting { body: a, node, other: b, triangles })
    };
    (0..places[a].len() as u32).filter_map(meeting).collect()
}

/// Whether two outward normals face each other.
pub fn face_each_other(one: &V3, other: &V3) -> bool {
    one.dot(other) < FACING
}

/// The box about these places, `reach` wider on all sides.
fn around(places: impl Iterator<Item = V3>, reach: f64) -> Aabb {
    let (low, high) = extent(places).unwrap_or_default();
    let part = |v: V3| Vec3::new(v.x as f32, v.y as f32, v.z as f32);
    let slack = Vec3::splat(reach as f32);
    Aabb::new(part(low) - slack, part(high) + slack)
}

/// The nearest point of a triangle.
struct Nearest {
    corners: [u32; 3],
    weights: [f64; 3],
    /// Vector from there to the node.
    away: V3,
    /// Outward.
    face: V3,
}

impl Meeting {
    pub fn triangles(&self) -> impl Iterator<Item = u32> + use<'_> {
        self.triangles.iter().copied()
    }

    /// Nodes of the triangles.
    pub fn corners<'a>(&'a self, bodies: &'a [TouchedBody]) -> impl Iterator<Item = u32> + use<'a> {
        let triangles = &bodies[self.other].triangles;
        self.triangles.iter().flat_map(|number| triangles[*number as usize])
    }

    /// The nearest point that faces the node, if any does. `outlines` are the places of nodes that have none in `places`.
    pub fn met(&self, bodies: &[TouchedBody], places: &[Places], outlines: &[Vec<V3>]) -> Option<Met> {
        let Meeting { body, node, other, .. } = *self;
        let master = &bodies[other];
        let x = places[body].get(node)?;
        let place = |node: u32| places[other].get(node).unwrap_or(outlines[other][node as usize]);
        let own = |node: u32| places[body].get(node).unwrap_or(outlines[body][node as usize]);
        let outward = bodies[body].outward(node, &own);
        let all = self.triangles.iter().map(|number| master.triangles[*number as usize]);
        let faced = all.clone().filter_map(|corners| {
            let at = corners.map(place);
            let face = normal_of(&at)?;
            face_each_other(&face, &outward).then(|| nearest_of(&at, face, &x, corners))
        });
        let facing = faced.min_by(|a, b| a.away.norm_squared().total_cmp(&b.away.norm_squared()))?;
        let spot = SurfaceSpot { nodes: facing.corners, weights: facing.weights };
        let normal = master.normal(&spot, &place);
        let gap = normal.dot(&facing.away);
        let edge = master.longest().min(bodies[body].longest());
        let aside = (facing.away - normal * gap).norm();
        let is_beside = aside > BESIDE * edge + LEANING * gap.abs();
        let is_within = match body == other {
            true => gap < 0.0,
            false => {
                let nearest = all.filter_map(|corners| {
                    let at = corners.map(place);
                    Some(nearest_of(&at, normal_of(&at)?, &x, corners))
                });
                nearest.reduce(nearer).is_some_and(|nearest| nearest.face.dot(&nearest.away) < 0.0)
            }
        };
        let deepest = master.thickness() * if body == other { DEEPEST_ITSELF } else { DEEPEST };
        let is_before = match is_within {
            true => facing.away.norm() <= deepest && (body != other || !is_beside),
            false => gap > -ROUNDING * edge && !is_beside,
        };
        let takes = |node: &u32| master.takes[*node as usize];
        let yields = bodies[body].takes[node as usize] && facing.corners.iter().all(takes);
        Some(Met { spot, gap, is_before, yields })
    }
}

fn normal_of(at: &[V3; 3]) -> Option<V3> {
    (at[1] - at[0]).cross(&(at[2] - at[0])).try_normalize(0.0)
}

fn nearest_of(at: &[V3; 3], face: V3, x: &V3, corners: [u32; 3]) -> Nearest {
    let weights = nearest_weights(at, x);
    let away = x - (at[0] * weights[0] + at[1] * weights[1] + at[2] * weights[2]);
    Nearest { corners, weights, away, face }
}

/// The nearer of two triangles; where they share the nearest point, the one whose plane is farther, which says whether the node is
/// outside.
fn nearer(one: Nearest, other: Nearest) -> Nearest {
    let (own, than) = (one.away.norm(), other.away.norm());
    let height = |nearest: &Nearest| nearest.face.dot(&nearest.away).abs();
    let is_first = match (own - than).abs() <= 1e-9 * (own + than) {
        true => height(&one) >= height(&other),
        false => own < than,
    };
    if is_first { one } else { other }
}

impl TouchedBody {
    /// Whether a node can meet a triangle of its own body: not one around it, nor the other side of its wall.
    fn can_meet_itself(&self, node: u32, triangle: u32) -> bool {
        let corners = self.triangles[triangle as usize];
        if corners.contains(&node) {
            return false;
        }
        let rest = |node: u32| V3::from(self.free.rest()[node as usize].map(f64::from));
        let (at, x) = (corners.map(rest), rest(node));
        let Some(face) = normal_of(&at) else { return false };
        let away = nearest_of(&at, face, &x, corners).away;
        let far = away.norm();
        let is_inward = self.outward_at_rest[node as usize].dot(&away) >= -FLAT * far;
        !(is_inward && far <= ONE_WALL * self.wall)
    }
}
