//! Writes VTK XML `.vtu` (unstructured grids, their arrays as base64 within the XML), and turns the cells of a grid, as both
//! VTK formats hold them, into the elements of a [`RawMesh`] ([`Cells`]).
//!
//! In: pieces of nodes and cells with fields on them. Out: the file's bytes, which the reader of this folder, ParaView and
//! meshio open. After "VTK XML Formats" of the VTK documentation: without compression, the length (8 bytes) and the
//! numbers are encoded together in base64 (RFC 4648).

use crate::base::text::base64;
use crate::mesh::assemble::{ElementShape, RawMesh};
use crate::mesh::error::{FormatFault, refuse};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// One `Piece`: a body.
pub struct Piece<'a> {
    /// m
    pub points: &'a [Vector3<f64>],
    pub cell: Cell,
    /// The nodes of all cells, one cell after the other, in VTK's order.
    pub connectivity: Vec<u32>,
    /// Fields of vectors on the points, by name.
    pub vectors: Vec<(String, Vec<Vector3<f64>>)>,
    /// Fields of numbers on the points, by name; only beside vectors.
    pub scalars: Vec<(String, Vec<f64>)>,
    /// A number for each cell, by name.
    pub numbers: Option<(&'static str, Vec<i32>)>,
}

/// The type of all cells of a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    Triangle,
    Tetra,
    QuadraticTetra,
}

impl Cell {
    /// The number of nodes, and VTK's number of the type.
    fn nodes_and_type(self) -> (usize, u8) {
        match self {
            Cell::Triangle => (3, 5),
            Cell::Tetra => (4, 10),
            Cell::QuadraticTetra => (10, 24),
        }
    }
}

/// The whole file.
pub fn encode(pieces: &[Piece<'_>]) -> Vec<u8> {
    let mut text = String::from(
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <UnstructuredGrid>\n",
    );
    pieces.iter().for_each(|piece| put(&mut text, piece));
    text.push_str("</UnstructuredGrid>\n</VTKFile>\n");
    text.into_bytes()
}

fn put(text: &mut String, piece: &Piece<'_>) {
    let (size, kind) = piece.cell.nodes_and_type();
    let cells = piece.connectivity.len() / size;
    let points = piece.points.len();
    text.push_str(&format!("<Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{cells}\">\n"));
    if let Some((first, _)) = piece.vectors.first() {
        text.push_str(&format!("<PointData Vectors=\"{}\">\n", escaped(first)));
        for (name, field) in &piece.vectors {
            vectors(text, name, field);
        }
        for (name, field) in &piece.scalars {
            array(text, "Float64", name, 1, field.iter().copied().flat_map(f64::to_le_bytes));
        }
        text.push_str("</PointData>\n");
    }
    if let Some((name, numbers)) = &piece.numbers {
        text.push_str(&format!("<CellData Scalars=\"{name}\">\n"));
        array(text, "Int32", name, 1, numbers.iter().flat_map(|number| number.to_le_bytes()));
        text.push_str("</CellData>\n");
    }
    text.push_str("<Points>\n");
    vectors(text, "Points", piece.points);
    text.push_str("</Points>\n<Cells>\n");
    let wide = |number: usize| (number as i64).to_le_bytes();
    array(text, "Int64", "connectivity", 1, piece.connectivity.iter().flat_map(|&node| wide(node as usize)));
    array(text, "Int64", "offsets", 1, (1..=cells).flat_map(|count| wide(size * count)));
    array(text, "UInt8", "types", 1, std::iter::repeat_n(kind, cells));
    text.push_str("</Cells>\n</Piece>\n");
}

fn vectors(text: &mut String, name: &str, field: &[Vector3<f64>]) {
    let numbers = field.iter().flat_map(|v| [v.x, v.y, v.z]).flat_map(f64::to_le_bytes);
    array(text, "Float64", name, 3, numbers);
}

fn array(text: &mut String, kind: &str, name: &str, components: usize, bytes: impl Iterator<Item = u8>) {
    let name = escaped(name);
    text.push_str(&format!(
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">"
    ));
    let mut data = vec![0; 8];
    data.extend(bytes);
    let length = (data.len() - 8) as u64;
    data[..8].copy_from_slice(&length.to_le_bytes());
    text.push_str(&base64(&data));
    text.push_str("</DataArray>\n");
}

/// A name as the value of an attribute. Characters that XML 1.0 does not allow, such as most control characters, become U+FFFD;
/// white space other than blanks would be read as blanks, and is written by its number.
fn escaped(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '&' => text.push_str("&amp;"),
            '<' => text.push_str("&lt;"),
            '>' => text.push_str("&gt;"),
            '"' => text.push_str("&quot;"),
            '\t' | '\n' | '\r' => text.push_str(&format!("&#{};", u32::from(c))),
            '\u{0}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => text.push('\u{fffd}'),
            c => text.push(c),
        }
    }
    text
}

/// Names of cell arrays that are taken for region numbers, most wanted first, in lower case.
pub const REGION_ARRAYS: [&str; 11] = [
    "region",
    "regions",
    "gmsh:physical",
    "medit:ref",
    "mat_id",
    "material",
    "materialid",
    "material_id",
    "materialids",
    "cellentityids",
    "gmsh:geometrical",
];

