//! Static equilibrium at large strain: against independently computed solutions, closed forms, rigid motions, and its
//! own rate of convergence.

mod after;
mod cases;
mod critical;
mod elements;
use crate::common::{attempt, block_scene, folder, greenstage};
use greenstage::deform::{ControlPose, ControlPoses, EquilibriumResult, Statics, StaticsError};
use greenstage::fem::{
    self, ELEMENTS, Hyperelastic, LAWS, Lame, Law, NEO_HOOKEAN, NodeFields, Partition, STVK,
};
use greenstage::mesh::{TetMesh, generate, quadratic};
use greenstage::scene::Scene;
use greenstage::solve::{LAST_STEP, Newton, Setback, Silent, Solver};
use nalgebra::{Matrix3, Rotation3, Vector3};

fn law(name: &str) -> &'static Law {
    LAWS.iter().find(|law| law.name == name).unwrap()
}

fn pulled(poses: &[(usize, ControlPose)]) -> ControlPoses {
    let mut all = vec![ControlPose::REST; 2];
    poses.iter().for_each(|(e, pose)| all[*e] = *pose);
    all
}

fn block(law: &'static Law, cells: [u32; 3]) -> Statics {
    Statics::new(&block_scene(cells, ""), "block", law, &Silent).unwrap()
}

/// The ends of a bar of side 1 pulled apart and let contract as the closed form has it: E = ½(λ*² - 1) along, -ν E
/// across, force E (λ*³ - λ*)/2 on the area 1.
#[test]
fn bar_pulled_and_pressed_has_the_closed_forms_force_and_energy() {
    let mut statics = block(&STVK, [5, 4, 4]);
    let (young, poisson) = (1e3, 0.3);
    for stretch in [0.75, 0.9, 1.3, 2.0] {
        let strain = 0.5 * (stretch * stretch - 1.0f64);
        let across = (1.0 - 2.0 * poisson * strain).sqrt();
        let matrix = Matrix3::from_diagonal(&Vector3::new(stretch, across, across));
        let half = Vector3::x() * (0.5 * (stretch - 1.0));
        let pose = |translation| ControlPose { translation, matrix };
        let settled = statics.solve(&pulled(&[(0, pose(half)), (1, pose(-half))]), &Silent).unwrap();
        let force = 0.5 * young * (stretch.powi(3) - stretch);
        let expected = [Vector3::x() * force, Vector3::x() * -force];
        for (wrench, expected) in settled.wrenches.iter().zip(expected) {
            assert!((wrench.force - expected).norm() < 1e-11 * force.abs(), "{stretch}: {wrench:?}");
        }
        let energy = 0.5 * young * strain * strain;
        assert!((settled.energy - energy).abs() < 1e-12 * energy, "{stretch}: {} J", settled.energy);
    }
}

fn rigid(statics: &Statics, turn: Rotation3<f64>, shift: Vector3<f64>, poses: &ControlPoses) -> ControlPoses {
    let turned = |(control, pose): (&greenstage::green::ControlElement, &ControlPose)| ControlPose {
        translation: turn * (control.origin + pose.translation) + shift - control.origin,
        matrix: turn * pose.matrix,
    };
    statics.controls.iter().zip(poses).map(turned).collect()
}

