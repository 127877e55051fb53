//! Meshes that are written are read back, bit by bit; no input makes a reader panic.

use crate::mesh_geometry::demo_tube;
use greenstage::mesh::{Block, Encoding, LoadedMesh, TetMesh, block, encode, load, parse, save, tube};
use proptest::collection::{btree_map, btree_set, vec};
use proptest::prelude::*;
use proptest::sample::{Index, select};
use std::collections::BTreeSet;
use std::path::Path;

/// A block, its nodes moved a little and its size anything, with regions, and groups whose names match `name`.
pub fn any_block(name: &'static str) -> impl Strategy<Value = TetMesh> {
    let shape = (prop::array::uniform3(1u32..4), -90..90i32, vec(-0.1..0.1f64, 64 * 3));
    let regions = vec(select(vec![0, 1, 2, 7, i32::MAX as u32]), 27 * 5);
    let groups = btree_map(name, vec(any::<Index>(), 0..20), 0..4);
    (shape, regions, groups).prop_map(|((cells, exponent, shifts), regions, groups)| {
        let mut mesh = block(&Block { size: cells.map(f64::from), cells }).expect("1 to 3 cells of size 1");
        for (node, shift) in mesh.nodes.iter_mut().zip(shifts.chunks(3)) {
            *node = (*node + nalgebra::Vector3::from_column_slice(shift)) * 10f64.powi(exponent);
        }
        mesh.regions = regions.into_iter().take(mesh.tets.len()).collect();
        mesh.groups.clear();
        for (name, members) in groups {
            let nodes: BTreeSet<u32> =
                members.iter().map(|index| index.index(mesh.nodes.len()) as u32).collect();
            mesh.groups.insert(name, nodes.into_iter().collect());
        }
        mesh
    })
}

/// Meshes with tags and names of regions too.
fn any_mesh() -> impl Strategy<Value = TetMesh> {
    const NAME: &str = "[^\"\\p{Cc}]{0,12}";
    let names = btree_map(0u32..8, NAME, 0..4);
    (any_block(NAME), btree_set(0..=i32::MAX as u64, 64), names).prop_map(|(mut mesh, tags, names)| {
        mesh.tags = tags.into_iter().take(mesh.nodes.len()).collect();
        mesh.region_names = names;
        // A named region is a group, too.
        for (region, name) in &mesh.region_names {
            let group = mesh.groups.entry(name.clone()).or_default();
            let tets = mesh.tets.iter().zip(&mesh.regions).filter(|(_, of)| *of == region);
            group.extend(tets.flat_map(|(tet, _)| tet));
            group.sort_unstable();
            group.dedup();
        }
        mesh
    })
}

fn read(bytes: &[u8]) -> Option<LoadedMesh> {
    parse(Path::new("m.msh"), bytes).ok()
}

/// Equality of f64 takes 0 for -0.
pub fn bits(mesh: &TetMesh) -> Vec<u64> {
    mesh.nodes.iter().flatten().map(|x| x.to_bits()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_encoding_gives_back_the_same_mesh(mesh in any_mesh()) {
        for encoding in Encoding::ALL {
            let bytes = encode(&mesh, encoding).unwrap();
            let loaded = parse(Path::new("m.msh"), &bytes).map_err(|error| error.to_string());
            let loaded = loaded.map(|loaded| loaded.mesh);
            prop_assert_eq!(loaded.as_ref(), Ok(&mesh), "{:?}", encoding);
            prop_assert_eq!(loaded.map(|loaded| bits(&loaded)), Ok(bits(&mesh)));
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in vec(any::<u8>(), 0..300), head in 0..4usize) {
        let heads: [&[u8]; 4] = [b"", b"$MeshFormat\n", b"$MeshFormat\n2.2 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Elements\n9\n",
            b"$MeshFormat\n4.1 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Nodes\n"];
        let result = read(&[heads[head], &bytes].concat());
        prop_assert!(result.is_none());
    }

    #[test]
    fn damaged_files_are_read_or_refused(
        mesh in any_mesh(),
        encoding in select(Encoding::ALL.to_vec()),
        flips in vec((any::<Index>(), any::<u8>()), 0..4),
        words in vec((any::<Index>(), select(vec!["0", "-1", "4294967296", "1e999", "nan", "$Nodes", "\n", "99"])), 0..3),
        cut in prop::option::of(any::<Index>()),
    ) {
        let mut bytes = encode(&mesh, encoding).unwrap();
        for (index, value) in flips {
            let at = index.index(bytes.len());
            bytes[at] = value;
        }
        for (index, word) in words {
            let at = index.index(bytes.len());
            let start = bytes[..at].iter().rposition(u8::is_ascii_whitespace).map_or(0, |i| i + 1);
            let end = bytes[at..].iter().position(u8::is_ascii_whitespace).map_or(bytes.len(), |i| at + i);
            bytes.splice(start..end.max(start), word.bytes());
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Some(LoadedMesh { mesh, .. }) = read(&bytes) {
            let nodes = mesh.nodes.len();
            prop_assert!(mesh.tets.iter().flatten().all(|&node| (node as usize) < nodes));
            prop_assert!(mesh.groups.values().flatten().all(|&node| (node as usize) < nodes));
            prop_assert!(mesh.nodes.iter().flatten().all(|x| x.is_finite()));
            prop_assert_eq!((mesh.tags.len(), mesh.regions.len()), (nodes, mesh.tets.len()));
        }
    }
}

#[test]
fn a_tube_goes_through_a_file_of_each_encoding() {
    let mesh = tube(&demo_tube()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for encoding in ["msh22", "msh22-binary", "msh41", "msh41-binary"] {
        let path = folder.path().join(format!("{encoding}.MSH"));
        assert_eq!(save(&path, &mesh, Some(encoding)).unwrap(), [] as [&str; 0]);
        let start = std::time::Instant::now();
        let loaded = load(&path).unwrap();
        println!("{encoding}: read in {:.1?}", start.elapsed());
        assert_eq!(loaded, LoadedMesh { mesh: mesh.clone(), notices: vec![] });
    }
    // Folders that are missing are made, but a file is no folder.
    let message = save(&folder.path().join("msh22.MSH/a.msh"), &mesh, None).unwrap_err().to_string();
    assert!(message.contains("msh22.MSH/a.msh: cannot be written: "), "{message}");
}

#[test]
fn negative_zero_and_extreme_digits_survive_as_text() {
    let mut mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
    mesh.nodes[0].x = -0.5 - f64::EPSILON;
    mesh.nodes[0].y = -0.1 - 0.2 - 0.2;
    mesh.nodes.iter_mut().for_each(|node| node.z += 0.5);
    mesh.nodes[0].z = -0.0;
    mesh.nodes[2].z = 5e-324;
    for encoding in Encoding::ALL {
        let loaded = read(&encode(&mesh, encoding).unwrap()).unwrap();
        assert_eq!(bits(&loaded.mesh), bits(&mesh), "{encoding:?}");
    }
}
