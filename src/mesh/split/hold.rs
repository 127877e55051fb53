//! Whether all parts of a mesh in pieces are held.
//!
//! In: the pieces, and the nodes that control elements hold. Out: whether each part that hangs together by faces has three held nodes, or
//! three nodes in common with a part that is held. A part on a single node or on an edge could turn about it freely.

use super::pieces::{Split, Splitter};
use crate::base::disjoint::DisjointSets;

/// Number of nodes that hold a part.
const HOLDING: usize = 3;

impl Splitter {
    /// Whether some part is not held.
    pub(super) fn falls_apart(&self, split: &Split, held: &[Option<usize>]) -> bool {
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
                return !loose.is_empty();
            }
            parts = loose;
        }
        false
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
