//! Every format that is read and written: small files of each variant, round trips and faults.

mod small;

use crate::mesh_roundtrip::{any_block, bits};
use greenstage::mesh::{EDGES, LoadedMesh, Order, TetMesh, formats::writers, load, parse, parse_as, save};
use nalgebra::Vector3;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use std::path::Path;

fn read(name: &str, bytes: &[u8]) -> Result<LoadedMesh, String> {
    parse(Path::new(name), bytes).map_err(|error| error.to_string())
}

/// Replaces the first `from` in a text.
fn edited(text: &str, from: &str, to: &str) -> Vec<u8> {
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1).into_bytes()
}

fn positions() -> Vec<Vector3<f64>> {
    small::NODES.map(Vector3::from).to_vec()
}

#[track_caller]
fn refused(name: &str, bytes: &[u8], expected: &str) {
    match read(name, bytes) {
        Err(message) => assert!(message.starts_with(expected), "`{message}` instead of `{expected}`"),
        Ok(loaded) => panic!("accepted: {loaded:?} instead of `{expected}`"),
    }
}

/// Two tetrahedra on five nodes in every variant give the same positions, tetrahedra and regions.
#[test]
fn all_variants_of_all_formats_say_the_same() {
    for (name, bytes) in small::all() {
        let loaded = read(&name, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        let mesh = loaded.mesh;
        assert_eq!(mesh.nodes, positions(), "{name}");
        assert_eq!(mesh.tets, [[0, 1, 2, 3], [1, 2, 3, 4]], "{name}");
        assert_eq!(mesh.regions, [3, 7], "{name}");
        assert_eq!(loaded.notices, [] as [&str; 0], "{name}");
    }
}

#[test]
fn vega_sets_are_groups_and_regions() {
    let vega = String::from_utf8(small::vega()).unwrap();
    let named = vega.replace("Region_3", "soft part").replace("*SET Region_7\n1\n", "").replace(
        "*REGION\nRegion_7, hard\n",
        "*MATERIAL hard\nENU, 1000, 2e6, 0.4\n*MATERIAL odd\nMOONEYRIVLIN, 1, 2, 3, 4\n*OWN thing\n",
    );
    let loaded = read("m.veg", named.as_bytes()).unwrap();
    assert_eq!(loaded.mesh.regions, [1, 0]);
    assert_eq!(loaded.mesh.region_names[&1], "soft part");
    assert_eq!(loaded.mesh.groups["soft part"], [0, 1, 2, 3]);
    assert!(
        loaded.notices[0].ends_with(
            "hard = { young = 2000000.0, poisson = 0.4, density = 1000.0 }; odd (MOONEYRIVLIN, 1, 2, 3, 4)"
        ),
        "{:?}",
        loaded.notices
    );
    assert_eq!(loaded.notices[1], "sections not used: *OWN");
    // All elements in one region, then some of them in another.
    let two = edited(&vega, "*REGION\nRegion_3", "*REGION\nallElements, all\n*REGION\nRegion_3");
    assert_eq!(read("m.veg", &two).unwrap().mesh.regions, [3, 7]);
    for (from, to, expected) in [
        ("5 3 0 0", "6 3 0 0", "m.veg:10: expected a vertex, found `*ELEMENTS`: fewer entries than said?"),
        ("5 3 0 0", "4 3 0 0", "m.veg:8: expected a keyword (*NAME), found `4, 1"),
        ("TETS", "CUBIC", "m.veg:11: elements of the kind CUBIC are not read"),
        ("2 4 0", "3 4 0", "m.veg:16: expected an element, found `*SET Region_3`"),
        ("1, 1, 2, 3, 4", "1, 1, 2, 3", "m.veg:14: the line ends where the number of a vertex is expected"),
        ("1, 1, 2, 3, 4", "1, 1, 2, x, 4", "m.veg:14: expected the number of a vertex, found `x`"),
        (" 0,\n", " 5,\n", "m.veg:17: set Region_3: there is no element 5 before it"),
        ("Region_3, soft", "Region_5, soft", "m.veg:21: there is no set Region_5 (*SET)"),
        ("*REGION", "*INCLUDE more.veg\n*REGION", "m.veg:20: *INCLUDE is not followed"),
        (
            "*ELEMENTS\nTETS\n2 4 0\n0 0 1 2 3\n1, 1, 2, 3, 4",
            "",
            "m.veg:13: set Region_3: there is no element 0",
        ),
    ] {
        refused("m.veg", &edited(&vega, from, to), expected);
    }
    refused("m.veg", b"*VERTICES\n1 3 0 0\n0 0 0 0\n", "m.veg: no section *ELEMENTS");
}

/// GiD is recognised by its content, whatever the name; a Gmsh file of the same extension is still one.
#[test]
fn gid_is_told_from_gmsh_by_its_first_line() {
    let gid = String::from_utf8(small::gid()).unwrap();
    let plain = gid.replace(" 3\n2 12", "\n2 12").replace(" 7\nEnd", "\nEnd");
    assert_eq!(read("m.msh", plain.as_bytes()).unwrap().mesh.regions, [0, 0]);
    assert_eq!(read("m", gid.as_bytes()).unwrap().mesh.regions, [3, 7]);
    // A second MESH of faces, and a third of tetrahedra, on the coordinates of the first.
    let faces = "MESH \"clamped\" dimension 3 ElemType Triangle Nnode 3\nCoordinates\nEnd Coordinates\n\
                 Elements\n7 11 12 13\nEnd Elements\n";
    let solid = "MESH core dimension 3 ElemType Tetrahedra Nnode 4\nElements\n8 11 12 13 15\nEnd Elements\n";
    let loaded = read("m.msh", (plain.clone() + "Unit \"mm\"\n" + faces + solid).as_bytes()).unwrap();
    assert_eq!(loaded.mesh.regions, [1, 1, 3]);
    assert_eq!(loaded.mesh.region_names[&1], "a body");
    assert_eq!(loaded.mesh.groups["clamped"], [0, 1, 2]);
    assert!(loaded.notices[0].contains("its unit is \"mm\""), "{:?}", loaded.notices);
    for (from, to, expected) in [
        ("Dimension 3", "Dimension 2", "m.msh:2: a mesh in 2 dimensions, not 3"),
        ("nnode 4", "nnode 5", "m.msh:2: tetrahedra of 5 nodes are not known"),
        ("tetrahedra", "blobs", "m.msh:2: elements of the kind blobs are not known: Point, Line"),
        ("nnode 4", "", "m.msh:2: MESH without Nnode: write `MESH"),
        ("end coordinates\n", "", "m.msh:10: expected the number of a node, found `Elements`"),
        ("End Elements", "", "m.msh:14: the file ends where End Elements is expected"),
        (
            "1 11 12 13 14 3",
            "1 11 12",
            "m.msh:12: expected the number of an element and those of its 4 nodes",
        ),
        ("13 14 3", "13 14 x", "m.msh:12: expected the number of a material, found `x`"),
        ("Elements", "Elephants", "m.msh:11: expected MESH, Coordinates or Elements, found `Elephants`"),
    ] {
        refused("m.msh", &edited(&gid, from, to), expected);
    }
    refused("m.msh", b"hello\n", "m.msh:1: ");
}

/// GiD counts the edge 13 before 23, Gmsh after it.
#[test]
fn the_ten_nodes_of_gid_stand_on_their_edges() {
    let corners = [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]];
    let edges = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];
    let middles =
        edges.map(|[a, b]: [usize; 2]| [0, 1, 2].map(|axis| (corners[a][axis] + corners[b][axis]) / 2));
    let nodes: String = (1..)
        .zip(corners.iter().chain(&middles))
        .map(|(tag, [x, y, z])| format!("{tag} {x} {y} {z}\n"))
        .collect();
    let text = format!(
        "MESH dimension 3 ElemType Tetrahedra Nnode 10\nCoordinates\n{nodes}End Coordinates\nElements\n\
         1 1 2 3 4 5 6 7 8 9 10\nEnd Elements\n"
    );
    let mesh = parse_as(Path::new("m.msh"), text.as_bytes(), Order::Quadratic).unwrap().mesh;
    for (edge, mid) in EDGES.iter().zip(mesh.mids[0]) {
        let [a, b] = edge.map(|corner| mesh.nodes[mesh.tets[0][corner] as usize]);
        assert_eq!(mesh.nodes[mid as usize], (a + b) / 2.0, "{edge:?}");
    }
}

