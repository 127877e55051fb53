//! A mesh that is cut across its edges: which pieces each tetrahedron falls into, and which nodes move apart.
//!
//! In: a mesh, and the edges that are cut, each at a point of it. Out: the pieces of its tetrahedra with their share of the volume, the
//! copies of nodes that they need, and the cut surface.
//!
//! A tetrahedron is divided where its four nodes, joined by the edges that are not cut, fall apart: a corner with three cut edges, or two
//! pairs with four. Each piece moves with four nodes, the tetrahedron's own on its side and copies of those beyond the cut. Pieces of
//! neighbours share their nodes where they meet on the common face, so that there are no copies at the end of a cut, and it closes there (P. Hansbo and A. Hansbo, Computer Methods in Applied Mechanics and Engineering 193, 2004, 3523-3540; N. Molino, Z. Bao and
//! R. Fedkiw, ACM Transactions on Graphics 23, 2004, 385-392). No tetrahedron is made smaller, so that none becomes a sliver.

use super::surface::sorted_faces;
use super::tet_mesh::{FACES, TetMesh};
use crate::base::disjoint::DisjointSets;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Edges that are cut: both nodes, the smaller first, and where, as a part of the way from the first to the second.
pub type CutEdges = BTreeMap<[u32; 2], f64>;

/// Faces and neighbours of a mesh that is to be cut.
pub struct Splitter {
    pub mesh: Arc<TetMesh>,
    /// The neighbour of each tetrahedron across each face; `None` at the outer surface.
    neighbours: Vec<[Option<u32>; 4]>,
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
    /// Part of the tetrahedron's volume.
    pub volume: f64,
    /// The nodes with which it moves: those of the mesh, or copies, which are counted on from them.
    pub nodes: [u32; 4],
}

/// A point of a cut surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPoint {
    /// The nodes, or copies, between which it lies, and the part of the way from the first to the second.
    pub nodes: [u32; 2],
    pub share: f64,
}

