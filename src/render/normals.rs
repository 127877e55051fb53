//! The normals of a body on the device: for each vertex, the corners of the triangles around it.
//!
//! In: triangles, once; out: a gather over compressed rows (one row a vertex) that runs after every deformation. Its
//! twin on the CPU is `deform::vertex_normals`.

use super::chunk::ComputePass;
use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;

/// The neighbours of each vertex, a row of `corners`: the two others of every triangle around it, in their order.
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
    pass.add_rows(gpu, positions, &adjacency.starts, &adjacency.corners, normals)?;
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
}
