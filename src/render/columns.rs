//! Basis columns on the device: as they are stored, in chunks of nodes.
//!
//! In: borrowed columns in one of three storages; out: a buffer per chunk in which column after column of the chunk's
//! nodes lies, each padded to four numbers, and how far each column moves any node.

use super::{Gpu, RenderError, shader};
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

    fn numbers(&self) -> usize {
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

    /// Largest |number| of a column along each axis, not scaled.
    pub(super) fn largest(&self, column: usize, nodes: usize) -> [f32; 3] {
        let part = column * 3 * nodes..(column + 1) * 3 * nodes;
        match self {
            ColumnData::F32(values) => largest(&values[part], f32::abs),
            // Without their sign, halves are ordered as their bits are.
            ColumnData::F16 { bits, .. } => {
                largest(&bits[part], |bits| bits & 0x7fff).map(|bits| half::f16::from_bits(bits).to_f32())
            }
            ColumnData::Int16 { values, .. } => largest(&values[part], i16::unsigned_abs).map(f32::from),
        }
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

fn largest<T: Copy, M: PartialOrd + Copy + Default>(column: &[T], size: impl Fn(T) -> M) -> [M; 3] {
    let mut most = [M::default(); 3];
    for node in column.chunks_exact(3) {
        for (most, &number) in most.iter_mut().zip(node) {
            let size = size(number);
            *most = if size > *most { size } else { *most };
        }
    }
    most
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
    fn the_largest_displacement_of_a_column_is_found_in_every_storage() {
        let values = [0.0_f32, 9.0, 0.0, 0.5, -2.0, 0.25, -0.75, 1.0, 0.0];
        let halves: Vec<u16> = values.iter().map(|x| half::f16::from_f32(*x).to_bits()).collect();
        let integers: Vec<i16> = values.iter().map(|x| (*x * 100.0) as i16).collect();
        let scales = [1.0; 3];
        assert_eq!(ColumnData::F32(&values).largest(1, 1), [0.5, 2.0, 0.25]);
        assert_eq!(ColumnData::F16 { bits: &halves, scales: &scales }.largest(2, 1), [0.75, 1.0, 0.0]);
        assert_eq!(
            ColumnData::Int16 { values: &integers, scales: &scales }.largest(0, 3),
            [75.0, 900.0, 25.0]
        );
    }

    #[test]
    fn columns_that_do_not_fit_the_body_are_refused() {
        let values = [0.0_f32; 18];
        assert_eq!(ColumnData::F32(&values).count(3).unwrap(), 2);
        assert!(ColumnData::F32(&values[1..]).count(3).is_err());
        assert!(ColumnData::Int16 { values: &[0; 18], scales: &[1.0] }.count(3).is_err());
    }
}
