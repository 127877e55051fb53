//! TetGen `.node` and `.ele`, a pair of files of one name.
//!
//! In: the bytes of both. Out: a [`RawMesh`] with the files' numbers; the first attribute of a tetrahedron is its
//! region. After Hang Si, "TetGen: A Quality Tetrahedral Mesh Generator", section "File formats".

use super::format::{Encoded, Format, Part, Words, Writer, parsed};
use super::gmsh_scan::excerpt;
use super::write::{check, lost, put};
use crate::base::output::Kind;
use crate::mesh::assemble::{ElementShape, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, MeshError, refuse};
use crate::mesh::tet_mesh::TetMesh;
use nalgebra::Vector3;
use std::path::{Path, PathBuf};

pub const FORMAT: Format = Format {
    name: "TetGen",
    extensions: &["node", "ele"],
    recognizes: |_| false,
    others,
    read,
    writers: &[Writer {
        name: "tetgen",
        about: "TetGen, a pair of files, regions as attribute",
        files: &[
            ("node", Kind { name: "a TetGen .node file", recognizes: opens_nodes }),
            ("ele", Kind { name: "a TetGen .ele file", recognizes: opens_elements }),
        ],
        encode,
    }],
};

fn is_node(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("node"))
}

/// The `.ele` of a `.node`, or the `.node` of an `.ele`; in capitals where there is only such a one.
fn others(path: &Path) -> Vec<PathBuf> {
    let small = path.with_extension(if is_node(path) { "ele" } else { "node" });
    let large = path.with_extension(if is_node(path) { "ELE" } else { "NODE" });
    vec![if !small.exists() && large.exists() { large } else { small }]
}

/// Whether these are the first bytes of a .node file: the numbers of nodes, dimensions (3), attributes and markers.
fn opens_nodes(head: &[u8]) -> bool {
    matches!(first_numbers(head)[..], [_, 3] | [_, 3, _] | [_, 3, _, _])
}

/// Whether these are the first bytes of an .ele file: the numbers of tetrahedra, nodes of each and attributes.
fn opens_elements(head: &[u8]) -> bool {
    matches!(first_numbers(head)[..], [_, 4 | 10] | [_, 4 | 10, _])
}

/// The numbers of the first line that is no comment; none if any of its words is no number.
fn first_numbers(head: &[u8]) -> Vec<u64> {
    let Some((_, line)) = Words::new(head, Some(b'#')).full_line() else { return Vec::new() };
    let words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).take(5);
    let numbers = words.map(|word| std::str::from_utf8(word).ok()?.parse().ok());
    numbers.collect::<Option<_>>().unwrap_or_default()
}

fn read(bytes: &[u8], others: &[Part]) -> Result<RawMesh, FormatFault> {
    let [other] = others else {
        return Err(FormatFault::whole("a TetGen mesh is a .node file and an .ele file"));
    };
    // A fault in the file that was not named names that file itself.
    let in_other =
        |fault: FormatFault| FormatFault::whole(fault.in_file(&other.path, &other.bytes).to_string());
    let mut raw = RawMesh::default();
    if is_node(&other.path) {
        nodes(&other.bytes, &mut raw).map_err(in_other)?;
        elements(bytes, &mut raw)?;
    } else {
        nodes(bytes, &mut raw)?;
        elements(&other.bytes, &mut raw).map_err(in_other)?;
        raw.elements_in = Some(0);
    }
    Ok(raw)
}

/// The words of a line, and its offset.
struct Line<'a> {
    at: usize,
    words: Vec<&'a [u8]>,
}

