use crate::base::progress::Silent;
use crate::deform::models::fixture::assert_slopes;
use crate::deform::pose::se3;
use crate::deform::{
    ComparedState, ControlPose, ControlPoses, DeformationModel, Deformer, ModelReach, PoseSlope, Statics,
    Wrench, axial, find_model, model_of,
};
use crate::fem::STVK;
use crate::green::{
    self, AFFINE, EQUILIBRIA, FIELDS, KnownEquilibrium, PathKind, REDUCED, REDUCED_NEO_HOOKEAN, Requirements,
};
use crate::scene::Scene;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3, Vector6};
use std::path::Path;

/// A bar of 6 : 1 : 1 between two faces, and a third held face at its side where `sides` says so.
pub fn bar(sides: &str) -> Scene {
    let text = format!(
        "[body.bar]\ngenerate = {{ block = {{ size = [6.0, 1.0, 1.0], cells = [12, 2, 2] }} }}\n\
         material = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"reduced\"\n\
         control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n{sides}"
    );
    Scene::parse(&text, Path::new("bar.toml")).unwrap()
}

pub const RIGHT: &str = "control.right = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

/// The models in a few fields, of either law.
const MODELS: [&str; 2] = ["reduced", "reduced_neo_hookean"];

fn made(scene: &Scene) -> (Box<dyn DeformationModel>, green::Solution, Vector3<f64>) {
    made_as(scene, "reduced")
}

fn made_as(scene: &Scene, name: &str) -> (Box<dyn DeformationModel>, green::Solution, Vector3<f64>) {
    let model = find_model(name).unwrap();
    let solution = green::solve(scene, "bar", &model.with_energy(), &Silent).unwrap();
    let (model, centre) = model_of(model, &solution).unwrap();
    (model, solution, centre)
}

/// The right end at the end of the screw (6 + slide, turn) from the left one, and all of it moved by `motion`.
pub fn poses(slide: [f64; 3], turn: [f64; 3], motion: &Isometry3<f64>) -> ControlPoses {
    let rest = Vector3::new(6.0, 0.0, 0.0);
    let end = se3::exp(&Vector6::new(rest.x + slide[0], slide[1], slide[2], turn[0], turn[1], turn[2]));
    [(Isometry3::identity(), -3.0), (end, 3.0)]
        .map(|(frame, x)| {
            let left = Vector3::new(-3.0, 0.0, 0.0);
            let place = motion * nalgebra::Point3::from(frame.translation.vector + left);
            ControlPose {
                translation: place.coords - Vector3::new(x, 0.0, 0.0),
                matrix: *(motion.rotation * frame.rotation).to_rotation_matrix().matrix(),
            }
        })
        .to_vec()
}

fn motion() -> Isometry3<f64> {
    Isometry3::from_parts(
        Vector3::new(0.4, -1.0, 2.0).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.7, -0.2, 1.1)),
    )
}

/// A model's response a little beside its state differs from the one that it finds there directly by the square of the way; at
/// 90° in the models' own fields, to which stretches of control elements belong. The state stays.
#[test]
fn slopes_beside_are_those_to_first_order() {
    for name in ["reduced", "reduced_neo_hookean", "perturbation"] {
        let (mut model, ..) = made_as(&bar(RIGHT), name);
        let at = poses([0.1, 0.3, -0.2], [0.2, -0.9, 0.3], &motion());
        let moved = |by: f64| {
            let mut moved = at.clone();
            moved[1].translation += Vector3::new(0.3, -0.8, 0.5) * by;
            moved[1].matrix += Matrix3::new(0.1, -0.4, 0.2, 0.3, 0.2, -0.5, 0.1, 0.6, -0.2) * by;
            moved
        };
        let mut slopes = [[PoseSlope::default(); 2]; 3];
        let [own, found, beside] = &mut slopes;
        let mut off = |by: f64| {
            model.respond(&at, own).unwrap();
            assert!(!model.prepare_beside(true), "{name}: a tick has time for a part");
            assert!((0..12).any(|_| model.prepare_beside(false)), "{name}: twelve parts are not enough");
            let answer = model.respond_beside(&moved(by), beside).unwrap();
            model.respond(&at, found).unwrap();
            assert!(off_by(own, found) < 1e-9 * size(own), "{name}: {}", off_by(own, found));
            let expected = model.respond(&moved(by), found).unwrap();
            [off_by(beside, found), off_by(own, found), (answer.energy - expected.energy).abs()]
        };
        let [[far, way, far_j], [near, _, near_j]] = [off(1e-2), off(1e-3)];
        assert!(far < 0.1 * way, "{name}: {far} of {way}");
        let [rate, rate_j] = [far / near, far_j / near_j].map(f64::log10);
        assert!((1.95..2.05).contains(&rate), "{name}: {far} {near}");
        assert!(rate_j > 1.95, "{name}: energy off by {far_j} J, {near_j} J");
    }
}

