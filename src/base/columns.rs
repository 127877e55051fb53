//! Stores columns of displacements in single precision, or in half the bytes with a known error.
//!
//! In: f64 columns, or stored numbers in any memory. Out: [`StoredColumns`], which own their numbers and know their errors,
//! and [`ColumnGroup`], a view of them that the .green file, the sum on the CPU and the renderer share.

use half::f16;
use serde::{Deserialize, Serialize};
use std::ops::{Range, RangeInclusive};

/// Prefix of the name of a storage within an error.
const WITHIN: &str = "error ";

/// Numbers of the precomputed displacements in the .green file and in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Storage {
    /// Single precision.
    #[default]
    F32,
    /// Half precision, scaled per column: half the bytes, an error of 2.5e-4 of each column's largest displacement.
    F16,
    /// 16-bit integers, scaled per column: half the bytes, an error of 2e-5.
    Int16,
    /// 16-bit integers with steps as coarse as this error allows, which pack the smaller: a part of each column's largest
    /// displacement.
    #[serde(rename = "error")]
    Within(f64),
}

impl Storage {
    /// The storages that need no number.
    pub const ALL: [Storage; 3] = [Storage::F32, Storage::F16, Storage::Int16];
    /// The errors that can be asked for: the least is that of the 16 bits.
    pub const ERRORS: RangeInclusive<f64> = 1.6e-5..=1e-2;

    pub fn name(self) -> String {
        match self {
            Storage::F32 => "f32".to_owned(),
            Storage::F16 => "f16".to_owned(),
            Storage::Int16 => "int16".to_owned(),
            Storage::Within(error) => format!("{WITHIN}{error:e}"),
        }
    }

    /// The storage of this [`name`](Storage::name).
    pub fn named(name: &str) -> Option<Storage> {
        let within = || name.strip_prefix(WITHIN)?.parse().ok().map(Storage::Within);
        Storage::ALL.into_iter().find(|known| known.name() == name).or_else(within)
    }

    /// The error says what is wrong with the error that was asked for.
    pub fn check(self) -> Result<(), String> {
        match self {
            Storage::Within(error) if !Storage::ERRORS.contains(&error) => Err(format!(
                "error = {error:e} must lie between {:e} and {:e} of each field's largest displacement. For less \
                 write storage = \"f32\"",
                Storage::ERRORS.start(),
                Storage::ERRORS.end()
            )),
            _ => Ok(()),
        }
    }

    /// Bytes of one number.
    pub fn width(self) -> usize {
        match self {
            Storage::F32 => 4,
            Storage::F16 | Storage::Int16 | Storage::Within(_) => 2,
        }
    }
}

/// Stored columns that belong together, such as the twelve of one control element: one after the other, 3 numbers a node.
/// A stored number times the scale of its column is metres per unit of the column's coefficient.
#[derive(Clone, Copy, Debug)]
pub enum ColumnGroup<'a> {
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

