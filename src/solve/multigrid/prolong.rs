//! The prolongator, which turns a motion of the aggregates into that of their nodes, and the matrix with which a level is
//! smoothed ([`Smoothed`], f32: the rows, the inverses of the clusters' blocks, and the parts that one thread works on).
//!
//! ```text
//! tentative    [N_i S(o_i - c)]_(i in aggregate) = Q R      P₀ = Q,  coarse N = R about the centre c
//! smoothed     P = (I - ω D⁻¹ A) P₀                         ω = 4/3 / λ_max(D⁻¹ A),  D: the blocks of A on the clusters
//! ```
//!
//! N_i are a node's six rigid motions about its own place o_i, and S(d) takes a motion (t, ω) about c to that about c + d: t + ω
//! × d. Rigid motions of the whole body are therefore motions of the aggregates, exactly, and have no energy on the coarse level
//! either. A motion that is not distinct from the others at the aggregate's nodes (the turn of a straight row of nodes about
//! itself) is left out: its column of Q is zero.

use super::cluster;
use super::cluster::{ALONE, Aggregates, Clusters, MOST};
use super::rows::{Block, Rows};
use rayon::prelude::*;
use std::ops::Range;

/// Rigid motions.
pub const MODES: usize = 6;
/// A column of Q is left out where orthogonalisation leaves less than this part of its length.
const DEPENDENT: f64 = 1e-6;

/// A node's rows of the columns of the six rigid motions.
pub type Modes<const B: usize> = [[f64; MODES]; B];

/// Rigid motions of the nodes of one level, each about its own place.
pub struct RigidModes<const B: usize> {
    pub place: Vec<[f64; 3]>,
    pub modes: Vec<Modes<B>>,
}

/// P, stored by rows, with an index by columns.
pub struct Prolongator<const B: usize> {
    /// Blocks of fine node i: `start[i]..start[i + 1]`.
    pub start: Vec<usize>,
    pub column: Vec<u32>,
    /// 6 B numbers a block, column by column.
    pub value: Vec<f32>,
    /// Blocks of aggregate a: `down_start[a]..down_start[a + 1]`, ascending by the fine nodes.
    pub down_start: Vec<usize>,
    /// The fine node of each block, and the block's index in `column`.
    pub down: Vec<(u32, u32)>,
}

/// N S(d): the displacements of a node by the rigid motions about a centre from which it is `d` away.
fn shifted<const B: usize>(modes: &Modes<B>, d: [f64; 3]) -> Modes<B> {
    // t + ω × d: the columns of ω × d for the unit turns.
    let turned = [[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]];
    std::array::from_fn(|r| {
        let row = &modes[r];
        std::array::from_fn(|c| match c {
            0..3 => row[c],
            _ => row[c] + (0..3).map(|t| row[t] * turned[c - 3][t]).sum::<f64>(),
        })
    })
}

/// The rows of Q of every node, and R of every aggregate: the rigid motions of the coarse level.
fn tentative<const B: usize>(
    aggregates: &Aggregates,
    fine: &RigidModes<B>,
) -> (Vec<Modes<B>>, RigidModes<MODES>) {
    let (start, members) = aggregates.members();
    let made: Vec<([f64; 3], Modes<MODES>, Vec<Modes<B>>)> = (0..aggregates.count)
        .into_par_iter()
        .with_min_len(64)
        .map(|aggregate| orthonormal(&members[start[aggregate]..start[aggregate + 1]], fine))
        .collect();
    let mut q = vec![[[0.0; MODES]; B]; fine.place.len()];
    let mut coarse = RigidModes { place: Vec::new(), modes: Vec::new() };
    for (aggregate, (centre, r, own)) in made.into_iter().enumerate() {
        coarse.place.push(centre);
        coarse.modes.push(r);
        for (&node, own) in members[start[aggregate]..].iter().zip(own) {
            q[node as usize] = own;
        }
    }
    (q, coarse)
}

/// The centre, R and Q of one aggregate, by the Gram-Schmidt process, run twice.
fn orthonormal<const B: usize>(
    members: &[u32],
    fine: &RigidModes<B>,
) -> ([f64; 3], Modes<MODES>, Vec<Modes<B>>) {
    let places = || members.iter().map(|&node| fine.place[node as usize]);
    let centre: [f64; 3] =
        std::array::from_fn(|axis| places().map(|place| place[axis]).sum::<f64>() / members.len() as f64);
    let from_centre =
        |place: [f64; 3]| -> [f64; 3] { std::array::from_fn(|axis| place[axis] - centre[axis]) };
    let mut q: Vec<Modes<B>> = members
        .iter()
        .map(|&node| shifted(&fine.modes[node as usize], from_centre(fine.place[node as usize])))
        .collect();
    let dot =
        |q: &[Modes<B>], a: usize, b: usize| -> f64 { q.iter().flatten().map(|row| row[a] * row[b]).sum() };
    let mut r = [[0.0; MODES]; MODES];
    for c in 0..MODES {
        let before = dot(&q, c, c).sqrt();
        for _ in 0..2 {
            for k in 0..c {
                let along = dot(&q, k, c);
                r[k][c] += along;
                q.iter_mut().flatten().for_each(|row| row[c] -= along * row[k]);
            }
        }
        let length = dot(&q, c, c).sqrt();
        let is_new = length > DEPENDENT * before;
        r[c][c] = if is_new { length } else { 0.0 };
        q.iter_mut().flatten().for_each(|row| row[c] = if is_new { row[c] / length } else { 0.0 });
    }
    (centre, r, q)
}

