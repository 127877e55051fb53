//! The plate in a body, against the linear solution, static equilibrium at large rotations, and differences of its energy.

use super::*;
use crate::deform::Wrench;
use crate::deform::models::fixture::{self, Body, assert_slopes, pose, twist};
use crate::deform::models::model_of;
use crate::deform::statics::Statics;
use crate::fem::LAWS;
use crate::green::{self, Requirements, Solution};
use crate::scene::Scene;
use crate::solve::Silent;
use nalgebra::{Matrix3, Rotation3};
use std::path::Path;

/// Leaves of 1 × 0.4 × 0.03 m, thin along y, held at the ends of their length along x.
const LEAF: &str = "block = { size = [1.0, 0.03, 0.4], cells = [10, 1, 4] }";
const FINE: &str = "block = { size = [1.0, 0.03, 0.4], cells = [16, 1, 6] }";
const LAYERED: &str = "block = { size = [1.0, 0.03, 0.4], cells = [16, 2, 6] }";
const THIN: [f64; 3] = [0.0, 1.0, 0.0];

const TEXT: &str = "stage = \"desktop\"\n[body.b]\ngenerate = { GENERATE }\nelement = \"ELEMENT\"\n\
                    material = { young = 1e6, poisson = 0.3 }\nmodel = \"stvk\"\n\
                    control.a = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.b = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

fn scene(generate: &str, element: &str) -> Scene {
    let text = TEXT.replace("GENERATE", generate).replace("ELEMENT", element);
    Scene::parse(&text, Path::new("leaf.toml")).unwrap()
}

fn solve(scene: &Scene) -> Solution {
    green::solve(scene, "b", &Requirements::new(ENTRY.requirements), &Silent).unwrap()
}

/// The end of an arc of length 1, out of the plate's plane.
fn bend(degrees: f64) -> [ControlPose; 2] {
    fixture::bend(degrees, 1.0)
}

/// All four moduli of an element that does not lock are Young's.
#[test]
fn moduli_are_those_of_the_material() {
    let solution = solve(&scene(FINE, "tet10"));
    let nodes = &solution.mesh.nodes;
    let surface: Vec<Vector3<f64>> = solution.surface.nodes.iter().map(|&n| nodes[n as usize]).collect();
    let held: Vec<Vec<Vector3<f64>>> = solution
        .controls
        .iter()
        .map(|control| control.nodes.iter().map(|&node| nodes[node as usize]).collect())
        .collect();
    let middle = Middle::new(&surface, &solution.surface.triangles, &held).unwrap();
    assert!((middle.through().dot(&Vector3::from(THIN)).abs() - 1.0).abs() < 1e-6);
    assert!((middle.thickness - 0.03).abs() < 1e-6, "{}", middle.thickness);
    let origins: Vec<Vector3<f64>> = solution.controls.iter().map(|control| control.origin).collect();
    let shapes = middle
        .parts
        .iter()
        .filter_map(|part| Point::new(&middle.grid.at(part.place), &middle.rest, part.seen, part.thickness));
    let grips = held.iter().enumerate().flat_map(|(e, nodes)| grips_of(&middle, e, &origins[e], nodes));
    let (points, grips) = (shapes.collect(), grips.collect());
    let mut sheet = Sheet::new(&middle.grid, middle.rest.clone(), points, grips);
    let (moduli, off) = constants::fit(&mut sheet, &origins, solution.stiffness().unwrap());
    assert!(moduli.iter().all(|modulus| (modulus / 1e6 - 1.0).abs() < 0.03), "{moduli:?}");
    assert!(off < 2e-3, "{off:e}");
}

