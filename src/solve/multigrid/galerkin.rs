//! Computes the coarse matrix Pᵀ A P, row by row, so that no more than a row is kept besides it.

use super::prolong::{MODES, Modes, Prolongator};
use super::rows::{Block, CoarseRows, Rows};
use rayon::prelude::*;

const NONE: u32 = u32::MAX;

/// Blocks of one row under construction, found by their columns.
struct RowBlocks<T> {
    /// The slot of each column, or [`NONE`].
    slot: Vec<u32>,
    blocks: Vec<(u32, T)>,
}

impl<T> RowBlocks<T> {
    fn new(columns: usize) -> RowBlocks<T> {
        RowBlocks { slot: vec![NONE; columns], blocks: Vec::new() }
    }

    #[inline(always)]
    fn at(&mut self, column: u32, zero: T) -> &mut T {
        let slot = &mut self.slot[column as usize];
        if *slot == NONE {
            *slot = self.blocks.len() as u32;
            self.blocks.push((column, zero));
        }
        &mut self.blocks[*slot as usize].1
    }

    fn clear(&mut self) {
        for (column, _) in self.blocks.drain(..) {
            self.slot[column as usize] = NONE;
        }
    }
}

/// Pᵀ A P; a motion that an aggregate does not have gets 1 on the diagonal.
pub fn coarse<const B: usize>(rows: &impl Rows<B>, prolongator: &Prolongator<B>) -> CoarseRows {
    let count = prolongator.down_start.len() - 1;
    let made: Vec<(Block<MODES>, Vec<u32>, Vec<Block<MODES>>)> = (0..count)
        .into_par_iter()
        .with_min_len(count / (8 * rayon::current_num_threads()) + 1)
        .map_init(
            || (RowBlocks::new(rows.nodes()), RowBlocks::new(count)),
            |(left, row), aggregate| {
                coarse_row(rows, prolongator, aggregate, left, row);
                row.blocks.sort_unstable_by_key(|(column, _)| *column);
                let mut diagonal = [[0.0; MODES]; MODES];
                let (mut columns, mut blocks) = (Vec::new(), Vec::new());
                for (column, block) in &row.blocks {
                    if *column as usize == aggregate {
                        diagonal = *block;
                    } else {
                        columns.push(*column);
                        blocks.push(*block);
                    }
                }
                row.clear();
                for axis in 0..MODES {
                    if diagonal[axis][axis] <= 0.0 {
                        diagonal[axis][axis] = 1.0;
                    }
                }
                (diagonal, columns, blocks)
            },
        )
        .collect();
    let blocks = made.iter().map(|(_, columns, _)| columns.len()).sum();
    let mut coarse = CoarseRows {
        diagonal: Vec::with_capacity(count),
        start: vec![0],
        column: Vec::with_capacity(blocks),
        block: Vec::with_capacity(blocks),
    };
    for (diagonal, columns, blocks) in made {
        coarse.diagonal.push(diagonal);
        coarse.column.extend(columns);
        coarse.block.extend(blocks);
        coarse.start.push(coarse.column.len());
    }
    coarse
}

/// Row `aggregate` of (Pᵀ A) P.
fn coarse_row<const B: usize>(
    rows: &impl Rows<B>,
    prolongator: &Prolongator<B>,
    aggregate: usize,
    left: &mut RowBlocks<[[f64; B]; MODES]>,
    row: &mut RowBlocks<Block<MODES>>,
) {
    let (start, end) = (prolongator.down_start[aggregate], prolongator.down_start[aggregate + 1]);
    for &(node, at) in &prolongator.down[start..end] {
        let p: Modes<B> = prolongator.block(at as usize);
        let mut add = |other: usize, block: &Block<B>| {
            let sum = left.at(other as u32, [[0.0; B]; MODES]);
            for m in 0..MODES {
                for k in 0..B {
                    for c in 0..B {
                        sum[m][c] += p[k][m] * block[k][c];
                    }
                }
            }
        };
        add(node as usize, &rows.diagonal(node as usize));
        rows.each(node as usize, add);
    }
    for (other, product) in &left.blocks {
        for at in prolongator.start[*other as usize]..prolongator.start[*other as usize + 1] {
            let p = prolongator.block(at);
            let sum = row.at(prolongator.column[at], [[0.0; MODES]; MODES]);
            for m in 0..MODES {
                for k in 0..B {
                    for c in 0..MODES {
                        sum[m][c] += product[m][k] * p[k][c];
                    }
                }
            }
        }
    }
    left.clear();
}
