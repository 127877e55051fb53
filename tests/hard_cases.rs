//! Hard cases: bodies, materials, units and control elements on which a solver can go wrong in silence.
//!
//! Each case is built, and is solved to the stated accuracy, solved with a warning, or refused with the entity and the
//! remedy. Measured errors are printed: `cargo test --release --test hard_cases -- --nocapture`.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod common;

use common::folder;
use greenstage::fem::{NodeFields, assemble};
use greenstage::green::{self, FIELDS, Finding, GreenError, Needs, Severity, Solution};
use greenstage::mesh::{self, TetMesh, generate};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::Vector3;
use std::path::{Path, PathBuf};

const HAPTICS: Needs = Needs { stiffness: true };

/// The base case: a block of 1 × 1 × 2 m, 5 × 5 × 10 cells, held at both ends of z.
fn base() -> TetMesh {
    generate::block(&generate::Block { size: [1.0, 1.0, 2.0], cells: [5, 5, 10] }).unwrap()
}

/// A scene of `mesh` with control elements at zmin and zmax, and what else `extra` says of the body.
fn scene_of(name: &str, mesh: &TetMesh, extra: &str, controls: &str) -> Scene {
    let folder: PathBuf = folder(&format!("hard-{name}"));
    mesh::save(&folder.join("body.msh"), mesh, Some("msh41-binary")).unwrap();
    let text = format!(
        "[body.b]\nmesh = \"body.msh\"\n{}{controls}",
        if extra.contains("material") {
            extra.to_owned()
        } else {
            format!("material = {{ young = 1.0e6, poisson = 0.3 }}\n{extra}")
        }
    );
    Scene::parse(&text, &folder.join("scene.toml")).unwrap()
}

const ENDS: &str = r#"
[body.b.control.low]
nodes = { group = "zmin" }
grab = "fixed"
[body.b.control.high]
nodes = { group = "zmax" }
grab = "dragger"
"#;

fn solve(scene: &Scene) -> Result<Solution, GreenError> {
    green::solve(scene, "b", HAPTICS, &Silent)
}

fn findings(scene: &Scene) -> Vec<Finding> {
    green::prepare(scene, "b").unwrap().findings
}

fn has(findings: &[Finding], severity: Severity, part: &str) -> bool {
    findings.iter().any(|finding| finding.severity == severity && finding.message.contains(part))
}

fn refused(scene: &Scene, part: &str) {
    let error = solve(scene).err().expect("this body must be refused").to_string();
    assert!(error.contains(part), "{part:?} is missing in: {error}");
}

/// Worst relative difference of two solutions' fields, column by column, each against its own norm.
fn difference(a: &Solution, b: &Solution, scale: impl Fn(usize) -> f64) -> f64 {
    assert_eq!(a.fields.columns, b.fields.columns);
    let columns = a.fields.columns;
    let column = |s: &Solution, c: usize| -> Vec<f64> {
        (0..3 * s.mesh.nodes.len()).map(|row| s.fields.row(row)[c]).collect()
    };
    (0..columns)
        .map(|c| {
            let (a, b) = (column(a, c), column(b, c));
            let error: f64 = a.iter().zip(&b).map(|(a, b)| (a * scale(c) - b).powi(2)).sum();
            let norm: f64 = b.iter().map(|b| b * b).sum();
            if norm == 0.0 { 0.0 } else { (error / norm).sqrt() }
        })
        .fold(0.0, f64::max)
}

/// Relative error of a pure stretch and a twist against the solution of a second solver: conjugate gradients at 1e-13.
fn against_pcg(name: &str, mesh: &TetMesh, extra: &str) -> f64 {
    let cholesky = solve(&scene_of(name, mesh, extra, ENDS)).unwrap();
    let other =
        format!("{extra}solver = {{ method = \"pcg\", tolerance = 1e-13, max_iterations = 100000 }}\n");
    let pcg = solve(&scene_of(&format!("{name}-pcg"), mesh, &other, ENDS)).unwrap();
    difference(&pcg, &cholesky, |_| 1.0)
}

