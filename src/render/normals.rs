//! The normals of a body on the device: for each vertex, the corners of the triangles around it.
//!
//! In: triangles, once; out: a gather over compressed rows (one row a vertex) that runs after every deformation. Its
//! twin on the CPU is `deform::vertex_normals`.

use super::chunk::{Chunk, ComputePass, most_items};
use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use wgpu::BufferUsages;

/// For each vertex its row of `corners`: of every triangle around it, the two others in their order.
struct Adjacency {
    starts: Vec<u32>,
    corners: Vec<[u32; 2]>,
}

impl Adjacency {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Adjacency {
        let mut starts = vec![0; vertices + 1];
        for &vertex in triangles.as_flattened() {
            starts[vertex as usize + 1] += 1;
        }
        for vertex in 0..vertices {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut corners = vec![[0; 2]; 3 * triangles.len()];
        for &[a, b, c] in triangles {
            for [here, left, right] in [[a, b, c], [b, c, a], [c, a, b]] {
                let row = &mut next[here as usize];
                corners[*row as usize] = [left, right];
                *row += 1;
            }
        }
        Adjacency { starts, corners }
    }

    /// Vertices from `first` on whose corners fit into `most`; at least one.
    fn fitting(&self, first: usize, most: usize) -> usize {
        let limit = self.starts[first] as usize + most;
        let end = self.starts.partition_point(|&start| start as usize <= limit) - 1;
        end.max(first + 1) - first
    }
}

/// The pass that writes `normals` from `positions`.
pub(super) fn pass(
    gpu: &Gpu,
    triangles: &[[u32; 3]],
    vertices: usize,
    positions: &wgpu::Buffer,
    normals: &wgpu::Buffer,
) -> Result<ComputePass, RenderError> {
    let adjacency = Adjacency::new(vertices, triangles);
    let mut pass = ComputePass::new(gpu, "normals", &shader::NORMALS);
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let most_corners = (gpu.storage_limit / 8) as usize;
    let most_vertices = most_items(gpu).min((gpu.storage_limit / 4) as usize - 1);
    let mut first = 0;
    while first < vertices {
        let count = adjacency.fitting(first, most_corners).min(most_vertices);
        let rows = &adjacency.starts[first..=first + count];
        let from = rows[0];
        let starts: Vec<u32> = rows.iter().map(|start| start - from).collect();
        let corners = &adjacency.corners[from as usize..][..(rows[count] - from) as usize];
        // A vertex of no triangle has an empty row, and a buffer is never empty.
        let bytes = (size_of_val(corners) as u64).max(8);
        let buffers = [
            gpu.storage("rows of corners", size_of_val(&starts[..]) as u64, usage)?,
            gpu.storage("corners", bytes, usage)?,
        ];
        gpu.queue.write_buffer(&buffers[0], 0, bytemuck::cast_slice(&starts));
        gpu.queue.write_buffer(&buffers[1], 0, bytemuck::cast_slice(corners));
        gpu.queue.submit([]);
        let chunk = Chunk { count: count as u32, first: first as u32 };
        pass.add(gpu, [positions, &buffers[0], &buffers[1], normals], chunk)?;
        first += count;
    }
    Ok(pass)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_corner_is_in_the_row_of_its_vertex() {
        let triangles = [[0, 1, 2], [2, 1, 4]];
        let adjacency = Adjacency::new(6, &triangles);
        assert_eq!(adjacency.starts, [0, 1, 3, 5, 5, 6, 6]);
        assert_eq!(adjacency.corners, [[1, 2], [2, 0], [4, 2], [0, 1], [1, 4], [2, 1]]);
    }

    #[test]
    fn rows_are_never_split() {
        let adjacency = Adjacency::new(6, &[[0, 1, 2], [2, 1, 4]]);
        assert_eq!(adjacency.fitting(0, 100), 6);
        assert_eq!(adjacency.fitting(0, 3), 2);
        assert_eq!(adjacency.fitting(0, 2), 1);
        assert_eq!(adjacency.fitting(1, 1), 1);
        assert_eq!(adjacency.fitting(3, 1), 3);
    }
}