fn size(slopes: &[PoseSlope]) -> f64 {
    slopes.iter().map(|slope| slope.translation.norm() + slope.matrix.norm()).fold(0.0, f64::max)
}

fn off_by(one: &[PoseSlope], other: &[PoseSlope]) -> f64 {
    let between = |(one, other): (&PoseSlope, &PoseSlope)| PoseSlope {
        translation: one.translation - other.translation,
        matrix: one.matrix - other.matrix,
    };
    size(&one.iter().zip(other).map(between).collect::<Vec<_>>())
}

/// A bar of 10 : 1 pressed by 7 % and turned by 4° is buckled, by Euler's load from 3.3 % on; a block of 2 : 1 and a tube, whose ends turn
/// about its axis without strain, are bent and twisted as far as the law has equilibria. No field was made from these poses.
#[test]
fn slender_and_compact_bodies_have_the_forces_of_their_mesh_at_large_turns() {
    use crate::deform::{Deviation, Motion, Moved, PoseResult};
    let body = |generator: &str, [left, right]: [&str; 2]| {
        let text = format!(
            "[body.bar]\ngenerate = {{ {generator} }}\n\
             material = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"reduced\"\n\
             control.left = {{ nodes = {{ group = \"{left}\" }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"{right}\" }}, grab = \"dragger\" }}\n"
        );
        Scene::parse(&text, Path::new("bar.toml")).unwrap()
    };
    let ends = ["xmin", "xmax"];
    let slender =
        [(Motion::Shift([-0.07, 0.0]), 4.0), (Motion::Mixed(50.0, 0.08), 0.0), (Motion::Twist(80.0), 0.0)];
    let level = |motion| (motion, 0.0);
    let compact = [
        Motion::Bend(50.0),
        Motion::Turn([0, 0, 1], 40.0),
        Motion::Twist(80.0),
        Motion::Turn([1, 1, 1], 50.0),
    ]
    .map(level);
    // Where St. Venant–Kirchhoff's law has no equilibrium.
    let further = [
        Motion::Bend(1.0),
        Motion::Twist(1.0),
        Motion::Bend(88.0),
        Motion::Twist(88.0),
        Motion::Turn([1, 1, 1], 80.0),
        Motion::Shift([0.09, 0.0]),
    ]
    .map(level);
    let bar = body("block = { size = [10.0, 1.0, 1.0], cells = [20, 2, 2] }", ends);
    let block = body("block = { size = [2.0, 1.0, 1.0], cells = [8, 4, 4] }", ends);
    let tube = body(
        "tube = { inner_radius = 0.07, outer_radius = 0.1, length = 0.8, radial = 1, around = 12, along = 14, control_length = 0.1 }",
        ["left", "right"],
    );
    for (name, scene, motions) in [
        ("reduced", &bar, &slender[..]),
        ("reduced", &block, &compact),
        ("reduced_neo_hookean", &block, &further),
        ("reduced_neo_hookean", &tube, &further),
    ] {
        let (mut model, solution, _) = made_as(scene, name);
        let law = find_model(name).unwrap().large_strain_law();
        let mut statics = Statics::new(scene, "bar", law, &Silent).unwrap();
        let origins: Vec<_> = solution.controls.iter().map(|control| control.origin).collect();
        let moved = Moved::new(&origins, 1).unwrap();
        for (motion, tilt) in motions {
            model.forget();
            let mut slopes = [PoseSlope::default(); 2];
            let at = |share: f64| {
                let mut poses = moved.poses(motion.part(share));
                let turn = Rotation3::from_scaled_axis(moved.across * (share * f64::to_radians(*tilt)));
                poses[1].matrix = turn.matrix() * poses[1].matrix;
                poses
            };
            let poses = at(1.0);
            for step in 1..=36 {
                let on_the_way = at(f64::from(step) / 36.0);
                assert!(model.respond(&on_the_way, &mut slopes).unwrap().is_defined, "{}", motion.name());
            }
            let settled = statics.solve(&poses, &Silent).unwrap();
            let held = settled.balance(&poses);
            let wrenches = slopes.iter().zip(&poses).map(|(slope, pose)| Wrench {
                force: slope.translation,
                moment: axial(&(slope.matrix * pose.matrix.transpose())),
            });
            let of = |wrenches: Vec<Wrench>, energy| PoseResult {
                wrenches: Some(wrenches),
                energy,
                surface: Vec::new(),
            };
            let energy = settled.energy;
            let off = Deviation::new(&of(wrenches.collect(), energy), &of(held, energy), moved.length);
            let (force, torque) = (off.force.unwrap(), off.torque.unwrap());
            // Measured: 0.016, 0.00002, 0.0004 and 0.004 at most.
            let most = match motion {
                Motion::Shift(_) | Motion::Mixed(..) if name == "reduced" => 0.03,
                Motion::Bend(1.0) | Motion::Twist(1.0) => 0.0002,
                _ if name == "reduced" => 0.002,
                _ => 0.008,
            };
            assert!(force.max(torque) < most, "{name} {}: force {force}, torque {torque}", motion.name());
        }
    }
}

