//! The surface of a mesh in pieces: the outer one with the cuts in it.

use super::edges::{CutEdges, edge, share};
use super::groups::{is_single, pairs, seen_from_outside};
use super::pieces::{Piece, Split, Splitter};
use crate::mesh::tet_mesh::FACES;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A point of a cut surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPoint {
    /// The nodes, or copies, between which it lies, and the part of the way from the first to the second.
    pub nodes: [u32; 2],
    pub share: f64,
}

/// The outer surface with the cuts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CutSurface {
    /// Points beside the nodes of the mesh, which keep their numbers.
    pub points: Vec<CutPoint>,
    /// Nodes of the mesh, then `points`; counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl CutSurface {
    /// A node or copy of the piece to which a corner of a triangle belongs, in a mesh of `nodes` nodes.
    pub fn corner(&self, corner: u32, nodes: usize) -> u32 {
        (corner as usize).checked_sub(nodes).map_or(corner, |point| self.points[point].nodes[0])
    }
}

impl Splitter {
    /// The outer surface of a mesh in pieces with the cuts.
    pub fn surface(&self, split: &Split, cut: &CutEdges) -> CutSurface {
        let mut points =
            Points { known: BTreeMap::new(), all: Vec::new(), base: self.mesh.nodes.len() as u32 };
        let mut triangles = Vec::new();
        for (tet, nodes) in (0..).zip(&self.mesh.tets) {
            for (face, corners) in FACES.iter().enumerate() {
                if let Some(other) = self.neighbours[tet as usize][face] {
                    let own = self.middle(tet, *corners, split, cut, &mut points);
                    let of_other = own.and_then(|_| {
                        let place = |k: usize| {
                            self.mesh.tets[other as usize].iter().position(|n| *n == nodes[corners[k]])
                        };
                        let there = [place(0)?, place(1)?, place(2)?];
                        self.middle(other, there, split, cut, &mut points)
                    });
                    triangles.extend(own.filter(|own| of_other.is_some_and(|other| other != *own)));
                    continue;
                }
                match split.pieces_of(tet) {
                    None => triangles.push(corners.map(|corner| nodes[corner])),
                    Some(own) => {
                        for piece in own {
                            let polygon = self.face_of(&split.pieces[piece], *corners, cut, &mut points);
                            triangles.extend(fan(&polygon));
                        }
                    }
                }
            }
        }
        for piece in &split.pieces {
            self.sides(piece, cut, (&mut points, &mut triangles));
        }
        CutSurface { points: points.all, triangles }
    }

