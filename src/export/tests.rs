//! `deform` from a scene and a pose file, against beams and against what is found by hand from unit poses.

use super::batch::solve;
use super::shape::Shape;
use super::{Files, PoseRequest, ResultSet, ask};
use crate::deform::{Wrench, pose_file};
use crate::prepare::Resolved;
use nalgebra::{Matrix6, Vector6};
use std::path::Path;

const YOUNG: f64 = 1.0e6;
/// Length and side, m.
const BEAM: [f64; 2] = [1.0, 0.1];

fn solved(model: &str, element: &str, poses: &str) -> ResultSet {
    let [length, side] = BEAM;
    let scene = format!(
        "[body.beam]\n\
         generate = {{ block = {{ size = [{length}, {side}, {side}], cells = [10, 1, 1] }} }}\n\
         material = {{ young = {YOUNG}, poisson = 0.0 }}\n\
         element = \"{element}\"\n\
         model = \"{model}\"\n\
         effects = [\"haptics\"]\n\
         control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
    );
    let scene = Resolved::parse(&scene, Path::new("beam.toml")).unwrap();
    let path = Path::new("poses.toml");
    let poses = pose_file::parse(poses, path).unwrap();
    let asked: Vec<PoseRequest<'_>> = poses.iter().map(|pose| ask(&scene, pose, path).unwrap()).collect();
    solve(&scene, &asked, None, model == "linear").unwrap().0
}

/// The wrench that holds the right end about its place, and those that hold both ends about one point.
fn right(set: &ResultSet, pose: usize) -> (Wrench, [Wrench; 2]) {
    let result = &set.results[pose];
    let [(_, left), (_, right)] = &result.wrenches.as_ref().unwrap().controls[..] else { panic!() };
    let about = |wrench: &Wrench, e: usize| Wrench {
        moment: wrench.moment + result.told.places[e].cross(&wrench.force),
        ..*wrench
    };
    (right.about_the_place(&result.told.control[1]), [about(left, 0), about(right, 1)])
}

const PUSHED: &str = "[[pose]]\nname = \"guided\"\ncontrol.right = { translation = [0.0, 0.0, 1e-4] }\n\
                      [[pose]]\nname = \"free\"\n\
                      control.right = { translation = [0.0, 0.0, 1e-4], free = [\"rotation\", \"x\", \"y\"] }\n\
                      [[pose]]\nname = \"pushed\"\ncontrol.right = { force = [0.0, 0.0, 2.5e-3] }\n";

/// Timoshenko's beam: w / F = L³ / 3 EI + L / κ G A where the end may turn, L³ / 12 EI + L / κ G A where it may not
/// (Timoshenko and Gere, Mechanics of Materials, sections 9.3 and 9.10 of the first edition).
#[test]
fn a_free_end_and_a_guided_one_are_timoshenkos() {
    let set = solved("linear", "tet10", PUSHED);
    let [length, side] = BEAM;
    let (bending, shear) =
        (length.powi(3) / (YOUNG * side.powi(4) / 12.0), length / (5.0 / 6.0 * 0.5 * YOUNG * side * side));
    let stiffness = |pose: usize| right(&set, pose).0.force.z / 1e-4;
    for (pose, flexibility) in [(0, bending / 12.0 + shear), (1, bending / 3.0 + shear)] {
        let ratio = stiffness(pose) * flexibility;
        assert!((ratio - 1.0).abs() < 0.03, "{pose}: {ratio}");
    }
    let (held, both) = right(&set, 1);
    assert!(held.moment.norm() < 1e-9 && held.force.xy().norm() < 1e-9, "{held:?}");
    assert!((both[0].force + both[1].force).norm() < 1e-6 * held.force.z, "action and reaction");
    assert!((both[0].moment + both[1].moment).norm() < 1e-6 * held.force.z);
    // The force that was found for a shift finds that shift.
    let pushed = set.results[2].told.control[1].translation;
    assert!((pushed.z * stiffness(1) / 2.5e-3 - 1.0).abs() < 1e-4, "{pushed}");
}

