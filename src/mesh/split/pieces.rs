//! The pieces of divided tetrahedra, and the copies of nodes with which they move.

use super::edges::{CutEdges, edge, share};
use super::groups::{PAIRS, is_single, pairs};
use crate::base::disjoint::DisjointSets;
use crate::mesh::surface::sorted_faces;
use crate::mesh::tet_mesh::{FACES, TetMesh};
use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Faces and neighbours of a mesh that is to be cut.
pub struct Splitter {
    pub mesh: Arc<TetMesh>,
    /// The neighbour of each tetrahedron across each face; `None` at the outer surface.
    pub(super) neighbours: Vec<[Option<u32>; 4]>,
    /// Tetrahedra around each node: those of node n stand from `start[n]` to `start[n + 1]`.
    around: Vec<u32>,
    start: Vec<usize>,
}

/// A piece of a tetrahedron that is divided.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    pub tet: u32,
    /// Whether each node of the tetrahedron lies in it.
    pub own: [bool; 4],
    /// ∫ N dV over it of the shape function N of each node of the tetrahedron, as parts of the tetrahedron's volume.
    pub shares: [f64; 4],
    /// The nodes with which it moves: those of the mesh, or copies, which are counted on from them.
    pub nodes: [u32; 4],
}

impl Piece {
    /// A tetrahedron in one piece that moves with these nodes.
    pub(super) fn whole(tet: u32, nodes: [u32; 4]) -> Piece {
        Piece { tet, own: [true; 4], shares: [0.25; 4], nodes }
    }

    /// Whether it is a part of another piece of the tetrahedron.
    fn is_in(&self, other: &Piece) -> bool {
        (0..4).all(|k| other.own[k] || !self.own[k])
    }

    /// The first of its corners.
    pub fn corner(&self) -> TetCorner {
        (self.tet, self.own.iter().position(|own| *own).unwrap_or_default())
    }

    /// Part of the tetrahedron's volume.
    pub fn volume(&self) -> f64 {
        self.shares.iter().sum()
    }
}

/// A part of a mesh in pieces with which nothing else moves.
#[derive(Clone, Debug, PartialEq)]
pub struct LoosePart {
    /// Whole tetrahedra.
    pub tets: Vec<u32>,
    /// Numbers of its pieces.
    pub pieces: Vec<usize>,
    /// Nodes and copies, ascending.
    pub nodes: Vec<u32>,
}

/// A corner of a tetrahedron of the mesh: its number, and which of its four nodes.
pub type TetCorner = (u32, usize);

impl LoosePart {
    /// The corners of tetrahedra that lie in it, the lowest one first.
    pub fn corners(&self, split: &Split) -> Vec<TetCorner> {
        let of_tets = self.tets.iter().flat_map(|tet| (0..4).map(|k| (*tet, k)));
        let own =
            |piece: &Piece| (0..4).filter(|k| piece.own[*k]).map(|k| (piece.tet, k)).collect::<Vec<_>>();
        let of_pieces = self.pieces.iter().flat_map(|number| own(&split.pieces[*number]));
        let mut corners: Vec<TetCorner> = of_tets.chain(of_pieces).collect();
        corners.sort_unstable();
        corners
    }
}

/// A mesh that has fallen into pieces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// The pieces of divided tetrahedra, in their order, and whole ones that move with copies.
    pub pieces: Vec<Piece>,
    /// The node of which each copy is one.
    pub copies: Vec<u32>,
    /// The first piece of each divided tetrahedron.
    pub(super) first: BTreeMap<u32, usize>,
    /// The parts that nothing holds.
    pub loose: Vec<LoosePart>,
}

impl Split {
    /// The numbers of a tetrahedron's pieces; `None` of one that is whole.
    pub fn pieces_of(&self, tet: u32) -> Option<Range<usize>> {
        pieces_of(tet, &self.first, &self.pieces)
    }

    /// The nodes with which a corner of a tetrahedron moves: those of its piece, or of the whole one.
    pub fn nodes_at(&self, (tet, k): TetCorner, of_tet: [u32; 4]) -> [u32; 4] {
        let piece = self.pieces_of(tet).and_then(|own| self.pieces[own].iter().find(|piece| piece.own[k]));
        piece.map_or(of_tet, |piece| piece.nodes)
    }

    /// Whether a node or a copy belongs to a part that nothing holds.
    pub fn is_loose(&self, node: u32) -> bool {
        self.loose.iter().any(|part| part.nodes.binary_search(&node).is_ok())
    }

    /// Whether a corner of a tetrahedron lies in a part that nothing holds.
    pub fn is_loose_at(&self, (tet, k): TetCorner) -> bool {
        let piece = self.pieces_of(tet).map(|mut own| own.find(|number| self.pieces[*number].own[k]));
        self.loose.iter().any(|part| match piece {
            None => part.tets.binary_search(&tet).is_ok(),
            Some(piece) => piece.is_some_and(|piece| part.pieces.binary_search(&piece).is_ok()),
        })
    }

