//! The bytes of a .green file: a whole file in memory, aligned for numbers of eight bytes ([`Bytes`]), and a tensor before
//! it is written: a type, a shape and little-endian bytes ([`Tensor`]).
//!
//! In: an opened file and its length. Out: a copy of its bytes. A memory map would cost less, but a mapped file that
//! another program cuts short ends this one by SIGBUS.

use safetensors::tensor::Dtype;
use std::io::{Error, ErrorKind, Read, Result};

/// Bytes of the longest header.
const LARGEST_HEADER: u64 = 100_000_000;

#[derive(Debug)]
pub struct Bytes {
    words: Vec<u64>,
    length: usize,
}

impl Bytes {
    /// Reads `length` bytes, which must be all that `input` holds. An error is of the kind `OutOfMemory` where they cannot
    /// be held, of `UnexpectedEof` or `InvalidData` where there are fewer or more.
    pub fn read(input: &mut impl Read, length: u64) -> Result<Bytes> {
        let invalid = |reason: String| Error::new(ErrorKind::InvalidData, reason);
        let mut head = [0; 8];
        input.read_exact(&mut head)?;
        // Before memory is taken for it: a file with a hole for its content may claim any length.
        let header = u64::from_le_bytes(head);
        if header == 0 || header > length.saturating_sub(8) {
            let reason = format!("it is cut short or damaged (a header of {header} in {length} bytes)");
            return Err(invalid(reason));
        }
        let too_large = |error: &dyn std::fmt::Display| {
            let gigabytes = length as f64 * 1e-9;
            let reason = format!(
                "its {length} bytes ({gigabytes:.2} GB) do not fit into memory ({error}). Write storage = \
                 \"int16\", or take a coarser mesh"
            );
            Error::new(ErrorKind::OutOfMemory, reason)
        };
        let length = usize::try_from(length).map_err(|error| too_large(&error))?;
        let count = length.div_ceil(8);
        let mut words: Vec<u64> = Vec::new();
        words.try_reserve_exact(count).map_err(|error| too_large(&error))?;
        words.resize(count, 0);
        let all = &mut bytemuck::cast_slice_mut(&mut words)[..length];
        all[..8].copy_from_slice(&head);
        input.read_exact(&mut all[8..])?;
        if input.read(&mut [0])? > 0 {
            return Err(invalid("it grew while it was read".into()));
        }
        Ok(Bytes { words, length })
    }

    /// The first bytes of a file, up to the end of its header; errors as [`Bytes::read`].
    pub fn header(input: &mut impl Read, length: u64) -> Result<Vec<u8>> {
        let mut head = [0; 8];
        input.read_exact(&mut head)?;
        let header = u64::from_le_bytes(head);
        // As much as safetensors reads.
        if header == 0 || header > length.saturating_sub(8).min(LARGEST_HEADER) {
            let reason = format!("it is cut short or damaged (a header of {header} in {length} bytes)");
            return Err(Error::new(ErrorKind::InvalidData, reason));
        }
        let mut bytes = head.to_vec();
        match input.take(header).read_to_end(&mut bytes)? as u64 == header {
            true => Ok(bytes),
            false => Err(ErrorKind::UnexpectedEof.into()),
        }
    }

    pub fn as_slice(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.length]
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    pub bytes: Vec<u8>,
}

/// A number that tensors are made of.
pub trait Number: Copy {
    const DTYPE: Dtype;
    fn to_bytes(self) -> impl IntoIterator<Item = u8>;
}

macro_rules! number {
    ($($number:ty: $dtype:ident),*) => {
        $(impl Number for $number {
            const DTYPE: Dtype = Dtype::$dtype;

            fn to_bytes(self) -> impl IntoIterator<Item = u8> {
                self.to_le_bytes()
            }
        })*
    };
}

number!(u8: U8, f32: F32, f64: F64, u32: U32, u64: U64);

impl Tensor {
    /// `numbers` row by row; as many as the shape has places.
    pub fn new<T: Number>(shape: &[usize], numbers: impl IntoIterator<Item = T>) -> Tensor {
        let bytes = numbers.into_iter().flat_map(T::to_bytes).collect();
        Tensor { dtype: T::DTYPE, shape: shape.to_vec(), bytes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_aligned_and_whole() {
        let file = [&5_u64.to_le_bytes()[..], b"hello", b"world, "].concat();
        let bytes = Bytes::read(&mut file.as_slice(), file.len() as u64).unwrap();
        assert_eq!(bytes.as_slice(), file);
        assert!((bytes.as_slice().as_ptr() as usize).is_multiple_of(8));
    }

    #[test]
    fn what_changes_while_it_is_read_is_refused() {
        let file = [&5_u64.to_le_bytes()[..], b"hello"].concat();
        let read = |length: u64| Bytes::read(&mut file.as_slice(), length).unwrap_err();
        assert_eq!(read(14).kind(), ErrorKind::UnexpectedEof);
        assert!(read(12).to_string().contains("a header of 5 in 12 bytes"));
        let longer = [&file[..], b"!"].concat();
        let error = Bytes::read(&mut longer.as_slice(), 13).unwrap_err();
        assert!(error.to_string().contains("it grew"), "{error}");
    }

    /// An allocation that fails ends no program: the error names the size. A file of holes is refused before memory is taken.
    #[test]
    fn what_memory_cannot_hold_is_told_with_its_size() {
        let length = u64::MAX >> 1;
        let error = Bytes::read(&mut 5_u64.to_le_bytes().as_slice(), length).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::OutOfMemory);
        assert!(error.to_string().contains("9223372036854775807 bytes (9223372036.85 GB)"), "{error}");
        let error = Bytes::read(&mut std::io::repeat(0), length).unwrap_err();
        assert!(error.to_string().contains("a header of 0 in"), "{error}");
    }
}
