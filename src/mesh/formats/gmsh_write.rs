//! Writes Gmsh 2.2 and 4.1, text or binary, so that the reader gives back the same mesh.
//!
//! In: a [`TetMesh`]. Out: bytes. A region is a physical volume. A node group is a physical group of points: one
//! point element (type 15) for each of its nodes, on a point entity of the group's own, so that a node can be in
//! several groups. A group that holds just the nodes of the regions of its name is not written: the reader makes it
//! from them. Nodes and tetrahedra keep their order.

use super::write::{check_indices, own_groups};
use crate::mesh::error::MeshError;
use crate::mesh::tet_mesh::TetMesh;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::io::Write;

/// The versions and encodings of Gmsh files that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Gmsh22Text,
    Gmsh22Binary,
    Gmsh41Text,
    Gmsh41Binary,
}

impl Encoding {
    pub const ALL: [Encoding; 4] =
        [Encoding::Gmsh22Text, Encoding::Gmsh22Binary, Encoding::Gmsh41Text, Encoding::Gmsh41Binary];

    pub fn name(self) -> &'static str {
        match self {
            Encoding::Gmsh22Text => "Gmsh 2.2 text",
            Encoding::Gmsh22Binary => "Gmsh 2.2 binary",
            Encoding::Gmsh41Text => "Gmsh 4.1 text",
            Encoding::Gmsh41Binary => "Gmsh 4.1 binary",
        }
    }

    fn is_binary(self) -> bool {
        matches!(self, Encoding::Gmsh22Binary | Encoding::Gmsh41Binary)
    }

    fn is_version_2(self) -> bool {
        matches!(self, Encoding::Gmsh22Text | Encoding::Gmsh22Binary)
    }
}

const POINT: i32 = 15;
const TETRAHEDRON: i32 = 4;

/// The bytes of a Gmsh file that holds `mesh`. Refuses what the format has no room for: a number above 2³¹ - 1 of
/// a region, or in 2.2 of a node; a name with a quote or a control character.
pub fn encode(mesh: &TetMesh, encoding: Encoding) -> Result<Vec<u8>, MeshError> {
    encode_with_endianness(mesh, encoding, false)
}

pub(super) fn encode_with_endianness(
    mesh: &TetMesh,
    encoding: Encoding,
    big_endian: bool,
) -> Result<Vec<u8>, MeshError> {
    let plan = Plan::new(mesh, encoding)?;
    let binary = encoding.is_binary();
    let mut out = Sink { bytes: Vec::new(), binary, big_endian, wide: !encoding.is_version_2(), fresh: true };
    let version = if encoding.is_version_2() { "2.2" } else { "4.1" };
    out.text(format_args!("$MeshFormat\n{version} {} 8\n", u8::from(binary)));
    if binary {
        out.int(1);
        out.text("\n");
    }
    out.text("$EndMeshFormat\n");
    plan.names(&mut out);
    if encoding.is_version_2() {
        plan.sections_2(&mut out);
    } else {
        plan.sections_4(&mut out);
    }
    Ok(out.bytes)
}

/// The checked content of the file.
struct Plan<'a> {
    mesh: &'a TetMesh,
    /// Physical group of each tetrahedron: its region.
    regions: Vec<i32>,
    /// The volume entity of each region, from 1.
    volumes: BTreeMap<i32, i32>,
    /// Groups to be written, by physical group of points and point entity, which are the same.
    groups: Vec<(i32, &'a str, &'a [u32])>,
    region_names: Vec<(i32, &'a str)>,
}

