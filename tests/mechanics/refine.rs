//! Uniform refinement: conforming meshes, exact volumes, bounded shapes, groups, and solutions that converge.

use crate::common::{block_scene, euler_characteristic_of_closed, scene, tet_volume};
use greenstage::green::{self, AFFINE, Requirements, STIFFNESS};
use greenstage::mesh::isosurface_stuffing::tetrahedralise;
use greenstage::mesh::quadratic::{least_jacobian, quadratic, straight};
use greenstage::mesh::quality::{components, overlapping_faces, quality_report, signed_volume};
use greenstage::mesh::refine::refine;
use greenstage::mesh::surface_check::check;
use greenstage::mesh::surface_files::TriangleSurface;
use greenstage::mesh::{Block, Surface, TetMesh, Tube, block, diagnostics, tube};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeSet;
use std::f64::consts::PI;

fn ring() -> Tube {
    Tube {
        inner_radius: 0.5,
        outer_radius: 1.0,
        length: 1.0,
        radial: 1,
        around: 8,
        along: 4,
        control_length: 0.25,
    }
}

fn refined_ring(times: u32) -> TetMesh {
    let ring = ring();
    refine(tube(&ring).unwrap(), times, &|a, b| ring.curve(a, b)).unwrap()
}

/// No hanging nodes: no face has more than two sides, every node belongs to a tetrahedron, and the surface is closed:
/// a hanging node would leave faces on it that no triangle meets.
fn assert_conforming(mesh: &TetMesh, euler: i64) {
    assert!(overlapping_faces(mesh).is_empty());
    assert_eq!(components(mesh).nodes, [(0..mesh.nodes.len() as u32).collect::<Vec<u32>>()]);
    assert_eq!(euler_characteristic_of_closed(&Surface::from_mesh(mesh)), euler);
    assert!(mesh.tets.len() == mesh.regions.len() && mesh.nodes.len() == mesh.tags.len());
    assert_eq!(mesh.tags.iter().collect::<BTreeSet<_>>().len(), mesh.tags.len());
    assert!((0..mesh.tets.len()).all(|tet| signed_volume(&mesh.corners(tet)) > 0.0));
}

#[test]
fn straight_bodies_keep_volume_area_nodes_and_regions() {
    let mut coarse = block(&Block { size: [3.0, 2.0, 1.0], cells: [3, 2, 1] }).unwrap();
    coarse.regions = (0..coarse.tets.len() as u32).map(|tet| tet % 3).collect();
    coarse.region_names.insert(2, "stiff".into());
    assert_eq!(refine(coarse.clone(), 0, &straight).unwrap().nodes, coarse.nodes);
    for times in 1..=3 {
        let mesh = refine(coarse.clone(), times, &straight).unwrap();
        assert_conforming(&mesh, 2);
        assert_eq!(mesh.tets.len(), coarse.tets.len() << (3 * times));
        assert!((tet_volume(&mesh) - 6.0).abs() < 1e-12);
        assert!((Surface::from_mesh(&mesh).area(&mesh) - 22.0).abs() < 1e-12);
        assert_eq!(
            Surface::from_mesh(&mesh).triangles.len(),
            Surface::from_mesh(&coarse).triangles.len() << (2 * times)
        );
        assert_eq!(mesh.nodes[..coarse.nodes.len()], coarse.nodes, "old nodes keep index and place");
        assert_eq!(mesh.tags[..coarse.nodes.len()], coarse.tags);
        let of_region = |region: u32| -> f64 {
            let tets = (0..mesh.tets.len()).filter(|&tet| mesh.regions[tet] == region);
            tets.map(|tet| signed_volume(&mesh.corners(tet))).sum()
        };
        let before = |region: u32| -> f64 {
            let tets = (0..coarse.tets.len()).filter(|&tet| coarse.regions[tet] == region);
            tets.map(|tet| signed_volume(&coarse.corners(tet))).sum()
        };
        assert!((0..3).all(|region| (of_region(region) - before(region)).abs() < 1e-12));
        assert_eq!(mesh.region_names, coarse.region_names);
        assert_eq!(diagnostics::find(&mesh), []);
    }
}

