//! Measured errors of bodies under loads, against answers from elsewhere.

use super::tests::{beam, deformer_of};
use super::*;
use crate::deform::pose_file::PoseLoads;
use crate::deform::{ControlPose, ROTATION};
use crate::green::{self, LOADS, Requirements};
use crate::solve::Silent;
use crate::world::wrench_error_of;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;

/// Under its weight alone the beam's error is that of the weight: against the same beam of tet10, and far below that of the worst motion.
#[test]
fn the_error_of_the_mesh_under_weight_is_that_of_the_weight() {
    let of = |element: &str| {
        let settings = format!(
            "material = {{ young = 1.0e7, poisson = 0.0, density = 100.0 }}\nelement = \"{element}\"\ngravity = true"
        );
        let scene = beam(2, &settings, "fixed", "dragger");
        let required = Requirements::of(&[STIFFNESS, LOADS]);
        let body = green::precompute(&scene, "beam", &required, &Silent).unwrap();
        (scene, body)
    };
    let ((scene, body), (_, fine)) = (of("tet4"), of("tet10"));
    let mesh = mesh_errors(&scene, &body, &[1], &Silent, &mut Vec::new())[0].0.clone();
    let most = mesh.as_ref().unwrap().wrench;
    let moved = MovedErrors { control: "high".into(), mesh, ..MovedErrors::default() };
    let expected = ExpectedErrors { moved: vec![moved], ..ExpectedErrors::default() };
    let shown = |body: &Precomputed| {
        let mut deformer = deformer_of(body, "linear");
        deformer.apply(&PoseLoads::of_scene(&scene.body["beam"]).applied(&deformer).unwrap());
        deformer.evaluate(&[ControlPose::REST; 2]);
        let wrenches = deformer.wrenches().unwrap().0;
        (expected.mesh_at(&deformer, &wrenches).unwrap(), wrenches[1])
    };
    let ((told, own), (_, right)) = (shown(&body), shown(&fine));
    let size = |force: Vector3<f64>, moment: Vector3<f64>| force.norm().max(moment.norm() / 4.0);
    let known = size(own.force - right.force, own.moment - right.moment) / size(right.force, right.moment);
    println!("told {told:.5}, known {known:.5}, most {most:.5}");
    // A half of 4 m³ of 100 kg/m³ on each end.
    assert!((right.force.y / (2.0 * 100.0 * 9.80665) - 1.0).abs() < 0.01, "{right:?}");
    assert!((told - known).abs() < 0.01 * known + 1e-4 && told < 0.5 * most, "{told} {known} {most}");
}

/// A warm bar between walls, ν = 0: linear theory has E A ε; a bar whose shape without stress is s = 1 + ε times as large, of St.
/// Venant and Kirchhoff's law, E A (s² - 1)/2s (its strain (1/s² - 1)/2, its energy for the volume s³): linear theory has ε/(2 +
/// ε) too much. Near its ends, whose sections the walls keep from growing, the bar has a little less than that. A body that loads
/// alone deform gets this error, not those of bends.
#[test]
fn a_body_under_loads_alone_has_the_errors_of_its_loads() {
    let warm = 0.002;
    let text = format!(
        "[body.bar]\ngenerate = {{ block = {{ size = [20.0, 1.0, 1.0], cells = [40, 2, 2] }} }}\n\
         material = {{ young = 1.0e3, poisson = 0.0 }}\nthermal = {{ expansion = 1e-4, difference = {} }}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n",
        warm / 1e-4
    );
    let scene = Resolved::parse(&text, Path::new("bar.toml")).unwrap();
    let required = Requirements::of(&[STIFFNESS, LOADS]);
    let mut body = green::precompute(&scene, "bar", &required, &Silent).unwrap();
    let errors = measure(&scene, &mut body, &Silent);
    let told = errors.loaded.unwrap().force.unwrap();
    assert!((told / (warm / (2.0 + warm)) - 1.0).abs() < 0.05, "{told}");
    let mut deformer = deformer_of(&body, "linear");
    let mut loads = PoseLoads::of_scene(&scene.body["bar"]).applied(&deformer).unwrap();
    let mut force = |share: f64, pull: f64| {
        loads.coefficients = vec![share * warm];
        deformer.apply(&loads);
        let translation = Vector3::new(pull, 0.0, 0.0);
        deformer.evaluate(&[ControlPose::REST, ControlPose { translation, ..ControlPose::REST }]);
        errors.in_pose(&deformer).and_then(|at| at.force)
    };
    assert_eq!(force(1.0, 0.0), Some(told));
    let half = force(0.5, 0.0).unwrap();
    assert!((0.49..0.51).contains(&(half / told)), "{half}");
    assert_eq!(force(2.0, 0.0), None, "warmer than measured");
    assert!(force(1.0, 0.02).unwrap() > told, "pulled too");
    assert_eq!(force(0.0, 0.02), None, "a pull was measured of the warm bar alone");
}

