//! Helpers of several formats' writers: checks, the groups to write, and sentences on what a format cannot hold.

use crate::mesh::error::MeshError;
use crate::mesh::tet_mesh::TetMesh;
use std::collections::BTreeMap;
use std::fmt::Write;

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
