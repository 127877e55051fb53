//! Turns the cells of a VTK unstructured grid, as both VTK formats hold them, into the elements of a [`RawMesh`].
//!
//! In: connectivity, where each cell ends in it, cell types, and a number of each cell. Out: tetrahedra with their
//! regions, and the cells of lower dimension that have a number as node groups. Cell types and the order of their
//! nodes are in "The VTK User's Guide", chapter "VTK File Formats".

use crate::mesh::assemble::{ElementShape, RawMesh};
use crate::mesh::error::{FormatFault, refuse};
use std::collections::BTreeMap;

/// Names of cell arrays that are taken for region numbers, most wanted first, in lower case.
pub const REGION_ARRAYS: [&str; 11] = [
    "region",
    "regions",
    "gmsh:physical",
    "medit:ref",
    "mat_id",
    "material",
    "materialid",
    "material_id",
    "materialids",
    "cellentityids",
    "gmsh:geometrical",
];

/// The rank of an array of that name among [`REGION_ARRAYS`]; the least rank is taken.
pub fn region_rank(name: &str) -> Option<usize> {
    let name = name.to_lowercase().replace("%3a", ":");
    REGION_ARRAYS.iter().position(|known| *known == name)
}

/// One block of cells; node numbers count from the block's first node.
#[derive(Default)]
pub struct Cells {
    pub connectivity: Vec<u32>,
    /// End of each cell in `connectivity`.
    pub ends: Vec<usize>,
    pub types: Vec<u8>,
    /// A number of each cell, and the name of the array it comes from.
    pub regions: Option<(String, Vec<f64>)>,
    /// Offset of each cell in the file, or of all of them.
    pub at: Vec<usize>,
}

/// A number that stands for a node or a count.
pub fn index(value: f64, at: usize) -> Result<u32, FormatFault> {
    if value >= 0.0 && value < f64::from(u32::MAX) && value.fract() == 0.0 {
        return Ok(value as u32);
    }
    refuse(at, format!("{value} is no number of a point"))
}

/// Dimension and points of the cell types that can be used or counted.
fn shape(kind: u8) -> Option<(u8, u8)> {
    Some(match kind {
        1 => (0, 1),
        3 => (1, 2),
        21 => (1, 3),
        5 => (2, 3),
        8 | 9 => (2, 4),
        22 => (2, 6),
        23 => (2, 8),
        10 => (3, 4),
        11 | 12 => (3, 8),
        13 => (3, 6),
        14 => (3, 5),
        24 => (3, 10),
        25 => (3, 20),
        26 => (3, 15),
        27 => (3, 13),
        _ => return None,
    })
}

impl Cells {
    /// Adds the cells to `raw`, whose nodes from `first_node` on are those of this block.
    pub fn add_to(mut self, raw: &mut RawMesh, first_node: u64, first_cell: u64) -> Result<(), FormatFault> {
        let at = self.at.first().copied().unwrap_or(0);
        if self.types.len() != self.ends.len() {
            return refuse(at, format!("{} cells, but {} cell types", self.ends.len(), self.types.len()));
        }
        let numbers = self.region_numbers(raw);
        let mut left_out: BTreeMap<u8, usize> = BTreeMap::new();
        let mut start = 0;
        for (i, (&end, &kind)) in self.ends.iter().zip(&self.types).enumerate() {
            let at = self.at.get(i).copied().unwrap_or(at);
            let Some(nodes) = self.connectivity.get(start..end) else {
                let reason = format!(
                    "cell {i} ends at entry {end} of the connectivity, which has {} and has been read to {start}",
                    self.connectivity.len()
                );
                return refuse(at, reason);
            };
            start = end;
            let number = numbers.as_ref().and_then(|numbers| numbers.get(i)).copied().unwrap_or(0);
            let Some((dimension, size)) = shape(kind) else {
                *left_out.entry(kind).or_default() += 1;
                continue;
            };
            if nodes.len() != usize::from(size) {
                return refuse(at, format!("cell {i} of type {kind} has {} points, not {size}", nodes.len()));
            }
            if dimension < 3 && number <= 0 {
                *left_out.entry(kind).or_default() += 1;
                continue;
            }
            let mut tags: Vec<u64> = nodes.iter().map(|&node| first_node + u64::from(node)).collect();
            let is_tetrahedron = matches!(kind, 10 | 24);
            if kind == 24 {
                tags.swap(8, 9);
            }
            let kind = ElementShape { dimension, nodes: size, is_tetrahedron };
            raw.add(kind, first_cell + i as u64, number, at, &tags);
        }
        for (kind, count) in left_out {
            raw.notices.push(format!("{count} cells of VTK type {kind} have been left out"));
        }
        Ok(())
    }

    /// The cells' numbers, where all of them can be region numbers.
    fn region_numbers(&mut self, raw: &mut RawMesh) -> Option<Vec<i32>> {
        let (name, values) = self.regions.take()?;
        if values.len() != self.ends.len() {
            let reason = format!("{} values for {} cells", values.len(), self.ends.len());
            raw.notices.push(format!("cell array \"{name}\" is not taken for regions: {reason}"));
            return None;
        }
        let is_number =
            |value: &&f64| **value >= 0.0 && **value <= f64::from(i32::MAX) && value.fract() == 0.0;
        if let Some(other) = values.iter().find(|value| !is_number(value)) {
            let reason = format!("{other} is no whole number from 0 to {}", i32::MAX);
            raw.notices.push(format!("cell array \"{name}\" is not taken for regions: {reason}"));
            return None;
        }
        Some(values.iter().map(|&value| value as i32).collect())
    }
}
