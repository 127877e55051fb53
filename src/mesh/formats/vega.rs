//! Vega `.veg`, text: tetrahedra with their sets, regions and materials.
//!
//! In: bytes. Out: a [`RawMesh`] with the file's numbers; sets become node groups, regions stay regions. After the
//! reader of the Vega FEM library (J. Barbič et al., `volumetricMesh.cpp` of version 2.0): numbers are separated by
//! blanks or commas, `#` begins a comment, of several regions that hold an element the last counts. A set `Region_7` is
//! region 7 without a name, as in Abaqus files.

use super::format::{Format, Part, Words, parsed};
use super::gmsh_scan::excerpt;
use crate::mesh::assemble::{ElementShape, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, refuse};
use nalgebra::Vector3;
use std::collections::BTreeSet;

pub const FORMAT: Format =
    Format { name: "Vega", extensions: &["veg"], recognizes, others: |_| Vec::new(), read, writers: &[] };

/// The set of all elements, which no file defines.
const ALL: &[u8] = b"allElements";

fn recognizes(bytes: &[u8]) -> bool {
    Words::new(bytes, Some(b'#')).word() == Some(b"*VERTICES")
}

/// Elements by their place in the file, as a region or a group uses them.
struct Set<'a> {
    name: &'a [u8],
    elements: Vec<u32>,
}

/// A set with the material that it is of; the offset of the line.
type Region<'a> = (&'a [u8], usize);

fn read(bytes: &[u8], _: &[Part]) -> Result<RawMesh, FormatFault> {
    let mut lines = Words::new(bytes, Some(b'#'));
    let mut raw = RawMesh::default();
    let (mut sets, mut regions, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    let mut skipped = BTreeSet::new();
    while let Some((at, line)) = lines.full_line() {
        let Some(keyword) = line.strip_prefix(b"*") else {
            let reason =
                format!("expected a keyword (*NAME), found `{}`: more entries than said?", excerpt(line));
            return refuse(at, reason);
        };
        let length = keyword.iter().take_while(|byte| byte.is_ascii_alphabetic()).count();
        let (keyword, rest) = keyword.split_at(length);
        let rest = rest.trim_ascii();
        match keyword {
            b"VERTICES" if raw.nodes.is_empty() => vertices(&mut lines, &mut raw)?,
            b"ELEMENTS" if raw.elements.is_empty() => elements(&mut lines, &mut raw)?,
            b"VERTICES" | b"ELEMENTS" => {
                return refuse(at, format!("a second section *{}", excerpt(keyword)));
            }
            b"SET" => sets.push(set(&mut lines, &raw, rest, at)?),
            b"REGION" => regions.push(region(&mut lines, at)?),
            b"MATERIAL" => materials.push(material(&mut lines, rest, at)?),
            b"INCLUDE" => {
                return refuse(at, "*INCLUDE is not followed: put the lines of that file in its place");
            }
            _ => {
                skip_data(&mut lines);
                skipped.insert(excerpt(keyword));
            }
        }
    }
    if raw.elements.is_empty() {
        return Err(FormatFault::whole("no section *ELEMENTS: is this a whole Vega file?"));
    }
    assign(&mut raw, &sets, &regions)?;
    groups(&mut raw, &sets)?;
    if !materials.is_empty() {
        raw.notices.push(format!(
            "materials of a scene are written there, those of the file are not used: {}",
            materials.join("; ")
        ));
    }
    if !skipped.is_empty() {
        let names: Vec<String> = skipped.into_iter().map(|name| format!("*{name}")).collect();
        raw.notices.push(format!("sections not used: {}", names.join(", ")));
    }
    Ok(raw)
}

/// The words of a line, between blanks and commas.
fn words(at: usize, line: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let is_between = |byte: &u8| byte.is_ascii_whitespace() || *byte == b',';
    line.split(is_between)
        .scan(at, |next, word| {
            let here = *next;
            *next += word.len() + 1;
            Some((here, word))
        })
        .filter(|(_, word)| !word.is_empty())
}

/// The next line, which holds data.
fn data_line<'a>(lines: &mut Words<'a>, what: &str) -> Result<(usize, &'a [u8]), FormatFault> {
    let at = lines.at;
    let missing = || FormatFault::at(at, format!("the file ends where {what} is expected"));
    let (at, line) = lines.full_line().ok_or_else(missing)?;
    if line.starts_with(b"*") {
        return refuse(at, format!("expected {what}, found `{}`: fewer entries than said?", excerpt(line)));
    }
    Ok((at, line))
}

