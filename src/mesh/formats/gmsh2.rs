//! `$Nodes` and `$Elements` of Gmsh 2.2.
//!
//! An element's first tag is its physical group, which stands in for the geometric entity of version 4.

use super::gmsh_scan::{Mode, Scanner};
use super::gmsh_types::known_kind;
use crate::mesh::assemble::{ElementShape, RawElement, RawMesh, RawNode};
use crate::mesh::error::FormatFault;
use nalgebra::Vector3;

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
