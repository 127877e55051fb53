//! Deformation models against each other, against rigid motions and against static equilibrium at large rotations.

use crate::common::{block_scene, case_poses, csv_rows, scene, shared};
use greenstage::base::parts::PartWeights;
use greenstage::deform::{
    Bearing, BodyState, ControlPose, ControlPoses, DeformationModel, Deformer, Frame, Kind, LINEAR,
    ModelEntry, find_model, local_turn,
};
use greenstage::green::{self, AFFINE, GreenFile, Requirements};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Isometry3, Point3, Rotation3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The only body of the scene, precomputed through a file.
fn green_file(scene: &Scene) -> Arc<GreenFile> {
    let body = scene.body.keys().next().unwrap();
    let precomputed = green::precompute(scene, body, &Requirements::new(&[AFFINE]), &Silent).unwrap();
    green::opened(&[precomputed]).unwrap()
}

/// A body of the file in the given poses; others rest.
fn deformed(file: &Arc<GreenFile>, model: &str, poses: &[(&str, ControlPose)]) -> Deformer {
    let body = file.meta.bodies.keys().next().unwrap();
    let mut deformer = Deformer::new(file.clone(), body, find_model(model).unwrap()).unwrap();
    let all: ControlPoses = deformer
        .controls
        .iter()
        .map(|control| {
            poses.iter().find(|(name, _)| *name == control.name).map_or(ControlPose::REST, |(_, pose)| *pose)
        })
        .collect();
    deformer.evaluate(&all);
    deformer
}

/// The place at which surface node `i` is drawn, about the body's centre.
fn drawn(deformer: &Deformer, i: usize) -> Vector3<f64> {
    let x = Point3::from(Vector3::from(deformer.positions()[i]).cast::<f64>());
    (deformer.body_from_surface() * x).coords
}

fn rest(deformer: &Deformer, i: usize) -> Vector3<f64> {
    Vector3::from(deformer.rest()[i]).cast()
}

/// Largest extent at rest along an axis, m.
fn length(deformer: &Deformer) -> f64 {
    let along = |axis: usize| {
        let values = deformer.rest().iter().map(|x| f64::from(x[axis]));
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    (0..3).map(along).fold(0.0, f64::max)
}

/// A model of two rigid parts, one at each end along x, that blend between them. Its columns are those of `linear`.
struct TwoParts;

const TWO_PARTS: ModelEntry = ModelEntry {
    name: "two_parts",
    summary: "a test's own",
    requirements: &[AFFINE],
    frame: Frame::MeanMotion,
    energy: None,
    turn_limits_deg: [0.0; 2],
    kind: Kind::Online(|_| Ok(Box::new(TwoParts))),
    loads: Bearing::Columns,
    fits: None,
};

impl DeformationModel for TwoParts {
    /// The first part follows the first control element's translation and turns with it; the second stays.
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        let turn = Vector3::new(0.0, 0.0, 40.0 * poses[0].translation.x);
        BodyState {
            parts: vec![Isometry3::new(poses[0].translation, turn), Isometry3::identity()],
            coefficients: poses.iter().flat_map(ControlPose::coefficients).collect(),
            ..BodyState::at_rest(0)
        }
    }

    fn part_weights(&self, rest: &[[f32; 3]]) -> Option<PartWeights> {
        let ends = rest.iter().fold([f32::MAX, f32::MIN], |[a, b], x| [a.min(x[0]), b.max(x[0])]);
        let share = |x: &[f32; 3]| f64::from((x[0] - ends[0]) / (ends[1] - ends[0])).clamp(0.0, 1.0);
        let rows: Vec<_> = rest.iter().map(|x| vec![(0, 1.0 - share(x)), (1, share(x))]).collect();
        PartWeights::new(2, &rows).ok()
    }
}

