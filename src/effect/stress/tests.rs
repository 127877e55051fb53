//! Stress against that of bodies that were solved, and in sessions and damaged files.

use super::stressed_body::{StressedBody, written};
use crate::base::legend::Legend;
use crate::deform::{AppliedLoads, ControlPose, Deformer, LINEAR};
use crate::effect::{EFFECTS, Resolved, RunningEffect, add_sections, attach, file_of};
use crate::fem::NodeFields;
use crate::green::{self, Precomputed, Tensor};
use crate::render::Drawable;
use crate::scene::Limit;
use crate::solve::Silent;
use crate::stage::Stage;
use crate::track::TrackerState;
use crate::world::World;
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

const INNER: f64 = 0.5;
const OUTER: f64 = 1.0;
const YOUNG: f64 = 1e9;
const PRESSURE: f64 = 1e3;

fn scene(text: &str) -> Resolved {
    Resolved::parse(text, Path::new("test.toml")).unwrap()
}

/// A tube whose inner wall moves as pressure moves it, ends free.
fn tube(size: u32, element: &str, poisson: f64) -> Resolved {
    scene(&format!(
        "[body.b]\ngenerate = {{ tube = {{ inner_radius = {INNER}, outer_radius = {OUTER}, length = 1.0, radial = {size}, \
         around = {}, along = {}, control_length = 0.1 }} }}\nelement = \"{element}\"\n\
         material = {{ young = {YOUNG}, poisson = {poisson} }}\neffects = [\"stress\"]\n\
         control.inner = {{ nodes = {{ group = \"inner\" }}, grab = \"dragger\" }}\n",
        12 * size,
        2 * size
    ))
}

fn made(scene: &Resolved) -> Precomputed {
    let required = scene.requirements("b").unwrap();
    let mut made = green::precompute(scene, "b", &required, &Silent).unwrap();
    add_sections(scene, &mut made, &Silent).unwrap();
    made
}

/// Errors on the outer wall, away from the ends: of this recovery, and of the mean over the tetrahedra around each node.
fn errors(size: u32, element: &str, poisson: f64) -> [f64; 2] {
    let scene = tube(size, element, poisson);
    let made = made(&scene);
    let file = green::opened(std::slice::from_ref(&made)).unwrap();
    // Lamé with free ends (Timoshenko and Goodier, article 28): σ_θ = 2 p a² / (b² - a²) at r = b, σ_r = σ_z = 0.
    let ring = OUTER * OUTER - INNER * INNER;
    let hoop = 2.0 * PRESSURE * INNER * INNER / ring;
    let radial = PRESSURE / YOUNG * ((INNER * INNER + OUTER * OUTER) / ring + poisson);
    let along = -poisson * hoop / YOUNG;
    let moved = Vector3::new(along, radial, radial);
    let matrix = Matrix3::from_diagonal(&moved.add_scalar(1.0));
    let pose = ControlPose { matrix, ..ControlPose::REST };
    let mut deformer = Deformer::new(file.clone(), "b", &LINEAR).unwrap();
    deformer.evaluate(&[pose]);
    let stressed = StressedBody::of_file(&scene, &file, "b").unwrap();
    let found = stressed.stress(&deformer);

    let solution = &made.solution;
    let mesh = &solution.mesh;
    let c = pose.coefficients();
    let value = |row: usize| solution.fields.row(row).iter().zip(&c).map(|(u, c)| u * c).sum::<f64>();
    let fields = NodeFields {
        nodes: mesh.nodes.len(),
        columns: 1,
        data: (0..3 * mesh.nodes.len()).map(value).collect(),
    };
    let lame = vec![scene.body["b"].material.lame(); mesh.tets.len()];
    let points = solution.element.points(mesh, &lame).unwrap();
    let mut sums = vec![(Matrix3::zeros(), 0.0); mesh.nodes.len()];
    for (point, h) in points.displacement_gradients(&fields).iter().enumerate() {
        let strain = (h + h.transpose()) * 0.5;
        let lame = points.lame(point);
        let stress = strain * (2.0 * lame.mu) + Matrix3::from_diagonal_element(lame.lambda * strain.trace());
        for &node in points.nodes_of(points.element_of(point)) {
            let sum = &mut sums[node as usize];
            *sum = (sum.0 + stress * points.volume[point], sum.1 + points.volume[point]);
        }
    }
    let of_volume = |(sum, volume): &(Matrix3<f64>, f64)| {
        let stress = sum / *volume;
        let deviator = stress - Matrix3::from_diagonal_element(stress.trace() / 3.0);
        (1.5 * deviator.norm_squared()).sqrt()
    };
    let mut worst = [0.0_f64; 2];
    for (i, &node) in solution.surface.nodes.iter().enumerate() {
        let place = mesh.nodes[node as usize];
        if place.y.hypot(place.z) < OUTER - 1e-6 || place.x.abs() > 0.3 {
            continue;
        }
        let values = [found[i].unwrap().von_mises, of_volume(&sums[node as usize])];
        worst = [0, 1].map(|k| worst[k].max((values[k] / hoop - 1.0).abs()));
    }
    worst
}

