//! Reads and writes Abaqus and CalculiX `.inp`: nodes, elements C3D4 and C3D10, and their sets.
//!
//! In: bytes. Out: a [`RawMesh`] with the file's numbers; node sets become node groups, element sets regions (see
//! [`super::abaqus_sets`]). After "Abaqus Keywords Reference Guide" and G. Dhondt, "CalculiX CrunchiX User's Manual",
//! chapter "Input deck format". Keywords of the analysis are skipped; those that move or create nodes are refused.

use super::abaqus_sets::{Keyword, Sets, data_line, fields, skip_data};
use super::format::{Encoded, Format, Part, Words, Writer, parsed};
use super::gmsh_scan::excerpt;
use super::write::{check, own_groups, put};
use crate::base::output::Kind;
use crate::mesh::assemble::{ElementShape, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, MeshError, refuse};
use crate::mesh::tet_mesh::TetMesh;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

pub const FORMAT: Format = Format {
    name: "Abaqus and CalculiX",
    extensions: &["inp"],
    recognizes,
    others: |_| Vec::new(),
    read,
    writers: &[Writer {
        name: "abaqus",
        about: "Abaqus and CalculiX, regions and node groups as sets",
        files: &[("inp", Kind { name: "an Abaqus mesh", recognizes })],
        encode,
    }],
};

fn recognizes(bytes: &[u8]) -> bool {
    let head = bytes.get(..bytes.len().min(2000)).unwrap_or_default().to_ascii_uppercase();
    [&b"*HEADING"[..], b"*NODE"].iter().any(|word| head.windows(word.len()).any(|window| window == *word))
}

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    let mut deck = Deck { lines: Words::new(bytes, None), raw: RawMesh::default(), others: BTreeMap::new() };
    let mut node_sets = Sets::new(bytes.len());
    let mut element_sets = Sets::new(bytes.len());
    let mut once = BTreeSet::new();
    while let Some((at, line)) = deck.lines.full_line() {
        if line.starts_with(b"**") {
            continue;
        }
        if !line.starts_with(b"*") {
            return refuse(at, format!("expected a keyword (*NAME), found `{}`", excerpt(line)));
        }
        let keyword = Keyword::read(at, line, &mut deck.lines)?;
        match keyword.name.as_str() {
            "NODE" => {
                let first = deck.raw.nodes.len();
                deck.nodes(&keyword)?;
                if let Some(name) = keyword.value("NSET") {
                    node_sets.add_span(name, first..deck.raw.nodes.len(), at)?;
                }
            }
            "ELEMENT" => {
                let first = deck.raw.elements.len();
                deck.elements(&keyword)?;
                if let Some(name) = keyword.value("ELSET") {
                    element_sets.add_span(name, first..deck.raw.elements.len(), at)?;
                }
            }
            "NSET" => node_sets.read(&keyword, "NSET", &mut deck.lines)?,
            "ELSET" => element_sets.read(&keyword, "ELSET", &mut deck.lines)?,
            "SOLID SECTION" => {
                if let Some(name) = keyword.value("ELSET") {
                    element_sets.sections.insert(name.to_uppercase());
                }
                skip_data(&mut deck.lines);
            }
            "INCLUDE" => {
                return refuse(at, "*INCLUDE is not followed: put the lines of that file in its place");
            }
            "PART" | "INSTANCE" => {
                if !once.insert(keyword.name.clone()) {
                    let reason = "a second part or instance: save the model without parts and assemblies";
                    return refuse(at, reason);
                }
                if data_line(&mut deck.lines).is_some() {
                    let reason = "an instance that is moved: save the model without parts and assemblies";
                    return refuse(at, reason);
                }
            }
            "NGEN" | "NFILL" | "NCOPY" | "NMAP" | "ELGEN" | "ELCOPY" | "SYSTEM" => {
                let reason =
                    format!("*{} makes or moves nodes and is not read: save a flat file", keyword.name);
                return refuse(at, reason);
            }
            _ => skip_data(&mut deck.lines),
        }
    }
    let Deck { mut raw, others, .. } = deck;
    for (kind, count) in &others {
        raw.notices.push(format!("{count} elements of type {kind} have been left out"));
    }
    if raw.elements.is_empty() {
        let kinds: Vec<String> =
            others.iter().map(|(kind, count)| format!("{count} of type {kind}")).collect();
        let reason = match kinds.as_slice() {
            [] => "the file holds no elements".to_owned(),
            _ => format!(
                "no tetrahedra (C3D4, C3D10) among its elements: {}. Mesh the volume by tetrahedra",
                kinds.join(", ")
            ),
        };
        return Err(FormatFault::whole(reason));
    }
    node_sets.to_groups(&mut raw)?;
    element_sets.to_regions(&mut raw)?;
    Ok(raw)
}

