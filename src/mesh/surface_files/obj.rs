//! Wavefront OBJ: `v` and `f` only (Wavefront Technologies, Advanced Visualizer manual, appendix B1).
//!
//! Texture coordinates, normals, materials, groups and lines do not change the surface and are skipped; free-form
//! surfaces (`curv`, `surf`, …) are refused, because leaving them out would open holes.

use super::words::{RawSurface, Word, lines, number, words};
use crate::mesh::error::{FormatFault, refuse};
use nalgebra::Vector3;

pub fn read(bytes: &[u8]) -> Result<RawSurface, FormatFault> {
    let mut raw = RawSurface::default();
    let mut line_joined: Vec<u8> = Vec::new();
    for (at, line) in lines(bytes) {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        // A backslash at the end continues the line. Offsets within such a line then point near the place.
        if let Some(begun) = line.strip_suffix(b"\\") {
            line_joined.extend_from_slice(begun);
            line_joined.push(b' ');
            continue;
        }
        if line_joined.is_empty() {
            read_line(at, line, &mut raw)?;
        } else {
            line_joined.extend_from_slice(line);
            read_line(at.min(bytes.len()), &line_joined, &mut raw)
                .map_err(|fault| FormatFault { at: Some(at), ..fault })?;
            line_joined.clear();
        }
    }
    Ok(raw)
}

fn read_line(at: usize, line: &[u8], raw: &mut RawSurface) -> Result<(), FormatFault> {
    let line = line.split(|&byte| byte == b'#').next().unwrap_or(line);
    let end = at + line.len();
    let mut words = words(line, at);
    let Some(keyword) = words.next() else { return Ok(()) };
    match keyword.text {
        b"v" => {
            let mut next = || number(&mut words, end);
            raw.vertices.push(Vector3::new(next()?, next()?, next()?));
        }
        b"f" | b"fo" => {
            let mut sides = 0;
            for word in words {
                raw.corners.push(corner(word, raw.vertices.len())?);
                sides += 1;
            }
            raw.polygons.push((sides, at));
        }
        b"curv" | b"curv2" | b"surf" => {
            return refuse(at, "free-form curves and surfaces are not read: export triangles");
        }
        _ => {}
    }
    Ok(())
}

/// The vertex of `7`, `7/1`, `7//3` or `-1` (the last one defined before), from 0.
fn corner(word: Word, vertices: usize) -> Result<u32, FormatFault> {
    let text = word.text.split(|&byte| byte == b'/').next().unwrap_or(word.text);
    let number: i64 = Word { text, at: word.at }.parse("a vertex number")?;
    let index = if number < 0 { vertices as i64 + number } else { number - 1 };
    u32::try_from(index).ok().filter(|_| number != 0).ok_or_else(|| {
        FormatFault::at(
            word.at,
            format!("vertex number {number} points nowhere; {vertices} are defined so far"),
        )
    })
}
