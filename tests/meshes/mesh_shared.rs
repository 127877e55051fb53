//! Real meshes, where they are at hand, against the counts that others found.

use crate::common::shared;
use greenstage::mesh::{Surface, TetMesh, load, quality};
use std::collections::{BTreeMap, BTreeSet};

/// A mesh without its order: positions and groups by node tag, tetrahedra by sorted tags with their region.
#[derive(Debug, PartialEq)]
struct Unordered {
    nodes: BTreeMap<u64, [u64; 3]>,
    tets: BTreeSet<([u64; 4], u32)>,
    names: BTreeMap<u32, String>,
    groups: BTreeMap<String, BTreeSet<u64>>,
}

fn unordered(mesh: &TetMesh) -> Unordered {
    let tag = |&node: &u32| mesh.tags[node as usize];
    let tets = mesh.tets.iter().zip(&mesh.regions).map(|(tet, region)| {
        let mut tags = tet.map(|node| tag(&node));
        tags.sort_unstable();
        (tags, *region)
    });
    Unordered {
        nodes: mesh
            .tags
            .iter()
            .copied()
            .zip(mesh.nodes.iter().map(|x| [x.x, x.y, x.z].map(f64::to_bits)))
            .collect(),
        tets: tets.collect(),
        names: mesh.region_names.clone(),
        groups: mesh
            .groups
            .iter()
            .map(|(name, nodes)| (name.clone(), nodes.iter().map(tag).collect()))
            .collect(),
    }
}

#[test]
fn cases_are_the_same_in_gmsh_2_and_4() {
    for (case, nodes) in [("tube", 2769), ("block2", 1574)] {
        let (Some(two), Some(four)) =
            (shared(&format!("cases/{case}/mesh.msh")), shared(&format!("cases/{case}/mesh41.msh")))
        else {
            return;
        };
        let (two, four) = (load(&two).unwrap(), load(&four).unwrap());
        assert_eq!(two.notices, four.notices);
        assert_eq!(two.mesh.nodes.len(), nodes);
        assert_eq!(unordered(&two.mesh), unordered(&four.mesh));
        assert!(two.mesh.groups.contains_key("surface"));
    }
}

#[test]
fn real_meshes_have_the_counts_of_their_manifest() {
    let Some(manifest) = shared("meshes/MANIFEST.md") else { return };
    let text = std::fs::read_to_string(&manifest).unwrap();
    let rows =
        text.lines().take_while(|line| !line.starts_with("## raw")).filter(|line| line.contains(".msh |"));
    let mut count = 0;
    for row in rows {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let number = |i: usize| cells[i].parse::<usize>().unwrap();
        let loaded = load(&manifest.with_file_name(cells[1])).unwrap();
        assert_eq!(loaded.notices, [] as [&str; 0], "{row}");
        let mesh = loaded.mesh;
        let surface = Surface::from_mesh(&mesh);
        let report = quality::report(&mesh, &surface);
        let found = [
            report.nodes,
            report.tetrahedra,
            report.surface_nodes,
            report.surface_triangles,
            report.regions.len(),
            report.components,
        ];
        assert_eq!(found, [3, 4, 5, 6, 7, 8].map(number), "{row}");
        let [min, mean] = [10, 11].map(|i| cells[i].parse::<f64>().unwrap());
        assert!((report.quality.min - min).abs() < 1e-5, "{row}: {:?}", report.quality);
        assert!((report.quality.mean - mean).abs() < 1e-3, "{row}: {:?}", report.quality);
        assert!((report.volume / surface.volume(&mesh) - 1.0).abs() < 1e-11, "{row}");
        count += 1;
    }
    assert_eq!(count, 14);
}

#[test]
fn raw_meshes_are_read_or_refused_with_the_reason() {
    // Name, then either tetrahedra, used nodes and words of the notices, or the refusal.
    type Read = (usize, usize, &'static [&'static str]);
    let expected: [(&str, Result<Read, &str>); 14] = [
        ("sofa_raptorTetra_8418.vtu", Ok((8418, 2993, &["3 nodes belong to no tetrahedron"]))),
        ("admm_box768.node", Ok((1175, 413, &[]))),
        ("admm_box768.ele", Ok((1175, 413, &[]))),
        ("sfepy_elbow2.mesh", Ok((8161, 1823, &["8161 of 8161 tetrahedra were oriented negatively"]))),
        ("sfepy_wheelset.vtk", Ok((21934, 5457, &[]))),
        ("sofa_msh4_cube.msh", Ok((24, 14, &[]))),
        ("sofa_6_tetra_bad.msh", Ok((6, 17, &["1 of 6 tetrahedra were oriented negatively"]))),
        (
            "polyfem_microstructure_P2.msh",
            Ok((6414, 1585, &["8 of 6414 tetrahedra were", "6414 tetrahedra of 10 or more nodes"])),
        ),
        ("fenris_cube_tet10_24.msh", Ok((24, 14, &["24 tetrahedra of 10 or more nodes"]))),
        // The manifest has no counts for this one; these are of its $Elements, counted by another program.
        ("mfemdata_piece.asc.v40.msh", Ok((13676, 4072, &["24 nodes belong to no tetrahedron"]))),
        ("mfemdata_piece.asc.v41.msh", Ok((13370, 4067, &["27 nodes belong to no tetrahedron"]))),
        ("mfemdata_piece.bin.v41.msh", Ok((13370, 4067, &["27 nodes belong to no tetrahedron"]))),
        ("mfemdata_piece.bin.v22.msh", Ok((13179, 3915, &["24 nodes belong to no tetrahedron"]))),
        ("calculix_segment.inp", Err("no tetrahedra (C3D4, C3D10) among its elements: 96 of type C3D20")),
    ];
    for (name, expected) in expected {
        let Some(path) = shared(&format!("meshes/raw/{name}")) else { return };
        match (load(&path).map_err(|error| error.to_string()), expected) {
            (Ok(loaded), Ok((tets, nodes, notices))) => {
                let found = (loaded.mesh.tets.len(), loaded.mesh.nodes.len());
                assert_eq!(found, (tets, nodes), "{name}: {:?}", loaded.notices);
                assert_eq!(loaded.notices.len(), notices.len(), "{name}: {:?}", loaded.notices);
                let is_said = |notice: &&str| loaded.notices.iter().any(|n| n.starts_with(notice));
                assert!(notices.iter().all(is_said), "{name}: {:?}", loaded.notices);
            }
            (Err(message), Err(part)) => assert!(message.contains(part), "{message}"),
            (found, _) => panic!("{name}: {found:?}"),
        }
    }
}
