//! Body loads, force patterns and point forces against closed formulas, equilibrium and fresh solves.

use greenstage::deform::{AppliedLoads, Bearing, ControlPose, Deformer, PointLoad, Pull, find_model};
use greenstage::effect;
use greenstage::fem::{NodeFields, Partition};
use greenstage::green::{
    self, COMPLIANCE, KEPT_FACTOR, LOAD_FIELDS, LOADS, Requirements, STIFFNESS, Solution,
};
use greenstage::scene::{KeptForm, Scene};
use greenstage::solve::{Silent, Solver};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::path::Path;

type V3 = Vector3<f64>;

/// A block of 1 × 0.2 × 0.2 m, held at one end or both, with these further keys.
pub fn bar(element: &str, keys: &str, ends: &[&str]) -> Scene {
    let controls: String = ends
        .iter()
        .map(|end| format!("[body.b.control.{end}]\nnodes = {{ group = \"{end}\" }}\ngrab = \"dragger\"\n"))
        .collect();
    let text = format!(
        "[body.b]\ngenerate = {{ block = {{ size = [1.0, 0.2, 0.2], cells = [5, 1, 1] }} }}\nelement = \"{element}\"\n\
         material = {{ young = 1e6, poisson = 0.0, density = 1000 }}\n{keys}\n{controls}"
    );
    Scene::parse(&text, Path::new("bar.toml")).unwrap()
}

fn solved(scene: &Scene) -> Solution {
    let name = scene.body.keys().next().unwrap();
    green::solve(scene, name, &Requirements::new(&[LOADS, STIFFNESS]), &Silent).unwrap()
}

/// The body of the scene with all that its keys ask for, and its energy.
pub fn deformer(scene: &Scene, model: &str) -> Deformer {
    let name = scene.body.keys().next().unwrap();
    let body = &scene.body[name];
    let entry = find_model(model).unwrap();
    let mut required = effect::requirements(entry, []).and(Requirements::new(entry.energy.unwrap()));
    if !body.loads().is_empty() {
        required = required.and(match entry.loads {
            Bearing::Columns => Requirements::new(&[LOADS]),
            Bearing::Forces(families) => Requirements::new(families),
        });
    }
    if body.surface_compliance.is_some() {
        let kept = body.surface_compliance.as_ref().map(|of| of.kept);
        let family = if kept == Some(KeptForm::Factor) { KEPT_FACTOR } else { COMPLIANCE };
        required = required.and(Requirements::new(&[family]));
    }
    let made = green::precompute(scene, name, &required, &Silent).unwrap();
    Deformer::new(green::opened(&[made]).unwrap(), name, entry).unwrap()
}

pub fn applied(coefficients: &[f64], points: Vec<PointLoad>) -> AppliedLoads {
    AppliedLoads { coefficients: coefficients.to_vec(), points }
}

/// u = ρ g (L s - s²/2)/E: quadratic, so that quadratic elements have it exactly.
#[test]
fn a_bar_hangs_under_its_own_weight() {
    let solution = solved(&bar("tet10", "gravity = true", &["xmin"]));
    let u = &solution.tables[LOAD_FIELDS];
    for (node, x) in solution.mesh.nodes.iter().enumerate() {
        let s = x.x + 0.5;
        let exact = 1000.0 * (s - 0.5 * s * s) / 1e6;
        assert!((u[(3 * node, 0)] - exact).abs() < 1e-13, "{} {exact}", u[(3 * node, 0)]);
        assert!(u[(3 * node + 1, 0)].abs() < 1e-13);
    }
}

/// The end of a cantilever under its weight: q L⁴/(8 E I) of bending, and shear of q L²/(2 κ G A), κ = 5/6
/// (Timoshenko, Strength of Materials I, 3rd ed. 1955, section 39).
#[test]
fn a_cantilever_sags_as_timoshenko_says() {
    let solution = solved(&bar("tet10", "gravity = true", &["xmin"]));
    let u = &solution.tables[LOAD_FIELDS];
    let (area, inertia, q) = (0.04, 0.2_f64.powi(4) / 12.0, 1000.0 * 0.04);
    let exact = q / (8.0 * 1e6 * inertia) + q / (2.0 * (5.0 / 6.0) * 0.5e6 * area);
    let end = (0..solution.mesh.nodes.len()).filter(|&n| solution.mesh.nodes[n].x > 0.5 - 1e-9);
    let sag: Vec<f64> = end.map(|n| u[(3 * n + 1, 1)]).collect();
    let mean = sag.iter().sum::<f64>() / sag.len() as f64;
    assert!((mean / exact - 1.0).abs() < 0.02, "{mean} {exact}");
}