/// Force and torque in parts of the largest wrench, shape in parts of the length, energy in parts of itself, by
/// St. Venant-Kirchhoff statics on the same mesh.
fn compare(generate: &str, element: &str, cases: &[(&str, [ControlPose; 2], [f64; 4])]) {
    let scene = scene(generate, element);
    let mut body = Body::new(&scene, &ENTRY);
    let law = LAWS.iter().find(|law| law.name == "stvk").unwrap();
    let mut statics = Statics::new(&scene, "b", law, &Silent).unwrap();
    for (name, poses, most) in cases {
        body.model.forget();
        let found = statics.solve(&poses.to_vec(), &Silent).unwrap();
        let (energy, slopes) = body.respond::<3>(poses);
        let about = |w: &Wrench| Wrench { moment: w.moment - poses[1].translation.cross(&w.force), ..*w };
        let (own, held) = (about(&Wrench::from_slope(&slopes[1], &poses[1])), about(&found.wrenches[1]));
        let size = held.force.norm().max(held.moment.norm());
        let nodes = body.solution.surface.nodes.clone();
        let off = body
            .shape(poses)
            .iter()
            .zip(&nodes)
            .map(|(u, &node)| u - found.displacement[node as usize])
            .collect::<Vec<_>>();
        let shape = (off.iter().map(Vector3::norm_squared).sum::<f64>() / off.len() as f64).sqrt();
        let errors = [
            (own.force - held.force).norm() / size,
            (own.moment - held.moment).norm() / size,
            shape,
            (energy / found.energy - 1.0).abs(),
        ];
        println!("{element} {name}: {errors:?}");
        assert!(
            errors.iter().zip(most).all(|(error, most)| error < most),
            "{element} {name}: {errors:?} {most:?}"
        );
    }
}

#[test]
fn a_bent_and_twisted_leaf_is_that_of_static_equilibrium() {
    compare(
        LEAF,
        "tet10",
        &[
            ("bend 1°", bend(1.0), [0.08, 0.01, 1e-4, 0.01]),
            ("bend 90°", bend(90.0), [0.2, 0.05, 1e-3, 0.02]),
            ("twist 1°", twist(1.0), [0.05, 0.02, 1e-4, 0.01]),
            ("twist 90°", twist(90.0), [0.05, 0.01, 2e-3, 0.03]),
            (
                "out of the plane by 10 %",
                pose(Vector3::zeros(), Vector3::y() * 0.1),
                [0.02, 0.01, 1e-3, 0.02],
            ),
            ("along by 1 %", pose(Vector3::zeros(), Vector3::x() * 0.01), [0.01, 0.01, 1e-4, 0.01]),
            ("in the plane by 1 %", pose(Vector3::zeros(), Vector3::z() * 0.01), [0.01, 0.01, 1e-4, 0.01]),
        ],
    );
}

/// Elements that lock: three times too stiff in bending, twenty-four times in twisting.
#[test]
fn a_leaf_of_locking_elements_is_that_of_static_equilibrium() {
    compare(
        LAYERED,
        "tet4",
        &[
            ("bend 60°", bend(60.0), [0.05, 0.02, 1e-3, 0.02]),
            ("twist 60°", twist(60.0), [0.01, 0.05, 2e-3, 0.03]),
        ],
    );
}

/// A third control element on the side of the leaf, away from its ends.
#[test]
fn slopes_are_those_of_the_energy_and_held_nodes_go_where_they_are_held() {
    let third = "control.c = { nodes = { box = { min = [-0.11, -1.0, 0.19], max = [0.11, 1.0, 0.21] } }, grab = \"fixed\" }\n";
    let text = TEXT.replace("GENERATE", LEAF).replace("ELEMENT", "tet10") + third;
    let mut body = Body::new(&Scene::parse(&text, Path::new("leaf.toml")).unwrap(), &ENTRY);
    let turn = |by: Vector3<f64>| *Rotation3::from_scaled_axis(by).matrix();
    let stretch = Matrix3::new(1.01, 0.005, 0.0, 0.005, 0.99, 0.002, 0.0, 0.002, 1.02);
    let pose = |x, y, z, matrix| ControlPose { translation: Vector3::new(x, y, z), matrix };
    let poses = [
        pose(0.1, -0.2, 0.3, turn(Vector3::new(0.2, 0.4, -0.3))),
        pose(-0.1, 0.1, 0.25, turn(Vector3::new(0.5, 0.2, 0.4)) * stretch),
        pose(0.05, -0.05, 0.3, turn(Vector3::new(0.3, 0.3, 0.1))),
    ];
    let (energy, slopes) = body.respond::<3>(&poses);
    let size = energy.max(slopes[1].translation.norm());
    assert_slopes(body.model.as_mut(), &poses, 1e-5, 1e-5 * size);
    body.assert_held_nodes_follow(&poses);
}