    /// The node of the mesh that a node is, or of which it is a copy, in a mesh of `nodes` nodes.
    pub fn original(&self, node: u32, nodes: usize) -> u32 {
        (node as usize).checked_sub(nodes).map_or(node, |copy| self.copies[copy])
    }
}

impl Splitter {
    /// A splitter of a mesh of linear tetrahedra.
    pub fn new(mesh: Arc<TetMesh>) -> Splitter {
        let mut neighbours = vec![[None; 4]; mesh.tets.len()];
        for same in sorted_faces(&mesh).chunk_by(|a, b| a.0 == b.0) {
            if let [(_, one), (_, other)] = same {
                neighbours[one / 4][one % 4] = Some((other / 4) as u32);
                neighbours[other / 4][other % 4] = Some((one / 4) as u32);
            }
        }
        let mut start = vec![0; mesh.nodes.len() + 1];
        mesh.tets.iter().flatten().for_each(|node| start[*node as usize + 1] += 1);
        for node in 0..mesh.nodes.len() {
            start[node + 1] += start[node];
        }
        let (mut next, mut around) = (start.clone(), vec![0; 4 * mesh.tets.len()]);
        for (number, tet) in (0..).zip(&mesh.tets) {
            for node in tet {
                around[next[*node as usize]] = number;
                next[*node as usize] += 1;
            }
        }
        Splitter { mesh, neighbours, around, start }
    }

    /// The tetrahedra around a node.
    pub fn tets_around(&self, node: u32) -> &[u32] {
        &self.around[self.start[node as usize]..self.start[node as usize + 1]]
    }

    /// The groups of a tetrahedron's nodes that edges without a cut join: for each node the lowest of its group.
    pub(super) fn groups(&self, tet: u32, cut: &CutEdges) -> [usize; 4] {
        let nodes = self.mesh.tets[tet as usize];
        let mut group = [0, 1, 2, 3];
        for _ in 0..3 {
            for (a, b) in PAIRS {
                if !cut.contains_key(&edge([nodes[a], nodes[b]])) {
                    let least = group[a].min(group[b]);
                    (group[a], group[b]) = (least, least);
                }
            }
        }
        group
    }

    /// The corner of a tetrahedron with which the middle goes where all four are cut off: the one that would be the largest.
    pub(super) fn middle_of(&self, tet: u32, group: &[usize; 4], cut: &CutEdges) -> Option<usize> {
        let nodes = self.mesh.tets[tet as usize];
        let size = |a: &usize| -> f64 {
            (0..4).filter(|b| b != a).map(|b| share(cut, [nodes[*a], nodes[b]])).product()
        };
        let larger = |a: usize, b: usize| if size(&b) > size(&a) { b } else { a };
        (0..4).reduce(larger).filter(|_| *group == [0, 1, 2, 3])
    }

    /// The mesh after these cuts, with the control element that holds each node. A piece with nodes of its own that an element holds goes
    /// with the element's nodes beyond the cut, too: what holds them holds both sides. Pieces within one of an `earlier` split have its
    /// shares together.
    pub fn split(&self, cut: &CutEdges, held: &[Option<usize>], earlier: &Split) -> Split {
        let mut pieces = Vec::new();
        let mut first: BTreeMap<u32, usize> = BTreeMap::new();
        let mut touched: Vec<u32> =
            cut.keys().flatten().flat_map(|node| self.tets_around(*node)).copied().collect();
        touched.sort_unstable();
        touched.dedup();
        for tet in touched {
            let group = self.groups(tet, cut);
            if group == [0; 4] {
                continue;
            }
            first.insert(tet, pieces.len());
            let shares = self.shares(tet, &group, cut);
            for lowest in (0..4).filter(|node| group[*node] == *node) {
                let own = group.map(|of| of == lowest);
                pieces.push(Piece { tet, own, shares: shares[lowest], nodes: self.mesh.tets[tet as usize] });
            }
            if let Some(of) = earlier.pieces_of(tet) {
                share_out(&mut pieces[first[&tet]..], &earlier.pieces[of]);
            }
        }
        let copies = self.copy_nodes(&mut pieces, &first, held);
        let mut split = Split { pieces, copies, first, loose: Vec::new() };
        self.release(&mut split, held);
        split
    }

    /// [`Piece::shares`] of each group of a tetrahedron's nodes, at its lowest node.
    fn shares(&self, tet: u32, group: &[usize; 4], cut: &CutEdges) -> [[f64; 4]; 4] {
        let nodes = self.mesh.tets[tet as usize];
        let corner = |a: usize| Vector4::ith(a, 1.0);
        let on = |a: usize, b: usize| corner(a).lerp(&corner(b), share(cut, [nodes[a], nodes[b]]));
        let whole = Vector4::repeat(0.25);
        let mut shares = [Vector4::zeros(); 4];
        if let Some([a, b, c, d]) = pairs(group) {
            // The quadrilateral of the cut has its diagonal from ac to bd.
            let (ac, bd) = (on(a, c), on(b, d));
            let parts = [
                [corner(b), on(b, c), bd, corner(a)],
                [corner(a), ac, on(a, d), bd],
                [corner(a), ac, on(b, c), bd],
            ];
            shares[group[a]] = parts.iter().map(share_of).sum();
            shares[group[c]] = whole - shares[group[a]];
            return shares.map(Into::into);
        }
        let mut rest = whole;
        let with_middle = self.middle_of(tet, group, cut);
        for a in (0..4).filter(|a| is_single(group, *a) && with_middle != Some(*a)) {
            let around: Vec<usize> = (0..4).filter(|other| *other != a).collect();
            shares[a] = share_of(&[corner(a), on(a, around[0]), on(a, around[1]), on(a, around[2])]);
            rest -= shares[a];
        }
        if let Some(other) = with_middle.or_else(|| (0..4).find(|node| !is_single(group, *node))) {
            shares[group[other]] = rest;
        }
        shares.map(Into::into)
    }

