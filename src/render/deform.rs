//! A body deformed on the device: coefficients and motions in; positions and normals out, into the body's own vertex
//! buffers.
//!
//! y = X + Σ cₖ u⁽ᵏ⁾ over all columns with a coefficient, x = Σ w_p (R_p y + t_p) where the body has several parts, then
//! the normals. The sum is made whole each time: partial sums per group, as `deform::Superposition` keeps them on the CPU,
//! would read half as much when one of two control elements moves, but write and read as much again, and under the model
//! `rotation` all elements change together. Twins on the CPU: `deform::Superposition`, `deform::move_parts`,
//! `deform::vertex_normals`.
//!
//! Copies of nodes, which draw the other side of a sharp edge, take their nodes' positions after every deformation; their
//! twin on the CPU is `base::creases`.

use super::chunk::{Chunk, ComputePass, most_items, ranges};
use super::error::RenderError;
use super::gpu::Gpu;
use super::parts::PartsPass;
use super::patches::Reach;
use super::view::Bounds;
use super::{columns, normals, shader};
use crate::base::columns::{ColumnGroup, Storage};
use crate::base::parts::PartWeights;
use nalgebra::Isometry3;
use wgpu::BufferUsages;

/// Four columns and their weights: `Terms` of `shaders/deform.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Terms {
    column: [u32; 4],
    weight: [f32; 4],
}

/// Bytes before the terms in `Sum` of `shaders/deform.wgsl`.
const HEADER: usize = 16;

/// The compute passes of one body, and what their buffers hold.
pub(super) struct DeformPass {
    sum: ComputePass,
    /// Present for a body of several parts.
    parts: Option<PartsPass>,
    /// Present for a body with vertices that are copies of nodes.
    copies: Option<ComputePass>,
    normals: ComputePass,
    terms: wgpu::Buffer,
    /// Scale of each column.
    scales: Vec<f32>,
    /// The coefficients summed last.
    pub(super) last: Vec<f32>,
    /// Reach of each patch of the body.
    pub(super) reaches: Vec<Reach>,
}