/// The pose by hand: six unit poses, and the free components out of their 6 × 6 matrix.
#[test]
fn a_free_end_is_what_six_unit_poses_give() {
    let mut poses = PUSHED.to_owned();
    let unit = 1e-6;
    for k in 0..6 {
        let mut pose = crate::deform::ControlPose::REST;
        if k < 3 {
            pose.translation[k] = unit;
        } else {
            pose.matrix += nalgebra::Vector3::ith(k - 3, unit).cross_matrix();
        }
        let (t, m) = (pose.translation, pose.matrix);
        let rows: Vec<String> =
            (0..3).map(|i| format!("[{:?}, {:?}, {:?}]", m[(i, 0)], m[(i, 1)], m[(i, 2)])).collect();
        poses += &format!(
            "[[pose]]\nname = \"{k}\"\ncontrol.right = {{ translation = [{:?}, {:?}, {:?}], matrix = [{}] }}\n",
            t.x,
            t.y,
            t.z,
            rows.join(", ")
        );
    }
    let set = solved("linear", "tet4", &poses);
    let columns: Vec<Vector6<f64>> = (0..6)
        .map(|k| {
            let (held, _) = right(&set, 3 + k);
            Vector6::from_iterator(held.force.iter().chain(held.moment.iter()).map(|x| x / unit))
        })
        .collect();
    let compliance = Matrix6::from_columns(&columns).try_inverse().unwrap();
    let force = 1e-4 / compliance[(2, 2)];
    let found = right(&set, 1).0.force.z;
    assert!((found / force - 1.0).abs() < 1e-3, "{found} {force}");
    // Of large strain too, where the pose is small.
    let of_law = solved("stvk", "tet4", PUSHED);
    for pose in 0..3 {
        let (law, linear) = (right(&of_law, pose).0.force.z, right(&set, pose).0.force.z);
        assert!((law / linear - 1.0).abs() < 1e-3, "{pose}: {law} {linear}");
    }
}

/// A clamped bar that is warm by e bears -E e along; pushed by δ it yields where E (e + δ/L) reaches the limit. The way is
/// found from there, and a replay of the poses that were written gives the same.
#[test]
fn first_yield_counts_the_loads_and_found_poses_keep_them() {
    let text = |model: &str, limit: f64| {
        format!(
            "[body.bar]\ngenerate = {{ block = {{ size = [4.0, 1.0, 1.0], cells = [4, 1, 1] }} }}\n\
             material = {{ young = {YOUNG}, poisson = 0.0, limit = {{ stress = {limit} }}, density = 1.0 }}\n\
             element = \"tet10\"\nmodel = \"{model}\"\neffects = [\"haptics\", \"stress\"]\ngravity = true\n\
             thermal = {{ expansion = 1e-5, difference = 40 }}\n\
             load.side = {{ nodes = {{ group = \"ymax\" }}, kind = \"shift\" }}\n\
             control.left = {{ nodes = {{ box = {{ min = [-3, -1, -1], max = [-1.9, 1, 1] }} }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
        )
    };
    let path = Path::new("poses.toml");
    let run = |scene: &str, poses: &str| {
        let scene = Resolved::parse(scene, Path::new("bar.toml")).unwrap();
        let poses = pose_file::parse(poses, path).unwrap();
        let asked: Vec<PoseRequest<'_>> = poses.iter().map(|pose| ask(&scene, pose, path).unwrap()).collect();
        solve(&scene, &asked, None, scene.body["bar"].model == "linear").unwrap().0
    };
    // Ends that go along across, so that the stress is the same everywhere.
    let e = 4e-4;
    let across = format!("[[1.0, 0, 0], [0, {0}, 0], [0, 0, {0}]]", 1.0 + e);
    let pushed = format!(
        "[[pose]]\nname = \"pushed\"\nload.gravity = [0, 0, 0]\ncontrol.left = {{ matrix = {across} }}\n\
         control.right = {{ translation = [-4e-3, 0, 0], matrix = {across} }}\n"
    );
    for (model, near) in [("linear", 2e-3), ("stvk", 1e-2)] {
        let set = run(&text(model, 900.0), &pushed);
        let first = set.results[0].told.first_yield.as_ref().unwrap();
        // Warmth alone bears 400 of 900 Pa; how the ends widen on the way adds little.
        let exact = (900.0 / YOUNG - e) * 4.0 / 4e-3;
        assert!((first.share / exact - 1.0).abs() < 0.1, "{model}: {} {exact}", first.share);
        // In that pose, solved by itself, the limit is just reached.
        let scene = Resolved::parse(&text(model, 900.0), Path::new("bar.toml")).unwrap();
        let poses = pose_file::parse(&pushed, path).unwrap();
        let there = first.control.clone();
        let asked =
            PoseRequest { control: there.clone(), given: there, ..ask(&scene, &poses[0], path).unwrap() };
        let at = solve(&scene, &[asked], None, model == "linear").unwrap().0;
        let (part, _) = at.results[0].stress.as_ref().unwrap().reached.limit.unwrap();
        assert!((part - 1.0).abs() < near, "{model}: {part}");
        let alone = run(&text(model, 300.0), &pushed);
        assert_eq!(alone.results[0].told.first_yield.as_ref().unwrap().share, 0.0, "{model}");
    }
    let free = "[[pose]]\nname = \"sags\"\nload.side = [0.1, 2.0, 0.3]\nload.thermal = 7.0\n\
                control.right = { free = [\"translation\", \"rotation\"] }\n";
    for model in ["linear", "stvk"] {
        let set = run(&text(model, 1e9), free);
        let written = String::from_utf8((super::found::POSES.write)(&set)).unwrap();
        let again = run(&text(model, 1e9), &written);
        let [found, replayed] = [&set.results[0], &again.results[0]];
        assert_eq!(found.told.loads, replayed.told.loads, "{written}");
        assert_eq!(found.told.control, replayed.told.control, "{written}");
        let largest = found.displacement.iter().map(|u| u.norm()).fold(0.0, f64::max);
        let apart = found.displacement.iter().zip(&replayed.displacement).map(|(a, b)| (a - b).norm());
        assert!(apart.fold(0.0, f64::max) < 1e-8 * largest && largest > 1e-5, "{model}");
        let right = found.wrenches.as_ref().unwrap().controls[1].1;
        assert!(right.force.norm() < 1e-6, "{model}: nothing holds the free end: {right:?}");
    }
}