#[test]
fn geometry_and_foreign_meshes_are_told_what_converts_them() {
    for (name, bytes, expected) in [
        ("part.step", &b"ISO-10303-21;\nHEADER;"[..], "gmsh -3 -clmax 5 -format msh41 part.step -o part.msh"),
        ("part", b"ISO-10303-21;\nHEADER;", "gmsh -3"),
        ("part.igs", b"", "gmsh -3 -clmax 5 -format msh41 part.igs"),
        ("part.geo", b"SetFactory", "gmsh -3 -clmax 0.008"),
        ("part.bdf", b"", "gmsh part.bdf -save -format msh41 -o part.msh"),
        ("part.exo", b"", "meshio convert part.exo part.vtu"),
        ("part.txt", b"", "not a mesh file that can be read; known are Gmsh"),
    ] {
        let told = read(name, bytes).unwrap_err();
        assert!(told.starts_with(&format!("{name}: ")) && told.contains(expected), "{told}");
    }
}

#[test]
fn tetgen_is_read_by_either_name_and_names_the_file_at_fault() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let nodes = "# five nodes\n5 3 0 1\n0 0 0 0 0\n1 1 0 0 0 # a comment\n2 0 1 0 0\n3 0 0 1 0\n4 1 1 1 0\n";
    let tets = "2 4 1\n0 0 1 2 3 3\n1 1 2 3 4 7\n";
    std::fs::write(path("a.node"), nodes).unwrap();
    std::fs::write(path("a.ele"), tets).unwrap();
    let one = load(&path("a.node")).unwrap();
    assert_eq!(one, load(&path("a.ele")).unwrap());
    assert_eq!((one.mesh.nodes, one.mesh.regions), (positions(), vec![3, 7]));
    assert_eq!(one.mesh.tags, [0, 1, 2, 3, 4]);

    let message = |name: &str| load(&path(name)).unwrap_err().to_string();
    std::fs::write(path("b.ele"), tets).unwrap();
    assert!(message("b.ele").contains("b.ele: holds a part of the mesh alone, and"), "{}", message("b.ele"));
    for (bad, at) in
        [("1 1 0 x 0", "a.node:4: expected a number, found `x`"), ("1 1 0 0", "a.node:4: 5 numbers")]
    {
        std::fs::write(path("a.node"), nodes.replace("1 1 0 0 0", bad)).unwrap();
        assert!(message("a.ele").contains(at), "{}", message("a.ele"));
        assert!(message("a.node").contains(at), "{}", message("a.node"));
    }
    std::fs::write(path("a.node"), nodes).unwrap();
    for (bad, at) in
        [("1 2 3 9 7", "a.ele:3: element 1 names node 9"), ("1 2 3", "a.ele:3: 6 numbers are expected")]
    {
        std::fs::write(path("a.ele"), tets.replace("1 2 3 4 7", bad)).unwrap();
        assert!(message("a.ele").contains(at), "{}", message("a.ele"));
        assert!(message("a.node").contains(at), "{}", message("a.node"));
    }
    std::fs::write(path("a.ele"), "1 10 0\n0 0 1 2 3 4 4 4 4 4 4\n").unwrap();
    let ten = load(&path("a.ele")).unwrap();
    assert!(
        ten.notices[0].starts_with("1 tetrahedra of 10 nodes: only their 4 corners"),
        "{:?}",
        ten.notices
    );
}

