//! Helpers of several formats' writers: checks, the groups to write, and sentences on what a format cannot hold; and advice
//! for files of formats that are not read: geometry without a mesh, and meshes of other programs.

use super::format::extension;
use crate::mesh::error::MeshError;
use crate::mesh::tet_mesh::TetMesh;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Refuses a mesh whose parts do not fit together, and a region above 2³¹ - 1.
pub fn check(mesh: &TetMesh, encoding: &'static str) -> Result<(), MeshError> {
    let refuse = |reason| MeshError::Unwritable { encoding, reason };
    check_indices(mesh).map_err(refuse)?;
    match mesh.regions.iter().find(|&&region| i32::try_from(region).is_err()) {
        Some(region) => Err(refuse(format!("region {region} is above {}", i32::MAX))),
        None => Ok(()),
    }
}

/// Refuses a mesh whose parts do not fit together.
pub fn check_indices(mesh: &TetMesh) -> Result<(), String> {
    if mesh.tags.len() != mesh.nodes.len() || mesh.regions.len() != mesh.tets.len() {
        return Err("its nodes and tags, or tetrahedra and regions, differ in number".to_owned());
    }
    let mut used = mesh.tets.iter().flatten().chain(mesh.groups.values().flatten());
    match used.find(|&&node| node as usize >= mesh.nodes.len()) {
        Some(node) => Err(format!("node index {node} is not below {}", mesh.nodes.len())),
        None => Ok(()),
    }
}

/// The node groups that the reader makes from named regions.
fn nodes_of_named_regions(mesh: &TetMesh) -> BTreeMap<&str, Vec<u32>> {
    let mut nodes: BTreeMap<&str, Vec<u32>> =
        mesh.region_names.values().map(|name| (name.as_str(), Vec::new())).collect();
    for (tet, region) in mesh.tets.iter().zip(&mesh.regions) {
        let name = mesh.region_names.get(region).map(String::as_str);
        if let Some(nodes) = name.and_then(|name| nodes.get_mut(name)) {
            nodes.extend(tet);
        }
    }
    for nodes in nodes.values_mut() {
        nodes.sort_unstable();
        nodes.dedup();
    }
    nodes
}

/// The node groups that have to be written: a reader does not make them from the names of regions.
pub fn own_groups(mesh: &TetMesh) -> impl Iterator<Item = (&String, &Vec<u32>)> {
    let implied = nodes_of_named_regions(mesh);
    mesh.groups.iter().filter(move |&(name, nodes)| implied.get(name.as_str()) != Some(nodes))
}

/// Sentences on names, groups and node numbers that a format cannot hold; its own node numbers begin at `first`.
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

/// Appends formatted text to a string, which cannot fail.
pub fn put(text: &mut String, line: std::fmt::Arguments) {
    let written = text.write_fmt(line);
    debug_assert!(written.is_ok(), "a string takes all text");
}

/// A sentence with the command that converts a file that no reader knows; `None` if it is not known here either.
pub fn advice(path: &Path, bytes: &[u8]) -> Option<String> {
    let name = path.file_name().unwrap_or_default().display();
    let mesh = path.with_extension("msh");
    let mesh = mesh.file_name().unwrap_or_default().display();
    let is_step = bytes.starts_with(b"ISO-10303-21");
    Some(match extension(path).as_str() {
        "step" | "stp" | "p21" | "iges" | "igs" | "brep" => geometry(&name, &mesh),
        _ if is_step => geometry(&name, &mesh),
        "geo" => format!("is a Gmsh script; mesh it: `gmsh -3 -clmax 0.008 -format msh41 {name} -o {mesh}`"),
        "fcstd" | "sldprt" | "ipt" | "prt" | "catpart" | "x_t" | "3mf" | "off" | "dae" | "fbx" | "glb"
        | "gltf" => {
            format!(
                "is not read: save it as STL, OBJ or PLY (a closed surface), or as STEP, which Gmsh can mesh: {name}"
            )
        }
        "bdf" | "nas" | "unv" | "med" | "cgns" => {
            format!("is not read; Gmsh converts it: `gmsh {name} -save -format msh41 -o {mesh}`")
        }
        "e" | "exo" | "xdmf" | "h5m" | "ugrid" | "su2" => {
            format!("is not read; meshio converts it: `meshio convert {name} part.vtu`")
        }
        _ => return None,
    })
}

fn geometry(name: &dyn std::fmt::Display, mesh: &dyn std::fmt::Display) -> String {
    format!(
        "is CAD geometry without a mesh. Mesh it with `gmsh -3 -clmax 5 -format msh41 {name} -o {mesh}`, \
         then `greenstage new {mesh} --unit mm`"
    )
}
