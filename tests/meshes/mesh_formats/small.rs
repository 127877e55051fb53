//! Two tetrahedra on five nodes, regions 3 and 7, in every format and variant; made here, byte by byte.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write;

pub const NODES: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]];
const TETS: [[u32; 4]; 2] = [[0, 1, 2, 3], [1, 2, 3, 4]];

/// Every variant but TetGen's, which are two files.
pub fn all() -> Vec<(String, Vec<u8>)> {
    let mut files = vec![
        ("m.inp".to_owned(), abaqus()),
        ("m.mesh".to_owned(), medit()),
        ("m.veg".to_owned(), vega()),
        ("m.flavia.msh".to_owned(), gid()),
        ("gmsh40.msh".to_owned(), gmsh_4_0(false)),
        ("gmsh40b.msh".to_owned(), gmsh_4_0(true)),
        ("text.vtk".to_owned(), vtk_text("3.0")),
        ("binary2.vtk".to_owned(), vtk_binary(2)),
        ("binary5.vtk".to_owned(), vtk_binary(5)),
        ("text5.vtk".to_owned(), vtk_text_5()),
        ("text.vtu".to_owned(), vtu_text("LittleEndian")),
        ("text_big.vtu".to_owned(), vtu_text("BigEndian")),
    ];
    for big in [false, true] {
        for wide in [false, true] {
            for zlib in [false, true] {
                for placing in [Placing::Inline, Placing::Raw, Placing::Base64] {
                    let bytes = vtu(big, wide, zlib, placing);
                    files.push((format!("big_{big}_wide_{wide}_zlib_{zlib}_{placing:?}.vtu"), bytes));
                }
            }
        }
    }
    files
}

pub fn abaqus() -> Vec<u8> {
    b"** a comment\n*HEADING\nanything, at all\n*NODE, NSET=All\n10, 0., 0., 0.\n20, 1.D0,\n30, , 1e0, 0\n\
      ** within\n40, 0, 0, 1.\n50,1,1,1\n*Element,\n TYPE=C3D4\n1, 10, 20,\n30, 40\n2, 20, 30, 40, 50\n\
      *NODE PRINT\n*NSET, NSET=Tip, GENERATE\n10, 50, 20\n*ELSET, ELSET=REGION_3\n1,\n\
      *NSET, nset = both\nTip\n*ELSET, ELSET=Region_7\n2,\n*STEP\n"
        .to_vec()
}

pub fn medit() -> Vec<u8> {
    let mut text = "MeshVersionFormatted 2 # a comment\nDimension 3\n\nVertices\n5\n".to_owned();
    for [x, y, z] in NODES {
        text += &format!("{x} {y} {z} 0\n");
    }
    text += "Tetrahedra\n2\n1 2 3 4 3\n2 3 4 5 7\nEnd\n";
    text.into_bytes()
}

/// A Vega file with numbers from 0, as some writers do, and every separator.
pub fn vega() -> Vec<u8> {
    let mut text = "# a comment\n*VERTICES\n5 3 0 0\n".to_owned();
    for (tag, [x, y, z]) in NODES.iter().enumerate() {
        text += &format!("{tag}, {x}\t{y} {z}\n");
    }
    text += "\n*ELEMENTS\nTETS\n2 4 0\n0 0 1 2 3\n1, 1, 2, 3, 4\n# sets\n*SET Region_3\n 0,\n*SET Region_7\n1\n\
             *REGION\nRegion_3, soft\n*REGION\nRegion_7, hard\n";
    text.into_bytes()
}

pub fn gid() -> Vec<u8> {
    let mut text = "# encoding utf-8\nmesh \"a body\" Dimension 3 ELEMTYPE tetrahedra nnode 4\n".to_owned();
    text += "# color 127 127 0\nCoordinates\n";
    for (tag, [x, y, z]) in (11..).zip(NODES) {
        text += &format!("{tag} {x} {y} {z}\n");
    }
    text += "end coordinates\nElements\n1 11 12 13 14 3\n2 12 13 14 15 7\nEnd Elements\n";
    text.into_bytes()
}

