//! Quadratic meshes: from files of 10-node tetrahedra, from corners alone, and as scenes ask for them.

use crate::common::{HAPTICS, folder, shared};
use greenstage::green::{self};
use greenstage::mesh::{self, Order, Surface, TetMesh, generate, parse_as, quadratic};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use std::fmt::Write;
use std::path::Path;

fn linear() -> TetMesh {
    generate::block(&generate::Block { size: [2.0, 1.0, 1.0], cells: [4, 2, 2] }).unwrap()
}

/// Gmsh 2.2 with one tetrahedron of 10 nodes a line, and of 4 where `short` says so.
fn gmsh(mesh: &TetMesh, short: impl Fn(usize) -> bool) -> String {
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", mesh.nodes.len());
    for (tag, x) in mesh.tags.iter().zip(&mesh.nodes) {
        writeln!(text, "{tag} {} {} {}", x.x, x.y, x.z).unwrap();
    }
    writeln!(text, "$EndNodes\n$Elements\n{}", mesh.tets.len()).unwrap();
    for tet in 0..mesh.tets.len() {
        let count = if short(tet) { 4 } else { 10 };
        let kind = if short(tet) { 4 } else { 11 };
        write!(text, "{} {kind} 2 1 1", tet + 1).unwrap();
        for node in &mesh::quadratic::nodes(mesh, tet)[..count] {
            write!(text, " {}", mesh.tags[*node as usize]).unwrap();
        }
        text.push('\n');
    }
    text + "$EndElements\n"
}

fn parse(text: &str, order: Order) -> Result<mesh::LoadedMesh, String> {
    parse_as(Path::new("ten.msh"), text.as_bytes(), order).map_err(|error| error.to_string())
}

#[test]
fn a_file_keeps_its_mid_side_nodes_or_loses_them_with_a_notice() {
    let mesh = quadratic(linear(), &mesh::quadratic::straight);
    let text = gmsh(&mesh, |_| false);
    let kept = parse(&text, Order::Quadratic).unwrap();
    assert_eq!((&kept.mesh.nodes, &kept.mesh.tags), (&mesh.nodes, &mesh.tags));
    assert_eq!((&kept.mesh.tets, &kept.mesh.mids), (&mesh.tets, &mesh.mids));
    assert_eq!(kept.notices, [""; 0]);
    let corners = parse(&text, Order::Linear).unwrap();
    assert_eq!((&corners.mesh.nodes, &corners.mesh.tets), (&linear().nodes, &linear().tets));
    assert!(corners.mesh.mids.is_empty());
    assert!(corners.notices[0].contains("only their 4 corners are used"), "{:?}", corners.notices);
}

