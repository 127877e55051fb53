//! Writes VTK XML `.vtu`: unstructured grids, their arrays as base64 within the XML.
//!
//! In: pieces of nodes and cells with fields on them. Out: the file's bytes, which the reader of this folder, ParaView and
//! meshio open. After "VTK XML Formats" of the VTK documentation: without compression, the length (8 bytes) and the
//! numbers are encoded together in base64 (RFC 4648).

use crate::base::text::base64;
use nalgebra::Vector3;

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
