//! The family `compliance`: (K⁻¹)ₛ, the displacements of the surface for a force at one of its nodes while the control
//! elements are held.
//!
//! In: the factor of A. Out, symmetric and stored once, f32: `compliance/order`, the free nodes of the surface with the n that
//! take forces in front, and `compliance/values`, tile after tile:
//!
//! ```text
//! tile I, J ≥ I    nodes 32 I … of the n × nodes 32 J … of all m, 3 × 3 numbers each, m/N, row by row
//! ```
//!
//! The values stay on the disk: the response to a force at a node is read from the tiles of its row and column, m/32 tiles
//! of 37 kB, each checked against its hash in `compliance/hashes`. This is the paper's "surface compliance": 5,000 nodes
//! take 450 MB.

use super::super::bytes::Tensor;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, COMPLIANCE_VALUES as VALUES, GreenFile};
use super::super::numbers::{LARGEST, numbers};
use super::super::on_demand::Yield;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution, SurfaceInverse};
use super::super::update::ChangedSystem;
use super::affine::AFFINE;
use super::tile_layout::{BLOCK, HASH, TileLayout};
use crate::base::machine;
use crate::fem::NodeFields;
use crate::mesh::{Surface, TetMesh};
use crate::scene::SurfaceCompliance;
use crate::solve::{Factor, InverseStrip, Progress, SolveError};
use rayon::prelude::*;
use safetensors::tensor::Dtype;
use std::collections::BTreeMap;
use std::sync::Arc;

pub const COMPLIANCE: Family = Family { name: "compliance", from: &[AFFINE] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: COMPLIANCE,
    holds: "how the surface yields to forces at its single nodes: a part of the inverse of K",
    suits: None,
    compute: Some(compute),
    solves: true,
    write,
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |_| 0,
    is_derived: true,
    column_names: None,
};

const ORDER: &str = "compliance/order";
/// blake3 of every tile.
const HASHES: &str = "compliance/hashes";

/// The free nodes of the surface, the selected ones in front, and the number of selected ones.
pub(super) fn order(
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

/// Counts for a prepared body: nodes that take forces, free nodes of the surface, and bytes of the numbers.
pub fn compliance_size(
    mesh: &TetMesh,
    held: impl IntoIterator<Item = u32>,
    asked: &SurfaceCompliance,
) -> Result<[usize; 3], String> {
    let mut is_held = vec![false; mesh.nodes.len()];
    held.into_iter().for_each(|node| is_held[node as usize] = true);
    let free: Vec<u32> = (0..mesh.nodes.len() as u32).filter(|&node| !is_held[node as usize]).collect();
    let (order, n) = order(mesh, &Surface::from_mesh(mesh), &free, asked)?;
    Ok([n, order.len(), TileLayout { n, m: order.len() }.bytes()])
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let (Some(asked), Some(factor)) = (&assembled.body.surface_compliance, assembled.factor) else {
        return Ok(());
    };
    let (order, n, unknowns) = unknowns(assembled, solution, asked)?;
    let layout = TileLayout { n, m: order.len() };
    // Three copies of the numbers: as they are made, as a tensor, and in the file's bytes.
    machine::expect("the compliance of the surface", 12.0 * layout.len() as f64)
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
    let mut bytes = vec![0; layout.bytes()];
    solve(factor, &unknowns, layout, &mut bytes, progress)
        .map_err(|source| GreenError::Solve { body: assembled.place.to_owned(), source })?;
    solution.compliance = Some(SurfaceInverse { nodes: n, order, bytes });
    Ok(())
}

/// The nodes of [`order`], the number of them that take forces, and the index of each among the nodes of A.
pub(super) fn unknowns(
    assembled: &Assembled<'_>,
    solution: &Solution,
    asked: &SurfaceCompliance,
) -> Result<(Vec<u32>, usize, Vec<u32>), GreenError> {
    let Solution { mesh, surface, .. } = solution;
    let free = &assembled.partition.free;
    let (order, n) = order(mesh, surface, free, asked).map_err(|message| {
        let key = format!("body.{}.surface_compliance.nodes", assembled.name);
        assembled.scene.invalid(&key, message)
    })?;
    let index_in_a = |&i: &u32| free.partition_point(|&node| node < surface.nodes[i as usize]) as u32;
    let unknowns = order.iter().map(index_in_a).collect();
    Ok((order, n, unknowns))
}

/// Fills the tiles in `bytes` with the inverse of A over `nodes`.
fn solve(
    factor: &dyn Factor,
    nodes: &[u32],
    layout: TileLayout,
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
        let unit = NodeFields::unit(own.len());
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
    let hashes = TileLayout { n: inverse.nodes, m: inverse.order.len() }.hashes(&inverse.bytes);
    let values = Tensor { dtype: Dtype::F32, shape, bytes: inverse.bytes.clone() };
    vec![(ORDER.to_owned(), order), (HASHES.to_owned(), hashes), (VALUES.to_owned(), values)]
}

/// Number of nodes that take forces, and number of nodes in the order; an error where the order is not one of surface nodes.
pub(super) fn check_order(file: &GreenFile, order: &str, body: &BodyMeta) -> Result<[usize; 2], String> {
    let m = file.count(order);
    file.expect(order, Dtype::U32, &[m])?;
    let mut sorted = file.slice::<u32>(order).to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    let n = body.compliance_nodes.unwrap_or(0);
    let is_fit = sorted.len() == m && sorted.last().is_none_or(|&last| (last as usize) < body.surface_nodes);
    match is_fit && n > 0 && n <= m {
        true => Ok([n, m]),
        false => Err(format!("tensor {order} does not name nodes of the surface, {n} of which take forces")),
    }
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let values = format!("{name}/{VALUES}");
    let [n, m] = check_order(file, &format!("{name}/{ORDER}"), body)?;
    let layout = TileLayout { n, m };
    // The numbers are checked when they are read.
    file.expect(&values, Dtype::F32, &[layout.len()])?;
    file.expect(&format!("{name}/{HASHES}"), Dtype::U8, &[layout.tiles().count(), HASH])
}

/// The free nodes of a surface.
#[derive(Clone, Copy)]
pub(super) struct Order<'a> {
    /// Indices among all nodes of the surface; those that take forces come first.
    pub nodes: &'a [u32],
    /// Number of nodes that take forces.
    pub n: usize,
    pub surface_nodes: usize,
}

