//! The numbers of one array of a `.vtu` file.
//!
//! In: where the array stands and how it is encoded. Out: its numbers, one after the other; only one compressed block is
//! held in memory. After "VTK XML Formats", section "Appended and binary data": a header of lengths, then bytes, or
//! blocks that are compressed separately; base64 restarts after the header of compressed data.

use super::format::Words;
use crate::mesh::error::{FormatFault, refuse};
use crate::mesh::scalar::Scalar;
use std::io::{Cursor, Read};

/// The description of an array in the XML.
pub struct Array<'a> {
    pub name: String,
    /// `Float64`, `Int32`, …
    pub kind: String,
    pub components: usize,
    pub source: ArrayData<'a>,
    pub at: usize,
}

#[derive(Clone, Copy)]
pub enum ArrayData<'a> {
    Text(&'a [u8]),
    Base64(&'a [u8]),
    /// The offset from the start of the appended data, bytes.
    Appended(usize),
}

impl<'a> Array<'a> {
    /// Gives the array its text, which begins at `at`.
    pub fn put(&mut self, text: &'a [u8], at: usize) -> Result<(), FormatFault> {
        match &mut self.source {
            ArrayData::Text(there) | ArrayData::Base64(there) if there.is_empty() => *there = text,
            ArrayData::Appended(_) => return Ok(()),
            _ => return refuse(at, "a second text within one array"),
        }
        self.at = at;
        Ok(())
    }

    fn scalar(&self) -> Result<Scalar, FormatFault> {
        Ok(match self.kind.as_str() {
            "Int8" => Scalar::I8,
            "UInt8" => Scalar::U8,
            "Int16" => Scalar::I16,
            "UInt16" => Scalar::U16,
            "Int32" => Scalar::I32,
            "UInt32" => Scalar::U32,
            "Int64" => Scalar::I64,
            "UInt64" => Scalar::U64,
            "Float32" => Scalar::F32,
            "Float64" => Scalar::F64,
            other => {
                return refuse(self.at, format!("numbers of type `{}` are not read", other.escape_debug()));
            }
        })
    }
}

/// The encoding of the bytes of a file's arrays.
pub struct Coding<'a> {
    bytes: &'a [u8],
    pub big_endian: bool,
    /// Lengths have 8 bytes, else 4.
    pub wide: bool,
    pub compressor: Option<String>,
    /// The appended data, behind the mark `_`, and its offset; whether it is base64.
    appended: Option<(&'a [u8], usize, bool)>,
    /// Bytes that may still come out of compressed blocks.
    budget: u64,
}

impl<'a> Coding<'a> {
    /// Compressed arrays may decode to this many times the size of the file. Real meshes reach 10, a zip bomb 1000.
    const MOST_INFLATION: u64 = 64;

    pub fn new(bytes: &'a [u8]) -> Coding<'a> {
        let budget = (bytes.len() as u64).saturating_mul(Coding::MOST_INFLATION);
        Coding { bytes, big_endian: false, wide: false, compressor: None, appended: None, budget }
    }

    /// The appended data begins somewhere from `at` on.
    pub fn appended(&mut self, at: usize, encoding: Option<String>) -> Result<(), FormatFault> {
        let rest = self.bytes.get(at..).unwrap_or_default();
        let white = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        let Some(data) = rest[white..].strip_prefix(b"_") else {
            return refuse(at, "appended data does not begin with `_`");
        };
        let is_base64 = match encoding.as_deref() {
            Some("raw") => false,
            None | Some("base64") => true,
            Some(other) => {
                let reason = format!("appended data in `{}`, neither raw nor base64", other.escape_debug());
                return refuse(at, reason);
            }
        };
        self.appended = Some((data, at + white + 1, is_base64));
        Ok(())
    }

    /// Calls `each` with every number of `array` and an offset for error messages.
    pub fn numbers(
        &mut self,
        array: &Array,
        mut each: impl FnMut(usize, f64) -> Result<(), FormatFault>,
    ) -> Result<(), FormatFault> {
        let kind = array.scalar()?;
        let (at, mut bytes) = match array.source {
            ArrayData::Text(text) => {
                let mut words = Words::new(text, None);
                let in_file =
                    |fault: FormatFault| FormatFault { at: fault.at.map(|at| at + array.at), ..fault };
                loop {
                    words.skip_white();
                    if words.rest().is_empty() {
                        return Ok(());
                    }
                    let at = array.at + words.at;
                    each(at, words.number("a number").map_err(in_file)?)?;
                }
            }
            ArrayData::Base64(text) => (array.at, Bytes { bytes: text, coded: Some(Vec::new()) }),
            ArrayData::Appended(offset) => {
                let Some((data, start, is_base64)) = self.appended else {
                    return refuse(array.at, "the array is appended, but nothing is");
                };
                let bytes = data.get(offset..).unwrap_or_default();
                (start.saturating_add(offset), Bytes { bytes, coded: is_base64.then(Vec::new) })
            }
        };
        if bytes.bytes.trim_ascii().is_empty() {
            return Ok(());
        }
        let mut sink =
            Sink { kind, big_endian: self.big_endian, at, filled: 0, number: [0; 8], each: &mut each };
        match self.compressor.as_deref() {
            None => {
                let length = self.length(&mut bytes, at)?;
                self.copy(&mut bytes, length, at, &mut sink)?;
            }
            Some("vtkZLibDataCompressor") => self.inflate(&mut bytes, at, &mut sink)?,
            Some(other) => {
                let reason = format!(
                    "data compressed by `{}` is not read: save with zlib, or without compression",
                    other.escape_debug()
                );
                return refuse(at, reason);
            }
        }
        match sink.filled {
            0 => Ok(()),
            left => refuse(at, format!("{left} bytes are left behind the last number")),
        }
    }

    fn length(&self, bytes: &mut Bytes, at: usize) -> Result<u64, FormatFault> {
        let mut number = [0; 8];
        let size = if self.wide { 8 } else { 4 };
        if self.big_endian {
            bytes.fill(&mut number[8 - size..], at)?;
            return Ok(u64::from_be_bytes(number));
        }
        bytes.fill(&mut number[..size], at)?;
        Ok(u64::from_le_bytes(number))
    }

    fn copy(&self, bytes: &mut Bytes, length: u64, at: usize, sink: &mut Sink) -> Result<(), FormatFault> {
        let mut left = length;
        let mut chunk = [0; 4096];
        while left > 0 {
            let size = left.min(chunk.len() as u64) as usize;
            bytes.fill(&mut chunk[..size], at)?;
            sink.put(&chunk[..size])?;
            left -= size as u64;
        }
        Ok(())
    }

    /// Blocks of zlib data behind the header: number of blocks, size of a block and of the last one where that is
    /// smaller, compressed size of each.
    fn inflate(&mut self, bytes: &mut Bytes, at: usize, sink: &mut Sink) -> Result<(), FormatFault> {
        let blocks = self.length(bytes, at)?;
        if blocks == 0 {
            return Ok(());
        }
        let (block, last) = (self.length(bytes, at)?, self.length(bytes, at)?);
        let mut sizes = Vec::new();
        for _ in 0..blocks {
            sizes.push(self.length(bytes, at)?);
        }
        bytes.restart();
        // One for all blocks: its buffers are larger than a small block.
        let mut decoder = flate2::read::ZlibDecoder::new(Cursor::new(Vec::new()));
        for (i, &size) in sizes.iter().enumerate() {
            let packed = bytes.next(size, at)?;
            let said = if i + 1 == sizes.len() && last > 0 { last } else { block };
            self.budget = self.budget.checked_sub(said).ok_or_else(|| {
                let reason = format!(
                    "the arrays hold more than {} times the file's bytes: save it without compression",
                    Coding::MOST_INFLATION
                );
                FormatFault::at(at, reason)
            })?;
            decoder.reset(Cursor::new(packed));
            let mut unpacked = (&mut decoder).take(said);
            let (mut found, mut chunk) = (0, [0; 4096]);
            loop {
                let size = unpacked.read(&mut chunk).map_err(|error| {
                    FormatFault::at(at, format!("compressed block {i} cannot be unpacked: {error}"))
                })?;
                if size == 0 {
                    break;
                }
                found += size as u64;
                sink.put(&chunk[..size])?;
            }
            if found != said {
                let reason = format!("compressed block {i} holds {found} bytes, its header says {said}");
                return refuse(at, reason);
            }
        }
        Ok(())
    }
}

/// Bytes of an array, as they are or as base64.
struct Bytes<'a> {
    bytes: &'a [u8],
    /// Bytes of base64 that have been decoded and not yet taken, at most 3, the last first.
    coded: Option<Vec<u8>>,
}

impl Bytes<'_> {
    fn fill(&mut self, out: &mut [u8], at: usize) -> Result<(), FormatFault> {
        let early = || FormatFault::at(at, "the array's data ends too early");
        if self.coded.is_none() {
            let (head, tail) = self.bytes.split_at_checked(out.len()).ok_or_else(early)?;
            out.copy_from_slice(head);
            self.bytes = tail;
            return Ok(());
        }
        for byte in out {
            *byte = match self.coded.as_mut().and_then(Vec::pop) {
                Some(byte) => byte,
                None => self.decode().ok_or_else(early)?,
            };
        }
        Ok(())
    }

    /// The next `size` bytes. Memory is reserved only for bytes that exist.
    fn next(&mut self, size: u64, at: usize) -> Result<Vec<u8>, FormatFault> {
        let size = usize::try_from(size).ok().filter(|&size| size <= self.bytes.len());
        let size = size.ok_or_else(|| FormatFault::at(at, "the array's data ends too early"))?;
        let mut out = vec![0; size];
        self.fill(&mut out, at)?;
        Ok(out)
    }

    /// Restarts base64 decoding and drops what is left of the last four characters.
    fn restart(&mut self) {
        if let Some(coded) = &mut self.coded {
            coded.clear();
        }
    }

    /// Decodes four characters (RFC 4648) and returns the first byte. Padding may stand between two streams.
    fn decode(&mut self) -> Option<u8> {
        let (mut bits, mut digits, mut padding) = (0u32, 0, 0);
        while digits < 4 {
            let (&character, rest) = self.bytes.split_first()?;
            self.bytes = rest;
            let digit = match character {
                b'A'..=b'Z' => character - b'A',
                b'a'..=b'z' => character - b'a' + 26,
                b'0'..=b'9' => character - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                b'=' if digits > 1 => {
                    padding += 1;
                    0
                }
                _ if character.is_ascii_whitespace() => continue,
                _ => return None,
            };
            bits = bits << 6 | u32::from(digit);
            digits += 1;
        }
        let [_, first, second, third] = bits.to_be_bytes();
        let coded = self.coded.as_mut()?;
        coded.extend(&[third, second][padding.min(2)..]);
        Some(first)
    }
}

