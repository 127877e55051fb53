//! `$Entities`, `$PartitionedEntities`, `$Nodes` and `$Elements` of Gmsh 4.1.

use super::gmsh::known_kind;
use super::gmsh_scan::Scanner;
use crate::mesh::assemble::{RawElement, RawMesh, RawNode};
use crate::mesh::error::Fault;
use nalgebra::Vector3;

/// The physical groups of each geometric entity.
pub fn entities(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), Fault> {
    entity_lists(scan, raw, false)
}

/// The same for a partitioned mesh, whose elements stand on entities of their own.
pub fn partitioned_entities(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), Fault> {
    scan.size()?;
    scan.end_line()?;
    let ghosts = scan.size()?;
    scan.end_line()?;
    for _ in 0..ghosts {
        scan.int()?;
        scan.int()?;
        scan.end_line()?;
    }
    entity_lists(scan, raw, true)
}

fn entity_lists(scan: &mut Scanner, raw: &mut RawMesh, is_partitioned: bool) -> Result<(), Fault> {
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
            for _ in 0..if dimension == 0 { 3 } else { 6 } {
                scan.real()?;
            }
            let mut physicals = Vec::new();
            ints(scan, |number| physicals.push(number.unsigned_abs()))?;
            if dimension > 0 {
                ints(scan, |_| ())?;
            }
            scan.end_line()?;
            if raw.physicals.insert((dimension, tag), physicals).is_some() {
                return Err(Fault::at(at, format!("entity {tag} of dimension {dimension} is listed twice")));
            }
        }
    }
    Ok(())
}

/// A count and that many numbers.
fn ints(scan: &mut Scanner, mut each: impl FnMut(i32)) -> Result<(), Fault> {
    for _ in 0..scan.size()? {
        each(scan.int()?);
    }
    Ok(())
}

/// Blocks and nodes of a section, as its head counts them; the least and greatest tag are not needed.
fn head(scan: &mut Scanner) -> Result<(u64, u64), Fault> {
    let counts = (scan.size()?, scan.size()?);
    scan.size()?;
    scan.size()?;
    scan.end_line()?;
    Ok(counts)
}

fn dimension(scan: &mut Scanner) -> Result<u8, Fault> {
    let (at, dimension) = (scan.at(), scan.int()?);
    match u8::try_from(dimension) {
        Ok(dimension @ 0..=3) => Ok(dimension),
        _ => Err(Fault::at(at, format!("{dimension} is no dimension from 0 to 3"))),
    }
}

/// Refuses a section whose blocks do not hold what its head says.
fn compare(at: usize, what: &str, said: u64, found: usize) -> Result<(), Fault> {
    if said == found as u64 {
        return Ok(());
    }
    Err(Fault::at(at, format!("the section's head says {said} {what}, its blocks hold {found}")))
}

pub fn nodes(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), Fault> {
    let section_at = scan.at();
    let (blocks, total) = head(scan)?;
    for _ in 0..blocks {
        let dimension = dimension(scan)?;
        scan.int()?;
        let at = scan.at();
        let parameters = match scan.int()? {
            0 => 0,
            1 => dimension,
            other => {
                return Err(Fault::at(at, format!("parametric is {other}, neither 0 nor 1")));
            }
        };
        let count = scan.size()?;
        scan.end_line()?;
        let first = raw.nodes.len();
        for _ in 0..count {
            let at = scan.at();
            raw.nodes.push(RawNode { tag: scan.size()?, position: Vector3::zeros(), at });
            scan.end_line()?;
        }
        for node in raw.nodes.iter_mut().skip(first) {
            node.at = scan.at();
            node.position = Vector3::new(scan.real()?, scan.real()?, scan.real()?);
            for _ in 0..parameters {
                scan.real()?;
            }
            scan.end_line()?;
        }
    }
    compare(section_at, "nodes", total, raw.nodes.len())
}

pub fn elements(scan: &mut Scanner, raw: &mut RawMesh) -> Result<(), Fault> {
    let section_at = scan.at();
    let (blocks, total) = head(scan)?;
    for _ in 0..blocks {
        let at = scan.at();
        let (dimension, entity) = (dimension(scan)?, scan.int()?);
        let kind = known_kind(scan.int()?, at)?;
        if kind.dimension != dimension {
            let reason =
                format!("elements of dimension {} on an entity of dimension {dimension}", kind.dimension);
            return Err(Fault::at(at, reason));
        }
        let count = scan.size()?;
        scan.end_line()?;
        for _ in 0..count {
            let at = scan.at();
            let tag = scan.size()?;
            for _ in 0..kind.nodes {
                raw.corners.push(scan.size()?);
            }
            scan.end_line()?;
            raw.elements.push(RawElement { tag, kind, entity, at });
        }
    }
    compare(section_at, "elements", total, raw.elements.len())
}
