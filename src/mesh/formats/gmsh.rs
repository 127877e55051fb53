//! Gmsh `.msh` 2.2, 4.0 and 4.1, text or binary: the sections that all versions share, and `$Nodes` and `$Elements` of 2.2.
//!
//! In: bytes. Out: a [`RawMesh`]. After the Gmsh reference manual, chapter "Gmsh file formats", sections "MSH file
//! format" and "Legacy formats". Sections may stand in any order; unknown ones are skipped.

use super::format::{Encoded, Format, Part, Writer};
use super::gmsh_scan::{Mode, Scanner, excerpt, known_kind};
use super::gmsh_write::{Encoding, encode};
use super::gmsh4;
use super::gmsh4::Layout;
use crate::base::output::Kind;
use crate::mesh::assemble::{ElementShape, RawElement, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, MeshError, refuse};
use crate::mesh::tet_mesh::TetMesh;
use nalgebra::Vector3;
use std::collections::BTreeSet;

type Encode = fn(&TetMesh) -> Result<Encoded, MeshError>;

const fn msh(name: &'static str, about: &'static str, encode: Encode) -> Writer {
    Writer { name, about, files: &[("msh", Kind { name: "a Gmsh mesh", recognizes })], encode }
}

pub const FORMAT: Format = Format {
    name: "Gmsh 2.2, 4.0 and 4.1",
    extensions: &["msh"],
    recognizes,
    others: |_| Vec::new(),
    read,
    writers: &[
        msh("msh41", "Gmsh 4.1, text", |mesh| encoded(mesh, Encoding::Gmsh41Text)),
        msh("msh41-binary", "Gmsh 4.1, binary", |mesh| encoded(mesh, Encoding::Gmsh41Binary)),
        msh("msh22", "Gmsh 2.2, text", |mesh| encoded(mesh, Encoding::Gmsh22Text)),
        msh("msh22-binary", "Gmsh 2.2, binary", |mesh| encoded(mesh, Encoding::Gmsh22Binary)),
    ],
};

fn recognizes(bytes: &[u8]) -> bool {
    bytes.starts_with(b"$MeshFormat")
}

fn encoded(mesh: &TetMesh, encoding: Encoding) -> Result<Encoded, MeshError> {
    Ok(Encoded { files: vec![encode(mesh, encoding)?], lost: Vec::new() })
}

const ADVICE: &str = "convert it with `gmsh old.msh -save -format msh41 -o new.msh`";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Version {
    V2,
    V4(gmsh4::Layout),
}

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    use Version::{V2, V4};
    let mut scan = Scanner::new(bytes);
    let mut raw = RawMesh::default();
    let mut version = None;
    let mut seen = BTreeSet::new();
    let mut skipped = BTreeSet::new();
    loop {
        scan.skip_white();
        let at = scan.at();
        let Some(name) = scan.section()? else { break };
        match (name, version) {
            ("NOD" | "ELM", _) => return refuse(at, format!("Gmsh 1.0 is not read: {ADVICE}")),
            ("MeshFormat", None) => version = Some(mesh_format(&mut scan)?),
            ("Nodes" | "Elements" | "Entities" | "PartitionedEntities" | "PhysicalNames", None) => {
                return refuse(at, format!("${name} stands before $MeshFormat"));
            }
            ("ParametricNodes", _) => {
                let reason = "nodes with parametric coordinates are read in Gmsh 4.1 only: save with \
                              Mesh.SaveParametric = 0, or as 4.1";
                return refuse(at, reason);
            }
            ("PhysicalNames", _) => physical_names(&mut scan, &mut raw)?,
            ("Nodes", Some(V2)) => nodes(&mut scan, &mut raw)?,
            ("Elements", Some(V2)) => elements(&mut scan, &mut raw)?,
            ("Nodes", Some(V4(layout))) => gmsh4::nodes(&mut scan, &mut raw, layout)?,
            ("Elements", Some(V4(layout))) => gmsh4::elements(&mut scan, &mut raw, layout)?,
            ("Entities", Some(V4(layout))) => gmsh4::entities(&mut scan, &mut raw, layout)?,
            ("PartitionedEntities", Some(V4(Layout::Old))) => {
                return refuse(at, format!("a partitioned mesh of Gmsh 4.0 is not read: {ADVICE}"));
            }
            ("PartitionedEntities", Some(V4(Layout::New))) => {
                gmsh4::partitioned_entities(&mut scan, &mut raw)?;
            }
            _ => {
                scan.skip_section(at, name)?;
                skipped.insert(name);
                continue;
            }
        }
        scan.end_section(name)?;
        if !seen.insert(name) {
            return refuse(at, format!("a second section ${name}"));
        }
    }
    for name in ["MeshFormat", "Nodes", "Elements"] {
        if !seen.contains(name) {
            return Err(FormatFault::whole(format!("no section ${name}: is this a whole Gmsh mesh file?")));
        }
    }
    if !skipped.is_empty() {
        let names: Vec<String> =
            skipped.iter().map(|name| format!("${}", excerpt(name.as_bytes()))).collect();
        raw.notices.push(format!("sections not used: {}", names.join(", ")));
    }
    Ok(raw)
}