impl<'a> Order<'a> {
    /// Reads the order from a body's tensor.
    pub fn open(file: &'a GreenFile, tensor: &str, body: &BodyMeta) -> Option<Order<'a>> {
        let (nodes, surface_nodes) = (file.slice(tensor), body.surface_nodes);
        Some(Order { nodes, n: body.compliance_nodes?, surface_nodes })
    }

    /// The nodes after a change that releases `freed`, and the number of them that take forces: where all free nodes do, the
    /// released ones do too.
    pub fn with(&self, freed: &[u32]) -> (Vec<u32>, usize) {
        let all = [self.nodes, freed].concat();
        let n = if self.n == self.nodes.len() { all.len() } else { self.n };
        (all, n)
    }

    /// Place in the order of each surface node that takes forces.
    pub fn places(&self) -> BTreeMap<u32, usize> {
        self.nodes[..self.n].iter().copied().zip(0..).collect()
    }

    /// Displacements of the whole surface. `number(j, axis, force)` is that of the j-th node along `axis` for a unit force
    /// along axis `force`; nodes of control elements stay.
    pub fn spread(&self, number: impl Fn(usize, usize, usize) -> f32) -> Yield {
        let mut all = vec![[[0.0; 3]; 3]; self.surface_nodes];
        for (j, &node) in self.nodes.iter().enumerate() {
            all[node as usize] = [0, 1, 2].map(|axis| [0, 1, 2].map(|force| number(j, axis, force)));
        }
        all
    }
}

/// The tiles of a file, each of which is read when it is needed.
pub struct Tiles<'a> {
    file: &'a GreenFile,
    /// Name of the tensor of the values.
    tensor: String,
    layout: TileLayout,
    pub(super) order: Order<'a>,
    hashes: &'a [u8],
}

