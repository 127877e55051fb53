//! VTK legacy `.vtk`, versions 1 to 5, text or binary (big endian): unstructured grids.
//!
//! In: bytes. Out: a [`RawMesh`] whose nodes and elements have the file's numbers, from 0. After "The VTK User's
//! Guide", chapter "VTK File Formats", and for version 5 (OFFSETS and CONNECTIVITY) the sources of VTK 9. Attributes
//! other than a region array are skipped.

use super::format::{Format, Part, Words, parsed};
use super::gmsh_scan::excerpt;
use super::vtu_write::{Cells, index, region_rank};
use crate::mesh::assemble::{RawMesh, RawNode};
use crate::mesh::error::{FormatFault, refuse};
use crate::mesh::scalar::Scalar;
use nalgebra::Vector3;

pub const FORMAT: Format = Format {
    name: "VTK legacy",
    extensions: &["vtk"],
    recognizes: |bytes| bytes.starts_with(b"# vtk DataFile"),
    others: |_| Vec::new(),
    read,
    writers: &[],
};

/// The name of a number's type in a legacy file.
fn scalar(name: &str, at: usize) -> Result<Scalar, FormatFault> {
    Ok(match name.to_lowercase().as_str() {
        "char" | "signed_char" | "vtktypeint8" => Scalar::I8,
        "unsigned_char" | "vtktypeuint8" => Scalar::U8,
        "short" | "vtktypeint16" => Scalar::I16,
        "unsigned_short" | "vtktypeuint16" => Scalar::U16,
        "int" | "vtkidtype" | "vtktypeint32" => Scalar::I32,
        "unsigned_int" | "vtktypeuint32" => Scalar::U32,
        "long" | "long_long" | "vtktypeint64" => Scalar::I64,
        "unsigned_long" | "unsigned_long_long" | "vtktypeuint64" => Scalar::U64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        other => {
            let name = excerpt(other.as_bytes());
            return refuse(at, format!("numbers of type `{name}` are not read: save without this array"));
        }
    })
}

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    let mut reader = Reader::open(bytes)?;
    while let Some((at, line)) = reader.words.full_line() {
        let text = String::from_utf8_lossy(line);
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        reader.section(at, &words)?;
    }
    let Reader { mut raw, cells, version, .. } = reader;
    if version.is_empty() || raw.nodes.is_empty() {
        return Err(FormatFault::whole("no POINTS: is this a whole VTK file?"));
    }
    cells.add_to(&mut raw, 0, 0)?;
    Ok(raw)
}

struct Reader<'a> {
    words: Words<'a>,
    is_binary: bool,
    version: String,
    raw: RawMesh,
    cells: Cells,
    /// Whether the attributes that follow are those of the cells, and how many entries each has.
    attributes: (bool, u64),
}

