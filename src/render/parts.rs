//! The rigid parts of a body that has several, on the device; and vertex data that advances once per instance: where a shape
//! stands, and its colour ([`Instances`]).
//!
//! In: the parts' weights of every vertex, once, and the motion of every part; out: a pass that moves the summed positions
//! in place. Its twin on the CPU is `deform::move_parts`.

use super::chunk::ComputePass;
use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use super::view::Bounds;
use crate::base::parts::{PartMotion, PartWeights};
use nalgebra::{Isometry3, Matrix3, Vector3};
use wgpu::BufferUsages;

/// The pass, and the motions that its buffer holds.
pub(super) struct PartsPass {
    pub(super) pass: ComputePass,
    motions: wgpu::Buffer,
    pub(super) last: Vec<PartMotion>,
}

impl PartsPass {
    pub(super) fn new(
        gpu: &Gpu,
        weights: &PartWeights,
        positions: &wgpu::Buffer,
    ) -> Result<PartsPass, RenderError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let last = vec![PartMotion::from(&Isometry3::identity()); weights.parts()];
        let motions = gpu.storage("motions of parts", size_of_val(&last[..]) as u64, usage)?;
        gpu.queue.write_buffer(&motions, 0, bytemuck::cast_slice(&last));
        let mut pass = ComputePass::new(gpu, "parts", &shader::PARTS);
        pass.add_rows(gpu, &motions, weights.starts(), weights.shares(), positions)?;
        Ok(PartsPass { pass, motions, last })
    }

    /// Whether the motions differ from the last ones; then they are written to the device.
    /// Errors: [`RenderError::PartCount`] unless there is one for each part.
    pub(super) fn take(&mut self, gpu: &Gpu, parts: &[Isometry3<f64>]) -> Result<bool, RenderError> {
        let (found, expected) = (parts.len(), self.last.len());
        if found != expected {
            return Err(RenderError::PartCount { found, expected });
        }
        let motions: Vec<PartMotion> = parts.iter().map(PartMotion::from).collect();
        let is_new = motions != self.last;
        if is_new {
            gpu.queue.write_buffer(&self.motions, 0, bytemuck::cast_slice(&motions));
            self.last = motions;
        }
        Ok(is_new)
    }
}

/// A box around a box of points each of which any mix of these parts moves: weights that sum to 1 keep a point between the
/// places to which the parts bring it. It is wider by what rounding may do.
pub(super) fn moved_bounds(bounds: &Bounds, parts: &[u32], motions: &[PartMotion]) -> Bounds {
    let (mut low, mut high) = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
    let mut size = Vector3::zeros();
    for motion in parts.iter().map(|&part| &motions[part as usize]) {
        let [x, y, z] = motion.rows;
        let rotation = Matrix3::new(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]).abs();
        let centre = Vector3::from(motion.apply(bounds.centre.into()));
        let half = rotation * bounds.half;
        let shift = Vector3::new(x[3], y[3], z[3]).abs();
        low = low.inf(&(centre - half));
        high = high.sup(&(centre + half));
        size = size.sup(&(rotation * bounds.centre.abs() + half + shift));
    }
    // Four products and sums a part, then as many of the weights as there are parts, which sum to 1 but for their rounding.
    let slack = size * ((2 * parts.len() + 8) as f32 * f32::EPSILON);
    Bounds { centre: (low + high) / 2.0, half: (high - low) / 2.0 + slack }
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Instance {
    pub(super) room_from_shape: [[f32; 4]; 4],
    /// Linear RGB and the share of it that glows; of bodies, how densely their pattern and hatching lie.
    pub(super) color: [f32; 4],
}

pub(super) const INSTANCE_ATTRIBUTES: [wgpu::VertexAttribute; 5] =
    wgpu::vertex_attr_array![3 => Float32x4, 4 => Float32x4, 5 => Float32x4, 6 => Float32x4, 7 => Float32x4];

pub(super) fn instance_layout() -> wgpu::VertexBufferLayout<'static> {
    wgpu::VertexBufferLayout {
        array_stride: size_of::<Instance>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &INSTANCE_ATTRIBUTES,
    }
}

/// A frame's instances; the buffer is made with the first of them, and grows with the longest list.
#[derive(Default)]
pub(super) struct Instances {
    pub(super) list: Vec<Instance>,
    buffer: Option<wgpu::Buffer>,
}

impl Instances {
    pub(super) fn upload(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        if self.list.is_empty() {
            return Ok(());
        }
        let room = self.list.len().next_power_of_two().max(16) * size_of::<Instance>();
        gpu.write_vertices(&mut self.buffer, "instances", bytemuck::cast_slice(&self.list), room)
    }

    /// Binds the instances from `first` on to a slot of vertex buffers.
    pub(super) fn bind(&self, pass: &mut wgpu::RenderPass<'_>, slot: u32, first: usize) {
        if let Some(buffer) = &self.buffer {
            pass.set_vertex_buffer(slot, buffer.slice((first * size_of::<Instance>()) as u64..));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::assert_layout;
    use super::*;
    use crate::base::parts::PartShare;

    #[test]
    fn structs_lie_as_the_shader_reads_them() {
        let source = shader::PARTS.concat();
        assert_layout!(source, "Share", PartShare: part, weight);
        assert_layout!(source, "Motion", PartMotion: rows);
    }

    #[test]
    fn a_box_holds_what_any_mix_of_its_parts_makes_of_its_corners() {
        let parts = [
            Isometry3::new(Vector3::new(1.0, 0.0, 0.5), Vector3::new(0.3, -1.2, 2.0)),
            Isometry3::new(Vector3::new(0.0, -2.0, 0.0), Vector3::new(-0.9, 0.1, 0.4)),
            Isometry3::new(Vector3::new(9.0, 9.0, 9.0), Vector3::zeros()),
        ];
        let motions: Vec<PartMotion> = parts.iter().map(PartMotion::from).collect();
        let bounds = Bounds { centre: Vector3::new(0.4, -0.1, 0.2), half: Vector3::new(0.3, 0.05, 0.6) };
        let moved = moved_bounds(&bounds, &[0, 1], &motions);
        for corner in 0..8 {
            let sign = |bit: i32| if corner & bit == 0 { -1.0 } else { 1.0 };
            let point = bounds.centre + bounds.half.component_mul(&Vector3::new(sign(1), sign(2), sign(4)));
            for share in [0.0, 0.3, 1.0] {
                let ends = [0, 1].map(|part| Vector3::from(motions[part].apply(point.into())));
                let away = (ends[0].lerp(&ends[1], share) - moved.centre).abs() - moved.half;
                assert!(away.max() <= 0.0, "{away}");
            }
        }
        assert!(moved.half.max() < 3.0, "the third part is not in it: {moved:?}");
    }

    #[test]
    fn the_colour_is_the_last_attribute() {
        assert_eq!(INSTANCE_ATTRIBUTES[4].offset as usize, std::mem::offset_of!(Instance, color));
    }
}
