//! STL, text and binary (3D Systems, StereoLithography Interface Specification, 1989).
//!
//! A binary file is recognised by its length, 84 + 50 · triangles, because many begin with "solid" as texts do. Normals
//! and attribute bytes are not used: the order of the corners determines the outside.

use super::words::{RawSurface, number, words};
use crate::mesh::error::{FormatFault, refuse};
use nalgebra::Vector3;

const HEADER: usize = 84;
const RECORD: usize = 50;

pub fn read(bytes: &[u8]) -> Result<RawSurface, FormatFault> {
    let count = bytes.get(80..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let need = |count: u32| HEADER as u64 + RECORD as u64 * u64::from(count);
    match count {
        Some(count) if need(count) == bytes.len() as u64 => Ok(binary(bytes)),
        _ if bytes.trim_ascii_start().starts_with(b"solid") => text(bytes),
        Some(count) if need(count) < bytes.len() as u64 => {
            let used = need(count) as usize;
            let mut raw = binary(&bytes[..used]);
            raw.notices.push(format!("{} bytes after the last triangle were left out", bytes.len() - used));
            Ok(raw)
        }
        Some(count) => Err(FormatFault::whole(format!(
            "the header says {count} triangles, which are {} bytes, but the file has {}: it is cut short, or no STL",
            need(count),
            bytes.len()
        ))),
        None => Err(FormatFault::whole("neither a text that begins with \"solid\" nor a binary STL file")),
    }
}

/// `bytes`: the header and whole records.
fn binary(bytes: &[u8]) -> RawSurface {
    let mut raw = RawSurface::default();
    for (t, record) in bytes[HEADER..].chunks_exact(RECORD).enumerate() {
        // After the normal's 12 bytes come nine coordinates.
        let mut numbers = record[12..48]
            .chunks_exact(4)
            .map(|four| f64::from(f32::from_le_bytes([four[0], four[1], four[2], four[3]])));
        let mut next = || numbers.next().unwrap_or(f64::NAN);
        for _ in 0..3 {
            raw.corners.push(raw.vertices.len() as u32);
            raw.vertices.push(Vector3::new(next(), next(), next()));
        }
        raw.polygons.push((3, HEADER + RECORD * t));
    }
    raw
}

/// Only `vertex` and `endloop` matter; everything between is passed over, so that any name is accepted.
fn text(bytes: &[u8]) -> Result<RawSurface, FormatFault> {
    let mut raw = RawSurface::default();
    let mut sides = 0;
    let (mut after_loop, mut closed) = (false, false);
    let mut words = words(bytes, 0);
    while let Some(word) = words.next() {
        let is = |name: &str| word.text.eq_ignore_ascii_case(name.as_bytes());
        if is("vertex") && after_loop {
            let mut next = || number(&mut words, bytes.len());
            let vertex = Vector3::new(next()?, next()?, next()?);
            raw.corners.push(raw.vertices.len() as u32);
            raw.vertices.push(vertex);
            sides += 1;
        } else if is("endloop") {
            if sides != 3 {
                return refuse(word.at, format!("a facet has {sides} corners; three are needed"));
            }
            raw.polygons.push((sides, word.at));
            (sides, after_loop) = (0, false);
        } else if is("loop") {
            after_loop = true;
        }
        closed = is("endsolid") || (closed && !is("facet"));
    }
    if sides != 0 || after_loop {
        return refuse(bytes.len(), "the file ends inside a facet: it is cut short");
    }
    if !closed {
        raw.notices.push("the last \"endsolid\" is missing: the file may be cut short".into());
    }
    Ok(raw)
}