impl ColumnGroup<'_> {
    pub fn storage(&self) -> Storage {
        match self {
            ColumnGroup::F32(_) => Storage::F32,
            ColumnGroup::F16 { .. } => Storage::F16,
            ColumnGroup::Int16 { .. } => Storage::Int16,
        }
    }

    /// Stored numbers of all its columns.
    pub fn numbers(&self) -> usize {
        match self {
            ColumnGroup::F32(values) => values.len(),
            ColumnGroup::F16 { bits, .. } => bits.len(),
            ColumnGroup::Int16 { values, .. } => values.len(),
        }
    }

    /// Number of columns of `nodes` nodes in it; `None` where they are not whole or lack a scale.
    pub fn columns(&self, nodes: usize) -> Option<usize> {
        let per_column = 3 * nodes;
        let columns = self.numbers().checked_div(per_column)?;
        let is_scaled = match self {
            ColumnGroup::F32(_) => true,
            ColumnGroup::F16 { scales, .. } | ColumnGroup::Int16 { scales, .. } => scales.len() == columns,
        };
        (columns * per_column == self.numbers() && is_scaled).then_some(columns)
    }

    pub fn scale(&self, column: usize) -> f32 {
        match self {
            ColumnGroup::F32(_) => 1.0,
            ColumnGroup::F16 { scales, .. } | ColumnGroup::Int16 { scales, .. } => scales[column],
        }
    }

    /// Number `i` of a column of `nodes` nodes, m per unit of its coefficient.
    pub fn value(&self, nodes: usize, column: usize, i: usize) -> f32 {
        let at = 3 * nodes * column + i;
        match self {
            ColumnGroup::F32(values) => values[at],
            ColumnGroup::F16 { bits, scales } => half_to_single(bits[at]) * scales[column],
            ColumnGroup::Int16 { values, scales } => f32::from(values[at]) * scales[column],
        }
    }

    /// Some of its numbers, as they lie in memory.
    pub fn bytes(&self, part: Range<usize>) -> &[u8] {
        match self {
            ColumnGroup::F32(values) => bytemuck::cast_slice(&values[part]),
            ColumnGroup::F16 { bits, .. } => bytemuck::cast_slice(&bits[part]),
            ColumnGroup::Int16 { values, .. } => bytemuck::cast_slice(&values[part]),
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

/// A group of columns that owns its numbers, with what storing them cost in accuracy.
#[derive(Clone, Debug)]
pub struct StoredColumns {
    numbers: Numbers,
    /// Scale of each column; empty where numbers are stored as they are.
    pub scales: Vec<f32>,
    /// Largest |stored - exact| of each column, m per unit of its coefficient.
    pub errors: Vec<f64>,
    /// Largest |exact| of each column.
    pub sizes: Vec<f64>,
}

#[derive(Clone, Debug)]
enum Numbers {
    F32(Vec<f32>),
    F16(Vec<u16>),
    Int16(Vec<i16>),
}

impl StoredColumns {
    /// Stores `columns`, all of equal length, one after the other.
    pub fn new(storage: Storage, columns: &[Vec<f64>]) -> StoredColumns {
        let mut numbers = match storage {
            Storage::F32 => Numbers::F32(Vec::new()),
            Storage::F16 => Numbers::F16(Vec::new()),
            Storage::Int16 | Storage::Within(_) => Numbers::Int16(Vec::new()),
        };
        let (mut scales, mut errors, mut sizes) = (Vec::new(), Vec::new(), Vec::new());
        for column in columns {
            let size = column.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            let unit = if size == 0.0 { 1.0 } else { size };
            let mut scaled_by = |scale: f64| {
                let scale = scale as f32;
                scales.push(scale);
                f64::from(scale)
            };
            errors.push(match &mut numbers {
                Numbers::F32(all) => push(all, column, |x| x as f32, f64::from),
                Numbers::F16(all) => {
                    let scale = scaled_by(unit);
                    let back = |bits| f64::from(half_to_single(bits)) * scale;
                    push(all, column, |x| f16::from_f64(x / scale).to_bits(), back)
                }
                Numbers::Int16(all) => {
                    let scale = scaled_by(match storage {
                        // Rounding to single precision must not make the step longer.
                        Storage::Within(error) => 2.0 * error * unit * (1.0 - f64::from(f32::EPSILON)),
                        _ => unit / f64::from(i16::MAX),
                    });
                    push(all, column, |x| (x / scale).round() as i16, |q| f64::from(q) * scale)
                }
            });
            sizes.push(size);
        }
        StoredColumns { numbers, scales, errors, sizes }
    }

    pub fn group(&self) -> ColumnGroup<'_> {
        let scales = &self.scales;
        match &self.numbers {
            Numbers::F32(values) => ColumnGroup::F32(values),
            Numbers::F16(bits) => ColumnGroup::F16 { bits, scales },
            Numbers::Int16(values) => ColumnGroup::Int16 { values, scales },
        }
    }

    /// The stored numbers in little-endian order.
    pub fn into_bytes(self) -> Vec<u8> {
        match self.numbers {
            Numbers::F32(values) => values.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Numbers::F16(bits) => bits.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Numbers::Int16(values) => values.iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }

    /// One column as it is read again, m.
    pub fn rounded(storage: Storage, column: &[f64]) -> Vec<f64> {
        let stored = StoredColumns::new(storage, std::slice::from_ref(&column.to_vec()));
        let scale = f64::from(stored.scales.first().copied().unwrap_or(1.0));
        match &stored.numbers {
            Numbers::F32(values) => values.iter().map(|x| f64::from(*x)).collect(),
            Numbers::F16(bits) => bits.iter().map(|h| f64::from(half_to_single(*h)) * scale).collect(),
            Numbers::Int16(values) => values.iter().map(|q| f64::from(*q) * scale).collect(),
        }
    }

    /// The largest error of a column as a part of its largest displacement.
    pub fn relative_error(&self) -> f64 {
        let parts = self.errors.iter().zip(&self.sizes).filter(|(_, size)| **size > 0.0);
        parts.map(|(error, size)| error / size).fold(0.0, f64::max)
    }
}

/// Appends a column as `store` writes it; returns its largest error as `back` reads it.
fn push<T: Copy>(all: &mut Vec<T>, column: &[f64], store: impl Fn(f64) -> T, back: impl Fn(T) -> f64) -> f64 {
    let mut error: f64 = 0.0;
    for &x in column {
        let stored = store(x);
        error = error.max((back(stored) - x).abs());
        all.push(stored);
    }
    error
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
        const COLUMNS: usize = 12;
        for size in [1e-12, 1.0, 3.7e8] {
            let columns: Vec<Vec<f64>> = (0..COLUMNS)
                .map(|k| (0..3000).map(|i| size * ((i * (k + 1)) as f64 * 0.7).sin()).collect())
                .collect();
            let within = [1.6e-5, 1e-4, 1e-2].map(|error| (Storage::Within(error), error));
            let known = [(Storage::F32, 6e-8), (Storage::F16, 2.5e-4), (Storage::Int16, 1.6e-5)];
            for (storage, bound) in known.into_iter().chain(within) {
                let stored = StoredColumns::new(storage, &columns);
                let error = stored.relative_error();
                assert!(error <= bound && error > 0.1 * bound, "{storage:?} of {size}: {error:e}");
                let group = stored.group();
                assert_eq!((group.storage().width(), group.columns(1000)), (storage.width(), Some(COLUMNS)));
                let read: Vec<f64> = (0..3000).map(|i| group.value(1000, 7, i).into()).collect();
                let rounded = StoredColumns::rounded(storage, &columns[7]);
                assert!(read.iter().zip(&rounded).all(|(a, b)| (a - b).abs() <= 1e-7 * size), "{storage:?}");
                assert_eq!(stored.into_bytes().len(), storage.width() * COLUMNS * 3000);
            }
        }
        let nothing = StoredColumns::new(Storage::Int16, &vec![vec![0.0; 6]; COLUMNS]);
        assert_eq!((nothing.relative_error(), nothing.into_bytes()), (0.0, vec![0; 2 * 6 * COLUMNS]));
    }

    #[test]
    fn a_storage_is_found_by_its_name_and_checked() {
        for storage in Storage::ALL.into_iter().chain([1.6e-5, 1e-4, 0.01].map(Storage::Within)) {
            assert_eq!((Storage::named(&storage.name()), storage.check()), (Some(storage), Ok(())));
        }
        assert_eq!([Storage::named("error"), Storage::named("int8")], [None, None]);
        for error in [1e-5, 0.02, -1e-4, f64::NAN, f64::INFINITY] {
            let told = Storage::Within(error).check().unwrap_err();
            assert!(told.contains("1.6e-5 and 1e-2"), "{told}");
        }
    }

    #[test]
    fn columns_that_are_not_whole_or_lack_a_scale_are_not_counted() {
        let values = [0.0_f32; 18];
        assert_eq!(ColumnGroup::F32(&values).columns(3), Some(2));
        assert_eq!(ColumnGroup::F32(&values[1..]).columns(3), None);
        assert_eq!(ColumnGroup::F32(&values).columns(0), None);
        assert_eq!(ColumnGroup::Int16 { values: &[0; 18], scales: &[1.0] }.columns(3), None);
    }
}