/// `version file-type data-size`, and in a binary file the number 1 that marks the byte order.
fn mesh_format(scan: &mut Scanner) -> Result<Version, FormatFault> {
    let at = scan.at();
    let line = String::from_utf8_lossy(scan.line());
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let &[version, file_type, data_size] = words.as_slice() else {
        let reason =
            format!("expected version, file type and data size, found `{}`", excerpt(line.as_bytes()));
        return refuse(at, reason);
    };
    let version = match version {
        "2" | "2.0" | "2.1" | "2.2" => Version::V2,
        "4" | "4.0" => Version::V4(Layout::Old),
        "4.1" => Version::V4(Layout::New),
        other => {
            let reason =
                format!("Gmsh {} is not read, only 2.2, 4.0 and 4.1: {ADVICE}", excerpt(other.as_bytes()));
            return refuse(at, reason);
        }
    };
    match file_type {
        "0" => return Ok(version),
        "1" => {}
        other => {
            let reason =
                format!("file type {} is neither 0 (text) nor 1 (binary)", excerpt(other.as_bytes()));
            return refuse(at, reason);
        }
    }
    let size_bytes = match (version, data_size) {
        (Version::V2, "8") | (Version::V4(Layout::New), "4") => 4,
        (Version::V4(_), "8") => 8,
        _ => return refuse(at, format!("data size {} is not read", excerpt(data_size.as_bytes()))),
    };
    let at = scan.at();
    let big_endian = match scan.take()? {
        [1, 0, 0, 0] => false,
        [0, 0, 0, 1] => true,
        other => {
            return refuse(at, format!("expected the number 1 that marks the byte order, found {other:?}"));
        }
    };
    scan.mode = Mode::Binary { big_endian, size_bytes };
    Ok(version)
}

/// Lines of `dimension number "name"`; text in binary files too.
fn physical_names(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), FormatFault> {
    for _ in 0..scan.count_line()? {
        scan.skip_white();
        let at = scan.at();
        let line = scan.line();
        let (key, name) = physical_name(line).ok_or_else(|| {
            let reason = format!("expected `dimension number \"name\"` in UTF-8, found `{}`", excerpt(line));
            FormatFault::at(at, reason)
        })?;
        if let Some(other) = raw.names.insert(key, name.to_owned()) {
            let reason = format!("physical group {} of dimension {} is also named \"{other}\"", key.1, key.0);
            return refuse(at, reason);
        }
    }
    Ok(())
}

fn physical_name(line: &[u8]) -> Option<((u8, u32), &str)> {
    let (head, tail) = std::str::from_utf8(line).ok()?.split_once('"')?;
    let name = tail.strip_suffix('"')?;
    let mut words = head.split_ascii_whitespace();
    let dimension = words.next()?.parse().ok().filter(|dimension| *dimension <= 3)?;
    let number: i32 = words.next()?.parse().ok()?;
    words.next().is_none().then_some(((dimension, number.unsigned_abs()), name))
}

/// `$Nodes` of version 2.2.
pub fn nodes(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), FormatFault> {
    for _ in 0..scan.count_line()? {
        let at = scan.at();
        let tag = scan.size()?;
        let position = Vector3::new(scan.real()?, scan.real()?, scan.real()?);
        scan.end_line()?;
        raw.nodes.push(RawNode { tag, position, at });
    }
    Ok(())
}

/// `$Elements` of version 2.2. An element's first tag is its physical group, which stands in for the geometric entity of
/// version 4.
pub fn elements(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), FormatFault> {
    let at = scan.at();
    let mut left = scan.count_line()?;
    while left > 0 {
        let header_at = scan.at();
        if scan.mode == Mode::Text {
            let tag = scan.size()?;
            let kind = known_kind(scan.int()?, header_at)?;
            let tag_count = scan.size()?;
            element(scan, raw, RawElement { tag, kind, entity: 0, at: header_at }, tag_count)?;
            scan.end_line()?;
            left -= 1;
            continue;
        }
        let kind: ElementShape = known_kind(scan.int()?, header_at)?;
        let (follow, tag_count) = (scan.size()?, scan.size()?);
        left = left
            .checked_sub(follow)
            .ok_or_else(|| FormatFault::at(at, "more elements than the section's count says".to_owned()))?;
        for _ in 0..follow {
            let at = scan.at();
            let tag = scan.size()?;
            element(scan, raw, RawElement { tag, kind, entity: 0, at }, tag_count)?;
        }
    }
    Ok(())
}

/// The tags and nodes of one element.
fn element(
    scan: &mut Scanner,
    raw: &mut RawMesh,
    mut element: RawElement,
    tag_count: u64,
) -> Result<(), FormatFault> {
    for i in 0..tag_count {
        let tag = scan.int()?;
        if i == 0 {
            element.entity = tag;
        }
    }
    for _ in 0..element.kind.nodes {
        raw.corners.push(scan.size()?);
    }
    let key = (element.kind.dimension, element.entity);
    raw.physicals.entry(key).or_insert_with(|| vec![element.entity.unsigned_abs()]);
    raw.elements.push(element);
    Ok(())
}
