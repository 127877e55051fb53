//! Makes node groups and regions of the sets in an Abaqus file, and splits the lines of such a deck into keywords, their
//! parameters, and the data that follows them.
//!
//! Element sets may overlap, regions may not. Where the file has *SOLID SECTION, whose sets are the materials, only
//! their sets become regions. An element in several sets belongs to the smallest of them, of equals to the one that
//! the file names first; every set that loses elements by this stays a node group of all its nodes. Regions are
//! numbered from 1 as the file names them; a set `Region_7` is region 7 without a name, as our writer puts it.

use super::format::{Words, parsed};
use super::gmsh_scan::excerpt;
use crate::mesh::assemble::RawMesh;
use crate::mesh::error::{FormatFault, refuse};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// The sets of nodes, or those of elements.
pub struct Sets {
    /// Size of the file, which limits how many sets and members are read.
    bytes: usize,
    list: Vec<Set>,
    by_name: BTreeMap<String, usize>,
    /// Sets that have a section, in upper case.
    pub sections: BTreeSet<String>,
}

/// A set as the file describes it.
#[derive(Default)]
struct Set {
    /// The name as it was first written.
    name: String,
    tags: Vec<u64>,
    /// Ranges: first, last, step.
    ranges: Vec<[u64; 3]>,
    /// Members that were defined under the set's name.
    spans: Vec<Range<usize>>,
    /// Other sets that it includes; all of them stand before it.
    parts: Vec<usize>,
}

impl Sets {
    pub fn new(bytes: usize) -> Sets {
        Sets { bytes, list: Vec::new(), by_name: BTreeMap::new(), sections: BTreeSet::new() }
    }

    /// The index of the set `name`, which is created where there is none.
    fn set(&mut self, name: &str, at: usize) -> Result<usize, FormatFault> {
        if self.list.len() > 1000 + self.bytes / 100 {
            return refuse(at, format!("more than {} sets in such a file", self.list.len() - 1));
        }
        let next = self.list.len();
        let index = *self.by_name.entry(name.to_uppercase()).or_insert(next);
        if index == next {
            self.list.push(Set { name: name.to_owned(), ..Set::default() });
        }
        Ok(index)
    }

    pub fn add_span(&mut self, name: &str, span: Range<usize>, at: usize) -> Result<(), FormatFault> {
        let index = self.set(name, at)?;
        self.list[index].spans.push(span);
        Ok(())
    }

    /// Reads the lines of a set; `key` is the parameter that names it.
    pub fn read(&mut self, keyword: &Keyword, key: &str, lines: &mut Words) -> Result<(), FormatFault> {
        let name = keyword.value(key).filter(|name| !name.is_empty());
        let name =
            name.ok_or_else(|| FormatFault::at(keyword.at, format!("a set without a name: {key}=…")))?;
        let index = self.set(name, keyword.at)?;
        while let Some((at, line)) = data_line(lines) {
            if keyword.has("GENERATE") {
                let mut range = [0, 0, 1];
                let mut found = 0;
                for (place, field) in range.iter_mut().zip(fields(line)) {
                    if !field.is_empty() {
                        *place = parsed(field, at, "first, last and step")?;
                    }
                    found += 1;
                }
                if found < 2 || range[2] == 0 || fields(line).count() > 3 {
                    return refuse(at, format!("expected first, last and step, found `{}`", excerpt(line)));
                }
                self.list[index].ranges.push(range);
                continue;
            }
            for field in fields(line).filter(|field| !field.is_empty()) {
                if field[0].is_ascii_digit() {
                    self.list[index].tags.push(parsed(field, at, "a number or the name of a set")?);
                    continue;
                }
                let part = String::from_utf8_lossy(field).trim_matches('"').to_uppercase();
                let part = self.by_name.get(&part).copied().filter(|&part| part < index);
                let part = part.ok_or_else(|| {
                    FormatFault::at(at, format!("`{}` is no set that stands before this one", excerpt(field)))
                })?;
                self.list[index].parts.push(part);
            }
        }
        Ok(())
    }