/// A twist by 200° there and back, or given by a quaternion's sign; and a common motion, which costs nothing.
#[test]
fn long_turns_are_followed_and_rigid_motions_cost_nothing() {
    let mut body = Body::new(&scene(LEAF, "tet10"), &ENTRY);
    let mut energies = Vec::new();
    for step in (0..=10).chain((0..10).rev()) {
        energies.push(body.respond::<3>(&twist(20.0 * f64::from(step))).0);
    }
    for step in 0..10 {
        assert!((energies[step] - energies[20 - step]).abs() < 1e-6 * energies[10], "{energies:?}");
        assert!(energies[step] < energies[step + 1], "{energies:?}");
    }
    let told = energies[10];
    body.model.forget();
    body.model.set_turn(1, UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 190f64.to_radians()));
    let again = body.respond::<3>(&twist(200.0)).0;
    assert!((told / again - 1.0).abs() < 1e-6, "{again} {energies:?}");
    body.model.forget();
    let turn = *Rotation3::from_scaled_axis(Vector3::new(0.4, 2.0, -1.5)).matrix();
    let rigid: Vec<ControlPose> = body
        .solution
        .controls
        .iter()
        .map(|control| ControlPose {
            translation: turn * control.origin - control.origin + Vector3::new(1.0, 2.0, 3.0),
            matrix: turn,
        })
        .collect();
    assert!(body.respond::<3>(&rigid).0 < 1e-9 * told);
}

/// A leaf that is pressed together gives way to a side: it takes less energy than one that stays plane.
#[test]
fn a_pressed_leaf_buckles() {
    let mut body = Body::new(&scene(LEAF, "tet10"), &ENTRY);
    let pressed = |share: f64| pose(Vector3::zeros(), Vector3::x() * -share);
    let plane = body.respond::<3>(&pressed(1e-4)).0 * 1e4;
    let (energy, _) = body.respond::<3>(&pressed(0.01));
    assert!(energy < 0.65 * plane, "{energy} {plane}");
    let shape = body.shape(&pressed(0.01));
    let aside = shape.iter().map(|u| u.y.abs()).fold(0.0, f64::max);
    assert!((0.04..0.1).contains(&aside), "{aside}");
}

/// A pose so far away that no number holds its energy: the shell stays as it was, and goes on from there.
#[test]
fn a_pose_without_equilibrium_leaves_the_last_one() {
    let mut body = Body::new(&scene(LEAF, "tet4"), &ENTRY);
    let bent = bend(20.0);
    let (energy, slopes) = body.respond::<3>(&bent);
    let shape = body.shape(&bent);
    for far in [1e100, 1e154, 1e300] {
        let nowhere = pose(Vector3::z() * 2.0, Vector3::new(far, far, 0.0));
        let mut kept = [PoseSlope::default(); 3];
        let response = body.model.respond(&nowhere, &mut kept).unwrap();
        assert!(!response.is_defined && response.energy == energy, "{far:e}: {response:?}");
        for (kept, slope) in kept.iter().zip(&slopes) {
            let off = (kept.translation - slope.translation).norm() + (kept.matrix - slope.matrix).norm();
            assert!(off <= 1e-9 * energy, "{far:e}: {kept:?} {slope:?}");
        }
        assert_eq!(body.shape(&nowhere), shape, "{far:e}");
    }
    let (again, _) = body.respond::<3>(&bend(25.0));
    let (fresh, _) = Body::new(&scene(LEAF, "tet4"), &ENTRY).respond::<3>(&bend(25.0));
    assert!((again - fresh).abs() < 1e-6 * fresh, "{again} {fresh}");
}