/// u_r = ρ ω² (a linear body force along a bar that turns about its held end): ρ ω² (L² s/2 - s³/6)/E at the nodes of a
/// bar of linear elements, whose nodal values are exact in one dimension; here within the mesh's error.
#[test]
fn a_bar_that_turns_about_its_held_end_grows_longer() {
    let keys = "centrifugal = { axis = [0, 0, 1], point = [-0.5, 0, 0], speed = 2.0 }";
    let solution = solved(&bar("tet10", keys, &["xmin"]));
    let u = &solution.tables[LOAD_FIELDS];
    let tip = (0..solution.mesh.nodes.len()).filter(|&n| solution.mesh.nodes[n].x > 0.5 - 1e-9);
    let tip: Vec<f64> = tip.map(|n| u[(3 * n, 0)]).collect();
    let (mean, exact) = (tip.iter().sum::<f64>() / tip.len() as f64, 1000.0 / 3.0 / 1e6);
    assert!((mean / exact - 1.0).abs() < 2e-3, "{mean} {exact}");
}

#[test]
fn warmth_expands_a_free_body_without_force_and_presses_a_clamped_one() {
    for element in ["tet4", "tet4_anp", "tet10"] {
        let scene = bar(element, "thermal = { expansion = 1e-4, difference = 50 }", &["xmin", "xmax"]);
        let mut body = deformer(&scene, "linear");
        let strain = scene.body["b"].loads()[0].start[0];
        body.apply(&applied(&[strain], Vec::new()));
        let grown = |body: &Deformer, e: usize| ControlPose {
            translation: body.controls[e].origin * strain,
            matrix: Matrix3::from_diagonal_element(1.0 + strain),
        };
        let free = [grown(&body, 0), grown(&body, 1)];
        body.evaluate(&free);
        for i in 0..body.node_count() {
            let exact = Vector3::from(body.rest()[i]).cast::<f64>() * strain;
            assert!((body.displacement(i) - exact).norm() < 1e-9, "{element}");
        }
        let (wrenches, energy) = body.wrenches().unwrap();
        assert!(wrenches.iter().all(|wrench| wrench.force.norm() < 1e-9), "{element}: {wrenches:?}");
        assert!(energy.abs() < 1e-8, "without stress nothing is stored, {element}: {energy}");
        body.evaluate(&[ControlPose::REST; 2]);
        // σ = -E α ΔT on the ends, held across too: the whole end pushes with E A e for ν = 0.
        let force = body.wrenches().unwrap().0[1].force;
        let exact = -1e6 * 0.04 * strain;
        assert!(
            (force.x / exact - 1.0).abs() < 1e-6 && force.yz().norm() < 1e-6,
            "{element}: {force} {exact}"
        );
    }
}

/// Pulled by 1 N an end goes EA/L⁻¹; three shifts do what the pull does along their own axis.
#[test]
fn a_stretched_bar_has_the_stiffness_of_the_book() {
    let pattern = |name: &str, kind: &str| {
        format!("load.{name} = {{ nodes = {{ group = \"xmax\" }}, kind = \"{kind}\" }}\n")
    };
    let keys = pattern("pull", "stretch") + &pattern("aside", "shift");
    let solution = solved(&bar("tet4", &keys, &["xmin"]));
    let u = &solution.tables[LOAD_FIELDS];
    for (node, x) in solution.mesh.nodes.iter().enumerate() {
        let exact = (x.x + 0.5) / (1e6 * 0.04);
        assert!((u[(3 * node, 0)] - exact).abs() < 1e-15 && (u[(3 * node, 1)] - exact).abs() < 1e-15);
        assert!(u[(3 * node + 1, 1)].abs() < 1e-15);
    }
}

fn rod(keys: &str, sizes: &str) -> Scene {
    let text = format!(
        "[body.b]\ngenerate = {{ tube = {{ {sizes}, control_length = 0.0 }} }}\nelement = \"tet10\"\n\
         material = {{ young = 1e6, poisson = 0.3 }}\n{keys}\n\
         [body.b.control.left]\nnodes = {{ group = \"left\" }}\ngrab = \"fixed\"\n"
    );
    Scene::parse(&text, Path::new("rod.toml")).unwrap()
}