/// A beam under its weight that is turned as a whole, model `rotation`: upside down the weight acts the other way, upright along it,
/// which were not measured; about the weight all is as before. Of an upright beam the mesh's part is that of an axial weight, which
/// linear elements bear exactly in halves, and not that of the moment across.
#[test]
fn a_loaded_body_that_is_turned_as_a_whole_has_the_errors_of_its_loads_directions() {
    let settings =
        "material = { young = 1.0e7, poisson = 0.0, density = 100.0 }\nmodel = \"rotation\"\ngravity = true";
    let scene = beam(2, settings, "fixed", "dragger");
    let families = [ROTATION.requirements, ROTATION.energy.unwrap_or_default(), &[STIFFNESS, LOADS]];
    let required =
        families.map(Requirements::of).into_iter().fold(Requirements::default(), Requirements::and);
    let mut body = green::precompute(&scene, "beam", &required, &Silent).unwrap();
    let errors = measure(&scene, &mut body, &Silent);
    let mut deformer = deformer_of(&body, "rotation");
    deformer.apply(&PoseLoads::of_scene(&scene.body["beam"]).applied(&deformer).unwrap());
    let mut turned = |axis: Vector3<f64>| {
        let turn = Rotation3::new(axis);
        let poses: Vec<ControlPose> = deformer
            .controls
            .iter()
            .map(|control| ControlPose {
                translation: turn * control.origin - control.origin,
                matrix: *turn.matrix(),
            })
            .collect();
        deformer.evaluate(&poses);
        let wrenches = deformer.wrenches().unwrap().0;
        let mesh = errors.mesh_at(&deformer, &wrenches).unwrap();
        let unmeasured = ExpectedErrors { moved: vec![], loaded: None, ..errors.clone() };
        assert_eq!(wrench_error_of(&unmeasured, &deformer, &wrenches, &[]), None);
        (errors.in_pose(&deformer).is_some(), mesh, wrenches[1])
    };
    use std::f64::consts::{FRAC_PI_2, PI};
    let (is_known, across, _) = turned(Vector3::zeros());
    assert!(is_known && across > 1e-4, "{across}");
    let (is_known, about_weight, _) = turned(Vector3::y() * 1.2);
    assert!(is_known && (about_weight / across - 1.0).abs() < 1e-6, "{about_weight} {across}");
    assert!(!turned(Vector3::z() * PI).0);
    let (is_known, upright, wrench) = turned(Vector3::z() * FRAC_PI_2);
    assert!(!is_known && upright < 1e-6, "{upright}");
    assert!((wrench.force.y / (2.0 * 100.0 * 9.80665) - 1.0).abs() < 1e-5, "{wrench:?}");
}

/// A control element midway between two others has no axis to them, and the mesh's part of it is known all the same.
#[test]
fn the_mesh_is_measured_of_an_element_in_the_middle_of_others() {
    let text = "[body.beam]\ngenerate = { block = { size = [4.0, 1.0, 1.0], cells = [8, 2, 2] } }\n\
                material = { young = 1.0e7, poisson = 0.3, density = 100.0 }\ngravity = true\n\
                control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.high = { nodes = { group = \"xmax\" }, grab = \"fixed\" }\n\
                control.middle = { nodes = { box = { min = [-0.1, -1.0, -1.0], max = [0.1, 1.0, 1.0] } }, grab = \"dragger\" }\n";
    let scene = Resolved::parse(text, Path::new("beam.toml")).unwrap();
    let body = green::precompute(&scene, "beam", &Requirements::of(&[STIFFNESS, LOADS]), &Silent).unwrap();
    let mut left_out = Vec::new();
    let errors = mesh_errors(&scene, &body, &[2], &Silent, &mut left_out);
    assert!(errors[0].0.as_ref().is_some_and(|mesh| mesh.wrench > 0.01), "{left_out:?}");
}