/// Force, torque and shape at 60° to 90° against the equilibrium of the whole mesh: a tenth of what the other models miss.
#[test]
fn forces_and_shape_are_those_of_the_mesh() {
    let scene = bar(RIGHT);
    let (mut model, solution, centre) = made(&scene);
    let mut statics = Statics::new(&scene, "bar", &STVK, &Silent).unwrap();
    let mut slopes = [PoseSlope::default(); 2];
    let table = &solution.tables["reduced/fields"];
    for (slide, turn) in
        [([0.0; 3], [0.0, 0.0, 1.05]), ([0.0; 3], [1.57, 0.0, 0.0]), ([0.1, 0.3, -0.2], [0.4, -0.9, 0.5])]
    {
        let poses = poses(slide, turn, &Isometry3::identity());
        let state = model.state(&poses);
        let response = model.respond(&poses, &mut slopes).unwrap();
        let settled = statics.solve(&poses, &Silent).unwrap();
        assert!(response.is_defined && response.energy > settled.energy * (1.0 - 1e-9));
        assert!(response.energy < 1.005 * settled.energy, "{} {}", response.energy, settled.energy);
        let wrench = &settled.wrenches[1];
        let moment = wrench.moment - poses[1].translation.cross(&wrench.force);
        let scale = wrench.force.norm().max(moment.norm() / 6.0);
        let torque = axial(&(slopes[1].matrix * poses[1].matrix.transpose()));
        let off = (slopes[1].translation - wrench.force).norm().max((torque - moment).norm() / 6.0);
        assert!(off < 0.03 * scale, "{turn:?}: {off} of {scale}");
        let motion = state.body_from_surface();
        let q = &state.coefficients[solution.fields.columns..];
        let mut square = 0.0;
        for (node, settled) in settled.displacement.iter().enumerate() {
            let x = solution.mesh.nodes[node] - centre;
            let u = Vector3::from_fn(|axis, _| {
                let row = 3 * node + axis;
                let affine: f64 =
                    solution.fields.row(row).iter().zip(&state.coefficients).map(|(u, c)| u * c).sum();
                affine + q.iter().enumerate().map(|(k, q)| table[(row, k)] * q).sum::<f64>()
            });
            square += ((motion * nalgebra::Point3::from(x + u)).coords - x - settled).norm_squared();
        }
        let rms = (square / settled.displacement.len() as f64).sqrt();
        assert!(rms < 1e-3 * 6.0, "{turn:?}: {rms} m off");
    }
}

