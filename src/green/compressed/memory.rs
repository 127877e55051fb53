//! Memory of the compression, estimated before each of its two steps: the bases, and the blocks.
//!
//! In: a surface, and its bases where they are known. Out: bytes beside what is there already.

use super::basis::{Bases, HEAP};
use super::exact::MEASURED;
use super::samples;
use super::tree::{Block, Surface, TOGETHER, Tree};

/// Bytes of the columns to compare with, of the samples, and of the leaves' rows of these at most. Each thread has the rows of a
/// leaf twice in f64. The clusters above are counted by [`super::basis::bases`] level by level, when the ranks below are known.
pub fn of_bases(of: &Surface<'_>) -> f64 {
    let Surface { factor, tree, .. } = *of;
    let size = 3.0 * of.nodes.len() as f64;
    let count = samples::count(tree) as f64;
    let exact = 24.0 * size * MEASURED.min(of.n) as f64;
    // Forces, displacements, and a block of them in the factor.
    let solves = factor.solve_memory(TOGETHER, of.nodes.len()) + 8.0 * size * TOGETHER as f64;
    let widest = tree.leaves().map(|leaf| tree.size(leaf)).max().unwrap_or(0) as f64;
    let work = rayon::current_num_threads() as f64 * 2.0 * 8.0 * widest * count;
    // Which clusters are far from which leaves.
    let far = (tree.clusters.len() as f64).powi(2);
    let bases: f64 = tree.leaves().map(|leaf| 3.0 * 8.0 * (tree.size(leaf) as f64).powi(2)).sum();
    HEAP * (exact + far + 4.0 * size * count + solves.max(4.0 * size * count + work + bases))
}

/// Bytes of the blocks, and the larger of two more: the strips of the inverse with every cluster's coefficients of one; or the
/// bases and the bytes as they are rounded.
pub fn of_blocks(of: &Surface<'_>, bases: &Bases) -> f64 {
    let Surface { factor, tree, blocks, .. } = *of;
    let numbers = |is_far: bool| -> f64 {
        let sides = |block: &Block| block.of.map(|cluster| bases.width(tree, cluster, is_far) as f64);
        blocks
            .iter()
            .filter(|block| block.is_far == is_far)
            .map(|block| sides(block).iter().product::<f64>())
            .sum()
    };
    let (near, far) = (numbers(false), numbers(true));
    let width = 3.0 * factor.strip_nodes().max(TOGETHER / 3) as f64;
    let seen: usize = bases.ranks.iter().sum();
    let strips = factor.strip_memory(of.nodes.len()) + 8.0 * width * (3 * of.nodes.len() + seen) as f64;
    let strips = strips + bytes(tree, bases);
    // Twice their bytes, of 12 bits a number.
    let rounded = 2.0 * bytes(tree, bases) + 3.0 * (near + far);
    HEAP * (4.0 * near + 8.0 * far + strips.max(rounded))
}

/// Bytes of the bases.
fn bytes(tree: &Tree, bases: &Bases) -> f64 {
    (0..tree.clusters.len())
        .map(|cluster| 8.0 * (bases.of[cluster].nrows() * bases.of[cluster].ncols()) as f64)
        .sum()
}
