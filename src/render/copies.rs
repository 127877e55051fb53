//! Vertices that are copies of nodes, on the device: drawn on the other side of a sharp edge.
//!
//! In: the node of each copy, once; out: a pass that copies their positions after every deformation. Its twin on the CPU is
//! `base::creases`.

use super::chunk::{Chunk, ComputePass, most_items, ranges};
use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use wgpu::BufferUsages;

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