/// T L/(G J) with J = π (b⁴ - a⁴)/2.
#[test]
fn a_twisted_rod_has_the_stiffness_of_the_book() {
    let keys = "load.twist = { nodes = { group = \"right\" }, kind = \"twist\" }";
    let sizes = "inner_radius = 0.05, outer_radius = 0.1, length = 0.4, radial = 1, around = 16, along = 4";
    let solution = solved(&rod(keys, sizes));
    let u = &solution.tables[LOAD_FIELDS];
    let j = std::f64::consts::FRAC_PI_2 * (0.1_f64.powi(4) - 0.05_f64.powi(4));
    let exact = 0.4 / (1e6 / 2.6 * j);
    let angle = |(node, x): (usize, &V3)| {
        let around = V3::x().cross(x);
        let moved = V3::new(u[(3 * node, 0)], u[(3 * node + 1, 0)], u[(3 * node + 2, 0)]);
        moved.dot(&around) / around.norm_squared()
    };
    let end = solution.mesh.nodes.iter().enumerate().filter(|(_, x)| x.x > 0.2 - 1e-9);
    let angles: Vec<f64> = end.map(angle).collect();
    let mean = angles.iter().sum::<f64>() / angles.len() as f64;
    assert!((mean / exact - 1.0).abs() < 0.012, "{mean} {exact}");
}

/// Lamé's cylinder in the middle of a tube whose ends are held: of u = A r + B/r, B = (1 + ν) p a² b²/(E (b² - a²)) whatever
/// the strain along the axis (Timoshenko and Goodier, Theory of Elasticity, section 28).
#[test]
fn a_tube_under_pressure_widens_as_lames_cylinder() {
    let keys = "load.inside = { nodes = { group = \"inner\" }, kind = \"pressure\" }\n\
                [body.b.control.right]\nnodes = { group = \"right\" }\ngrab = \"fixed\"";
    let sizes = "inner_radius = 0.5, outer_radius = 1.0, length = 8.0, radial = 2, around = 16, along = 8";
    let solution = solved(&rod(keys, sizes));
    let u = &solution.tables[LOAD_FIELDS];
    let (e, nu, a2, b2) = (1e6, 0.3, 0.25, 1.0);
    let mean = |radius: f64| {
        let is_there = |x: &V3| x.x.abs() < 1e-9 && (x.yz().norm() - radius).abs() < 1e-6;
        let nodes = solution.mesh.nodes.iter().enumerate().filter(|(_, x)| is_there(x));
        let radial = nodes.map(|(n, x)| (u[(3 * n + 1, 0)] * x.y + u[(3 * n + 2, 0)] * x.z) / radius);
        let radial: Vec<f64> = radial.collect();
        radial.iter().sum::<f64>() / radial.len() as f64
    };
    let exact = (1.0 + nu) * a2 * b2 / (e * (b2 - a2));
    let found = (mean(0.5) / 0.5 - mean(1.0)) / (1.0 / a2 - 1.0 / b2);
    assert!((found / exact - 1.0).abs() < 0.02, "{found} {exact}");
}

const ALL: &str = "gravity = true\nsurface_compliance = { nodes = \"surface\" }\n\
                   load.press = { nodes = { group = \"ymax\" }, kind = \"shift\" }";

/// A column of the compliance is a fresh solve with that force, and the same both ways.
#[test]
fn a_point_force_does_what_a_fresh_solve_says() {
    for kept in ["\"inverse\"", "\"factor\""] {
        let all = ALL.replace("\"surface\"", &format!("\"surface\", kept = {kept}"));
        point_force_as_by_a_fresh_solve(&bar("tet10", &all, &["xmin", "xmax"]));
    }
}