#[test]
fn quadratic_tetrahedra_keep_their_corners() {
    for (name, bytes) in small::quadratic() {
        let loaded = read(&name, &bytes).unwrap();
        assert_eq!(loaded.mesh.tets, [[0, 1, 2, 3]], "{name}");
        let notice = "1 tetrahedra of 10 or more nodes: only their 4 corners are used, 6 nodes between them";
        assert!(loaded.notices.iter().any(|found| found.starts_with(notice)), "{name}: {:?}", loaded.notices);
    }
}

#[test]
fn malformed_vtk_names_line_or_byte() {
    let text = String::from_utf8(small::vtk_text("3.0")).unwrap();
    for (from, to, expected) in [
        ("Version 3.0", "Version 9.0", "m.vtk:1: expected `# vtk DataFile Version 1 to 5`"),
        ("ASCII", "ASCI", "m.vtk:3: expected ASCII or BINARY, found `ASCI`"),
        ("UNSTRUCTURED_GRID", "POLYDATA", "m.vtk:4: a dataset of type `POLYDATA`"),
        ("POINTS 5", "POINTS 6", "m.vtk:11: expected a number, found `CELLS`"),
        ("POINTS 5", "POINTS 4", "m.vtk:10: expected a VTK section, found `1`"),
        ("POINTS 5 double", "POINTS 5 string", "m.vtk:5: numbers of type `string` are not read"),
        ("POINTS 5", "POINTS 9999999999999999999", "m.vtk:5: 9999999999999999999 points"),
        ("CELLS 2 10", "CELLS 3 10", "m.vtk:11: 3 cells of 10 numbers are said, 2 cells found"),
        ("4 1 2 3 4", "4 1 2 3 9", "m.vtk:13: element 1 names node 9"),
        ("4 1 2 3 4", "4 1 2 3 -4", "m.vtk:13: -4 is no number of a point"),
        ("4 1 2 3 4", "4 1 2 3 3", "m.vtk:13: tetrahedron 1 names a node twice"),
        ("CELL_TYPES 2\n10\n10", "CELL_TYPES 1\n10", "m.vtk:12: 2 cells, but 1 cell types"),
        ("10\n10", "9\n9", "m.vtk: none of the file's 2 elements"),
        ("10\n10", "10\n5", "m.vtk:13: cell 1 of type 5 has 4 points, not 3"),
        ("SCALARS", "SCALES", "m.vtk:18: expected a VTK section, found `SCALES`"),
    ] {
        refused("m.vtk", &edited(&text, from, to), expected);
    }
    let binary = small::vtk_binary(5);
    refused("m.vtk", &binary[..120], "m.vtk:byte ");
    let notice = |from: &str, to: &str| read("m.vtk", &edited(&text, from, to)).unwrap().notices;
    let face =
        read("m.vtk", &edited(&text, "4 1 2 3 4\nCELL_TYPES 2\n10\n10", "4 0 1 3 2\nCELL_TYPES 2\n10\n9"))
            .unwrap();
    assert_eq!(face.mesh.groups["7"], [0, 1, 2, 3]);
    assert_eq!(notice("10\n10", "10\n42")[0], "1 cells of VTK type 42 have been left out");
    let odd = notice("3\n7", "3\n7.5");
    assert!(odd[0].starts_with("cell array \"region\" is not taken for regions: 7.5"), "{odd:?}");
}

