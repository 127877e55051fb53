use super::*;
use crate::mesh::diagnostics;
use crate::mesh::quality::{components, signed_volume};
use std::collections::BTreeSet;

/// Meshes of a piece, of 250 to 1000 nodes, without faults, with as many regions as materials, and of each kind.
#[test]
fn random_bodies_have_sound_meshes() {
    let (mut kinds, mut counts, mut models) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    for seed in 0..60 {
        let body = RandomBody::new(seed).unwrap();
        let mesh = &body.mesh;
        assert!((250..1000).contains(&mesh.nodes.len()), "{seed}: {} nodes", mesh.nodes.len());
        assert_eq!(components(mesh).nodes.len(), 1, "{seed}: pieces");
        let found = diagnostics::find(mesh);
        assert!(found.is_empty(), "{seed}: {found:?}");
        let volumes: Vec<f64> = (0..mesh.tets.len()).map(|tet| signed_volume(&mesh.corners(tet))).collect();
        assert!(volumes.iter().all(|volume| *volume > 0.0), "{seed}");
        // The surface encloses as much as the tetrahedra fill.
        let enclosed = crate::mesh::Surface::from_mesh(mesh).volume(mesh);
        assert!((volumes.iter().sum::<f64>() / enclosed - 1.0).abs() < 1e-9, "{seed}");
        let regions: BTreeSet<u32> = mesh.regions.iter().copied().collect();
        assert_eq!(regions.len(), body.materials.len(), "{seed}: {regions:?}");
        for material in &body.materials {
            assert!(material.young > 0.0 && (0.0..=0.49).contains(&material.poisson), "{seed}: {material:?}");
        }
        let ends = CONTROLS.map(|name| mesh.groups[name].iter().copied().collect::<BTreeSet<u32>>());
        assert!(ends.iter().all(|end| end.len() >= 4) && ends[0].is_disjoint(&ends[1]), "{seed}");
        kinds.insert(body.kind);
        counts.insert(body.materials.len());
        models.insert(body.model);
    }
    assert_eq!((kinds.len(), counts, models.len()), (3, BTreeSet::from([1, 2, 3, 4]), 6));
}

/// A body has the same numbers whenever it is made; poses turn by up to 90°, stretch by 10 % and press by 5 %.
#[test]
fn a_seed_gives_one_body_and_poses_in_range() {
    for seed in 0..60 {
        let [body, again] = [RandomBody::new(seed), RandomBody::new(seed)].map(Result::unwrap);
        assert_eq!(
            (&body.mesh, &body.materials, body.scene()),
            (&again.mesh, &again.materials, again.scene())
        );
        assert_eq!(body.poses.len(), 4);
        for pose in &body.poses {
            assert!((0.0..=90.0).contains(&pose.turn), "{seed} {}: {}", pose.name, pose.turn);
        }
        let along = &body.poses[2].poses[1];
        let ends = CONTROLS.map(|name| {
            let nodes = &body.mesh.groups[name];
            nodes.iter().map(|node| body.mesh.nodes[*node as usize]).sum::<nalgebra::Vector3<f64>>()
                / nodes.len() as f64
        });
        let way = ends[1] - ends[0];
        let part = ((way + along.translation).norm() - way.norm()) / way.norm();
        assert!((-0.0501..=0.1001).contains(&part) && part != 0.0, "{seed}: {part}");
    }
}

/// Half of the third digit is what printing loses.
#[test]
fn a_statement_holds_within_what_is_printed_and_its_doubt() {
    let statement = |shown: Option<f64>, truth: f64| Statement {
        source: Source::Report,
        quantity: Quantity::Shape,
        of: "tet4 h".into(),
        turn: 0.0,
        shown,
        doubt: 0.01,
        truth,
    };
    let told = [(Some(0.1), 0.11), (Some(0.1), 0.112), (None, 0.2)]
        .map(|(shown, truth)| statement(shown, truth).holds());
    assert_eq!(told, [Some(true), Some(false), None]);
    assert_eq!(statement(Some(0.1), 0.11).ratio().map(|ratio| (100.0 * ratio).round()), Some(100.0));
}

/// A bar of 20 nodes, bent by 20°: the report's rows, the planner's answer and the ± are judged, and `tet4` is off by what a mesh of
/// one cell across is.
#[test]
fn a_small_body_is_judged() {
    let mut mesh =
        crate::mesh::block(&crate::mesh::Block { size: [0.5, 0.5, 2.0], cells: [1, 1, 4] }).unwrap();
    for (name, group) in CONTROLS.iter().zip(["zmin", "zmax"]) {
        let nodes = mesh.groups[group].clone();
        mesh.groups.insert((*name).into(), nodes);
    }
    mesh.regions = vec![1; mesh.tets.len()];
    let turn = 20f64.to_radians();
    let matrix = *nalgebra::Rotation3::new(nalgebra::Vector3::x() * turn).matrix();
    let way = nalgebra::Vector3::z() * 2.0;
    let translation = crate::deform::se3::slide_matrix(&(nalgebra::Vector3::x() * turn)) * way - way;
    let poses = vec![crate::deform::ControlPose::REST, crate::deform::ControlPose { translation, matrix }];
    let body = RandomBody {
        seed: 1,
        kind: BodyKind::Compact,
        mesh,
        materials: vec![RandomMaterial { young: 1e6, poisson: 0.3 }],
        model: "rotation",
        poses: vec![RandomPose { name: "bent 20°".into(), turn: 20.0, poses }],
    };
    let planner =
        |scene: &_, body: &str, rows, demand: &_| crate::tuning::answered(scene, body, rows, demand);
    let judged = judge_body(&body, Some(&planner)).unwrap();
    let of = |source: Source| judged.statements.iter().filter(move |statement| statement.source == source);
    assert!(of(Source::Report).count() > 20, "{:?}", judged.left_out);
    assert_eq!((of(Source::Planner).count(), of(Source::Expected).count()), (2, 2), "{:?}", judged.left_out);
    let row = of(Source::Report)
        .find(|s| s.of == "tet4 h · cholesky · f32 · rotation" && s.quantity == Quantity::Wrench);
    let row = row.unwrap();
    println!("{row:?}");
    assert!(row.truth > 0.1 && row.holds() == Some(true), "{row:?}");
    // tet10 on such a mesh, from which the ± comes, is itself off by a tenth.
    for statement in of(Source::Expected) {
        println!("{statement:?} {:?}", statement.ratio());
        assert!(statement.ratio().is_some_and(|ratio| (0.8..5.0).contains(&ratio)), "{statement:?}");
    }
    let table = summary(&[&judged]).text();
    assert!(table.contains("± force, to 60°") && table.contains("report: shape"), "{table}");
}