fn number<'a, T: std::str::FromStr>(
    words: &mut impl Iterator<Item = (usize, &'a [u8])>,
    line: usize,
    what: &str,
) -> Result<T, FormatFault> {
    let missing = || FormatFault::at(line, format!("the line ends where {what} is expected"));
    let (at, word) = words.next().ok_or_else(missing)?;
    parsed(word, at, what)
}

fn skip_data(lines: &mut Words) {
    loop {
        let mut ahead = *lines;
        match ahead.full_line() {
            Some((_, line)) if !line.starts_with(b"*") => *lines = ahead,
            _ => return,
        }
    }
}

/// `count 3 0 0`, and a line `number x y z` for each.
fn vertices(lines: &mut Words, raw: &mut RawMesh) -> Result<(), FormatFault> {
    let (at, line) = data_line(lines, "the number of vertices")?;
    let count: u64 = number(&mut words(at, line), at, "the number of vertices")?;
    for _ in 0..count {
        let (at, line) = data_line(lines, "a vertex")?;
        let mut words = words(at, line);
        let tag = number(&mut words, at, "the number of a vertex")?;
        let mut real = || number(&mut words, at, "a number");
        let position = Vector3::new(real()?, real()?, real()?);
        raw.nodes.push(RawNode { tag, position, at });
    }
    Ok(())
}

/// `TET`, `count 4 0`, and a line `number a b c d` for each.
fn elements(lines: &mut Words, raw: &mut RawMesh) -> Result<(), FormatFault> {
    let (at, kind) = data_line(lines, "the kind of elements, TET")?;
    if !kind.starts_with(b"TET") {
        let reason = format!(
            "elements of the kind {} are not read, only TET: mesh the body by tetrahedra",
            excerpt(kind)
        );
        return refuse(at, reason);
    }
    let (at, line) = data_line(lines, "the number of elements")?;
    let count: u64 = number(&mut words(at, line), at, "the number of elements")?;
    for _ in 0..count {
        let (at, line) = data_line(lines, "an element")?;
        let mut words = words(at, line);
        let tag = number(&mut words, at, "the number of an element")?;
        let mut corner = || number(&mut words, at, "the number of a vertex");
        let corners: [u64; 4] = [corner()?, corner()?, corner()?, corner()?];
        raw.add(ElementShape::TETRAHEDRON, tag, 0, at, &corners);
    }
    Ok(())
}

/// Numbers of elements, on lines up to the next keyword.
fn set<'a>(lines: &mut Words<'a>, raw: &RawMesh, name: &'a [u8], at: usize) -> Result<Set<'a>, FormatFault> {
    if name.is_empty() {
        return refuse(at, "a set without a name: write *SET name");
    }
    let mut by_tag: Vec<(u64, u32)> = raw.elements.iter().map(|element| element.tag).zip(0..).collect();
    by_tag.sort_unstable();
    let mut elements = Vec::new();
    loop {
        let mut ahead = *lines;
        let Some((at, line)) = ahead.full_line().filter(|(_, line)| !line.starts_with(b"*")) else { break };
        *lines = ahead;
        for (at, word) in words(at, line) {
            let tag: u64 = parsed(word, at, "the number of an element")?;
            let place = by_tag.binary_search_by_key(&tag, |(tag, _)| *tag);
            let Ok(place) = place else {
                return refuse(at, format!("set {}: there is no element {tag} before it", excerpt(name)));
            };
            elements.push(by_tag[place].1);
        }
    }
    elements.sort_unstable();
    elements.dedup();
    Ok(Set { name, elements })
}

