//! Gmsh `.msh` 2.2, 4.0 and 4.1, text or binary: the sections that all share.
//!
//! In: bytes. Out: a [`RawMesh`]. After the Gmsh reference manual, chapter "Gmsh file formats", sections "MSH file
//! format" and "Legacy formats". Sections may stand in any order; unknown ones are skipped.

use super::gmsh_scan::{Mode, Scanner, excerpt};
use super::gmsh4::{self, Layout};
use super::{Format, Part, gmsh2};
use crate::mesh::assemble::{Kind, RawMesh};
use crate::mesh::error::Fault;
use std::collections::BTreeSet;

pub const FORMAT: Format = Format {
    name: "Gmsh 2.2, 4.0 and 4.1",
    extensions: &["msh"],
    recognizes: |bytes| bytes.starts_with(b"$MeshFormat"),
    others: |_| Vec::new(),
    read,
};

const ADVICE: &str = "convert it with `gmsh old.msh -save -format msh41 -o new.msh`";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Version {
    V2,
    V4(gmsh4::Layout),
}

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, Fault> {
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
            ("NOD" | "ELM", _) => {
                return Err(Fault::at(at, format!("Gmsh 1.0 is not read: {ADVICE}")));
            }
            ("MeshFormat", None) => version = Some(mesh_format(&mut scan)?),
            ("Nodes" | "Elements" | "Entities" | "PartitionedEntities" | "PhysicalNames", None) => {
                return Err(Fault::at(at, format!("${name} stands before $MeshFormat")));
            }
            ("ParametricNodes", _) => {
                let reason = "nodes with parametric coordinates are read in Gmsh 4.1 only: save with \
                              Mesh.SaveParametric = 0, or as 4.1";
                return Err(Fault::at(at, reason));
            }
            ("PhysicalNames", _) => physical_names(&mut scan, &mut raw)?,
            ("Nodes", Some(V2)) => gmsh2::nodes(&mut scan, &mut raw)?,
            ("Elements", Some(V2)) => gmsh2::elements(&mut scan, &mut raw)?,
            ("Nodes", Some(V4(layout))) => gmsh4::nodes(&mut scan, &mut raw, layout)?,
            ("Elements", Some(V4(layout))) => gmsh4::elements(&mut scan, &mut raw, layout)?,
            ("Entities", Some(V4(layout))) => gmsh4::entities(&mut scan, &mut raw, layout)?,
            ("PartitionedEntities", Some(V4(Layout::Old))) => {
                return Err(Fault::at(at, format!("a partitioned mesh of Gmsh 4.0 is not read: {ADVICE}")));
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
            return Err(Fault::at(at, format!("a second section ${name}")));
        }
    }
    for name in ["MeshFormat", "Nodes", "Elements"] {
        if !seen.contains(name) {
            return Err(Fault::whole(format!("no section ${name}: is this a whole Gmsh mesh file?")));
        }
    }
    if !skipped.is_empty() {
        let names: Vec<String> =
            skipped.iter().map(|name| format!("${}", excerpt(name.as_bytes()))).collect();
        raw.notices.push(format!("sections not used: {}", names.join(", ")));
    }
    Ok(raw)
}

/// `version file-type data-size`, and in a binary file the number 1 that tells the byte order.
fn mesh_format(scan: &mut Scanner) -> Result<Version, Fault> {
    let at = scan.at();
    let line = String::from_utf8_lossy(scan.line());
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let &[version, file_type, data_size] = words.as_slice() else {
        let reason =
            format!("expected version, file type and data size, found `{}`", excerpt(line.as_bytes()));
        return Err(Fault::at(at, reason));
    };
    let version = match version {
        "2" | "2.0" | "2.1" | "2.2" => Version::V2,
        "4" | "4.0" => Version::V4(Layout::Old),
        "4.1" => Version::V4(Layout::New),
        other => {
            let reason =
                format!("Gmsh {} is not read, only 2.2, 4.0 and 4.1: {ADVICE}", excerpt(other.as_bytes()));
            return Err(Fault::at(at, reason));
        }
    };
    match file_type {
        "0" => return Ok(version),
        "1" => {}
        other => {
            let reason =
                format!("file type {} is neither 0 (text) nor 1 (binary)", excerpt(other.as_bytes()));
            return Err(Fault::at(at, reason));
        }
    }
    let size_bytes = match (version, data_size) {
        (Version::V2, "8") | (Version::V4(Layout::New), "4") => 4,
        (Version::V4(_), "8") => 8,
        _ => {
            let reason = format!("data size {} is not read", excerpt(data_size.as_bytes()));
            return Err(Fault::at(at, reason));
        }
    };
    let at = scan.at();
    let big_endian = match scan.take()? {
        [1, 0, 0, 0] => false,
        [0, 0, 0, 1] => true,
        other => {
            return Err(Fault::at(
                at,
                format!("expected the number 1 that tells the byte order, found {other:?}"),
            ));
        }
    };
    scan.mode = Mode::Binary { big_endian, size_bytes };
    Ok(version)
}

/// Lines of `dimension number "name"`; text in binary files too.
fn physical_names(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), Fault> {
    for _ in 0..scan.count_line()? {
        scan.skip_white();
        let at = scan.at();
        let line = scan.line();
        let (key, name) = physical_name(line).ok_or_else(|| {
            let reason = format!("expected `dimension number \"name\"` in UTF-8, found `{}`", excerpt(line));
            Fault::at(at, reason)
        })?;
        if let Some(other) = raw.names.insert(key, name.to_owned()) {
            let reason = format!("physical group {} of dimension {} is also named \"{other}\"", key.1, key.0);
            return Err(Fault::at(at, reason));
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

/// Dimension and nodes of Gmsh's element type `number`.
pub fn kind(number: i32) -> Option<Kind> {
    let (dimension, nodes) = match number {
        15 => (0, 1),
        1 => (1, 2),
        8 => (1, 3),
        26 => (1, 4),
        27 => (1, 5),
        28 => (1, 6),
        2 => (2, 3),
        9 => (2, 6),
        20 => (2, 9),
        21 => (2, 10),
        22 => (2, 12),
        23 | 24 => (2, 15),
        25 => (2, 21),
        3 => (2, 4),
        16 => (2, 8),
        10 => (2, 9),
        4 => (3, 4),
        11 => (3, 10),
        29 => (3, 20),
        30 => (3, 35),
        31 => (3, 56),
        5 => (3, 8),
        17 => (3, 20),
        12 => (3, 27),
        6 => (3, 6),
        18 => (3, 15),
        13 => (3, 18),
        7 => (3, 5),
        19 => (3, 13),
        14 => (3, 14),
        92 => (3, 64),
        93 => (3, 125),
        _ => return None,
    };
    Some(Kind { dimension, nodes, is_tetrahedron: matches!(number, 4 | 11 | 29 | 30 | 31) })
}

/// [`kind`], refused at `at` when unknown.
pub fn known_kind(number: i32, at: usize) -> Result<Kind, Fault> {
    kind(number).ok_or_else(|| Fault::at(at, format!("element type {number} is not known")))
}