/// The nodes of a refined mesh are those of a mesh generated with more cells, in the same groups; but the middles of
/// cells, in which the edges of no five tetrahedra have their middle, are missing.
fn assert_nodes_and_groups_of(refined: &TetMesh, generated: &TetMesh, missing: usize) {
    let key = |x: &Vector3<f64>| <[i64; 3]>::from(x.map(|x| (x * 1e9).round() as i64));
    let places = |mesh: &TetMesh, nodes: &mut dyn Iterator<Item = u32>| -> BTreeSet<[i64; 3]> {
        nodes.map(|node| key(&mesh.nodes[node as usize])).collect()
    };
    let all = |mesh: &TetMesh| places(mesh, &mut (0..mesh.nodes.len() as u32));
    let (there, grid) = (all(refined), all(generated));
    assert!(there.len() == refined.nodes.len() && there.is_subset(&grid));
    assert_eq!(grid.len() - there.len(), missing);
    for (name, nodes) in &generated.groups {
        let group = &refined.groups[name];
        assert!(group.is_sorted_by(|a, b| a < b));
        let expected = places(generated, &mut nodes.iter().copied()).intersection(&there).copied().collect();
        assert!(places(refined, &mut group.iter().copied()) == expected, "{name}");
    }
}

#[test]
fn nodes_and_groups_are_those_of_twice_the_cells() {
    let coarse = Block { size: [3.0, 2.0, 1.0], cells: [3, 2, 1] };
    let fine = Block { cells: [6, 4, 2], ..coarse.clone() };
    let refined = refine(block(&coarse).unwrap(), 1, &straight).unwrap();
    assert_nodes_and_groups_of(&refined, &block(&fine).unwrap(), 3 * 2);

    let Tube { radial, around, along, .. } = ring();
    let fine = Tube { radial: 2 * radial, around: 2 * around, along: 2 * along, ..ring() };
    assert_nodes_and_groups_of(&refined_ring(1), &tube(&fine).unwrap(), 8 * 4);
}

#[test]
fn a_tube_stays_round_and_its_volume_converges_at_rate_2() {
    let exact = PI * 0.75;
    let mut errors = Vec::new();
    for times in 0..=3 {
        let mesh = refined_ring(times);
        assert_conforming(&mesh, 0);
        for (wall, radius) in [("inner", 0.5), ("outer", 1.0)] {
            let off = |&node: &u32| (mesh.nodes[node as usize].yz().norm() - radius).abs();
            assert!(mesh.groups[wall].iter().map(off).fold(0.0, f64::max) < 1e-14);
        }
        let error = (tet_volume(&mesh) / exact - 1.0).abs();
        let quality = quality_report(&mesh);
        println!("refined {times} times: volume {error:.2e} off, least quality {:.3}", quality.min);
        assert!(quality.min > 0.5 * quality_report(&tube(&ring()).unwrap()).min);
        errors.push(error);
    }
    let rates: Vec<f64> = errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect();
    assert!(rates.iter().all(|rate| (rate - 2.0).abs() < 0.1), "{rates:?}");
}