impl DeformPass {
    /// `positions` and `normals` are storage buffers of the body's vertices, a multiple of 16 bytes long.
    pub(super) fn new(
        gpu: &Gpu,
        (triangles, copied): (&[[u32; 3]], &[u32]),
        rest: &[[f32; 3]],
        groups: &[ColumnGroup<'_>],
        weights: Option<&PartWeights>,
        [positions, normals]: [&wgpu::Buffer; 2],
    ) -> Result<DeformPass, RenderError> {
        let nodes = rest.len();
        let mut scales = Vec::new();
        for group in groups {
            scales.extend((0..columns::count(group, nodes)?).map(|column| group.scale(column)));
        }
        let storage = groups.first().map_or(Storage::F32, ColumnGroup::storage);
        if groups.iter().any(|group| group.storage() != storage) {
            return Err(RenderError::MixedStorage);
        }
        if let Some(weights) = weights.filter(|weights| weights.nodes() != nodes) {
            let (what, found) = ("rows of weights", weights.nodes());
            return Err(RenderError::VertexCount { what, found, expected: nodes });
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let rest_buffer = gpu.storage("rest surface", positions.size(), usage)?;
        gpu.queue.write_buffer(&rest_buffer, 0, bytemuck::cast_slice(rest));
        let most_terms = HEADER + scales.len().div_ceil(4).max(1) * size_of::<Terms>();
        let terms = gpu.storage("coefficients", most_terms as u64, usage)?;

        let mut sum = ComputePass::new(gpu, "deform", &columns::shader(storage));
        let bytes_per_node = 3 * storage.width() * scales.len().max(1);
        let most_nodes = (gpu.storage_limit as usize / bytes_per_node).min(most_items(gpu) / 3 * 4);
        // Four nodes are three passes of four numbers: every chunk starts at a whole one.
        for chunk in ranges(nodes, most_nodes, 4) {
            let columns = columns::upload(gpu, groups, nodes, chunk.clone())?;
            let quads = |nodes: usize| (3 * nodes).div_ceil(4) as u32;
            let part = Chunk { count: quads(chunk.len()), first: quads(chunk.start) };
            sum.add(gpu, [&columns, &rest_buffer, &terms, positions], part)?;
        }
        let parts = weights.map(|weights| PartsPass::new(gpu, weights, positions)).transpose()?;
        let copies = (!copied.is_empty()).then(|| pass(gpu, copied, nodes, positions)).transpose()?;
        let normals = normals::pass(gpu, triangles, nodes + copied.len(), positions, normals)?;
        gpu.check()?;
        Ok(DeformPass { sum, parts, copies, normals, terms, scales, last: Vec::new(), reaches: Vec::new() })
    }

    /// Whether the coefficients or the parts differ from the last ones; then the passes are encoded and submitted. The
    /// motion of a single part is left to whoever draws the body.
    pub(super) fn run(
        &mut self,
        gpu: &Gpu,
        coefficients: &[f64],
        parts: &[Isometry3<f64>],
    ) -> Result<bool, RenderError> {
        let (found, expected) = (coefficients.len(), self.scales.len());
        if found != expected {
            return Err(RenderError::CoefficientCount { found, expected });
        }
        let moved = match &mut self.parts {
            Some(pass) => pass.take(gpu, parts)?,
            None => false,
        };
        let rounded: Vec<f32> = coefficients.iter().map(|c| *c as f32).collect();
        if self.last == rounded && !moved {
            return Ok(false);
        }
        self.last = rounded;
        self.submit(gpu)?;
        Ok(true)
    }

    fn submit(&self, gpu: &Gpu) -> Result<(), RenderError> {
        gpu.queue.write_buffer(&self.terms, 0, &self.packed());
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.sum.encode(gpu, &mut encoder);
        if let Some(parts) = &self.parts {
            parts.pass.encode(gpu, &mut encoder);
        }
        if let Some(copies) = &self.copies {
            copies.encode(gpu, &mut encoder);
        }
        self.normals.encode(gpu, &mut encoder);
        gpu.queue.submit([encoder.finish()]);
        gpu.check()
    }

    /// Puts the body at rest, as it is made.
    pub(super) fn rest(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        self.last = vec![0.0; self.scales.len()];
        self.submit(gpu)
    }

    /// A box around a patch as it is now.
    pub(super) fn bounds(&self, reach: &Reach) -> Bounds {
        reach.bounds(&self.last, self.parts.as_ref().map_or(&[], |parts| &parts.last))
    }

    /// The buffer `sum` of the shader: columns without a coefficient are left out, which is why they cost nothing.
    fn packed(&self) -> Vec<u8> {
        let used: Vec<(u32, f32)> = (0..)
            .zip(self.scales.iter().zip(&self.last))
            .filter(|(_, (_, c))| **c != 0.0)
            .map(|(k, (scale, c))| (k, c * scale))
            .collect();
        let passes = used.chunks(4).map(|four| {
            let mut terms = Terms::default();
            for (i, &(column, weight)) in four.iter().enumerate() {
                (terms.column[i], terms.weight[i]) = (column, weight);
            }
            terms
        });
        let mut bytes = vec![0; HEADER];
        bytes[..4].copy_from_slice(&(used.len().div_ceil(4) as u32).to_ne_bytes());
        passes.for_each(|terms| bytes.extend_from_slice(bytemuck::bytes_of(&terms)));
        bytes
    }

    /// Dispatches of the sum and of the normals: one where the device binds the whole body at once.
    pub(super) fn chunks(&self) -> [usize; 2] {
        [self.sum.chunks(), self.normals.chunks()]
    }
}

/// The pass that writes the positions of the vertices after the first `nodes`.
pub(super) fn pass(
    gpu: &Gpu,
    copies: &[u32],
    nodes: usize,
    positions: &wgpu::Buffer,
) -> Result<ComputePass, RenderError> {
    let mut pass = ComputePass::new(gpu, "copies", &shader::COPIES);
    let most = most_items(gpu).min((gpu.storage_limit / 4) as usize);
    for part in ranges(copies.len(), most, 1) {
        let own = &copies[part.clone()];
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let buffer = gpu.storage("copied nodes", size_of_val(own) as u64, usage)?;
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(own));
        let chunk = Chunk { count: own.len() as u32, first: (nodes + part.start) as u32 };
        pass.add(gpu, [&buffer, &buffer, &buffer, positions], chunk)?;
    }
    Ok(pass)
}

#[cfg(test)]
mod tests {
    use super::super::layout::assert_layout;
    use super::super::{layout, shader};
    use super::*;

    #[test]
    fn structs_lie_as_the_shaders_read_them() {
        let source = shader::DEFORM_F32.concat();
        assert_layout!(source, "Terms", Terms: column, weight);
        assert_layout!(source, "Chunk", Chunk: count, first);
        let offsets: Vec<usize> =
            layout::in_wgsl(&source, "Sum").1.into_iter().map(|(_, offset)| offset).collect();
        assert_eq!(offsets, [0, HEADER]);
    }
}