fn point_force_as_by_a_fresh_solve(scene: &Scene) {
    let prepared = green::prepare(scene, "b").unwrap();
    let element = scene.body["b"].element;
    let k = element.assemble(&prepared.mesh, &prepared.lame).unwrap();
    let held = prepared.controls.iter().flat_map(|control| control.nodes.iter().copied());
    let partition = Partition::new(prepared.mesh.nodes.len(), held);
    let a = partition.a(&k);
    let solver = Solver::default().analyse(&a, &Silent).unwrap();
    let factor = solver.factor(&a, &Silent).unwrap();
    let mut body = deformer(scene, "linear");
    let takes: Vec<u32> = body.takes_forces().into_iter().collect();
    let (one, other) = (takes[3], takes[takes.len() - 2]);
    let force = V3::new(0.4, -1.0, 0.7);
    let push = |node: u32, force: V3| PointLoad {
        nodes: [node; 3],
        weights: [1.0, 0.0, 0.0],
        pull: Pull::Force(force),
    };
    let index = |node: u32| {
        let tag = body.tags()[node as usize];
        prepared.mesh.tags.iter().position(|known| *known == tag).unwrap() as u32
    };
    let place = |node: u32| partition.free.binary_search(&index(node)).unwrap();
    let mut rhs = NodeFields::zeros(partition.free.len(), 1);
    (0..3).for_each(|axis| rhs.row_mut(3 * place(one) + axis)[0] = force[axis]);
    let (x, _) = factor.solve(&rhs, &Silent).unwrap();
    let exact: Vec<(u32, V3)> =
        takes.iter().map(|&node| (node, V3::from_fn(|axis, _| x.row(3 * place(node) + axis)[0]))).collect();
    let largest = exact.iter().map(|(_, u)| u.norm()).fold(0.0, f64::max);
    body.apply(&applied(&[], vec![push(one, force)]));
    body.evaluate(&[ControlPose::REST; 2]);
    for (node, u) in &exact {
        let found = body.displacement(*node as usize);
        assert!((found - u).norm() < 1e-6 * largest, "{node}: {found} {u}");
    }
    let there = body.displacement(other as usize);
    body.apply(&applied(&[], vec![push(other, V3::z())]));
    body.evaluate(&[ControlPose::REST; 2]);
    let back = body.displacement(one as usize).dot(&force);
    assert!((there.z - back).abs() < 1e-6 * largest, "{} {back}", there.z);
}

/// (1 - ν²) F/(π E r) on the surface of a half-space (Johnson, Contact Mechanics, section 3.2); differences, so that what the
/// block's size adds falls out.
#[test]
fn a_point_force_on_a_large_block_is_boussinesqs() {
    let text = "[body.b]\ngenerate = { block = { size = [4.0, 4.0, 2.4], cells = [10, 10, 6] } }\nelement = \"tet10\"\n\
                material = { young = 1e6, poisson = 0.3 }\n\
                surface_compliance = { nodes = { sphere = { centre = [0, 0, 1.2], radius = 0.01 } } }\n\
                [body.b.control.below]\nnodes = { group = \"zmin\" }\ngrab = \"fixed\"\n";
    let mut body = deformer(&Scene::parse(text, Path::new("block.toml")).unwrap(), "linear");
    let node = *body.takes_forces().first().unwrap();
    let point = PointLoad { nodes: [node; 3], weights: [1.0, 0.0, 0.0], pull: Pull::Force(-V3::z()) };
    body.apply(&applied(&[], vec![point]));
    body.evaluate(&[ControlPose::REST]);
    let at = |x: f64, y: f64| {
        let place = V3::new(x, y, 1.2);
        let is_there = |i: &usize| (Vector3::from(body.rest()[*i]).cast::<f64>() - place).norm() < 1e-5;
        body.displacement((0..body.node_count()).find(is_there).unwrap()).z
    };
    let exact = |r: f64| -(1.0 - 0.09) / (std::f64::consts::PI * 1e6 * r);
    for (near, far) in [((0.4, 0.0), (0.8, 0.0)), ((0.0, 0.4), (0.0, 1.0)), ((0.4, 0.4), (0.8, 0.8))] {
        let found = at(near.0, near.1) - at(far.0, far.1);
        let book = exact(f64::hypot(near.0, near.1)) - exact(f64::hypot(far.0, far.1));
        assert!((found / book - 1.0).abs() < 0.12, "{near:?} {far:?}: {found} {book}");
    }
}

fn bent(body: &Deformer) -> [ControlPose; 2] {
    let turn = Rotation3::from_scaled_axis(V3::new(0.3, 0.2, 0.7));
    let origin = body.controls[1].origin;
    let start = Rotation3::from_scaled_axis(V3::new(-0.1, 0.3, 0.1));
    [
        ControlPose { translation: V3::new(0.01, 0.0, -0.02), matrix: *start.matrix() },
        ControlPose {
            translation: turn * origin - origin + V3::new(-0.05, 0.1, 0.02),
            matrix: turn.matrix() * Matrix3::from_diagonal(&V3::new(1.05, 0.97, 1.0)),
        },
    ]
}