#[test]
fn rigid_motion_costs_nothing_and_turns_the_answer() {
    let (turn, shift) =
        (Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 2.0)), Vector3::new(0.3, -2.0, 0.7));
    for law in LAWS {
        let mut statics = block(law, [4, 4, 4]);
        let moved = |statics: &Statics, settled: &EquilibriumResult| -> Vec<Vector3<f64>> {
            statics.mesh.nodes.iter().zip(&settled.displacement).map(|(x, u)| x + u).collect()
        };
        let still = statics.solve(&rigid(&statics, turn, shift, &pulled(&[])), &Silent).unwrap();
        let both = moved(&statics, &still).into_iter().zip(&statics.mesh.nodes);
        let off = both.map(|(x, rest)| (x - turn * rest - shift).norm()).fold(0.0, f64::max);
        let force = still.wrenches[0].force.norm();
        println!("{}: rigid motion off by {off:.1e} m, {:.1e} J, {force:.1e} N", law.name, still.energy);
        // Rounding: 1e-15 of Young's modulus 1e3 Pa on 1 m³, 1e-13 of it on 1 m².
        assert!(off < 1e-13 && still.energy < 1e-12 && force < 1e-10, "{}", law.name);

        for size in [1.0, 1e-6] {
            let sheared = ControlPose {
                translation: Vector3::new(0.05, 0.2, 0.0) * size,
                matrix: *Rotation3::from_axis_angle(&Vector3::x_axis(), 0.5 * size).matrix(),
            };
            let poses = pulled(&[(0, sheared)]);
            let straight = statics.solve(&poses, &Silent).unwrap();
            let turned = statics.solve(&rigid(&statics, turn, shift, &poses), &Silent).unwrap();
            let both = moved(&statics, &straight).into_iter().zip(moved(&statics, &turned));
            let off = both.map(|(a, b)| (turn * a + shift - b).norm()).fold(0.0, f64::max);
            let energy = (straight.energy - turned.energy).abs();
            let (a, b) = (straight.wrenches[0].force, turned.wrenches[0].force);
            let force = (turn * a - b).norm();
            println!("{}: {size} turned: off by {off:.1e} m, {energy:.1e} J, {force:.1e} N", law.name);
            assert!(off < 1e-12 && energy < 1e-12 && force < 1e-10, "{}: {off:e}", law.name);
        }
    }
}

/// The displacements that the linear theory has for control element 0 moved by `shift` and turned by `turn`.
fn linear_answer(statics: &Statics, shift: Vector3<f64>, turn: Vector3<f64>) -> Vec<Vector3<f64>> {
    let mesh = &statics.mesh;
    let k = fem::TET4.assemble(mesh, &vec![Lame::from_young_poisson(1e3, 0.3); mesh.tets.len()]).unwrap();
    let controlled = statics.controls.iter().flat_map(|control| control.nodes.iter().copied());
    let partition = Partition::new(mesh.nodes.len(), controlled);
    let mut u = NodeFields::zeros(mesh.nodes.len(), 1);
    let control = &statics.controls[0];
    for &node in &control.nodes {
        let moved = shift + turn.cross(&(mesh.nodes[node as usize] - control.origin));
        u.data[3 * node as usize..][..3].copy_from_slice(moved.as_slice());
    }
    let a = partition.a(&k);
    let solver = Solver::default().analyse(&a, &Silent).unwrap();
    let factor = solver.factor(&a, &Silent).unwrap();
    let (free, _) = factor.solve(&partition.minus_b_times(&k, &u), &Silent).unwrap();
    partition.insert_free(&free, &mut u);
    u.data.chunks(3).map(Vector3::from_column_slice).collect()
}

/// Poses from a picometre and a picoradian up: each has its equilibrium, which tends to the linear theory's as the pose
/// does to rest, u/s - u' = O(s), down to rounding of u itself.
#[test]
fn poses_near_rest_have_the_linear_theorys_answer() {
    let (shift, turn) = (Vector3::new(-0.05, 0.2, 0.1), Vector3::new(0.3, 0.2, -0.35));
    for law in LAWS {
        let mut statics = block(law, [4, 4, 4]);
        for (what, shift, turn) in
            [("shift", shift, Vector3::zeros()), ("turn", Vector3::zeros(), turn), ("both", shift, turn)]
        {
            let linear = linear_answer(&statics, shift, turn);
            let size = linear.iter().map(|u| u.norm()).fold(0.0, f64::max);
            let mut off = |s: f64| {
                let matrix = *Rotation3::from_scaled_axis(turn * s).matrix();
                let pose = ControlPose { translation: shift * s, matrix };
                let settled = match statics.solve(&pulled(&[(0, pose)]), &Silent) {
                    Ok(settled) => settled,
                    Err(error) => panic!("{}: {what} of {s:e}: {error}", law.name),
                };
                let both = settled.displacement.iter().zip(&linear);
                both.map(|(u, linear)| (u / s - linear).norm()).fold(0.0, f64::max) / size
            };
            let found: Vec<f64> = (0..=12).map(|i| off(0.1f64.powi(i))).collect();
            let shown: Vec<String> = found.iter().map(|off| format!("{off:.1e}")).collect();
            println!("{}: {what}: {}", law.name, shown.join(" "));
            for (i, pair) in (1..).zip(found[1..6].windows(2)) {
                let rate = (pair[0] / pair[1]).log10();
                assert!((rate - 1.0).abs() < 0.1, "{}: {what} of 1e-{i}: order {rate}", law.name);
            }
            // A matrix tells cos s from 1 to 1e-16 alone, which is 1e-16/s of the turn.
            for (i, off) in (0..).zip(&found) {
                assert!(*off < 3.0 * 0.1f64.powi(i) + 1e-14, "{}: {what} of 1e-{i}: {off:e}", law.name);
            }
        }
        let rest = statics.solve(&pulled(&[]), &Silent).unwrap();
        assert!(rest.displacement.iter().all(|u| *u == Vector3::zeros()) && rest.energy == 0.0);
    }
}

