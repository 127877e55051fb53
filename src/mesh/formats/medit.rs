//! Medit `.mesh`, text; binary `.meshb` is refused.
//!
//! In: bytes. Out: a [`RawMesh`] whose nodes are numbered from 1; a reference is the region of a tetrahedron, or the
//! node group of an edge or a face. After P. Frey, "MEDIT: An interactive mesh visualization software" (INRIA RT-0253,
//! 2001), appendix.

use super::format::{Encoded, Format, Part, Words, Writer};
use super::gmsh_scan::excerpt;
use super::write::{check, lost, put};
use crate::base::output::Kind;
use crate::mesh::assemble::{ElementShape, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, MeshError, refuse};
use crate::mesh::tet_mesh::TetMesh;
use nalgebra::Vector3;
use std::collections::BTreeSet;

pub const FORMAT: Format = Format {
    name: "Medit",
    extensions: &["mesh", "meshb"],
    recognizes,
    others: |_| Vec::new(),
    read,
    writers: &[Writer {
        name: "medit",
        about: "Medit, regions as references",
        files: &[("mesh", Kind { name: "a Medit mesh", recognizes })],
        encode,
    }],
};

fn recognizes(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MeshVersion")
}

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    if matches!(bytes.first_chunk(), Some([1, 0, 0, 0] | [0, 0, 0, 1])) {
        return Err(FormatFault::whole(
            "a binary Medit file is not read: save it as text, or `gmsh part.meshb -save -format mesh -o part.mesh`",
        ));
    }
    let mut words = Words::new(bytes, Some(b'#'));
    let mut raw = RawMesh::default();
    let mut seen = BTreeSet::new();
    let mut skipped = BTreeSet::new();
    let mut has_references = false;
    match words.word() {
        Some(b"MeshVersionFormatted") => {
            words.number::<u32>("a version")?;
        }
        other => {
            let found = excerpt(other.unwrap_or_default());
            let reason = format!("expected `MeshVersionFormatted`, found `{found}`: this is no Medit file");
            return refuse(0, reason);
        }
    }
    loop {
        words.skip_white();
        let at = words.at;
        let Some(keyword) = words.word() else { break };
        let name = excerpt(keyword);
        if !seen.insert(name.clone()) || seen.len() > 100 {
            return refuse(at, format!("a second section {name}, or the hundredth"));
        }
        match name.as_str() {
            "End" => break,
            "Dimension" => {
                let dimension: u32 = words.number("a dimension")?;
                if dimension != 3 {
                    return refuse(at, format!("a mesh in {dimension} dimensions, not 3"));
                }
            }
            "Vertices" => vertices(&mut words, &mut raw, &mut has_references)?,
            "Tetrahedra" => elements(&mut words, &mut raw, ElementShape::TETRAHEDRON)?,
            "Edges" => elements(&mut words, &mut raw, other(1, 2))?,
            "Triangles" => elements(&mut words, &mut raw, other(2, 3))?,
            "Quadrilaterals" => elements(&mut words, &mut raw, other(2, 4))?,
            "Hexahedra" | "Hexaedra" => elements(&mut words, &mut raw, other(3, 8))?,
            "Prisms" => elements(&mut words, &mut raw, other(3, 6))?,
            "Pyramids" => elements(&mut words, &mut raw, other(3, 5))?,
            _ if keyword[0].is_ascii_alphabetic() => {
                skip_numbers(&mut words);
                skipped.insert(name);
            }
            _ => {
                let reason =
                    format!("expected a section, found `{}`: more entries than said?", excerpt(keyword));
                return refuse(at, reason);
            }
        }
    }
    if !seen.contains("Vertices") {
        return Err(FormatFault::whole("no section Vertices: is this a whole Medit file?"));
    }
    if has_references {
        raw.notices.push("references of vertices are not used".to_owned());
    }
    if !skipped.is_empty() {
        let names: Vec<String> = skipped.into_iter().collect();
        raw.notices.push(format!("sections not used: {}", names.join(", ")));
    }
    Ok(raw)
}

fn other(dimension: u8, nodes: u8) -> ElementShape {
    ElementShape { dimension, nodes, is_tetrahedron: false }
}

fn vertices(words: &mut Words, raw: &mut RawMesh, has_references: &mut bool) -> Result<(), FormatFault> {
    let count: u64 = words.number("a count")?;
    for tag in 1..=count {
        words.skip_white();
        let at = words.at;
        let mut real = || words.number("a number");
        let position = Vector3::new(real()?, real()?, real()?);
        *has_references |= words.number::<i64>("a reference")? != 0;
        raw.nodes.push(RawNode { tag, position, at });
    }
    Ok(())
}

/// Nodes and reference of each element; it is numbered within its section.
fn elements(words: &mut Words, raw: &mut RawMesh, kind: ElementShape) -> Result<(), FormatFault> {
    let count: u64 = words.number("a count")?;
    let mut nodes = [0; 8];
    for tag in 1..=count {
        words.skip_white();
        let at = words.at;
        let nodes = &mut nodes[..usize::from(kind.nodes)];
        for node in nodes.iter_mut() {
            *node = words.number("the number of a vertex")?;
        }
        let reference: i32 = words.number("a reference")?;
        raw.add(kind, tag, reference.saturating_abs(), at, nodes);
    }
    Ok(())
}

/// Moves to the next word that does not begin like a number.
fn skip_numbers(words: &mut Words) {
    loop {
        let mut ahead = *words;
        match ahead.word() {
            Some(word) if !word[0].is_ascii_alphabetic() => *words = ahead,
            _ => return,
        }
    }
}

fn encode(mesh: &TetMesh) -> Result<Encoded, MeshError> {
    check(mesh, "Medit")?;
    let mut text = String::from("MeshVersionFormatted 2\nDimension 3\n");
    put(&mut text, format_args!("Vertices\n{}\n", mesh.nodes.len()));
    for x in &mesh.nodes {
        put(&mut text, format_args!("{:?} {:?} {:?} 0\n", x.x, x.y, x.z));
    }
    put(&mut text, format_args!("Tetrahedra\n{}\n", mesh.tets.len()));
    for (tet, region) in mesh.tets.iter().zip(&mesh.regions) {
        let [a, b, c, d] = tet.map(|node| u64::from(node) + 1);
        put(&mut text, format_args!("{a} {b} {c} {d} {region}\n"));
    }
    text.push_str("End\n");
    Ok(Encoded { files: vec![text.into_bytes()], lost: lost(mesh, 1) })
}