#[test]
fn a_pressed_tube_that_was_solved_has_the_stress_of_lame() {
    let [coarse, fine] = [2, 4].map(|size| errors(size, "tet4", 0.3));
    println!("surface, volume: {coarse:?}, {fine:?}");
    assert!(fine[0] < 0.04 && (coarse[0] / fine[0]).log2() > 1.5, "{coarse:?}, {fine:?}");
    assert!(fine[0] < 0.2 * fine[1], "better than the mean over the tetrahedra: {fine:?}");
    for (element, most) in [("tet10", 0.03), ("tet4_anp", 0.2)] {
        let [found, _] = errors(2, element, 0.499);
        println!("{element}, ν = 0.499: {found:.4}");
        assert!(found < most, "{element}: {found}");
    }
}

/// Largest and least von Mises stress of the deformed body under these loads, over the nodes of the surface that `is_meant`.
fn extremes(scene: &Resolved, coefficients: &[f64], is_meant: impl Fn(&Vector3<f64>) -> bool) -> [f64; 2] {
    let made = made(scene);
    let file = green::opened(std::slice::from_ref(&made)).unwrap();
    let mut deformer = Deformer::new(file.clone(), "b", &LINEAR).unwrap();
    deformer.apply(&AppliedLoads { coefficients: coefficients.to_vec(), points: Vec::new() });
    deformer.evaluate(&[ControlPose::REST]);
    let found = StressedBody::of_file(scene, &file, "b").unwrap().stress(&deformer);
    let solution = &made.solution;
    let meant = solution.surface.nodes.iter().zip(&found);
    let meant = meant.filter(|(node, _)| is_meant(&solution.mesh.nodes[**node as usize]));
    meant.fold([f64::INFINITY, 0.0], |[least, most], (_, at)| {
        let value = at.unwrap().von_mises;
        [least.min(value), most.max(value)]
    })
}

/// The wall on which the pressure acts: σ_r = -p, σ_θ = p (b² + a²)/(b² - a²) inside; pressed on both walls all over, -p in
/// the plane and nothing along the axis (Timoshenko and Goodier, article 28). Far from the end that is held: what it does fades
/// within √(radius · wall) of some 0.6 m.
#[test]
fn pressure_is_stress_in_the_wall_on_which_it_acts() {
    let scene = scene(&format!(
        "[body.b]\ngenerate = {{ tube = {{ inner_radius = {INNER}, outer_radius = {OUTER}, length = 4.0, radial = 2, around = 32, \
         along = 16, control_length = 0.0 }} }}\nelement = \"tet10\"\nmaterial = {{ young = {YOUNG}, poisson = 0.3 }}\neffects = [\"stress\"]\n\
         load.inside = {{ nodes = {{ group = \"inner\" }}, kind = \"pressure\" }}\n\
         load.outside = {{ nodes = {{ group = \"outer\" }}, kind = \"pressure\" }}\n\
         control.left = {{ nodes = {{ group = \"left\" }}, grab = \"fixed\" }}\n"
    ));
    let (a2, b2) = (INNER * INNER, OUTER * OUTER);
    let hoop = (b2 + a2) / (b2 - a2);
    let inner = (0.5 * ((hoop + 1.0).powi(2) + hoop * hoop + 1.0)).sqrt();
    let is_inside = |x: &Vector3<f64>| (0.5..1.9).contains(&x.x) && x.y.hypot(x.z) < INNER + 1e-6;
    let is_amid = |x: &Vector3<f64>| (0.5..1.9).contains(&x.x);
    for (pressures, expected, is_meant) in [
        ([PRESSURE, 0.0], inner, &is_inside as &dyn Fn(&Vector3<f64>) -> bool),
        ([PRESSURE, PRESSURE], 1.0, &is_amid),
    ] {
        let found = extremes(&scene, &pressures, is_meant).map(|value| value / PRESSURE / expected);
        println!("{pressures:?}: {found:?} of Lamé's");
        assert!(found[0] > 0.97 && found[1] < 1.03, "{found:?}");
    }
}

