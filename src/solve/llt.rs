//! A = P L Lᵀ Pᵀ in f64 or f32: the factor of an [`Analysis`], and its solves.
//!
//! Solves run in blocks of columns, one thread each.

use super::analysis::Analysis;
use super::dense::Real;
use super::error::SolveError;
use super::kept_factor::KeptFactor;
use super::multifrontal::{self, Failure, zeros};
use super::pcg;
use super::solver::InverseStrip;
use super::substitution::{Triangle, block_width, scratch};
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

/// Nodes whose columns of an inverse are solved together, and the bytes that these columns should not exceed.
const STRIP_NODES: std::ops::RangeInclusive<usize> = 8..=64;
const STRIP_BYTES: usize = 64 << 20;

/// Bytes below which the system is not asked what it leaves: its answer takes as long as a small body's factor.
const UNASKED: f64 = 1e6;

/// Whether a system has been solved in this process: the threads then own their buffers already.
static BUFFERED: AtomicBool = AtomicBool::new(false);

impl Analysis {
    /// Errors where they take more memory than is left.
    pub(super) fn fits<T: Real>(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        let memory = self.memory::<T>(a, columns);
        if memory < UNASKED && BUFFERED.load(Relaxed) {
            return Ok(());
        }
        let entries = self.fronts.entries();
        let what = format!("a factor of {entries} numbers, with the solves for {columns} columns");
        // Every thread maps the buffers of its matrix products once: two of the size of the largest cache.
        let threads = if BUFFERED.load(Relaxed) { 0 } else { rayon::current_num_threads() + 1 };
        let buffers = (2 * threads) as f64 * machine::largest_cache();
        let fits = |need: f64| machine::fits(&what, need, buffers);
        let Err(refused) = fits(memory) else { return Ok(()) };
        let mut fitting = Vec::new();
        let half = self.memory::<f32>(a, columns);
        if size_of::<T>() > size_of::<f32>() && fits(half).is_ok() {
            fitting.push(format!("solver = {{ method = \"mixed\" }}, which takes {}", machine::size(half)));
        }
        let iterative = pcg::memory(a, columns);
        if machine::fits("", iterative, 0.0).is_ok() {
            fitting
                .push(format!("solver = {{ method = \"pcg\" }}, which takes {}", machine::size(iterative)));
        }
        // The numbers of a factor grow with the nodes to the power of 4/3.
        let nodes = a.nodes() as f64 * refused.share.min(1.0).powf(0.75);
        fitting.push(format!("a mesh of about {:.0} thousand nodes", (0.9e-3 * nodes).floor().max(1.0)));
        fitting.push("more memory for the program (control group, ulimit)".to_owned());
        Err(SolveError::Unfit { refused, fitting: fitting.join("; ") })
    }
}

/// Scratch in which a thread solves one strip of an inverse after the other.
struct Room<T> {
    block: Vec<T>,
    scratch: Vec<T>,
    values: Vec<f64>,
}

/// The numbers of L.
pub(super) struct Llt<'a, T> {
    analysis: &'a Analysis,
    values: Vec<T>,
    pub(super) factor_s: f64,
}

