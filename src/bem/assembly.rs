//! The dense matrices of a closed surface, filled on all threads.
//!
//! In: a [`Mesh`] of the surface, where each node stands in the matrices. Out: columns of V with those of (½ + K)ᵀ below them, and
//! the lower half of D. What each thread does depends on sizes alone, and sums have a fixed order, so that the bits do not depend on
//! the number of threads.

use super::operators::Material;
use super::pairs;
use super::triangle::Triangle;
use crate::base::progress::Progress;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Triangles whose rows are made together.
const STRIP: usize = 64;
/// Rows of a strip, about: half as many nodes as triangles, and those of its border.
pub const ROWS: f64 = 200.0;

/// A closed surface of one material.
pub struct Mesh {
    pub triangles: Vec<Triangle>,
    /// The places of their corners in the matrices.
    pub places: Vec<[u32; 3]>,
    /// How many places there are.
    pub nodes: usize,
    pub material: Material,
}

impl Mesh {
    /// For the triangles `held`: the lower half of V, and below it (½ + K)ᵀ over all places. Column after column.
    pub fn tractions(&self, held: &[u32], progress: &dyn Progress) -> Vec<f64> {
        let (own, rows) = (3 * held.len(), 3 * (held.len() + self.nodes));
        let mut all = vec![0.0; rows * own];
        progress.begin("tractions", held.len() as u64);
        all.par_chunks_mut(3 * rows).enumerate().for_each(|(at, columns)| {
            let i = &self.triangles[held[at] as usize];
            let mut put = |row: usize, block: &Matrix3<f64>| {
                for (a, b) in (0..9).map(|k| (k / 3, k % 3)) {
                    columns[a * rows + row + b] += block[(a, b)];
                }
            };
            for (other, &j) in held.iter().enumerate().skip(at) {
                put(3 * other, &self.material.single_layer(&pairs::pull(i, &self.triangles[j as usize])));
            }
            for (j, corners) in self.triangles.iter().zip(&self.places) {
                let blocks = self.material.double_layer(i, j, &pairs::pull(i, j));
                for (block, &place) in blocks.iter().zip(corners) {
                    put(own + 3 * place as usize, block);
                }
            }
            for place in self.places[held[at] as usize] {
                put(own + 3 * place as usize, &Matrix3::from_diagonal_element(i.area / 6.0));
            }
            progress.advance(1);
        });
        progress.end();
        all
    }

    /// Adds D to the lower half of a matrix over all places, column after column.
    pub fn add_hypersingular(&self, matrix: &mut [f64], progress: &dyn Progress) {
        let strips: Vec<usize> = (0..self.triangles.len()).step_by(STRIP).collect();
        progress.begin("boundary elements", self.triangles.len() as u64);
        for some in strips.chunks(2 * rayon::current_num_threads()) {
            let made: Vec<Strip> = some.par_iter().with_max_len(1).map(|&first| self.strip(first)).collect();
            let size = 9 * self.nodes;
            matrix
                .par_chunks_mut(size)
                .enumerate()
                .for_each(|(place, columns)| made.iter().for_each(|strip| strip.add_to(columns, place)));
            progress.advance((STRIP * some.len()) as u64);
        }
        progress.end();
    }

    fn strip(&self, first: usize) -> Strip {
        let own = first..(first + STRIP).min(self.triangles.len());
        let mut places: Vec<u32> = self.places[own.clone()].iter().flatten().copied().collect();
        places.sort_unstable();
        places.dedup();
        let rows = 3 * places.len();
        let mut sums = vec![0.0; rows * 3 * self.nodes];
        for t in own {
            let i = &self.triangles[t];
            let local = self.places[t].map(|place| places.partition_point(|other| *other < place));
            for u in t..self.triangles.len() {
                let j = &self.triangles[u];
                // Of a pair both orders are meant; of a triangle with itself, half of them.
                let weight = if u == t { 0.5 } else { 1.0 };
                let blocks = self.material.hypersingular(i, j, &pairs::pull(i, j));
                for (&row, blocks) in local.iter().zip(&blocks) {
                    for (&column, block) in self.places[u].iter().zip(blocks) {
                        for b in 0..3 {
                            let at = (3 * column as usize + b) * rows + 3 * row;
                            for a in 0..3 {
                                sums[at + a] += weight * block[(a, b)];
                            }
                        }
                    }
                }
            }
        }
        Strip { places, sums }
    }
}

/// What the triangles of a strip add to a matrix and to its transpose: rows of their own places, columns of all.
struct Strip {
    /// Ascending.
    places: Vec<u32>,
    sums: Vec<f64>,
}

impl Strip {
    /// Adds what belongs into the three columns of a place.
    fn add_to(&self, columns: &mut [f64], place: usize) {
        let (rows, height) = (3 * self.places.len(), columns.len() / 3);
        let value = |row: usize, column: usize| self.sums[column * rows + row];
        for (local, &other) in self.places.iter().enumerate() {
            let other = other as usize;
            for (a, b) in (0..9).map(|k| (k / 3, k % 3)).filter(|_| other >= place) {
                columns[b * height + 3 * other + a] += value(3 * local + a, 3 * place + b);
            }
        }
        if let Ok(local) = self.places.binary_search(&(place as u32)) {
            for other in place..height / 3 {
                for (a, b) in (0..9).map(|k| (k / 3, k % 3)) {
                    columns[a * height + 3 * other + b] += value(3 * local + a, 3 * other + b);
                }
            }
        }
    }
}