pub fn gmsh_4_0(binary: bool) -> Vec<u8> {
    let mut out = format!("$MeshFormat\n4 {} 8\n", u8::from(binary)).into_bytes();
    let mut sink = Gmsh { out: &mut out, binary };
    if binary {
        sink.int(1);
    }
    sink.text("\n$EndMeshFormat\n$Entities\n");
    [0, 0, 0, 2].into_iter().for_each(|count| sink.size(count));
    sink.end();
    for (entity, region) in [(1, 3), (2, 7)] {
        sink.int(entity);
        [0.0, 0.0, 0.0, 1.0, 1.0, 1.0].into_iter().for_each(|x| sink.real(x));
        sink.size(1);
        sink.int(region);
        sink.size(0);
        sink.end();
    }
    sink.text("\n$EndEntities\n$Nodes\n");
    [1, 5].into_iter().for_each(|count| sink.size(count));
    sink.end();
    [1, 3, 0].into_iter().for_each(|number| sink.int(number));
    sink.size(5);
    sink.end();
    for (tag, node) in (1..).zip(NODES) {
        sink.int(tag);
        node.into_iter().for_each(|x| sink.real(x));
        sink.end();
    }
    sink.text("\n$EndNodes\n$Elements\n");
    [2, 2].into_iter().for_each(|count| sink.size(count));
    sink.end();
    for (entity, tet) in (1..).zip(TETS) {
        [entity, 3, 4].into_iter().for_each(|number| sink.int(number));
        sink.size(1);
        sink.end();
        sink.int(entity);
        tet.into_iter().for_each(|node| sink.int(node as i32 + 1));
        sink.end();
    }
    sink.text("\n$EndElements\n");
    out
}

struct Gmsh<'a> {
    out: &'a mut Vec<u8>,
    binary: bool,
}

impl Gmsh<'_> {
    fn text(&mut self, text: &str) {
        self.out.extend(text.bytes());
    }
    fn int(&mut self, number: i32) {
        if self.binary { self.out.extend(number.to_le_bytes()) } else { self.text(&format!("{number} ")) }
    }
    fn size(&mut self, number: u64) {
        if self.binary { self.out.extend(number.to_le_bytes()) } else { self.text(&format!("{number} ")) }
    }
    fn real(&mut self, number: f64) {
        if self.binary { self.out.extend(number.to_le_bytes()) } else { self.text(&format!("{number} ")) }
    }
    fn end(&mut self) {
        if !self.binary {
            self.text("\n");
        }
    }
}

pub fn vtk_text(version: &str) -> Vec<u8> {
    let points = NODES.map(|x| format!("{} {} {}", x[0], x[1], x[2])).join("\n");
    format!(
        "# vtk DataFile Version {version}\ntwo\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n{points}\n\
         CELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\nCELL_DATA 2\nSCALARS region int 1\n\
         LOOKUP_TABLE default\n3\n7\nPOINT_DATA 5\nVECTORS u float\n{points}\n"
    )
    .into_bytes()
}

pub fn vtk_text_5() -> Vec<u8> {
    let points = NODES.map(|x| format!("{} {} {}", x[0], x[1], x[2])).join(" ");
    format!(
        "# vtk DataFile Version 5.1\ntwo\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n{points}\n\
         METADATA\nINFORMATION 0\n\nCELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n\
         0 1 2 3 1 2 3 4\n\nCELL_TYPES 2\n10\n10\nCELL_DATA 2\nFIELD FieldData 2\nquality 1 2 double\n.5 .6\n\
         gmsh%3Aphysical 1 2 int\n3 7\n"
    )
    .into_bytes()
}

