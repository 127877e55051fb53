//! Isosurface stuffing: the dihedral angles that its authors prove, conforming meshes, volume and distance that
//! converge, and what is refused.

use crate::common::euler_characteristic_of_closed;
use greenstage::mesh::isosurface_stuffing::core::{ALPHA_LONG, ALPHA_SHORT, stuff};
use greenstage::mesh::isosurface_stuffing::lattice::Lattice;
use greenstage::mesh::isosurface_stuffing::tetrahedralise;
use greenstage::mesh::surface_check::check;
use greenstage::mesh::surface_files::TriangleSurface;
use greenstage::mesh::{Surface, TetMesh, quality};
use nalgebra::{Rotation3, Vector3};
use std::collections::BTreeMap;

/// Labelle and Shewchuk, Isosurface stuffing (SIGGRAPH 2007), abstract: "dihedral angles are bounded between 10.7° and
/// 164.8°".
const LEAST: f64 = 10.7;
const GREATEST: f64 = 164.8;

/// Least and greatest dihedral angle in degrees.
fn dihedral_angles(nodes: &[Vector3<f64>], tets: &[[u32; 4]]) -> (f64, f64) {
    const EDGES: [[usize; 4]; 6] =
        [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 0, 2], [2, 3, 0, 1]];
    let mut range = (f64::INFINITY, 0.0f64);
    for tet in tets {
        let x = tet.map(|node| nodes[node as usize]);
        for [i, j, k, l] in EDGES {
            let along = (x[j] - x[i]).normalize();
            let across = |p: Vector3<f64>| (p - x[i]) - along * along.dot(&(p - x[i]));
            let angle = across(x[k]).angle(&across(x[l])).to_degrees();
            range = (range.0.min(angle), range.1.max(angle));
        }
    }
    range
}

/// A number in [0, 1) from integers, the same on every machine.
fn noise(key: &[i64]) -> f64 {
    let mut hasher = blake3::Hasher::new();
    for part in key {
        hasher.update(&part.to_le_bytes());
    }
    let first = hasher.finalize().as_bytes()[..8].try_into().unwrap();
    (u64::from_le_bytes(first) >> 11) as f64 / (1u64 << 53) as f64
}

/// The bounds hold for any signs and any cut points, which no surface could have: the proof takes nothing else.
#[test]
fn no_signs_and_no_cut_points_break_the_angles() {
    let (mut least, mut greatest) = (180.0f64, 0.0f64);
    for seed in 0..24 {
        let lattice = Lattice { origin: Vector3::zeros(), cell: 1.0, cubes: [14; 3] };
        let share = [0.5, 0.3, 0.8][seed as usize % 3];
        let depth: Vec<f64> = (0..lattice.vertices())
            .map(|v| if noise(&[seed, v as i64]) < share { 1.0 } else { -1.0 })
            .collect();
        let cut = |from: [i64; 3], to: [i64; 3]| {
            let t = noise(&[seed, 7, from[0], from[1], from[2], to[0], to[1], to[2]]);
            // Some just beyond the reach of a warp, where the extremes are.
            let is_long = (from[0] - to[0]) % 2 == 0;
            let alpha = if is_long { ALPHA_LONG } else { ALPHA_SHORT };
            match noise(&[seed, 8, from[0], from[1], from[2], to[0], to[1], to[2]]) {
                x if x < 0.25 => alpha + 1e-9,
                x if x < 0.5 => 1.0 - alpha - 1e-9,
                x if x < 0.6 => alpha - 1e-9,
                x if x < 0.7 => 1.0 - alpha + 1e-9,
                _ => t,
            }
        };
        let (nodes, tets) = stuff(&lattice, &depth, cut);
        let (low, high) = dihedral_angles(&nodes, &tets);
        println!("seed {seed}: {} tetrahedra, {low:.4}° to {high:.4}°", tets.len());
        (least, greatest) = (least.min(low), greatest.max(high));
    }
    assert!(least >= LEAST && greatest <= GREATEST, "{least}° to {greatest}°");
}

fn surface(vertices: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>) -> TriangleSurface {
    TriangleSurface { vertices, triangles }
}

/// A box about the origin.
fn cuboid(size: [f64; 3]) -> TriangleSurface {
    let corner = |i: usize| Vector3::from_fn(|axis, _| size[axis] * ((i >> axis & 1) as f64 - 0.5));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    surface((0..8).map(corner).collect(), triangles)
}