/// x_i = Σ w_ip (R_p (X_i + u_i) + t_p) in positions, in single displacements, and where only some nodes are summed.
#[test]
fn a_model_of_several_parts_moves_each_node_by_its_weights() {
    let file = green_file(&block_scene([4, 3, 3], ""));
    let mut body = Deformer::new(file.clone(), "block", &TWO_PARTS).unwrap();
    let mut poses = vec![ControlPose::REST; body.controls.len()];
    assert_eq!(body.body_from_surface(), Isometry3::identity());
    (poses[0].translation, poses[1].matrix[(0, 1)]) = (Vector3::new(0.02, 0.01, -0.03), 0.05);
    assert!(body.evaluate(&poses).is_some());
    let parts = [Isometry3::new(poses[0].translation, Vector3::z() * 0.8), Isometry3::identity()];
    let weights = TwoParts.part_weights(body.rest()).unwrap();
    let plain = deformed(&file, "linear", &[]);
    let mut plain_body = Deformer::new(file.clone(), "block", &LINEAR).unwrap();
    plain_body.evaluate(&poses);
    let expected: Vec<Vector3<f64>> = (0..body.node_count())
        .map(|i| {
            let place = Point3::from(drawn(&plain_body, i));
            let of = |share: &greenstage::base::parts::PartShare| {
                (parts[share.part as usize] * place).coords * f64::from(share.weight)
            };
            weights.at(i).iter().map(of).sum()
        })
        .collect();
    let farthest = expected.iter().enumerate().map(|(i, x)| (x - rest(&plain, i)).norm()).fold(0.0, f64::max);
    assert!(farthest > 0.1 * length(&plain), "it is moved: {farthest}");
    for (i, expected) in expected.iter().enumerate() {
        assert!((drawn(&body, i) - expected).norm() < 1e-6 * length(&body), "{i}");
        assert!((rest(&body, i) + body.displacement(i) - expected).norm() < 1e-6 * length(&body), "{i}");
    }
    let whole = body.positions().to_vec();
    body.sum_only_at(vec![0, 5]);
    for i in 0..whole.len() {
        let kept = body.kept_positions()[i];
        assert!(if i == 0 || i == 5 { kept == whole[i] } else { kept[0].is_nan() }, "{i}: {kept:?}");
    }
    assert_eq!(body.positions().as_ref(), whole);
}

/// The linear theory takes the finite rotation's R - I for a strain ½(R + Rᵀ) - I, and the body swells.
#[test]
fn rigid_motion_of_all_control_elements_is_rigid_motion_of_the_body() {
    let file = green_file(&block_scene([4, 4, 4], ""));
    let shift = Vector3::new(0.3, -2.0, 0.7);
    for (turn, least_linear) in [([0.02, 0.0, -0.01], 1e-4), ([0.4, -1.1, 2.0], 0.5)] {
        let turn = Rotation3::from_scaled_axis(Vector3::from(turn));
        let meta = &file.meta.bodies["block"];
        let poses: Vec<(&str, ControlPose)> = meta
            .controls
            .iter()
            .map(|control| {
                let origin = Vector3::from(control.origin);
                let translation = turn * origin + shift - origin;
                (control.name.as_str(), ControlPose { translation, matrix: *turn.matrix() })
            })
            .collect();
        let error = |model: &str| {
            let body = deformed(&file, model, &poses);
            let off = |i| (drawn(&body, i) - turn * rest(&body, i) - shift).norm();
            (0..body.node_count()).map(off).fold(0.0, f64::max) / length(&body)
        };
        let (linear, rotation) = (error("linear"), error("rotation"));
        println!(
            "turned by {:.3} rad: error / length: linear {linear:.1e}, rotation {rotation:.1e}",
            turn.angle()
        );
        assert!(rotation < 1e-6, "{rotation}");
        assert!(linear > least_linear, "{linear}");
    }
}

/// x to the right end's middle along an arc of the angle θ in the x-y plane, the left end held.
fn bent(length: f64, theta: f64) -> ControlPose {
    ControlPose {
        translation: Vector3::new(
            length * theta.sin() / theta - length,
            length * (1.0 - theta.cos()) / theta,
            0.0,
        ),
        matrix: *Rotation3::from_axis_angle(&Vector3::z_axis(), theta).matrix(),
    }
}