/// All twelve numbers of both elements, bent, moved and stretched, against central differences of V.
#[test]
fn slopes_are_derivatives_of_the_energy() {
    let stretch = Matrix3::new(1.05, 0.02, -0.01, 0.02, 0.97, 0.03, -0.01, 0.03, 1.02);
    for (name, stretch) in MODELS.into_iter().flat_map(|name| [(name, Matrix3::identity()), (name, stretch)])
    {
        let (mut model, ..) = made_as(&bar(RIGHT), name);
        let mut poses = poses([0.2, -0.1, 0.3], [0.5, -0.9, 0.4], &motion());
        poses[1].matrix *= stretch;
        let mut slopes = [PoseSlope::default(); 2];
        assert!(model.respond(&poses, &mut slopes).unwrap().is_defined);
        let size = slopes.iter().map(|slope| slope.matrix.norm()).fold(0.0, f64::max);
        assert_slopes(model.as_mut(), &poses, 1e-5, 1e-6 * size);
    }
}

/// The work that is put into the body on a closed way of the hand comes back: the trapezoidal rule over small steps has an error
/// of third order in them, and nothing else is left.
#[test]
fn a_closed_path_makes_no_energy() {
    let at = |share: f64| {
        let angle = std::f64::consts::TAU * share;
        let turn = [0.5 * angle.sin(), 0.9 * (1.0 - angle.cos()), 0.3 * (2.0 * angle).sin()];
        poses([0.2 * angle.sin(), 0.3 * (1.0 - angle.cos()), 0.0], turn, &Isometry3::identity())
    };
    let work = |steps: usize, model: &mut dyn DeformationModel| {
        let (mut sum, mut most) = (0.0, 0.0_f64);
        let mut before = ([PoseSlope::default(); 2], at(0.0));
        model.respond(&before.1, &mut before.0).unwrap();
        for step in 1..=steps {
            let now = at(step as f64 / steps as f64);
            let mut slopes = [PoseSlope::default(); 2];
            let response = model.respond(&now, &mut slopes).unwrap();
            assert!(response.is_defined);
            most = most.max(response.energy);
            let moved = now[1].translation - before.1[1].translation;
            let turned = now[1].matrix - before.1[1].matrix;
            let force = (slopes[1].translation + before.0[1].translation) * 0.5;
            let moment = (slopes[1].matrix + before.0[1].matrix) * 0.5;
            sum += force.dot(&moved) + moment.dot(&turned);
            before = (slopes, now);
        }
        sum.abs() / most
    };
    for name in MODELS {
        let (mut model, ..) = made_as(&bar(RIGHT), name);
        let coarse = work(250, model.as_mut());
        let fine = work(1000, model.as_mut());
        assert!(fine < 2e-5 && fine < 0.1 * coarse.max(1e-6), "{name}: {coarse:e} {fine:e}");
    }
}

#[test]
fn a_common_motion_costs_nothing_and_forces_are_in_balance() {
    let (mut model, _, _) = made(&bar(RIGHT));
    let mut slopes = [PoseSlope::default(); 2];
    let still = model.respond(&poses([0.0; 3], [0.0; 3], &motion()), &mut slopes).unwrap();
    assert!(still.energy.abs() < 1e-12 && slopes[1].matrix.amax() < 1e-6, "{still:?} {slopes:?}");
    let bent = poses([0.1, 0.3, -0.2], [0.4, -0.9, 0.5], &Isometry3::identity());
    let moved = poses([0.1, 0.3, -0.2], [0.4, -0.9, 0.5], &motion());
    let [first, second] = [&bent, &moved].map(|poses| {
        let response = model.respond(poses, &mut slopes).unwrap();
        let force = slopes[0].translation + slopes[1].translation;
        let turn = |e: usize| {
            let place = Vector3::new([-3.0, 3.0][e], 0.0, 0.0) + poses[e].translation;
            let torque = axial(&(slopes[e].matrix * poses[e].matrix.transpose()));
            place.cross(&slopes[e].translation) + torque
        };
        let size = slopes[1].matrix.norm();
        assert!(force.norm() < 1e-8 * size && (turn(0) + turn(1)).norm() < 1e-8 * size, "{force} {size}");
        response.energy
    });
    assert!((first - second).abs() < 1e-9 * first, "{first} {second}");
}

