//! The nodes of a cut mesh against those of a base, which is the same mesh before its last cuts.
//!
//! In: a split and the earlier one of the base. Out: for each copy the node of the base with which it moves, and whether it moves beyond it. Of
//! all that a node of the base has become, one moves as it does: the node itself, or the copy with the lowest number.

use super::matter::Matter;
use crate::mesh::split::{LoosePart, Piece, Split};
use std::collections::BTreeMap;

pub struct Descent {
    /// Node of the base of each copy; `None` of one that had fallen off it.
    pub base: Vec<Option<u32>>,
    /// Number of each copy among those that move beyond their nodes of the base.
    pub beyond: Vec<Option<usize>>,
    /// Numbers of these copies in the split, each with the node or copy that moves as its node of the base does.
    pub copies: Vec<(u32, u32)>,
    /// Nodes of the base with which each piece moves; `None` of one that had fallen off it.
    pub pieces: Vec<Option<[u32; 4]>>,
    /// Whether each loose part had fallen off it.
    pub is_gone: Vec<bool>,
}

impl Descent {
    pub fn new(of: &Matter, split: &Split, base: &Split) -> Descent {
        let count = of.nodes();
        let is_gone: Vec<bool> = split.loose.iter().map(|part| is_gone(part, split, base)).collect();
        let mut pieces: Vec<Option<[u32; 4]>> =
            split.pieces.iter().map(|piece| Some(nodes_at(of, base, piece))).collect();
        for (part, _) in split.loose.iter().zip(&is_gone).filter(|(_, is_gone)| **is_gone) {
            part.pieces.iter().for_each(|piece| pieces[*piece] = None);
        }
        let mut of_copies = vec![None; split.copies.len()];
        let own = split.pieces.iter().zip(&pieces).filter_map(|(piece, nodes)| Some((piece, (*nodes)?)));
        for (copy, node) in own.flat_map(|(piece, nodes)| piece.nodes.into_iter().zip(nodes)) {
            if let Some(copy) = (copy as usize).checked_sub(count) {
                of_copies[copy] = Some(node);
            }
        }
        let has = |part: &LoosePart, node: u32| part.nodes.binary_search(&node).is_ok();
        let is_there = |node: &u32| {
            let mut gone = split.loose.iter().zip(&is_gone).filter(|(_, is_gone)| **is_gone);
            (*node as usize) < count && !gone.any(|(part, _)| has(part, *node))
        };
        let mut leading: BTreeMap<u32, u32> = BTreeMap::new();
        let (mut beyond, mut copies) = (Vec::new(), Vec::new());
        for (copy, node) in (count as u32..).zip(&of_copies) {
            let leads = node.map(|node| {
                *leading.entry(node).or_insert_with(|| if is_there(&node) { node } else { copy })
            });
            let leads = leads.filter(|leads| *leads != copy);
            beyond.push(leads.map(|_| copies.len()));
            copies.extend(leads.map(|leads| (copy, leads)));
        }
        Descent { base: of_copies, beyond, copies, pieces, is_gone }
    }
}

/// The nodes of a split with which a piece of a later one moves.
fn nodes_at(of: &Matter, base: &Split, piece: &Piece) -> [u32; 4] {
    base.nodes_at(piece.corner(), of.splitter.mesh.tets[piece.tet as usize])
}

fn is_gone(part: &LoosePart, split: &Split, base: &Split) -> bool {
    part.corners(split).first().is_some_and(|corner| base.is_loose_at(*corner))
}
