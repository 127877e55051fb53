//! Loads on bodies that are solved anew, and stress where it is warm: against closed formulas and the linear theory.

use super::loads::{applied, bar, deformer};
use greenstage::deform::{ControlPose, StaticForces, Statics};
use greenstage::effect::Resolved;
use greenstage::effect::stress::StressedBody;
use greenstage::fem::STVK;
use greenstage::solve::Silent;
use nalgebra::{Matrix3, Rotation3, Vector3};

type V3 = Vector3<f64>;

fn statics(keys: &str, element: &str, ends: &[&str]) -> Statics {
    Statics::new(&bar(element, keys, ends), "b", &STVK, &Silent).unwrap()
}

fn acting(coefficients: &[f64]) -> StaticForces {
    StaticForces { coefficients: coefficients.to_vec(), at_nodes: Vec::new() }
}

const WEIGHT: &str = "gravity = true\nload.press = { nodes = { group = \"ymax\" }, kind = \"pressure\" }";

/// Under small loads a body that is solved anew is where the linear theory has it, with the same forces on what holds it, and
/// these bear the weight in any case.
#[test]
fn under_small_loads_a_solved_body_is_the_linear_one() {
    let mut statics = statics(WEIGHT, "tet10", &["xmin", "xmax"]);
    let mut body = deformer(&bar("tet10", WEIGHT, &["xmin", "xmax"]), "linear");
    let loads = [1e-3, -4e-3, 2e-3, 0.3];
    body.apply(&applied(&loads, Vec::new()));
    body.evaluate(&[ControlPose::REST; 2]);
    statics.apply(&acting(&loads)).unwrap();
    let found = statics.solve(&vec![ControlPose::REST; 2], &Silent).unwrap();
    let place = |tag: u64| statics.mesh.tags.iter().position(|own| *own == tag).unwrap();
    let pairs = || body.tags().iter().enumerate().map(|(i, tag)| (i, place(*tag)));
    let largest = pairs().map(|(_, node)| found.displacement[node].norm()).fold(0.0, f64::max);
    for (i, node) in pairs() {
        let apart = (found.displacement[node] - body.displacement(i)).norm();
        assert!(apart < 1e-3 * largest, "{apart} of {largest}");
    }
    let (wrenches, energy) = body.wrenches().unwrap();
    assert!((energy / found.energy - 1.0).abs() < 1e-3, "{energy} {}", found.energy);
    for (linear, solved) in wrenches.iter().zip(&found.wrenches) {
        assert!((linear.force - solved.force).norm() < 1e-3 * solved.force.norm(), "{linear:?} {solved:?}");
        assert!(
            (linear.moment - solved.moment).norm() < 1e-3 * solved.moment.norm(),
            "{linear:?} {solved:?}"
        );
    }
}

/// The ends bear the weight of a body that is bent far and sags far; taken away again, nothing of the loads is left.
#[test]
fn reactions_of_a_solved_body_bear_its_weight() {
    let mut statics = statics("gravity = true", "tet10", &["xmin", "xmax"]);
    let turned = ControlPose {
        translation: V3::new(-0.1, 0.1, 0.0),
        matrix: *Rotation3::from_scaled_axis(V3::new(0.0, 0.2, 0.5)).matrix(),
    };
    let poses = vec![ControlPose::REST, turned];
    let before = statics.solve(&poses, &Silent).unwrap();
    statics.apply(&acting(&[0.0, -9.81, 3.0])).unwrap();
    let found = statics.solve(&poses, &Silent).unwrap();
    let (total, weight) =
        (found.wrenches.iter().map(|w| w.force).sum::<V3>(), V3::new(0.0, 9.81, -3.0) * 40.0);
    assert!((total - weight).norm() < 1e-6 * weight.norm(), "{total} {weight}");
    let sag = found.displacement.iter().zip(&before.displacement).map(|(a, b)| (a - b).norm());
    assert!(sag.fold(0.0, f64::max) > 5e-3, "it sags");
    assert!(found.residual < 1e-9, "{}", found.residual);
    statics.apply(&StaticForces::default()).unwrap();
    let again = statics.solve(&poses, &Silent).unwrap();
    let apart = again.displacement.iter().zip(&before.displacement).map(|(a, b)| (a - b).norm());
    assert!(apart.fold(0.0, f64::max) < 1e-9);
}

