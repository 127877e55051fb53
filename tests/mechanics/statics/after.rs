//! Poses that go on from others: turns add up.

use super::{law, pulled};
use crate::common::{folder, greenstage};
use greenstage::deform::{ControlPose, EquilibriumResult, Statics};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;

const BEAM: &str = r#"
[body.b]
generate = { block = { size = [1.0, 0.1, 0.1], cells = [20, 2, 2] } }
material = { young = 1.0e6, poisson = 0.3 }
control.high = { nodes = { group = "xmax" }, grab = "dragger" }
control.low = { nodes = { group = "xmin" }, grab = "fixed" }
"#;

/// A beam twisted through these angles, each from the one before; energy and torque at the end.
fn twisted(statics: &mut Statics, degrees: &[f64]) -> EquilibriumResult {
    let pose = |degrees: f64| {
        let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), degrees.to_radians()).matrix();
        pulled(&[(0, ControlPose { matrix, ..ControlPose::REST })])
    };
    let mut found = statics.solve(&pose(degrees[0]), &Silent).unwrap();
    for &next in &degrees[1..] {
        let held = statics.held().unwrap().clone();
        found = statics.solve_after("before", &held, &pose(next), &Silent).unwrap();
    }
    found
}

#[test]
fn a_turn_in_steps_is_the_turn_at_once_and_a_whole_turn_is_not_rest() {
    let scene = Scene::parse(BEAM, Path::new("after.toml")).unwrap();
    for model in ["stvk", "neo_hookean", "corotational"] {
        let mut statics = Statics::new(&scene, "b", law(model), &Silent).unwrap();
        let at_once = twisted(&mut statics, &[150.0]);
        let in_steps = twisted(&mut statics, &[50.0, 100.0, 150.0]);
        assert!((in_steps.energy / at_once.energy - 1.0).abs() < 1e-10, "{model}");

        let [whole, other] =
            [1.0, -1.0].map(|way| twisted(&mut statics, &[120.0 * way, 240.0 * way, 360.0 * way]));
        println!("{model}: 150° {:.6e} J, 360° {:.6e} J", at_once.energy, whole.energy);
        // Saint-Venant's torsion: the energy goes with the square of the angle, and a little less at large strain.
        let ratio = whole.energy / at_once.energy / (360.0f64 / 150.0).powi(2);
        assert!((0.9..1.1).contains(&ratio), "{model}: {ratio}");
        let (torque, back) = (whole.wrenches[0].moment.x, other.wrenches[0].moment.x);
        assert!(torque > 0.0 && (torque + back).abs() < 1e-8 * torque, "{model}: {torque} and {back}");

        // What goes on from no pose knows nothing of those turns.
        let rest = statics.solve(&pulled(&[]), &Silent).unwrap();
        assert!(rest.energy == 0.0, "{model}: {} J", rest.energy);
    }
}

/// Turns add up through files too, beside an online model that follows turns.
#[test]
fn deform_adds_up_the_turns_of_poses_that_go_on_from_each_other() {
    let place = folder("statics-after");
    let online = BEAM.replace("body.b", "body.online").replace("control.", "model = \"rotation\"\ncontrol.");
    let online = online.replacen("model = \"rotation\"\ncontrol.low", "control.low", 1);
    let statics = BEAM.replacen("control.", "model = \"stvk\"\ncontrol.", 1);
    std::fs::write(place.join("two.toml"), format!("{statics}{online}")).unwrap();
    let mut poses = String::new();
    for body in ["b", "online"] {
        for (name, after, degrees) in
            [("third", "", 120.0), ("two", "third", 240.0), ("far", "two", 300.0), ("rest", "", 360.0)]
        {
            let (sine, cosine) = f64::to_radians(degrees).sin_cos();
            let after = if after.is_empty() { String::new() } else { format!("after = \"{after}\"\n") };
            poses += &format!(
                "[[pose]]\nname = \"{name}\"\nbody = \"{body}\"\n{after}control.high = {{ matrix = [[1, 0, 0], [0, \
                 {cosine:?}, {:?}], [0, {sine:?}, {cosine:?}]] }}\n",
                -sine
            );
        }
    }
    std::fs::write(place.join("poses.toml"), poses).unwrap();
    let output = greenstage(&place, &["deform", "two.toml", "--poses", "poses.toml", "-o", "out"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let forces = std::fs::read_to_string(place.join("out.forces.csv")).unwrap();
    let energy = |row: &str| -> f64 {
        let line = forces.lines().find(|line| line.starts_with(row)).unwrap();
        line.split(',').next_back().unwrap().parse().unwrap()
    };
    let (third, far) = (energy("third/b"), energy("far/b"));
    assert!((far / third - 6.25).abs() < 0.625 && energy("rest/b") < 1e-20 * far, "{forces}");

    // With the model `rotation`, the middle of the body turns by half: nearly back to front after 300°.
    let moved = std::fs::read_to_string(place.join("out.csv")).unwrap();
    let largest = |of: &str| {
        let rows = moved.lines().filter(|line| line.starts_with(of));
        let size =
            |line: &str| line.split(',').skip(2).map(|u| u.parse::<f64>().unwrap().abs()).fold(0.0, f64::max);
        rows.map(size).fold(0.0, f64::max)
    };
    assert!(largest("far/online") > 0.09 && largest("rest/online") < 1e-6, "{}", largest("far/online"));
}
