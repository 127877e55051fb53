//! The family `compressed`: (K⁻¹)ₛ in little memory, within an error that is measured ([`super::super::compressed`]).
//!
//! In: the factor of A. Out: `compressed/order`, the free nodes of the surface with those that take forces in front, cluster by
//! cluster; the frames and nested bases of the clusters; and, cluster against cluster, blocks that stay on the disk. What a
//! force at a node does is read from the blocks of the clusters that hold it, each checked against its hash.

use super::super::bytes::Tensor;
use super::super::compressed::{
    Block, BuildError, Shape, Surface, Tree, Trial, blocks, compress, frames_of, order, unpack, unpack_bases,
};
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, COMPRESSED_VALUES as VALUES, CompressedMeta, GreenFile};
use super::super::numbers::{LARGEST, numbers};
use super::super::on_demand::Yield;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution, SurfaceCompressed};
use super::super::update::ChangedSystem;
use super::affine::AFFINE;
use super::compliance::{Order, changed, check_order, unknowns};
use super::tile_layout::{BLOCK, HASH, TileLayout};
use crate::base::table::bytes;
use crate::scene::KeptForm;
use crate::solve::Progress;
use faer::Mat;
use rayon::prelude::*;
use safetensors::tensor::Dtype;
use std::collections::BTreeMap;
use std::sync::Arc;

pub const COMPRESSED: Family = Family { name: "compressed", from: &[AFFINE] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: COMPRESSED,
    holds: "how the surface yields to forces at its single nodes, compressed within an error",
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

const ORDER: &str = "compressed/order";
const FRAMES: &str = "compressed/frames";
const RANKS: &str = "compressed/ranks";
const BASES: &str = "compressed/bases";
const BASIS_ENDS: &str = "compressed/basis_ends";
const BLOCKS: &str = "compressed/blocks";
const ENDS: &str = "compressed/ends";
/// blake3 of every block.
const HASHES: &str = "compressed/hashes";

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let (Some(asked), Some(factor)) = (&assembled.body.surface_compliance, assembled.factor) else {
        return Ok(());
    };
    let KeptForm::Compressed(error) = asked.kept else { return Ok(()) };
    let body = || assembled.place.to_owned();
    let (nodes, n, unknowns) = unknowns(assembled, solution, asked)?;
    let Solution { mesh, surface, .. } = &*solution;
    let places: Vec<_> = nodes.iter().map(|&i| mesh.nodes[surface.nodes[i as usize] as usize]).collect();
    let order = order(&places, n);
    let places: Vec<_> = order.iter().map(|&at| places[at]).collect();
    let tree = Tree::new(n, order.len());
    let blocks = blocks(&tree, &places);
    let unknowns: Vec<u32> = order.iter().map(|&at| unknowns[at]).collect();
    let nodes: Vec<u32> = order.iter().map(|&at| nodes[at]).collect();
    let solve = |source| GreenError::Solve { body: body(), source };
    let factor = factor.unkept(progress).map_err(solve)?.unwrap_or(factor);
    let of = Surface { factor, nodes: &unknowns, n, tree: &tree, blocks: &blocks };
    let compressed = compress(&of, error, progress).map_err(|failed| match failed {
        Trial::Build(BuildError::Solve(source)) => solve(source),
        Trial::Build(BuildError::Memory(source)) => GreenError::Memory { body: body(), source },
        Trial::Error(found) => GreenError::Compression { body: body(), asked: error, found },
    })?;
    let size = compressed.values.len() + compressed.bases.len() + HASH * blocks.len();
    let full = TileLayout { n, m: nodes.len() }.bytes() as f64;
    progress.tell(&format!(
        "compliance of the surface: {}, 1/{:.0} of the uncompressed {}; error at most {:.1e} of the \
         pressed node's displacement, at {} of {n} nodes",
        bytes(size as f64),
        full / size as f64,
        bytes(full),
        compressed.error,
        compressed.measured
    ));
    solution.compressed =
        Some(SurfaceCompressed { nodes: n, order: nodes, blocks, asked: error, compressed });
    Ok(())
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let Some(SurfaceCompressed { nodes, order, blocks, asked, compressed }) = &body.solution.compressed
    else {
        return Vec::new();
    };
    meta.compliance_nodes = Some(*nodes);
    meta.compressed =
        Some(CompressedMeta { asked: *asked, measured: compressed.error, nodes: compressed.measured });
    let starts = std::iter::once(0).chain(compressed.ends.iter().copied());
    let hash = |(start, &end): (u64, &u64)| {
        *blake3::hash(&compressed.values[start as usize..end as usize]).as_bytes()
    };
    let hashes: Vec<u8> = starts.zip(&compressed.ends).flat_map(hash).collect();
    let three = |block: &Block| [u32::from(block.is_far), block.of[0] as u32, block.of[1] as u32];
    let raw = |of: &[u8]| Tensor { dtype: Dtype::U8, shape: vec![of.len()], bytes: of.to_vec() };
    let tensors = [
        (ORDER, Tensor::new(&[order.len()], order.iter().copied())),
        (FRAMES, Tensor::new(&[compressed.frames.len() / 9, 9], compressed.frames.iter().copied())),
        (RANKS, Tensor::new(&[compressed.ranks.len()], compressed.ranks.iter().copied())),
        (BASES, raw(&compressed.bases)),
        (BASIS_ENDS, Tensor::new(&[compressed.basis_ends.len()], compressed.basis_ends.iter().copied())),
        (BLOCKS, Tensor::new(&[blocks.len(), 3], blocks.iter().flat_map(three))),
        (ENDS, Tensor::new(&[compressed.ends.len()], compressed.ends.iter().copied())),
        (HASHES, Tensor { dtype: Dtype::U8, shape: vec![blocks.len(), HASH], bytes: hashes }),
        (VALUES, raw(&compressed.values)),
    ];
    tensors.map(|(name, tensor)| (name.to_owned(), tensor)).into()
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    shape(file, name, body).map(|shape| file.shapes.keep(name, shape))
}

