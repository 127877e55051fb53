//! The dense matrices of a closed surface, filled on all threads.
//!
//! In: a [`Mesh`] of the surface, where each node stands in the matrices. Out: columns of V with those of (½ + K)ᵀ below them, and
//! the lower half of D. What each thread does depends on sizes alone, and sums have a fixed order, so that the bits do not depend on
//! the number of threads.

use super::operators::{CURLED, CurlSums, Material};
use super::strip::{LANES, Pulls, Strip};
use super::triangle::Triangle;
use crate::base::progress::Progress;
use rayon::prelude::*;

/// Approximate number of rows to which a strip adds: half as many nodes as triangles, and those of its border.
const ROWS: usize = 120;

/// Numbers that the threads need for each row of the matrix.
pub fn working() -> f64 {
    rayon::current_num_threads() as f64 * (2 * ROWS + CURLED / 3) as f64
}

/// A closed surface of one material.
pub struct Mesh {
    pub triangles: Vec<Triangle>,
    /// The places of their corners in the matrices.
    pub places: Vec<[u32; 3]>,
    /// The number of places.
    pub nodes: usize,
    pub material: Material,
}

impl Mesh {
    /// The matrix for the triangles `held`: the lower half of V, and below it (½ + K)ᵀ over all places. Column after column.
    pub fn tractions(&self, held: &[u32], progress: &dyn Progress) -> Vec<f64> {
        let rows = 3 * (held.len() + self.nodes);
        let mut all = vec![0.0; 3 * held.len() * rows];
        let mut row_of = vec![None; self.triangles.len()];
        (0..).zip(held).for_each(|(row, &t)| row_of[t as usize] = Some(row));
        progress.begin("tractions", held.len() as u64);
        all.par_chunks_mut(3 * LANES * rows).zip(held.par_chunks(LANES)).enumerate().for_each(
            |(at, (columns, own))| {
                self.put_tractions(own, LANES * at, &row_of, 3 * held.len(), columns);
                progress.advance(own.len() as u64);
            },
        );
        progress.end();
        all
    }

    /// The columns of the triangles `held`, the first of which is `first`; `below`: the row where K begins.
    fn put_tractions(
        &self,
        held: &[u32],
        first: usize,
        row_of: &[Option<usize>],
        below: usize,
        columns: &mut [f64],
    ) {
        let own: Vec<&Triangle> = held.iter().map(|&t| &self.triangles[t as usize]).collect();
        let strip = Strip::new(&own);
        let weights = std::array::from_fn(|k| if k < own.len() { 1.0 } else { 0.0 });
        let height = columns.len() / (3 * own.len());
        let mut put = |row: usize, lane: usize, value: &dyn Fn(usize, usize) -> f64| {
            for (a, b) in (0..9).map(|k| (k / 3, k % 3)) {
                columns[(3 * lane + a) * height + row + b] += value(a, b);
            }
        };
        let mut pulls = Pulls::default();
        let mut curled = vec![CurlSums::default(); self.nodes];
        for ((j, corners), row) in self.triangles.iter().zip(&self.places).zip(row_of) {
            strip.pulls(j, &weights, true, &mut pulls);
            for q in 0..3 {
                curled[corners[q] as usize].add(self.material, &pulls, q, j.curls[q].into());
            }
            if let Some(row) = row.filter(|row| *row >= first) {
                let blocks = self.material.single_layer(&pulls);
                for lane in 0..own.len().min(row - first + 1) {
                    put(3 * row, lane, &|a, b| blocks[a][b][lane]);
                }
            }
        }
        for (place, sums) in curled.iter().enumerate() {
            let blocks = self.material.double_layer(sums);
            for lane in 0..own.len() {
                put(below + 3 * place, lane, &|a, b| blocks[a][b][lane]);
            }
        }
        for (lane, (&t, i)) in held.iter().zip(&own).enumerate() {
            for place in self.places[t as usize] {
                let half = |a: usize, b: usize| if a == b { i.area / 6.0 } else { 0.0 };
                put(below + 3 * place as usize, lane, &half);
            }
        }
    }

    /// Adds D to the lower half of a matrix over all places, column after column.
    pub fn add_hypersingular(&self, matrix: &mut [f64], progress: &dyn Progress) {
        let strips: Vec<usize> = (0..self.triangles.len()).step_by(LANES).collect();
        progress.begin("boundary elements", self.triangles.len() as u64);
        for some in strips.chunks(2 * rayon::current_num_threads()) {
            let made: Vec<Rows> = some.par_iter().with_max_len(1).map(|&first| self.rows(first)).collect();
            let size = 9 * self.nodes;
            matrix
                .par_chunks_mut(size)
                .enumerate()
                .for_each(|(place, columns)| made.iter().for_each(|rows| rows.add_to(columns, place)));
            progress.advance((LANES * some.len()) as u64);
        }
        progress.end();
    }

    /// The contributions of the triangles from `first` on, with those that are not before them.
    fn rows(&self, first: usize) -> Rows {
        let own = first..(first + LANES).min(self.triangles.len());
        let mut places: Vec<u32> = self.places[own.clone()].iter().flatten().copied().collect();
        places.sort_unstable();
        places.dedup();
        let local = |place: u32| places.partition_point(|other| *other < place);
        let corners: Vec<[usize; 3]> = self.places[own.clone()].iter().map(|t| t.map(local)).collect();
        let triangles: Vec<&Triangle> = self.triangles[own.clone()].iter().collect();
        let strip = Strip::new(&triangles);

        let mut curled: Vec<Option<Box<CurlSums>>> = vec![None; self.nodes];
        let mut pulls = Pulls::default();
        for u in first..self.triangles.len() {
            let j = &self.triangles[u];
            // Of a pair both orders are meant; of a triangle with itself, half of them.
            let weight = |t: usize| {
                if t < u {
                    1.0
                } else if t == u {
                    0.5
                } else {
                    0.0
                }
            };
            let weights = std::array::from_fn(|k| if k < own.len() { weight(first + k) } else { 0.0 });
            strip.pulls(j, &weights, false, &mut pulls);
            for (q, &place) in self.places[u].iter().enumerate() {
                let sums = curled[place as usize].get_or_insert_default();
                sums.add(self.material, &pulls, q, j.curls[q].into());
            }
        }

        let rows = 3 * places.len();
        let mut sums = vec![0.0; rows * 3 * self.nodes];
        for (place, curled) in curled.iter().enumerate() {
            let Some(curled) = curled else { continue };
            let columns = &mut sums[3 * place * rows..][..3 * rows];
            for p in 0..3 {
                let blocks = self.material.hypersingular(&strip.curls[p], curled);
                for (lane, local) in corners.iter().enumerate() {
                    for (a, b) in (0..9).map(|k| (k / 3, k % 3)) {
                        columns[b * rows + 3 * local[p] + a] += blocks[a][b][lane];
                    }
                }
            }
        }
        Rows { places, sums }
    }
}

/// The contributions of a strip's triangles to a matrix and to its transpose: rows of their own places, columns of all.
struct Rows {
    /// Ascending.
    places: Vec<u32>,
    sums: Vec<f64>,
}

impl Rows {
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
