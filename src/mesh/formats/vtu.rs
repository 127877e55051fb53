//! VTK XML `.vtu`: unstructured grids, their arrays as text, base64 or appended bytes, plain or compressed by zlib,
//! in either byte order.
//!
//! In: bytes. Out: a [`RawMesh`] whose nodes and elements are numbered from 0 through all pieces. After "VTK XML
//! Formats" of the VTK documentation. The XML is read to AppendedData only, since what follows is no XML.

use super::format::{Encoded, Format, Part, Writer};
use super::gmsh_scan::excerpt;
use super::vtu_array::{Array, ArrayData, Coding};
use super::vtu_write;
use super::vtu_write::{Cells, index, region_rank};
use super::write::{check, lost};
use crate::base::output::Kind;
use crate::mesh::assemble::{RawMesh, RawNode};
use crate::mesh::error::{FormatFault, MeshError, refuse};
use crate::mesh::tet_mesh::TetMesh;
use nalgebra::Vector3;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

pub const FORMAT: Format = Format {
    name: "VTK XML",
    extensions: &["vtu"],
    recognizes,
    others: |_| Vec::new(),
    read,
    writers: &[Writer {
        name: "vtu",
        about: "VTK XML, regions as a cell array",
        files: &[("vtu", Kind { name: "a VTU file", recognizes })],
        encode,
    }],
};

fn recognizes(bytes: &[u8]) -> bool {
    bytes.windows(8).take(200).any(|window| window == b"<VTKFile")
}

fn encode(mesh: &TetMesh) -> Result<Encoded, MeshError> {
    check(mesh, "VTU")?;
    // The check above has found all of them in range.
    let regions = || mesh.regions.iter().map(|&region| region as i32).collect();
    let piece = vtu_write::Piece {
        scalars: Vec::new(),
        points: &mesh.nodes,
        cell: vtu_write::Cell::Tetra,
        connectivity: mesh.tets.as_flattened().to_vec(),
        vectors: Vec::new(),
        numbers: mesh.regions.iter().any(|&region| region != 0).then(|| ("region", regions())),
    };
    Ok(Encoded { files: vec![vtu_write::encode(&[piece])], lost: lost(mesh, 0) })
}

/// The description of one piece in the XML.
#[derive(Default)]
struct Piece<'a> {
    at: usize,
    points: u64,
    cells: u64,
    arrays: Vec<Array<'a>>,
}

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    let (pieces, mut coding) = outline(bytes, false)?;
    let mut raw = RawMesh::default();
    let mut first_cell = 0;
    for piece in &pieces {
        let first_node = raw.nodes.len() as u64;
        let cells = piece_cells(piece, &mut coding, &mut raw)?;
        let count = cells.ends.len() as u64;
        cells.add_to(&mut raw, first_node, first_cell)?;
        first_cell += count;
    }
    if pieces.len() > 1 {
        raw.notices
            .push(format!("{} pieces, which have no nodes in common: joined as they are", pieces.len()));
    }
    Ok(raw)
}

/// Prefix of the names of arrays of the points.
const POINT_DATA: &str = "PointData/";

/// Places, m, each with a vector.
pub type PlacedVectors = Vec<(Vector3<f64>, Vector3<f64>)>;