/// Bey's order gives at most three shapes a tetrahedron, so that the least quality does not fall after the first cuts.
#[test]
fn quality_is_bounded() {
    let mut crooked = block(&Block { size: [1.0; 3], cells: [3; 3] }).unwrap();
    let mut state = 1u64;
    for node in crooked.nodes.iter_mut().flat_map(|node| node.iter_mut()) {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        *node += 0.12 * ((state >> 33) as f64 / (1u64 << 31) as f64 - 0.5);
    }
    let mut ring = {
        let mesh = tube(&ring()).unwrap();
        let Surface { triangles, nodes } = Surface::from_mesh(&mesh);
        TriangleSurface { vertices: nodes.iter().map(|&node| mesh.nodes[node as usize]).collect(), triangles }
    };
    let report = check(&mut ring, &mut Vec::new());
    let stuffed = tetrahedralise(&ring, &report, 0.2, &mut Vec::new()).unwrap();
    for (name, mesh, limit) in [("crooked", crooked, 0.65), ("stuffed", stuffed, 0.65)] {
        let least: Vec<f64> = (0..=3)
            .map(|times| quality_report(&refine(mesh.clone(), times, &straight).unwrap()).min)
            .collect();
        println!("{name}: least quality {least:.3?}");
        assert!(least[1..].iter().all(|q| *q > limit * least[0]), "{name}: {least:?}");
        assert!((least[3] - least[2]).abs() < 1e-9, "{name}: {least:?}");
    }
}

/// A quadratic mesh is refined on its own curved faces: the map of the parent and those of its children agree, so the
/// body it describes does not change, and its walls are as round as its quadratic edges were.
#[test]
fn a_quadratic_mesh_keeps_its_curved_shape() {
    let ring = ring();
    let coarse = quadratic(tube(&ring).unwrap(), &|a, b| ring.curve(a, b));
    let mesh = refine(coarse.clone(), 1, &straight).unwrap();
    assert_conforming_quadratic(&coarse, &mesh);
    let again = refine(mesh.clone(), 1, &straight).unwrap();
    assert_conforming_quadratic(&mesh, &again);
    assert!((volume_of_map(&coarse) - volume_of_map(&mesh)).abs() < 1e-13);
    assert!((volume_of_map(&coarse) - volume_of_map(&again)).abs() < 1e-13);
    let exact = PI * 0.75;
    let off = (volume_of_map(&coarse) / exact - 1.0).abs();
    println!("volume of the quadratic ring: {off:.1e} off");
    assert!(off < 2e-3, "{off:e}");
    let refined = refine(tube(&ring).unwrap(), 1, &|a, b| ring.curve(a, b)).unwrap();
    let round = quadratic(refined, &|a, b| ring.curve(a, b));
    assert_eq!(round.nodes.len(), mesh.nodes.len());
    for name in ["left", "right", "inner", "outer"] {
        assert_eq!(round.groups[name].len(), mesh.groups[name].len(), "{name}");
    }
}

fn assert_conforming_quadratic(coarse: &TetMesh, fine: &TetMesh) {
    assert_eq!(fine.tets.len(), 8 * coarse.tets.len());
    assert_eq!(fine.mids.len(), fine.tets.len());
    assert_eq!(fine.nodes[..coarse.nodes.len()], coarse.nodes);
    let linear =
        TetMesh { nodes: coarse.nodes.clone(), tags: coarse.tags.clone(), mids: vec![], ..fine.clone() };
    assert_conforming(&linear, 0);
    assert!((0..fine.tets.len()).all(|tet| least_jacobian(fine, tet) > 0.3));
    let used: BTreeSet<u32> = fine.tets.iter().flatten().chain(fine.mids.iter().flatten()).copied().collect();
    assert_eq!(used.len(), fine.nodes.len());
}

/// ∫ det J over every tetrahedron: a cubic, integrated exactly by the five points of Keast's rule of degree 3.
fn volume_of_map(mesh: &TetMesh) -> f64 {
    use greenstage::mesh::quadratic::{jacobian, local_gradients, nodes};
    let det = |tet: usize, at: [f64; 4]| {
        let x = nodes(mesh, tet).map(|node| mesh.nodes[node as usize]);
        jacobian(&x, &local_gradients(&at)).determinant()
    };
    let of = |tet: usize| {
        let near = |i: usize| -> [f64; 4] { std::array::from_fn(|j| if i == j { 0.5 } else { 1.0 / 6.0 }) };
        let corners: f64 = (0..4).map(|i| det(tet, near(i))).sum();
        (0.45 * corners - 0.8 * det(tet, [0.25; 4])) / 6.0
    };
    (0..mesh.tets.len()).map(of).sum()
}