/// No mean frame exists beyond a whole turn: the last forces go on, and the response is marked as not defined. One element alone
/// feels nothing, three have an equilibrium, five are refused.
#[test]
fn it_says_where_it_is_not_defined() {
    let (mut model, _, _) = made(&bar(RIGHT));
    let mut slopes = [PoseSlope::default(); 2];
    let defined = (0..=355).step_by(5).all(|degrees| {
        let turn = [f64::from(degrees).to_radians(), 0.0, 0.0];
        model.respond(&poses([0.0; 3], turn, &Isometry3::identity()), &mut slopes).unwrap().is_defined
    });
    assert!(!defined && slopes[1].matrix.norm() > 0.0);

    let (mut one, _, _) = made(&bar(""));
    let turned =
        [ControlPose { matrix: *motion().rotation.to_rotation_matrix().matrix(), ..ControlPose::REST }];
    let response = one.respond(&turned, &mut slopes[..1]).unwrap();
    assert!(response.is_defined && response.energy.abs() < 1e-9, "{response:?}");

    let side = |name: &str, x: f64| {
        let (low, high) = (x - 0.3, x + 0.3);
        format!(
            "control.{name} = {{ nodes = {{ box = {{ min = [{low}, -9.0, 0.4], max = [{high}, 9.0, 9.0] }} }}, \
             grab = \"fixed\" }}\n"
        )
    };
    let (mut three, _, _) = made(&bar(&(RIGHT.to_owned() + &side("top", 0.0))));
    let mut bent = poses([0.0; 3], [0.0, 0.5, 0.0], &Isometry3::identity());
    bent.push(ControlPose { translation: Vector3::new(0.1, 0.2, 0.5), ..ControlPose::REST });
    let mut of_three = [PoseSlope::default(); 3];
    assert!(three.respond(&bent, &mut of_three).unwrap().is_defined);

    let many = RIGHT.to_owned() + &side("a", -1.5) + &side("b", 0.0) + &side("c", 1.5);
    let requirements = Requirements::new(&[AFFINE, REDUCED]);
    let refused = green::solve(&bar(&many), "bar", &requirements, &Silent).err().unwrap().to_string();
    assert!(refused.contains("has 5 control elements") && refused.contains("rotation"), "{refused}");
    // Its points are chosen from equilibria, which only two control elements have.
    let requirements = Requirements::new(&[AFFINE, REDUCED_NEO_HOOKEAN]);
    let refused = green::solve(&bar(""), "bar", &requirements, &Silent).err().unwrap().to_string();
    assert!(refused.contains("has 1 control elements") && refused.contains("takes 2"), "{refused}");
}

