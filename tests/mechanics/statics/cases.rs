//! Static equilibria against independently computed ones.

use super::law;
use crate::common::{case_poses, csv_rows, shared};
use greenstage::deform::{ControlPose, ControlPoses, Statics};
use greenstage::fem::{Hyperelastic, LAWS, Lame, NodeFields, TET4};
use greenstage::mesh::TetMesh;
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// A case of ../shared: its body, and the poses of its file.
fn case(folder: &Path) -> (Statics, Vec<(String, ControlPoses)>) {
    let scene = Scene::load(&folder.join("scene.toml")).unwrap();
    let (name, body) = scene.body.first().unwrap();
    let statics = Statics::new(&scene, name, law(&body.model), &Silent).unwrap();
    let rest = ControlPose::REST;
    let of = |(pose, named): (String, BTreeMap<String, ControlPose>)| {
        (pose, body.control.keys().map(|name| *named.get(name).unwrap_or(&rest)).collect())
    };
    (statics, case_poses(folder).into_iter().map(of).collect())
}

/// Solves the case pose by pose and compares every node; worst relative differences of displacements (L2), energy, and
/// force on the control element that moves.
fn compare(name: &str) -> Option<[f64; 3]> {
    let folder = shared(&format!("cases/{name}"))?;
    let (mut statics, poses) = case(&folder);
    let expected = csv_rows(&folder.join("expected.csv"), 1);
    let energies: BTreeMap<_, _> = csv_rows(&folder.join("expected.energy.csv"), 1).into_iter().collect();
    println!("{name}: {} nodes, {} tetrahedra", statics.mesh.nodes.len(), statics.mesh.tets.len());
    println!(
        "  pose       displacement   energy    force   residual  steps factorizations  least det F  seconds"
    );
    let mut worst = [0.0f64; 3];
    for (pose, control) in &poses {
        let started = Instant::now();
        let settled = statics.solve(control, &Silent).unwrap();
        let seconds = started.elapsed().as_secs_f64();
        let by_tag: BTreeMap<u64, Vector3<f64>> =
            statics.mesh.tags.iter().copied().zip(settled.displacement.iter().copied()).collect();
        let wanted: Vec<&Vec<f64>> =
            expected.iter().filter(|(of, _)| of == pose).map(|(_, row)| row).collect();
        assert_eq!(wanted.len(), statics.mesh.nodes.len(), "every node is compared");
        let square = |of: &dyn Fn(&Vec<f64>) -> Vector3<f64>| -> f64 {
            wanted.iter().map(|row| of(row).norm_squared()).sum()
        };
        let u = |row: &Vec<f64>| Vector3::from_column_slice(&row[1..]);
        let off = square(&|row| by_tag[&(row[0] as u64)] - u(row));
        let moved = control.iter().position(|pose| *pose != ControlPose::REST).unwrap();
        let (energy, force) = (energies[pose][0], Vector3::from_column_slice(&energies[pose][1..]));
        let found = [
            (off / square(&u)).sqrt(),
            (settled.energy / energy - 1.0).abs(),
            (settled.wrenches[moved].force - force).norm() / force.norm(),
        ];
        println!(
            "  {pose:<10} {:12.1e} {:8.1e} {:8.1e} {:10.1e} {:6} {:14} {:12.4} {seconds:8.2}",
            found[0],
            found[1],
            found[2],
            settled.residual,
            settled.counts.steps,
            settled.counts.factorizations,
            settled.least_det.0
        );
        (0..3).for_each(|i| worst[i] = worst[i].max(found[i]));
    }
    Some(worst)
}

/// The independent forces are worse than the rest: in beam_stvk they balance to 1e-10 only, ours to 1e-12.
#[test]
fn every_law_matches_the_independent_solutions() {
    for name in ["tube_stvk", "beam_stvk", "beam_neo_hookean", "beam_corotational"] {
        let Some(worst) = compare(name) else { continue };
        assert!(worst[0] < 1e-12 && worst[1] < 1e-12 && worst[2] < 1e-8, "{name}: {worst:?}");
    }
}