/// Far from the origin and turned, a strain of any size has its equilibrium; displacements have the rounding of the shift.
#[test]
fn a_small_strain_in_a_body_moved_far_has_its_equilibrium() {
    let turn = Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 0.6));
    for law in LAWS {
        let mut statics = block(law, [4, 4, 4]);
        for far in [1.0, 1e3, 1e6] {
            let shift = Vector3::new(0.3, -2.0, 0.7) * far;
            for size in [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0] {
                let sheared = ControlPose {
                    translation: Vector3::new(0.05, 0.2, 0.0) * size,
                    matrix: *Rotation3::from_axis_angle(&Vector3::x_axis(), 0.5 * size).matrix(),
                };
                let poses = pulled(&[(0, sheared)]);
                let straight = statics.solve(&poses, &Silent).unwrap();
                let turned = match statics.solve(&rigid(&statics, turn, shift, &poses), &Silent) {
                    Ok(turned) => turned,
                    Err(error) => panic!("{}: {size:e} at {far:e} m: {error}", law.name),
                };
                let place = |settled: &EquilibriumResult, node: usize| {
                    statics.mesh.nodes[node] + settled.displacement[node]
                };
                let off = |node: usize| (turn * place(&straight, node) + shift - place(&turned, node)).norm();
                let off = (0..statics.mesh.nodes.len()).map(off).fold(0.0, f64::max);
                println!("{}: {size:e} at {far:e} m: off by {off:.1e} m", law.name);
                assert!(off < 1e-14 * shift.norm().max(1.0), "{}: {size:e} at {far:e} m: {off:e}", law.name);
            }
        }
    }
}

/// Inner nodes follow an affine boundary, whatever the law: the patch test at large strain, F that of the samples.
#[test]
fn patch_test_at_large_strain() {
    let linear: TetMesh =
        generate::block(&generate::Block { size: [1.0, 0.8, 1.2], cells: [4, 4, 4] }).unwrap();
    let h = Matrix3::new(0.2, 0.1, -0.05, 0.2, -0.1, 0.15, -0.1, 0.05, 0.1);
    let half = Vector3::new(0.5, 0.4, 0.6);
    for (law, element) in LAWS.iter().flat_map(|law| ELEMENTS.iter().map(move |element| (law, element))) {
        let mesh = match element.order {
            1 => linear.clone(),
            _ => quadratic(linear.clone(), &quadratic::straight),
        };
        let lame = vec![Lame { lambda: 2.0, mu: 1.0 }; mesh.tets.len()];
        let outside = (0..mesh.nodes.len() as u32).filter(|&node| {
            (0..3).any(|axis| mesh.nodes[node as usize][axis].abs() > half[axis] * (1.0 - 1e-9))
        });
        let partition = Partition::new(mesh.nodes.len(), outside);
        assert_eq!(partition.free.len(), if element.order == 1 { 27 } else { 279 });
        let body = Hyperelastic::new(element, law, &mesh, &lame).unwrap();
        let rest = NodeFields::zeros(mesh.nodes.len(), 1);
        let k = body.tangent(&body.gradients(&rest));
        let solver = Solver::default().analyse(&partition.a(&k), &Silent).unwrap();
        let newton = Newton {
            body: &body,
            partition: &partition,
            solver: Some(solver.as_ref()),
            loads: None,
            last_step: LAST_STEP,
        };
        let path = |share: f64, u: &mut NodeFields| {
            for &node in &partition.controlled {
                let at = h * mesh.nodes[node as usize] * share;
                u.data[3 * node as usize..][..3].copy_from_slice(at.as_slice());
            }
        };
        let found = newton.follow(rest, 1, &path, &Silent).unwrap();
        let off = found.equilibrium.gradients.iter().map(|found| (found - h).amax()).fold(0.0, f64::max);
        assert!(off < 1e-12, "{} {}: {off:e}", law.name, element.name);
        let energy = 0.96 * (law.energy)(&h, lame[0]);
        assert!((found.equilibrium.energy - energy).abs() < 1e-12 * energy, "{} {}", law.name, element.name);
    }
}

