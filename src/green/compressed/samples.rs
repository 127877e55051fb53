//! Displacements by random forces, from which the bases are made.
//!
//! In: a surface and its frames. Out: [`Samples`], in f32.

use super::basis::Samples;
use super::tree::{Frame, Surface, TOGETHER, Tree};
use crate::fem::NodeFields;
use crate::solve::{Progress, SolveError};
use rayon::prelude::*;

/// Samples of random forces, of all and for each leaf at most.
const SAMPLES: usize = 1536;
const SAMPLES_OF_LEAF: usize = 24;

/// Number of samples.
pub fn count(tree: &Tree) -> usize {
    (SAMPLES_OF_LEAF * tree.leaves().count()).min(SAMPLES)
}

/// A pseudo-random number of variance 1 about 0, the same on every machine (S. Vigna's splitmix64).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    let unit = ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53);
    12f64.sqrt() * (unit - 0.5)
}

/// `count` different numbers below `all`, chosen at random from `seed`, ascending; all where there are no more.
pub fn some(all: usize, count: usize, seed: u64) -> Vec<usize> {
    let mut state = seed;
    let mut numbers: Vec<(f64, usize)> = (0..all).map(|i| (random(&mut state), i)).collect();
    numbers.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen: Vec<usize> = numbers.into_iter().take(count).map(|(_, i)| i).collect();
    chosen.sort_unstable();
    chosen
}

/// Displacements of the whole surface by random forces. Every second sample has them on one leaf, for clusters that are far from
/// few leaves; the others on 2, 4, 8 and so on, which matter more, the more leaves are far.
pub fn samples(of: &Surface<'_>, frames: &[Frame], progress: &dyn Progress) -> Result<Samples, SolveError> {
    let tree = of.tree;
    let leaves: Vec<usize> = tree.leaves().collect();
    let count = count(tree);
    let classes = (leaves.len() / 8).checked_ilog2().unwrap_or(0) as usize;
    let on = |sample: usize| -> Vec<usize> {
        if sample.is_multiple_of(2) || classes == 0 {
            return vec![leaves[sample * leaves.len() / count]];
        }
        let how_many = 2 << (sample / 2 % classes);
        some(leaves.len(), how_many, sample as u64).into_iter().map(|i| leaves[i]).collect()
    };
    let size = 3 * of.nodes.len();
    let mut samples = Samples { leaves: (0..count).map(on).collect(), values: vec![0.0; size * count] };
    let mut state = 1;
    progress.begin("samples of the surface", count as u64);
    for (chunk, out) in samples.leaves.chunks(TOGETHER).zip(samples.values.chunks_mut(TOGETHER * size)) {
        let mut loaded: Vec<usize> = chunk.concat();
        loaded.sort_unstable();
        loaded.dedup();
        let places: Vec<usize> = loaded.iter().flat_map(|&leaf| tree.clusters[leaf].nodes.clone()).collect();
        let mut forces = NodeFields::zeros(places.len(), chunk.len());
        for (column, on) in chunk.iter().enumerate() {
            for (i, &place) in places.iter().enumerate() {
                let leaf = tree.leaf_of[place];
                if on.contains(&leaf) {
                    let force = nalgebra::Vector3::from_fn(|_, _| random(&mut state));
                    let force = frames[leaf].inverse * force;
                    (0..3).for_each(|axis| forces.row_mut(3 * i + axis)[column] = force[axis]);
                }
            }
        }
        let nodes: Vec<u32> = places.iter().map(|&place| of.nodes[place]).collect();
        let x = of.factor.solve_at(&nodes, &forces, of.nodes)?;
        out.par_chunks_mut(size).enumerate().for_each(|(column, out)| {
            for (place, out) in out.chunks_exact_mut(3).enumerate() {
                let moved = nalgebra::Vector3::from_fn(|axis, _| x.row(3 * place + axis)[column]);
                let moved = frames[tree.leaf_of[place]].inverse * moved;
                out.iter_mut().zip(&moved).for_each(|(out, moved)| *out = *moved as f32);
            }
        });
        progress.advance(chunk.len() as u64);
    }
    progress.end();
    Ok(samples)
}