pub fn vtk_binary(version: u8) -> Vec<u8> {
    let mut out = format!(
        "# vtk DataFile Version {version}.0\ntwo\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n"
    )
    .into_bytes();
    let ints = |out: &mut Vec<u8>, numbers: &[i32]| numbers.iter().for_each(|n| out.extend(n.to_be_bytes()));
    NODES.iter().flatten().for_each(|x| out.extend(x.to_be_bytes()));
    if version == 5 {
        out.extend(b"\nCELLS 3 8\nOFFSETS vtktypeint64\n");
        [0i64, 4, 8].into_iter().for_each(|n| out.extend(n.to_be_bytes()));
        out.extend(b"\nCONNECTIVITY vtktypeint64\n");
        TETS.iter().flatten().for_each(|&n| out.extend(i64::from(n).to_be_bytes()));
    } else {
        out.extend(b"\nCELLS 2 10\n");
        ints(&mut out, &[4, 0, 1, 2, 3, 4, 1, 2, 3, 4]);
    }
    out.extend(b"\nCELL_TYPES 2\n");
    ints(&mut out, &[10, 10]);
    out.extend(b"\nCELL_DATA 2\nSCALARS medit:ref int\nLOOKUP_TABLE default\n");
    ints(&mut out, &[1, 1]);
    out.extend(b"\nSCALARS REGION unsigned_char 1\nLOOKUP_TABLE default\n\x03\x07\n");
    out
}

/// A VTU file without its end; `array` writes an array of a type, with attributes and values.
pub fn vtu_head(attributes: &str, mut array: impl FnMut(&str, &str, &str) -> String) -> String {
    let points = NODES.map(|x| format!("{} {} {}", x[0], x[1], x[2])).join("\n");
    let points = array("Float64", "Name=\"Points\" NumberOfComponents=\"3\"", &points);
    let connectivity = array("Int32", "Name=\"connectivity\"", "0 1 2 3\n1 2 3 4");
    let offsets = array("Int64", "Name=\"offsets\"", "4 8");
    let types = array("UInt8", "Name=\"types\"", "10 10");
    let quality = array("Float32", "Name=\"quality\"", "0.5 0.5");
    let region = array("Int16", "Name=\"material\"", "3 7");
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" {attributes}>\n<UnstructuredGrid>\n\
         <Piece NumberOfPoints=\"5\" NumberOfCells=\"2\">\n<Points>\n{points}</Points>\n<Cells>\n{connectivity}\
         {offsets}{types}</Cells>\n<CellData Scalars=\"x\">\n{quality}{region}</CellData>\n</Piece>\n\
         </UnstructuredGrid>\n"
    )
}