/// A column that stands on its foot, pulled at its head: σ = F/A up to the face that is pulled.
#[test]
fn a_pulled_face_has_the_stress_of_its_pull() {
    let scene = scene(
        "[body.b]\ngenerate = { block = { size = [3.0, 1.0, 1.0], cells = [12, 4, 4] } }\nelement = \"tet10\"\n\
         material = { young = 1.0e9, poisson = 0.3 }\neffects = [\"stress\"]\n\
         load.pull = { nodes = { group = \"xmax\" }, kind = \"stretch\" }\n\
         control.foot = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n",
    );
    let found = extremes(&scene, &[1e3], |x| x.x > 1.0);
    assert!(found.iter().all(|value| (value / 1e3 - 1.0).abs() < 0.01), "{found:?}");
}

const BAR: &str = "[body.b]\n\
    generate = { block = { size = [2.0, 1.0, 1.0], cells = [4, 2, 2] } }\n\
    material = { young = 1.0e9, poisson = 0.3, limit = { stress = 1.0e6 } }\neffects = [\"stress\"]\n\
    control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
    control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

/// The newest.
fn legend_of(world: &World) -> Legend {
    world.frame.all(Drawable::plate).filter_map(|plate| plate.legend.clone()).last().unwrap()
}

#[test]
fn a_session_says_where_the_limit_is_passed_and_shows_another_field() {
    let scene = scene(BAR);
    let file = file_of(&scene).unwrap();
    let mut world = World::new(&scene, &scene.models(), &file, Stage::find("desktop").unwrap()).unwrap();
    let mut running = attach(EFFECTS, &scene, &file, &mut world).unwrap();
    let [effect] = &mut running[..] else { panic!() };
    world.show_by(effect.as_mut());
    assert!(world.frame.bodies[0].colours.as_ref().unwrap().iter().all(|code| *code == [0; 4]), "at rest");
    let legend = legend_of(&world);
    assert_eq!(
        (legend.title.as_str(), legend.to, legend.range.as_str()),
        ("von Mises stress", 1e6, "the limit")
    );

    // Pulled by 1 %: some 10 MPa.
    let mut poses = world.bodies[0].deformer.poses.clone();
    poses[1].translation.x = 0.02;
    world.bodies[0].deformer.evaluate(&poses);
    world.bodies[0].deformations += 1;
    world.show_by(effect.as_mut());
    let line = legend_of(&world).lines[0].clone();
    assert!(
        line.warns && line.text.contains("limit 1.00 MPa PASSED in 100 % of the surface"),
        "{}",
        line.text
    );
    assert!(world.warnings.iter().any(|(_, warning)| warning.contains("body.b: its limit of 1.00 MPa")));
    let codes = world.frame.bodies[0].colours.clone().unwrap();
    assert!(codes.iter().filter(|code| code[..2] != [0, 0]).count() == 40);
    world.field_changes += 1;
    world.show_by(effect.as_mut());
    let legend = legend_of(&world);
    assert_eq!(
        (legend.title.as_str(), legend.range.as_str()),
        ("largest principal strain", "largest so far (C: reset)")
    );
    assert!((0.01..0.03).contains(&legend.to) && legend.lines[0].warns, "{legend:?}");
    assert_ne!(world.frame.bodies[0].colours.as_ref().unwrap(), &codes);
    world.step(&TrackerState::default().into());
    world.show_by(effect.as_mut());
    let before = world.frame.bodies[0].clone();
    world.show_by(effect.as_mut());
    assert!(world.frame.bodies[0].is_drawn_as(&before), "nothing is coded anew where nothing changed");
    let summary = effect.summary();
    assert!(
        summary.starts_with("body.b: von Mises stress at most 1")
            && summary.contains("above its 1.00 MPa limit on 100 % of the surface"),
        "{summary}"
    );
}