/// The factors of the body at rest, of the first iterations and of the equilibrium; the steps between take an old one.
#[test]
fn newton_converges_with_few_factors() {
    for law in LAWS {
        let mut statics = block(law, [5, 4, 4]);
        let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), 0.5).matrix();
        let pose = ControlPose { translation: Vector3::new(-0.05, 0.2, 0.0), matrix };
        let EquilibriumResult { counts, residual, .. } =
            statics.solve(&pulled(&[(0, pose)]), &Silent).unwrap();
        let shown: Vec<String> = counts.moves.iter().map(|size| format!("{size:.1e}")).collect();
        println!(
            "{}: {}, moves {}, residual {residual:.1e}",
            law.name,
            counts.factorizations,
            shown.join(" ")
        );
        assert!(
            counts.steps == 1 && counts.factorizations <= 5 && residual < 1e-14,
            "{}: {counts:?}",
            law.name
        );
    }
}

/// A clamped cube pressed beyond what St. Venant–Kirchhoff material bears, somewhere between 70 and 60 % of its height:
/// said with share, det F and place; the next pose is none the worse; a neo-Hookean cube bears it.
#[test]
fn collapse_under_compression_is_said_and_not_answered() {
    let press = |height: f64| {
        pulled(&[(0, ControlPose { translation: Vector3::x() * (height - 1.0), ..ControlPose::REST })])
    };
    let mut statics = block(&STVK, [4, 4, 4]);
    let before = statics.solve(&press(0.8), &Silent).unwrap();
    let error = statics.solve(&press(0.4), &Silent).unwrap_err();
    println!("{error}");
    let text = error.to_string();
    assert!(text.contains("% of the way from") && text.contains("neo_hookean"), "{text}");
    let details = error.details().unwrap();
    for words in ["Least det F: 0.", "[", "of 320 tetrahedra"] {
        assert!(details.contains(words), "{details} lacks {words}");
    }
    let StaticsError::Stopped { settled, share, from, why, .. } = error else { panic!("{text}") };
    assert_eq!((from.as_str(), why), ("the last pose", Setback::Unstable));
    let reached = 0.8 - 0.4 * share;
    assert!((0.6..0.7).contains(&reached), "{reached}");
    assert!(settled.inverted.is_empty() && settled.residual < 1e-10);

    let after = statics.solve(&press(0.8), &Silent).unwrap();
    let off =
        before.displacement.iter().zip(&after.displacement).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(off < 1e-13, "{off:e}");
    assert!(block(&NEO_HOOKEAN, [4, 4, 4]).solve(&press(0.4), &Silent).unwrap().inverted.is_empty());
}

#[test]
fn solutions_have_the_same_bits_on_every_thread_count_and_rest_is_rest() {
    let pose = ControlPose {
        translation: Vector3::new(0.1, 0.1, 0.0),
        matrix: *Rotation3::from_axis_angle(&Vector3::x_axis(), 1.0).matrix(),
    };
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| block(&STVK, [4, 4, 3]).solve(&pulled(&[(0, pose)]), &Silent).unwrap())
    };
    assert!(with(1) == with(3));
    let rest = block(&STVK, [3, 3, 3]).solve(&pulled(&[]), &Silent).unwrap();
    assert!(rest.displacement.iter().all(|u| *u == Vector3::zeros()));
    assert_eq!(
        (rest.energy, rest.residual, rest.least_det.0, rest.counts.factorizations),
        (0.0, 0.0, 1.0, 0)
    );
    // One cell has no free node.
    let held = block(&STVK, [1, 1, 1]).solve(&pulled(&[(0, pose)]), &Silent).unwrap();
    assert!(held.energy > 0.0 && held.residual == 0.0);
}