impl<'a> Line<'a> {
    /// The next line that is not empty. It must have `count` words, or any number where `count` is 0.
    fn next(words: &mut Words<'a>, count: usize) -> Result<Line<'a>, FormatFault> {
        let Some((at, line)) = words.full_line() else {
            return refuse(words.at, "the file ends before the entries that its head counts");
        };
        let split = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let line = Line { at, words: split.take(1000).collect() };
        if count > 0 && line.words.len() != count {
            return refuse(at, format!("{count} numbers are expected here, found {}", line.words.len()));
        }
        Ok(line)
    }

    fn count(&self, i: usize, default: u64) -> Result<u64, FormatFault> {
        self.words.get(i).map_or(Ok(default), |word| parsed(word, self.at, "a count"))
    }

    fn columns(&self, i: usize) -> Result<usize, FormatFault> {
        let count = self.count(i, 0)?;
        usize::try_from(count).ok().filter(|&count| count <= 100).ok_or_else(|| {
            FormatFault::at(self.at, format!("{count} columns of attributes or markers are too many"))
        })
    }
}

/// Refuses words behind the last entry.
fn end(words: &mut Words) -> Result<(), FormatFault> {
    match words.full_line() {
        None => Ok(()),
        Some((at, line)) => {
            let reason = format!("more entries than the file's head says: `{}`", excerpt(line));
            refuse(at, reason)
        }
    }
}

/// Head: nodes, dimension, attributes, markers. Each line: number, x, y, z, attributes, marker.
fn nodes(bytes: &[u8], raw: &mut RawMesh) -> Result<(), FormatFault> {
    let mut words = Words::new(bytes, Some(b'#'));
    let head = Line::next(&mut words, 0)?;
    let (count, dimension) = (head.count(0, 0)?, head.count(1, 3)?);
    if dimension != 3 {
        return refuse(head.at, format!("nodes in {dimension} dimensions, not 3"));
    }
    let (attributes, markers) = (head.columns(2)?, head.columns(3)?);
    let mut has_markers = false;
    for _ in 0..count {
        let Line { at, words } = Line::next(&mut words, 4 + attributes + markers)?;
        let tag = parsed(words[0], at, "the number of a node")?;
        let real = |i: usize| parsed::<f64>(words[i], at, "a number");
        let position = Vector3::new(real(1)?, real(2)?, real(3)?);
        let first = raw.nodes.first().map_or(tag, |node| node.tag);
        let expected = first.saturating_add(raw.nodes.len() as u64);
        if tag != expected || first > 1 {
            return refuse(at, format!("node {tag}: nodes are numbered in sequence from 0 or from 1"));
        }
        if !position.iter().all(|x| x.is_finite()) {
            return refuse(at, format!("node {tag} has a coordinate that is no finite number"));
        }
        has_markers |= markers > 0 && words[words.len() - 1] != b"0";
        raw.nodes.push(RawNode { tag, position, at });
    }
    if attributes > 0 || has_markers {
        raw.notices.push("attributes and boundary markers of nodes are not used".to_owned());
    }
    end(&mut words)
}

/// Head: tetrahedra, nodes of each (4 or 10), attributes. Each line: number, nodes, attributes.
fn elements(bytes: &[u8], raw: &mut RawMesh) -> Result<(), FormatFault> {
    let mut words = Words::new(bytes, Some(b'#'));
    let head = Line::next(&mut words, 0)?;
    let (count, size, attributes) = (head.count(0, 0)?, head.count(1, 4)?, head.columns(2)?);
    let size = match size {
        4 => 4,
        10 => 10,
        other => return refuse(head.at, format!("tetrahedra of {other} nodes, neither 4 nor 10")),
    };
    let mut odd = 0;
    for _ in 0..count {
        let Line { at, words } = Line::next(&mut words, 1 + size + attributes)?;
        let tag = parsed(words[0], at, "the number of a tetrahedron")?;
        let mut nodes = [0; 4];
        for (node, word) in nodes.iter_mut().zip(&words[1..]) {
            *node = parsed(word, at, "the number of a node")?;
        }
        let mut region = 0;
        if attributes > 0 {
            let value: f64 = parsed(words[1 + size], at, "an attribute")?;
            if value.fract() == 0.0 && value.abs() <= f64::from(i32::MAX) {
                region = (value as i32).abs();
            } else {
                odd += 1;
            }
        }
        raw.add(ElementShape::TETRAHEDRON, tag, region, at, &nodes);
    }
    if odd > 0 {
        let reason = "tetrahedra have an attribute that is no whole number: their region is 0";
        raw.notices.push(format!("{odd} {reason}"));
    }
    if attributes > 1 {
        raw.notices
            .push("of the attributes of a tetrahedron only the first is used, as its region".to_owned());
    }
    if size == 10 && count > 0 {
        raw.notices.push(format!("{count} tetrahedra of 10 nodes: only their 4 corners are used"));
    }
    end(&mut words)
}

/// Encodes both files. Node numbers start at 0 or at 1, as TetGen requires; the mesh's own are kept where they do.
fn encode(mesh: &TetMesh) -> Result<Encoded, MeshError> {
    check(mesh, "TetGen")?;
    let first = u64::from(mesh.tags.first() != Some(&0));
    let mut nodes = format!("{} 3 0 0\n", mesh.nodes.len());
    for (x, tag) in mesh.nodes.iter().zip(first..) {
        put(&mut nodes, format_args!("{tag} {:?} {:?} {:?}\n", x.x, x.y, x.z));
    }
    let mut elements = format!("{} 4 1\n", mesh.tets.len());
    for ((tet, region), number) in mesh.tets.iter().zip(&mesh.regions).zip(first..) {
        let [a, b, c, d] = tet.map(|node| u64::from(node) + first);
        put(&mut elements, format_args!("{number} {a} {b} {c} {d} {region}\n"));
    }
    let files = vec![nodes.into_bytes(), elements.into_bytes()];
    Ok(Encoded { files, lost: lost(mesh, first) })
}