/// All but the blocks' own numbers; the error names the first fault.
fn shape(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<Shape, String> {
    let own = |tensor: &str| format!("{name}/{tensor}");
    let [n, m] = check_order(file, &own(ORDER), body)?;
    let tree = Tree::new(n, m);
    let clusters = tree.clusters.len();
    file.expect(&own(FRAMES), Dtype::F64, &[tree.leaves().count(), 9])?;
    file.expect(&own(RANKS), Dtype::U32, &[clusters])?;
    file.expect(&own(BASES), Dtype::U8, &[file.count(&own(BASES))])?;
    file.expect(&own(BASIS_ENDS), Dtype::U64, &[clusters])?;
    let count = file.count(&own(BLOCKS)) / 3;
    file.expect(&own(BLOCKS), Dtype::U32, &[count, 3])?;
    file.expect(&own(ENDS), Dtype::U64, &[count])?;
    file.expect(&own(HASHES), Dtype::U8, &[count, HASH])?;
    let length = file.count(&own(VALUES));
    file.expect(&own(VALUES), Dtype::U8, &[length])?;
    let frames: &[f64] = file.slice(&own(FRAMES));
    numbers(&own(FRAMES), frames.iter().copied(), LARGEST)?;
    let fault = |tensor: &str| format!("tensor {} is not that of {m} nodes", own(tensor));
    let ranks: Vec<usize> = file.slice::<u32>(&own(RANKS)).iter().map(|&rank| rank as usize).collect();
    for cluster in (0..clusters).rev() {
        let rows = match tree.clusters[cluster].children {
            Some(parts) => parts.iter().map(|&part| ranks[part]).sum(),
            None => tree.size(cluster),
        };
        if ranks[cluster] > rows {
            return Err(fault(RANKS));
        }
    }
    let bases = unpack_bases(&tree, &ranks, file.slice(&own(BASES)), file.slice(&own(BASIS_ENDS)));
    let bases = bases.ok_or_else(|| fault(BASES))?;
    let block = |three: &[u32]| {
        let of = [three[1] as usize, three[2] as usize];
        let is_near = of.iter().all(|&c| tree.clusters.get(c).is_some_and(|of| of.children.is_none()));
        let is_fit = of.iter().all(|&c| c < clusters) && (three[0] == 1 || three[0] == 0 && is_near);
        is_fit.then_some(Block { is_far: three[0] == 1, of })
    };
    let blocks: Option<Vec<Block>> = file.slice(&own(BLOCKS)).chunks_exact(3).map(block).collect();
    let ends: &[u64] = file.slice(&own(ENDS));
    if !ends.is_sorted() || ends.last().copied().unwrap_or(0) != length as u64 {
        return Err(fault(ENDS));
    }
    let frames = frames_of(&tree, frames);
    Ok(Shape { blocks: blocks.ok_or_else(|| fault(BLOCKS))?, tree, frames, bases })
}

/// The compressed compliance of a body, read where it lies.
pub struct CompressedColumns<'a> {
    file: &'a GreenFile,
    /// Tensor of the values.
    tensor: String,
    pub(super) order: Order<'a>,
    shape: Arc<Shape>,
    ends: &'a [u64],
    hashes: &'a [u8],
}

