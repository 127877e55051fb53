//! A matrix whose numbers are multiples of one step, in as few bits as they need.
//!
//! ```text
//! step     f64
//! bits     of each tile of 8 × 8 numbers, one byte; the tiles of the last row and column are smaller
//! numbers  tile after tile, row by row, each number plus 2^(bits - 1), its lowest bit first, without gaps
//! ```
//!
//! Where large numbers stand in front, as in a basis whose first fields matter most, a tile behind takes few bits, or none.

use faer::{Mat, MatRef};

const TILE: usize = 8;
const HEAD: usize = 8;
/// Most bits of a number: with more it could not be distinguished from its neighbours.
const MOST: u8 = 50;

/// Numbers of the largest matrix that is read.
const LARGEST: usize = 1 << 24;

/// The steps of a matrix: no number needs more than [`MOST`] bits.
fn step_of(matrix: MatRef<'_, f64>, step: f64) -> f64 {
    step.max(matrix.norm_max() * 2f64.powi(3 - i32::from(MOST))).max(f64::MIN_POSITIVE)
}

/// The matrix as [`unpack`] gives it back.
pub fn rounded(matrix: MatRef<'_, f64>, step: f64) -> Mat<f64> {
    let step = step_of(matrix, step);
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| (matrix[(i, j)] / step).round() * step)
}

/// Rows and columns of each tile.
fn tiles(rows: usize, columns: usize) -> impl Iterator<Item = [std::ops::Range<usize>; 2]> {
    let across = move |row: usize| {
        let part = move |column: usize| [row..rows.min(row + TILE), column..columns.min(column + TILE)];
        (0..columns).step_by(TILE).map(part)
    };
    (0..rows).step_by(TILE).flat_map(across)
}

/// Numbers are rounded to multiples of the step.
pub fn pack(matrix: MatRef<'_, f64>, step: f64) -> Vec<u8> {
    let step = step_of(matrix, step);
    let number = |i: usize, j: usize| (matrix[(i, j)] / step).round() as i64;
    let mut bytes = step.to_le_bytes().to_vec();
    let mut stream = Vec::new();
    let (mut word, mut filled) = (0_u128, 0);
    for [rows, columns] in tiles(matrix.nrows(), matrix.ncols()) {
        let numbers = || rows.clone().flat_map(|i| columns.clone().map(move |j| (i, j)));
        let largest = numbers().map(|(i, j)| number(i, j).unsigned_abs()).max().unwrap_or(0);
        let bits = if largest == 0 { 0 } else { 65 - largest.leading_zeros() as u8 };
        bytes.push(bits);
        for (i, j) in numbers().filter(|_| bits > 0) {
            word |= u128::from((number(i, j) + (1 << (bits - 1))) as u64) << filled;
            filled += usize::from(bits);
            while filled >= 8 {
                stream.push(word as u8);
                (word, filled) = (word >> 8, filled - 8);
            }
        }
    }
    if filled > 0 {
        stream.push(word as u8);
    }
    bytes.extend(stream);
    bytes
}

/// `None` where these are not the bytes of such a matrix.
pub fn unpack(bytes: &[u8], rows: usize, columns: usize) -> Option<Mat<f64>> {
    let (head, rest) = bytes.split_first_chunk::<HEAD>()?;
    let step = f64::from_le_bytes(*head);
    rows.checked_mul(columns).filter(|&numbers| numbers <= LARGEST)?;
    let count = rows.div_ceil(TILE) * columns.div_ceil(TILE);
    let (bits, stream) = rest.split_at_checked(count)?;
    if !(step.is_finite() && step > 0.0) || bits.iter().any(|&bits| bits == 1 || bits > MOST) {
        return None;
    }
    let sizes = tiles(rows, columns).map(|[rows, columns]| rows.len() * columns.len());
    let all: usize = sizes.zip(bits).map(|(size, &bits)| size * usize::from(bits)).sum();
    if stream.len() != all.div_ceil(8) {
        return None;
    }
    let mut matrix = Mat::zeros(rows, columns);
    let (mut word, mut filled, mut at) = (0_u64, 0_usize, stream.iter());
    for ([rows, columns], &bits) in tiles(rows, columns).zip(bits).filter(|(_, bits)| **bits > 0) {
        let (width, half) = (usize::from(bits), 1_i64 << (bits - 1));
        for i in rows {
            for j in columns.clone() {
                while filled < width {
                    word |= u64::from(*at.next()?) << filled;
                    filled += 8;
                }
                let number = (word & ((1 << width) - 1)) as i64 - half;
                matrix[(i, j)] = number as f64 * step;
                (word, filled) = (word >> width, filled - width);
            }
        }
    }
    Some(matrix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_come_back_as_multiples_of_the_step_in_few_bits() {
        for (rows, columns) in [(1, 1), (8, 8), (9, 17), (96, 40), (0, 5), (3, 0)] {
            let decaying = |i: usize, j: usize| (3.0 + i as f64).sin() * (-0.3 * (i + j) as f64).exp();
            let matrix = Mat::from_fn(rows, columns, decaying);
            let bytes = pack(matrix.as_ref(), 1e-4);
            let back = unpack(&bytes, rows, columns).unwrap();
            assert_eq!(back, rounded(matrix.as_ref(), 1e-4));
            assert!((&back - &matrix).norm_max() <= 0.5001e-4);
            if rows * columns > 1000 {
                assert!(8 * bytes.len() < 4 * rows * columns, "{} bytes", bytes.len());
            }
            assert!(unpack(&bytes[..bytes.len() - 1], rows, columns).is_none());
        }
        let huge = Mat::from_fn(2, 2, |_, _| 1e300);
        assert_eq!(unpack(&pack(huge.as_ref(), 1e-300), 2, 2).unwrap(), rounded(huge.as_ref(), 1e-300));
    }

    proptest! {
        /// Whatever bytes are read, there is a matrix of finite numbers or none.
        #[test]
        fn no_bytes_are_too_much(
            mut bytes in proptest::collection::vec(any::<u8>(), 0..200),
            at in 0..200_usize, flip in any::<u8>(), rows in 0..20_usize, columns in 0..20_usize,
        ) {
            let _ = unpack(&bytes, rows, columns);
            let matrix = Mat::from_fn(rows, columns, |i, j| (i as f64 - 3.0) * (j as f64 + 0.5));
            bytes = pack(matrix.as_ref(), 0.01);
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= flip;
            }
            let _ = unpack(&bytes, rows, columns);
        }
    }
}
