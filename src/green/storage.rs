//! How the basis columns are stored: in single precision, or in half the bytes with an error that is known.
//!
//! In: the f64 columns of one control element. Out: bytes, a scale per field, and the largest error per field,
//! measured against the f64 columns. Online, half the bytes are also half the time, which goes on reading them.

use super::control::FIELDS;
use crate::scene::Storage;
use half::f16;

/// The twelve columns of one control element as they are stored, one after the other, 3 numbers a node. Stored numbers
/// times the field's scale are metres per unit of the field.
#[derive(Clone, Copy, Debug)]
pub enum Basis<'a> {
    F32(&'a [f32]),
    /// Bits of IEEE half precision, of magnitude 1 at most.
    F16 {
        bits: &'a [u16],
        scales: &'a [f32],
    },
    Int16 {
        values: &'a [i16],
        scales: &'a [f32],
    },
}

impl Basis<'_> {
    /// Number `i` of field `k`, m per unit of the field; `nodes` surface nodes.
    pub fn value(&self, nodes: usize, k: usize, i: usize) -> f32 {
        let at = 3 * nodes * k + i;
        match self {
            Basis::F32(values) => values[at],
            Basis::F16 { bits, scales } => half_to_single(bits[at]) * scales[k],
            Basis::Int16 { values, scales } => f32::from(values[at]) * scales[k],
        }
    }

    /// Bytes of one number.
    pub fn width(&self) -> usize {
        match self {
            Basis::F32(_) => 4,
            Basis::F16 { .. } | Basis::Int16 { .. } => 2,
        }
    }
}

/// The single of half-precision bits that are neither infinite nor NaN, by integer shifts and one exact product, so
/// that a loop of it is vectorised.
#[inline(always)]
pub fn half_to_single(bits: u16) -> f32 {
    const TWO_TO_112: f32 = f32::from_bits(0x7780_0000);
    let magnitude = f32::from_bits(u32::from(bits & 0x7fff) << 13) * TWO_TO_112;
    f32::from_bits(magnitude.to_bits() | u32::from(bits & 0x8000) << 16)
}

/// Columns in their stored form.
pub struct Stored {
    pub bytes: Vec<u8>,
    /// Per field; empty where numbers are stored as they are.
    pub scales: Vec<f32>,
    /// Largest |stored - exact| of each field, m per unit of the field.
    pub errors: Vec<f64>,
    /// Largest |exact| of each field.
    pub sizes: Vec<f64>,
}

impl Stored {
    /// Stores field after field of `columns`, twelve of equal length.
    pub fn new(storage: Storage, columns: &[Vec<f64>]) -> Stored {
        let mut stored = Stored {
            bytes: Vec::new(),
            scales: Vec::new(),
            errors: Vec::with_capacity(FIELDS),
            sizes: Vec::with_capacity(FIELDS),
        };
        for column in columns {
            let size = column.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            let unit = if size == 0.0 { 1.0 } else { size };
            let error = match storage {
                Storage::F32 => stored.push(column, |x| x as f32, f32::to_le_bytes, f64::from),
                Storage::F16 => {
                    let scale = unit as f32;
                    stored.scales.push(scale);
                    let scale = f64::from(scale);
                    let back = |h: f16| f64::from(half_to_single(h.to_bits())) * scale;
                    stored.push(column, |x| f16::from_f64(x / scale), f16::to_le_bytes, back)
                }
                Storage::Int16 => {
                    let scale = (unit / f64::from(i16::MAX)) as f32;
                    stored.scales.push(scale);
                    let scale = f64::from(scale);
                    stored.push(
                        column,
                        |x| (x / scale).round() as i16,
                        i16::to_le_bytes,
                        |q| f64::from(q) * scale,
                    )
                }
            };
            stored.errors.push(error);
            stored.sizes.push(size);
        }
        stored
    }

    /// One column as it is read again, m.
    pub fn rounded(storage: Storage, column: &[f64]) -> Vec<f64> {
        let stored = Stored::new(storage, std::slice::from_ref(&column.to_vec()));
        let scale = f64::from(stored.scales.first().copied().unwrap_or(1.0));
        match storage {
            Storage::F32 => column.iter().map(|x| f64::from(*x as f32)).collect(),
            Storage::F16 => {
                let halves =
                    stored.bytes.chunks_exact(2).map(|b| half_to_single(u16::from_le_bytes([b[0], b[1]])));
                halves.map(|h| f64::from(h) * scale).collect()
            }
            Storage::Int16 => {
                let integers = stored.bytes.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]]));
                integers.map(|q| f64::from(q) * scale).collect()
            }
        }
    }

    fn push<T: Copy, const N: usize>(
        &mut self,
        column: &[f64],
        store: impl Fn(f64) -> T,
        bytes: impl Fn(T) -> [u8; N],
        back: impl Fn(T) -> f64,
    ) -> f64 {
        let mut error: f64 = 0.0;
        for &x in column {
            let stored = store(x);
            error = error.max((back(stored) - x).abs());
            self.bytes.extend(bytes(stored));
        }
        error
    }

    /// The largest error of a field as a part of its largest displacement.
    pub fn relative_error(&self) -> f64 {
        let parts = self.errors.iter().zip(&self.sizes).filter(|(_, size)| **size > 0.0);
        parts.map(|(error, size)| error / size).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_is_converted_exactly() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            if half.is_finite() {
                assert_eq!(half_to_single(bits).to_bits(), half.to_f32().to_bits(), "{bits:#x}");
            }
        }
    }

    /// Rounding is half a unit in the last place of the largest number, or less.
    #[test]
    fn errors_are_those_of_the_format_at_any_size() {
        for size in [1e-12, 1.0, 3.7e8] {
            let columns: Vec<Vec<f64>> = (0..FIELDS)
                .map(|k| (0..3000).map(|i| size * ((i * (k + 1)) as f64 * 0.7).sin()).collect())
                .collect();
            for (storage, bound, width) in
                [(Storage::F32, 6e-8, 4), (Storage::F16, 2.5e-4, 2), (Storage::Int16, 1.6e-5, 2)]
            {
                let stored = Stored::new(storage, &columns);
                let error = stored.relative_error();
                assert!(error < bound && error > 0.1 * bound, "{storage:?} of {size}: {error:e}");
                assert_eq!(stored.bytes.len(), width * FIELDS * 3000);
            }
        }
        let nothing = Stored::new(Storage::Int16, &vec![vec![0.0; 6]; FIELDS]);
        assert_eq!((nothing.relative_error(), nothing.bytes), (0.0, vec![0; 2 * 6 * FIELDS]));
    }
}
