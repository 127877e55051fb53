//! Faults that readers refuse, with file, line and reason; faults that they repair, with a notice.

use greenstage::mesh::{Block, Encoding, LoadedMesh, block, encode, load, parse, quality::signed_volume};
use std::path::Path;

fn read(text: &str) -> Result<LoadedMesh, String> {
    parse(Path::new("m.msh"), text.as_bytes()).map_err(|error| error.to_string())
}

/// A unit tetrahedron in Gmsh 2.2, with `from` replaced by `to`.
fn version_2(from: &str, to: &str) -> Result<LoadedMesh, String> {
    let text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n\
        $PhysicalNames\n1\n3 7 \"soft\"\n$EndPhysicalNames\n\
        $Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n\
        $Elements\n2\n1 2 2 11 1 1 2 3\n2 4 2 7 1 1 2 3 4\n$EndElements\n";
    assert!(text.contains(from), "{from}");
    read(&text.replacen(from, to, 1))
}

/// A file in Gmsh 4.1 with `from` replaced by `to`.
fn version_4(from: &str, to: &str) -> Result<LoadedMesh, String> {
    let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n\
        $PhysicalNames\n1\n3 7 \"soft\"\n$EndPhysicalNames\n\
        $Entities\n0 0 1 1\n1 0 0 0 1 1 0 1 11 0\n1 0 0 0 1 1 1 1 7 1 1\n$EndEntities\n\
        $Nodes\n2 4 1 4\n2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n3 1 0 1\n4\n0 0 1\n$EndNodes\n\
        $Elements\n2 2 1 2\n2 1 2 1\n1 1 2 3\n3 1 4 1\n2 1 2 3 4\n$EndElements\n";
    assert!(text.contains(from), "{from}");
    read(&text.replacen(from, to, 1))
}

#[track_caller]
fn refused(result: Result<LoadedMesh, String>, expected: &str) {
    match result {
        Err(message) => assert!(message.starts_with(expected), "`{message}` instead of `{expected}`"),
        Ok(loaded) => panic!("accepted: {loaded:?} instead of `{expected}`"),
    }
}

#[test]
fn both_versions_say_the_same() {
    let two = version_2("", "").unwrap();
    assert_eq!(two, version_4("", "").unwrap());
    assert_eq!(two.notices, [] as [&str; 0]);
    assert_eq!(two.mesh.regions, [7]);
    assert_eq!(two.mesh.region_names[&7], "soft");
    assert_eq!(two.mesh.groups["soft"], [0, 1, 2, 3]);
    assert_eq!(two.mesh.groups["11"], [0, 1, 2]);
    assert_eq!(two.mesh.groups.len(), 2);
}