pub fn vtu_text(byte_order: &str) -> Vec<u8> {
    let attributes = format!("version=\"0.1\" byte_order=\"{byte_order}\"");
    let array = |kind: &str, rest: &str, values: &str| {
        format!("<DataArray type=\"{kind}\" {rest} format=\"ascii\">{values}\n</DataArray>\n")
    };
    (vtu_head(&attributes, array) + "</VTKFile>\n").into_bytes()
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placing {
    Inline,
    Raw,
    Base64,
}

pub fn vtu(big: bool, wide: bool, zlib: bool, placing: Placing) -> Vec<u8> {
    let mut appended: Vec<u8> = Vec::new();
    let length = |number: usize| match (wide, big) {
        (true, true) => (number as u64).to_be_bytes().to_vec(),
        (true, false) => (number as u64).to_le_bytes().to_vec(),
        (false, true) => (number as u32).to_be_bytes().to_vec(),
        (false, false) => (number as u32).to_le_bytes().to_vec(),
    };
    let array = |kind: &str, rest: &str, values: &str| {
        let bytes: Vec<u8> = values.split_whitespace().flat_map(|word| number(kind, word, big)).collect();
        // Compressed: blocks of 16 bytes, the last one smaller.
        let (head, data) = if zlib {
            let blocks: Vec<Vec<u8>> = bytes.chunks(16).map(deflated).collect();
            let sizes = [blocks.len(), 16, bytes.len() % 16].into_iter().chain(blocks.iter().map(Vec::len));
            (sizes.flat_map(length).collect(), blocks.concat())
        } else {
            (length(bytes.len()), bytes)
        };
        // VTK encodes the head of compressed data for itself, and uncompressed data in one with its head.
        let coded = match (placing, zlib) {
            (Placing::Raw, _) => [head, data].concat(),
            (_, true) => (base64(&head) + &base64(&data)).into_bytes(),
            (_, false) => base64(&[head, data].concat()).into_bytes(),
        };
        if placing == Placing::Inline {
            let text = String::from_utf8(coded).unwrap();
            return format!("<DataArray type=\"{kind}\" {rest} format=\"binary\">\n {text}\n</DataArray>\n");
        }
        let offset = appended.len();
        appended.extend(coded);
        format!("<DataArray type=\"{kind}\" {rest} format=\"appended\" offset=\"{offset}\"/>\n")
    };
    let mut attributes = format!(
        "version=\"1.0\" byte_order=\"{}\" header_type=\"{}\"",
        if big { "BigEndian" } else { "LittleEndian" },
        if wide { "UInt64" } else { "UInt32" }
    );
    if zlib {
        attributes += " compressor=\"vtkZLibDataCompressor\"";
    }
    let mut out = vtu_head(&attributes, array).into_bytes();
    if placing != Placing::Inline {
        let encoding = if placing == Placing::Raw { "raw" } else { "base64" };
        out.extend(format!("<AppendedData encoding=\"{encoding}\">\n _").bytes());
        out.extend(appended);
        out.extend(b"\n</AppendedData>\n");
    }
    out.extend(b"</VTKFile>\n");
    out
}

fn number(kind: &str, word: &str, big: bool) -> Vec<u8> {
    let mut bytes = match kind {
        "Float64" => word.parse::<f64>().unwrap().to_le_bytes().to_vec(),
        "Float32" => word.parse::<f32>().unwrap().to_le_bytes().to_vec(),
        "Int64" => word.parse::<i64>().unwrap().to_le_bytes().to_vec(),
        "Int32" => word.parse::<i32>().unwrap().to_le_bytes().to_vec(),
        "Int16" => word.parse::<i16>().unwrap().to_le_bytes().to_vec(),
        _ => word.parse::<u8>().unwrap().to_le_bytes().to_vec(),
    };
    if big {
        bytes.reverse();
    }
    bytes
}

pub fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let quad = |three: &[u8]| {
        let bits = (0..3).fold(0, |bits, i| bits << 8 | u32::from(three.get(i).copied().unwrap_or(0)));
        let digit = |i: usize| match i > three.len() {
            true => '=',
            false => char::from(DIGITS[(bits >> (18 - 6 * i) & 63) as usize]),
        };
        (0..4).map(digit).collect::<String>()
    };
    bytes.chunks(3).map(quad).collect()
}

/// One tetrahedron of ten nodes.
pub fn quadratic() -> Vec<(String, Vec<u8>)> {
    let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]];
    let middles = [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]];
    let mut points: Vec<String> = corners.map(|x| format!("{} {} {}", x[0], x[1], x[2])).to_vec();
    points.extend(middles.map(|x| format!("{} {} {}", x[0], x[1], x[2])));
    let vtk = format!(
        "# vtk DataFile Version 2.0\nten\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 10 float\n{}\n\
         CELLS 1 11\n10 0 1 2 3 4 5 6 7 8 9\nCELL_TYPES 1\n24\n",
        points.join("\n")
    );
    let mut abaqus = "*NODE\n".to_owned();
    for (number, point) in (1..).zip(&points) {
        abaqus += &format!("{number}, {}\n", point.replace(' ', ", "));
    }
    abaqus += "*ELEMENT, TYPE=C3D10M\n1, 1, 2, 3, 4, 5, 6, 7, 8,\n9, 10\n";
    vec![("ten.vtk".to_owned(), vtk.into_bytes()), ("ten.inp".to_owned(), abaqus.into_bytes())]
}
