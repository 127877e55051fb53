//! A body in parts, so that no buffer is larger than the device binds; the compute passes share this.
//!
//! In: the largest number of items of a part. Out: parts without gaps, a uniform for each, and one dispatch per part.

use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use std::ops::Range;
use wgpu::BufferUsages;

/// Threads of a workgroup in every compute shader.
pub(super) const WORKGROUP: u32 = 64;

/// `Chunk` of `shaders/common/chunk.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Chunk {
    pub(super) count: u32,
    pub(super) first: u32,
}

/// One dispatch: its buffers bound, its items counted.
pub(super) struct Dispatch {
    group: wgpu::BindGroup,
    items: u32,
}

/// A compute pipeline whose bindings are 0 to 2 read, 3 written and 4 the [`Chunk`], with its dispatches.
pub(super) struct ComputePass {
    pub(super) label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    dispatches: Vec<Dispatch>,
}

/// `0..all` in ranges of at most `most` items, each but the last a multiple of `step`.
pub(super) fn ranges(all: usize, most: usize, step: usize) -> impl Iterator<Item = Range<usize>> {
    let length = (most / step * step).max(step);
    (0..all).step_by(length).map(move |start| start..(start + length).min(all))
}

impl ComputePass {
    pub(super) fn new(gpu: &Gpu, label: &'static str, parts: &[&str]) -> ComputePass {
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let entry = |binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: buffer(match binding {
                4 => wgpu::BufferBindingType::Uniform,
                _ => wgpu::BufferBindingType::Storage { read_only: binding != 3 },
            }),
            count: None,
        };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &[0, 1, 2, 3, 4].map(entry),
        });
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = shader::module(&gpu.device, label, &parts.concat());
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("compute"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        gpu.made.count_pipeline();
        ComputePass { label, pipeline, layout, dispatches: Vec::new() }
    }

    /// One more dispatch: a thread for each item of `chunk`.
    pub(super) fn add(
        &mut self,
        gpu: &Gpu,
        buffers: [&wgpu::Buffer; 4],
        chunk: Chunk,
    ) -> Result<(), RenderError> {
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("chunk of a body", size_of::<Chunk>() as u64, usage)?;
        gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&chunk));
        let [a, b, c, d] = buffers;
        let entries: Vec<_> = [a, b, c, d, &uniform]
            .iter()
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.layout,
            entries: &entries,
        });
        self.dispatches.push(Dispatch { group, items: chunk.count });
        Ok(())
    }

    /// A thread for each row of `items`, in as many dispatches as the device's limits ask for. Binding 0 is `read`, 1 where
    /// each row of the chunk starts and one more for the end, 2 the items of these rows, 3 `written`.
    pub(super) fn add_rows<T: bytemuck::Pod>(
        &mut self,
        gpu: &Gpu,
        read: &wgpu::Buffer,
        starts: &[u32],
        items: &[T],
        written: &wgpu::Buffer,
    ) -> Result<(), RenderError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let most = gpu.storage_limit as usize / size_of::<T>();
        let most_rows = most_items(gpu).min((gpu.storage_limit / 4) as usize - 1);
        let (mut first, rows) = (0, starts.len() - 1);
        while first < rows {
            let count = fitting(starts, first, most).min(most_rows);
            let bounds = &starts[first..=first + count];
            let own: Vec<u32> = bounds.iter().map(|start| start - bounds[0]).collect();
            let items = &items[bounds[0] as usize..bounds[count] as usize];
            // Rows may all be empty, and a buffer is never.
            let bytes = (size_of_val(items) as u64).max(8);
            let buffers = [
                gpu.storage("starts of rows", size_of_val(&own[..]) as u64, usage)?,
                gpu.storage("items of rows", bytes, usage)?,
            ];
            gpu.queue.write_buffer(&buffers[0], 0, bytemuck::cast_slice(&own));
            gpu.queue.write_buffer(&buffers[1], 0, bytemuck::cast_slice(items));
            gpu.queue.submit([]);
            let chunk = Chunk { count: count as u32, first: first as u32 };
            self.add(gpu, [read, &buffers[0], &buffers[1], written], chunk)?;
            first += count;
        }
        Ok(())
    }

    pub(super) fn chunks(&self) -> usize {
        self.dispatches.len()
    }

    /// All chunks, one after another.
    pub(super) fn encode(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) {
        let span = gpu.clock().and_then(|clock| clock.span(self.label));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(self.label),
            timestamp_writes: span.map(|(query_set, begin, end)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(end),
            }),
        });
        pass.set_pipeline(&self.pipeline);
        for Dispatch { group, items } in &self.dispatches {
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(items.div_ceil(WORKGROUP), 1, 1);
        }
    }
}

/// Rows from `first` on whose items fit into `most`; at least one. `starts` has one more for the end.
fn fitting(starts: &[u32], first: usize, most: usize) -> usize {
    let limit = starts[first] as usize + most;
    let end = starts.partition_point(|&start| start as usize <= limit) - 1;
    end.max(first + 1) - first
}

/// Items that one dispatch can have.
pub(super) fn most_items(gpu: &Gpu) -> usize {
    gpu.device.limits().max_compute_workgroups_per_dimension as usize * WORKGROUP as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_never_split() {
        let starts = [0, 1, 3, 5, 5, 6, 6];
        assert_eq!(fitting(&starts, 0, 100), 6);
        assert_eq!(fitting(&starts, 0, 3), 2);
        assert_eq!(fitting(&starts, 0, 2), 1);
        assert_eq!(fitting(&starts, 1, 1), 1);
        assert_eq!(fitting(&starts, 3, 1), 3);
    }

    #[test]
    fn chunks_cover_everything_once() {
        for (all, most, step) in [(1, 100, 4), (1003, 100, 4), (1000, 1000, 1), (7, 3, 4), (12, 6, 4)] {
            let ranges: Vec<_> = ranges(all, most, step).collect();
            assert!(ranges.iter().all(|r| r.start % step == 0 && r.len() <= most.max(step)), "{ranges:?}");
            let ends: Vec<usize> = ranges.iter().map(|r| r.end).collect();
            let starts: Vec<usize> = ranges.iter().map(|r| r.start).collect();
            assert_eq!(starts[0], 0);
            assert_eq!(&starts[1..], &ends[..ends.len() - 1]);
            assert_eq!(ends.last(), Some(&all));
        }
    }
}