impl<'a> Reader<'a> {
    /// Version, title and encoding: the first three lines.
    fn open(bytes: &'a [u8]) -> Result<Reader<'a>, FormatFault> {
        let mut words = Words::new(bytes, None);
        let (_, head) = words.line().unwrap_or_default();
        let version = head.strip_prefix(b"# vtk DataFile Version ").unwrap_or_default();
        let version = String::from_utf8_lossy(version).trim().to_owned();
        let major = version.split('.').next().unwrap_or_default();
        if !matches!(major, "1" | "2" | "3" | "4" | "5") {
            return refuse(0, format!("expected `# vtk DataFile Version 1 to 5`, found `{}`", excerpt(head)));
        }
        words.line();
        let (at, encoding) = words.full_line().unwrap_or((words.at, b""));
        let is_binary = match encoding.to_ascii_uppercase().as_slice() {
            b"ASCII" => false,
            b"BINARY" => true,
            _ => return refuse(at, format!("expected ASCII or BINARY, found `{}`", excerpt(encoding))),
        };
        let (raw, cells) = (RawMesh::default(), Cells::default());
        Ok(Reader { words, is_binary, version, raw, cells, attributes: (false, 0) })
    }

    fn section(&mut self, at: usize, words: &[&str]) -> Result<(), FormatFault> {
        let count = |i: usize| -> Result<u64, FormatFault> {
            parsed(words.get(i).unwrap_or(&"").as_bytes(), at, "a count")
        };
        let kind = |i: usize| scalar(words.get(i).unwrap_or(&""), at);
        let keyword = words.first().map(|word| word.to_uppercase()).unwrap_or_default();
        let (of_cells, entries) = self.attributes;
        let times = |n: u64| {
            entries.checked_mul(n).ok_or_else(|| FormatFault::at(at, format!("{entries} times {n} values")))
        };
        match keyword.as_str() {
            "DATASET" if words.get(1).is_some_and(|kind| kind.eq_ignore_ascii_case("UNSTRUCTURED_GRID")) => {}
            "DATASET" => {
                let found = words.get(1).copied().unwrap_or_default();
                let reason = format!(
                    "a dataset of type `{}`: only UNSTRUCTURED_GRID holds tetrahedra",
                    excerpt(found.as_bytes())
                );
                return refuse(at, reason);
            }
            "POINTS" if self.raw.nodes.is_empty() => self.points(at, count(1)?, kind(2)?)?,
            "CELLS" if self.cells.ends.is_empty() => {
                self.cells.at = vec![at];
                if self.version.starts_with('5') {
                    self.cells_5(at, count(1)?, count(2)?)?;
                } else {
                    self.cells_2(at, count(1)?, count(2)?)?;
                }
            }
            "CELL_TYPES" if self.cells.types.is_empty() => {
                let types = &mut self.cells.types;
                let each = |at: usize, value: f64| {
                    types.push(u8::try_from(index(value, at)?).unwrap_or(u8::MAX));
                    Ok(())
                };
                numbers(&mut self.words, self.is_binary, Scalar::I32, count(1)?, each)?;
            }
            "POINTS" | "CELLS" | "CELL_TYPES" => return refuse(at, format!("a second {keyword}")),
            "CELL_DATA" => self.attributes = (true, count(1)?),
            "POINT_DATA" => self.attributes = (false, count(1)?),
            "FIELD" => self.field(count(2)?, of_cells)?,
            "METADATA" => while self.words.line().is_some_and(|(_, line)| !line.is_empty()) {},
            "SCALARS" => {
                let components = if words.len() > 3 { count(3)? } else { 1 };
                let mut ahead = self.words;
                let next = ahead.full_line().map(|(_, line)| line.to_ascii_uppercase()).unwrap_or_default();
                if next.starts_with(b"LOOKUP_TABLE") {
                    self.words = ahead;
                }
                let name = words.get(1).copied().filter(|_| of_cells && components == 1);
                self.array(name, kind(2)?, times(components)?)?;
            }
            "LOOKUP_TABLE" => {
                let values =
                    count(2)?.checked_mul(4).ok_or_else(|| FormatFault::at(at, "too many colours"))?;
                self.array(None, Scalar::U8, values)?;
            }
            "COLOR_SCALARS" => self.array(None, Scalar::U8, times(count(2)?)?)?,
            "VECTORS" | "NORMALS" => self.array(None, kind(2)?, times(3)?)?,
            "TENSORS" => self.array(None, kind(2)?, times(9)?)?,
            "TENSORS6" => self.array(None, kind(2)?, times(6)?)?,
            "TEXTURE_COORDINATES" => self.array(None, kind(3)?, times(count(2)?)?)?,
            "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => self.array(None, kind(2)?, times(1)?)?,
            _ => {
                let reason = format!("expected a VTK section, found `{}`", excerpt(keyword.as_bytes()));
                return refuse(at, reason);
            }
        }
        Ok(())
    }

    fn points(&mut self, at: usize, count: u64, kind: Scalar) -> Result<(), FormatFault> {
        let values = count.checked_mul(3).ok_or_else(|| FormatFault::at(at, format!("{count} points")))?;
        let nodes = &mut self.raw.nodes;
        let (mut position, mut axis) = (Vector3::zeros(), 0);
        let each = |at: usize, value: f64| {
            position[axis] = value;
            axis = (axis + 1) % 3;
            if axis == 0 {
                nodes.push(RawNode { tag: nodes.len() as u64, position, at });
            }
            Ok(())
        };
        numbers(&mut self.words, self.is_binary, kind, values, each)
    }

    /// Reads cells up to version 4: for each cell the number of its points, and these.
    fn cells_2(&mut self, at: usize, count: u64, size: u64) -> Result<(), FormatFault> {
        let cells = &mut self.cells;
        cells.at.clear();
        let mut left = 0;
        let each = |at: usize, value: f64| {
            let number = index(value, at)?;
            if left > 0 {
                cells.connectivity.push(number);
                left -= 1;
            } else {
                left = number;
                cells.at.push(at);
                cells.ends.push(cells.connectivity.len() + number as usize);
            }
            Ok(())
        };
        numbers(&mut self.words, self.is_binary, Scalar::I32, size, each)?;
        if cells.ends.len() as u64 != count || left > 0 {
            let reason =
                format!("{count} cells of {size} numbers are said, {} cells found", cells.ends.len());
            return refuse(at, reason);
        }
        Ok(())
    }

    /// Reads cells of version 5 on: where each cell begins, with the end of the last, then all points.
    fn cells_5(&mut self, at: usize, offsets: u64, size: u64) -> Result<(), FormatFault> {
        for (name, count) in [("OFFSETS", offsets), ("CONNECTIVITY", size)] {
            let (line_at, line) = self.words.full_line().unwrap_or((self.words.at, b""));
            let text = String::from_utf8_lossy(line);
            let Some((found, kind)) =
                text.split_once(' ').filter(|(found, _)| found.eq_ignore_ascii_case(name))
            else {
                let reason = format!("expected {name} and a type of numbers, found `{}`", excerpt(line));
                return refuse(line_at, reason);
            };
            let (kind, cells) = (scalar(kind.trim(), line_at)?, &mut self.cells);
            let each = |at: usize, value: f64| {
                let number = index(value, at)?;
                if found.eq_ignore_ascii_case("OFFSETS") {
                    cells.ends.push(number as usize);
                } else {
                    cells.connectivity.push(number);
                }
                Ok(())
            };
            numbers(&mut self.words, self.is_binary, kind, count, each)?;
        }
        if !self.cells.ends.is_empty() && self.cells.ends.remove(0) != 0 {
            return refuse(at, "the first of OFFSETS is not 0");
        }
        Ok(())
    }

    /// Arrays, each with a line of name, components, entries and type.
    fn field(&mut self, arrays: u64, of_cells: bool) -> Result<(), FormatFault> {
        for _ in 0..arrays {
            let (mut at, mut line) = self.words.full_line().unwrap_or((self.words.at, b""));
            if line == b"METADATA" {
                while self.words.line().is_some_and(|(_, line)| !line.is_empty()) {}
                (at, line) = self.words.full_line().unwrap_or((self.words.at, b""));
            }
            let text = String::from_utf8_lossy(line);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            let &[name, components, entries, kind] = words.as_slice() else {
                let reason =
                    format!("expected name, components, entries and type, found `{}`", excerpt(line));
                return refuse(at, reason);
            };
            let components: u64 = parsed(components.as_bytes(), at, "a count")?;
            let entries: u64 = parsed(entries.as_bytes(), at, "a count")?;
            let values =
                components.checked_mul(entries).ok_or_else(|| FormatFault::at(at, "too many values"))?;
            let name = (of_cells && components == 1).then_some(name);
            self.array(name, scalar(kind, at)?, values)?;
        }
        Ok(())
    }

    /// Skips an array, or takes its values for the regions where `name` ranks before the array taken earlier.
    fn array(&mut self, name: Option<&str>, kind: Scalar, count: u64) -> Result<(), FormatFault> {
        let rank_of = |name: &str| region_rank(name).unwrap_or(usize::MAX);
        let there = self.cells.regions.as_ref().map_or(usize::MAX, |(name, _)| rank_of(name));
        let mut values = Vec::new();
        let name = name.filter(|name| rank_of(name) < there);
        let each = |_: usize, value: f64| {
            if name.is_some() {
                values.push(value);
            }
            Ok(())
        };
        numbers(&mut self.words, self.is_binary, kind, count, each)?;
        if let Some(name) = name {
            self.cells.regions = Some((name.to_owned(), values));
        }
        Ok(())
    }
}

/// Calls `each` with `count` numbers and their offsets.
fn numbers(
    words: &mut Words,
    is_binary: bool,
    kind: Scalar,
    count: u64,
    mut each: impl FnMut(usize, f64) -> Result<(), FormatFault>,
) -> Result<(), FormatFault> {
    if !is_binary {
        for _ in 0..count {
            words.skip_white();
            let at = words.at;
            each(at, words.number("a number")?)?;
        }
        return Ok(());
    }
    let size = kind.size();
    let length = usize::try_from(count).ok().and_then(|count| count.checked_mul(size));
    let Some(bytes) = length.and_then(|length| words.rest().get(..length)) else {
        return refuse(words.at, format!("the file ends before {count} numbers of {size} bytes"));
    };
    for number in bytes.chunks_exact(size) {
        let mut wide = [0; 8];
        wide[8 - size..].copy_from_slice(number);
        each(words.at, kind.value(wide))?;
        words.at += size;
    }
    Ok(())
}
