//! Losses of static equilibrium, and the messages about them.

use super::{law, pulled};
use greenstage::deform::{Branch, ControlPose, CriticalPose, Statics, StaticsError};
use greenstage::fem::LAWS;
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;

/// The critical pose of a body `shape` on the way to `pose` of its first control element, its share of the way, and the message: of a body
/// that goes on beyond it, and of one that has no equilibrium there.
fn critical(shape: &str, model: &str, pose: ControlPose) -> (CriticalPose, f64, String) {
    let scene = format!("[body.b]\nmaterial = {{ young = 1.0e6, poisson = 0.3 }}\n{shape}");
    let scene = Scene::parse(&scene, Path::new("critical.toml")).unwrap();
    let mut statics = Statics::new(&scene, "b", law(model), &Silent).unwrap();
    let (critical, said) = match statics.solve(&pulled(&[(0, pose)]), &Silent) {
        Ok(found) => {
            let stability = found.stability;
            println!(
                "{model}: {:?}, {} passed, {:?}",
                stability.branch,
                stability.passed.len(),
                found.counts
            );
            assert!(stability.branch == Branch::Buckled && found.inverted.is_empty());
            (
                stability.passed[0].clone(),
                format!("{}. {}", stability.passed[0], stability.passed[0].details()),
            )
        }
        Err(error) => {
            let said = error.to_string();
            let StaticsError::Stopped { critical: Some(critical), .. } = error else { panic!("{said}") };
            (*critical, said)
        }
    };
    println!("{model}: {said}");
    let share = critical.share;
    assert!(critical.is_critical, "{said}");
    // The bracket of the halving and the extrapolated eigenvalue agree.
    let zero_at = critical.zero_at.unwrap().0;
    assert!((zero_at - share).abs() < 2.0 / 4096.0, "{share} and {zero_at}");
    assert!(critical.least < 0.01, "{}", critical.least);
    (critical, share, said)
}

fn block(size: [f64; 3], cells: [u32; 3]) -> String {
    format!(
        "generate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n"
    )
}

/// Euler's column, clamped at both ends: it buckles at the strain 4π² I/(A L²), 3.3 % where L = 10 h. Linear tetrahedra are
/// too stiff in bending, the less the finer the mesh; the mode moves the middle across.
#[test]
fn a_pressed_column_buckles_at_eulers_load() {
    let euler = std::f64::consts::PI.powi(2) / 300.0;
    for law in LAWS {
        let strain = |cells: [u32; 3]| {
            let press = ControlPose { translation: Vector3::x() * -0.06, ..ControlPose::REST };
            let (critical, share, said) = critical(&block([1.0, 0.1, 0.1], cells), law.name, press);
            assert!(said.contains("the body buckles") && !critical.snaps, "{said}");
            let shape = &critical.shape;
            assert!(shape.along < 0.03 && (0.3..0.7).contains(&shape.spread), "{said}");
            assert!(shape.place.x.abs() < 0.06, "the middle moves most: {said}");
            0.06 * share / euler
        };
        let (coarse, fine) = (strain([20, 2, 2]), strain([40, 4, 4]));
        println!("{}: {coarse:.3} and {fine:.3} of Euler's strain", law.name);
        assert!(coarse > fine && fine > 1.0 && fine < 1.15, "{}: {coarse} and {fine}", law.name);
    }
}

/// A pressed cube of St. Venant–Kirchhoff material snaps along the way that it is pressed.
#[test]
fn a_pressed_cube_snaps() {
    let press = ControlPose { translation: Vector3::x() * -0.6, ..ControlPose::REST };
    let (critical, share, said) = critical(&block([1.0; 3], [4; 3]), "stvk", press);
    assert!(critical.snaps && critical.shape.along > 0.8 && said.contains("snaps"), "{said}");
    assert!((0.3..0.4).contains(&(0.6 * share)) && said.contains("gives way under compression"), "{said}");
}

/// A short, thin tube twisted until its wall buckles, in two modes that differ by a turn about the axis alone: the angle
/// is named, and compression is not blamed.
#[test]
fn a_twisted_tubes_critical_angle_is_named() {
    let tube = "generate = { tube = { inner_radius = 0.085, outer_radius = 0.1, length = 0.6, radial = 1, around = 24, along \
                = 24, control_length = 0.1 } }\n\
                control.right = { nodes = { group = \"right\" }, grab = \"dragger\" }\n\
                control.left = { nodes = { group = \"left\" }, grab = \"fixed\" }\n";
    let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), 2.6).matrix();
    let (critical, share, said) = critical(tube, "neo_hookean", ControlPose { matrix, ..ControlPose::REST });
    assert!((critical.turn - 2.6 * share).abs() < 1e-9, "{said}");
    assert!(said.contains(&format!("right turned by {:.1}°", critical.turn.to_degrees())), "{said}");
    assert!(said.contains("the body buckles"), "{said}");
    assert!(critical.modes == 2 && critical.shape.along < 0.2, "{said}");
    assert!(critical.shape.place.x.abs() < 0.1, "the wall moves most between the ends: {said}");
}