/// A free body that is warm is larger by e and bears nothing; one whose ends are held in place along, and go along across,
/// has P = E (1/s² - 1)/(2 s) over the area s² A of its natural shape, s = 1 + e, for ν = 0.
#[test]
fn a_warm_solved_body_has_the_closed_form() {
    for element in ["tet4", "tet4_anp", "tet10"] {
        let mut statics =
            statics("thermal = { expansion = 1e-4, difference = 50 }", element, &["xmin", "xmax"]);
        let (e, s) = (0.02, 1.02_f64);
        statics.apply(&acting(&[e])).unwrap();
        let held = |along: f64| -> Vec<ControlPose> {
            let stretch = Matrix3::from_diagonal(&V3::new(1.0 + along, s, s));
            let of = |origin: V3| ControlPose {
                translation: V3::new(along * origin.x, e * origin.y, e * origin.z),
                matrix: stretch,
            };
            statics.controls.iter().map(|control| of(control.origin)).collect()
        };
        let (free, clamped) = (held(e), held(0.0));
        let found = statics.solve(&free, &Silent).unwrap();
        for (u, x) in found.displacement.iter().zip(&statics.mesh.nodes) {
            assert!((u - x * e).norm() < 1e-9, "{element}: {u} {x}");
        }
        assert!(found.wrenches.iter().all(|w| w.force.norm() < 1e-6), "{element}: {:?}", found.wrenches);
        assert!(found.energy.abs() < 1e-9, "{element}: {}", found.energy);
        let found = statics.solve(&clamped, &Silent).unwrap();
        let exact = 1e6 * 0.04 * s * s * (s.powi(-2) - 1.0) / (2.0 * s);
        let force = found.wrenches[1].force;
        assert!(
            (force.x / exact - 1.0).abs() < 1e-6 && force.yz().norm() < 1e-4,
            "{element}: {force} {exact}"
        );
    }
}

/// A free expansion is no stress; if the body is kept from it there is E e in the middle of a clamped bar.
#[test]
fn warmth_is_no_stress_in_a_free_body_and_e_alpha_t_in_a_clamped_one() {
    let scene = bar("tet10", "thermal = { expansion = 1e-5, difference = 50 }", &["xmin", "xmax"]);
    let mut body = deformer(&scene, "linear");
    let strain = scene.body["b"].loads()[0].start[0];
    body.apply(&applied(&[strain], Vec::new()));
    let mesh = greenstage::green::prepare(&scene, "b").unwrap();
    let held: Vec<&[u32]> = mesh.controls.iter().map(|control| &control.nodes[..]).collect();
    let (surface, stressed) =
        StressedBody::of_mesh(&Resolved::new(scene.clone()).unwrap(), "b", &mesh.mesh, &held).unwrap();
    let tags: Vec<u64> = surface.nodes.iter().map(|&node| mesh.mesh.tags[node as usize]).collect();
    assert_eq!(tags, body.tags(), "the same surface");
    let grown = |origin: V3| ControlPose {
        translation: origin * strain,
        matrix: Matrix3::from_diagonal_element(1.0 + strain),
    };
    let free: Vec<ControlPose> = body.controls.iter().map(|control| grown(control.origin)).collect();
    body.evaluate(&free);
    let none = stressed.stress(&body);
    assert!(none.iter().flatten().count() > 50);
    for at in none.iter().flatten() {
        assert!(at.von_mises < 1e-4 * 1e6 * strain && at.strain.abs() < 1e-4 * strain, "{at:?}");
    }
    body.evaluate(&[ControlPose::REST; 2]);
    let middle = |i: &usize| body.rest()[*i][0].abs() < 0.05;
    let all = stressed.stress(&body);
    let found: Vec<f64> = (0..all.len()).filter(middle).filter_map(|i| Some(all[i]?.von_mises)).collect();
    assert!(!found.is_empty());
    for von_mises in found {
        assert!((von_mises / (1e6 * strain) - 1.0).abs() < 0.02, "{von_mises}");
    }
}

/// A clamped bar that is warmed or cooled by 5 % of its length at once is where ten small steps bring it.
#[test]
fn a_bar_warmed_at_once_is_where_small_steps_bring_it() {
    for element in ["tet4", "tet10"] {
        for e in [-0.05, 0.05] {
            let solved = |steps: usize| {
                let keys = "thermal = { expansion = 1e-4, difference = 50 }";
                let mut statics = statics(keys, element, &["xmin", "xmax"]);
                let rest = vec![ControlPose::REST; 2];
                let mut found = None;
                for step in 1..=steps {
                    statics.apply(&acting(&[e * step as f64 / steps as f64])).unwrap();
                    found = Some(match statics.held().cloned() {
                        Some(before) => statics.solve_after("before", &before, &rest, &Silent).unwrap(),
                        None => statics.solve(&rest, &Silent).unwrap(),
                    });
                }
                found.unwrap()
            };
            let (once, steps) = (solved(1), solved(10));
            println!("{element} {e}: {:?}, {} N", once.counts, once.wrenches[1].force.x);
            let apart = once.displacement.iter().zip(&steps.displacement).map(|(a, b)| (a - b).norm());
            assert!(apart.fold(0.0, f64::max) < 1e-8, "{element} {e}");
            let force = once.wrenches[1].force.x;
            assert!((force - steps.wrenches[1].force.x).abs() < 1e-6 * force.abs(), "{element} {e}: {force}");
            // E e on 0.04 m², less what the Green strain has of second order.
            assert!((force / (-1e6 * e * 0.04) - 1.0).abs() < 0.2, "{element} {e}: {force}");
        }
    }
}
