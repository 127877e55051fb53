//! What can be written: one line in [`WRITERS`] for each format and encoding.
//!
//! In: a [`TetMesh`]. Out: the bytes of one or two files that the reader of the format gives back as the same nodes,
//! tetrahedra and regions, bit by bit, and a sentence for everything that the format cannot hold.

use super::super::error::MeshError;
use super::gmsh_write::{Encoding, encode, nodes_of_named_regions};
use super::{abaqus, abaqus_write, gmsh, medit, tetgen, vtu, vtu_write};
use crate::base::output::Kind;
use crate::mesh::TetMesh;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// How one file format, in one encoding, is written.
pub struct Writer {
    pub name: &'static str,
    /// In lower case, without the dot.
    pub extensions: &'static [&'static str],
    pub about: &'static str,
    pub encode: fn(&TetMesh) -> Result<Encoded, MeshError>,
}

/// Files by their extension; where there is one only, its name is the user's.
pub struct Encoded {
    pub files: Vec<(&'static str, Vec<u8>)>,
    /// What the format cannot hold, one sentence each.
    pub lost: Vec<String>,
}

/// Every writer; the first for an extension is the one that is taken when none is named.
pub const WRITERS: &[Writer] = &[
    Writer {
        name: "msh41",
        extensions: &["msh"],
        about: "Gmsh 4.1, text",
        encode: |mesh| gmsh(mesh, Encoding::Gmsh41Text),
    },
    Writer {
        name: "msh41-binary",
        extensions: &["msh"],
        about: "Gmsh 4.1, binary",
        encode: |mesh| gmsh(mesh, Encoding::Gmsh41Binary),
    },
    Writer {
        name: "msh22",
        extensions: &["msh"],
        about: "Gmsh 2.2, text",
        encode: |mesh| gmsh(mesh, Encoding::Gmsh22Text),
    },
    Writer {
        name: "msh22-binary",
        extensions: &["msh"],
        about: "Gmsh 2.2, binary",
        encode: |mesh| gmsh(mesh, Encoding::Gmsh22Binary),
    },
    Writer { name: "vtu", extensions: &["vtu"], about: "VTK XML, regions as a cell array", encode: vtu },
    Writer { name: "medit", extensions: &["mesh"], about: "Medit, regions as references", encode: medit },
    Writer {
        name: "tetgen",
        extensions: &["node", "ele"],
        about: "TetGen, a pair of files, regions as attribute",
        encode: tetgen::encode,
    },
    Writer {
        name: "abaqus",
        extensions: &["inp"],
        about: "Abaqus and CalculiX, regions and node groups as sets",
        encode: abaqus_write::encode,
    },
];

/// The writer for the extension of `path`, or the one called `name` if it has that extension.
pub fn writer_of(path: &Path, name: Option<&str>) -> Result<&'static Writer, MeshError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let fits = |writer: &&Writer| writer.extensions.contains(&extension.as_str());
    let found = WRITERS.iter().filter(fits).find(|writer| name.is_none_or(|name| writer.name == name));
    found.ok_or_else(|| {
        let known: Vec<String> =
            WRITERS.iter().map(|w| format!("{} (.{})", w.name, w.extensions.join(", ."))).collect();
        let asked = name.map_or(String::new(), |name| format!(" as {name}"));
        let reason = format!("cannot be written{asked}; known are {}", known.join(", "));
        MeshError::Refused { path: path.to_owned(), reason }
    })
}

/// What may stand at the place of a file with that extension and be overwritten.
const KINDS: &[(&str, Kind)] = &[
    ("msh", Kind { name: "a Gmsh mesh", recognizes: gmsh::FORMAT.recognizes }),
    ("vtu", Kind { name: "a VTU file", recognizes: vtu::FORMAT.recognizes }),
    ("mesh", Kind { name: "a Medit mesh", recognizes: medit::FORMAT.recognizes }),
    ("node", Kind { name: "a TetGen .node file", recognizes: tetgen::opens_nodes }),
    ("ele", Kind { name: "a TetGen .ele file", recognizes: tetgen::opens_elements }),
    ("inp", Kind { name: "an Abaqus mesh", recognizes: abaqus::FORMAT.recognizes }),
];