/// The places of all points, m, with what an array of three components has there: that of this name, or the only one.
pub fn point_vectors(bytes: &[u8], name: Option<&str>) -> Result<PlacedVectors, FormatFault> {
    let (pieces, mut coding) = outline(bytes, true)?;
    let mut all = Vec::new();
    for piece in &pieces {
        let own = piece.arrays.iter().filter_map(|array| Some((array.name.strip_prefix(POINT_DATA)?, array)));
        let own: Vec<_> = own.filter(|(_, array)| array.components == 3).collect();
        let known = || own.iter().map(|(name, _)| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
        let array = match (name, &own[..]) {
            (None, [(_, only)]) => only,
            (None, []) => return refuse(piece.at, "no array of its points has three components"),
            (None, _) => {
                return refuse(piece.at, format!("name one of its arrays by array = …: {}", known()));
            }
            (Some(name), _) => match own.iter().find(|(own, _)| *own == name) {
                Some((_, array)) => array,
                None => {
                    let message =
                        format!("no array \"{name}\" of three components at its points, but {}", known());
                    return refuse(piece.at, message);
                }
            },
        };
        let places = triples(points(piece)?, piece, &mut coding)?;
        all.extend(places.into_iter().zip(triples(array, piece, &mut coding)?));
    }
    Ok(all)
}

/// The three numbers of each point.
fn triples(array: &Array, piece: &Piece, coding: &mut Coding) -> Result<Vec<Vector3<f64>>, FormatFault> {
    let mut numbers = Vec::new();
    coding.numbers(array, |at, value| match value.is_finite() {
        true => {
            numbers.push(value);
            Ok(())
        }
        false => refuse(at, format!("{value} is no coordinate")),
    })?;
    compare(array.at, "points", piece.points, numbers.len() / 3)?;
    Ok(numbers.chunks_exact(3).map(Vector3::from_column_slice).collect())
}

/// The coordinates of a piece's points.
fn points<'p, 'a>(piece: &'p Piece<'a>) -> Result<&'p Array<'a>, FormatFault> {
    let points = piece.arrays.iter().find(|array| array.name == "Points");
    let points = points.ok_or_else(|| FormatFault::at(piece.at, "the piece has no array \"Points\""))?;
    if points.components != 3 {
        return refuse(points.at, format!("points have {} components, not 3", points.components));
    }
    Ok(points)
}

/// The arrays of all pieces, unread, those of points only where they are asked for, and how their bytes are to be taken.
fn outline(bytes: &[u8], with_point_data: bool) -> Result<(Vec<Piece<'_>>, Coding<'_>), FormatFault> {
    let mut xml = Reader::from_reader(bytes);
    let mut coding = Coding::new(bytes);
    let mut pieces: Vec<Piece> = Vec::new();
    let mut path: Vec<String> = Vec::new();
    loop {
        let at = offset(xml.buffer_position());
        let event = xml.read_event();
        match event.map_err(|error| {
            FormatFault::at(offset(xml.error_position()), format!("this is no XML: {error}"))
        })? {
            Event::Start(tag) => {
                let name = open(&tag, &path, at, (&mut pieces, with_point_data), &mut coding)?;
                if name == "AppendedData" {
                    coding.appended(offset(xml.buffer_position()), attribute(&tag, "encoding", at)?)?;
                    break;
                }
                path.push(name);
            }
            Event::Empty(tag) => {
                open(&tag, &path, at, (&mut pieces, with_point_data), &mut coding)?;
            }
            Event::Text(text) if path.last().is_some_and(|name| name == WANTED) => {
                let array = pieces.last_mut().and_then(|piece| piece.arrays.last_mut());
                let end = offset(xml.buffer_position());
                // The text as it stands in the file: numbers and base64 need no unescaping.
                let text = bytes.get(end.saturating_sub(text.len())..end).unwrap_or_default();
                let is_full = !text.trim_ascii().is_empty();
                if let Some(array) = array.filter(|_| is_full) {
                    array.put(text, end - text.len())?;
                }
            }
            Event::GeneralRef(_) if path.last().is_some_and(|name| name == WANTED) => {
                return refuse(at, "a reference (&…;) within an array of numbers");
            }
            Event::End(_) => {
                path.pop();
            }
            Event::Eof => match path.last() {
                Some(name) => return refuse(at, format!("the file ends within <{name}>")),
                None => break,
            },
            _ => {}
        }
    }
    if pieces.is_empty() {
        return Err(FormatFault::whole("no Piece of an UnstructuredGrid: is this a whole .vtu file?"));
    }
    Ok((pieces, coding))
}

fn offset(position: u64) -> usize {
    usize::try_from(position).unwrap_or(usize::MAX)
}

/// Replaces the name of an array that will be read.
const WANTED: &str = "wanted DataArray";

/// Takes note of an element and returns its name, or [`WANTED`]; `path` leads to it.
fn open<'a>(
    tag: &BytesStart,
    path: &[String],
    at: usize,
    (pieces, with_point_data): (&mut Vec<Piece<'a>>, bool),
    coding: &mut Coding,
) -> Result<String, FormatFault> {
    const DEEPEST: usize = 100;
    let name = String::from_utf8_lossy(tag.local_name().as_ref()).into_owned();
    let parent = path.last().map_or("", String::as_str);
    if path.len() > DEEPEST {
        return refuse(at, format!("more than {DEEPEST} elements within each other"));
    }
    match (parent, name.as_str()) {
        ("", "VTKFile") => {
            let kind = attribute(tag, "type", at)?.unwrap_or_default();
            if kind != "UnstructuredGrid" {
                let kind = excerpt(kind.as_bytes());
                let reason = format!("a file of type `{kind}`: only UnstructuredGrid holds tetrahedra");
                return refuse(at, reason);
            }
            coding.big_endian = attribute(tag, "byte_order", at)?.as_deref() == Some("BigEndian");
            coding.wide = attribute(tag, "header_type", at)?.as_deref() == Some("UInt64");
            coding.compressor = attribute(tag, "compressor", at)?.filter(|name| !name.is_empty());
        }
        ("", other) => {
            return refuse(at, format!("expected <VTKFile>, found <{}>", excerpt(other.as_bytes())));
        }
        ("UnstructuredGrid", "Piece") => {
            let count = |key: &str| -> Result<u64, FormatFault> {
                let text = attribute(tag, key, at)?.unwrap_or_default();
                let count = text.trim().parse().ok();
                count.ok_or_else(|| {
                    FormatFault::at(at, format!("{key} is no count: `{}`", excerpt(text.as_bytes())))
                })
            };
            let (points, cells) = (count("NumberOfPoints")?, count("NumberOfCells")?);
            pieces.push(Piece { at, points, cells, arrays: Vec::new() });
        }
        ("PointData", "DataArray") if with_point_data => {
            if let Some(piece) = pieces.last_mut() {
                let name = attribute(tag, "Name", at)?.unwrap_or_default();
                piece.arrays.push(array(tag, format!("{POINT_DATA}{name}"), at)?);
                return Ok(WANTED.to_owned());
            }
        }
        ("Points" | "Cells" | "CellData", "DataArray") => {
            if let Some(piece) = pieces.last_mut() {
                let name = attribute(tag, "Name", at)?.unwrap_or_default();
                let is_wanted = match parent {
                    "Points" => true,
                    "Cells" => matches!(name.as_str(), "connectivity" | "offsets" | "types"),
                    _ => region_rank(&name).is_some(),
                };
                if is_wanted {
                    let name = if parent == "Points" { "Points".to_owned() } else { name };
                    piece.arrays.push(array(tag, name, at)?);
                    return Ok(WANTED.to_owned());
                }
            }
        }
        _ => {}
    }
    Ok(name)
}

fn array<'a>(tag: &BytesStart, name: String, at: usize) -> Result<Array<'a>, FormatFault> {
    let text = |key: &str| Ok::<_, FormatFault>(attribute(tag, key, at)?.unwrap_or_default());
    let source = match text("format")?.as_str() {
        "ascii" | "" => ArrayData::Text(b""),
        "binary" => ArrayData::Base64(b""),
        "appended" => {
            let offset = text("offset")?;
            let number = offset.trim().parse().ok();
            ArrayData::Appended(number.ok_or_else(|| {
                FormatFault::at(at, format!("offset is no count: `{}`", excerpt(offset.as_bytes())))
            })?)
        }
        other => {
            let reason = format!("format `{}` is none of ascii, binary, appended", excerpt(other.as_bytes()));
            return refuse(at, reason);
        }
    };
    let kind = text("type")?;
    let components = text("NumberOfComponents")?;
    let components = if components.is_empty() { 1 } else { components.trim().parse().unwrap_or(0) };
    Ok(Array { name, kind, components, source, at })
}

/// The value of an attribute, unescaped.
fn attribute(tag: &BytesStart, key: &str, at: usize) -> Result<Option<String>, FormatFault> {
    let wrong = |error: &dyn std::fmt::Display| FormatFault::at(at, format!("attribute {key}: {error}"));
    let found = tag.try_get_attribute(key).map_err(|error| wrong(&error))?;
    let Some(found) = found else { return Ok(None) };
    let value = found.normalized_value(XmlVersion::Implicit1_0).map_err(|error| wrong(&error))?;
    Ok(Some(value.into_owned()))
}

/// Adds the nodes of a piece to `raw`, and reads its cells.
fn piece_cells(piece: &Piece, coding: &mut Coding, raw: &mut RawMesh) -> Result<Cells, FormatFault> {
    let find = |name: &str| {
        let found = piece.arrays.iter().find(|array| array.name == name);
        found.ok_or_else(|| FormatFault::at(piece.at, format!("the piece has no array \"{name}\"")))
    };
    let first = raw.nodes.len();
    let points = points(piece)?;
    let (mut position, mut axis) = (Vector3::zeros(), 0);
    coding.numbers(points, |at, value| {
        position[axis] = value;
        axis = (axis + 1) % 3;
        if axis == 0 {
            raw.nodes.push(RawNode { tag: raw.nodes.len() as u64, position, at });
        }
        Ok(())
    })?;
    compare(points.at, "points", piece.points, raw.nodes.len() - first)?;

    let mut cells = Cells { at: vec![find("connectivity")?.at], ..Cells::default() };
    let connectivity = &mut cells.connectivity;
    coding.numbers(find("connectivity")?, |at, value| {
        connectivity.push(index(value, at)?);
        Ok(())
    })?;
    let ends = &mut cells.ends;
    coding.numbers(find("offsets")?, |at, value| {
        ends.push(index(value, at)? as usize);
        Ok(())
    })?;
    compare(find("offsets")?.at, "offsets", piece.cells, cells.ends.len())?;
    let types = &mut cells.types;
    coding.numbers(find("types")?, |at, value| {
        types.push(u8::try_from(index(value, at)?).unwrap_or(u8::MAX));
        Ok(())
    })?;
    compare(find("types")?.at, "types", piece.cells, cells.types.len())?;

    let scalars = piece.arrays.iter().filter(|array| array.components == 1);
    let ranked = scalars.filter_map(|array| Some((region_rank(&array.name)?, array)));
    if let Some((_, array)) = ranked.min_by_key(|(rank, _)| *rank) {
        let mut values = Vec::new();
        coding.numbers(array, |_, value| {
            values.push(value);
            Ok(())
        })?;
        cells.regions = Some((array.name.clone(), values));
    }
    Ok(cells)
}

/// Refuses an array that does not hold what the piece's head says.
fn compare(at: usize, what: &str, said: u64, found: usize) -> Result<(), FormatFault> {
    if said == found as u64 {
        return Ok(());
    }
    refuse(at, format!("the piece's head says {said} {what}, the array holds {found}"))
}
