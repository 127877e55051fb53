//! The family `compliance`: (K⁻¹)ₛ, how the surface yields to a force at a node of it while the control elements are held.
//!
//! In: the factor of A. Out, symmetric and stored once, f32: `compliance/order`, the free nodes of the surface with the n that
//! take forces in front, and `compliance/values`, for every 32 of those n a block of rows that begins at its own nodes:
//!
//! ```text
//! block I    rows 32 I … of the n nodes × the nodes 32 I … of all m, 3 × 3 numbers each, m/N, row by row
//! ```
//!
//! A column is then one run of rows, and pieces of the rows of the blocks before its own. From the paper's "surface
//! compliance": 5,000 nodes take 450 MB.

use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::numbers::{LARGEST, numbers};
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution, SurfaceInverse};
use super::super::tensor::Tensor;
use super::affine::AFFINE;
use crate::base::machine;
use crate::fem::NodeFields;
use crate::mesh::{Surface, TetMesh};
use crate::scene::SurfaceCompliance;
use crate::solve::{Factor, InverseStrip, Progress, SolveError};
use nalgebra::DMatrix;
use safetensors::tensor::Dtype;
use std::collections::BTreeMap;

pub const COMPLIANCE: Family = Family { name: "compliance", from: &[AFFINE] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: COMPLIANCE,
    holds: "how the surface yields to forces at its single nodes: a part of the inverse of K",
    compute: Some(compute),
    solves: true,
    write,
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |_| 0,
};

const ORDER: &str = "compliance/order";
const VALUES: &str = "compliance/values";
/// Nodes of a block of rows.
const BLOCK: usize = 32;

/// Where the numbers of m nodes stand, of which the first n take forces.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Layout {
    n: usize,
    m: usize,
}

impl Layout {
    /// Where block `block` begins.
    fn start(&self, block: usize) -> usize {
        // Each of the blocks before it has 32 rows.
        let before = BLOCK * block;
        9 * (before * self.m - BLOCK * BLOCK * (block * block.saturating_sub(1)) / 2)
    }

    fn len(&self) -> usize {
        let blocks = self.n / BLOCK;
        let rest = self.n % BLOCK;
        self.start(blocks) + 9 * rest * (self.m - BLOCK * blocks)
    }

    /// Where row 3·`i` + `axis` of node `i` < n holds node `j`, which is of its block or behind it.
    fn at(&self, i: usize, axis: usize, j: usize) -> usize {
        let block = i / BLOCK;
        let first = BLOCK * block;
        self.start(block) + (3 * (i - first) + axis) * 3 * (self.m - first) + 3 * (j - first)
    }
}

/// The free nodes of the surface, with those in front that are selected, and how many these are.
fn order(
    mesh: &TetMesh,
    surface: &Surface,
    free: &[u32],
    asked: &SurfaceCompliance,
) -> Result<(Vec<u32>, usize), String> {
    let chosen = asked.nodes.selection().map(|nodes| nodes.select(mesh)).transpose()?;
    let is_chosen = |node: u32| chosen.as_ref().is_none_or(|chosen| chosen.binary_search(&node).is_ok());
    let is_free = |i: &u32| free.binary_search(&surface.nodes[*i as usize]).is_ok();
    let all = (0..surface.nodes.len() as u32).filter(is_free);
    let (front, behind): (Vec<u32>, Vec<u32>) = all.partition(|&i| is_chosen(surface.nodes[i as usize]));
    let count = front.len();
    if count == 0 {
        return Err("selects no node of the surface that is free of control elements".to_owned());
    }
    Ok(([front, behind].concat(), count))
}