#[test]
fn malformed_vtu_names_the_place() {
    let text = String::from_utf8(small::vtu_text("LittleEndian")).unwrap();
    for (from, to, expected) in [
        ("type=\"UnstructuredGrid\"", "type=\"PolyData\"", "m.vtu:2: a file of type `PolyData`"),
        (
            "NumberOfPoints=\"5\"",
            "NumberOfPoints=\"6\"",
            "m.vtu:6: the piece's head says 6 points, the array holds 5",
        ),
        ("NumberOfCells=\"2\"", "NumberOfCells=\"x\"", "m.vtu:4: NumberOfCells is no count: `x`"),
        ("Name=\"types\"", "Name=\"kinds\"", "m.vtu:4: the piece has no array \"types\""),
        ("1 2 3 4\n", "1 2 3 9\n", "m.vtu:14: element 1 names node 9"),
        ("1 2 3 4\n", "1 2 3 q\n", "m.vtu:15: expected a number, found `q`"),
        ("1 2 3 4\n", "1 2 3 &#52;\n", "m.vtu:15: a reference (&…;) within an array of numbers"),
        ("<Cells>", "<Cell>", "m.vtu:"),
        ("format=\"ascii\"", "format=\"xdmf\"", "m.vtu:6: format `xdmf` is none of ascii, binary, appended"),
        ("</VTKFile>", "", "m.vtu:"),
    ] {
        refused("m.vtu", &edited(&text, from, to), expected);
    }
    let lz4 = text.replace("byte_order", "compressor=\"vtkLZ4DataCompressor\" byte_order");
    let lz4 = lz4.replace("\"ascii\"", "\"binary\"");
    let message = read("m.vtu", lz4.as_bytes()).unwrap_err();
    assert!(message.contains("vtkLZ4DataCompressor` is not read: save with zlib"), "{message}");
    let bomb = vtu_bomb();
    let message = read("m.vtu", &bomb).unwrap_err();
    assert!(message.contains("more than 64 times the file's bytes"), "{message}");
}