/// A cantilever whose end is pushed and free to turn, E I = 1e9 · 0.1 · 0.1³/12: at the clamp σ = 6 F L/(b t²) with F = 3 E I w/L³
/// (Gere and Timoshenko, Mechanics of Materials, appendix G), which by small-strain theory is half a limit of twice that at half the
/// way. The nodes at the clamp are no place where it first yields.
#[test]
fn a_pushed_end_yields_where_linear_theory_says() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[body.bar]\ngenerate = { block = { size = [1.0, 0.1, 0.1], cells = [20, 2, 2] } }\nelement = \"tet10\"\n\
                material = { young = 1e9, poisson = 0.0, limit = { stress = 7.5e5 } }\neffects = [\"haptics\", \"stress\"]\n\
                control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    let poses = "[[pose]]\nname = \"push\"\ncontrol.right = { translation = [0, 0, 0.01], free = [\"rotation\", \"x\", \"y\"] }\n";
    let scene = Resolved::parse(text, &folder.path().join("bar.toml")).unwrap();
    let path = Path::new("poses.toml");
    let poses = pose_file::parse(poses, path).unwrap();
    let asked: Vec<PoseRequest<'_>> = poses.iter().map(|pose| ask(&scene, pose, path).unwrap()).collect();
    let result = solve(&scene, &asked, None, false).unwrap().0.results.remove(0);
    let reached = result.stress.as_ref().unwrap().reached;
    // 3 E t w / (2 L²), less what is left out at the clamp: half an element's length of twenty, and the next.
    let clamp = 1.5 * 1e9 * 0.1 * 0.01;
    let (inside, most) = (reached.inside.von_mises / clamp, reached.von_mises.0 / clamp);
    assert!((0.9..1.0).contains(&inside) && (0.95..1.3).contains(&most), "{inside} {most}");
    let first = result.told.first_yield.as_ref().unwrap();
    let (share, at_edges) =
        (7.5e5 / reached.inside.von_mises, reached.von_mises.0 / reached.inside.von_mises);
    assert!((first.share / share - 1.0).abs() < 4e-3, "{} {share}", first.share);
    assert!((first.at_edges / at_edges - 1.0).abs() < 4e-3, "{} {at_edges}", first.at_edges);
    let force = first.wrenches.as_ref().unwrap()[1].force.z;
    let beam = 3.0 * 1e9 * 0.1_f64.powi(4) / 12.0 * 0.01 * share;
    assert!((force / beam - 1.0).abs() < 0.03, "{force} {beam}");
}

