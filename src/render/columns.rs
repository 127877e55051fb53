//! Columns on the device: as they are stored, in chunks of nodes.
//!
//! In: borrowed groups of columns in one storage; out: a buffer per chunk in which column after column of the chunk's
//! nodes lies, each padded to four numbers, and between which displacements a column moves some nodes.

use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use crate::base::columns::{ColumnGroup, Storage, half_to_single};
use std::ops::Range;
use wgpu::BufferUsages;

/// Bytes handed to the driver before it is waited for: the memory that the upload needs beside the buffers.
const BATCH: u64 = 64 << 20;

/// The parts of the shader that reads a storage.
pub(super) fn shader(storage: Storage) -> [&'static str; 3] {
    match storage {
        Storage::F32 => shader::DEFORM_F32,
        Storage::F16 => shader::DEFORM_F16,
        Storage::Int16 | Storage::Within(_) => shader::DEFORM_INT16,
    }
}

/// Number of columns of `nodes` nodes in a group.
pub(super) fn count(group: &ColumnGroup<'_>, nodes: usize) -> Result<usize, RenderError> {
    let (numbers, per_column) = (group.numbers(), 3 * nodes);
    group.columns(nodes).ok_or(RenderError::ColumnLength { numbers, per_column })
}

/// Least and largest displacement of some nodes, of `all`, along each axis, m per unit of the column's coefficient.
pub(super) fn extent(group: &ColumnGroup<'_>, column: usize, nodes: &[u32], all: usize) -> [[f32; 3]; 2] {
    let part = column * 3 * all..(column + 1) * 3 * all;
    let [a, b] = match group {
        ColumnGroup::F32(values) => extent_of(&values[part], nodes, |x| x),
        ColumnGroup::F16 { bits, .. } => extent_of(&bits[part], nodes, half_to_single),
        ColumnGroup::Int16 { values, .. } => extent_of(&values[part], nodes, f32::from),
    };
    let [a, b] = [a, b].map(|end| end.map(|x| x * group.scale(column)));
    [[0, 1, 2].map(|axis| a[axis].min(b[axis])), [0, 1, 2].map(|axis| a[axis].max(b[axis]))]
}

fn extent_of<T: Copy>(column: &[T], nodes: &[u32], number: impl Fn(T) -> f32) -> [[f32; 3]; 2] {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for &node in nodes {
        for axis in 0..3 {
            let x = number(column[3 * node as usize + axis]);
            low[axis] = if x < low[axis] { x } else { low[axis] };
            high[axis] = if x > high[axis] { x } else { high[axis] };
        }
    }
    [low, high]
}

/// All columns of the groups for the nodes of one chunk, in one buffer.
pub(super) fn upload(
    gpu: &Gpu,
    groups: &[ColumnGroup<'_>],
    nodes: usize,
    chunk: Range<usize>,
) -> Result<wgpu::Buffer, RenderError> {
    let numbers = 3 * chunk.len();
    let width = groups.first().map_or(4, |group| group.storage().width());
    let padded = numbers.next_multiple_of(4) * width;
    let columns: usize = groups.iter().map(|group| group.numbers() / (3 * nodes)).sum();
    // A body without columns still binds a buffer.
    let bytes = ((columns * padded) as u64).max(16);
    let buffer = gpu.storage("columns", bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST)?;
    let (mut at, mut waiting) = (0, 0);
    for group in groups {
        for column in 0..group.numbers() / (3 * nodes) {
            let first = 3 * (column * nodes + chunk.start);
            let data = group.bytes(first..first + numbers);
            // A write is of whole words; halves of an odd number of nodes end within one.
            let (words, rest) = data.split_at(data.len() / 4 * 4);
            gpu.queue.write_buffer(&buffer, at, words);
            if !rest.is_empty() {
                let mut word = [0; 4];
                word[..rest.len()].copy_from_slice(rest);
                gpu.queue.write_buffer(&buffer, at + words.len() as u64, &word);
            }
            at += padded as u64;
            waiting += padded as u64;
            if waiting >= BATCH {
                gpu.queue.submit([]);
                gpu.wait()?;
                waiting = 0;
            }
        }
    }
    gpu.queue.submit([]);
    gpu.wait()?;
    Ok(buffer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extent_of_a_column_at_some_nodes_is_found_in_every_storage() {
        let values = [0.0_f32, 9.0, 0.0, 0.5, -2.0, 0.25, -0.75, 1.0, 0.0];
        let halves: Vec<u16> = values.iter().map(|x| half::f16::from_f32(*x).to_bits()).collect();
        let integers: Vec<i16> = values.iter().map(|x| (*x * 100.0) as i16).collect();
        let scales = [2.0; 3];
        assert_eq!(extent(&ColumnGroup::F32(&values), 1, &[0], 1), [[0.5, -2.0, 0.25]; 2]);
        let expected = [[-0.75, -2.0, 0.0], [0.5, 1.0, 0.25]];
        assert_eq!(extent(&ColumnGroup::F32(&values), 0, &[1, 2], 3), expected);
        let doubled = expected.map(|end| end.map(|x| 2.0 * x));
        let group = ColumnGroup::F16 { bits: &halves, scales: &scales };
        assert_eq!(extent(&group, 0, &[1, 2], 3), doubled);
        let hundreds = doubled.map(|end| end.map(|x| 100.0 * x));
        let group = ColumnGroup::Int16 { values: &integers, scales: &scales };
        assert_eq!(extent(&group, 0, &[2, 1], 3), hundreds);
    }
}