impl<'a> Tiles<'a> {
    /// The tiles of a body with this family.
    pub(super) fn open(file: &'a GreenFile, body: &str, meta: &BodyMeta) -> Option<Tiles<'a>> {
        let order = Order::open(file, &format!("{body}/{ORDER}"), meta)?;
        let layout = TileLayout { n: order.n, m: order.nodes.len() };
        let (tensor, hashes) = (format!("{body}/{VALUES}"), file.slice(&format!("{body}/{HASHES}")));
        Some(Tiles { file, tensor, layout, order, hashes })
    }

    /// See [`super::Compliance::column`].
    pub(super) fn column(&self, place: usize) -> Result<Yield, GreenError> {
        let strip = self.strip(place / BLOCK)?;
        let (width, row) = (3 * self.layout.m, 3 * (place % BLOCK));
        Ok(self.order.spread(|j, axis, force| strip[(row + force) * width + 3 * j + axis]))
    }

    /// Reads every tile; errors at the first whose hash differs.
    pub(super) fn verify(&self) -> Result<(), GreenError> {
        let tiles: Vec<_> = self.layout.tiles().collect();
        tiles.par_iter().try_for_each(|&[block, other]| self.tile(block, other).map(drop))
    }

    /// The rows of a block over all m nodes, on both sides of the diagonal.
    fn strip(&self, block: usize) -> Result<Arc<Vec<f32>>, GreenError> {
        self.file.recent.get(&self.tensor, block, || {
            let width = 3 * self.layout.m;
            let mut strip = vec![0.0; self.layout.sides(block, block)[0] * width];
            for other in 0..self.layout.m.div_ceil(BLOCK) {
                let [upper, lower] = [block.min(other), block.max(other)];
                let tile = self.tile(upper, lower)?;
                let [_, columns] = self.layout.sides(upper, lower);
                for (row, numbers) in tile.chunks_exact(columns).enumerate() {
                    if other >= block {
                        let at = row * width + 3 * BLOCK * other;
                        strip[at..at + columns].copy_from_slice(numbers);
                        continue;
                    }
                    for (row_here, value) in numbers.iter().enumerate().take(strip.len() / width) {
                        strip[row_here * width + 3 * BLOCK * other + row] = *value;
                    }
                }
            }
            Ok(strip)
        })
    }

    fn tile(&self, block: usize, other: usize) -> Result<Vec<f32>, GreenError> {
        let path = || self.file.path.clone();
        let tile = self.layout.tile(block, other);
        let bytes = self.file.bytes_of(&self.tensor, 4 * tile.start..4 * tile.end);
        let bytes = bytes.map_err(|source| GreenError::Io { path: path(), source })?;
        let number = self.layout.number(block, other);
        let damaged = |reason: String| GreenError::Damaged { path: path(), reason };
        if self.hashes[HASH * number..HASH * (number + 1)] != *blake3::hash(&bytes).as_bytes() {
            return Err(damaged(format!(
                "tile {number} of tensor {} is damaged (the hash differs)",
                self.tensor
            )));
        }
        let four = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let values: Vec<f32> = bytes.chunks_exact(4).map(four).collect();
        numbers(&format!("tensor {}", self.tensor), values.iter().map(|&x| x.into()), LARGEST)
            .map_err(damaged)?;
        Ok(values)
    }
}

impl Tiles<'_> {
    /// The tensors after a change that releases the nodes `freed` of the surface.
    pub(super) fn changed(
        &self,
        freed: &[u32],
        change: &ChangedSystem<'_>,
    ) -> Result<Vec<(String, Tensor)>, GreenError> {
        changed(&self.tensor, self.order, freed, change, &|first| self.strip(first / BLOCK))
    }
}

/// Reads rows of the matrix: three for each node from the given one up to the next multiple of [`BLOCK`].
pub(super) type Rows<'a> = &'a dyn Fn(usize) -> Result<Arc<Vec<f32>>, GreenError>;

/// The tensors of the tiles after a change that releases the nodes `freed`, from the numbers of `tensor` before the change.
/// Errors where the new file and its tensors do not fit into memory together.
pub(super) fn changed(
    tensor: &str,
    before: Order<'_>,
    freed: &[u32],
    change: &ChangedSystem<'_>,
    rows: Rows<'_>,
) -> Result<Vec<(String, Tensor)>, GreenError> {
    let m = before.nodes.len();
    let (order, n) = before.with(freed);
    let layout = TileLayout { n, m: order.len() };
    let size = layout.bytes();
    machine::expect("the compliance of the surface after the change", 2.0 * size as f64).map_err(
        |source| GreenError::Memory { body: tensor.split('/').next().unwrap_or_default().to_owned(), source },
    )?;
    let mut values = vec![0; size];
    for first in (0..n).step_by(BLOCK) {
        let own = first..(first + BLOCK).min(n);
        let more = change.compliance(&order[own.clone()]);
        // Nodes that were held did not move.
        let strip = if first < before.n { Some(rows(first)?) } else { None };
        for (row, (i, axis)) in own.flat_map(|i| [0, 1, 2].map(|axis| (i, axis))).enumerate() {
            let old = strip.as_ref().and_then(|strip| strip.get(3 * m * row..3 * m * (row + 1)));
            for (j, &node) in order.iter().enumerate().skip(first) {
                for other in 0..3 {
                    // The matrix is symmetric: here the force acts at node i.
                    let old = old.and_then(|old| old.get(3 * j + other)).map_or(0.0, |&old| f64::from(old));
                    let new = (old + more[(3 * node as usize + other, row)]) as f32;
                    let at = 4 * (layout.at(i, axis, j) + other);
                    values[at..at + 4].copy_from_slice(&new.to_le_bytes());
                }
            }
        }
    }
    let order = Tensor::new(&[order.len()], order);
    let hashes = layout.hashes(&values);
    let values = Tensor { dtype: Dtype::F32, shape: vec![layout.len()], bytes: values };
    Ok(vec![(ORDER.to_owned(), order), (HASHES.to_owned(), hashes), (VALUES.to_owned(), values)])
}