/// Bytes to numbers.
struct Sink<'a> {
    kind: Scalar,
    big_endian: bool,
    at: usize,
    /// Bytes of the next number that have come.
    filled: usize,
    number: [u8; 8],
    each: &'a mut dyn FnMut(usize, f64) -> Result<(), FormatFault>,
}

impl Sink<'_> {
    fn put(&mut self, bytes: &[u8]) -> Result<(), FormatFault> {
        let size = self.kind.size();
        for &byte in bytes {
            let place = if self.big_endian { 8 - size + self.filled } else { 7 - self.filled };
            self.number[place] = byte;
            self.filled += 1;
            if self.filled == size {
                (self.each)(self.at, self.kind.value(self.number))?;
                self.filled = 0;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// The numbers of one array, appended raw and compressed in blocks of 16 bytes, whose header says this of the last one.
    fn inflated(numbers: &[f64], last: u32) -> Vec<f64> {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let packed: Vec<Vec<u8>> = bytes
            .chunks(16)
            .map(|block| {
                let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
                encoder.write_all(block).unwrap();
                encoder.finish().unwrap()
            })
            .collect();
        let head = [packed.len() as u32, 16, last];
        let sizes = packed.iter().map(|block| block.len() as u32);
        let mut file = b"_".to_vec();
        file.extend(head.into_iter().chain(sizes).flat_map(u32::to_le_bytes));
        file.extend(packed.concat());
        let mut coding = Coding::new(&file);
        coding.compressor = Some("vtkZLibDataCompressor".to_owned());
        coding.appended(0, Some("raw".to_owned())).unwrap();
        let (name, kind) = ("a".to_owned(), "Float64".to_owned());
        let array = Array { name, kind, components: 1, source: ArrayData::Appended(0), at: 0 };
        let mut found = Vec::new();
        coding
            .numbers(&array, |_, number| {
                found.push(number);
                Ok(())
            })
            .unwrap();
        found
    }

    /// VTK writes the last block's bytes where it is shorter, and 0 where it is as long as the others.
    #[test]
    fn a_last_block_may_be_shorter_or_as_long_as_the_others() {
        assert_eq!(inflated(&[1.0, 2.5, -3.0], 8), [1.0, 2.5, -3.0]);
        assert_eq!(inflated(&[1.0, 2.5, -3.0, 0.25], 0), [1.0, 2.5, -3.0, 0.25]);
    }
}