/// The files that `writer` makes for `path`, in the order of [`Encoded::files`].
pub fn targets(writer: &Writer, path: &Path) -> Vec<(PathBuf, &'static Kind)> {
    let is_alone = writer.extensions.len() == 1;
    let name = |extension| if is_alone { path.to_owned() } else { path.with_extension(extension) };
    let kind = |&extension: &&str| {
        let (extension, kind) = KINDS.iter().find(|(known, _)| *known == extension)?;
        Some((name(extension), kind))
    };
    writer.extensions.iter().filter_map(kind).collect()
}

fn gmsh(mesh: &TetMesh, encoding: Encoding) -> Result<Encoded, MeshError> {
    Ok(Encoded { files: vec![("msh", encode(mesh, encoding)?)], lost: Vec::new() })
}

/// Refuses a mesh whose parts do not fit together, and a region above 2³¹ - 1.
pub fn check(mesh: &TetMesh, encoding: &'static str) -> Result<(), MeshError> {
    let refuse = |reason: String| Err(MeshError::Unwritable { encoding, reason });
    if mesh.tags.len() != mesh.nodes.len() || mesh.regions.len() != mesh.tets.len() {
        return refuse("its nodes and tags, or tetrahedra and regions, differ in number".to_owned());
    }
    let corners = mesh.tets.iter().flatten().chain(mesh.groups.values().flatten());
    if let Some(node) = corners.copied().find(|&node| node as usize >= mesh.nodes.len()) {
        return refuse(format!("node index {node} is not below {}", mesh.nodes.len()));
    }
    match mesh.regions.iter().find(|&&region| i32::try_from(region).is_err()) {
        Some(region) => refuse(format!("region {region} is above {}", i32::MAX)),
        None => Ok(()),
    }
}

/// Node groups that do not follow from the names of regions.
pub fn own_groups(mesh: &TetMesh) -> impl Iterator<Item = (&String, &Vec<u32>)> {
    let implied = nodes_of_named_regions(mesh);
    mesh.groups.iter().filter(move |&(name, nodes)| implied.get(name.as_str()) != Some(nodes))
}

/// Sentences on names, groups and node numbers that a format does not hold; its own numbers begin at `first`.
pub fn lost(mesh: &TetMesh, first: u64) -> Vec<String> {
    let mut lost = Vec::new();
    let groups: Vec<&str> = own_groups(mesh).map(|(name, _)| name.as_str()).collect();
    if !groups.is_empty() {
        lost.push(format!("the format holds no node groups; lost: {}", listed(&groups)));
    }
    let names: Vec<&str> = mesh.region_names.values().map(String::as_str).collect();
    if !names.is_empty() {
        lost.push(format!("the format holds no names of regions, only numbers; lost: {}", listed(&names)));
    }
    if mesh.tags.iter().zip(first..).any(|(&tag, expected)| tag != expected) {
        lost.push(format!("nodes are numbered anew from {first}: files of node tags no longer fit"));
    }
    lost
}

fn listed(names: &[&str]) -> String {
    const MOST: usize = 12;
    let more = if names.len() > MOST { ", …" } else { "" };
    names[..names.len().min(MOST)].join(", ") + more
}

/// Appended text to a string, which takes all of it.
pub fn put(text: &mut String, line: std::fmt::Arguments) {
    let written = text.write_fmt(line);
    debug_assert!(written.is_ok(), "a string takes all text");
}

fn medit(mesh: &TetMesh) -> Result<Encoded, MeshError> {
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
    Ok(Encoded { files: vec![("mesh", text.into_bytes())], lost: lost(mesh, 1) })
}

fn vtu(mesh: &TetMesh) -> Result<Encoded, MeshError> {
    check(mesh, "VTU")?;
    // The check above has found all of them in range.
    let regions = || mesh.regions.iter().map(|&region| region as i32).collect();
    let piece = vtu_write::Piece {
        points: &mesh.nodes,
        cell: vtu_write::Cell::Tetra,
        connectivity: mesh.tets.as_flattened().to_vec(),
        vectors: Vec::new(),
        numbers: mesh.regions.iter().any(|&region| region != 0).then(|| ("region", regions())),
    };
    Ok(Encoded { files: vec![("vtu", vtu_write::encode(&[piece]))], lost: lost(mesh, 0) })
}