/// Wall thickness against that at rest, thinnest and thickest, between the two control elements.
fn wall(tube: &Deformer, inner: f64, outer: f64) -> (f64, f64) {
    let key = |x: &Vector3<f64>| {
        let degrees = x.z.atan2(x.y).to_degrees().rem_euclid(360.0).round() as i64 % 360;
        ((x.x * 1e4).round() as i64, degrees)
    };
    let nodes = 0..tube.node_count();
    let on = |radius: f64| -> BTreeMap<(i64, i64), usize> {
        let is_on = |i: &usize| (rest(tube, *i).yz().norm() - radius).abs() < 1e-5;
        nodes.clone().filter(is_on).map(|i| (key(&rest(tube, i)), i)).collect()
    };
    let (inside, outside) = (on(inner), on(outer));
    assert_eq!(inside.len(), outside.len());
    let ratios =
        inside.iter().map(|(key, &i)| (drawn(tube, i) - drawn(tube, outside[key])).norm() / (outer - inner));
    (ratios.clone().fold(f64::MAX, f64::min), ratios.fold(0.0, f64::max))
}

fn tube() -> Scene {
    scene(
        r#"
[body.tube]
generate = { tube = { inner_radius = 0.07, outer_radius = 0.1, length = 1.0, radial = 2, around = 40, along = 40, control_length = 0.1 } }
material = { young = 1.0e6, poisson = 0.3 }
control.left = { nodes = { group = "left" }, grab = "fixed" }
control.right = { nodes = { group = "right" }, grab = "dragger" }
"#,
    )
}

/// Linear theory sees what a model leaves it: a rigid turn whole or not at all, a bend whole or half, and where both ends
/// keep their turn but not their place the slope of the wall between, 1.5 δ/l for a slender beam of the length l = 0.8 m
/// carried aside by δ (Timoshenko, Strength of Materials I, section 43), less for a thick one; of which `rotation` takes
/// the part that the held nodes turned by together. What it makes of large turns is bent further: there the wall swells.
#[test]
fn the_local_turn_is_that_of_the_part_that_linear_theory_computes() {
    let file = green_file(&tube());
    let degrees = |model: &str, poses: &[(&str, ControlPose)]| {
        let body = deformed(&file, model, poses);
        let [some, all] = [256, usize::MAX].map(|most| local_turn(&body, most).to_degrees());
        assert!(some <= all && some > 0.9 * all - 1e-3, "a few triangles tell of all: {some} of {all}");
        all
    };
    let both = |poses: &[(&str, ControlPose)]| ["linear", "rotation"].map(|model| degrees(model, poses));
    let [linear, rotation] = both(&[]);
    assert!(linear < 1e-6 && rotation < 1e-6, "at rest: {linear}, {rotation}");
    for (whole, further) in [(4.0_f64, 0.15), (30.0, 0.6), (60.0, 1.0)] {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), whole.to_radians());
        let rigid: Vec<(&str, ControlPose)> = file.meta.bodies["tube"]
            .controls
            .iter()
            .map(|control| {
                let origin = Vector3::from(control.origin);
                let translation = turn * origin - origin;
                (control.name.as_str(), ControlPose { translation, matrix: *turn.matrix() })
            })
            .collect();
        let [linear, rotation] = both(&rigid);
        println!("turned as a whole by {whole}°: linear {linear:.2}°, rotation {rotation:.5}°");
        assert!(linear > 0.99 * whole && linear < (1.0 + further) * whole, "{linear}");
        assert!(rotation < 1e-6, "{rotation}");

        let [linear, rotation] = both(&[("right", bent(0.9, whole.to_radians()))]);
        println!("bent by {whole}°: linear {linear:.2}°, rotation {rotation:.2}°");
        assert!(linear > 0.99 * whole && linear < (1.0 + further) * whole, "{linear}");
        assert!(rotation > 0.495 * whole && rotation < 0.5 * (1.0 + further) * whole, "{rotation}");

        let aside = 0.8 * whole.to_radians() / 1.5;
        let translation = Vector3::new(0.0, aside, 0.0);
        let [linear, rotation] = both(&[("right", ControlPose { translation, ..ControlPose::REST })]);
        println!("carried aside by {aside:.3} m: linear {linear:.2}°, rotation {rotation:.2}°");
        assert!(linear > 0.6 * whole && linear < whole, "{linear}");
        assert!(rotation > 0.5 * linear && rotation < linear, "{rotation}");
    }
}