/// The same mesh with its nodes and tetrahedra numbered backwards: another ordering, other rounding, the same answer.
fn backwards(mesh: &TetMesh) -> TetMesh {
    let last = mesh.nodes.len() as u32 - 1;
    let turn = |node: &u32| last - node;
    TetMesh {
        nodes: mesh.nodes.iter().rev().copied().collect(),
        tets: mesh.tets.iter().rev().map(|[a, b, c, d]| [turn(b), turn(a), turn(d), turn(c)]).collect(),
        regions: mesh.regions.iter().rev().copied().collect(),
        groups: mesh.groups.iter().map(|(n, g)| (n.clone(), g.iter().rev().map(turn).collect())).collect(),
        ..mesh.clone()
    }
}

/// Relative difference of the handle stiffness of a mesh and of the same mesh numbered backwards.
fn against_backwards(name: &str, extra: &str) -> f64 {
    let forward = solve(&scene_of(name, &base(), extra, ENDS)).unwrap();
    let backward = solve(&scene_of(&format!("{name}-back"), &backwards(&base()), extra, ENDS)).unwrap();
    let (a, b) = (forward.stiffness.unwrap(), backward.stiffness.unwrap());
    (&a - &b).amax() / a.amax()
}

/// Cases 1, 2 and 4: Poisson's ratio from -0.99 to 0.499999. Harmless below 0.45; above, solved, with a warning.
#[test]
fn poissons_ratio() {
    for (poisson, limit, warned) in [
        (0.3, 4e-14, false),
        (-0.5, 8e-14, false),
        (-0.99, 1e-13, false),
        (0.49, 2.5e-13, true),
        (0.499999, 1e-9, true),
    ] {
        let extra = format!("material = {{ young = 1.0e6, poisson = {poisson} }}\n");
        let name = format!("poisson{poisson}");
        let error = against_backwards(&name, &extra);
        let scene = scene_of(&name, &base(), &extra, ENDS);
        println!("case 2  ν = {poisson}: against another ordering {error:.1e}");
        assert!(error < limit, "{poisson}: {error:e}");
        assert_eq!(has(&findings(&scene), Severity::Warning, "lock"), warned, "{poisson}");
    }
}

/// Case 3: ν = 0.5, above, and -1: refused when the scene is read.
#[test]
fn impossible_poissons_ratios_are_refused() {
    for poisson in ["0.5", "0.51", "-1.0", "nan", "inf"] {
        let text =
            format!("[body.b]\nmesh = \"b.msh\"\nmaterial = {{ young = 1.0, poisson = {poisson} }}\n{ENDS}");
        let error = Scene::parse(&text, Path::new("scene.toml")).unwrap_err().to_string();
        assert!(error.contains("body.b.material") && error.contains("Poisson"), "{error}");
    }
}

fn with_region(mut mesh: TetMesh, inside: impl Fn(&Vector3<f64>) -> bool) -> TetMesh {
    for tet in 0..mesh.tets.len() {
        let centre: Vector3<f64> = mesh.corners(tet).iter().sum::<Vector3<f64>>() / 4.0;
        mesh.regions[tet] = if inside(&centre) { 2 } else { 1 };
    }
    mesh
}

/// Cases 5 and 7: any contrast where the stiff part is held, and soft inclusions: solved. The reference is the limit
/// of a rigid half, whose own motion is that of its control element.
#[test]
fn contrast_of_a_held_half_and_soft_inclusions() {
    let half = with_region(base(), |x| x.z > 0.0);
    for contrast in [1e2, 1e6, 1e10, 1e14] {
        let extra = format!("region.2 = {{ young = {:e}, poisson = 0.3 }}\n", 1e6 * contrast);
        let scene = scene_of(&format!("contrast{contrast:e}"), &half, &extra, ENDS);
        let solution = solve(&scene).unwrap();
        // An upper half that is stiff by `contrast` follows its control element up to 1/contrast.
        let control = &solution.controls[1];
        let mut worst = 0.0f64;
        for (node, x) in solution.mesh.nodes.iter().enumerate().filter(|(_, x)| x.z > 1e-9) {
            let affine = [x - control.origin, Vector3::repeat(1.0)];
            let u = solution.fields.row(3 * node)[FIELDS];
            worst = worst.max((u - affine[1].x).abs());
        }
        println!("case 5  contrast {contrast:.0e}: stiff half follows its control element to {worst:.1e}");
        assert!(worst < 3.0 / contrast + 1e-13, "{contrast:e}: {worst:e}");
        assert!(!findings(&scene).iter().any(|finding| finding.severity < Severity::Note));
    }
    let inclusion = with_region(base(), |x| x.norm() < 0.35);
    for contrast in [1e-4, 1e-12] {
        let extra = format!("region.2 = {{ young = {:e}, poisson = 0.3 }}\n", 1e6 * contrast);
        let error = against_pcg(&format!("soft{contrast:e}"), &inclusion, &extra);
        println!("case 7  soft inclusion {contrast:.0e}: Cholesky against PCG {error:.1e}");
        assert!(error < 2e-13, "{contrast:e}: {error:e}");
    }
}