/// The .green file gives, in every storage, the same state and the same forces as the solution, and the surface is where its
/// columns say; one element alone has no columns beyond the affine ones.
#[test]
fn the_file_holds_what_the_model_needs() {
    for (name, sides, storage) in [
        ("reduced", RIGHT, "f32"),
        ("reduced", RIGHT, "f16"),
        ("reduced", RIGHT, "int16"),
        ("reduced", "", "f32"),
        ("reduced_neo_hookean", RIGHT, "f32"),
    ] {
        let mut scene = bar(sides);
        scene.body["bar"].storage = serde_json::from_value(storage.into()).unwrap();
        let (mut model, solution, centre) = made_as(&scene, name);
        let entry = find_model(name).unwrap();
        let body = green::precompute(&scene, "bar", &Requirements::new(entry.requirements), &Silent).unwrap();
        let mut deformer = Deformer::new(green::opened(&[body]).unwrap(), "bar", entry).unwrap();
        let mut poses = poses([0.2, -0.1, 0.3], [0.5, -0.9, 0.4], &motion());
        poses.truncate(solution.controls.len());
        let state = model.state(&poses);
        deformer.evaluate(&poses).unwrap();
        assert_eq!(deformer.state.coefficients.len(), state.coefficients.len(), "{storage}");
        let largest = state.coefficients.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        for (found, expected) in deformer.state.coefficients.iter().zip(&state.coefficients) {
            assert!((found - expected).abs() < 1e-6 * largest, "{storage}: {found} {expected}");
        }
        let fields = &solution.tables["reduced/fields"];
        for (i, &node) in solution.surface.nodes.iter().enumerate() {
            let value = |axis: usize| -> f64 {
                let row = 3 * node as usize + axis;
                let affine = solution.fields.row(row).iter().copied();
                let columns = affine.chain((0..fields.ncols()).map(|column| fields[(row, column)]));
                columns.zip(&state.coefficients).map(|(u, c)| u * c).sum()
            };
            let x = solution.mesh.nodes[node as usize] - centre + Vector3::from_fn(|axis, _| value(axis));
            let off = Vector3::from(deformer.positions()[i]).cast::<f64>() - x;
            assert!(off.amax() < 5e-3, "{storage}: node {i} is {} m off", off.amax());
        }
    }
}

/// The equilibria in the file are equilibria: force and moment of both ends cancel. The model holds at those of which no field was
/// made as it does elsewhere.
#[test]
fn known_equilibria_balance_and_tell_how_far_the_model_holds() {
    let (scene, model) = (bar(RIGHT), find_model("reduced_neo_hookean").unwrap());
    let made = green::precompute(&scene, "bar", &model.with_energy(), &Silent).unwrap();
    let file = green::opened(&[made]).unwrap();
    let table = file.table("bar", EQUILIBRIA).unwrap();
    let all: Vec<_> =
        table.column_iter().map(|own| KnownEquilibrium::read(own.as_slice()).unwrap()).collect();
    assert!(all.len() >= 60, "{}", all.len());
    for known in &all {
        let place = |e: usize| {
            Vector3::from_fn(|axis, _| known.coefficients[FIELDS * e + axis])
                + Vector3::x() * (6.0 * e as f64 - 3.0)
        };
        let [[force, moment], [other_force, other_moment]] = known.wrenches;
        let sum = moment + other_moment + (place(1) - place(0)).cross(&other_force);
        let size = force.norm().max(moment.norm() / 6.0);
        assert!((force + other_force).norm() < 1e-4 * size && sum.norm() < 6e-4 * size, "{known:?}");
    }
    let reach = ModelReach::measure(&file, "bar", model).unwrap().unwrap();
    assert_eq!((reach.states.len(), reach.inverted), (all.len(), 0), "{reach:?}");
    let held_out = |states: &[ComparedState]| states.iter().filter(|state| state.is_held_out).count();
    assert_eq!(held_out(&reach.states), all.iter().filter(|known| known.kind == PathKind::HeldOut).count());
    assert!(held_out(&reach.states) >= 8 && reach.turned().len() == 3, "{reach:?}");
    let [.., (turn, worst), _] = reach.turned()[..] else { panic!("{reach:?}") };
    assert!((turn - 90.0).abs() < 0.5 && worst < 0.05, "{}", reach.details());
    let text = reach.text();
    assert!(text.contains("turned to 45°") && text.contains("turned to 90°"), "what was measured: {text}");
}

/// A file of the perturbed body keeps equilibria too, but without the stiffness matrix of a linear body its model has no forces that
/// could be compared with them.
#[test]
fn no_reach_is_told_of_a_model_without_forces() {
    let (scene, model) = (bar(RIGHT), find_model("perturbation").unwrap());
    let reach = |requirements: &Requirements| {
        let made = green::precompute(&scene, "bar", requirements, &Silent).unwrap();
        let file = green::opened(&[made]).unwrap();
        assert!(file.table("bar", EQUILIBRIA).is_some());
        ModelReach::measure(&file, "bar", model).unwrap()
    };
    assert_eq!(reach(&Requirements::new(model.requirements)), None);
    assert!(reach(&model.with_energy()).is_some_and(|reach| !reach.states.is_empty()));
}