/// Reads `set, material` on a separate line.
fn region<'a>(lines: &mut Words<'a>, at: usize) -> Result<Region<'a>, FormatFault> {
    let (line_at, line) = data_line(lines, "a set and its material")?;
    let set = line.split(|&byte| byte == b',').next().unwrap_or_default().trim_ascii();
    if set.is_empty() {
        return refuse(at, "a region without a set: write `set, material` under *REGION");
    }
    Ok((set, line_at))
}

/// Reads the numbers of a material and returns them in words; `ENU, density, E, nu` is the usual kind.
fn material(lines: &mut Words, name: &[u8], at: usize) -> Result<String, FormatFault> {
    let (line_at, line) = data_line(lines, "a material's numbers")?;
    if name.is_empty() {
        return refuse(at, "a material without a name: write *MATERIAL name");
    }
    let mut all = words(line_at, line);
    let is_elastic = all.next().is_some_and(|(_, kind)| kind == b"ENU");
    let mut real = || number::<f64>(&mut all, line_at, "a number");
    Ok(match is_elastic {
        true => {
            let (density, young, poisson) = (real()?, real()?, real()?);
            format!(
                "{} = {{ young = {young:?}, poisson = {poisson:?}, density = {density:?} }}",
                excerpt(name)
            )
        }
        false => format!("{} ({})", excerpt(name), excerpt(line)),
    })
}

/// Each element gets the number of the last region that holds it.
fn assign(raw: &mut RawMesh, sets: &[Set], regions: &[Region]) -> Result<(), FormatFault> {
    if regions.len() > i32::MAX as usize {
        return Err(FormatFault::whole("too many regions"));
    }
    for (&(name, at), next) in regions.iter().zip(1..) {
        let text = String::from_utf8_lossy(name);
        let plain = text.strip_prefix("Region_").and_then(|number| number.parse().ok()).filter(|n| *n > 0);
        let number: i32 = plain.unwrap_or(next);
        if name == ALL {
            raw.elements.iter_mut().for_each(|element| element.entity = number);
        } else {
            let Some(set) = sets.iter().find(|set| set.name == name) else {
                return refuse(at, format!("there is no set {} (*SET)", excerpt(name)));
            };
            set.elements.iter().for_each(|&element| raw.elements[element as usize].entity = number);
            if plain.is_none() {
                raw.names.entry((3, number.unsigned_abs())).or_insert_with(|| text.clone().into_owned());
            }
        }
        raw.physicals.insert((3, number), vec![number.unsigned_abs()]);
    }
    Ok(())
}

/// Every set is the group of its elements' nodes.
fn groups(raw: &mut RawMesh, sets: &[Set]) -> Result<(), FormatFault> {
    let mut index: Vec<(u64, u32)> = raw.nodes.iter().map(|node| node.tag).zip(0..).collect();
    index.sort_unstable();
    // The last set that a node was counted for.
    let mut counted = vec![0u32; raw.nodes.len()];
    for (set, stamp) in sets.iter().zip(1u32..) {
        let mut nodes = Vec::new();
        for &element in &set.elements {
            for tag in raw.corners.iter().skip(4 * element as usize).take(4) {
                // An unknown vertex is told when the mesh is put together.
                let Ok(place) = index.binary_search_by_key(tag, |(tag, _)| *tag) else { continue };
                let node = index[place].1;
                if std::mem::replace(&mut counted[node as usize], stamp) != stamp {
                    nodes.push(node);
                }
            }
        }
        let name = String::from_utf8_lossy(set.name);
        if !name.starts_with("Region_") {
            raw.groups.entry(name.into_owned()).or_default().extend(nodes);
        }
    }
    Ok(())
}