/// A tetrahedron whose corners are turned keeps each node on its own edge.
#[test]
fn turned_tetrahedra_keep_their_edges() {
    let mut mesh = quadratic(linear(), &mesh::quadratic::straight);
    for (tet, mids) in mesh.tets.iter_mut().zip(&mut mesh.mids).step_by(3) {
        tet.swap(0, 1);
        let [a, b, c, d, e, f] = *mids;
        *mids = [a, c, b, f, e, d];
    }
    let loaded = parse(&gmsh(&mesh, |_| false), Order::Quadratic).unwrap();
    assert!(loaded.notices[0].contains("oriented negatively"), "{:?}", loaded.notices);
    for tet in 0..loaded.mesh.tets.len() {
        assert!((mesh::quadratic::least_jacobian(&loaded.mesh, tet) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn files_that_cannot_be_quadratic_are_refused() {
    let mesh = quadratic(linear(), &mesh::quadratic::straight);
    let error = parse(&gmsh(&mesh, |tet| tet == 7), Order::Quadratic).unwrap_err();
    assert!(error.contains("tetrahedron 8 has 4 nodes, others have 10"), "{error}");
    assert!(parse(&gmsh(&mesh, |tet| tet == 7), Order::Linear).is_ok());

    let mut cracked = mesh.clone();
    let shared_edge = cracked.mids[0][0];
    let twin = cracked.nodes.len() as u32;
    cracked.nodes.push(cracked.nodes[shared_edge as usize]);
    cracked.tags.push(9999);
    cracked.mids[0][0] = twin;
    let error = parse(&gmsh(&cracked, |_| false), Order::Quadratic).unwrap_err();
    assert!(error.contains("lies node") && error.contains("9999") && error.contains("merge them"), "{error}");

    let mut corner = mesh.clone();
    let (own, mid) = (corner.tets[0][0], corner.mids[0][0]);
    corner.mids.iter_mut().flatten().filter(|node| **node == mid).for_each(|node| *node = own);
    assert!(parse(&gmsh(&corner, |_| false), Order::Quadratic).unwrap_err().contains("is a corner of"));
}

/// The scene of a body file in `folder`, held by a tag file at x = -1 and by a plane at x = 1.
fn scene(folder: &Path, file: &str, element: &str) -> Scene {
    let text = format!(
        "[body.b]\nmesh = \"{file}\"\nelement = \"{element}\"\nmaterial = {{ young = 1.0e3, poisson = 0.3 }}\n\
         [body.b.control.low]\nnodes = {{ file = \"low.txt\" }}\ngrab = \"fixed\"\n[body.b.control.high]\n\
         nodes = {{ plane = {{ point = [1.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0], distance = 1e-9 }} }}\n\
         grab = \"dragger\"\n"
    );
    Scene::parse(&text, &folder.join("scene.toml")).unwrap()
}

/// Ten nodes from the file or from its corners: the same body, held at the same nodes.
#[test]
fn the_same_body_from_ten_nodes_and_from_four() {
    let folder = folder("quadratic");
    let mesh = quadratic(linear(), &mesh::quadratic::straight);
    std::fs::write(folder.join("ten.msh"), gmsh(&mesh, |_| false)).unwrap();
    std::fs::write(folder.join("four.msh"), gmsh(&mesh, |_| true)).unwrap();
    let tags = |mesh: &TetMesh| {
        let held = mesh.nodes.iter().zip(&mesh.tags).filter(|(x, _)| x.x == -1.0);
        held.map(|(_, tag)| format!("{tag}\n")).collect::<String>()
    };
    let solve = |file: &str, element: &str| {
        green::solve(&scene(&folder, file, element), "b", &HAPTICS, &Silent).unwrap()
    };
    std::fs::write(folder.join("low.txt"), tags(&mesh)).unwrap();
    let ten = solve("ten.msh", "tet10");
    std::fs::write(folder.join("low.txt"), tags(&linear())).unwrap();
    let four = solve("four.msh", "tet10");
    assert_eq!(four.controls[0].nodes.len(), 25);
    assert_eq!(ten.mesh.nodes.len(), four.mesh.nodes.len());
    let (s, t) = (ten.stiffness().unwrap(), four.stiffness().unwrap());
    assert!((s - t).amax() < 1e-12 * s.amax(), "{:e}", (s - t).amax() / s.amax());
    let corners = solve("ten.msh", "tet4");
    let corners = corners.stiffness().unwrap();
    assert!(
        corners[(1, 1)] > 1.02 * s[(1, 1)],
        "linear tetrahedra are stiffer: {} {}",
        corners[(1, 1)],
        s[(1, 1)]
    );
    assert_eq!(four.surface.triangles.len(), 4 * Surface::from_mesh(&linear()).triangles.len());
}

/// A mid-side node dragged through its element is found before anything is solved.
#[test]
fn folded_edges_are_refused_by_name() {
    let folder = folder("quadratic-folded");
    let mut mesh = quadratic(linear(), &mesh::quadratic::straight);
    let tet = mesh.tets[5];
    mesh.nodes[mesh.mids[5][0] as usize] = mesh.nodes[tet[3] as usize];
    std::fs::write(folder.join("ten.msh"), gmsh(&mesh, |_| false)).unwrap();
    std::fs::write(folder.join("low.txt"), "1\n2\n3\n4\n").unwrap();
    let error =
        green::solve(&scene(&folder, "ten.msh", "tet10"), "b", &HAPTICS, &Silent).err().unwrap().to_string();
    assert!(error.contains("folded by their curved edges"), "{error}");
    assert!(green::solve(&scene(&folder, "ten.msh", "tet4"), "b", &HAPTICS, &Silent).is_ok());
}

#[test]
fn real_files_of_ten_nodes() {
    let Some(cube) = shared("meshes/raw/fenris_cube_tet10_24.msh") else { return };
    let loaded = mesh::load_quadratic(&cube).unwrap().mesh;
    assert_eq!((loaded.nodes.len(), loaded.tets.len(), loaded.mids.len()), (63, 24, 24));
    assert!((Surface::from_mesh(&loaded).volume(&loaded) - 1.0).abs() < 1e-12);
    assert!((0..24).all(|tet| (mesh::quadratic::least_jacobian(&loaded, tet) - 1.0).abs() < 1e-9));
}