/// Each end sees half the angle: bent by 90° the wall is 1.28 of its thickness where it is thickest, against 2.08 in
/// the linear theory; at the demo's 60° 1.12 against 1.59.
#[test]
fn a_bent_tube_keeps_its_wall() {
    let tube = tube();
    let file = green_file(&tube);
    for (degrees, most, least_linear) in [(60.0_f64, 1.15, 1.5), (90.0, 1.30, 2.0)] {
        let walls = |model: &str| {
            let body = deformed(&file, model, &[("right", bent(0.9, degrees.to_radians()))]);
            wall(&body, 0.07, 0.1)
        };
        let (linear, rotation) = (walls("linear"), walls("rotation"));
        println!(
            "wall bent by {degrees}° against its rest, thinnest and thickest: linear {linear:.3?}, rotation {rotation:.3?}"
        );
        assert!(rotation.0 > 0.97 && rotation.1 < most, "{rotation:?}");
        assert!(linear.1 > least_linear, "{linear:?}");
    }
}

/// RMS position error over the surface, against the body's length, of `linear` and `rotation`, per pose of a case of
/// St. Venant-Kirchhoff statics on the same mesh.
fn errors(case: &str) -> Option<BTreeMap<String, [f64; 2]>> {
    let case_folder = shared(&format!("cases/{case}"))?;
    let path = case_folder.join("scene.toml");
    let text =
        std::fs::read_to_string(&path).unwrap().replace("\"stvk\"", "\"linear\"").replace("\"haptics\"", "");
    let file = green_file(&Scene::parse(&text, &path).unwrap());
    let exact: BTreeMap<String, Vec<f64>> =
        csv_rows(&case_folder.join("expected.csv"), 2).into_iter().collect();
    let of = |(pose, named): &(String, BTreeMap<String, ControlPose>)| {
        let control: Vec<(&str, ControlPose)> =
            named.iter().map(|(name, pose)| (name.as_str(), *pose)).collect();
        let error = ["linear", "rotation"].map(|model| {
            let body = deformed(&file, model, &control);
            let square = |(i, tag): (usize, &u64)| {
                let exact = Vector3::from_column_slice(&exact[&format!("{pose},{tag}")]);
                (body.displacement(i) - exact).norm_squared()
            };
            let sum: f64 = body.tags().iter().enumerate().map(square).sum();
            (sum / body.tags().len() as f64).sqrt() / length(&body)
        });
        (pose.clone(), error)
    };
    let errors: BTreeMap<_, _> = case_poses(&case_folder).iter().map(of).collect();
    println!(
        "{case}: RMS position error / length\n  {:<10} {:>9} {:>9}  factor",
        "pose", "linear", "rotation"
    );
    for (pose, [linear, rotation]) in &errors {
        println!("  {pose:<10} {linear:9.1e} {rotation:9.1e}  {:.1}", linear / rotation);
    }
    Some(errors)
}

/// The factors that a Python prototype measured over all nodes: bend of the tube by 90° 5.3, twist of the beam by 90°
/// 4.2. At a twist of 180° the mean rotation is not defined, and from rest `rotation` is `linear`.
#[test]
fn rotation_is_nearer_to_static_equilibrium_than_linear() {
    let (Some(tube), Some(beam)) = (errors("tube_stvk"), errors("beam_stvk")) else { return };
    let least = |pose: &str| match pose {
        "twist180" => 0.999,
        twist if twist.starts_with("twist") => 3.7,
        _ => 5.2,
    };
    for (pose, [linear, rotation]) in tube.iter().chain(&beam) {
        let factor = linear / rotation;
        assert!(factor > least(pose), "{pose}: better by {factor:.2} only");
    }
    assert!((beam["twist180"][0] / beam["twist180"][1] - 1.0).abs() < 1e-6);
    assert!(tube["bend90"][1] < 1.5e-2 && beam["bend60"][1] < 8e-3 && tube["twist90"][1] < 1e-2);
}