/// A file whose first array claims to hold, and does hold, far more than the file's own bytes.
fn vtu_bomb() -> Vec<u8> {
    let array = |kind: &str, rest: &str, _: &str| {
        let block = small::deflated(&vec![0; 1 << 20]);
        let head: Vec<u8> =
            [1, 1 << 20, 0, block.len()].iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
        let text = small::base64(&head) + &small::base64(&block);
        format!("<DataArray type=\"{kind}\" {rest} format=\"binary\">{text}</DataArray>\n")
    };
    let attributes = "byte_order=\"LittleEndian\" compressor=\"vtkZLibDataCompressor\"";
    (small::vtu_head(attributes, array) + "</VTKFile>\n").into_bytes()
}

#[test]
fn abaqus_sets_become_groups_and_regions() {
    let text = String::from_utf8(small::abaqus()).unwrap();
    let mesh = read("m.inp", text.as_bytes()).unwrap().mesh;
    assert_eq!(mesh.tags, [10, 20, 30, 40, 50]);
    assert_eq!(mesh.groups["Tip"], [0, 2, 4]);
    assert_eq!(mesh.groups["All"], [0, 1, 2, 3, 4]);
    assert_eq!(mesh.groups["both"], [0, 2, 4]);
    assert!(mesh.region_names.is_empty());

    let named = read("m.inp", &edited(&text, "ELSET=Region_7", "ELSET=rubber")).unwrap().mesh;
    assert_eq!((named.regions, named.region_names[&1].as_str()), (vec![3, 1], "rubber"));
    assert_eq!(named.groups["rubber"], [1, 2, 3, 4]);

    let overlap = "*ELSET, ELSET=Eall, GENERATE\n1, 2\n";
    let loaded = read("m.inp", &edited(&text, "*STEP", &format!("{overlap}*STEP"))).unwrap();
    assert_eq!(loaded.mesh.regions, [3, 7]);
    assert_eq!(loaded.mesh.groups["Eall"], [0, 1, 2, 3, 4]);
    assert!(loaded.notices[0].starts_with("element sets overlap (2 times)"), "{:?}", loaded.notices);

    let section = format!("{overlap}*SOLID SECTION, ELSET=EALL, MATERIAL=steel\n1.,\n*STEP");
    let loaded = read("m.inp", &edited(&text, "*STEP", &section)).unwrap();
    assert_eq!(loaded.mesh.regions, [1, 1]);
    assert_eq!(loaded.mesh.region_names[&1], "Eall");
    assert_eq!(loaded.mesh.groups["Region_7"], [1, 2, 3, 4]);
    assert_eq!(loaded.notices, [] as [&str; 0]);

    let [_, (_, mut ten)] = small::quadratic().try_into().unwrap();
    ten.extend(b"*ELSET, ELSET=first\n1\n*ELSET, ELSET=second\n1\n");
    let groups = parse_as(Path::new("ten.inp"), &ten, Order::Quadratic).unwrap().mesh.groups;
    assert!(
        ["first", "second"].iter().all(|name| groups[*name] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]),
        "{groups:?}"
    );
}

