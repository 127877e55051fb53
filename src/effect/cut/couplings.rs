//! The copies of a mesh in pieces, and how they hang together with the body.
//!
//! In: the pieces with their materials. Out: G, H and the forces of gravity on the copies.

use crate::fem::Lame;
use crate::fem::tet4::{geometry, stiffness_block};
use crate::mesh::split::{Split, Splitter};
use nalgebra::{DMatrix, Matrix3};
use std::collections::BTreeMap;

/// A row of G: blocks of the nodes of the mesh.
pub type Row = BTreeMap<u32, Matrix3<f64>>;

/// A copy's node, and the pieces that move with it: their tetrahedra, and the bits of their shares.
pub type CopyKey = (u32, Vec<(u32, u64)>);

pub struct Couplings {
    /// G, a row for each copy.
    pub rows: Vec<Row>,
    /// Blocks of H.
    pub h: BTreeMap<(usize, usize), Matrix3<f64>>,
    /// Dependence of X of each copy.
    pub keys: Vec<CopyKey>,
    /// Mass that moves with each copy: ∫ N ρ dV over its pieces, kg; 0 of those that nothing holds.
    pub masses: Vec<f64>,
}

impl Couplings {
    /// The couplings of a split; `density` is empty where nothing is heavy.
    pub fn new(splitter: &Splitter, split: &Split, lame: &[Lame], density: &[f64]) -> Couplings {
        let mesh = &splitter.mesh;
        let copy_of = |node: u32| (node as usize).checked_sub(mesh.nodes.len());
        let mut rows = vec![Row::new(); split.copies.len()];
        let mut h: BTreeMap<(usize, usize), Matrix3<f64>> = BTreeMap::new();
        let mut keys: Vec<CopyKey> = split.copies.iter().map(|node| (*node, Vec::new())).collect();
        let mut masses = vec![0.0; split.copies.len()];
        let mut is_loose = vec![false; split.pieces.len()];
        split.loose.iter().flat_map(|part| &part.pieces).for_each(|piece| is_loose[*piece] = true);
        for (piece, is_loose) in split.pieces.iter().zip(is_loose) {
            let tet = piece.tet as usize;
            let Some(geometry) = geometry(mesh.corners(tet)) else { continue };
            let density = density.get(tet).filter(|_| !is_loose);
            let mass = density.map_or(0.0, |density| density * geometry.volume.abs());
            for a in 0..4 {
                let Some(copy) = copy_of(piece.nodes[a]) else { continue };
                keys[copy].1.push((piece.tet, piece.volume().to_bits()));
                masses[copy] += mass * piece.shares[a];
                for b in 0..4 {
                    let block = stiffness_block(&geometry, lame[tet], a, b) * piece.volume();
                    *rows[copy].entry(mesh.tets[tet][b]).or_insert_with(Matrix3::zeros) += block;
                    if let Some(other) = copy_of(piece.nodes[b]) {
                        *h.entry((copy, other)).or_insert_with(Matrix3::zeros) += block;
                    }
                }
            }
        }
        Couplings { rows, h, keys, masses }
    }

    /// H - G X.
    pub fn system(&self, gx: &DMatrix<f64>) -> DMatrix<f64> {
        let mut system = -gx;
        for ((i, j), block) in &self.h {
            let mut own = system.fixed_view_mut::<3, 3>(3 * i, 3 * j);
            own += block;
        }
        system
    }
}
