//! GiD postprocess meshes, `.post.msh`, `.flavia.msh` or `.msh`, text.
//!
//! In: bytes. Out: a [`RawMesh`] with the file's numbers; material numbers are regions, or node groups where the
//! elements are faces or lines; without them every MESH is a region or a group, under its name. After the GiD
//! customization manual, "Mesh format: ModelName.post.msh". Keywords may be in any case.

use super::format::{Format, Part, Words, parsed};
use super::gmsh_scan::excerpt;
use crate::mesh::assemble::{ElementShape, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, refuse};
use nalgebra::Vector3;
use std::ops::Range;

pub const FORMAT: Format =
    Format { name: "GiD", extensions: &["msh"], recognizes, others: |_| Vec::new(), read, writers: &[] };

fn recognizes(bytes: &[u8]) -> bool {
    let first = Words::new(bytes, Some(b'#')).full_line();
    first.is_some_and(|(_, line)| is_word(line, b"mesh") || is_word(line, b"group"))
}

/// Whether a line begins with a keyword.
fn is_word(line: &[u8], word: &[u8]) -> bool {
    let end = line.iter().position(|&byte| byte.is_ascii_whitespace() || byte == b'"').unwrap_or(line.len());
    line[..end].eq_ignore_ascii_case(word)
}

/// The word that follows a keyword of the header.
fn value_of<'a>(line: &'a [u8], key: &[u8]) -> Option<&'a [u8]> {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    words.find(|word| word.eq_ignore_ascii_case(key))?;
    words.next()
}

/// One MESH of the file: its header, and the elements that it holds.
struct Piece {
    name: String,
    kind: Option<ElementShape>,
    elements: Range<usize>,
}

/// Elements as the header names them, with their dimension and the numbers of nodes that they may have.
const KINDS: &[(&[u8], u8, &[u8])] = &[
    (b"Point", 0, &[1]),
    (b"Line", 1, &[2, 3]),
    (b"Linear", 1, &[2, 3]),
    (b"Triangle", 2, &[3, 6]),
    (b"Quadrilateral", 2, &[4, 8, 9]),
    (b"Tetrahedra", 3, &[4, 10]),
    (b"Tetrahedron", 3, &[4, 10]),
    (b"Hexahedra", 3, &[8, 20, 27]),
    (b"Prism", 3, &[6, 15, 18]),
    (b"Pyramid", 3, &[5, 13]),
];

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    let mut lines = Words::new(bytes, Some(b'#'));
    let mut raw = RawMesh::default();
    let mut pieces: Vec<Piece> = Vec::new();
    // Whether an element of the dimension has a material.
    let mut has_material = [false; 4];
    let mut left_out = 0usize;
    while let Some((at, line)) = lines.full_line() {
        if is_word(line, b"mesh") {
            if pieces.len() > 1000 + bytes.len() / 100 {
                return refuse(at, format!("more than {} meshes in such a file", pieces.len() - 1));
            }
            pieces.push(header(at, line, raw.elements.len())?);
        } else if is_word(line, b"unit") {
            let unit = quoted(line).unwrap_or_default();
            raw.notices.push(format!(
                "the file says that its unit is \"{unit}\"; a scene says so with the key unit, such as unit = \"mm\""
            ));
        } else if is_word(line, b"coordinates") {
            coordinates(&mut lines, &mut raw)?;
        } else if is_word(line, b"elements") {
            let Some(piece) = pieces.last_mut() else {
                return refuse(at, "elements before the first MESH");
            };
            left_out += elements(&mut lines, &mut raw, piece.kind, &mut has_material)?;
            piece.elements.end = raw.elements.len();
        } else if !is_word(line, b"group") && !is_word(line, b"end") {
            let reason = format!(
                "expected MESH, Coordinates or Elements, found `{}`: is a mesh's End missing?",
                excerpt(line)
            );
            return refuse(at, reason);
        }
    }
    if left_out > 0 {
        raw.notices.push(format!("{left_out} spheres and circles have been left out"));
    }
    let solids = pieces.iter().filter(|piece| piece.kind.is_some_and(|kind| kind.is_tetrahedron)).count();
    for (piece, number) in pieces.iter().zip(1i32..) {
        let Some(dimension) = piece.kind.map(|kind| kind.dimension) else { continue };
        let is_told = has_material[usize::from(dimension)] || dimension == 3 && solids < 2;
        if is_told || piece.elements.is_empty() {
            continue;
        }
        raw.elements[piece.elements.clone()].iter_mut().for_each(|element| element.entity = number);
        raw.physicals.insert((dimension, number), vec![number.unsigned_abs()]);
        if !piece.name.is_empty() {
            raw.names.insert((dimension, number.unsigned_abs()), piece.name.clone());
        }
    }
    Ok(raw)
}

/// The text between the first two quotation marks.
fn quoted(line: &[u8]) -> Option<String> {
    let text = line.split(|&byte| byte == b'"').nth(1)?;
    Some(String::from_utf8_lossy(text).into_owned())
}