#[test]
fn malformed_abaqus_names_line_and_remedy() {
    let text = String::from_utf8(small::abaqus()).unwrap();
    for (from, to, expected) in [
        ("*STEP", "*INCLUDE, INPUT=a.inp", "m.inp:25: *INCLUDE is not followed: put the lines"),
        ("*NODE, NSET=All", "*Node, NSet=All, input = n.inp", "m.inp:4: INPUT= names another file"),
        ("*NODE, NSET=All", "*NODE, SYSTEM=C, NSET=All", "m.inp:4: nodes in cylinder"),
        ("*STEP", "*NGEN\n1,2", "m.inp:25: *NGEN makes or moves nodes"),
        ("20, 1", "20, l", "m.inp:6: expected a number, found `l.e0`"),
        ("2, 20, 30, 40, 50", "2, 20, 30, 40", "m.inp:15: 3 of the 4 nodes of a C3D4"),
        ("2, 20, 30, 40, 50", "2, 20, 30, 40, 50, 60", "m.inp:15: more than the 4 nodes of a C3D4"),
        ("2, 20, 30, 40, 50", "2, 20, 30, 40, 60", "m.inp:15: element 2 names node 60"),
        ("2, 20, 30, 40, 50", "1, 20, 30, 40, 50", "m.inp:15: element 1 is defined twice"),
        ("10, 50, 20", "10, 50, 0", "m.inp:18: expected first, last and step"),
        ("Tip\n*", "Top\n*", "m.inp:22: `Top` is no set that stands before"),
        ("TYPE=C3D4", "TYPE=C3D8", "m.inp: "),
        ("*HEADING", "HEADING", "m.inp:2: expected a keyword"),
    ] {
        refused("m.inp", &edited(&text, from, to), expected);
    }
    let none = text.replace("C3D4", "C3D20");
    let message = read("m.inp", none.as_bytes()).unwrap_err();
    assert!(message.contains("no tetrahedra (C3D4, C3D10) among its elements: 2 of type C3D20"), "{message}");
    let hostile: String = (0..900).map(|i| format!("*NSET,NSET=s{i},GENERATE\n1,99999\n")).collect();
    let message = read("m.inp", &edited(&text, "*STEP", &hostile)).map(|loaded| loaded.mesh.groups.len());
    assert_eq!(message, Ok(903), "small sets of all nodes are taken");
}