    /// The members of each set as sorted, unique indices; `tags` are all numbers with their indices, sorted. `most`
    /// bounds all sets together. Also the numbers that are none, for each set.
    fn resolve(&self, tags: &[(u64, u32)], most: usize) -> Result<Vec<(Vec<u32>, usize)>, FormatFault> {
        let mut resolved: Vec<(Vec<u32>, usize)> = Vec::with_capacity(self.list.len());
        let mut total = 0;
        for set in &self.list {
            let (mut members, mut missing) = (Vec::new(), 0);
            let mut room = |added: usize| {
                total += added;
                let reason = "its sets hold far more members than the file has room for";
                if total > most { Err(FormatFault::whole(reason)) } else { Ok(()) }
            };
            for tag in &set.tags {
                match tags.binary_search_by_key(tag, |(tag, _)| *tag) {
                    Ok(found) => members.push(tags[found].1),
                    Err(_) => missing += 1,
                }
            }
            for &[first, last, step] in &set.ranges {
                let start = tags.partition_point(|(tag, _)| *tag < first);
                let end = tags.partition_point(|(tag, _)| *tag <= last);
                let inside = tags.get(start..end).unwrap_or_default();
                room(inside.len())?;
                let kept = inside.iter().filter(|(tag, _)| (tag - first) % step == 0);
                members.extend(kept.map(|(_, index)| index));
            }
            for span in &set.spans {
                room(span.len())?;
                members.extend(span.clone().map(|index| index as u32));
            }
            for &part in &set.parts {
                let part = &resolved[part].0;
                room(part.len())?;
                members.extend(part);
            }
            members.sort_unstable();
            members.dedup();
            resolved.push((members, missing));
        }
        Ok(resolved)
    }

    /// Makes node groups of the node sets.
    pub fn to_groups(&self, raw: &mut RawMesh) -> Result<(), FormatFault> {
        let tags = sorted(raw.nodes.iter().map(|node| node.tag));
        for (set, (members, missing)) in self.list.iter().zip(self.resolve(&tags, self.bytes / 2)?) {
            if missing > 0 {
                let name = excerpt(set.name.as_bytes());
                raw.notices.push(format!("{missing} numbers of the node set \"{name}\" are no nodes"));
            }
            raw.groups.insert(set.name.clone(), members);
        }
        Ok(())
    }

    /// Makes regions of the element sets.
    pub fn to_regions(&self, raw: &mut RawMesh) -> Result<(), FormatFault> {
        let tags = sorted(raw.elements.iter().map(|element| element.tag));
        if let Some(pair) = tags.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let second = raw.elements[pair[1].1 as usize];
            return refuse(second.at, format!("element {} is defined twice", second.tag));
        }
        let sets = self.resolve(&tags, self.bytes / 4)?;
        let has_section = |set: &Set| self.sections.contains(&set.name.to_uppercase());
        let any_section =
            self.list.iter().zip(&sets).any(|(set, (members, _))| has_section(set) && !members.is_empty());
        let mut candidates: Vec<usize> = (0..sets.len())
            .filter(|&i| !sets[i].0.is_empty() && (!any_section || has_section(&self.list[i])))
            .collect();
        let numbers = self.numbers(&candidates);
        candidates.sort_by_key(|&i| (sets[i].0.len(), i));

