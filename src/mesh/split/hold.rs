//! The parts of a mesh in pieces that nothing holds.
//!
//! In: the pieces, and the nodes that control elements hold. Out: the parts that hang together by faces and have neither three held nodes
//! nor three nodes in common with a part that is held; a part on a single node or on an edge could turn about it freely. They get nodes
//! of their own wherever they would hang on others.

use super::pieces::{LoosePart, Piece, Split, Splitter};
use crate::base::disjoint::DisjointSets;
use std::collections::{BTreeMap, BTreeSet};

/// Number of nodes that hold a part.
const HOLDING: usize = 3;

impl Splitter {
    /// Finds the parts that nothing holds, and parts them from all others.
    pub(super) fn release(&self, split: &mut Split, held: &[Option<usize>]) {
        let loose = self.not_held(split, held);
        if loose.is_empty() {
            return;
        }
        let mut part_of = vec![0; self.mesh.tets.len() + split.pieces.len()];
        for (part, members) in (1..).zip(&loose) {
            members.iter().for_each(|member| part_of[*member] = part);
        }
        let pieces = self.parted(split, &part_of, held);
        split.first.clear();
        for (number, (_, piece)) in pieces.iter().enumerate() {
            split.first.entry(piece.tet).or_insert(number);
        }
        for (part, members) in (1..).zip(loose) {
            let tets = members.into_iter().filter(|of| *of < self.mesh.tets.len()).map(|of| of as u32);
            let tets: Vec<u32> = tets.filter(|tet| !split.first.contains_key(tet)).collect();
            let own = pieces.iter().enumerate().filter(|(_, (of, _))| *of == part);
            let numbers: Vec<usize> = own.map(|(number, _)| number).collect();
            let of_tets = tets.iter().flat_map(|tet| self.mesh.tets[*tet as usize]);
            let of_pieces = numbers.iter().flat_map(|number| pieces[*number].1.nodes);
            let nodes: BTreeSet<u32> = of_tets.chain(of_pieces).collect();
            let nodes = nodes.into_iter().collect();
            split.loose.push(LoosePart { tets, pieces: numbers, nodes });
        }
        split.pieces = pieces.into_iter().map(|(_, piece)| piece).collect();
    }

    /// The pieces in their order, each with its part, after each loose part got copies of nodes that another one has; a whole tetrahedron
    /// with such a node becomes a piece. Part 0 is all that is held.
    fn parted(&self, split: &mut Split, part_of: &[usize], held: &[Option<usize>]) -> Vec<(usize, Piece)> {
        let whole = self.mesh.tets.len();
        let count = self.mesh.nodes.len() + split.copies.len();
        let mut owners: Vec<Option<usize>> =
            (0..count).map(|node| held.get(node).copied().flatten().map(|_| 0)).collect();
        let mut copied: BTreeMap<(usize, u32), u32> = BTreeMap::new();
        let mut pieces = Vec::new();
        let mut members: Vec<usize> = (0..part_of.len()).collect();
        members.sort_by_key(|member| part_of[*member]);
        for member in members {
            let part = part_of[member];
            let mut own = match member.checked_sub(whole) {
                Some(piece) => split.pieces[piece].clone(),
                None if split.pieces_of(member as u32).is_some() => continue,
                None => Piece::whole(member as u32, self.mesh.tets[member]),
            };
            let before = own.nodes;
            own.nodes = before.map(|node| match *owners[node as usize].get_or_insert(part) == part {
                true => node,
                false => *copied.entry((part, node)).or_insert_with(|| {
                    split.copies.push(split.original(node, self.mesh.nodes.len()));
                    (self.mesh.nodes.len() + split.copies.len() - 1) as u32
                }),
            });
            if member >= whole || own.nodes != before {
                pieces.push((part, own));
            }
        }
        pieces.sort_by_key(|(_, piece)| piece.tet);
        pieces
    }

    /// The parts that are not held: their tetrahedra, and their pieces counted on from these.
    fn not_held(&self, split: &Split, held: &[Option<usize>]) -> Vec<Vec<usize>> {
        let whole = self.mesh.tets.len();
        let mut nodes = self.mesh.tets.clone();
        for piece in &split.pieces {
            nodes.push(piece.nodes);
        }
        let mut joined = self.joined_by_faces(split, &nodes);
        let is_there = |of: usize| of >= whole || split.pieces_of(of as u32).is_none();
        let mut parts: Vec<Vec<usize>> = vec![Vec::new(); nodes.len()];
        for of in (0..nodes.len()).filter(|of| is_there(*of)) {
            parts[joined.root(of as u32) as usize].push(of);
        }
        parts.retain(|part| !part.is_empty());
        let count = self.mesh.nodes.len() + split.copies.len();
        let mut holds: Vec<bool> =
            (0..count).map(|node| held.get(node).is_some_and(Option::is_some)).collect();
        // The part in which each node was counted last.
        let mut counted = vec![usize::MAX; count];
        for round in 0.. {
            let before = parts.len();
            let mut loose = Vec::new();
            for (number, part) in std::mem::take(&mut parts).into_iter().enumerate() {
                let mark = round * nodes.len() + number;
                let mut holding = 0;
                for node in part.iter().flat_map(|of| nodes[*of]) {
                    let is_new = std::mem::replace(&mut counted[node as usize], mark) != mark;
                    holding += usize::from(is_new && holds[node as usize]);
                }
                if holding < HOLDING {
                    loose.push(part);
                    continue;
                }
                part.iter().flat_map(|of| nodes[*of]).for_each(|node| holds[node as usize] = true);
            }
            if loose.is_empty() || loose.len() == before {
                return loose;
            }
            parts = loose;
        }
        Vec::new()
    }

    /// Tetrahedra, and after them pieces, joined where they have three nodes of a face in common.
    fn joined_by_faces(&self, split: &Split, nodes: &[[u32; 4]]) -> DisjointSets {
        let whole = self.mesh.tets.len();
        let mut joined = DisjointSets::new(nodes.len());
        for tet in 0..whole as u32 {
            let own = split.pieces_of(tet);
            for other in self.neighbours[tet as usize].iter().flatten().filter(|other| **other > tet) {
                let others = split.pieces_of(*other);
                if own.is_none() && others.is_none() {
                    joined.join(tet, *other);
                    continue;
                }
                let of = |tet: u32, pieces: &Option<std::ops::Range<usize>>| match pieces {
                    None => tet as usize..tet as usize + 1,
                    Some(pieces) => whole + pieces.start..whole + pieces.end,
                };
                for one in of(tet, &own) {
                    for other in of(*other, &others) {
                        let common = nodes[one].iter().filter(|node| nodes[other].contains(node)).count();
                        if common >= HOLDING {
                            joined.join(one as u32, other as u32);
                        }
                    }
                }
            }
        }
        joined
    }
}