const TWO: &str = r#"
[body.hard]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [3, 3, 3] } }
material = { young = 1.0e3, poisson = 0.3 }
model = "stvk"
control.high = { nodes = { group = "xmax" }, grab = "dragger" }
control.low = { nodes = { group = "xmin" }, grab = "fixed" }
[body.soft]
generate = { block = { size = [1.0, 1.0, 1.0], cells = [3, 3, 3] } }
material = { young = 1.0e3, poisson = 0.3 }
control.high = { nodes = { group = "xmax" }, grab = "dragger" }
control.low = { nodes = { group = "xmin" }, grab = "fixed" }
"#;
const POSES: &str = r#"
pose = [
    { name = "pull", body = "soft", control.high = { translation = [0.1, 0.0, 0.0] } },
    { name = "pull", body = "hard", control.high = { translation = [0.1, 0.0, 0.0] } },
]
"#;

/// A static body has no part in the .green file; a linear one sees no Newton.
#[test]
fn each_model_of_a_scene_costs_what_it_needs_and_no_more() {
    let place = folder("statics-deform");
    std::fs::write(place.join("two.toml"), TWO).unwrap();
    std::fs::write(place.join("poses.toml"), POSES).unwrap();
    let output =
        greenstage(&place, &["deform", "two.toml", "--poses", "poses.toml", "-o", "out", "--verbose"]);
    let (out, progress) =
        (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(out.contains("hard  load steps  factorizations  residual  least det F"), "{out}");
    let steps = |body: &str, step: &str| progress.contains(&format!("{body}  {step}"));
    assert!(steps("hard", "Newton") && !steps("soft", "Newton"), "{progress}");
    assert!(steps("soft", "factorization") && !steps("hard", "factorization"), "{progress}");
    let file = greenstage::green::GreenFile::open(&place.join("two.green")).unwrap();
    assert_eq!(file.meta.bodies.keys().collect::<Vec<_>>(), ["soft"]);

    let displacements = std::fs::read_to_string(place.join("out.csv")).unwrap();
    let of = |body: &str| displacements.lines().filter(|line| line.starts_with(body)).count();
    // Of the 64 nodes 56 lie on the surface; the poses stand in the order of the file.
    assert_eq!((of("pull/hard"), of("pull/soft")), (64, 56));
    assert!(displacements.find("pull/soft") < displacements.find("pull/hard"));
    let forces = std::fs::read_to_string(place.join("out.forces.csv")).unwrap();
    let first: Vec<&str> = forces.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((forces.lines().count(), first[..2].join(",").as_str()), (3, "pull/hard,high"), "{forces}");
    assert!(first[2].parse::<f64>().unwrap() > 50.0);
}

const PRESSED: &str = r#"
pose = [
    { name = "pull", body = "hard", control.high = { translation = [0.1, 0.0, 0.0] } },
    { name = "flat", body = "hard", control.high = { translation = [-0.9, 0.0, 0.0] } },
    { name = "flat", body = "soft", control.high = { translation = [-0.9, 0.0, 0.0] } },
    { name = "push", body = "hard", control.high = { translation = [-0.1, 0.0, 0.0] } },
]
"#;

/// A pose without an equilibrium is named, and the others of the batch are written.
#[test]
fn a_pose_without_equilibrium_leaves_the_others_of_the_batch() {
    let place = folder("statics-batch");
    std::fs::write(place.join("two.toml"), TWO).unwrap();
    std::fs::write(place.join("poses.toml"), PRESSED).unwrap();
    let deform = |poses: &str, out: &str| {
        let output = attempt(&place, &["deform", "two.toml", "--poses", poses, "-o", out]);
        (output.status.code(), [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()))
    };
    let (status, [told, said]) = deform("poses.toml", "out");
    assert_eq!(status, Some(1), "{said}");
    for words in ["pose \"flat\": body.hard: no equilibrium beyond", "% of the way from", "neo_hookean"] {
        assert_eq!(said.matches(words).count(), 1, "{said} lacks {words}");
    }
    assert!(!said.contains("pose \"pull\"") && !said.contains("pose \"push\""), "{said}");
    let row = told.lines().find(|line| line.starts_with("flat")).unwrap();
    assert!(told.contains("push") && row.contains("none beyond"), "{told}");
    let first = |file: &str| -> Vec<String> {
        let text = std::fs::read_to_string(place.join(file)).unwrap();
        let mut names: Vec<String> =
            text.lines().skip(1).map(|line| line.split(',').next().unwrap().to_owned()).collect();
        names.dedup();
        names
    };
    assert_eq!(first("out.csv"), ["pull/hard", "flat/soft", "push/hard"]);
    assert_eq!(first("out.forces.csv"), ["pull/hard", "push/hard"]);
    let vtu = std::fs::read(place.join("out.vtu")).unwrap();
    let vtu = String::from_utf8_lossy(&vtu);
    assert!(["pull", "flat", "push"].iter().all(|pose| vtu.contains(&format!("displacement {pose}"))));

    // Nothing is written where nothing is found.
    let flat =
        "pose = [{ name = \"flat\", body = \"hard\", control.high = { translation = [-0.9, 0.0, 0.0] } }]";
    std::fs::write(place.join("flat.toml"), flat).unwrap();
    let (status, [_, said]) = deform("flat.toml", "none");
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("pose \"flat\": body.hard: no equilibrium beyond"), "{said}");
    assert!(!place.join("none.csv").exists() && !place.join("none.vtu").exists());
}