impl<'a> CompressedColumns<'a> {
    /// The compliance of a body with this family.
    pub(super) fn open(file: &'a GreenFile, body: &str, meta: &BodyMeta) -> Option<CompressedColumns<'a>> {
        let own = |tensor: &str| format!("{body}/{tensor}");
        Some(CompressedColumns {
            file,
            tensor: own(VALUES),
            order: Order::open(file, &own(ORDER), meta)?,
            shape: file.shapes.get(body)?,
            ends: file.slice(&own(ENDS)),
            hashes: file.slice(&own(HASHES)),
        })
    }

    /// See [`super::Compliance::column`].
    pub(super) fn column(&self, place: usize) -> Result<Yield, GreenError> {
        let column = self.file.recent.get(&self.tensor, place, || self.numbers(place))?;
        Ok(self.order.spread(|j, axis, force| column[9 * j + 3 * axis + force]))
    }

    /// The numbers of one column, node after node of the order.
    fn numbers(&self, place: usize) -> Result<Vec<f32>, GreenError> {
        let touched: Vec<usize> = self.shape.touched(place);
        let read: Result<BTreeMap<usize, Mat<f64>>, GreenError> =
            touched.par_iter().map(|&block| Ok((block, self.block(block)?))).collect();
        let mut read = read?;
        let missing =
            |block: usize| self.damaged(format!("block {block} of tensor {} is missing", self.tensor));
        let column = self.shape.column(place, |block| read.remove(&block).ok_or_else(|| missing(block)))?;
        let all = || column.iter().flatten().flatten().copied();
        numbers(&format!("tensor {}", self.tensor), all(), LARGEST).map_err(|reason| self.damaged(reason))?;
        Ok(all().map(|number| number as f32).collect())
    }

    fn damaged(&self, reason: String) -> GreenError {
        GreenError::Damaged { path: self.file.path.clone(), reason }
    }

    fn block(&self, block: usize) -> Result<Mat<f64>, GreenError> {
        let start = if block == 0 { 0 } else { self.ends[block - 1] };
        let bytes = self.file.bytes_of(&self.tensor, start as usize..self.ends[block] as usize);
        let bytes = bytes.map_err(|source| GreenError::Io { path: self.file.path.clone(), source })?;
        if self.hashes[HASH * block..HASH * (block + 1)] != *blake3::hash(&bytes).as_bytes() {
            let reason = format!("block {block} of tensor {} is damaged (the hash differs)", self.tensor);
            return Err(self.damaged(reason));
        }
        let [rows, columns] = self.shape.sides(block);
        unpack(&bytes, rows, columns).ok_or_else(|| {
            self.damaged(format!("block {block} of tensor {} is not {rows} × {columns} numbers", self.tensor))
        })
    }

    /// Reads every block; errors at the first that is not what was written.
    pub(super) fn verify(&self) -> Result<(), GreenError> {
        (0..self.ends.len()).into_par_iter().try_for_each(|block| self.block(block).map(drop))
    }

    /// The tensors after a change by which the nodes `freed` of the surface are held no more: those of the family `compliance`,
    /// with all numbers.
    pub(super) fn changed(
        &self,
        freed: &[u32],
        change: &ChangedSystem<'_>,
    ) -> Result<Vec<(String, Tensor)>, GreenError> {
        changed(&self.tensor, self.order, freed, change, &|first| {
            let nodes: Vec<usize> = (first..self.order.n.min(first + BLOCK)).collect();
            let columns: Result<Vec<_>, GreenError> =
                nodes.par_iter().map(|&place| self.numbers(place)).collect();
            let row = |(column, force): (&Vec<f32>, usize)| -> Vec<f32> {
                column.chunks_exact(3).map(|axis| axis[force]).collect()
            };
            let rows = columns?;
            let rows = rows.iter().flat_map(|column| [0, 1, 2].map(|force| row((column, force))));
            Ok(Arc::new(rows.flatten().collect()))
        })
    }
}

#[cfg(test)]
mod tests;