/// A mesh after cuts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// The pieces of divided tetrahedra, in their order.
    pub pieces: Vec<Piece>,
    /// The node of which each copy is one.
    pub copies: Vec<u32>,
    /// Points of the new surface beside the nodes of the mesh, which keep their numbers.
    pub points: Vec<CutPoint>,
    /// Outer surface with the cuts: nodes of the mesh, then `points`; counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Whether some piece hangs together with no node that is held.
    pub falls_apart: bool,
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
    fn groups(&self, tet: u32, cut: &CutEdges) -> [usize; 4] {
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

    /// Whether a tetrahedron would fall into four pieces: its four corners, without what lies between them.
    pub fn shatters(&self, tet: u32, cut: &CutEdges) -> bool {
        self.groups(tet, cut) == [0, 1, 2, 3]
    }

    /// The mesh after these cuts. A piece with `held` nodes of its own goes
    /// with the held nodes beyond the cut, too: what holds them holds both sides.
    pub fn split(&self, cut: &CutEdges, held: &[bool]) -> Split {
        let (mut split, first) = self.divided(cut, held);
        self.surface(&mut split, &first, cut);
        split
    }

    /// Whether some piece would hang together with no held node after these cuts.
    pub fn would_fall_apart(&self, cut: &CutEdges, held: &[bool]) -> bool {
        self.divided(cut, held).0.falls_apart
    }

    /// The pieces after these cuts without their surface, and the number of the first piece of each divided tetrahedron.
    fn divided(&self, cut: &CutEdges, held: &[bool]) -> (Split, BTreeMap<u32, usize>) {
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
            let shares = self.volumes(tet, &group, cut);
            for lowest in (0..4).filter(|node| group[*node] == *node) {
                let own = group.map(|of| of == lowest);
                pieces.push(Piece { tet, own, volume: shares[lowest], nodes: self.mesh.tets[tet as usize] });
            }
        }
        let copies = self.copy_nodes(&mut pieces, &first, held);
        let mut split = Split { pieces, copies, ..Split::default() };
        split.falls_apart = self.falls_apart(&split, &first, held);
        (split, first)
    }

    /// Part of the volume of each group of a tetrahedron's nodes, at its lowest node.
    fn volumes(&self, tet: u32, group: &[usize; 4], cut: &CutEdges) -> [f64; 4] {
        let nodes = self.mesh.tets[tet as usize];
        let along = |a: usize, b: usize| share(cut, [nodes[a], nodes[b]]);
        let mut shares = [0.0; 4];
        if let Some([a, b, c, d]) = pairs(group) {
            let [ac, ad, bc, bd] = [along(a, c), along(a, d), along(b, c), along(b, d)];
            // The quadrilateral of the cut has its diagonal from ac to bd.
            shares[group[a]] = bc * bd + ac * ad * (1.0 - bd) + ac * bd * (1.0 - bc);
            shares[group[c]] = 1.0 - shares[group[a]];
            return shares;
        }
        let mut rest = 1.0;
        for a in (0..4).filter(|a| is_single(group, *a)) {
            shares[a] = (0..4).filter(|other| *other != a).map(|other| along(a, other)).product();
            rest -= shares[a];
        }
        if let Some(other) = (0..4).find(|node| !is_single(group, *node)) {
            shares[group[other]] = rest;
        }
        shares
    }

    /// Gives the pieces copies of the nodes beyond their cuts; the node of each copy.
    fn copy_nodes(&self, pieces: &mut [Piece], first: &BTreeMap<u32, usize>, held: &[bool]) -> Vec<u32> {
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
            // What has the node itself keeps it; so does what the same hand holds beyond the cut.
            for (i, (tet, piece)) in members.iter().enumerate() {
                let nodes = self.mesh.tets[*tet as usize];
                let own = |k: usize| piece.is_none_or(|piece| pieces[piece].own[k]);
                let is_held = |k: usize| own(k) && held[nodes[k] as usize];
                let has_it = (0..4).any(|k| nodes[k] == node && own(k));
                if has_it || (held[node as usize] && (0..4).any(is_held)) {
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

    /// Whether some piece hangs together with no held node.
    fn falls_apart(&self, split: &Split, first: &BTreeMap<u32, usize>, held: &[bool]) -> bool {
        let count = self.mesh.nodes.len() + split.copies.len();
        let mut joined = DisjointSets::new(count);
        let whole = (0..).zip(&self.mesh.tets).filter(|(tet, _)| !first.contains_key(tet));
        let all = whole.map(|(_, tet)| tet).chain(split.pieces.iter().map(|piece| &piece.nodes));
        let mut used = vec![false; count];
        for nodes in all {
            for node in nodes {
                used[*node as usize] = true;
                joined.join(nodes[0], *node);
            }
        }
        let mut is_held = vec![false; count];
        for node in (0..self.mesh.nodes.len()).filter(|node| held[*node]) {
            is_held[joined.root(node as u32) as usize] = true;
        }
        (0..count).any(|node| used[node] && !is_held[joined.root(node as u32) as usize])
    }

    /// Adds the outer surface and the cuts.
    fn surface(&self, split: &mut Split, first: &BTreeMap<u32, usize>, cut: &CutEdges) {
        let mut points =
            Points { known: BTreeMap::new(), all: Vec::new(), base: self.mesh.nodes.len() as u32 };
        let mut triangles = Vec::new();
        for (tet, nodes) in (0..).zip(&self.mesh.tets) {
            for (face, corners) in FACES.iter().enumerate() {
                if let Some(other) = self.neighbours[tet as usize][face] {
                    let own = self.middle(tet, *corners, (&split.pieces, first), cut, &mut points);
                    let of_other = own.and_then(|_| {
                        let place = |k: usize| {
                            self.mesh.tets[other as usize].iter().position(|n| *n == nodes[corners[k]])
                        };
                        let there = [place(0)?, place(1)?, place(2)?];
                        self.middle(other, there, (&split.pieces, first), cut, &mut points)
                    });
                    triangles.extend(own.filter(|own| of_other.is_some_and(|other| other != *own)));
                    continue;
                }
                match pieces_of(tet, first, &split.pieces) {
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
        (split.points, split.triangles) = (points.all, triangles);
    }

    /// The part of a face that belongs to a piece, a polygon.
    fn face_of(&self, piece: &Piece, face: [usize; 3], cut: &CutEdges, points: &mut Points) -> Vec<u32> {
        let nodes = self.mesh.tets[piece.tet as usize];
        let group = self.groups(piece.tet, cut);
        let mut polygon = Vec::new();
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let mut point = |points: &mut Points| {
                let share = share(cut, [nodes[a], nodes[b]]);
                polygon.push(points.at([piece.nodes[a], piece.nodes[b]], share));
            };
            match (piece.own[a], piece.own[b]) {
                (true, true) => polygon.push(piece.nodes[a]),
                (true, false) => {
                    polygon.push(piece.nodes[a]);
                    let share = share(cut, [nodes[a], nodes[b]]);
                    polygon.push(points.at([piece.nodes[a], piece.nodes[b]], share));
                }
                (false, true) => point(points),
                // Between two corners that are cut off what is left of the face reaches to the cut.
                (false, false) if group[a] != group[b] && self.is_rest(piece, &group) => point(points),
                (false, false) => {}
            }
        }
        if face.iter().any(|corner| piece.own[*corner]) { polygon } else { Vec::new() }
    }

    /// The triangle between the cuts of all three edges of a face, with the points of the piece to which it belongs; `None` where an edge is
    /// whole, or the tetrahedron.
    fn middle(
        &self,
        tet: u32,
        face: [usize; 3],
        (pieces, first): (&[Piece], &BTreeMap<u32, usize>),
        cut: &CutEdges,
        points: &mut Points,
    ) -> Option<[u32; 3]> {
        let own = pieces_of(tet, first, pieces)?;
        let nodes = self.mesh.tets[tet as usize];
        let sides = [[0, 1], [1, 2], [2, 0]].map(|side| side.map(|k| face[k]));
        if sides.iter().any(|[a, b]| !cut.contains_key(&edge([nodes[*a], nodes[*b]]))) {
            return None;
        }
        // It belongs to what is left when the corners are cut off.
        let group = self.groups(tet, cut);
        let rest = (0..3).find(|k| {
            !is_single(&group, face[*k]) || (0..3).any(|o| o != *k && group[face[o]] == group[face[*k]])
        });
        let piece = pieces[own].iter().find(|piece| piece.own[face[rest.unwrap_or(0)]])?;
        Some(
            sides.map(|[a, b]| points.at([piece.nodes[a], piece.nodes[b]], share(cut, [nodes[a], nodes[b]]))),
        )
    }

    /// Whether a piece is what two cut-off corners leave of a tetrahedron.
    fn is_rest(&self, piece: &Piece, group: &[usize; 4]) -> bool {
        let groups = (0..4).filter(|node| group[*node] == *node).count();
        groups == 3 && piece.own.iter().filter(|own| **own).count() == 2
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
        for alone in (0..4).filter(|node| is_single(&group, *node)) {
            let others: Vec<usize> = (0..4).filter(|node| *node != alone).collect();
            let [a, b, c, d] = seen_from_outside([alone, others[0], others[1], others[2]]);
            let own = piece.own[a];
            if own || piece.own.iter().filter(|own| **own).count() > 1 {
                let side = [at(a, b), at(a, c), at(a, d)];
                triangles.push(if own { side } else { turned(side) });
            }
        }
    }

    /// Place of a node or copy at rest.
    pub fn place(&self, split: &Split, node: u32) -> Vector3<f64> {
        let count = self.mesh.nodes.len();
        let own = (node as usize).checked_sub(count).map_or(node, |copy| split.copies[copy]);
        self.mesh.nodes[own as usize]
    }
}

/// Points of the cut surface as they are found.
struct Points {
    known: BTreeMap<[u32; 2], u32>,
    all: Vec<CutPoint>,
    base: u32,
}

impl Points {
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

/// Whether no other node of a tetrahedron is in the group of this one.
fn is_single(group: &[usize; 4], node: usize) -> bool {
    (0..4).all(|other| other == node || group[other] != group[node])
}

/// The two pairs of a tetrahedron, that with the lowest node first, where it falls into two.
fn pairs(group: &[usize; 4]) -> Option<[usize; 4]> {
    let of_first: Vec<usize> = (0..4).filter(|node| group[*node] == group[0]).collect();
    let others: Vec<usize> = (0..4).filter(|node| group[*node] != group[0]).collect();
    let ([a, b], [c, d]) = (of_first.as_slice(), others.as_slice()) else { return None };
    (group[*c] == group[*d]).then(|| seen_from_outside([*a, *b, *c, *d]))
}

/// The corners of a tetrahedron in this order, or with the last two swapped, so that the last three are seen counter-clockwise from
/// outside.
fn seen_from_outside(order: [usize; 4]) -> [usize; 4] {
    let swaps = PAIRS.iter().filter(|(i, j)| order[*i] > order[*j]).count();
    let [a, b, c, d] = order;
    if swaps % 2 == 0 { order } else { [a, b, d, c] }
}

const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

/// An edge as it stands in [`CutEdges`].
pub fn edge([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Place of the cut of an edge, as a part of the way from its first node; a half where it is not.
fn share(cut: &CutEdges, [a, b]: [u32; 2]) -> f64 {
    let share = cut.get(&edge([a, b])).copied().unwrap_or(0.5);
    if a < b { share } else { 1.0 - share }
}

fn pieces_of(tet: u32, first: &BTreeMap<u32, usize>, pieces: &[Piece]) -> Option<std::ops::Range<usize>> {
    let from = *first.get(&tet)?;
    let count = pieces[from..].iter().take_while(|piece| piece.tet == tet).count();
    Some(from..from + count)
}

fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + use<'_> {
    (2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]])
}

fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    [a, c, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;
    use crate::mesh::{Block, block};

    type V3 = Vector3<f64>;

    fn a_block() -> Arc<TetMesh> {
        Arc::new(block(&Block { size: [0.3, 0.2, 0.1], cells: [6, 4, 3] }).unwrap())
    }

    /// The edges that a plane n·x = d cuts where `is_in` holds for the point.
    fn by_plane(mesh: &TetMesh, n: Vector3<f64>, d: f64, is_in: &dyn Fn(Vector3<f64>) -> bool) -> CutEdges {
        let mut cut = CutEdges::new();
        for tet in &mesh.tets {
            for (i, j) in PAIRS {
                let [a, b] = edge([tet[i], tet[j]]);
                let [x, y] = [a, b].map(|node| mesh.nodes[node as usize]);
                let (from, to) = (n.dot(&x) - d, n.dot(&y) - d);
                let share = from / (from - to);
                if from * to < 0.0 && is_in(x + (y - x) * share) {
                    cut.insert([a, b], share);
                }
            }
        }
        cut
    }

    fn volume_of(mesh: &TetMesh) -> f64 {
        (0..mesh.tets.len()).map(|tet| volume_of_tet(mesh, tet)).sum()
    }

    fn volume_of_tet(mesh: &TetMesh, tet: usize) -> f64 {
        let [a, b, c, d] = mesh.corners(tet);
        (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
    }

    /// Volume within the triangles, and by how much the sum of their normals misses 0.
    fn enclosed(splitter: &Splitter, split: &Split) -> (f64, f64) {
        let at = |node: u32| match (node as usize).checked_sub(splitter.mesh.nodes.len()) {
            None => splitter.mesh.nodes[node as usize],
            Some(point) => {
                let CutPoint { nodes, share } = split.points[point];
                let [x, y] = nodes.map(|node| splitter.place(split, node));
                x + (y - x) * share
            }
        };
        let (mut volume, mut normals) = (0.0, Vector3::zeros());
        for triangle in &split.triangles {
            let [a, b, c] = triangle.map(at);
            volume += a.cross(&b).dot(&c) / 6.0;
            normals += (b - a).cross(&(c - a));
        }
        (volume, normals.norm())
    }

    fn holding(mesh: &TetMesh, is_held: &dyn Fn(Vector3<f64>) -> bool) -> Vec<bool> {
        mesh.nodes.iter().map(|x| is_held(*x)).collect()
    }

    /// A plane through the whole block: both sides have the volumes that it cuts off, the surface is closed, and the side that nothing
    /// holds falls off.
    #[test]
    fn a_plane_divides_a_block() {
        let mesh = a_block();
        let splitter = Splitter::new(mesh.clone());
        let (low, high) = crate::mesh::quality::bounding_box(&mesh.nodes);
        let n = Vector3::new(1.0, 0.2, -0.3);
        let d = n.dot(&((low + high) * 0.5)) + 0.011;
        let cut = by_plane(&mesh, n, d, &|_| true);
        let held = holding(&mesh, &|x| x.x < low.x + 1e-9);
        let split = splitter.split(&cut, &held);
        assert!(split.falls_apart && !split.copies.is_empty());
        let both = holding(&mesh, &|x| x.x < low.x + 1e-9 || x.x > high.x - 1e-9);
        assert!(!splitter.split(&cut, &both).falls_apart);
        let beyond = |node: u32| n.dot(&mesh.nodes[node as usize]) > d;
        let mut far = 0.0;
        for (tet, nodes) in mesh.tets.iter().enumerate() {
            let own: Vec<_> = split.pieces.iter().filter(|piece| piece.tet as usize == tet).collect();
            let sum: f64 = own.iter().map(|piece| piece.volume).sum();
            assert!(own.is_empty() || (sum - 1.0).abs() < 1e-14, "{sum}");
            let part = match own.is_empty() {
                true => f64::from(u8::from(beyond(nodes[0]))),
                false => own
                    .iter()
                    .filter(|piece| (0..4).any(|k| piece.own[k] && beyond(nodes[k])))
                    .map(|piece| piece.volume)
                    .sum(),
            };
            far += part * volume_of_tet(&mesh, tet);
        }
        // The plane leaves the block through its four long sides: its volume beyond is that at the middle of the section.
        let size = high - low;
        let expected = size.y * size.z * (size.x * 0.5 - 0.011);
        assert!((far / expected - 1.0).abs() < 1e-12, "{far} of {expected}");
        let (volume, open) = enclosed(&splitter, &split);
        assert!((volume / volume_of(&mesh) - 1.0).abs() < 1e-12, "{volume}");
        assert!(open < 1e-15, "{open:e}");
        let mut edges = BTreeMap::new();
        for [a, b, c] in &split.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                *edges.entry([*from, *to]).or_insert(0) += 1;
            }
        }
        assert!(edges.iter().all(|([a, b], count)| *count == 1 && edges.contains_key(&[*b, *a])));
    }

    /// Slits, crossing cuts and edges cut at random: no volume is lost, and what meets keeps its nodes in common.
    #[test]
    fn any_cut_keeps_the_volume() {
        let mesh = a_block();
        let splitter = Splitter::new(mesh.clone());
        let whole = volume_of(&mesh);
        let held = vec![false; mesh.nodes.len()];
        let (low, high) = crate::mesh::quality::bounding_box(&mesh.nodes);
        let middle = (low + high) * 0.5;
        let mut cuts: Vec<CutEdges> = Vec::new();
        let slit =
            |n: Vector3<f64>, deep: f64| by_plane(&mesh, n, n.dot(&middle) + 0.004, &|x| x.y > high.y - deep);
        cuts.push(slit(Vector3::x(), 0.11));
        cuts.push(slit(Vector3::new(0.8, 0.1, 0.5), 0.07));
        let mut crossing = slit(Vector3::new(1.0, 0.0, 0.2), 0.3);
        crossing.extend(slit(Vector3::new(0.1, 0.0, 1.0), 0.3));
        cuts.push(crossing);
        let mut random = Random::default();
        for part in [0.2, 0.5, 0.8] {
            let mut cut = CutEdges::new();
            for tet in &mesh.tets {
                for (i, j) in PAIRS {
                    if random.draw() + 0.5 < part {
                        cut.insert(edge([tet[i], tet[j]]), 0.5 + 0.9 * random.draw());
                    }
                }
            }
            cuts.push(cut);
        }
        for mut cut in cuts {
            for (tet, nodes) in (0..).zip(&mesh.tets) {
                if splitter.shatters(tet, &cut) {
                    cut.remove(&edge([nodes[0], nodes[1]]));
                }
            }
            let split = splitter.split(&cut, &held);
            let (volume, open) = enclosed(&splitter, &split);
            assert!((volume / whole - 1.0).abs() < 1e-12 && open < 1e-14, "{volume} of {whole}, {open:e}");
            assert!(split.pieces.iter().all(|piece| piece.volume > 0.0));
            for piece in &split.pieces {
                let of = |node: u32| (node as usize).checked_sub(mesh.nodes.len());
                for (k, node) in piece.nodes.iter().enumerate() {
                    let own = mesh.tets[piece.tet as usize][k];
                    assert_eq!(of(*node).map_or(*node, |copy| split.copies[copy]), own);
                    assert!(!piece.own[k] || *node == own);
                }
            }
        }
    }

    /// Cuts that cross within the block, where some faces have three cut edges: the surface is closed, edge by edge, also where pieces
    /// move apart.
    #[test]
    fn crossing_cuts_leave_no_holes() {
        let mesh = a_block();
        let splitter = Splitter::new(mesh.clone());
        let (low, high) = crate::mesh::quality::bounding_box(&mesh.nodes);
        let middle = (low + high) * 0.5;
        let held = holding(&mesh, &|x| x.x < low.x + 1e-9);
        let mut cut = CutEdges::new();
        for (n, d) in [
            (V3::new(1.0, 0.1, 0.3), 0.004),
            (V3::new(0.2, 1.0, 0.1), 0.003),
            (V3::new(0.1, 0.2, 1.0), 0.002),
        ] {
            for (edge, share) in by_plane(&mesh, n, n.dot(&middle) + d, &|_| true) {
                if cut.contains_key(&edge) {
                    continue;
                }
                cut.insert(edge, share);
                if splitter.tets_around(edge[0]).iter().any(|tet| splitter.shatters(*tet, &cut)) {
                    cut.remove(&edge);
                }
            }
        }
        let split = splitter.split(&cut, &held);
        // An edge that only one neighbour has cut: its point stays on the line between both ends.
        let on = |[a, b]: [u32; 2]| {
            let at = split.points.iter().position(|point| point.nodes == edge([a, b]));
            at.map(|at| (mesh.nodes.len() + at) as u32)
        };
        let mut edges = std::collections::BTreeSet::new();
        for [a, b, c] in &split.triangles {
            for [from, to] in [[*a, *b], [*b, *c], [*c, *a]] {
                let way = match on([from, to]) {
                    Some(point) => vec![[from, point], [point, to]],
                    None => vec![[from, to]],
                };
                edges.extend(way);
            }
        }
        let single = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).count();
        println!("{} edges, {single} without the other side", edges.len());
        assert!(single == 0, "{single} of {}", edges.len());
    }

    /// A slit that ends inside: copies at its mouth, none at its end.
    #[test]
    fn a_slit_closes_at_its_end() {
        let mesh = a_block();
        let splitter = Splitter::new(mesh.clone());
        let (low, high) = crate::mesh::quality::bounding_box(&mesh.nodes);
        let n = Vector3::new(1.0, 0.0, 0.0);
        let deep = by_plane(&mesh, n, 0.5 * (low.x + high.x) + 0.004, &|x| x.y > high.y - 0.11);
        let held = holding(&mesh, &|x| x.y < low.y + 1e-9);
        let split = splitter.split(&deep, &held);
        assert!(!split.falls_apart && split.copies.len() > 4);
        // A row of cells below the slit's end keeps its nodes.
        let lowest = split.copies.iter().map(|node| mesh.nodes[*node as usize].y).fold(f64::MAX, f64::min);
        assert!(lowest > high.y - 0.11 - 1e-9, "{lowest}");
        let all_held = vec![true; mesh.nodes.len()];
        assert!(splitter.split(&deep, &all_held).copies.is_empty());
        // A cut beside what is held leaves nothing of the other side there.
        let beside = by_plane(&mesh, n, low.x + 0.02, &|_| true);
        let at_end = holding(&mesh, &|x| x.x < low.x + 1e-9);
        assert!(splitter.split(&beside, &at_end).falls_apart);
    }
}