/// Case 6: a stiff inclusion that floats. Its six rigid motions are lost in rounding as the contrast grows: solved at
/// 1e4, warned of above 1e8, refused above 1e12. The measure: a free rigid inclusion carries no net force or moment.
#[test]
fn floating_stiff_inclusion() {
    let inclusion = with_region(base(), |x| x.norm() < 0.35);
    let scene = |contrast: f64| {
        let extra = format!("region.2 = {{ young = {:e}, poisson = 0.3 }}\n", 1e6 * contrast);
        scene_of(&format!("floating{contrast:e}"), &inclusion, &extra, ENDS)
    };
    let reference = solve(&scene(1e4)).unwrap();
    for (contrast, limit) in [(1e5, 5e-4), (1e8, 5e-4), (1e10, 5e-4)] {
        let solution = solve(&scene(contrast)).unwrap();
        let error = difference(&solution, &reference, |_| 1.0);
        println!(
            "case 6  floating inclusion {contrast:.0e}: against contrast 1e4 {error:.1e}, residual {:.1e}",
            solution.stats.worst_residual()
        );
        assert!(error < limit, "{contrast:e}: {error:e}");
    }
    assert!(!has(&findings(&scene(1e8)), Severity::Warning, "floats"));
    assert!(has(&findings(&scene(1e10)), Severity::Warning, "floats"));
    refused(&scene(1e13), "region 2 floats");
}

/// Case 8: a node moved until its tetrahedra are slivers: solved, the answer elsewhere changes little, and they are
/// named. Case 9: no volume at all: refused.
#[test]
fn slivers_are_named_and_flat_tetrahedra_refused() {
    let squeezed = |height: f64| {
        let mut mesh = base();
        // Towards the plane of the opposite face of one tetrahedron, inside its own ball of neighbours.
        let tet = (0..mesh.tets.len())
            .find(|&t| mesh.tets[t].iter().all(|&n| mesh.nodes[n as usize].norm() < 0.6))
            .unwrap();
        let [a, b, c, d] = mesh.tets[tet].map(|node| node as usize);
        let (p, q, r) = (mesh.nodes[b], mesh.nodes[c], mesh.nodes[d]);
        let normal = (q - p).cross(&(r - p)).normalize();
        let distance = (mesh.nodes[a] - p).dot(&normal);
        mesh.nodes[a] -= normal * (distance * (1.0 - height));
        mesh
    };
    let reference = solve(&scene_of("sliver1", &base(), "", ENDS)).unwrap();
    for height in [1e-2, 1e-4, 1e-6] {
        let scene = scene_of(&format!("sliver{height:e}"), &squeezed(height), "", ENDS);
        let solution = solve(&scene).unwrap();
        let s = (solution.stiffness.as_ref().unwrap() - reference.stiffness.as_ref().unwrap()).amax();
        let change = s / reference.stiffness.as_ref().unwrap().amax();
        println!(
            "case 8  sliver of height {height:.0e}: handle stiffness changes by {change:.1e}, residual {:.1e}",
            solution.stats.worst_residual()
        );
        assert!(change < 5e-4 && solution.stats.worst_residual() < 4e-10);
        assert_eq!(has(&findings(&scene), Severity::Warning, "slivers"), height < 1e-3);
    }
    refused(&scene_of("flat", &squeezed(0.0), "", ENDS), "no volume");
}