impl<'a> Plan<'a> {
    fn new(mesh: &'a TetMesh, encoding: Encoding) -> Result<Plan<'a>, MeshError> {
        let refuse = |reason: String| MeshError::Unwritable { encoding: encoding.name(), reason };
        let int = |what: &str, number: u64| {
            let too_large = |_| refuse(format!("{what} {number} is above {}", i32::MAX));
            i32::try_from(number).map_err(too_large)
        };
        check_indices(mesh).map_err(refuse)?;
        for name in mesh.groups.keys().chain(mesh.region_names.values()) {
            if name.contains(|c: char| c == '"' || c.is_control()) {
                return Err(refuse(format!("the name {name:?} holds a quote or a control character")));
            }
        }
        if encoding.is_version_2() {
            mesh.tags.iter().try_for_each(|&tag| int("node tag", tag).map(|_| ()))?;
            let points: usize = mesh.groups.values().map(Vec::len).sum();
            int("element tag", (points + mesh.tets.len()) as u64)?;
        }
        let regions: Vec<i32> =
            mesh.regions.iter().map(|&region| int("region", region.into())).collect::<Result<_, _>>()?;
        let distinct: BTreeSet<i32> = regions.iter().copied().collect();
        let named = mesh.region_names.iter();
        Ok(Plan {
            mesh,
            volumes: distinct.into_iter().zip(1..).collect(),
            regions,
            groups: (1..)
                .zip(own_groups(mesh))
                .map(|(i, (name, nodes))| (i, name.as_str(), nodes.as_slice()))
                .collect(),
            region_names: named
                .map(|(&region, name)| Ok((int("region", region.into())?, name.as_str())))
                .collect::<Result<_, MeshError>>()?,
        })
    }

    fn names(&self, out: &mut Sink) {
        let count = self.groups.len() + self.region_names.len();
        if count == 0 {
            return;
        }
        out.text(format_args!("$PhysicalNames\n{count}\n"));
        for (number, name, _) in &self.groups {
            out.text(format_args!("0 {number} \"{name}\"\n"));
        }
        for (region, name) in &self.region_names {
            out.text(format_args!("3 {region} \"{name}\"\n"));
        }
        out.text("$EndPhysicalNames\n");
    }

    fn point_count(&self) -> usize {
        self.groups.iter().map(|(_, _, nodes)| nodes.len()).sum()
    }

    fn sections_2(&self, out: &mut Sink) {
        let mesh = self.mesh;
        out.text(format_args!("$Nodes\n{}\n", mesh.nodes.len()));
        for (&tag, position) in mesh.tags.iter().zip(&mesh.nodes) {
            out.size(tag);
            out.reals(position);
            out.end_line();
        }
        out.end_section("Nodes");
        out.text(format_args!("$Elements\n{}\n", self.point_count() + mesh.tets.len()));
        let mut tag = 0;
        let mut head = |out: &mut Sink, kind: i32| {
            tag += 1;
            out.size(tag);
            if !out.binary {
                out.int(kind);
                out.int(2);
            }
        };
        if out.binary && self.point_count() > 0 {
            out.int(POINT);
            out.size(self.point_count() as u64);
            out.int(2);
        }
        for (number, _, nodes) in &self.groups {
            for &node in *nodes {
                head(out, POINT);
                out.int(*number);
                out.int(*number);
                out.size(mesh.tags[node as usize]);
                out.end_line();
            }
        }
        if out.binary {
            out.int(TETRAHEDRON);
            out.size(mesh.tets.len() as u64);
            out.int(2);
        }
        for (tet, region) in mesh.tets.iter().zip(&self.regions) {
            head(out, TETRAHEDRON);
            out.int(*region);
            out.int(self.volumes[region]);
            tet.iter().for_each(|&node| out.size(mesh.tags[node as usize]));
            out.end_line();
        }
        out.end_section("Elements");
    }

    fn sections_4(&self, out: &mut Sink) {
        let mesh = self.mesh;
        self.entities(out);
        let first_tag = mesh.tags.iter().min().copied().unwrap_or(0);
        let last_tag = mesh.tags.iter().max().copied().unwrap_or(0);
        let node_count = mesh.nodes.len() as u64;
        out.text("$Nodes\n");
        [1, node_count, first_tag, last_tag].into_iter().for_each(|size| out.size(size));
        out.end_line();
        [3, 1, 0].into_iter().for_each(|int| out.int(int));
        out.size(node_count);
        out.end_line();
        for &tag in &mesh.tags {
            out.size(tag);
            out.end_line();
        }
        for position in &mesh.nodes {
            out.reals(position);
            out.end_line();
        }
        out.end_section("Nodes");

        let runs: Vec<&[i32]> = self.regions.chunk_by(|a, b| a == b).collect();
        let groups: Vec<_> = self.groups.iter().filter(|(_, _, nodes)| !nodes.is_empty()).collect();
        let count = (self.point_count() + mesh.tets.len()) as u64;
        out.text("$Elements\n");
        [(groups.len() + runs.len()) as u64, count, 1, count].into_iter().for_each(|size| out.size(size));
        out.end_line();
        let mut tag = 0;
        let mut element = |out: &mut Sink, nodes: &[u32]| {
            tag += 1;
            out.size(tag);
            nodes.iter().for_each(|&node| out.size(mesh.tags[node as usize]));
            out.end_line();
        };
        for (number, _, nodes) in groups {
            [0, *number, POINT].into_iter().for_each(|int| out.int(int));
            out.size(nodes.len() as u64);
            out.end_line();
            nodes.iter().for_each(|&node| element(out, &[node]));
        }
        let mut tets = mesh.tets.iter();
        for run in runs {
            [3, self.volumes[&run[0]], TETRAHEDRON].into_iter().for_each(|int| out.int(int));
            out.size(run.len() as u64);
            out.end_line();
            tets.by_ref().take(run.len()).for_each(|tet| element(out, tet));
        }
        out.end_section("Elements");
    }

    /// A point for each group, a volume for each region; volumes name no bounding surfaces.
    fn entities(&self, out: &mut Sink) {
        let mesh = self.mesh;
        out.text("$Entities\n");
        [self.groups.len(), 0, 0, self.volumes.len()].into_iter().for_each(|count| out.size(count as u64));
        out.end_line();
        for (number, _, nodes) in &self.groups {
            out.int(*number);
            out.reals(&nodes.first().map_or(Vector3::zeros(), |&node| mesh.nodes[node as usize]));
            out.size(1);
            out.int(*number);
            out.end_line();
        }
        let (min, max) = crate::base::extent::bounding_box(&mesh.nodes);
        let is_named = |region: &i32| self.region_names.iter().any(|(named, _)| named == region);
        for (region, volume) in &self.volumes {
            out.int(*volume);
            out.reals(&min);
            out.reals(&max);
            if *region != 0 || is_named(region) {
                out.size(1);
                out.int(*region);
            } else {
                out.size(0);
            }
            out.size(0);
            out.end_line();
        }
        out.end_section("Entities");
    }
}

/// Numbers as text, separated by blanks, or as bytes.
struct Sink {
    bytes: Vec<u8>,
    binary: bool,
    big_endian: bool,
    /// Tags and counts have 8 bytes, else 4.
    wide: bool,
    /// No number stands on this line yet.
    fresh: bool,
}

impl Sink {
    fn text(&mut self, text: impl Display) {
        let written = write!(self.bytes, "{text}");
        debug_assert!(written.is_ok(), "a vector takes all bytes");
    }