struct Deck<'a> {
    lines: Words<'a>,
    raw: RawMesh,
    /// Elements left out, by type.
    others: BTreeMap<String, usize>,
}

impl Deck<'_> {
    /// Reads lines of number, x, y, z; omitted coordinates are 0.
    fn nodes(&mut self, keyword: &Keyword) -> Result<(), FormatFault> {
        if keyword.value("SYSTEM").is_some_and(|system| !system.eq_ignore_ascii_case("R")) {
            return refuse(keyword.at, "nodes in cylinder or sphere coordinates: save them as x, y, z");
        }
        while let Some((at, line)) = data_line(&mut self.lines) {
            let mut fields = fields(line);
            let tag = parsed(fields.next().unwrap_or_default(), at, "the number of a node")?;
            let mut position = Vector3::zeros();
            for (x, field) in position.iter_mut().zip(fields).filter(|(_, field)| !field.is_empty()) {
                *x = real(field, at)?;
            }
            self.raw.nodes.push(RawNode { tag, position, at });
        }
        Ok(())
    }

    /// Reads number and nodes of each element, which may continue over several lines.
    fn elements(&mut self, keyword: &Keyword) -> Result<(), FormatFault> {
        let name = keyword.value("TYPE").unwrap_or_default().to_uppercase();
        let kind = match name.as_str() {
            "C3D4" | "C3D4H" => ElementShape::TETRAHEDRON,
            "C3D10" | "C3D10M" | "C3D10H" | "C3D10MH" | "C3D10I" | "C3D10HS" | "C3D10T" => {
                ElementShape::TETRAHEDRON_10
            }
            _ => {
                let mut continued = false;
                while let Some((_, line)) = data_line(&mut self.lines) {
                    if !continued {
                        *self.others.entry(excerpt(name.as_bytes())).or_default() += 1;
                    }
                    continued = line.ends_with(b",");
                }
                return Ok(());
            }
        };
        let wanted = 1 + usize::from(kind.nodes);
        while let Some((at, line)) = data_line(&mut self.lines) {
            let mut numbers = [0; 11];
            let mut found = 0;
            let (mut line_at, mut line) = (at, line);
            loop {
                for field in fields(line) {
                    let number = parsed(field, line_at, "the number of a node")?;
                    let place = numbers[..wanted].get_mut(found).ok_or_else(|| {
                        FormatFault::at(line_at, format!("more than the {} nodes of a {name}", kind.nodes))
                    })?;
                    *place = number;
                    found += 1;
                }
                if found == wanted {
                    break;
                }
                (line_at, line) = data_line(&mut self.lines).ok_or_else(|| {
                    FormatFault::at(
                        at,
                        format!("{} of the {} nodes of a {name}", found.max(1) - 1, kind.nodes),
                    )
                })?;
            }
            if kind == ElementShape::TETRAHEDRON_10 {
                numbers.swap(9, 10);
            }
            self.raw.add(kind, numbers[0], 0, at, &numbers[1..wanted]);
        }
        Ok(())
    }
}

/// A number that may be written as in Fortran, 1.5D-3.
fn real(field: &[u8], at: usize) -> Result<f64, FormatFault> {
    match parsed(field, at, "a number") {
        Err(_) if field.iter().any(|byte| matches!(byte, b'd' | b'D')) => {
            let e = |byte: &u8| if matches!(byte, b'd' | b'D') { b'e' } else { *byte };
            parsed(&field.iter().map(e).collect::<Vec<u8>>(), at, "a number")
        }
        other => other,
    }
}