/// Case 10: swapped orientation is repaired with a notice; case 11: a node pushed through its neighbours is refused.
#[test]
fn swapped_tetrahedra_are_turned_and_inverted_ones_refused() {
    let mut swapped = base();
    for tet in [3, 100, 700] {
        swapped.tets[tet].swap(0, 1);
    }
    let scene = scene_of("swapped", &swapped, "", ENDS);
    let reference = solve(&scene_of("unswapped", &base(), "", ENDS)).unwrap();
    let solution = solve(&scene).unwrap();
    assert!(difference(&solution, &reference, |_| 1.0) < 1e-13);
    assert!(findings(&scene).iter().any(|f| f.severity == Severity::Note && f.message.contains('3')));

    for push in [0.45, 0.8] {
        let mut inverted = base();
        let node =
            inverted.nodes.iter().position(|x| (x - Vector3::new(0.1, 0.1, 0.0)).norm() < 1e-9).unwrap();
        inverted.nodes[node].x += push;
        refused(&scene_of(&format!("inverted{push}"), &inverted, "", ENDS), "folded");
    }
}

/// Cases 12, 14 and 16: what floats, or hangs on an edge or a node alone, is refused by name.
#[test]
fn what_is_not_held_is_refused() {
    let joined = |shift: Vector3<f64>, merge: bool| {
        let mut mesh = base();
        let (count, tag) = (mesh.nodes.len() as u32, mesh.nodes.len() as u64);
        let other = generate::block(&generate::Block { size: [1.0; 3], cells: [5, 5, 5] }).unwrap();
        let mut index = Vec::new();
        for x in &other.nodes {
            let place = x + shift;
            let same = mesh.nodes[..count as usize].iter().position(|y| (y - place).norm() < 1e-9);
            match same.filter(|_| merge) {
                Some(node) => index.push(node as u32),
                None => {
                    index.push(mesh.nodes.len() as u32);
                    mesh.nodes.push(place);
                }
            }
        }
        mesh.tags = (1..=mesh.nodes.len() as u64).collect();
        assert!(tag > 0);
        mesh.tets.extend(other.tets.iter().map(|tet| tet.map(|node| index[node as usize])));
        mesh.regions.resize(mesh.tets.len(), 0);
        mesh
    };
    refused(&scene_of("floating", &joined(Vector3::new(3.0, 0.0, 0.0), false), "", ENDS), "piece 2 of 2");
    refused(
        &scene_of("edge", &joined(Vector3::new(1.0, 1.0, 0.5), true), "", ENDS),
        "join it to the rest by shared faces",
    );
    refused(
        &scene_of("corner", &joined(Vector3::new(1.0, 1.0, 1.5), true), "", ENDS),
        "held at a single node",
    );
}

/// Case 13: a layer of nodes that was never merged: solved, cracked open, and warned of with the place.
#[test]
fn a_layer_that_was_not_merged_is_warned_of() {
    let mut mesh = generate::block(&generate::Block { size: [1.0; 3], cells: [4, 4, 4] }).unwrap();
    let upper = mesh.clone();
    let count = mesh.nodes.len();
    mesh.nodes.extend(upper.nodes.iter().map(|x| x + Vector3::new(0.0, 0.0, 1.0)));
    mesh.tags = (1..=mesh.nodes.len() as u64).collect();
    mesh.tets.extend(upper.tets.iter().map(|tet| tet.map(|node| node + count as u32)));
    mesh.regions.resize(mesh.tets.len(), 0);
    mesh.groups = [
        ("zmin".to_owned(), upper.groups["zmin"].clone()),
        ("zmax".to_owned(), upper.groups["zmax"].iter().map(|node| node + count as u32).collect()),
    ]
    .into();
    let scene = scene_of("cracked", &mesh, "", ENDS);
    assert!(has(&findings(&scene), Severity::Warning, "25 pairs of nodes lie at the same place"));
    let solution = solve(&scene).unwrap();
    assert!(solution.notices[0].starts_with("warning: body.b: 25 pairs"), "{:?}", solution.notices);
}