/// Loads, a free end, a pull beyond small strain: with all nodes the same is told, and the same surface is drawn.
#[test]
fn all_nodes_tell_what_the_surface_tells() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[body.bar]\ngenerate = { block = { size = [1.0, 0.1, 0.1], cells = [10, 1, 1] } }\nelement = \"tet10\"\n\
                material = { young = 1e6, poisson = 0.3, density = 1000.0, limit = { stress = 3e4 } }\nmodel = \"linear\"\n\
                effects = [\"haptics\", \"stress\"]\ngravity = true\n\
                control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
    let poses = "[[pose]]\nname = \"sags\"\ncontrol.right = { force = [0, 0, -0.1] }\n\
                 [[pose]]\nname = \"heavy\"\nload.gravity = [0, -40, 0]\ncontrol.right = { force = [0, 0, -0.1] }\n\
                 [[pose]]\nname = \"bent\"\ncontrol.right = { matrix = [[0.88, -0.48, 0], [0.48, 0.88, 0], [0, 0, 1]] }\n\
                 [[pose]]\nname = \"pulled\"\ncontrol.right = { translation = [0.1, 0, 0] }\n";
    let scene = Resolved::parse(text, &folder.path().join("bar.toml")).unwrap();
    let path = Path::new("poses.toml");
    let poses = pose_file::parse(poses, path).unwrap();
    let asked: Vec<PoseRequest<'_>> = poses.iter().map(|pose| ask(&scene, pose, path).unwrap()).collect();
    let [summed, anew] = [false, true].map(|all| solve(&scene, &asked, None, all).unwrap().0);
    assert_eq!((summed.results.len(), anew.results.len()), (4, 4));
    let near = |one: f64, other: f64, within: f64| (one - other).abs() <= within * one.abs().max(other.abs());
    for (one, other) in summed.results.iter().zip(&anew.results) {
        let [a, b] = [one, other].map(|result| result.stress.as_ref().unwrap().reached);
        assert!(near(a.von_mises.0, b.von_mises.0, 2e-6), "{}: {a:?} {b:?}", one.pose);
        assert!(near(a.strain.0, b.strain.0, 2e-6) && near(a.passed, b.passed, 2e-6), "{a:?} {b:?}");
        assert_eq!(one.told.beyond, other.told.beyond, "{}", one.pose);
        let [a, b] = [one, other].map(|result| result.told.first_yield.as_ref().map(|first| first.share));
        assert!(a.zip(b).is_none_or(|(a, b)| near(a, b, 1e-5)) && a.is_some() == b.is_some(), "{a:?} {b:?}");
    }
    let told = |set: &ResultSet| set.results.iter().filter(|result| result.told.beyond.is_some()).count();
    let yielding = |set: &ResultSet| set.results.iter().filter(|r| r.told.first_yield.is_some()).count();
    assert!(told(&anew) > 0 && yielding(&anew) > 1, "{} {}", told(&anew), yielding(&anew));
    let drawn = |set: &ResultSet| Shape::list(&set.of_pose("bent"))[0].triangles.len();
    assert_eq!(drawn(&summed), drawn(&anew));
}

/// Files of an earlier run do not stay beside a pose that is missed now.
#[test]
fn files_of_a_pose_that_is_missed_now_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let files =
        Files::new(&folder.path().join("out"), &["stl".to_owned()], vec!["guided".to_owned()]).unwrap();
    let mut set = solved("linear", "tet4", PUSHED);
    files.write(&set, &[]).unwrap();
    let surface = folder.path().join("out.guided.stl");
    assert!(surface.exists());
    set.results.retain(|result| result.pose != "guided");
    files.write(&set, std::slice::from_ref(&surface)).unwrap();
    assert!(surface.exists(), "what the run reads stays");
    files.write(&set, &[]).unwrap();
    assert!(!surface.exists());
}
