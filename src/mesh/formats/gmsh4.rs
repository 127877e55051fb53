//! `$Entities`, `$PartitionedEntities`, `$Nodes` and `$Elements` of Gmsh 4.0 and 4.1.
//!
//! Both versions hold the same data in different orders: see [`Layout`].

use super::gmsh_scan::{Scanner, known_kind};
use crate::mesh::assemble::{RawElement, RawMesh, RawNode};
use crate::mesh::error::{FormatFault, refuse};
use nalgebra::Vector3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// 4.0: tags of nodes and elements have 32 bits, a block's head names the entity before its dimension, each
    /// node's tag stands before its coordinates, a point has a box.
    Old,
    /// 4.1: tags have the file's size of counts, the dimension comes first, a block's tags before all coordinates.
    New,
}

impl Layout {
    fn tag(self, scan: &mut Scanner) -> Result<u64, FormatFault> {
        match self {
            Layout::New => scan.size(),
            Layout::Old => {
                let (at, tag) = (scan.at(), scan.int()?);
                u64::try_from(tag).map_err(|_negative| FormatFault::at(at, format!("{tag} is no tag")))
            }
        }
    }

    /// Dimension and tag of the entity of a block.
    fn entity(self, scan: &mut Scanner) -> Result<(u8, i32), FormatFault> {
        match self {
            Layout::New => Ok((dimension(scan)?, scan.int()?)),
            Layout::Old => {
                let entity = scan.int()?;
                Ok((dimension(scan)?, entity))
            }
        }
    }
}

/// The physical groups of each geometric entity.
pub fn entities(scan: &mut Scanner, raw: &mut RawMesh, layout: Layout) -> Result<(), FormatFault> {
    entity_lists(scan, raw, false, if layout == Layout::Old { 6 } else { 3 })
}

/// The physical groups of each entity of a partitioned mesh, whose elements stand on separate entities.
pub fn partitioned_entities(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), FormatFault> {
    scan.size()?;
    scan.end_line()?;
    let ghosts = scan.size()?;
    scan.end_line()?;
    for _ in 0..ghosts {
        scan.int()?;
        scan.int()?;
        scan.end_line()?;
    }
    entity_lists(scan, raw, true, 3)
}

fn entity_lists(
    scan: &mut Scanner,
    raw: &mut RawMesh,
    is_partitioned: bool,
    point_reals: usize,
) -> Result<(), FormatFault> {
    let counts = [scan.size()?, scan.size()?, scan.size()?, scan.size()?];
    scan.end_line()?;
    for (dimension, count) in (0u8..).zip(counts) {
        for _ in 0..count {
            let at = scan.at();
            let tag = scan.int()?;
            if is_partitioned {
                scan.int()?;
                scan.int()?;
                ints(scan, |_| ())?;
            }
            for _ in 0..if dimension == 0 { point_reals } else { 6 } {
                scan.real()?;
            }
            let mut physicals = Vec::new();
            ints(scan, |number| physicals.push(number.unsigned_abs()))?;
            if dimension > 0 {
                ints(scan, |_| ())?;
            }
            scan.end_line()?;
            if raw.physicals.insert((dimension, tag), physicals).is_some() {
                return refuse(at, format!("entity {tag} of dimension {dimension} is listed twice"));
            }
        }
    }
    Ok(())
}

/// A count and that many numbers.
fn ints(scan: &mut Scanner, mut each: impl FnMut(i32)) -> Result<(), FormatFault> {
    for _ in 0..scan.size()? {
        each(scan.int()?);
    }
    Ok(())
}

/// Blocks and nodes of a section, as its head counts them; the least and greatest tag are not needed.
fn head(scan: &mut Scanner, layout: Layout) -> Result<(u64, u64), FormatFault> {
    let counts = (scan.size()?, scan.size()?);
    if layout == Layout::New {
        scan.size()?;
        scan.size()?;
    }
    scan.end_line()?;
    Ok(counts)
}

fn dimension(scan: &mut Scanner) -> Result<u8, FormatFault> {
    let (at, dimension) = (scan.at(), scan.int()?);
    match u8::try_from(dimension) {
        Ok(dimension @ 0..=3) => Ok(dimension),
        _ => refuse(at, format!("{dimension} is no dimension from 0 to 3")),
    }
}

/// Refuses a section whose blocks do not hold what its head says.
fn compare(at: usize, what: &str, said: u64, found: usize) -> Result<(), FormatFault> {
    if said == found as u64 {
        return Ok(());
    }
    refuse(at, format!("the section's head says {said} {what}, its blocks hold {found}"))
}

pub fn nodes(scan: &mut Scanner, raw: &mut RawMesh, layout: Layout) -> Result<(), FormatFault> {
    let section_at = scan.at();
    let (blocks, total) = head(scan, layout)?;
    for _ in 0..blocks {
        let (dimension, _) = layout.entity(scan)?;
        let at = scan.at();
        let parameters = match scan.int()? {
            0 => 0,
            1 => dimension,
            other => return refuse(at, format!("parametric is {other}, neither 0 nor 1")),
        };
        let count = scan.size()?;
        scan.end_line()?;
        let first = raw.nodes.len();
        for _ in 0..count {
            let at = scan.at();
            raw.nodes.push(RawNode { tag: layout.tag(scan)?, position: Vector3::zeros(), at });
            if layout == Layout::Old {
                coordinates(scan, raw.nodes.last_mut(), parameters)?;
            } else {
                scan.end_line()?;
            }
        }
        if layout == Layout::New {
            for node in raw.nodes.iter_mut().skip(first) {
                node.at = scan.at();
                coordinates(scan, Some(node), parameters)?;
            }
        }
    }
    compare(section_at, "nodes", total, raw.nodes.len())
}

/// Three coordinates, and the parameters behind them.
fn coordinates(scan: &mut Scanner, node: Option<&mut RawNode>, parameters: u8) -> Result<(), FormatFault> {
    let position = Vector3::new(scan.real()?, scan.real()?, scan.real()?);
    if let Some(node) = node {
        node.position = position;
    }
    for _ in 0..parameters {
        scan.real()?;
    }
    scan.end_line()
}

pub fn elements(scan: &mut Scanner, raw: &mut RawMesh, layout: Layout) -> Result<(), FormatFault> {
    let section_at = scan.at();
    let (blocks, total) = head(scan, layout)?;
    for _ in 0..blocks {
        let at = scan.at();
        let (dimension, entity) = layout.entity(scan)?;
        let kind = known_kind(scan.int()?, at)?;
        if kind.dimension != dimension {
            let reason =
                format!("elements of dimension {} on an entity of dimension {dimension}", kind.dimension);
            return refuse(at, reason);
        }
        let count = scan.size()?;
        scan.end_line()?;
        for _ in 0..count {
            let at = scan.at();
            let tag = layout.tag(scan)?;
            for _ in 0..kind.nodes {
                raw.corners.push(layout.tag(scan)?);
            }
            scan.end_line()?;
            raw.elements.push(RawElement { tag, kind, entity, at });
        }
    }
    compare(section_at, "elements", total, raw.elements.len())
}
