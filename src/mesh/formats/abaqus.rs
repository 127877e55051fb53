//! Abaqus and CalculiX `.inp`: nodes, elements C3D4 and C3D10, and their sets.
//!
//! In: bytes. Out: a [`RawMesh`] with the file's numbers; node sets become node groups, element sets regions (see
//! [`super::abaqus_sets`]). After "Abaqus Keywords Reference Guide" and G. Dhondt, "CalculiX CrunchiX User's Manual",
//! chapter "Input deck format". Keywords of the analysis are passed over; what would move or make nodes is refused.

use super::abaqus_sets::Sets;
use super::gmsh_scan::excerpt;
use super::words::{Words, parsed};
use super::{Format, Part};
use crate::mesh::assemble::{Kind, RawMesh, RawNode};
use crate::mesh::error::Fault;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

pub const FORMAT: Format = Format {
    name: "Abaqus and CalculiX",
    extensions: &["inp"],
    recognizes: |bytes| {
        let head = bytes.get(..bytes.len().min(2000)).unwrap_or_default().to_ascii_uppercase();
        [&b"*HEADING"[..], b"*NODE"].iter().any(|word| head.windows(word.len()).any(|window| window == *word))
    },
    others: |_| Vec::new(),
    read,
};

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, Fault> {
    let mut deck = Deck { lines: Words::new(bytes, None), raw: RawMesh::default(), others: BTreeMap::new() };
    let mut node_sets = Sets::new(bytes.len());
    let mut element_sets = Sets::new(bytes.len());
    let mut once = BTreeSet::new();
    while let Some((at, line)) = deck.lines.full_line() {
        if line.starts_with(b"**") {
            continue;
        }
        if !line.starts_with(b"*") {
            let reason = format!("expected a keyword (*NAME), found `{}`", excerpt(line));
            return Err(Fault::at(at, reason));
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
                let reason = "*INCLUDE is not followed: put the lines of that file in its place";
                return Err(Fault::at(at, reason));
            }
            "PART" | "INSTANCE" => {
                if !once.insert(keyword.name.clone()) {
                    let reason = "a second part or instance: save the model without parts and assemblies";
                    return Err(Fault::at(at, reason));
                }
                if data_line(&mut deck.lines).is_some() {
                    let reason = "an instance that is moved: save the model without parts and assemblies";
                    return Err(Fault::at(at, reason));
                }
            }
            "NGEN" | "NFILL" | "NCOPY" | "NMAP" | "ELGEN" | "ELCOPY" | "SYSTEM" => {
                let reason =
                    format!("*{} makes or moves nodes and is not read: save a flat file", keyword.name);
                return Err(Fault::at(at, reason));
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
        return Err(Fault::whole(reason));
    }
    node_sets.to_groups(&mut raw)?;
    element_sets.to_regions(&mut raw)?;
    Ok(raw)
}

/// `*NAME, KEY=VALUE, KEY`, in upper case but for the values.
pub struct Keyword {
    pub at: usize,
    pub name: String,
    parameters: Vec<(String, String)>,
}

impl Keyword {
    /// The keyword line that begins with `line`; where that ends in a comma, the next one continues it.
    fn read(at: usize, line: &[u8], lines: &mut Words) -> Result<Keyword, Fault> {
        let mut text = String::from_utf8_lossy(line).into_owned();
        while text.ends_with(',') {
            let Some(line) = data_line(lines) else { break };
            text.push_str(&String::from_utf8_lossy(line.1));
        }
        let mut fields = text.trim_start_matches('*').split(',').map(str::trim);
        let name = fields.next().unwrap_or_default().to_uppercase();
        let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
        const MOST_PARAMETERS: usize = 100;
        let parameters = fields.filter(|field| !field.is_empty()).take(MOST_PARAMETERS).map(|field| {
            let (key, value) = field.split_once('=').unwrap_or((field, ""));
            (key.trim().to_uppercase(), value.trim().trim_matches('"').to_owned())
        });
        let parameters = parameters.collect();
        let keyword = Keyword { at, name, parameters };
        if matches!(keyword.name.as_str(), "NODE" | "ELEMENT" | "NSET" | "ELSET") && keyword.has("INPUT") {
            let reason = "INPUT= names another file, which is not followed: put its lines in its place";
            return Err(Fault::at(at, reason));
        }
        Ok(keyword)
    }

    pub fn value(&self, key: &str) -> Option<&str> {
        self.parameters.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str())
    }

    pub fn has(&self, key: &str) -> bool {
        self.value(key).is_some()
    }
}

/// The next line of data and its offset, comments and empty lines passed over; `None` before a keyword.
pub fn data_line<'a>(lines: &mut Words<'a>) -> Option<(usize, &'a [u8])> {
    loop {
        let mut ahead = *lines;
        let (at, line) = ahead.full_line()?;
        match line {
            [b'*', b'*', ..] => *lines = ahead,
            [b'*', ..] => return None,
            _ => {
                *lines = ahead;
                return Some((at, line));
            }
        }
    }
}

fn skip_data(lines: &mut Words) {
    while data_line(lines).is_some() {}
}

/// The fields of a line of data, those behind a last comma left away.
pub fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let line = line.strip_suffix(b",").unwrap_or(line);
    line.split(|&byte| byte == b',').map(<[u8]>::trim_ascii)
}

struct Deck<'a> {
    lines: Words<'a>,
    raw: RawMesh,
    /// Elements left out, by type.
    others: BTreeMap<String, usize>,
}

impl Deck<'_> {
    /// Lines of number, x, y, z; coordinates that are left away are 0.
    fn nodes(&mut self, keyword: &Keyword) -> Result<(), Fault> {
        if keyword.value("SYSTEM").is_some_and(|system| !system.eq_ignore_ascii_case("R")) {
            return Err(Fault::at(
                keyword.at,
                "nodes in cylinder or sphere coordinates: save them as x, y, z",
            ));
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

    /// Number and nodes of each element, over as many lines as they take.
    fn elements(&mut self, keyword: &Keyword) -> Result<(), Fault> {
        let name = keyword.value("TYPE").unwrap_or_default().to_uppercase();
        let kind = match name.as_str() {
            "C3D4" | "C3D4H" => Kind::TETRAHEDRON,
            "C3D10" | "C3D10M" | "C3D10H" | "C3D10MH" | "C3D10I" | "C3D10HS" | "C3D10T" => {
                Kind::TETRAHEDRON_10
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
                        Fault::at(line_at, format!("more than the {} nodes of a {name}", kind.nodes))
                    })?;
                    *place = number;
                    found += 1;
                }
                if found == wanted {
                    break;
                }
                (line_at, line) = data_line(&mut self.lines).ok_or_else(|| {
                    Fault::at(at, format!("{} of the {} nodes of a {name}", found.max(1) - 1, kind.nodes))
                })?;
            }
            if kind == Kind::TETRAHEDRON_10 {
                numbers.swap(9, 10);
            }
            self.raw.add(kind, numbers[0], 0, at, &numbers[1..wanted]);
        }
        Ok(())
    }
}

/// A number that may be written as in Fortran, 1.5D-3.
fn real(field: &[u8], at: usize) -> Result<f64, Fault> {
    match parsed(field, at, "a number") {
        Err(_) if field.iter().any(|byte| matches!(byte, b'd' | b'D')) => {
            let e = |byte: &u8| if matches!(byte, b'd' | b'D') { b'e' } else { *byte };
            parsed(&field.iter().map(e).collect::<Vec<u8>>(), at, "a number")
        }
        other => other,
    }
}