#[test]
fn what_its_curved_edges_fold_is_refused_with_its_place() {
    let mut mesh = quadratic(block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap(), &straight);
    let (corner, mid) = (mesh.tets[0][0], mesh.mids[0][0]);
    let beyond = mesh.nodes[corner as usize] * 2.0 - mesh.nodes[mid as usize];
    mesh.nodes[mid as usize] = beyond;
    let error = refine(mesh, 1, &straight).unwrap_err().to_string();
    assert!(
        error.contains("is folded by its curved edges") && error.contains("begin with a finer mesh"),
        "{error}"
    );
}

fn handle_stiffness(scene: &Scene) -> DMatrix<f64> {
    green::solve(scene, "block", &Requirements::new(&[STIFFNESS]), &Silent)
        .unwrap()
        .stiffness()
        .unwrap()
        .clone()
}

/// The space of a refined mesh contains that of the coarse one, and the ends are prescribed alike: the strain energy of every
/// pose falls, so S(h) - S(h/2) has no negative eigenvalue, and the steps shrink.
#[test]
fn energies_fall_from_refinement_to_refinement_and_converge() {
    let s: Vec<DMatrix<f64>> = (0..=3)
        .map(|times| handle_stiffness(&block_scene([2, 2, 2], &format!("refine = {times}"))))
        .collect();
    let size = s[3].amax();
    let mut steps = Vec::new();
    for pair in s.windows(2) {
        let difference = &pair[0] - &pair[1];
        let eigenvalues = difference.clone().symmetric_eigenvalues();
        assert!(eigenvalues.min() > -1e-12 * size, "{:e}", eigenvalues.min() / size);
        steps.push(eigenvalues.max());
    }
    let rates: Vec<f64> = steps.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect();
    println!("steps of the largest eigenvalue {steps:.4?} N/m, rates {rates:.2?}");
    // The held faces end in edges where the stress is infinite: less than the 2 of a smooth solution.
    assert!(rates.iter().all(|rate| (1.0..2.1).contains(rate)), "{rates:?}");
    let eight = handle_stiffness(&block_scene([8, 8, 8], ""));
    let apart = (&s[2] - &eight).amax() / eight.amax();
    println!("refined twice from 2³ cells against 8³ cells: {apart:.1e}");
    assert!(apart < 0.02, "{apart:e}");
}

#[test]
fn a_scene_says_what_was_refined_or_refuses() {
    let prepared = green::prepare(&block_scene([2, 2, 2], "refine = 2"), "block").unwrap();
    let said: Vec<String> = prepared.findings.iter().map(|finding| finding.to_string()).collect();
    let expected = "note: body.block: refined 2 times: 40 tetrahedra became 2560, with 649 nodes";
    assert!(said.iter().any(|line| line == expected), "{said:?}");

    let many = scene(
        "[body.block]\ngenerate = { block = { size = [1.0, 1.0, 1.0], cells = [20, 20, 20] } }\nrefine = 4\n\
         material = { young = 1.0, poisson = 0.3 }\n\
         [body.block.control.low]\nnodes = { group = \"xmin\" }\ngrab = \"fixed\"\n",
    );
    let error = green::prepare(&many, "block").err().unwrap().to_string();
    assert!(error.contains("body.block.refine: 40000 tetrahedra refined 4 times are 163840000"), "{error}");
    let (once, twice) = (block_scene([2, 2, 2], "refine = 1"), block_scene([2, 2, 2], "refine = 2"));
    let print = |scene: &Scene| green::fingerprint(scene, "block", &Requirements::new(&[AFFINE])).unwrap();
    assert_ne!(print(&once), print(&twice));
}