/// Forces are the derivatives of the energy: gravity and a shift keep their directions while the body is bent and turned, a
/// spring pulls at a point, and a force at another.
#[test]
fn forces_of_loaded_bodies_are_the_gradient_of_their_energy() {
    for model in ["linear", "rotation"] {
        let mut body = deformer(&bar("tet4", ALL, &["xmin", "xmax"]), model);
        let takes: Vec<u32> = body.takes_forces().into_iter().collect();
        let point = |i: usize, pull| PointLoad {
            nodes: [takes[i], takes[i + 1], takes[i + 2]],
            weights: [0.5, 0.3, 0.2],
            pull,
        };
        let place = V3::new(0.1, 0.3, -0.2);
        let points = vec![
            point(2, Pull::Force(V3::new(20.0, -30.0, 10.0))),
            point(5, Pull::Towards { place, spring: Some(300.0) }),
        ];
        body.apply(&applied(&[3.0, -9.81, 1.0, 40.0, 70.0, -20.0], points));
        let poses = bent(&body);
        let energy_and = |body: &mut Deformer, poses: &[ControlPose]| {
            body.evaluate(poses);
            body.wrenches().unwrap()
        };
        let (wrenches, _) = energy_and(&mut body, &poses);
        let scale = wrenches.iter().map(|wrench| wrench.force.norm()).fold(0.0, f64::max);
        for e in 0..2 {
            for axis in 0..3 {
                let mut along = |by: f64, turn: f64| {
                    let mut moved = poses;
                    let rotation = Rotation3::from_scaled_axis(V3::ith(axis, turn));
                    // About where the origin rested, as moments are.
                    moved[e].translation = rotation * moved[e].translation + V3::ith(axis, by);
                    moved[e].matrix = rotation.matrix() * moved[e].matrix;
                    energy_and(&mut body, &moved).1
                };
                let step = 1e-5;
                let force = (along(step, 0.0) - along(-step, 0.0)) / (2.0 * step);
                let moment = (along(0.0, step) - along(0.0, -step)) / (2.0 * step);
                let [found_f, found_m] = [wrenches[e].force[axis], wrenches[e].moment[axis]];
                assert!((found_f - force).abs() < 2e-5 * scale, "{model} {e} {axis}: {found_f} {force}");
                assert!((found_m - moment).abs() < 2e-5 * scale, "{model} {e} {axis}: {found_m} {moment}");
            }
        }
    }
}

/// The forces that hold a body bear its weight, however it is turned.
#[test]
fn reactions_bear_the_weight() {
    for model in ["linear", "rotation"] {
        let mut body = deformer(&bar("tet4", ALL, &["xmin", "xmax"]), model);
        body.apply(&applied(&[0.0, -9.81, 0.0, 0.0, 5.0, 0.0], Vec::new()));
        let poses = bent(&body);
        body.evaluate(&poses);
        let total: V3 = body.wrenches().unwrap().0.iter().map(|wrench| wrench.force).sum();
        let weight = V3::new(0.0, 1000.0 * 0.04 * 9.81 - 5.0, 0.0);
        assert!((total - weight).norm() < 1e-6 * weight.norm(), "{model}: {total} {weight}");
    }
}

/// Two points that are held without a spring come to their places together, in a body that is bent and under load.
#[test]
fn held_points_are_where_they_are_held() {
    let mut body = deformer(&bar("tet10", ALL, &["xmin", "xmax"]), "rotation");
    let takes: Vec<u32> = body.takes_forces().into_iter().collect();
    let poses = bent(&body);
    let places = [V3::new(0.02, 0.25, -0.05), V3::new(-0.1, 0.1, 0.2)];
    let corners = |i: usize| [takes[i], takes[i + 9], takes[i + 20]];
    let points = [0, 1].map(|i| PointLoad {
        nodes: corners(7 * i),
        weights: [0.2, 0.3, 0.5],
        pull: Pull::Towards { place: places[i], spring: None },
    });
    body.apply(&applied(&[0.0, -9.81, 0.0, 0.0, 5.0, 0.0], points.to_vec()));
    body.evaluate(&poses);
    for (i, point) in points.iter().enumerate() {
        let told = body.point_results()[i];
        let shown: V3 = point
            .nodes
            .iter()
            .zip(point.weights)
            .map(|(&n, w)| {
                (Vector3::from(body.rest()[n as usize]).cast::<f64>() + body.displacement(n as usize)) * w
            })
            .sum();
        assert!((told.place - places[i]).norm() < 1e-7, "{} {}", told.place, places[i]);
        assert!((shown - places[i]).norm() < 2e-6, "{shown} {}", places[i]);
        assert!(told.force.norm() > 1.0);
    }
}