/// Moments about the moved origin as NumPy computed them.
#[test]
fn end_moments_match_the_independent_ones() {
    for (name, moments) in [
        (
            "beam_stvk",
            [
                ("bend60", [11.641103834434302, -0.6218543505118679, -0.47407086185129194]),
                ("twist90", [0.13140395018716422, -0.23195540171703727, 11.643050091438695]),
                ("twist180", [0.7296779209752327, 0.12993351089909383, 23.26645295291273]),
            ]
            .as_slice(),
        ),
        ("beam_neo_hookean", &[("bend60", [10.931011516875094, -0.620126838285781, -0.4726604142295754])]),
        ("beam_corotational", &[("bend60", [11.15836946649606, -0.623768478541828, -0.4757592085561705])]),
    ] {
        let Some(folder) = shared(&format!("cases/{name}")) else { return };
        let (mut statics, poses) = case(&folder);
        for (pose, expected) in moments {
            let control = &poses.iter().find(|(name, _)| name == pose).unwrap().1;
            let settled = statics.solve(control, &Silent).unwrap();
            let moved = control.iter().position(|pose| *pose != ControlPose::REST).unwrap();
            let (wrench, expected) = (settled.wrenches[moved], Vector3::from(*expected));
            let about_moved = wrench.moment - control[moved].translation.cross(&wrench.force);
            assert!((about_moved - expected).norm() < 1e-8 * expected.norm(), "{name} {pose}: {about_moved}");
        }
    }
}

/// One tetrahedron is inside out there, which is reported; from rest or on from 90° is the same.
#[test]
fn tube_twisted_by_half_a_turn_has_an_inverted_tetrahedron() {
    let Some(folder) = shared("cases/tube_stvk") else { return };
    let (mut statics, poses) = case(&folder);
    let (name, twist90) = poses.last().unwrap();
    assert_eq!(name, "twist90");
    let mut twist180 = twist90.clone();
    let moved = twist180.iter_mut().find(|pose| **pose != ControlPose::REST).unwrap();
    moved.matrix = *Rotation3::from_axis_angle(&Vector3::z_axis(), 180.0f64.to_radians()).matrix();
    for before in [None, Some(twist90)] {
        if let Some(before) = before {
            statics.solve(before, &Silent).unwrap();
        }
        let settled = statics.solve(&twist180, &Silent).unwrap();
        println!(
            "twist180: energy {} J, least det F {}, {:?}",
            settled.energy, settled.least_det.0, settled.counts
        );
        assert!((settled.energy / 265.06744851945916 - 1.0).abs() < 1e-11, "{}", settled.energy);
        assert!((settled.least_det.0 / -0.6390491883728749 - 1.0).abs() < 1e-10, "{:?}", settled.least_det);
        assert_eq!(settled.inverted, [settled.least_det.1]);
    }
}

#[derive(serde::Deserialize)]
struct Tet {
    general_tet_nodes: [[f64; 3]; 4],
    #[serde(rename = "E")]
    young: f64,
    nu: f64,
    u: Vec<f64>,
    models: BTreeMap<String, Model>,
}

#[derive(serde::Deserialize)]
struct Model {
    energy: f64,
    force: Vec<f64>,
    tangent: Vec<Vec<f64>>,
}

#[test]
fn one_tetrahedron_matches_the_independent_energy_force_and_tangent() {
    let Some(path) = shared("cases/unit_tet/general_tet_nonlinear.json") else { return };
    let tet: Tet = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let names = BTreeMap::from([
        ("stvk", "stvk"),
        ("neo_hookean", "neohooke_smith_nolog"),
        ("corotational", "corotated_linear"),
    ]);
    for law in LAWS {
        let name = names.get(law.name).unwrap_or_else(|| panic!("no expected values of {}", law.name));
        let expected = &tet.models[*name];
        let mesh = TetMesh {
            nodes: tet.general_tet_nodes.map(Vector3::from).to_vec(),
            tags: vec![1, 2, 3, 4],
            tets: vec![[0, 1, 2, 3]],
            ..TetMesh::default()
        };
        let lame = [Lame::from_young_poisson(tet.young, tet.nu)];
        let body = Hyperelastic::new(&TET4, law, &mesh, &lame).unwrap();
        let h = body.gradients(&NodeFields { nodes: 4, columns: 1, data: tet.u.clone() });
        let energy = body.energy(&h) / expected.energy - 1.0;
        let relative = |found: &[f64], expected: &[f64]| {
            let size = expected.iter().fold(0.0f64, |size, value| size.max(value.abs()));
            found.iter().zip(expected).fold(0.0f64, |worst, (f, e)| worst.max((f - e).abs())) / size
        };
        let force = relative(&body.forces(&h).data, &expected.force);
        let k = body.tangent(&h);
        let mut identity = NodeFields::zeros(4, 12);
        (0..12).for_each(|i| identity.row_mut(i)[i] = 1.0);
        let mut dense = NodeFields::zeros(4, 12);
        k.multiply(&identity, &mut dense);
        let tangent = relative(&dense.data, &expected.tangent.concat());
        println!(
            "{name}: relative differences: energy {energy:.1e}, force {force:.1e}, tangent {tangent:.1e}"
        );
        assert!(energy.abs() < 1e-12 && force < 1e-12 && tangent < 1e-12);
    }
}