/// Closed grid in two angles; `at` gives the place. Rows j = 0 and j = m are poles where `poles`.
fn torus(major: f64, minor: f64, n: u32, m: u32) -> TriangleSurface {
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let (s, c) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
            let (t, d) = (std::f64::consts::TAU * f64::from(j) / f64::from(m)).sin_cos();
            let r = major + minor * d;
            vertices.push(Vector3::new(r * c, r * s, minor * t));
            let at = |i: u32, j: u32| (i % n) * m + j % m;
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    surface(vertices, triangles)
}

/// An octahedron of which every triangle is cut in four, `times` times, on the sphere of this radius.
fn sphere(radius: f64, times: u32) -> TriangleSurface {
    let mut vertices: Vec<Vector3<f64>> =
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
            .map(|v: [i32; 3]| Vector3::from(v.map(f64::from)))
            .to_vec();
    let mut triangles: Vec<[u32; 3]> =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..times {
        let mut middles: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let mut middle = |p: u32, q: u32| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    vertices.push((vertices[p as usize] + vertices[q as usize]).normalize());
                    vertices.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    surface(vertices.iter().map(|v| v * radius).collect(), triangles)
}

fn fill(mut surface: TriangleSurface, cell: f64) -> (TetMesh, Vec<String>) {
    let mut notices = Vec::new();
    let report = check(&mut surface, &mut notices);
    assert!(report.faults().is_empty(), "{:?}", report.faults());
    let mesh = tetrahedralise(&surface, &report, cell, &mut notices).unwrap();
    (mesh, notices)
}

/// Every face belongs to one or two tetrahedra, and every edge of the surface to two triangles of opposite direction.
fn assert_conforming(mesh: &TetMesh) {
    assert!(quality::overlapping_faces(mesh).is_empty());
    assert!(mesh.tets.iter().enumerate().all(|(t, _)| quality::signed_volume(&mesh.corners(t)) > 0.0));
    euler_characteristic_of_closed(&Surface::from_mesh(mesh));
}

#[test]
fn shapes_have_the_angles_and_conform() {
    let turned = |mut surface: TriangleSurface| {
        let turn = Rotation3::from_euler_angles(0.3, 0.7, 1.1);
        surface.vertices.iter_mut().for_each(|v| *v = turn * *v + Vector3::new(10.0, -3.0, 0.1));
        surface
    };
    let shapes = [
        ("sphere", sphere(1.0, 4), 0.13),
        ("cube", cuboid([1.0; 3]), 0.09),
        ("cube of whole cells", cuboid([1.0; 3]), 0.125),
        ("torus", torus(1.0, 0.3, 60, 24), 0.08),
        ("turned box", turned(cuboid([1.0, 0.5, 0.3])), 0.06),
    ];
    for (name, shape, cell) in shapes {
        let (mesh, notices) = fill(shape.clone(), cell);
        let (least, greatest) = dihedral_angles(&mesh.nodes, &mesh.tets);
        println!("{name}: {} tetrahedra, {least:.2}° to {greatest:.2}°\n  {notices:?}", mesh.tets.len());
        assert!(least >= LEAST && greatest <= GREATEST, "{name}: {least}° to {greatest}°");
        assert_conforming(&mesh);
        assert_eq!(quality::components(&mesh).nodes.len(), 1, "{name}");
    }
}

#[test]
fn volume_converges_with_the_square_of_the_cell_and_nodes_lie_on_the_sphere() {
    let exact = sphere(1.0, 6);
    let inside = check(&mut exact.clone(), &mut Vec::new()).volume;
    let mut points = Vec::new();
    for cell in [0.4, 0.3, 0.2, 0.15, 0.1, 0.075] {
        let (mesh, _) = fill(exact.clone(), cell);
        let boundary = Surface::from_mesh(&mesh);
        // The surface itself is a polyhedron, 2·10⁻⁴ short of the sphere at most.
        let off = |x: &Vector3<f64>| (x.norm() - 1.0).abs();
        let furthest = boundary.nodes.iter().map(|&n| off(&mesh.nodes[n as usize])).fold(0.0, f64::max);
        assert!(furthest < 4e-4, "cell {cell}: a node is {furthest} m off the sphere");
        // Hausdorff distance the other way: the sagitta of an edge no longer than 1.6 cells.
        let middle = |t: &[u32; 3]| {
            t.iter().map(|&n| mesh.nodes[boundary.nodes[n as usize] as usize]).sum::<Vector3<f64>>() / 3.0
        };
        let deepest = boundary.triangles.iter().map(|t| off(&middle(t))).fold(0.0, f64::max);
        assert!(deepest < 0.35 * cell * cell, "cell {cell}: a triangle is {deepest} m off the sphere");
        points.push((f64::ln(cell), (inside - boundary.volume(&mesh)).ln()));
    }
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let rate = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
        / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
    println!("fitted rate {rate:.3} of {points:?}");
    assert!((rate - 2.0).abs() < 0.2, "{rate}");
}

#[test]
fn a_box_whose_faces_are_lattice_planes_keeps_its_volume() {
    // Corner to corner the lattice about a box of whole cells is the box's own.
    let (mesh, notices) = fill(cuboid([1.0, 0.5, 0.5]), 0.125);
    let volume = Surface::from_mesh(&mesh).volume(&mesh);
    assert!((volume / 0.25 - 1.0).abs() < 1e-12, "{volume} {notices:?}");
}

#[test]
fn the_same_mesh_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fill(torus(1.0, 0.3, 30, 12), 0.1))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn what_is_lost_is_told() {
    // A plate with a needle that no cell can hold.
    let mut shape = cuboid([1.0, 1.0, 0.3]);
    let base = shape.vertices.len() as u32;
    let needle = [[0.05, 0.05, 0.149], [-0.05, 0.05, 0.149], [0.0, -0.05, 0.149], [0.0, 0.0, 0.9]];
    shape.vertices.extend(needle.map(Vector3::from));
    shape
        .triangles
        .extend([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|t: [u32; 3]| t.map(|v| v + base)));
    let mut notices = Vec::new();
    let report = check(&mut shape, &mut notices);
    assert!(report.intersections.pairs > 0, "the needle passes through the plate's top");
    let mesh = tetrahedralise(&shape, &report, 0.15, &mut notices).unwrap();
    let all = notices.join("\n");
    assert!(all.contains("passes through itself") && all.contains("fine features are lost"), "{all}");
    assert!(!mesh.tets.is_empty());
}