impl<const B: usize> Prolongator<B> {
    /// The smoothed prolongator and the rigid motions of the coarse level; `largest`: λ_max(D⁻¹ A).
    pub fn new(
        rows: &impl Rows<B>,
        clusters: &Clusters,
        aggregates: &Aggregates,
        fine: &RigidModes<B>,
        largest: f64,
    ) -> (Prolongator<B>, RigidModes<MODES>) {
        let (q, coarse) = tentative(aggregates, fine);
        let nodes = rows.nodes();
        let damping = 4.0 / 3.0 / largest;
        let smoothing = Smoothing { rows, aggregates, q: &q, damping };
        let parts: Vec<_> = (0..clusters.count().div_ceil(PART))
            .into_par_iter()
            .map(|part| {
                let (mut counts, mut column, mut value) = (Vec::new(), Vec::new(), Vec::new());
                let mut row = Vec::new();
                for cluster in part * PART..((part + 1) * PART).min(clusters.count()) {
                    let members = clusters.members(cluster);
                    smoothing.rows_of(members.clone(), &mut row);
                    for own in 0..members.len() {
                        counts.push(row.len());
                        for (aggregate, blocks) in &row {
                            column.push(*aggregate);
                            value.extend((0..MODES * B).map(|at| blocks[own][at % B][at / B] as f32));
                        }
                    }
                }
                (counts, column, value)
            })
            .collect();
        let mut start = Vec::with_capacity(nodes + 1);
        start.push(0);
        let blocks = parts.iter().map(|(_, column, _)| column.len()).sum();
        let mut column: Vec<u32> = Vec::with_capacity(blocks);
        let mut value: Vec<f32> = Vec::with_capacity(MODES * B * blocks);
        let mut end = 0;
        for (counts, columns, values) in parts {
            for count in counts {
                end += count;
                start.push(end);
            }
            column.extend(columns);
            value.extend(values);
        }
        let (down_start, down) = by_columns(&start, &column, aggregates.count);
        (Prolongator { start, column, value, down_start, down }, coarse)
    }

    /// Block number `at`, B × 6.
    #[inline(always)]
    pub fn block(&self, at: usize) -> Modes<B> {
        let value = &self.value[MODES * B * at..][..MODES * B];
        std::array::from_fn(|r| std::array::from_fn(|c| f64::from(value[c * B + r])))
    }
}

/// The data from which P is made.
struct Smoothing<'a, R, const B: usize> {
    rows: &'a R,
    aggregates: &'a Aggregates,
    q: &'a [Modes<B>],
    damping: f64,
}

impl<R: Rows<B>, const B: usize> Smoothing<'_, R, B> {
    /// Fills `row` with the blocks of P in the rows of one cluster, ascending by their aggregates; leaves it empty where A
    /// is not positive definite.
    fn rows_of(&self, members: Range<usize>, row: &mut Vec<(u32, [Modes<B>; MOST])>) {
        row.clear();
        for node in members.clone() {
            let own = node - members.start;
            let mut add = |other: usize, block: &Block<B>| {
                let aggregate = self.aggregates.of_node[other];
                if aggregate == ALONE {
                    return;
                }
                let at = row.iter().position(|(known, _)| *known == aggregate).unwrap_or_else(|| {
                    row.push((aggregate, [[[0.0; MODES]; B]; MOST]));
                    row.len() - 1
                });
                let (sum, q) = (&mut row[at].1[own], &self.q[other]);
                for r in 0..B {
                    for k in 0..B {
                        for c in 0..MODES {
                            sum[r][c] += block[r][k] * q[k][c];
                        }
                    }
                }
            };
            add(node, &self.rows.diagonal(node));
            self.rows.each(node, &mut add);
        }
        let Some(inverse) = cluster::inverse(self.rows, members.clone()) else { return row.clear() };
        for (aggregate, sums) in row.iter_mut() {
            let product = *sums;
            for node in members.clone() {
                let own = node - members.start;
                let is_own = *aggregate == self.aggregates.of_node[node];
                for r in 0..B {
                    for c in 0..MODES {
                        let correction: f64 = (0..B * members.len())
                            .map(|k| inverse[(B * own + r, k)] * product[k / B][k % B][c])
                            .sum();
                        let own_q = if is_own { self.q[node][r][c] } else { 0.0 };
                        sums[own][r][c] = own_q - self.damping * correction;
                    }
                }
            }
        }
        row.sort_unstable_by_key(|(aggregate, _)| *aggregate);
    }
}

fn by_columns(start: &[usize], column: &[u32], count: usize) -> (Vec<usize>, Vec<(u32, u32)>) {
    let mut down_start = vec![0; count + 1];
    column.iter().for_each(|&aggregate| down_start[aggregate as usize + 1] += 1);
    for aggregate in 0..count {
        down_start[aggregate + 1] += down_start[aggregate];
    }
    let mut next = down_start.clone();
    let mut down = vec![(0, 0); column.len()];
    for node in 0..start.len() - 1 {
        for at in start[node]..start[node + 1] {
            let slot = &mut next[column[at] as usize];
            down[*slot] = (node as u32, at as u32);
            *slot += 1;
        }
    }
    (down_start, down)
}

/// The matrix with which a level is smoothed, f32: both triangles, the diagonal block first in each row.
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

/// Whole clusters with about [`PART`] nodes together, and the offset of their inverses.
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