        let mut owner: Vec<usize> = vec![usize::MAX; raw.elements.len()];
        let mut contested = 0;
        for &i in &candidates {
            for &element in &sets[i].0 {
                match &mut owner[element as usize] {
                    free @ &mut usize::MAX => *free = i,
                    _ => contested += 1,
                }
            }
        }
        if contested > 0 {
            raw.notices.push(format!(
                "element sets overlap ({contested} times): an element's region is the smallest set it is in; every \
                 set stays a node group"
            ));
        }
        for (&i, &number) in &numbers {
            raw.physicals.insert((3, number), vec![number.unsigned_abs()]);
            if own_number(&self.list[i].name).is_none() {
                raw.names.insert((3, number.unsigned_abs()), self.list[i].name.clone());
            }
        }
        for (element, owner) in raw.elements.iter_mut().zip(&owner) {
            element.entity = numbers.get(owner).copied().unwrap_or(0);
        }
        self.lost_to_groups(raw, &sets, &owner)
    }

    /// The region number of each set that becomes one.
    fn numbers(&self, candidates: &[usize]) -> BTreeMap<usize, i32> {
        let own = |&i: &usize| Some((i, own_number(&self.list[i].name)?));
        let mut numbers: BTreeMap<usize, i32> = candidates.iter().filter_map(own).collect();
        let taken: BTreeSet<i32> = numbers.values().copied().collect();
        let free = (1..).filter(|number| !taken.contains(number));
        let unnumbered: Vec<usize> =
            candidates.iter().copied().filter(|i| !numbers.contains_key(i)).collect();
        numbers.extend(unnumbered.into_iter().zip(free));
        numbers
    }

    /// Each set with elements of another region becomes a node group.
    fn lost_to_groups(
        &self,
        raw: &mut RawMesh,
        sets: &[(Vec<u32>, usize)],
        owner: &[usize],
    ) -> Result<(), FormatFault> {
        let mut corners = Vec::with_capacity(raw.elements.len());
        let mut first = 0;
        for element in &raw.elements {
            corners.push(first);
            first += usize::from(element.kind.nodes);
        }
        let nodes = sorted(raw.nodes.iter().map(|node| node.tag));
        let mut total = 0;
        for (i, (set, (members, _))) in self.list.iter().zip(sets).enumerate() {
            if members.iter().all(|&element| owner[element as usize] == i) {
                continue;
            }
            if raw.groups.contains_key(&set.name) {
                let name = excerpt(set.name.as_bytes());
                raw.notices
                    .push(format!("group \"{name}\" joins the node set and the element set of that name"));
            }
            let group = raw.groups.entry(set.name.clone()).or_default();
            for &element in members {
                let first = corners[element as usize];
                for tag in &raw.corners[first..first + usize::from(raw.elements[element as usize].kind.nodes)]
                {
                    // A node that the file does not define is refused when the mesh is put together.
                    let found = nodes.binary_search_by_key(tag, |(tag, _)| *tag);
                    group.extend(found.ok().map(|found| nodes[found].1));
                }
            }
            group.sort_unstable();
            group.dedup();
            total += group.len();
            if total > self.bytes {
                return Err(FormatFault::whole(
                    "its element sets hold far more members than the file has room for",
                ));
            }
        }
        Ok(())
    }
}

/// `Region_7` is region 7.
fn own_number(name: &str) -> Option<i32> {
    let number = name.to_uppercase().strip_prefix("REGION_")?.parse().ok()?;
    (number > 0).then_some(number)
}

/// Numbers with their indices, in ascending order.
fn sorted(tags: impl Iterator<Item = u64>) -> Vec<(u64, u32)> {
    let mut tags: Vec<(u64, u32)> = tags.zip(0..).collect();
    tags.sort_unstable();
    tags
}

/// `*NAME, KEY=VALUE, KEY`, in upper case but for the values.
pub struct Keyword {
    pub at: usize,
    pub name: String,
    parameters: Vec<(String, String)>,
}

impl Keyword {
    /// The keyword line that begins with `line`; where that ends in a comma, the next one continues it.
    pub fn read(at: usize, line: &[u8], lines: &mut Words) -> Result<Keyword, FormatFault> {
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
            return refuse(at, reason);
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

/// The next line of data and its offset; comments and empty lines are skipped. `None` before a keyword.
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

/// Skips the data of a keyword that is not used.
pub fn skip_data(lines: &mut Words) {
    while data_line(lines).is_some() {}
}

/// The fields of a line of data; a comma at its end adds none.
pub fn fields(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let line = line.strip_suffix(b",").unwrap_or(line);
    line.split(|&byte| byte == b',').map(<[u8]>::trim_ascii)
}