#[test]
fn what_cannot_be_filled_is_refused_with_a_remedy() {
    let refused = |mut shape: TriangleSurface, cell: f64| {
        let report = check(&mut shape, &mut Vec::new());
        tetrahedralise(&shape, &report, cell, &mut Vec::new()).unwrap_err()
    };
    let mut open = cuboid([1.0; 3]);
    open.triangles.drain(2..4);
    let text = refused(open, 0.1);
    assert!(text.contains("1 hole:") && text.contains("near (0.000000, 0.000000, 0.500000)"), "{text}");
    let text = refused(cuboid([1.0, 1.0, 0.1]), 0.2);
    assert!(text.contains("larger than the body") && text.contains("take cell = 3.3e-2 or less"), "{text}");
    let text = refused(cuboid([1.0; 3]), 0.005);
    assert!(text.contains("9.6e7 tetrahedra"), "{text}");
    for cell in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300] {
        refused(cuboid([1.0; 3]), cell);
    }
    // Two bodies that overlap.
    let (mut both, other) = (cuboid([1.0; 3]), cuboid([0.5, 0.5, 2.0]));
    both.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + 8)));
    both.vertices.extend(other.vertices);
    assert!(refused(both, 0.06).contains("the surface overlaps itself"));
    // Flat: no volume.
    refused(
        surface(
            [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Vector3::from).to_vec(),
            vec![[0, 1, 2], [0, 2, 1]],
        ),
        0.1,
    );
}

#[test]
fn neither_the_unit_nor_the_place_matters() {
    // Turned, so that no lattice vertex lies on it and rounding decides nothing.
    let mut shape = torus(1.0, 0.3, 30, 12);
    shape.vertices.iter_mut().for_each(|v| *v = Rotation3::from_euler_angles(0.3, 0.7, 1.1) * *v);
    let (mesh, _) = fill(shape.clone(), 0.1);
    let volume = Surface::from_mesh(&mesh).volume(&mesh);
    for (scale, shift) in [(1e-9, 0.0), (1e3, 0.0), (1.0, 1e6)] {
        let mut moved = shape.clone();
        moved.vertices.iter_mut().for_each(|v| *v = *v * scale + Vector3::repeat(shift));
        let (same, _) = fill(moved, 0.1 * scale);
        let got = Surface::from_mesh(&same).volume(&same) / scale.powi(3);
        assert!((got / volume - 1.0).abs() < 1e-6, "× {scale} + {shift}: {got} against {volume}");
        let (least, greatest) = dihedral_angles(&same.nodes, &same.tets);
        assert!(least >= LEAST && greatest <= GREATEST, "{least}° to {greatest}°");
    }
}
