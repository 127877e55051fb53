//! Writes Abaqus and CalculiX `.inp`.
//!
//! In: a [`TetMesh`]. Out: *NODE with the mesh's own node numbers, *ELEMENT of type C3D4, an *ELSET for each region
//! but an unnamed 0, an *NSET for each node group.

use super::format::Encoded;
use super::write::{check, own_groups, put};
use crate::mesh::error::MeshError;
use crate::mesh::tet_mesh::TetMesh;
use std::collections::{BTreeMap, BTreeSet};

pub fn encode(mesh: &TetMesh) -> Result<Encoded, MeshError> {
    check(mesh, "Abaqus")?;
    let mut sets: BTreeMap<u32, String> = BTreeMap::new();
    let mut lost = Vec::new();
    let used: BTreeSet<u32> = mesh.regions.iter().copied().collect();
    for &region in &used {
        match mesh.region_names.get(&region) {
            Some(name) => {
                sets.insert(region, name.clone());
            }
            None if region > 0 => {
                sets.insert(region, format!("Region_{region}"));
            }
            None => {}
        }
    }
    let unused: Vec<&str> = mesh
        .region_names
        .iter()
        .filter(|(number, _)| !used.contains(number))
        .map(|(_, name)| name.as_str())
        .collect();
    if !unused.is_empty() {
        lost.push(format!("regions without tetrahedra are not written: {}", unused.join(", ")));
    }
    let named: Vec<u32> =
        used.iter().copied().filter(|region| mesh.region_names.contains_key(region)).collect();
    let unnamed = used.iter().filter(|&&region| !mesh.region_names.contains_key(&region)).copied();
    let taken: BTreeSet<u32> = unnamed.collect();
    let free: Vec<u32> = (1..).filter(|number| !taken.contains(number)).take(named.len()).collect();
    if named != free {
        lost.push("named regions keep their names, but are numbered anew when the file is read".to_owned());
    }
    let groups: Vec<(&String, &Vec<u32>)> = own_groups(mesh).collect();
    distinct("element sets", sets.values())?;
    distinct("node sets", groups.iter().map(|(name, _)| *name))?;

    let mut text = String::from("*HEADING\nwritten by greenstage\n*NODE\n");
    for (tag, x) in mesh.tags.iter().zip(&mesh.nodes) {
        put(&mut text, format_args!("{tag}, {:?}, {:?}, {:?}\n", x.x, x.y, x.z));
    }
    text.push_str("*ELEMENT, TYPE=C3D4\n");
    for (tet, number) in mesh.tets.iter().zip(1u64..) {
        let [a, b, c, d] = tet.map(|node| mesh.tags[node as usize]);
        put(&mut text, format_args!("{number}, {a}, {b}, {c}, {d}\n"));
    }
    for (region, name) in &sets {
        put(&mut text, format_args!("*ELSET, ELSET=\"{name}\"\n"));
        members(
            &mut text,
            (1u64..).zip(&mesh.regions).filter(|(_, of)| *of == region).map(|(number, _)| number),
        );
    }
    for (name, nodes) in groups {
        put(&mut text, format_args!("*NSET, NSET=\"{name}\"\n"));
        members(&mut text, nodes.iter().map(|&node| mesh.tags[node as usize]));
    }
    Ok(Encoded { files: vec![text.into_bytes()], lost })
}

/// Writes up to 16 numbers a line, as Abaqus wants it.
fn members(text: &mut String, numbers: impl Iterator<Item = u64>) {
    for (i, number) in numbers.enumerate() {
        let after = if i % 16 == 15 { "\n" } else { " " };
        put(text, format_args!("{number},{after}"));
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
}

/// Refuses names that Abaqus would not accept, or would take for the same.
fn distinct<'a>(what: &str, names: impl Iterator<Item = &'a String>) -> Result<(), MeshError> {
    let mut seen = BTreeSet::new();
    for name in names {
        let refuse = |reason: &str| {
            let reason = format!("the name {name:?} of its {what} {reason}");
            Err(MeshError::Unwritable { encoding: "Abaqus", reason })
        };
        if name.trim().is_empty()
            || name.trim() != name
            || name.contains(|c: char| ",\"=".contains(c) || c.is_control())
        {
            return refuse("is empty, or holds a comma, a quote, an equals sign or outer blanks");
        }
        if !seen.insert(name.to_uppercase()) {
            return refuse("differs from another only by upper and lower case");
        }
    }
    Ok(())
}