#[test]
fn malformed_version_2_names_line_and_reason() {
    for (from, to, expected) in [
        ("2.2 0", "2.2 2", "m.msh:2: file type 2"),
        ("2.2 0 8", "2.2 0", "m.msh:2: expected version, file type and data size"),
        ("3 7 \"soft\"", "3 7 soft", "m.msh:6: expected `dimension number \"name\"`"),
        ("3 7 \"soft\"", "4 7 \"soft\"", "m.msh:6: expected `dimension number \"name\"`"),
        ("1\n3 7 \"soft\"", "2\n3 7 \"soft\"\n3 7 \"hard\"", "m.msh:7: physical group 7"),
        ("1\n3 7 \"soft\"", "2\n3 7 \"soft\"", "m.msh:7: expected `dimension number"),
        ("1 0 0\n", "1 0\n", "m.msh:11: the line ends where a number is expected"),
        ("1 0 0\n", "1 0 0 0\n", "m.msh:11: the line should end before `0`"),
        ("1 0 0\n", "1 O 0\n", "m.msh:11: expected a number, found `O`"),
        ("1 0 0\n", "1 0 nan\n", "m.msh:11: node 2 has a coordinate that is no finite"),
        ("1 0 0\n", "1 0 1e999\n", "m.msh:11: node 2 has a coordinate that is no finite"),
        ("\n2 1 0 0", "\n1 1 0 0", "m.msh:11: node 1 is defined twice"),
        ("\n2 1 0 0", "\n-2 1 0 0", "m.msh:11: expected a count or tag, found `-2`"),
        ("Nodes\n4", "Nodes\n5", "m.msh:14: fewer entries than the section's count says"),
        ("Nodes\n4", "Nodes\n3", "m.msh:13: expected $EndNodes, found `4 0 0 1`"),
        ("Nodes\n4", "Nodes\nx", "m.msh:9: expected a count, found `x`"),
        ("Elements\n2", "Elements\n1", "m.msh:18: expected $EndElements"),
        ("2 4 2 7 1 1 2 3 4", "2 4 2 7 1 1 2 3 9", "m.msh:18: element 2 names node 9"),
        ("2 11 1 1 2 3\n", "2 11 1 1 2 8\n", "m.msh:17: element 1 names node 8"),
        ("2 4 2 7 1 1 2 3 4", "2 4 2 7 1 1 2 3 3", "m.msh:18: tetrahedron 2 names a node twice"),
        ("2 4 2 7 1 1 2 3 4", "2 36 2 7 1 1 2 3 4", "m.msh:18: element type 36 is not known"),
        ("2 4 2 7 1 1 2 3 4", "2 4 1 7 1 1 2 3 4", "m.msh:18: the line should end before `4`"),
        (
            "2\n1 2 2 11 1 1 2 3\n",
            "3\n1 2 2 11 1 1 2 3\n8 4 2 7 1 2 1 4 3\n",
            "m.msh:19: tetrahedron 2 has the same nodes [1, 2, 3, 4] as tetrahedron 8",
        ),
        ("2\n1 2 2 11 1 1 2 3\n2 4 2 7 1 1 2 3 4\n", "0\n", "m.msh: the file holds no elements"),
        ("2\n1 2 2 11 1 1 2 3\n2 4 2 7 1 1 2 3 4\n", "1\n1 2 2 11 1 1 2 3\n", "m.msh: none of the file's 1"),
        ("$EndElements\n", "", "m.msh:19: the file ends before $EndElements"),
        ("$EndElements", "$EndElement", "m.msh:19: expected $EndElements, found `$EndElement`"),
        ("$EndElements\n", "$EndElements\nrubbish", "m.msh:20: expected a section ($Name)"),
        ("$EndNodes", "$EndNodes\n$Nodes\n0\n$EndNodes", "m.msh:15: a second section $Nodes"),
    ] {
        refused(version_2(from, to), expected);
    }
    refused(
        version_2("1 0 0\n", "1e160 0 0\n")
            .and_then(|_| version_2("2 1 0 0\n3 0 1 0\n4 0 0 1", "2 1e160 0 0\n3 0 1e160 0\n4 0 0 1e160")),
        "m.msh:18: tetrahedron 2: its coordinates are too large",
    );
}

#[test]
fn malformed_version_4_names_line_and_reason() {
    for (from, to, expected) in [
        ("0 0 1 1\n", "0 0 2 1\n", "m.msh:11: entity 1 of dimension 2 is listed twice"),
        ("0 0 1 1\n", "0 0 1 2\n", "m.msh:12: fewer entries than the section's count says: `$EndEntities`"),
        ("1 0 0 0 1 1 0 1 11 0", "1 0 0 0 1 1 0 9 11 0", "m.msh:10: the line ends where"),
        ("2 4 1 4", "2 5 1 4", "m.msh:14: the section's head says 5 nodes, its blocks hold 4"),
        ("2 4 1 4", "3 4 1 4", "m.msh:25: fewer entries than the section's count says: `$EndNodes`"),
        ("2 4 1 4", "1 3 1 4", "m.msh:22: expected $EndNodes, found `3 1 0 1`"),
        ("2 1 0 3\n1\n", "4 1 0 3\n1\n", "m.msh:15: 4 is no dimension"),
        ("2 1 0 3\n1\n", "2 1 2 3\n1\n", "m.msh:15: parametric is 2"),
        ("2 2 1 2", "2 3 1 2", "m.msh:27: the section's head says 3 elements"),
        ("2 1 2 1\n", "2 1 4 1\n", "m.msh:28: elements of dimension 3 on an entity of dimension 2"),
        ("2 1 2 1\n", "2 1 99 1\n", "m.msh:28: element type 99 is not known"),
        ("1 1 2 3\n", "1 1 2 5\n", "m.msh:29: element 1 names node 5"),
    ] {
        refused(version_4(from, to), expected);
    }
}

