//! A blade in a world, and the edges of a mesh that it cuts on its way.

use crate::mesh::split::edge;
use crate::render::GhostShape;
use crate::scene::{Tool, ToolShape};
use crate::world::ToolPlace;
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Least distance of a cut from a node, as a part of the edge.
const OFF_NODES: f64 = 0.02;
/// Thickness with which a blade is drawn, against its width.
const THICKNESS: f64 = 0.06;

pub struct Blade {
    pub name: String,
    pub place: ToolPlace,
    pub drawn: Arc<GhostShape>,
    /// Linear RGB.
    pub color: [f32; 3],
    length: f64,
}

impl Blade {
    /// `None` for a tool that is no blade.
    pub fn new(name: &str, tool: &Tool) -> Option<Blade> {
        let ToolShape::Blade { length, width } = tool.shape else { return None };
        Some(Blade {
            name: name.to_owned(),
            place: ToolPlace::new(tool),
            drawn: Arc::new(wedge(length, width)),
            color: tool.color.linear(),
            length,
        })
    }

    /// Length of its edge, m.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Both ends of its edge in the room.
    pub fn edge(&self, pose: &Isometry3<f64>) -> [V3; 2] {
        [0.0, self.length].map(|z| (pose * Point3::new(0.0, 0.0, z)).coords)
    }
}

/// A wedge whose edge goes from the origin along z and whose back stands above it.
fn wedge(length: f64, width: f64) -> GhostShape {
    let half = 0.5 * THICKNESS * width;
    let corners = [
        [0.0, 0.0, 0.0],
        [-half, width, 0.3 * width],
        [half, width, 0.3 * width],
        [0.0, 0.0, length],
        [-half, width, length],
        [half, width, length],
    ]
    .map(V3::from);
    let faces = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2]];
    let mut shape = GhostShape { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
    for face in faces {
        let [a, b, c] = face.map(|corner: usize| corners[corner]);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(V3::y);
        let first = shape.positions.len() as u32;
        for x in [a, b, c] {
            shape.positions.push(x.cast::<f32>().into());
            shape.normals.push(normal.cast::<f32>().into());
        }
        shape.triangles.push([first, first + 1, first + 2]);
    }
    shape
}

/// The way of a blade's edge in a frame: its ends where it began and where it came to.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    pub from: [V3; 2],
    pub to: [V3; 2],
}

/// The way of a blade, by its number, and its pose at the end.
#[derive(Clone, Copy, Debug)]
pub struct Swept {
    pub blade: usize,
    pub room_from_blade: Isometry3<f64>,
    pub sweep: Sweep,
}

impl Sweep {
    /// Corners of a box about it.
    pub fn low_and_high(&self) -> [V3; 2] {
        let all = self.from.iter().chain(&self.to);
        let start = [self.from[0]; 2];
        all.fold(start, |[low, high], x| [low.inf(x), high.sup(x)])
    }

    /// Motion of the middle of the edge.
    pub fn moved(&self) -> V3 {
        (self.to[0] + self.to[1] - self.from[0] - self.from[1]) * 0.5
    }

    pub fn is_still(&self) -> bool {
        self.from == self.to
    }

    /// The edges that it passes through, and where. Nodes have moved from `before` to `now` meanwhile: each edge is looked at from where
    /// its middle is.
    pub fn crossed(&self, edges: &[[u32; 2]], (before, now): (&[V3], &[V3])) -> Vec<([u32; 2], f64)> {
        let reach = before.iter().zip(now).map(|(x, y)| (y - x).norm()).fold(0.0, f64::max);
        let [low, high] = self.low_and_high();
        let (low, high) = (low - V3::repeat(reach), high + V3::repeat(reach));
        let mut found = Vec::new();
        for [a, b] in edges {
            let (x, y) = (now[*a as usize], now[*b as usize]);
            let is_apart = (0..3).any(|k| x[k].max(y[k]) < low[k] || x[k].min(y[k]) > high[k]);
            if is_apart {
                continue;
            }
            let moved = (x + y - before[*a as usize] - before[*b as usize]) * 0.5;
            let [p, q] = self.from.map(|end| end + moved);
            let [r, s] = self.to;
            let share = crossing([x, y], [p, q, s]).or_else(|| crossing([x, y], [p, s, r]));
            if let Some(share) = share {
                found.push((edge([*a, *b]), share.clamp(OFF_NODES, 1.0 - OFF_NODES)));
            }
        }
        found
    }
}

/// Place at which a segment passes through a triangle, as a part of the way from its first end (T. Möller and B. Trumbore, Journal of Graphics
/// Tools 2, 1997, 21-28).
fn crossing([x, y]: [V3; 2], [a, b, c]: [V3; 3]) -> Option<f64> {
    let (along, one, two) = (y - x, b - a, c - a);
    let across = along.cross(&two);
    let det = one.dot(&across);
    if det == 0.0 {
        return None;
    }
    let from = x - a;
    let u = from.dot(&across) / det;
    let turned = from.cross(&one);
    let v = along.dot(&turned) / det;
    let share = two.dot(&turned) / det;
    ((0.0..=1.0).contains(&u) && v >= 0.0 && u + v <= 1.0 && (0.0..=1.0).contains(&share)).then_some(share)
}