#[test]
fn malformed_medit_names_the_line() {
    let text = String::from_utf8(small::medit()).unwrap();
    for (from, to, expected) in [
        ("Formatted", "Unformatted", "m.mesh:1: expected `MeshVersionFormatted`"),
        ("Dimension 3", "Dimension 2", "m.mesh:2: a mesh in 2 dimensions, not 3"),
        ("Vertices\n5", "Vertices\n6", "m.mesh:11: expected a number, found `Tetrahedra`"),
        ("Vertices\n5", "Vertices\n4", "m.mesh:10: expected a section, found `1`"),
        ("2 3 4 5 7", "2 3 4 6 7", "m.mesh:14: element 2 names node 6"),
        ("2 3 4 5 7", "2 3 4 5 7.5", "m.mesh:14: expected a reference, found `7.5`"),
        ("Tetrahedra", "Tetraeder", "m.mesh: the file holds no elements"),
        ("1 0 0 0", "nan 0 0 0", "m.mesh:7: node 2 has a coordinate that is no finite number"),
    ] {
        refused("m.mesh", &edited(&text, from, to), expected);
    }
    refused("m.meshb", b"\x01\0\0\0\x02\0\0\0", "m.meshb: a binary Medit file is not read: save it as text");
    let loaded = read("m.mesh", &edited(&text, "End", "Corners\n1\n1\nTriangles\n1\n1 2 3 9\nEnd")).unwrap();
    assert_eq!(loaded.mesh.groups["9"], [0, 1, 2]);
    assert_eq!(loaded.notices, ["sections not used: Corners"]);
}

#[test]
fn truncated_anywhere_is_refused_or_whole() {
    // Nothing marks the end of an Abaqus file.
    for (name, bytes) in small::all().into_iter().filter(|(name, _)| name != "m.inp") {
        let whole = read(&name, &bytes).unwrap().mesh;
        for length in 0..bytes.len() {
            // Attributes stand last in VTK files: without them regions may be missing.
            if let Ok(loaded) = read(&name, &bytes[..length]) {
                assert_eq!(loaded.mesh.nodes, whole.nodes, "{name} cut to {length}");
            }
        }
    }
}

/// Names of groups differ by more than upper and lower case, as Abaqus wants it.
fn any_mesh() -> impl Strategy<Value = TetMesh> {
    (any_block("[a-zA-Zä_]{1,9} ?[0-9]"), 1u64..99).prop_map(|(mut mesh, first)| {
        mesh.tags = (first..).step_by(3).take(mesh.nodes.len()).collect();
        let mut seen = std::collections::BTreeSet::new();
        mesh.groups.retain(|name, _| seen.insert(name.to_uppercase()));
        mesh
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_writer_gives_back_the_mesh(mesh in any_mesh()) {
        let folder = tempfile::tempdir().unwrap();
        for writer in writers() {
            let path = folder.path().join("m").with_extension(writer.files[0].0);
            let lost = save(&path, &mesh, Some(writer.name)).unwrap();
            let loaded = load(&path).map_err(|error| error.to_string());
            prop_assert!(loaded.is_ok(), "{}: {:?}", writer.name, loaded);
            let loaded = loaded.unwrap();
            prop_assert_eq!(bits(&loaded.mesh), bits(&mesh), "{}", writer.name);
            prop_assert_eq!(&loaded.mesh.tets, &mesh.tets, "{}", writer.name);
            prop_assert_eq!(&loaded.mesh.regions, &mesh.regions, "{}", writer.name);
            prop_assert_eq!(loaded.notices, Vec::<String>::new());
            // What is not the same has been told.
            if lost.is_empty() {
                prop_assert_eq!(&loaded.mesh, &mesh, "{}", writer.name);
            } else {
                let said = lost.join(" ");
                prop_assert_eq!(said.contains("node groups"), !mesh.groups.is_empty());
                prop_assert!(said.contains("numbered anew"));
            }
        }
    }

    #[test]
    fn arbitrary_bytes_do_not_panic(extension in select(vec!["vtk", "vtu", "inp", "mesh", "meshb", "xyz"]),
                                    bytes in vec(any::<u8>(), 0..400)) {
        let _ = read(&format!("m.{extension}"), &bytes);
        let text: String = bytes.iter().map(|byte| char::from(b' ' + byte % 90)).collect();
        let _ = read(&format!("m.{extension}"), text.as_bytes());
    }
}