    /// Gives the pieces copies of the nodes beyond their cuts; the node of each copy.
    fn copy_nodes(
        &self,
        pieces: &mut [Piece],
        first: &BTreeMap<u32, usize>,
        held: &[Option<usize>],
    ) -> Vec<u32> {
        let mut affected: Vec<u32> = pieces.iter().flat_map(|piece| piece.nodes).collect();
        affected.sort_unstable();
        affected.dedup();
        let mut copies = Vec::new();
        for node in affected {
            // The pieces around the node; a whole tetrahedron is one.
            let mut members: Vec<(u32, Option<usize>)> = Vec::new();
            for tet in self.tets_around(node) {
                match pieces_of(*tet, first, pieces) {
                    None => members.push((*tet, None)),
                    Some(own) => members.extend(own.map(|piece| (*tet, Some(piece)))),
                }
            }
            let mut joined = DisjointSets::new(members.len());
            for (i, (tet, piece)) in members.iter().enumerate() {
                for (face, corners) in FACES.iter().enumerate() {
                    let nodes = corners.map(|corner| self.mesh.tets[*tet as usize][corner]);
                    let Some(other) = self.neighbours[*tet as usize][face].filter(|other| other > tet) else {
                        continue;
                    };
                    if !nodes.contains(&node) {
                        continue;
                    }
                    for (j, (_, other_piece)) in members.iter().enumerate().filter(|(_, (t, _))| *t == other)
                    {
                        let has = |tet: u32, piece: &Option<usize>, node: u32| {
                            let own = piece.is_none_or(|piece| {
                                let at = self.mesh.tets[tet as usize].iter().position(|n| *n == node);
                                at.is_some_and(|at| pieces[piece].own[at])
                            });
                            own && self.mesh.tets[tet as usize].contains(&node)
                        };
                        if nodes.iter().any(|n| has(*tet, piece, *n) && has(other, other_piece, *n)) {
                            joined.join(i as u32, j as u32);
                        }
                    }
                }
            }
            let mut roots: BTreeMap<u32, u32> = BTreeMap::new();
            // What has the node itself keeps it; so does what the same control element holds beyond the cut.
            for (i, (tet, piece)) in members.iter().enumerate() {
                let nodes = self.mesh.tets[*tet as usize];
                let own = |k: usize| piece.is_none_or(|piece| pieces[piece].own[k]);
                let by = held[node as usize];
                let is_held_along = |k: usize| own(k) && by.is_some() && held[nodes[k] as usize] == by;
                let has_it = (0..4).any(|k| nodes[k] == node && own(k));
                if has_it || (0..4).any(is_held_along) {
                    roots.insert(joined.root(i as u32), node);
                }
            }
            for (i, (tet, piece)) in members.iter().enumerate() {
                let Some(piece) = piece else { continue };
                let number = *roots.entry(joined.root(i as u32)).or_insert_with(|| {
                    copies.push(node);
                    (self.mesh.nodes.len() + copies.len() - 1) as u32
                });
                if let Some(at) = self.mesh.tets[*tet as usize].iter().position(|n| *n == node) {
                    pieces[*piece].nodes[at] = number;
                }
            }
        }
        copies
    }
}

fn pieces_of(tet: u32, first: &BTreeMap<u32, usize>, pieces: &[Piece]) -> Option<std::ops::Range<usize>> {
    let from = *first.get(&tet)?;
    let count = pieces[from..].iter().take_while(|piece| piece.tet == tet).count();
    Some(from..from + count)
}

/// Gives the pieces of a tetrahedron that lie in one of `earlier` its shares, each node's in their own ratio.
fn share_out(pieces: &mut [Piece], earlier: &[Piece]) {
    for whole in earlier {
        let mut within: Vec<&mut Piece> = pieces.iter_mut().filter(|piece| piece.is_in(whole)).collect();
        for k in 0..4 {
            let part = whole.shares[k] / within.iter().map(|piece| piece.shares[k]).sum::<f64>();
            within.iter_mut().for_each(|piece| piece.shares[k] *= part);
        }
    }
}

/// [`Piece::shares`] of a tetrahedron within another one, from its corners in barycentric coordinates.
fn share_of(corners: &[Vector4<f64>; 4]) -> Vector4<f64> {
    let volume = Matrix4::from_columns(corners).determinant().abs();
    corners.iter().sum::<Vector4<f64>>() * (0.25 * volume)
}
