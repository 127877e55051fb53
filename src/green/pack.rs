//! A .green file made small for shipping: zstd over the whole container, whose 16-bit columns are guessed before
//! ([`super::filter`]).
//!
//! In: a .green file. Out: a .green.zst file that unpacks to the same bytes, and back.

use super::error::GreenError;
use super::file::GreenFile;
use super::kind::{GREEN, PACKED};
use super::{filter, zstd_context};
use crate::base::{input, output};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// zstd's level: 19 is its smallest without extra memory for whoever unpacks.
const LEVEL: i32 = 19;
/// More bytes than these, and these for each packed one, are no columns of numbers: they are refused, whatever the packed
/// file says.
const LARGEST: u64 = 1 << 26;
const LARGEST_RATIO: u64 = 100;

/// The name of the packed file of a .green file: `tube.green.zst`.
pub fn packed_path(green: &Path) -> PathBuf {
    let mut name = green.as_os_str().to_owned();
    name.push(".zst");
    name.into()
}

/// The packed form of a .green file's bytes.
pub fn packed(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    zstd_context::compressed(&filter::filtered(bytes)?, LEVEL)
}

/// Packs the .green file at `from` into `to`, which is there whole or not at all; returns both sizes.
pub fn pack(from: &Path, to: &Path) -> Result<(u64, u64), GreenError> {
    let mut bytes = Vec::new();
    input::open(from)
        .and_then(|mut file| file.read_to_end(&mut bytes))
        .map_err(|source| GreenError::Io { path: from.to_owned(), source })?;
    // What is shipped is sound.
    GreenFile::open(from)?.verify()?;
    let failed = |source| GreenError::Io { path: to.to_owned(), source };
    let small = packed(&bytes).map_err(failed)?;
    output::write(to, &PACKED, |file| file.write_all(&small))?;
    Ok((bytes.len() as u64, small.len() as u64))
}

/// Unpacks `from` into the .green file `to`, which is replaced once what came out is whole and sound. Memory does not
/// grow with what the file claims, but with what it holds, up to 64 MiB or 100 times the packed size.
pub fn unpack(from: &Path, to: &Path) -> Result<u64, GreenError> {
    let unread = |source| GreenError::Io { path: from.to_owned(), source };
    let file = input::open(from).map_err(unread)?;
    let packed_size = file.limit();
    let largest = LARGEST.max(LARGEST_RATIO * packed_size);
    let damaged = |reason: String| GreenError::Damaged { path: from.to_owned(), reason };
    let unpacked = |error: std::io::Error| damaged(format!("it does not unpack ({error})"));
    let mut context = zstd_context::decompressing().map_err(unread)?;
    let packed = zstd::Decoder::with_context(BufReader::new(file), &mut context);
    let mut bytes = Vec::new();
    packed.take(largest + 1).read_to_end(&mut bytes).map_err(unpacked)?;
    if bytes.len() as u64 > largest {
        return Err(damaged(format!(
            "it does not unpack (its {packed_size} bytes hold more than {largest}, and no .green file is so empty)"
        )));
    }
    let bytes =
        filter::restored(bytes).map_err(|reason| damaged(format!("it does not unpack ({reason})")))?;
    let staged = output::stage(to, &GREEN, |file| file.write_all(&bytes))?;
    GreenFile::open(staged.now_at()).and_then(|file| file.verify()).map_err(|error| match error {
        GreenError::Damaged { reason, .. } => {
            damaged(format!("what it unpacks to is no sound .green file: {reason}"))
        }
        other => other,
    })?;
    staged.put()?;
    Ok(bytes.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packed_file_that_grows_without_bound_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (small, large) = (folder.path().join("bomb.green.zst"), folder.path().join("bomb.green"));
        let zeros = vec![0u8; LARGEST as usize + 1];
        std::fs::write(&small, zstd::encode_all(&zeros[..], 1).unwrap()).unwrap();
        let error = unpack(&small, &large).unwrap_err().to_string();
        assert!(error.contains("hold more than 67108864"), "{error}");
        assert!(!large.exists());
    }
}