impl<'a, T: Real> Llt<'a, T> {
    /// Errors where A is not positive definite or the factor does not fit into memory.
    pub(super) fn new(
        a: &StiffnessMatrix,
        analysis: &'a Analysis,
        progress: &dyn Progress,
    ) -> Result<Llt<'a, T>, SolveError> {
        analysis.fits::<T>(a, 1)?;
        progress.begin("factorization", 0);
        let started = Instant::now();
        let fronts = &analysis.fronts;
        let values = zeros(fronts.entries())
            .and_then(|mut values| multifrontal::factorize(fronts, a, &mut values).map(|()| values))
            .map_err(|failure| match failure {
                Failure::NotPositive { position } => SolveError::NotPositiveDefinite {
                    unknowns: 3 * a.nodes(),
                    pivot: 3 * fronts.forward[position] as usize,
                },
                Failure::NoMemory => {
                    let what = format!("a factor of {} numbers", fronts.entries());
                    SolveError::FactorMemory(machine::refused(what, analysis.memory::<T>(a, 1)))
                }
            });
        progress.end();
        Ok(Llt { analysis, values: values?, factor_s: started.elapsed().as_secs_f64() })
    }

    /// Numbers in the factor, with the explicit zeros of its supernodes.
    pub(super) fn entries(&self) -> usize {
        self.values.len()
    }

    /// A⁻¹ b as exact as the factor, each thread its own block of columns.
    pub(super) fn substitute(
        &self,
        b: &NodeFields,
        progress: &dyn Progress,
    ) -> Result<NodeFields, SolveError> {
        let nodes: Vec<u32> = (0..b.nodes as u32).collect();
        let x = self.between(&nodes, b, &nodes, progress);
        BUFFERED.store(true, Relaxed);
        x
    }

    /// The nodes `asked` of A⁻¹ b, with b given at the nodes `loaded`.
    pub(super) fn between(
        &self,
        loaded: &[u32],
        b: &NodeFields,
        asked: &[u32],
        progress: &dyn Progress,
    ) -> Result<NodeFields, SolveError> {
        self.triangle().between(loaded, b, asked, progress)
    }

    fn triangle(&self) -> Triangle<'_, T> {
        let Analysis { fronts, branches, .. } = self.analysis;
        Triangle { supernodes: fronts, values: &self.values, branches }
    }

    /// The part of the factor that solves between these nodes.
    pub(super) fn kept(&self, nodes: &[u32]) -> Result<KeptFactor, SolveError> {
        KeptFactor::from_triangle(&self.triangle(), nodes)
    }

    /// See [`super::Factor::solve_memory`]: all columns at all nodes, and at those asked.
    pub(super) fn solve_memory(&self, columns: usize, asked: usize) -> f64 {
        let fronts = &self.analysis.fronts;
        let width = block_width(columns).min(columns);
        let scratch =
            columns.div_ceil(width.max(1)).min(rayon::current_num_threads()) * scratch(fronts, width);
        (size_of::<T>() * (3 * fronts.nodes() * columns + scratch) + 24 * asked * columns) as f64
    }

    /// Nodes whose columns of an inverse are solved together.
    pub(super) fn strip_nodes(&self) -> usize {
        let width = STRIP_BYTES / (9 * size_of::<T>() * self.analysis.fronts.nodes().max(1));
        width.clamp(*STRIP_NODES.start(), *STRIP_NODES.end())
    }

    /// See [`super::Factor::strip_memory`]: a block for each thread, and a strip.
    pub(super) fn strip_memory(&self, nodes: usize) -> f64 {
        let (fronts, columns) = (&self.analysis.fronts, 3 * self.strip_nodes().min(nodes));
        let block = size_of::<T>() * (3 * fronts.nodes() * columns + scratch(fronts, columns));
        (rayon::current_num_threads() * (block + 24 * nodes * columns)) as f64
    }

    /// See [`super::Factor::inverse_block_from`]. Columns in the order of elimination need, of the symmetric matrix, only rows
    /// that are eliminated later: the solves stop there.
    pub(super) fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        let fronts = &self.analysis.fronts;
        let triangle = self.triangle();
        let position = |place: u32| fronts.inverse[nodes[place as usize] as usize] as usize;
        let mut places: Vec<u32> = (0..nodes.len() as u32).collect();
        places.sort_unstable_by_key(|&place| position(place));
        let all = fronts.with_ancestors(nodes);
        let width = self.strip_nodes();
        let strip = |first: usize, Room { block, scratch, values }: &mut Room<T>| {
            let (rows, columns) = (&places[first..], &places[first..places.len().min(first + width)]);
            let count = 3 * columns.len();
            // Nothing that is eliminated before the supernode of the first column is read.
            let x = &mut block[..3 * fronts.nodes() * count];
            let lowest = fronts.of_node(position(columns[0]));
            x[3 * fronts.own(lowest).start * count..].fill(T::from_f64(0.0));
            for (i, &place) in columns.iter().enumerate() {
                for axis in 0..3 {
                    x[(3 * position(place) + axis) * count + 3 * i + axis] = T::from_f64(1.0);
                }
            }
            let own: Vec<u32> = columns.iter().map(|&place| nodes[place as usize]).collect();
            let down = all.iter().rev().copied().take_while(|&s| s >= lowest);
            triangle.forward(x, count, scratch, fronts.with_ancestors(&own).into_iter());
            triangle.backward(x, count, scratch, down);
            values.resize(3 * rows.len() * count, 0.0);
            for (i, &place) in rows.iter().enumerate() {
                let node = &x[3 * position(place) * count..][..3 * count];
                for (axis, row) in node.chunks_exact(count).enumerate() {
                    for (column, value) in row.iter().enumerate() {
                        values[column * 3 * rows.len() + 3 * i + axis] = value.to_f64();
                    }
                }
            }
            (rows, columns)
        };
        progress.begin("inverse at chosen nodes", nodes.len() as u64);
        let firsts: Vec<usize> = (0..nodes.len()).step_by(width).skip(first).collect();
        let count = rayon::current_num_threads().min(firsts.len());
        let rooms = (0..count).map(|_| {
            let (block, scratch) = triangle.block(3 * width.min(nodes.len()))?;
            Ok(Room { block, scratch, values: Vec::new() })
        });
        let mut rooms = rooms.collect::<Result<Vec<Room<T>>, SolveError>>()?;
        for group in firsts.chunks(count.max(1)) {
            let each = group.par_iter().zip(&mut rooms).with_max_len(1);
            let strips: Vec<_> = each.map(|(&first, room)| strip(first, room)).collect();
            for ((rows, columns), room) in strips.into_iter().zip(&rooms) {
                take(&InverseStrip { rows, columns, values: &room.values });
                progress.advance(columns.len() as u64);
            }
        }
        progress.end();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
