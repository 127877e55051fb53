//! The matrix that a level is smoothed with, f32: the rows, the inverses of the clusters' blocks, and what one thread works on.

use super::cluster::{self, Clusters};
use super::rows::{Block, Rows};
use rayon::prelude::*;
use std::ops::Range;

/// The matrix that a level is smoothed with, f32, both triangles, the diagonal with the rest.
pub struct Smoothed<const B: usize> {
    /// Blocks of node i: `start[i]..start[i + 1]`.
    pub start: Vec<usize>,
    pub column: Vec<u32>,
    /// B² numbers a block, column by column.
    pub value: Vec<f32>,
    /// Nodes of cluster c: `clusters[c]..clusters[c + 1]`.
    pub clusters: Vec<u32>,
    /// Inverses of the clusters' blocks, column by column, one after the other.
    pub inverse: Vec<f32>,
    /// Parts that are worked on together.
    pub parts: Vec<Part>,
}

/// Whole clusters, of about [`PART`] nodes, and where their inverses begin.
pub struct Part {
    pub clusters: Range<usize>,
    pub nodes: Range<usize>,
    pub inverse: usize,
}

fn parts_of<const B: usize>(clusters: &Clusters) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let mut inverse = 0;
    for cluster in 0..clusters.count() {
        let nodes = clusters.members(cluster);
        match parts.last_mut() {
            Some(part) if nodes.end - part.nodes.start <= PART => {
                part.clusters.end = cluster + 1;
                part.nodes.end = nodes.end;
            }
            _ => parts.push(Part { clusters: cluster..cluster + 1, nodes: nodes.clone(), inverse }),
        }
        inverse += (B * nodes.len()).pow(2);
    }
    parts
}

impl<const B: usize> Smoothed<B> {
    /// The smoother of `rows`; errors with a node of a cluster whose block is not positive definite.
    pub fn new(rows: &impl Rows<B>, clusters: &Clusters) -> Result<Smoothed<B>, usize> {
        let nodes = rows.nodes();
        let mut start = vec![0; nodes + 1];
        start[1..].par_iter_mut().enumerate().with_min_len(512).for_each(|(node, count)| {
            *count = 1;
            rows.each(node, |_, _| *count += 1);
        });
        for node in 0..nodes {
            start[node + 1] += start[node];
        }
        let blocks = start[nodes];
        let (mut column, mut value) = (vec![0; blocks], vec![0.0; B * B * blocks]);
        let mut parts = Vec::with_capacity(nodes.div_ceil(PART));
        let (mut columns, mut values) = (column.as_mut_slice(), value.as_mut_slice());
        for first in (0..nodes).step_by(PART) {
            let count = start[(first + PART).min(nodes)] - start[first];
            let (own, rest) = columns.split_at_mut(count);
            let (own_values, rest_values) = values.split_at_mut(B * B * count);
            (columns, values) = (rest, rest_values);
            parts.push((first, own, own_values));
        }
        parts.into_par_iter().for_each(|(first, columns, values)| {
            let mut slots = columns.iter_mut().zip(values.chunks_exact_mut(B * B));
            let mut put = |other: usize, block: &Block<B>| {
                if let Some((column, value)) = slots.next() {
                    *column = other as u32;
                    for c in 0..B {
                        for r in 0..B {
                            value[c * B + r] = block[r][c] as f32;
                        }
                    }
                }
            };
            for node in first..(first + PART).min(nodes) {
                put(node, &rows.diagonal(node));
                rows.each(node, &mut put);
            }
        });
        let inverse: Vec<f32> = (0..clusters.count())
            .into_par_iter()
            .with_min_len(512)
            .map(|cluster| {
                let members = clusters.members(cluster);
                let first = members.start;
                let inverse = cluster::inverse(rows, members).ok_or(first)?;
                Ok(inverse.iter().map(|value| *value as f32).collect::<Vec<_>>())
            })
            .collect::<Result<Vec<_>, usize>>()?
            .concat();
        Ok(Smoothed {
            start,
            column,
            value,
            clusters: clusters.start.clone(),
            inverse,
            parts: parts_of::<B>(clusters),
        })
    }

    pub fn nodes(&self) -> usize {
        self.start.len() - 1
    }

    /// Numbers that one pass reads.
    pub fn numbers(&self) -> usize {
        self.value.len()
    }
}

/// Nodes that one thread works on at a time.
pub const PART: usize = 256;