#[test]
fn a_body_that_is_no_plate_is_refused() {
    let thick = scene("block = { size = [1.0, 0.1, 0.4], cells = [8, 1, 4] }", "tet4");
    let error = model_of(&ENTRY, &solve(&thick)).map(drop).unwrap_err();
    assert!(error.contains("1 : 4.0; a plate is 1 : 5") && error.contains("rotation"), "{error}");
    let solution = green::solve(&thick, "b", &Requirements::new(&[]), &Silent).unwrap();
    let error = model_of(&ENTRY, &solution).map(drop).unwrap_err();
    assert!(error.contains("handle stiffness"), "{error}");
    let tube = "tube = { inner_radius = 0.09, outer_radius = 0.1, length = 0.5, radial = 1, around = 16, along = 8, \
                control_length = 0.1 }";
    let text = TEXT
        .replace("GENERATE", tube)
        .replace("xmin", "left")
        .replace("xmax", "right")
        .replace("ELEMENT", "tet4");
    let error = model_of(&ENTRY, &solve(&Scene::parse(&text, Path::new("tube.toml")).unwrap()))
        .map(drop)
        .unwrap_err();
    assert!(error.contains("lies over itself"), "{error}");
    let text = TEXT.replace("GENERATE", FINE).replace("ELEMENT", "tet10");
    let (held, _) = text.split_once("control.b").unwrap();
    let scene = Scene::parse(held, Path::new("held.toml")).unwrap();
    let (_, why) = (ENTRY.fits.unwrap())(&green::prepare(&scene, "b").unwrap()).unwrap_err();
    assert!(why.contains("it has 1") && why.contains("rotation"), "{why}");
    let error = model_of(&ENTRY, &solve(&scene)).map(drop).unwrap_err();
    assert!(error.contains("it has 1"), "{error}");
}

/// A piece of a cylinder's wall: the middle surface and the thickness across it.
#[test]
fn a_curved_wall_has_its_middle_surface() {
    let (radius, thickness, cells) = (0.6, 0.03, [24, 8]);
    let (mut nodes, mut triangles) = (Vec::new(), Vec::new());
    for side in [-0.5, 0.5] {
        for i in 0..=cells[0] {
            for j in 0..=cells[1] {
                let (angle, y) = (i as f64 / cells[0] as f64 - 0.5, 0.4 * j as f64 / cells[1] as f64);
                let r = radius + side * thickness;
                nodes.push(Vector3::new(r * angle.sin(), y, r * angle.cos()));
            }
        }
    }
    let node = |side: u32, i: usize, j: usize| {
        side * ((cells[0] + 1) * (cells[1] + 1)) as u32 + (i * (cells[1] + 1) + j) as u32
    };
    for (i, j) in (0..cells[0] * cells[1]).map(|k| (k / cells[1], k % cells[1])) {
        for side in [0, 1] {
            let [a, b, c, d] =
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| node(side, i, j));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut wall = |from: [usize; 2], to: [usize; 2]| {
        let [a, b] = [0, 1].map(|side| node(side, from[0], from[1]));
        let [c, d] = [0, 1].map(|side| node(side, to[0], to[1]));
        triangles.extend([[a, b, d], [a, d, c]]);
    };
    (0..cells[0]).for_each(|i| [0, cells[1]].iter().for_each(|&j| wall([i, j], [i + 1, j])));
    (0..cells[1]).for_each(|j| [0, cells[0]].iter().for_each(|&i| wall([i, j], [i, j + 1])));
    let middle = Middle::new(&nodes, &triangles, &[]).unwrap();
    assert!((middle.thickness / thickness - 1.0).abs() < 0.01, "{}", middle.thickness);
    for part in &middle.parts {
        let place = middle.grid.at(part.place).point(&middle.rest);
        let off = place.x.hypot(place.z) - radius;
        assert!(off.abs() < 0.04 * thickness, "{off:e} at {place}");
    }
    let area: f64 = middle
        .parts
        .iter()
        .filter_map(|part| Point::new(&middle.grid.at(part.place), &middle.rest, part.seen, part.thickness))
        .map(|point| point.area)
        .sum();
    assert!((area / (radius * 0.4) - 1.0).abs() < 0.02, "{area}");
}