/// Cases 17, 18 and 20: one node, two, three on a line, a triangle; planar control elements; all nodes held.
#[test]
fn few_and_flat_supports() {
    let only = |name: &str, nodes: &str| {
        scene_of(name, &base(), "", &format!("\n[body.b.control.c]\nnodes = {nodes}\ngrab = \"fixed\"\n"))
    };
    let corner = "{ box = { min = [-0.6, -0.6, -1.1], max = [-0.4, -0.4, -0.9] } }";
    refused(&only("one-node", corner), "single node");
    let edge = "{ box = { min = [-0.6, -0.6, -1.1], max = [-0.4, 0.6, -0.9] } }";
    refused(&only("line", edge), "6 nodes on one line");
    let triangle = "{ sphere = { centre = [-0.5, -0.5, -1.0], radius = 0.21 } }";
    let solution = solve(&only("triangle", triangle)).unwrap();
    println!(
        "case 17 held at {} nodes of a corner: residual {:.1e}",
        solution.controls[0].nodes.len(),
        solution.stats.worst_residual()
    );
    assert!(solution.stats.worst_residual() < 1e-12);

    let planar = solve(&scene_of("planar", &base(), "", ENDS)).unwrap();
    assert!(planar.controls.iter().all(|control| control.rank == 2 && control.independent_fields() == 9));

    let all = "{ box = { min = [-9.0, -9.0, -9.0], max = [9.0, 9.0, 9.0] } }";
    let solution = solve(&only("all", all)).unwrap();
    let tx: Vec<f64> = (0..solution.mesh.nodes.len()).map(|node| solution.fields.row(3 * node)[0]).collect();
    assert!(tx.iter().all(|u| *u == 1.0), "every node moves as it is told");
}

/// Case 21: the same body in nanometres, millimetres, metres and megametres; case 22: moved away from its origin.
#[test]
fn units_and_places_do_not_matter() {
    let scaled = |unit: f64, offset: f64| {
        let mut mesh = base();
        for x in &mut mesh.nodes {
            *x = *x * unit + Vector3::repeat(offset);
        }
        mesh
    };
    let reference = solve(&scene_of("unit1", &base(), "", ENDS)).unwrap();
    for unit in [1e-9, 1e-3, 1e6] {
        let solution = solve(&scene_of(&format!("unit{unit:e}"), &scaled(unit, 0.0), "", ENDS)).unwrap();
        // Fields of T keep their numbers, fields of M are lengths.
        let scale = |c: usize| if c % FIELDS < 3 { 1.0 } else { 1.0 / unit };
        let error = difference(&solution, &reference, scale);
        println!("case 21 unit {unit:.0e} m: {error:.1e}");
        assert!(error < 1e-13, "{unit:e}: {error:e}");
    }
    for (offset, limit) in [(1e3, 1e-12), (1e6, 1e-9), (1e9, 1e-6)] {
        let scene = scene_of(&format!("offset{offset:e}"), &scaled(1.0, offset), "", ENDS);
        let error = difference(&solve(&scene).unwrap(), &reference, |_| 1.0);
        println!("case 22 moved by {offset:.0e} m: {error:.1e}");
        assert!(error < limit, "{offset:e}: {error:e}");
        assert_eq!(has(&findings(&scene), Severity::Warning, "digits left"), offset > 1e8);
    }
}

/// The factor is right only if the answer is in equilibrium: no force on any free node, whatever the material.
#[test]
fn free_nodes_are_in_equilibrium() {
    let solution = solve(&scene_of("equilibrium", &base(), "", ENDS)).unwrap();
    let lame = greenstage::fem::Lame::from_young_poisson(1e6, 0.3);
    let k = assemble(&solution.mesh, &vec![lame; solution.mesh.tets.len()]).unwrap();
    let mut force = NodeFields::zeros(solution.mesh.nodes.len(), solution.fields.columns);
    k.multiply(&solution.fields, &mut force);
    let largest = force.data.iter().fold(0.0f64, |m, f| m.max(f.abs()));
    for (node, x) in solution.mesh.nodes.iter().enumerate().filter(|(_, x)| x.z.abs() < 1.0 - 1e-9) {
        for axis in 0..3 {
            let worst = force.row(3 * node + axis).iter().fold(0.0f64, |m, f| m.max(f.abs()));
            assert!(worst < 1e-13 * largest, "node at {x:?}: {worst:e} of {largest:e}");
        }
    }
}
