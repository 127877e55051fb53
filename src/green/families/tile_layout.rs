//! Layout of the compliance of a surface in tiles: the upper half of a symmetric matrix, stored once.
//!
//! In: the number of nodes, m, and of those that take forces, n. Out: the place of each number, tile after tile as
//! [`super::compliance`] draws them, and the hash of every tile.

use super::super::bytes::Tensor;
use rayon::prelude::*;
use safetensors::tensor::Dtype;
use std::ops::Range;

/// Bytes of the blake3 hash of a tile.
pub(super) const HASH: usize = blake3::OUT_LEN;
/// Nodes of a block of rows, and of a tile's side.
pub(super) const BLOCK: usize = 32;

/// Layout of the numbers of m nodes, of which the first n take forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TileLayout {
    pub n: usize,
    pub m: usize,
}

impl TileLayout {
    /// Place of the first number of block `block`.
    fn start(&self, block: usize) -> usize {
        // Each of the blocks before it has 32 rows.
        let before = BLOCK * block;
        9 * (before * self.m - BLOCK * BLOCK * (block * block.saturating_sub(1)) / 2)
    }

    pub fn len(&self) -> usize {
        let blocks = self.n / BLOCK;
        let rest = self.n % BLOCK;
        self.start(blocks) + 9 * rest * (self.m - BLOCK * blocks)
    }

    /// Bytes of the numbers.
    pub fn bytes(&self) -> usize {
        4 * self.len()
    }

    /// Place of the numbers of node `j` in row 3·`i` + `axis` of node `i` < n; `j` is of its block or behind it.
    pub fn at(&self, i: usize, axis: usize, j: usize) -> usize {
        let tile = self.tile(i / BLOCK, j / BLOCK);
        let [_, columns] = self.sides(i / BLOCK, j / BLOCK);
        tile.start + (3 * (i % BLOCK) + axis) * columns + 3 * (j % BLOCK)
    }

    /// Rows and columns of numbers of a tile.
    pub fn sides(&self, block: usize, other: usize) -> [usize; 2] {
        [(block, self.n), (other, self.m)].map(|(at, all)| 3 * BLOCK.min(all - BLOCK * at))
    }

    /// The numbers of a tile, `other` ≥ `block`.
    pub fn tile(&self, block: usize, other: usize) -> Range<usize> {
        let [rows, columns] = self.sides(block, other);
        let start = self.start(block) + rows * 3 * BLOCK * (other - block);
        start..start + rows * columns
    }

    /// Number of a tile among all.
    pub fn number(&self, block: usize, other: usize) -> usize {
        let across = self.m.div_ceil(BLOCK);
        block * across - block * block.saturating_sub(1) / 2 + other - block
    }

    /// All tiles in their order.
    pub fn tiles(self) -> impl Iterator<Item = [usize; 2]> {
        let across = self.m.div_ceil(BLOCK);
        (0..self.n.div_ceil(BLOCK)).flat_map(move |block| (block..across).map(move |other| [block, other]))
    }

    /// The tensor of the hashes of all tiles of these values.
    pub fn hashes(self, values: &[u8]) -> Tensor {
        let hash = |[block, other]: [usize; 2]| {
            let tile = self.tile(block, other);
            *blake3::hash(&values[4 * tile.start..4 * tile.end]).as_bytes()
        };
        let tiles: Vec<_> = self.tiles().collect();
        let bytes: Vec<[u8; HASH]> = tiles.par_iter().map(|tile| hash(*tile)).collect();
        Tensor { dtype: Dtype::U8, shape: vec![tiles.len(), HASH], bytes: bytes.concat() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pair of which one takes forces has one place or, within a diagonal block, two.
    #[test]
    fn blocks_hold_each_pair_and_leave_no_gap() {
        for (n, m) in [(1, 1), (32, 32), (33, 33), (70, 70), (5, 100), (64, 65), (70, 101)] {
            let layout = TileLayout { n, m };
            let mut seen = vec![0; layout.len()];
            for i in 0..n {
                for j in i / BLOCK * BLOCK..m {
                    for axis in 0..3 {
                        (0..3).for_each(|other| seen[layout.at(i, axis, j) + other] += 1);
                    }
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{n} {m}");
            let mut end = 0;
            for (number, [block, other]) in layout.tiles().enumerate() {
                let tile = layout.tile(block, other);
                assert_eq!((layout.number(block, other), tile.start), (number, end), "{n} {m}");
                end = tile.end;
            }
            assert_eq!(end, layout.len());
        }
        let paper = TileLayout { n: 5000, m: 5000 };
        assert!((4.50e8..4.56e8).contains(&(paper.bytes() as f64)), "450 MB");
    }
}