/// The legend kept the values of a body that had been bent beyond its model, and nothing brought its range back.
#[test]
fn the_range_of_colours_takes_no_values_from_beyond_the_model_and_is_reset_by_a_key() {
    let scene = scene(&BAR.replace(", limit = { stress = 1.0e6 }", ""));
    let file = file_of(&scene).unwrap();
    let mut world = World::new(&scene, &scene.models(), &file, Stage::find("desktop").unwrap()).unwrap();
    let mut running = attach(EFFECTS, &scene, &file, &mut world).unwrap();
    let [effect] = &mut running[..] else { panic!() };
    let rest = world.bodies[0].deformer.poses.clone();
    let pose = |turn_deg: f64, pull_m: f64, world: &mut World, effect: &mut Box<dyn RunningEffect>| {
        let mut poses = rest.clone();
        poses[1].translation.x = pull_m;
        poses[1].matrix =
            *nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn_deg.to_radians()).matrix();
        world.bodies[0].deformer.evaluate(&poses);
        world.bodies[0].deformations += 1;
        world.show_by(effect.as_mut());
        legend_of(world)
    };
    let [small, large] = [0.001, 0.01].map(|pull| pose(0.0, pull, &mut world, effect).to);
    assert!(large > 5.0 * small, "it grows: {small}, {large}");
    let beyond = pose(120.0, 0.0, &mut world, effect);
    assert_eq!(beyond.to, large);
    let told = "b: deformed too far for its model, values not reliable";
    assert!(beyond.lines[0].warns && beyond.lines[0].text == told, "{:?}", beyond.lines[0]);
    assert!(
        world.frame.bodies[0].colours.as_ref().unwrap().iter().any(|code| code[0] > 0),
        "its colours remain"
    );
    assert_eq!(pose(0.0, 0.001, &mut world, effect).to, large);
    effect.clear();
    world.show_by(effect.as_mut());
    assert_eq!(legend_of(&world).to, small);
    let summary = effect.summary();
    assert!(summary.contains("poses beyond the range of its model are left out"), "{summary}");
}

#[test]
fn a_section_that_does_not_fit_is_refused() {
    let scene = scene(BAR);
    let mut made = made(&scene);
    for numbers in [vec![0_u8; 3], vec![1; made.solution.surface.triangles.len()]] {
        made.sections.insert("stress/material".into(), Tensor::new(&[numbers.len()], numbers));
        let file = green::opened(std::slice::from_ref(&made)).unwrap();
        let error = StressedBody::of_file(&scene, &file, "b").err().unwrap().to_string();
        assert!(error.contains("b/stress/material does not number the body's materials"), "{error}");
    }
    assert_eq!(written(Limit::Strain(0.3)), "30.0 %");
}

/// A state is taken back whose count of deformations is by chance that of the body: colours are those of its own shape.
#[test]
fn a_state_that_is_taken_back_is_coded_anew() {
    let scene = scene(BAR);
    let file = file_of(&scene).unwrap();
    let mut world = World::new(&scene, &scene.models(), &file, Stage::find("desktop").unwrap()).unwrap();
    let mut running = attach(EFFECTS, &scene, &file, &mut world).unwrap();
    let [effect] = &mut running[..] else { panic!() };
    let is_at_rest = |world: &World| {
        world.frame.bodies[0].colours.as_ref().is_some_and(|codes| codes.iter().all(|code| *code == [0; 4]))
    };
    world.show_by(effect.as_mut());
    let (rest, memory) = (world.bodies[0].deformer.poses.clone(), effect.memory().unwrap());
    let mut pulled = rest.clone();
    pulled[1].translation.x = 0.02;
    world.bodies[0].deformer.evaluate(&pulled);
    world.bodies[0].deformations += 1;
    world.show_by(effect.as_mut());
    assert!(!is_at_rest(&world));
    world.bodies[0].deformer.evaluate(&rest);
    effect.set_memory(&memory).unwrap();
    world.show_by(effect.as_mut());
    assert!(is_at_rest(&world));
}