    fn word(&mut self, word: impl Display) {
        if !std::mem::take(&mut self.fresh) {
            self.text(" ");
        }
        self.text(word);
    }

    fn raw<const N: usize>(&mut self, mut little_endian: [u8; N]) {
        if self.big_endian {
            little_endian.reverse();
        }
        self.bytes.extend(little_endian);
    }

    fn int(&mut self, int: i32) {
        if self.binary { self.raw(int.to_le_bytes()) } else { self.word(int) }
    }

    fn size(&mut self, size: u64) {
        match (self.binary, self.wide) {
            (false, _) => self.word(size),
            (true, true) => self.raw(size.to_le_bytes()),
            // `Plan::new` has found it below 2³¹.
            (true, false) => self.raw((size as u32).to_le_bytes()),
        }
    }

    /// The shortest digits that give back the same bits.
    fn reals(&mut self, reals: &Vector3<f64>) {
        for real in reals.iter() {
            if self.binary { self.raw(real.to_le_bytes()) } else { self.word(format_args!("{real:?}")) }
        }
    }

    fn end_line(&mut self) {
        if !self.binary {
            self.text("\n");
            self.fresh = true;
        }
    }

    fn end_section(&mut self, name: &str) {
        self.text(format_args!("{}$End{name}\n", if self.binary { "\n" } else { "" }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block, parse};

    #[test]
    fn big_endian_files_are_read_as_well() {
        let mesh = block(&Block { size: [1.0, 2.0, 3.0], cells: [2, 3, 1] }).unwrap();
        for encoding in [Encoding::Gmsh22Binary, Encoding::Gmsh41Binary] {
            let bytes = encode_with_endianness(&mesh, encoding, true).unwrap();
            assert_ne!(bytes, encode(&mesh, encoding).unwrap());
            assert_eq!(parse("m.msh".as_ref(), &bytes).unwrap().mesh, mesh, "{encoding:?}");
        }
    }
}