/// A matrix of 190° is one of -170°: a note reports which was taken, and there is none where there is no doubt.
#[test]
fn turns_near_half_a_turn_are_told_as_they_were_taken() {
    let place = folder("statics-half-turn");
    std::fs::write(place.join("two.toml"), TWO.replace("model = \"stvk\"", "model = \"neo_hookean\""))
        .unwrap();
    let matrix = |degrees: f64| {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        format!("matrix = [[1, 0, 0], [0, {cosine:?}, {:?}], [0, {sine:?}, {cosine:?}]]", -sine)
    };
    let said = |name: &str, high: f64, low: f64| {
        let pose = format!(
            "pose = [{{ name = \"{name}\", body = \"hard\", control.high = {{ {} }}, control.low = {{ {} }} }}]",
            matrix(high),
            matrix(low)
        );
        std::fs::write(place.join("poses.toml"), pose).unwrap();
        let output = attempt(&place, &["deform", "two.toml", "--poses", "poses.toml", "-o", "out"]);
        String::from_utf8(output.stderr).unwrap()
    };
    let told = said("far", 190.0, 0.0);
    for words in ["pose \"far\"", "body.hard", "high", "low", "170.0°", "190.0° the other way"] {
        assert!(told.contains(words), "{told} lacks {words}");
    }
    let told = said("both", 100.0, -100.0);
    assert!(told.contains("200.0°") && told.contains("160.0° the other way"), "{told}");
    for (high, low) in [(90.0, 0.0), (175.0, 175.0)] {
        let told = said("near", high, low);
        assert!(!told.contains("the other way"), "{high}, {low}: {told}");
    }
}

#[test]
fn what_a_model_of_large_strain_does_not_have_is_refused_before_anything_is_computed() {
    let place = folder("statics-online");
    let text = TWO.replacen("model = \"stvk\"", "model = \"stvk\"\nsolver = { method = \"pcg\" }", 1);
    std::fs::write(place.join("two.toml"), text).unwrap();
    for command in [&["view", "two.toml"][..], &["render", "two.toml", "-o", "out"], &["bench", "two.toml"]] {
        let output = attempt(&place, command);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{command:?}: {said}");
        assert!(said.contains("body.hard.solver") && said.contains("\"cholesky\""), "{command:?}: {said}");
        assert!(!place.join("two.green").exists() && !said.contains("assembly"), "{command:?}: {said}");
    }
    let scene = Scene::load(&place.join("two.toml")).unwrap();
    let said = Statics::new(&scene, "hard", &STVK, &Silent).err().unwrap().to_string();
    assert!(said.contains("body.hard.solver") && said.contains("\"cholesky\""), "{said}");
}