/// `MESH "name" dimension 3 ElemType Tetrahedra Nnode 4`; the name may be left out, or stand without quotes.
fn header(at: usize, line: &[u8], elements: usize) -> Result<Piece, FormatFault> {
    let name = quoted(line).unwrap_or_default();
    // A name may hold words of the header.
    let plain = line.rsplit(|&byte| byte == b'"').next().unwrap_or(line);
    let missing = |key: &str| {
        FormatFault::at(
            at,
            format!("MESH without {key}: write `MESH \"name\" dimension 3 ElemType Tetrahedra Nnode 4`"),
        )
    };
    let dimension = value_of(plain, b"dimension").ok_or_else(|| missing("dimension"))?;
    if dimension != b"3" {
        return refuse(at, format!("a mesh in {} dimensions, not 3", excerpt(dimension)));
    }
    let kind = value_of(plain, b"elemtype").ok_or_else(|| missing("ElemType"))?;
    let nodes = value_of(plain, b"nnode").ok_or_else(|| missing("Nnode"))?;
    let count: u8 = parsed(nodes, at, "the number of an element's nodes")?;
    let known = KINDS.iter().find(|(name, ..)| name.eq_ignore_ascii_case(kind));
    let kind = match known {
        Some((_, dimension, counts)) if counts.contains(&count) => {
            let is_tetrahedron = *dimension == 3 && matches!(count, 4 | 10);
            Some(ElementShape { dimension: *dimension, nodes: count, is_tetrahedron })
        }
        Some(_) => return refuse(at, format!("{} of {count} nodes are not known", excerpt(kind))),
        None if kind.eq_ignore_ascii_case(b"sphere") || kind.eq_ignore_ascii_case(b"circle") => None,
        None => {
            let known: Vec<&str> =
                KINDS.iter().filter_map(|(name, ..)| std::str::from_utf8(name).ok()).collect();
            return refuse(
                at,
                format!("elements of the kind {} are not known: {}", excerpt(kind), known.join(", ")),
            );
        }
    };
    Ok(Piece { name, kind, elements: elements..elements })
}

/// The next line of a block; `None` at its end.
fn inside<'a>(lines: &mut Words<'a>, block: &str) -> Result<Option<(usize, &'a [u8])>, FormatFault> {
    let at = lines.at;
    match lines.full_line() {
        Some((_, line)) if is_word(line, b"end") => Ok(None),
        Some(line) => Ok(Some(line)),
        None => refuse(at, format!("the file ends where End {block} is expected")),
    }
}

fn words(at: usize, line: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let words = line.split(u8::is_ascii_whitespace).scan(at, |next, word| {
        let here = *next;
        *next += word.len() + 1;
        Some((here, word))
    });
    words.filter(|(_, word)| !word.is_empty())
}

fn coordinates(lines: &mut Words, raw: &mut RawMesh) -> Result<(), FormatFault> {
    while let Some((at, line)) = inside(lines, "Coordinates")? {
        let mut words = words(at, line);
        let missing = || FormatFault::at(at, "expected the number of a node and three coordinates");
        let (tag_at, tag) = words.next().ok_or_else(missing)?;
        let tag = parsed(tag, tag_at, "the number of a node")?;
        let mut real =
            || words.next().ok_or_else(missing).and_then(|(at, word)| parsed(word, at, "a number"));
        let position = Vector3::new(real()?, real()?, real()?);
        raw.nodes.push(RawNode { tag, position, at });
    }
    Ok(())
}

/// Lines of number, nodes, and maybe a material; how many were left out. The nodes between corners stand on the edges 01,
/// 12, 02, 03, 13, 23.
fn elements(
    lines: &mut Words,
    raw: &mut RawMesh,
    kind: Option<ElementShape>,
    has_material: &mut [bool; 4],
) -> Result<usize, FormatFault> {
    let mut left_out = 0;
    let mut nodes = [0u64; 27];
    while let Some((at, line)) = inside(lines, "Elements")? {
        let Some(kind) = kind else {
            left_out += 1;
            continue;
        };
        let nodes = &mut nodes[..usize::from(kind.nodes)];
        let mut words = words(at, line);
        let missing = || {
            FormatFault::at(
                at,
                format!("expected the number of an element and those of its {} nodes", kind.nodes),
            )
        };
        let (tag_at, tag) = words.next().ok_or_else(missing)?;
        let tag = parsed(tag, tag_at, "the number of an element")?;
        for node in nodes.iter_mut() {
            let (at, word) = words.next().ok_or_else(missing)?;
            *node = parsed(word, at, "the number of a node")?;
        }
        if kind == ElementShape::TETRAHEDRON_10 {
            nodes.swap(8, 9);
        }
        let material = match words.next() {
            Some((at, word)) => parsed::<i32>(word, at, "the number of a material")?.max(0),
            None => 0,
        };
        has_material[usize::from(kind.dimension)] |= material > 0;
        raw.add(kind, tag, material, at, nodes);
    }
    Ok(left_out)
}