#[test]
fn other_versions_are_refused_with_advice() {
    let advice = "convert it with `gmsh old.msh -save -format msh41 -o new.msh`";
    for (text, start) in [
        ("$NOD\n1\n1 0 0 0\n$ENDNOD\n", "m.msh:1: Gmsh 1.0 is not read"),
        ("$MeshFormat\n3 0 8\n$EndMeshFormat\n", "m.msh:2: Gmsh 3 is not read, only 2.2, 4.0 and 4.1"),
    ] {
        let message = read(text).unwrap_err();
        assert!(message.starts_with(start) && message.ends_with(advice), "{message}");
    }
    refused(
        version_2("$Nodes", "$ParametricNodes"),
        "m.msh:8: nodes with parametric coordinates are read in Gmsh 4.1",
    );
    refused(read(""), "m.msh: no section $MeshFormat");
    refused(read("(0 \"fluent\")"), "m.msh:1: expected a section ($Name), found `(0 \\\"fluent\\\")`");
    refused(read("$Nodes\n0\n$EndNodes\n"), "m.msh:1: $Nodes stands before $MeshFormat");
    let message = parse(Path::new("a.xyz"), b"hello").unwrap_err().to_string();
    let start = "a.xyz: not a mesh file that can be read; known are Gmsh 2.2, 4.0 and 4.1 (.msh), VTK legacy (.vtk), ";
    assert!(message.starts_with(start), "{message}");
    let message = load(Path::new("no/such.msh")).unwrap_err().to_string();
    assert!(message.starts_with("no/such.msh: cannot be read: "), "{message}");
}

#[test]
fn truncated_anywhere_is_refused() {
    let mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
    for encoding in Encoding::ALL {
        let bytes = encode(&mesh, encoding).unwrap();
        // Without its very last byte, a line end, the file is still whole.
        for length in 0..bytes.len() - 1 {
            let result = parse(Path::new("m.msh"), &bytes[..length]);
            assert!(result.is_err(), "{encoding:?} cut to {length} of {} bytes", bytes.len());
        }
    }
}

#[test]
fn binary_faults_name_the_byte() {
    let mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
    let bytes = encode(&mesh, Encoding::Gmsh41Binary).unwrap();
    let cut = bytes.len() - 40;
    let message = parse(Path::new("m.msh"), &bytes[..cut]).unwrap_err().to_string();
    assert_eq!(message, format!("m.msh:byte {cut}: the file ends too early"));
    let mut swapped = bytes.clone();
    let one = bytes.windows(4).position(|window| window == [1, 0, 0, 0]).unwrap();
    swapped[one] = 2;
    let message = parse(Path::new("m.msh"), &swapped).unwrap_err().to_string();
    assert!(message.starts_with(&format!("m.msh:byte {one}: expected the number 1")), "{message}");
}

#[test]
fn crlf_blank_lines_marks_order_and_unknown_sections_do_not_matter() {
    let text = "\u{feff}$Comments\n$EndNodes here\n$EndComments\n$MeshFormat\n2.2 0 8\n$EndMeshFormat\n\
        $Elements\n1\n\n2 4 2 7 1 10 20 30 99999999999999\n$EndElements\n\n\
        $Nodes\n4\n10 0 0 0  \n20 1 0 0\n\n30 0 1 0\n99999999999999 0 0 1\n$EndNodes\n\
        $NodeData\nanything\n$EndNodeData";
    let loaded = read(text).unwrap();
    assert_eq!(loaded.mesh.tags, [10, 20, 30, 99_999_999_999_999]);
    assert_eq!(loaded.mesh.regions, [7]);
    assert_eq!(loaded.notices, ["sections not used: $Comments, $NodeData"]);
    assert_eq!(read(&text.replace('\n', "\r\n")).unwrap(), loaded);
}

#[test]
fn physical_tag_0_or_none_is_region_0() {
    for tags in ["2 0 1", "0", "1 0"] {
        let loaded = version_2("2 4 2 7 1 1", &format!("2 4 {tags} 1")).unwrap();
        assert_eq!(loaded.mesh.regions, [0]);
        assert_eq!(loaded.mesh.groups["soft"], [] as [u32; 0]);
    }
    assert_eq!(version_4("1 1 1 1 7 1 1", "1 1 1 0 1 1").unwrap().mesh.regions, [0]);
    refused(version_4("$Entities", "$Ignored"), "m.msh:8: the section has no $EndIgnored");
}

#[test]
fn inverted_tetrahedra_are_flipped_and_flat_ones_left() {
    let loaded = version_2("1 1 2 3 4\n", "1 1 3 2 4\n").unwrap();
    assert_eq!(
        loaded.notices,
        ["1 of 1 tetrahedra were oriented negatively and have been flipped (element 2)"]
    );
    assert!((signed_volume(&loaded.mesh.corners(0)) - 1.0 / 6.0).abs() < 1e-15);
    let flat = version_2("4 0 0 1\n", "4 1 1 0\n").unwrap();
    assert_eq!((flat.mesh.tets, flat.notices.len()), (vec![[0, 1, 2, 3]], 0));
}

