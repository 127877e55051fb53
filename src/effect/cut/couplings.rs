//! The copies of a mesh in pieces, and how they hang together with a base.
//!
//! In: the pieces with their materials. Out: G, H and the forces of gravity on the copies that move beyond their nodes of the base.

use super::descent::Descent;
use super::matter::Matter;
use crate::fem::NodeFields;
use crate::fem::tet4::{geometry, stiffness_block};
use crate::mesh::split::Split;
use nalgebra::{DMatrix, Matrix3};
use std::collections::{BTreeMap, BTreeSet};

/// A row of G: blocks of the nodes of the base.
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
    pub fn new(of: &Matter, split: &Split, descent: &Descent) -> Couplings {
        let mesh = &of.splitter.mesh;
        let beyond = |node: u32| {
            let copy = (node as usize).checked_sub(mesh.nodes.len());
            copy.and_then(|copy| descent.beyond[copy])
        };
        let count = descent.copies.len();
        let mut rows = vec![Row::new(); count];
        let mut h: BTreeMap<(usize, usize), Matrix3<f64>> = BTreeMap::new();
        let node = |copy: &u32| split.copies[*copy as usize - mesh.nodes.len()];
        let mut keys: Vec<CopyKey> =
            descent.copies.iter().map(|(copy, _)| (node(copy), Vec::new())).collect();
        let mut masses = vec![0.0; count];
        let mut is_loose = vec![false; split.pieces.len()];
        split.loose.iter().flat_map(|part| &part.pieces).for_each(|piece| is_loose[*piece] = true);
        for ((piece, nodes), is_loose) in split.pieces.iter().zip(&descent.pieces).zip(is_loose) {
            let tet = piece.tet as usize;
            let (Some(nodes), Some(geometry)) = (nodes, geometry(mesh.corners(tet))) else { continue };
            let mass = if is_loose { 0.0 } else { of.mass(piece.tet) };
            for a in 0..4 {
                let Some(copy) = beyond(piece.nodes[a]) else { continue };
                keys[copy].1.push((piece.tet, piece.volume().to_bits()));
                masses[copy] += mass * piece.shares[a];
                for b in 0..4 {
                    let block = stiffness_block(&geometry, of.lame[tet], a, b) * piece.volume();
                    *rows[copy].entry(nodes[b]).or_insert_with(Matrix3::zeros) += block;
                    if let Some(other) = beyond(piece.nodes[b]) {
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

    /// g - G U: what acts on the copies while they move with their nodes. Gravity acts along the last three columns where they are more than
    /// these.
    pub fn acting(&self, whole: &NodeFields, affine: usize) -> DMatrix<f64> {
        let mut acting = DMatrix::zeros(3 * self.rows.len(), whole.columns);
        for (i, row) in self.rows.iter().enumerate() {
            for (node, block) in row {
                for axis in 0..3 {
                    for (k, u) in whole.row(3 * *node as usize + axis).iter().enumerate() {
                        (0..3).for_each(|r| acting[(3 * i + r, k)] -= block[(r, axis)] * u);
                    }
                }
            }
            let weights = (0..3).zip(affine..whole.columns);
            weights.for_each(|(axis, k)| acting[(3 * i + axis, k)] += self.masses[i]);
        }
        acting
    }
}

/// Rows of G at the free nodes.
#[derive(Clone, Default)]
pub struct FreeRows {
    /// The free nodes that have a block in them, ascending.
    pub at: Vec<u32>,
    /// The blocks of each row, with their places in `at`.
    rows: Vec<Vec<(usize, Matrix3<f64>)>>,
}

impl FreeRows {
    /// Keeps the blocks of rows at free nodes, with the place of each node of the base among the free ones.
    pub fn new<'a>(rows: impl Iterator<Item = &'a Row> + Clone, free_at: &[Option<u32>]) -> FreeRows {
        let free = |row: &'a Row| {
            row.iter().filter_map(|(node, block)| Some((free_at[*node as usize]?, *block))).collect()
        };
        let blocks: Vec<Vec<(u32, Matrix3<f64>)>> = rows.map(free).collect();
        let at: BTreeSet<u32> = blocks.iter().flatten().map(|(free, _)| *free).collect();
        let at: Vec<u32> = at.into_iter().collect();
        let place = |(free, block)| (at.partition_point(|other| *other < free), block);
        let rows = blocks.into_iter().map(|row| row.into_iter().map(place).collect()).collect();
        FreeRows { at, rows }
    }

    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// G x, with x at these nodes.
    pub fn times(&self, x: &NodeFields) -> DMatrix<f64> {
        let mut product = DMatrix::zeros(3 * self.rows.len(), x.columns);
        for (i, row) in self.rows.iter().enumerate() {
            for (place, block) in row {
                for axis in 0..3 {
                    for (k, x) in x.row(3 * place + axis).iter().enumerate() {
                        (0..3).for_each(|r| product[(3 * i + r, k)] += block[(r, axis)] * x);
                    }
                }
            }
        }
        product
    }

    /// -Gᵀ v at these nodes, with as many columns as asked.
    pub fn minus_transposed(&self, v: &DMatrix<f64>, columns: usize) -> NodeFields {
        let mut product = NodeFields::zeros(self.at.len(), columns);
        for (i, row) in self.rows.iter().enumerate() {
            for (place, block) in row {
                for axis in 0..3 {
                    let sums = product.row_mut(3 * place + axis);
                    for (k, sum) in sums.iter_mut().enumerate().take(v.ncols()) {
                        *sum -= (0..3).map(|r| block[(r, axis)] * v[(3 * i + r, k)]).sum::<f64>();
                    }
                }
            }
        }
        product
    }
}