/// The bytes of a deck: *NODE with the mesh's own node numbers, *ELEMENT of type C3D4, an *ELSET for each region but an
/// unnamed 0, an *NSET for each node group.
pub fn encode(mesh: &TetMesh) -> Result<Encoded, MeshError> {
    check(mesh, "Abaqus")?;
    let mut sets: BTreeMap<u32, String> = BTreeMap::new();
    let mut lost = Vec::new();
    let used: BTreeSet<u32> = mesh.regions.iter().copied().collect();
    for &region in &used {
        match mesh.region_names.get(&region) {
            Some(name) => {
                sets.insert(region, name.clone());
            }
            None if region > 0 => {
                sets.insert(region, format!("Region_{region}"));
            }
            None => {}
        }
    }
    let unused: Vec<&str> = mesh
        .region_names
        .iter()
        .filter(|(number, _)| !used.contains(number))
        .map(|(_, name)| name.as_str())
        .collect();
    if !unused.is_empty() {
        lost.push(format!("regions without tetrahedra are not written: {}", unused.join(", ")));
    }
    let named: Vec<u32> =
        used.iter().copied().filter(|region| mesh.region_names.contains_key(region)).collect();
    let unnamed = used.iter().filter(|&&region| !mesh.region_names.contains_key(&region)).copied();
    let taken: BTreeSet<u32> = unnamed.collect();
    let free: Vec<u32> = (1..).filter(|number| !taken.contains(number)).take(named.len()).collect();
    if named != free {
        lost.push("named regions keep their names, but are numbered anew when the file is read".to_owned());
    }
    let groups: Vec<(&String, &Vec<u32>)> = own_groups(mesh).collect();
    distinct("element sets", sets.values())?;
    distinct("node sets", groups.iter().map(|(name, _)| *name))?;

    let mut text = String::from("*HEADING\nwritten by greenstage\n*NODE\n");
    for (tag, x) in mesh.tags.iter().zip(&mesh.nodes) {
        put(&mut text, format_args!("{tag}, {:?}, {:?}, {:?}\n", x.x, x.y, x.z));
    }
    text.push_str("*ELEMENT, TYPE=C3D4\n");
    for (tet, number) in mesh.tets.iter().zip(1u64..) {
        let [a, b, c, d] = tet.map(|node| mesh.tags[node as usize]);
        put(&mut text, format_args!("{number}, {a}, {b}, {c}, {d}\n"));
    }
    for (region, name) in &sets {
        put(&mut text, format_args!("*ELSET, ELSET=\"{name}\"\n"));
        members(
            &mut text,
            (1u64..).zip(&mesh.regions).filter(|(_, of)| *of == region).map(|(number, _)| number),
        );
    }
    for (name, nodes) in groups {
        put(&mut text, format_args!("*NSET, NSET=\"{name}\"\n"));
        members(&mut text, nodes.iter().map(|&node| mesh.tags[node as usize]));
    }
    Ok(Encoded { files: vec![text.into_bytes()], lost })
}

/// Writes up to 16 numbers a line, as Abaqus wants it.
fn members(text: &mut String, numbers: impl Iterator<Item = u64>) {
    for (i, number) in numbers.enumerate() {
        let after = if i % 16 == 15 { "\n" } else { " " };
        put(text, format_args!("{number},{after}"));
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
}

/// Refuses names that Abaqus would not accept, or would take for the same.
fn distinct<'a>(what: &str, names: impl Iterator<Item = &'a String>) -> Result<(), MeshError> {
    let mut seen = BTreeSet::new();
    for name in names {
        let refuse = |reason: &str| {
            let reason = format!("the name {name:?} of its {what} {reason}");
            Err(MeshError::Unwritable { encoding: "Abaqus", reason })
        };
        if name.trim().is_empty()
            || name.trim() != name
            || name.contains(|c: char| ",\"=".contains(c) || c.is_control())
        {
            return refuse("is empty, or holds a comma, a quote, an equals sign or outer blanks");
        }
        if !seen.insert(name.to_uppercase()) {
            return refuse("differs from another only by upper and lower case");
        }
    }
    Ok(())
}