    /// The part of a face that belongs to a piece, a polygon.
    fn face_of(&self, piece: &Piece, face: [usize; 3], cut: &CutEdges, points: &mut Points) -> Vec<u32> {
        let nodes = self.mesh.tets[piece.tet as usize];
        let group = self.groups(piece.tet, cut);
        let middle = self.middle_of(piece.tet, &group, cut);
        let is_rest = is_rest(piece, &group, middle);
        let mut polygon = Vec::new();
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let mut point = |points: &mut Points| {
                let share = share(cut, [nodes[a], nodes[b]]);
                polygon.push(points.at([piece.nodes[a], piece.nodes[b]], share));
            };
            match (piece.own[a], piece.own[b]) {
                (true, true) => polygon.push(points.corner(piece.nodes[a])),
                (true, false) => {
                    polygon.push(points.corner(piece.nodes[a]));
                    let share = share(cut, [nodes[a], nodes[b]]);
                    polygon.push(points.at([piece.nodes[a], piece.nodes[b]], share));
                }
                (false, true) => point(points),
                // Between two corners that are cut off what is left of the face reaches to the cut.
                (false, false) if group[a] != group[b] && is_rest => point(points),
                (false, false) => {}
            }
        }
        let has_middle = is_rest && polygon.len() == 3 && middle.is_some();
        if has_middle || face.iter().any(|corner| piece.own[*corner]) { polygon } else { Vec::new() }
    }

    /// The triangle between the cuts of all three edges of a face, with the points of the piece to which it belongs; `None` where an edge is
    /// whole, or the tetrahedron.
    fn middle(
        &self,
        tet: u32,
        face: [usize; 3],
        split: &Split,
        cut: &CutEdges,
        points: &mut Points,
    ) -> Option<[u32; 3]> {
        let own = split.pieces_of(tet)?;
        let nodes = self.mesh.tets[tet as usize];
        let sides = [[0, 1], [1, 2], [2, 0]].map(|side| side.map(|k| face[k]));
        if sides.iter().any(|[a, b]| !cut.contains_key(&edge([nodes[*a], nodes[*b]]))) {
            return None;
        }
        // It belongs to what is left when the corners are cut off.
        let group = self.groups(tet, cut);
        let rest = face.into_iter().find(|corner| {
            !is_single(&group, *corner) || face.iter().any(|o| o != corner && group[*o] == group[*corner])
        });
        let rest = self.middle_of(tet, &group, cut).or(rest).unwrap_or(face[0]);
        let piece = split.pieces[own].iter().find(|piece| piece.own[rest])?;
        Some(
            sides.map(|[a, b]| points.at([piece.nodes[a], piece.nodes[b]], share(cut, [nodes[a], nodes[b]]))),
        )
    }

    /// Adds the sides of a piece towards the other pieces of its tetrahedron.
    fn sides(&self, piece: &Piece, cut: &CutEdges, (points, triangles): (&mut Points, &mut Vec<[u32; 3]>)) {
        let nodes = self.mesh.tets[piece.tet as usize];
        let group = self.groups(piece.tet, cut);
        let mut at = |a: usize, b: usize| {
            points.at([piece.nodes[a], piece.nodes[b]], share(cut, [nodes[a], nodes[b]]))
        };
        if let Some([a, b, c, d]) = pairs(&group) {
            let quad = [at(a, c), at(a, d), at(b, d), at(b, c)];
            let sides = [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]];
            triangles.extend(if piece.own[a] { sides } else { sides.map(turned) });
            return;
        }
        let middle = self.middle_of(piece.tet, &group, cut);
        for alone in (0..4).filter(|node| is_single(&group, *node) && middle != Some(*node)) {
            let others: Vec<usize> = (0..4).filter(|node| *node != alone).collect();
            let [a, b, c, d] = seen_from_outside([alone, others[0], others[1], others[2]]);
            let own = piece.own[a];
            if own || is_rest(piece, &group, middle) || piece.own.iter().filter(|own| **own).count() > 1 {
                let side = [at(a, b), at(a, c), at(a, d)];
                triangles.push(if own { side } else { turned(side) });
            }
        }
    }

    /// Area of the cuts through a tetrahedron at rest, each counted once.
    pub fn cut_area(&self, tet: u32, cut: &CutEdges) -> f64 {
        let nodes = self.mesh.tets[tet as usize];
        let group = self.groups(tet, cut);
        let at = |a: usize, b: usize| {
            let [x, y] = [a, b].map(|corner| &self.mesh.nodes[nodes[corner] as usize]);
            x.lerp(y, share(cut, [nodes[a], nodes[b]]))
        };
        let area = |[a, b, c]: [Vector3<f64>; 3]| 0.5 * (b - a).cross(&(c - a)).norm();
        if let Some([a, b, c, d]) = pairs(&group) {
            let quad = [at(a, c), at(a, d), at(b, d), at(b, c)];
            return area([quad[0], quad[1], quad[2]]) + area([quad[0], quad[2], quad[3]]);
        }
        let corner = |alone: usize| {
            let others: Vec<usize> = (0..4).filter(|node| *node != alone).collect();
            area([0, 1, 2].map(|k| at(alone, others[k])))
        };
        let middle = self.middle_of(tet, &group, cut);
        (0..4).filter(|node| is_single(&group, *node) && middle != Some(*node)).map(corner).sum()
    }

    /// Place of a node or copy at rest.
    pub fn place(&self, split: &Split, node: u32) -> Vector3<f64> {
        self.mesh.nodes[split.original(node, self.mesh.nodes.len()) as usize]
    }
}

/// Whether a piece is what two or three cut-off corners leave of a tetrahedron.
fn is_rest(piece: &Piece, group: &[usize; 4], middle: Option<usize>) -> bool {
    let groups = (0..4).filter(|node| group[*node] == *node).count();
    let of_pair = groups == 3 && piece.own.iter().filter(|own| **own).count() == 2;
    of_pair || middle.is_some_and(|node| piece.own[node])
}

/// Points of the cut surface as they are found.
struct Points {
    known: BTreeMap<[u32; 2], u32>,
    all: Vec<CutPoint>,
    base: u32,
}

impl Points {
    /// The number of a node, or of the point where a copy is.
    fn corner(&mut self, node: u32) -> u32 {
        if node < self.base { node } else { self.at([node; 2], 0.0) }
    }

    /// The number of the point between two nodes or copies, at this part of the way from the first.
    fn at(&mut self, [a, b]: [u32; 2], share: f64) -> u32 {
        let point = match a < b {
            true => CutPoint { nodes: [a, b], share },
            false => CutPoint { nodes: [b, a], share: 1.0 - share },
        };
        *self.known.entry(point.nodes).or_insert_with(|| {
            self.all.push(point);
            self.base + self.all.len() as u32 - 1
        })
    }
}

fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + use<'_> {
    (2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]])
}

fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    [a, c, b]
}