#[test]
fn unused_nodes_are_dropped_and_groups_follow() {
    let text = "4\n9 5 5 5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1".replacen('4', "5", 1);
    let loaded = version_2("4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1", &text).unwrap();
    assert_eq!(loaded.notices, ["1 nodes belong to no tetrahedron and have been dropped (node 9)"]);
    assert_eq!((loaded.mesh.tags, loaded.mesh.nodes.len()), (vec![1, 2, 3, 4], 4));
    assert_eq!(loaded.mesh.groups["11"], [0, 1, 2]);
}

#[test]
fn ten_node_tetrahedra_keep_their_corners() {
    let nodes = "10\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 .5 0 0\n6 .5 .5 0\n7 0 .5 0\n8 0 0 .5\n9 0 .5 .5\n10 .5 0 .5";
    let text = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes}\n$EndNodes\n\
         $Elements\n2\n1 9 2 11 1 1 2 3 5 6 7\n2 11 2 7 1 1 2 3 4 5 6 7 8 9 10\n$EndElements\n"
    );
    let loaded = read(&text).unwrap();
    assert_eq!(loaded.mesh.tets, [[0, 1, 2, 3]]);
    assert_eq!(loaded.mesh.groups["11"], [0, 1, 2]);
    assert_eq!(
        loaded.notices,
        [
            "1 tetrahedra of 10 or more nodes: only their 4 corners are used, 6 nodes between them have been dropped"
        ]
    );
}

#[test]
fn parametric_coordinates_are_read_over() {
    let loaded = version_4(
        "2 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n3 1 0 1\n4\n0 0 1\n",
        "2 1 1 3\n1\n2\n3\n0 0 0 7 8\n1 0 0 7 8\n0 1 0 7 8\n3 1 1 1\n4\n0 0 1 7 8 9\n",
    );
    assert_eq!(loaded, version_4("", ""));
}

#[test]
fn partition_entities_carry_the_physical_groups() {
    let loaded = version_4(
        "$EndEntities\n",
        "$EndEntities\n$PartitionedEntities\n2\n1\n9 1\n0 0 0 1\n5 3 1 1 2 0 0 0 1 1 1 1 7 0\n$EndPartitionedEntities\n",
    );
    assert_eq!(loaded, version_4("", ""));
    let moved = version_4(
        "$EndEntities\n",
        "$EndEntities\n$PartitionedEntities\n2\n0\n0 0 0 1\n1 3 1 1 2 0 0 0 1 1 1 1 7 0\n$EndPartitionedEntities\n",
    );
    refused(moved, "m.msh:17: entity 1 of dimension 3 is listed twice");
}

#[test]
fn groups_of_one_name_are_joined_with_a_notice() {
    let loaded = version_2("2\n1 2 2 11 1 1 2 3\n", "3\n1 2 2 11 1 1 2 3\n5 1 2 11 1 1 4\n").unwrap();
    assert_eq!(loaded.mesh.groups["11"], [0, 1, 2, 3]);
    assert_eq!(loaded.notices, ["group \"11\" joins the physical groups curve 11, surface 11"]);
    let two = version_4("1 1 7 1 1", "1 2 7 8 1 1").unwrap();
    assert_eq!(two.mesh.regions, [7]);
    assert_eq!(two.notices, ["volume 1 belongs to the physical groups [7, 8]: its region is the first, 7"]);
}

#[test]
fn hexahedra_are_left_out_with_a_notice() {
    let loaded = version_2("2\n1 2 2 11 1 1 2 3\n", "3\n1 2 2 11 1 1 2 3\n5 7 2 9 1 1 2 3 4 1\n").unwrap();
    assert_eq!(loaded.notices, ["1 solid elements that are no tetrahedra have been left out"]);
}

#[test]
fn names_that_the_format_cannot_hold_are_refused() {
    let mut mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
    mesh.groups.insert("a\"b".to_owned(), vec![]);
    let message = encode(&mesh, Encoding::Gmsh41Text).unwrap_err().to_string();
    assert!(message.starts_with("the mesh cannot be written as Gmsh 4.1 text: the name"), "{message}");
    mesh.groups.clear();
    mesh.tags[3] = 1 << 31;
    assert!(encode(&mesh, Encoding::Gmsh41Text).is_ok());
    let message = encode(&mesh, Encoding::Gmsh22Binary).unwrap_err().to_string();
    assert!(message.ends_with("node tag 2147483648 is above 2147483647"), "{message}");
    mesh.tets[0][0] = 8;
    assert!(encode(&mesh, Encoding::Gmsh41Text).is_err());
}