/// The rank of an array of that name among [`REGION_ARRAYS`]; the least rank is taken.
pub fn region_rank(name: &str) -> Option<usize> {
    let name = name.to_lowercase().replace("%3a", ":");
    REGION_ARRAYS.iter().position(|known| *known == name)
}

/// One block of cells; node numbers count from the block's first node. Tetrahedra become elements with their regions, and
/// cells of lower dimension that have a number become node groups. Cell types and the order of their nodes are in "The VTK
/// User's Guide", chapter "VTK File Formats".
#[derive(Default)]
pub struct Cells {
    pub connectivity: Vec<u32>,
    /// End of each cell in `connectivity`.
    pub ends: Vec<usize>,
    pub types: Vec<u8>,
    /// A number of each cell, and the name of the array it comes from.
    pub regions: Option<(String, Vec<f64>)>,
    /// Offset of each cell in the file, or of all of them.
    pub at: Vec<usize>,
}

/// A number that stands for a node or a count.
pub fn index(value: f64, at: usize) -> Result<u32, FormatFault> {
    if value >= 0.0 && value < f64::from(u32::MAX) && value.fract() == 0.0 {
        return Ok(value as u32);
    }
    refuse(at, format!("{value} is no number of a point"))
}

/// Dimension and points of the cell types that can be used or counted.
fn shape(kind: u8) -> Option<(u8, u8)> {
    Some(match kind {
        1 => (0, 1),
        3 => (1, 2),
        21 => (1, 3),
        5 => (2, 3),
        8 | 9 => (2, 4),
        22 => (2, 6),
        23 => (2, 8),
        10 => (3, 4),
        11 | 12 => (3, 8),
        13 => (3, 6),
        14 => (3, 5),
        24 => (3, 10),
        25 => (3, 20),
        26 => (3, 15),
        27 => (3, 13),
        _ => return None,
    })
}

impl Cells {
    /// Adds the cells to `raw`, whose nodes from `first_node` on are those of this block.
    pub fn add_to(mut self, raw: &mut RawMesh, first_node: u64, first_cell: u64) -> Result<(), FormatFault> {
        let at = self.at.first().copied().unwrap_or(0);
        if self.types.len() != self.ends.len() {
            return refuse(at, format!("{} cells, but {} cell types", self.ends.len(), self.types.len()));
        }
        let numbers = self.region_numbers(raw);
        let mut left_out: BTreeMap<u8, usize> = BTreeMap::new();
        let mut start = 0;
        for (i, (&end, &kind)) in self.ends.iter().zip(&self.types).enumerate() {
            let at = self.at.get(i).copied().unwrap_or(at);
            let Some(nodes) = self.connectivity.get(start..end) else {
                let reason = format!(
                    "cell {i} ends at entry {end} of the connectivity, which has {} and has been read to {start}",
                    self.connectivity.len()
                );
                return refuse(at, reason);
            };
            start = end;
            let number = numbers.as_ref().and_then(|numbers| numbers.get(i)).copied().unwrap_or(0);
            let Some((dimension, size)) = shape(kind) else {
                *left_out.entry(kind).or_default() += 1;
                continue;
            };
            if nodes.len() != usize::from(size) {
                return refuse(at, format!("cell {i} of type {kind} has {} points, not {size}", nodes.len()));
            }
            if dimension < 3 && number <= 0 {
                *left_out.entry(kind).or_default() += 1;
                continue;
            }
            let mut tags: Vec<u64> = nodes.iter().map(|&node| first_node + u64::from(node)).collect();
            let is_tetrahedron = matches!(kind, 10 | 24);
            if kind == 24 {
                tags.swap(8, 9);
            }
            let kind = ElementShape { dimension, nodes: size, is_tetrahedron };
            raw.add(kind, first_cell + i as u64, number, at, &tags);
        }
        for (kind, count) in left_out {
            raw.notices.push(format!("{count} cells of VTK type {kind} have been left out"));
        }
        Ok(())
    }

    /// The cells' numbers, where all of them can be region numbers.
    fn region_numbers(&mut self, raw: &mut RawMesh) -> Option<Vec<i32>> {
        let (name, values) = self.regions.take()?;
        if values.len() != self.ends.len() {
            let reason = format!("{} values for {} cells", values.len(), self.ends.len());
            raw.notices.push(format!("cell array \"{name}\" is not taken for regions: {reason}"));
            return None;
        }
        let is_number =
            |value: &&f64| **value >= 0.0 && **value <= f64::from(i32::MAX) && value.fract() == 0.0;
        if let Some(other) = values.iter().find(|value| !is_number(value)) {
            let reason = format!("{other} is no whole number from 0 to {}", i32::MAX);
            raw.notices.push(format!("cell array \"{name}\" is not taken for regions: {reason}"));
            return None;
        }
        Some(values.iter().map(|&value| value as i32).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_well_formed_xml() {
        assert_eq!(escaped("a \"b\" <&> ü"), "a &quot;b&quot; &lt;&amp;&gt; ü");
        assert_eq!(
            escaped("\u{1b}[2J\u{0}\u{7}\n\t\u{ffff}"),
            "\u{fffd}[2J\u{fffd}\u{fffd}&#10;&#9;\u{fffd}"
        );
    }
}