/// Nodes that take forces, free nodes of the surface, and bytes of the numbers, of a prepared body.
pub fn compliance_size(
    mesh: &TetMesh,
    held: impl IntoIterator<Item = u32>,
    asked: &SurfaceCompliance,
) -> Result<[usize; 3], String> {
    let mut is_held = vec![false; mesh.nodes.len()];
    held.into_iter().for_each(|node| is_held[node as usize] = true);
    let free: Vec<u32> = (0..mesh.nodes.len() as u32).filter(|&node| !is_held[node as usize]).collect();
    let (order, n) = order(mesh, &Surface::of(mesh), &free, asked)?;
    Ok([n, order.len(), 4 * Layout { n, m: order.len() }.len()])
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let (Some(asked), Some(factor)) = (&assembled.body.surface_compliance, assembled.factor) else {
        return Ok(());
    };
    let Solution { mesh, surface, .. } = &*solution;
    let free = &assembled.partition.free;
    let (order, n) = order(mesh, surface, free, asked).map_err(|message| {
        let key = format!("body.{}.surface_compliance.nodes", assembled.name);
        assembled.scene.invalid(&key, message)
    })?;
    let layout = Layout { n, m: order.len() };
    // The numbers, as they are made, as a tensor, and in the file's bytes.
    machine::expect("the compliance of the surface", 12.0 * layout.len() as f64)
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
    let unknowns: Vec<u32> = order
        .iter()
        .map(|&i| free.partition_point(|&node| node < surface.nodes[i as usize]) as u32)
        .collect();
    let mut bytes = vec![0; 4 * layout.len()];
    solve(factor, &unknowns, layout, &mut bytes, progress)
        .map_err(|source| GreenError::Solve { body: assembled.place.to_owned(), source })?;
    solution.compliance = Some(SurfaceInverse { nodes: n, order, bytes });
    Ok(())
}

/// Fills the blocks with the inverse over these nodes of A.
fn solve(
    factor: &dyn Factor,
    nodes: &[u32],
    layout: Layout,
    bytes: &mut [u8],
    progress: &dyn Progress,
) -> Result<(), SolveError> {
    let mut put = |i: usize, axis: usize, j: usize, other: usize, value: f64| {
        if i < layout.n && j >= i / BLOCK * BLOCK {
            let at = 4 * (layout.at(i, axis, j) + other);
            bytes[at..at + 4].copy_from_slice(&(value as f32).to_le_bytes());
        }
    };
    let mut take = |strip: &InverseStrip<'_>| {
        for (column, values) in strip.values.chunks_exact(3 * strip.rows.len()).enumerate() {
            let (j, other) = (strip.columns[column / 3] as usize, column % 3);
            for (row, value) in values.iter().enumerate() {
                let (i, axis) = (strip.rows[row / 3] as usize, row % 3);
                put(i, axis, j, other, *value);
                if i != j {
                    put(j, other, i, axis, *value);
                }
            }
        }
    };
    if layout.n == layout.m {
        return factor.inverse_block(nodes, &mut take, progress);
    }
    let places: Vec<u32> = (0..nodes.len() as u32).collect();
    progress.begin("compliance of the surface", layout.n as u64);
    for first in (0..layout.n).step_by(BLOCK) {
        let own = first..(first + BLOCK).min(layout.n);
        let mut unit = NodeFields::zeros(own.len(), 3 * own.len());
        (0..3 * own.len()).for_each(|i| unit.row_mut(i)[i] = 1.0);
        let x = factor.solve_at(&nodes[own.clone()], &unit, &nodes[first..])?;
        let column = |c: usize| x.data.iter().skip(c).step_by(x.columns);
        let values: Vec<f64> = (0..x.columns).flat_map(column).copied().collect();
        take(&InverseStrip { rows: &places[first..], columns: &places[own.clone()], values: &values });
        progress.advance(own.len() as u64);
    }
    progress.end();
    Ok(())
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let Some(inverse) = &body.solution.compliance else { return Vec::new() };
    meta.compliance_nodes = Some(inverse.nodes);
    let order = Tensor::new(&[inverse.order.len()], inverse.order.iter().copied());
    let shape = vec![inverse.bytes.len() / 4];
    let values = Tensor { dtype: Dtype::F32, shape, bytes: inverse.bytes.clone() };
    vec![(ORDER.to_owned(), order), (VALUES.to_owned(), values)]
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let (order, values) = (format!("{name}/{ORDER}"), format!("{name}/{VALUES}"));
    let m = file.count(&order);
    file.expect(&order, Dtype::U32, &[m])?;
    let nodes: &[u32] = file.slice(&order);
    let mut sorted = nodes.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    let n = body.compliance_nodes.unwrap_or(0);
    let is_fit = sorted.len() == m && sorted.last().is_none_or(|&last| (last as usize) < body.surface_nodes);
    if !is_fit || n == 0 || n > m {
        return Err(format!("tensor {order} does not name nodes of the surface, {n} of which take forces"));
    }
    let layout = Layout { n, m };
    file.expect(&values, Dtype::F32, &[layout.len()])?;
    let numbers_of: &[f32] = file.slice(&values);
    numbers(&format!("tensor {values}"), numbers_of.iter().map(|&x| x.into()), LARGEST)
}

