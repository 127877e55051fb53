//! Recognises .green files and packed ones by their first bytes.

use super::zstd_context;
use crate::base::output::Kind;
use std::io::Read;

pub const GREEN: Kind = Kind { name: "a .green file", recognizes: is_green };
pub const PACKED: Kind = Kind { name: "a packed .green file", recognizes: is_packed };

/// A safetensors container opens with the length of its JSON, 8 bytes, and that JSON with the metadata.
const METADATA: &[u8] = br#"{"__metadata__":{"greenstage":"#;

fn is_green(head: &[u8]) -> bool {
    head.get(8..).is_some_and(|json| json.starts_with(METADATA))
}

/// Whether the unpacked head is that of a .green file: packed files are known by their content.
fn is_packed(head: &[u8]) -> bool {
    let mut unpacked = Vec::new();
    let Ok(mut context) = zstd_context::decompressing() else { return false };
    let decoder = zstd::Decoder::with_context(head, &mut context);
    // The head ends in the middle of the packed file, which is an error behind the bytes that are looked at.
    let _ = decoder.take(8 + METADATA.len() as u64).read_to_end(&mut unpacked);
    is_green(&unpacked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_file_is_known_by_what_it_holds() {
        let green = [&[200, 0, 0, 0, 0, 0, 0, 0], METADATA, &[b'x'; 100_000]].concat();
        let packed = super::super::packed(&green).unwrap();
        let other = super::super::packed(&[b'x'; 100_000]).unwrap();
        assert!(is_green(&green) && !is_green(&packed) && !is_green(b"stage = \"desktop\""));
        assert!(is_packed(&packed) && !is_packed(&other) && !is_packed(&green));
    }
}
