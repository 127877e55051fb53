//! Contexts of zstd, with an error where memory is refused: `Encoder::new` and `Decoder::new` panic there.

use std::io::{ErrorKind, Result, Write};
use zstd::zstd_safe::{CCtx, CParameter, DCtx};

/// A context that decompresses, for `zstd::Decoder::with_context`.
pub fn decompressing() -> Result<DCtx<'static>> {
    DCtx::try_create().ok_or_else(|| ErrorKind::OutOfMemory.into())
}

/// `bytes` as one zstd frame with its size and checksum, compressed at a level of 1 to 22.
pub fn compressed(bytes: &[u8], level: i32) -> Result<Vec<u8>> {
    let mut context = CCtx::try_create().ok_or(ErrorKind::OutOfMemory)?;
    let mut encoder = zstd::Encoder::with_context(Vec::new(), &mut context);
    encoder.set_parameter(CParameter::CompressionLevel(level))?;
    encoder.include_checksum(true)?;
    encoder.include_contentsize(true)?;
    encoder.set_pledged_src_size(Some(bytes.len() as u64))?;
    encoder.write_all(bytes)?;
    encoder.finish()
}