/// The compliance of a body, read where it lies.
pub struct Compliance<'a> {
    layout: Layout,
    order: &'a [u32],
    values: &'a [f32],
    surface_nodes: usize,
}

/// Displacements of all nodes of the surface for a force of 1 N at one of them along x, y and z: m/N, `[node][axis][force]`.
pub type Yield = Vec<[[f32; 3]; 3]>;

impl Compliance<'_> {
    /// Where each node of the surface stands that takes forces.
    pub fn places(&self) -> BTreeMap<u32, usize> {
        self.order[..self.layout.n].iter().copied().zip(0..).collect()
    }

    /// What a force at the node at `place` does to the whole surface; nodes of control elements stay.
    pub fn column(&self, place: usize) -> Yield {
        let mut all = vec![[[0.0; 3]; 3]; self.surface_nodes];
        let first = place / BLOCK * BLOCK;
        for (j, &node) in self.order.iter().enumerate() {
            let of_node = &mut all[node as usize];
            for (axis, row) in of_node.iter_mut().enumerate() {
                for (force, value) in row.iter_mut().enumerate() {
                    *value = match j < first {
                        true => self.values[self.layout.at(j, axis, place) + force],
                        false => self.values[self.layout.at(place, force, j) + axis],
                    };
                }
            }
        }
        all
    }
}

/// What a change adds to the displacements of the whole surface for unit forces at these of its nodes: 3 rows a node of the
/// surface, 3 columns a force.
pub type Added<'a> = &'a dyn Fn(&[u32]) -> DMatrix<f64>;

impl Compliance<'_> {
    /// The tensors after a change by which the nodes `freed` of the surface are held no more.
    pub fn changed(&self, freed: &[u32], added: Added<'_>) -> Vec<(String, Tensor)> {
        let n = self.layout.n;
        let order = [self.order, freed].concat();
        let layout = Layout { n, m: order.len() };
        let mut values = Vec::with_capacity(layout.len());
        for first in (0..n).step_by(BLOCK) {
            let own = first..(first + BLOCK).min(n);
            let more = added(&order[own.clone()]);
            for (i, axis) in own.flat_map(|i| [0, 1, 2].map(|axis| (i, axis))) {
                for (j, &node) in order.iter().enumerate().skip(first) {
                    // Both halves of the matrix are the same: the force is at node i.
                    let old = |other: usize| match j < self.layout.m {
                        true => self.values[self.layout.at(i, axis, j) + other],
                        false => 0.0,
                    };
                    let new = |other: usize| more[(3 * node as usize + other, 3 * (i - first) + axis)];
                    values.extend([0, 1, 2].map(|other| (f64::from(old(other)) + new(other)) as f32));
                }
            }
        }
        let order = Tensor::new(&[order.len()], order);
        vec![(ORDER.to_owned(), order), (VALUES.to_owned(), Tensor::new(&[values.len()], values))]
    }
}

impl GreenFile {
    /// How the surface of a body yields, where the scene asked for it.
    pub fn compliance(&self, body: &str) -> Option<Compliance<'_>> {
        let meta = self.meta.bodies.get(body).filter(|meta| meta.requirements.has(COMPLIANCE))?;
        let order: &[u32] = self.slice(&format!("{body}/{ORDER}"));
        let layout = Layout { n: meta.compliance_nodes?, m: order.len() };
        let values = self.slice(&format!("{body}/{VALUES}"));
        Some(Compliance { layout, order, values, surface_nodes: meta.surface_nodes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pair of which one takes forces has one place or, within a diagonal block, two.
    #[test]
    fn blocks_hold_each_pair_and_leave_no_gap() {
        for (n, m) in [(1, 1), (32, 32), (33, 33), (70, 70), (5, 100), (64, 65), (70, 101)] {
            let layout = Layout { n, m };
            let mut seen = vec![0; layout.len()];
            for i in 0..n {
                for j in i / BLOCK * BLOCK..m {
                    for axis in 0..3 {
                        (0..3).for_each(|other| seen[layout.at(i, axis, j) + other] += 1);
                    }
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{n} {m}");
        }
        let paper = Layout { n: 5000, m: 5000 };
        assert!((4.50e8..4.56e8).contains(&(4.0 * paper.len() as f64)), "450 MB");
    }
}
