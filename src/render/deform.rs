//! A body deformed on the device: coefficients in; positions and normals out, into the body's own vertex buffers.
//!
//! x = X + Σ cₖ u⁽ᵏ⁾ over all columns with a coefficient, then the normals. The sum is made whole each time: partial
//! sums per control element, as `deform::Superposition` keeps them on the CPU, would read half as much when one of two
//! elements moves, but write and read as much again, and under the model `rotation` all elements change together.
//! Twins on the CPU: `deform::Superposition`, `deform::vertex_normals`.

use super::chunk::{Chunk, ComputePass, most_items, ranges};
use super::columns::{self, ColumnData};
use super::error::RenderError;
use super::gpu::Gpu;
use super::normals;
use super::patches::Reach;
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

/// The two compute passes of one body, and what their buffers hold.
pub(super) struct DeformPass {
    sum: ComputePass,
    normals: ComputePass,
    terms: wgpu::Buffer,
    /// Of each column.
    scales: Vec<f32>,
    /// The coefficients summed last.
    pub(super) last: Vec<f32>,
    /// Of each patch of the body.
    pub(super) reaches: Vec<Reach>,
}

impl DeformPass {
    /// `positions` and `normals` are storage buffers of the body's vertices, a multiple of 16 bytes long.
    pub(super) fn new(
        gpu: &Gpu,
        triangles: &[[u32; 3]],
        rest: &[[f32; 3]],
        elements: &[ColumnData<'_>],
        [positions, normals]: [&wgpu::Buffer; 2],
    ) -> Result<DeformPass, RenderError> {
        let nodes = rest.len();
        let mut scales = Vec::new();
        for element in elements {
            scales.extend((0..element.count(nodes)?).map(|column| element.scale(column)));
        }
        let first = elements.first().copied().unwrap_or(ColumnData::F32(&[]));
        let same =
            |element: &ColumnData<'_>| std::mem::discriminant(element) == std::mem::discriminant(&first);
        if !elements.iter().all(same) {
            return Err(RenderError::MixedStorage);
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let rest_buffer = gpu.storage("rest surface", positions.size(), usage)?;
        gpu.queue.write_buffer(&rest_buffer, 0, bytemuck::cast_slice(rest));
        let most_terms = HEADER + scales.len().div_ceil(4).max(1) * size_of::<Terms>();
        let terms = gpu.storage("coefficients", most_terms as u64, usage)?;

        let mut sum = ComputePass::new(gpu, "deform", &first.shader());
        let bytes_per_node = 3 * first.width() * scales.len().max(1);
        let most_nodes = (gpu.storage_limit as usize / bytes_per_node).min(most_items(gpu) / 3 * 4);
        // Four nodes are three passes of four numbers: every chunk starts at a whole one.
        for chunk in ranges(nodes, most_nodes, 4) {
            let columns = columns::upload(gpu, elements, nodes, chunk.clone())?;
            let quads = |nodes: usize| (3 * nodes).div_ceil(4) as u32;
            let part = Chunk { count: quads(chunk.len()), first: quads(chunk.start) };
            sum.add(gpu, [&columns, &rest_buffer, &terms, positions], part)?;
        }
        let normals = normals::pass(gpu, triangles, nodes, positions, normals)?;
        gpu.check()?;
        Ok(DeformPass { sum, normals, terms, scales, last: Vec::new(), reaches: Vec::new() })
    }

    /// Whether the coefficients differ from the last ones; then the passes are encoded and submitted.
    pub(super) fn run(&mut self, gpu: &Gpu, coefficients: &[f32]) -> Result<bool, RenderError> {
        let (found, expected) = (coefficients.len(), self.scales.len());
        if found != expected {
            return Err(RenderError::CoefficientCount { found, expected });
        }
        if self.last == coefficients {
            return Ok(false);
        }
        self.last = coefficients.to_vec();
        gpu.queue.write_buffer(&self.terms, 0, &self.packed());
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.sum.encode(gpu, &mut encoder);
        self.normals.encode(gpu, &mut encoder);
        gpu.queue.submit([encoder.finish()]);
        gpu.check()?;
        Ok(true)
    }

    /// Puts the body at rest, whatever it was before.
    pub(super) fn rest(&mut self, gpu: &Gpu) -> Result<bool, RenderError> {
        self.last.clear();
        self.run(gpu, &vec![0.0; self.scales.len()])
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

    /// Dispatches of each of the two passes: one where the device binds the whole body at once.
    pub(super) fn chunks(&self) -> [usize; 2] {
        [self.sum.chunks(), self.normals.chunks()]
    }
}

#[cfg(test)]
mod tests {
    use super::super::{chunk::Chunk, layout, shader};
    use super::*;
    use std::mem::offset_of;

    #[test]
    fn structs_lie_as_the_shaders_read_them() {
        let source = shader::DEFORM_F32.concat();
        let terms = [("column", offset_of!(Terms, column)), ("weight", offset_of!(Terms, weight))];
        layout::assert(&source, "Terms", size_of::<Terms>(), &terms);
        let chunk = [("count", offset_of!(Chunk, count)), ("first", offset_of!(Chunk, first))];
        layout::assert(&source, "Chunk", size_of::<Chunk>(), &chunk);
        let offsets: Vec<usize> =
            layout::in_wgsl(&source, "Sum").1.into_iter().map(|(_, offset)| offset).collect();
        assert_eq!(offsets, [0, HEADER]);
    }
}
