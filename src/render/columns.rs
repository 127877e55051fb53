//! Basis columns on the device: as they are stored, in chunks of nodes.
//!
//! In: borrowed columns in one of three storages; out: a buffer per chunk in which column after column of the chunk's
//! nodes lies, each padded to four numbers, and between which displacements a column moves some nodes.

use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use std::ops::Range;
use wgpu::BufferUsages;

/// The basis columns of one control element, one after the other, 3 numbers a node. A stored number times the scale of
/// its column is metres per unit of the coefficient.
#[derive(Clone, Copy, Debug)]
pub enum ColumnData<'a> {
    F32(&'a [f32]),
    /// Bits of IEEE half precision.
    F16 {
        bits: &'a [u16],
        scales: &'a [f32],
    },
    Int16 {
        values: &'a [i16],
        scales: &'a [f32],
    },
}

/// Bytes handed to the driver before it is waited for: so much memory the upload needs beside the buffers.
const BATCH: u64 = 64 << 20;

impl ColumnData<'_> {
    /// The parts of the shader that reads this storage.
    pub(super) fn shader(&self) -> [&'static str; 3] {
        match self {
            ColumnData::F32(_) => shader::DEFORM_F32,
            ColumnData::F16 { .. } => shader::DEFORM_F16,
            ColumnData::Int16 { .. } => shader::DEFORM_INT16,
        }
    }

    pub(super) fn numbers(&self) -> usize {
        match self {
            ColumnData::F32(values) => values.len(),
            ColumnData::F16 { bits, .. } => bits.len(),
            ColumnData::Int16 { values, .. } => values.len(),
        }
    }

    /// Bytes of one number.
    pub(super) fn width(&self) -> usize {
        match self {
            ColumnData::F32(_) => 4,
            ColumnData::F16 { .. } | ColumnData::Int16 { .. } => 2,
        }
    }

    pub(super) fn scale(&self, column: usize) -> f32 {
        match self {
            ColumnData::F32(_) => 1.0,
            ColumnData::F16 { scales, .. } | ColumnData::Int16 { scales, .. } => scales[column],
        }
    }

    /// How many columns of `nodes` nodes there are, with a scale each.
    pub(super) fn count(&self, nodes: usize) -> Result<usize, RenderError> {
        let (numbers, per_column) = (self.numbers(), 3 * nodes);
        let columns = numbers / per_column;
        let scaled = match self {
            ColumnData::F32(_) => true,
            ColumnData::F16 { scales, .. } | ColumnData::Int16 { scales, .. } => scales.len() == columns,
        };
        if numbers % per_column == 0 && scaled {
            Ok(columns)
        } else {
            Err(RenderError::ColumnLength { numbers, per_column })
        }
    }

    /// Least and largest displacement of some nodes, of `all`, along each axis, m per unit of the column's coefficient.
    pub(super) fn extent(&self, column: usize, nodes: &[u32], all: usize) -> [[f32; 3]; 2] {
        let part = column * 3 * all..(column + 1) * 3 * all;
        let [a, b] = match self {
            ColumnData::F32(values) => extent(&values[part], nodes, |x| x),
            ColumnData::F16 { bits, .. } => {
                extent(&bits[part], nodes, |bits| half::f16::from_bits(bits).to_f32())
            }
            ColumnData::Int16 { values, .. } => extent(&values[part], nodes, f32::from),
        };
        let [a, b] = [a, b].map(|end| end.map(|x| x * self.scale(column)));
        [[0, 1, 2].map(|axis| a[axis].min(b[axis])), [0, 1, 2].map(|axis| a[axis].max(b[axis]))]
    }

    /// Numbers `part` of one column, as they lie in memory.
    fn bytes(&self, part: Range<usize>) -> &[u8] {
        match self {
            ColumnData::F32(values) => bytemuck::cast_slice(&values[part]),
            ColumnData::F16 { bits, .. } => bytemuck::cast_slice(&bits[part]),
            ColumnData::Int16 { values, .. } => bytemuck::cast_slice(&values[part]),
        }
    }
}

fn extent<T: Copy>(column: &[T], nodes: &[u32], number: impl Fn(T) -> f32) -> [[f32; 3]; 2] {
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

/// All columns of the elements for the nodes of one chunk, in one buffer.
pub(super) fn upload(
    gpu: &Gpu,
    elements: &[ColumnData<'_>],
    nodes: usize,
    chunk: Range<usize>,
) -> Result<wgpu::Buffer, RenderError> {
    let numbers = 3 * chunk.len();
    let width = elements.first().map_or(4, ColumnData::width);
    let padded = numbers.next_multiple_of(4) * width;
    let columns: usize = elements.iter().map(|element| element.numbers() / (3 * nodes)).sum();
    // A body without columns still binds a buffer.
    let bytes = ((columns * padded) as u64).max(16);
    let buffer = gpu.storage("basis columns", bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST)?;
    let (mut at, mut waiting) = (0, 0);
    for element in elements {
        for column in 0..element.numbers() / (3 * nodes) {
            let first = 3 * (column * nodes + chunk.start);
            let data = element.bytes(first..first + numbers);
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
        assert_eq!(ColumnData::F32(&values).extent(1, &[0], 1), [[0.5, -2.0, 0.25]; 2]);
        let expected = [[-0.75, -2.0, 0.0], [0.5, 1.0, 0.25]];
        assert_eq!(ColumnData::F32(&values).extent(0, &[1, 2], 3), expected);
        let doubled = expected.map(|end| end.map(|x| 2.0 * x));
        assert_eq!(ColumnData::F16 { bits: &halves, scales: &scales }.extent(0, &[1, 2], 3), doubled);
        let hundreds = doubled.map(|end| end.map(|x| 100.0 * x));
        assert_eq!(ColumnData::Int16 { values: &integers, scales: &scales }.extent(0, &[2, 1], 3), hundreds);
    }

    #[test]
    fn columns_that_do_not_fit_the_body_are_refused() {
        let values = [0.0_f32; 18];
        assert_eq!(ColumnData::F32(&values).count(3).unwrap(), 2);
        assert!(ColumnData::F32(&values[1..]).count(3).is_err());
        assert!(ColumnData::Int16 { values: &[0; 18], scales: &[1.0] }.count(3).is_err());
    }
}
