//! Bodies come home: whatever a tracker did, a second after the hands hold still a body has the shape that they reach from rest, or
//! is marked.

use crate::common::{scene, side_by_side};
use greenstage::deform::{
    AppliedLoads, ControlPose, ControlPoses, Deformer, Doubt, Kind, LINEAR, MODELS, ModelEntry, PointLoad,
    PoseLimiter, Pull, Screw, find_model,
};
use greenstage::fem::NEO_HOOKEAN;
use greenstage::green::{self, GreenFile};
use greenstage::solve::Silent;
use greenstage::world::out_of_range_of;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use std::sync::Arc;
use std::time::Duration;

/// A second.
const SECOND: usize = 60;
/// Farthest from the shape from rest, in parts of the body's length.
const HOME: f64 = 0.01;

/// A bar 10 : 1; of a plate a strip.
fn file_of(model: &ModelEntry) -> Arc<GreenFile> {
    let (size, cells, element) = match (model.name, model.kind) {
        ("plate", _) => ("[1.0, 0.02, 0.2]", "[12, 1, 4]", "tet10"),
        (_, Kind::Background(_)) => ("[1.0, 0.1, 0.1]", "[8, 1, 1]", "tet4"),
        _ => ("[1.0, 0.1, 0.1]", "[16, 2, 2]", "tet4"),
    };
    let scene = scene(&format!(
        "[body.b]\ngenerate = {{ block = {{ size = {size}, cells = {cells} }} }}\nelement = \"{element}\"\n\
         material = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"{}\"\n\
         control.left = {{ nodes = {{ box = {{ min = [-9.0, -9.0, -9.0], max = [-0.41, 9.0, 9.0] }} }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ box = {{ min = [0.41, -9.0, -9.0], max = [9.0, 9.0, 9.0] }} }}, grab = \"dragger\" }}\n",
        model.name
    ));
    green::opened(&[green::precompute(&scene, "b", &model.with_energy(), &Silent).unwrap()]).unwrap()
}

fn body(file: &Arc<GreenFile>, model: &'static ModelEntry) -> Deformer {
    let mut deformer = Deformer::new(file.clone(), "b", model).unwrap();
    deformer.be_patient(Duration::MAX);
    deformer
}

/// A body that hands move by their trackers, frame by frame.
struct Tracked {
    deformer: Deformer,
    limiters: [PoseLimiter; 2],
    poses: ControlPoses,
    frames: usize,
}

impl Tracked {
    fn new(deformer: Deformer) -> Tracked {
        Tracked { deformer, limiters: Default::default(), poses: vec![ControlPose::REST; 2], frames: 0 }
    }

    /// A frame of a world, in which the trackers say so.
    fn frame(&mut self, tracked: &[ControlPose; 2]) {
        self.deformer.pass_frame();
        for ((own, limiter), pose) in self.poses.iter_mut().zip(&mut self.limiters).zip(tracked) {
            *own = limiter.admit(own, pose).0;
        }
        self.deformer.evaluate(&self.poses);
        self.frames += 1;
    }

    /// Places at rest to which the poses of both control elements refer.
    fn origins(&self) -> [Vector3<f64>; 2] {
        [0, 1].map(|e| self.deformer.controls[e].origin)
    }

    fn shape(&self) -> Vec<Vector3<f64>> {
        let rest = self.deformer.rest().iter().map(|x| Vector3::from(*x).cast::<f64>());
        rest.enumerate().map(|(i, rest)| rest + self.deformer.displacement(i)).collect()
    }
}

const SEED: u64 = 7;

/// Steele, Lea and Flood's SplitMix.
struct Random(u64);

impl Random {
    fn number(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Between -1 and 1.
    fn part(&mut self) -> f64 {
        (self.number() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.part(), self.part(), self.part())
    }

    fn axis(&mut self) -> Vector3<f64> {
        self.vector().try_normalize(0.1).unwrap_or_else(Vector3::x)
    }
}

fn turned(turn: Vector3<f64>, translation: Vector3<f64>) -> ControlPose {
    ControlPose { translation, matrix: *Rotation3::from_scaled_axis(turn).matrix() }
}

/// Turns of the right end there and back again by a hand that makes up to 20 of them, by up to 60° a frame.
fn wind(body: &mut Tracked, random: &mut Random, most: usize) {
    let (axis, angle) = (random.axis(), 0.2 + 0.8 * random.part().abs());
    let turns = (20.0 * random.part()).clamp(-20.0, 20.0) * std::f64::consts::TAU;
    let steps = ((turns.abs() / angle).ceil() as usize).clamp(1, most);
    for step in (0..=steps).chain((0..=steps).rev()) {
        let angle = angle.min(turns.abs()) * step as f64 * turns.signum();
        body.frame(&[ControlPose::REST, turned(axis * angle, Vector3::zeros())]);
    }
}

/// What a tracker says that lost its target: anything.
fn throw(body: &mut Tracked, random: &mut Random, frames: usize) {
    for _ in 0..frames {
        let mut pose = turned(random.axis() * (3.1 * random.part()), random.vector() * 0.8);
        match random.number() % 12 {
            0 => pose.matrix *= f64::NAN,
            1 => pose.matrix = Matrix3::zeros(),
            2 => pose.matrix *= 1e3,
            3 => pose.matrix = -pose.matrix,
            4 => pose.translation.x = f64::INFINITY,
            5 => pose.matrix.column_mut(0).scale_mut(1.0 + 5.0 * random.part().abs()),
            _ => {}
        }
        let mut left = ControlPose::REST;
        if random.number().is_multiple_of(3) {
            left = turned(random.axis() * (3.1 * random.part()), random.vector() * 0.3);
        }
        body.frame(&[left, pose]);
    }
}

/// A calm pose within reach of every model, seen from a left end that is turned and shifted at will.
fn calm(random: &mut Random, model: &ModelEntry, origins: &[Vector3<f64>; 2]) -> [ControlPose; 2] {
    let bend = if *model == LINEAR { 0.1 } else { 0.25 };
    let right =
        turned(random.vector() * bend, Vector3::new(0.005, 0.03 * random.part(), 0.03 * random.part()));
    let whole = match model.is_linear() {
        true => Isometry3::identity(),
        false => Isometry3::new(random.vector() * 0.2, random.axis() * random.part()),
    };
    [(origins[0], ControlPose::REST), (origins[1], right)]
        .map(|(origin, pose)| pose_of(&(whole * in_room(&pose, &origin)), &origin))
}

/// The motion in the room of a control element that is not stretched.
fn in_room(pose: &ControlPose, origin: &Vector3<f64>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_matrix(&pose.matrix);
    Isometry3::from_parts((origin + pose.translation - rotation * origin).into(), rotation)
}

fn pose_of(motion: &Isometry3<f64>, origin: &Vector3<f64>) -> ControlPose {
    ControlPose {
        translation: (motion * Point3::from(*origin)).coords - origin,
        matrix: *motion.rotation.to_rotation_matrix().matrix(),
    }
}

/// `share` of a screw motion: on straight lines, two hands would press a body that they turn as a whole.
fn part(motion: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let room = Vector3::zeros();
    let screw = Screw::from_pose(&pose_of(motion, &room));
    in_room(&Screw::default().towards(&screw, share).pose(), &room)
}

/// The poses at `share` of a way from rest on which each hand goes by its own screw.
fn on_the_way(body: &Tracked, poses: &[ControlPose; 2], share: f64) -> [ControlPose; 2] {
    let origins = body.origins();
    [0, 1].map(|e| pose_of(&part(&in_room(&poses[e], &origins[e]), share), &origins[e]))
}

/// The shape to which hands lead the body from rest within a second.
fn from_rest(gentle: &mut Tracked, poses: &[ControlPose; 2]) -> Vec<Vector3<f64>> {
    gentle.deformer.forget();
    (gentle.limiters, gentle.poses) = (Default::default(), vec![ControlPose::REST; 2]);
    for step in 0..=SECOND {
        let at = on_the_way(gentle, poses, step as f64 / SECOND as f64);
        gentle.frame(&at);
    }
    gentle.frame(poses);
    gentle.shape()
}

/// The largest distance of two shapes, m.
fn distance(one: &[Vector3<f64>], other: &[Vector3<f64>]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Plays hostile trackers for about so many frames; returns how often the body was home afterwards, and how often it was marked.
fn play(model: &'static ModelEntry, frames: usize, longest: usize, seed: u64) -> [usize; 2] {
    let file = file_of(model);
    let mut random = Random(seed);
    let [mut body, mut gentle] = [(); 2].map(|()| Tracked::new(self::body(&file, model)));
    let [mut home, mut marked] = [0; 2];
    while body.frames < frames {
        let only_wound = random.number().is_multiple_of(2);
        if !only_wound {
            let count = 1 + random.number() as usize % longest;
            throw(&mut body, &mut random, count);
        } else {
            wind(&mut body, &mut random, longest);
        }
        let poses = calm(&mut random, model, &body.origins());
        for _ in 0..SECOND {
            let mut trembling = poses;
            trembling.iter_mut().for_each(|pose| pose.translation += random.vector() * 1e-4);
            body.frame(&trembling);
        }
        body.frame(&poses);
        let shape = body.shape();
        let apart = distance(&shape, &from_rest(&mut gentle, &poses));
        let mark = out_of_range_of(&body.deformer);
        assert!(apart.is_finite());
        assert!(
            apart <= HOME || mark.is_some(),
            "{}, frame {}: {:.1} % off without a mark; V {:?} J, from rest {:?} J; home {} times",
            model.name,
            body.frames,
            100.0 * apart,
            body.deformer.wrenches().map(|(_, energy)| energy),
            gentle.deformer.wrenches().map(|(_, energy)| energy),
            body.deformer.homecomings
        );
        if let Some(mark) = mark.filter(|_| apart > HOME) {
            println!("{}, frame {}: {:.1} % off: {mark}", model.name, body.frames, 100.0 * apart);
            marked += 1;
        } else {
            home += 1;
        }
    }
    println!("{}: {} frames, home {home} times, marked {marked} times", model.name, body.frames);
    [home, marked]
}

fn frames_of(model: &ModelEntry) -> [usize; 2] {
    match (model.name, model.kind) {
        ("plate" | "reduced" | "reduced_neo_hookean", _) | (_, Kind::Background(_)) => [180, 12],
        ("substructured", _) => [400, 12],
        _ => [1000, 60],
    }
}

#[test]
fn bodies_come_home_from_hostile_trackers() {
    side_by_side(MODELS, |model| {
        let [frames, longest] = frames_of(model);
        let [home, marked] = play(model, frames, longest, SEED);
        assert!(home > 0 && marked <= home, "{}: home {home} times, marked {marked} times", model.name);
    });
}

/// A bar pulled by a fifth bears 33 % less under neo-Hooke's law than under St. Venant and Kirchhoff's, one pulled by a fiftieth 4 %:
/// a strain beyond its law is told of every model but those that bear it.
#[test]
fn a_strain_beyond_a_models_law_is_told() {
    side_by_side(MODELS, |model| {
        let mut body = body(&file_of(model), model);
        let bears = model.large_strain_law().name == NEO_HOOKEAN.name;
        for (pull, is_told) in [(0.01, false), (0.2, !bears)] {
            body.evaluate(&[ControlPose::REST, turned(Vector3::zeros(), Vector3::x() * pull)]);
            let told = out_of_range_of(&body);
            let is_strained = told.as_ref().is_some_and(|told| told.contains("strained by"));
            assert!(is_strained == is_told, "{} pulled by {pull}: {told:?}", model.name);
        }
    });
}

/// A strip whose way home leads to one equilibrium, and to another where each end goes by its own screw from rest.
#[test]
fn a_body_says_that_it_has_several_equilibria() {
    let model = find_model("plate").unwrap();
    let file = file_of(model);
    let [mut body, mut gentle] = [(); 2].map(|()| Tracked::new(self::body(&file, model)));
    let poses = [
        turned(Vector3::new(-0.0657, 0.7311, 0.4601), Vector3::new(0.1461, -0.2490, 0.2936)),
        turned(Vector3::new(-0.0992, 0.4914, 0.4698), Vector3::new(-0.1622, 0.1282, -0.2880)),
    ];
    body.frame(&[ControlPose::REST, turned(Vector3::y() * 2.0, Vector3::zeros())]);
    (0..SECOND).for_each(|_| body.frame(&poses));
    let other = from_rest(&mut gentle, &poses);
    let apart = distance(&body.shape(), &other);
    assert!(
        apart > 0.05 && body.deformer.doubt() == Some(Doubt::Several),
        "{apart}, {:?}",
        body.deformer.doubt()
    );

    // Another load is looked into anew.
    let pull = Pull::Force(Vector3::z() * 1e-3);
    let points = vec![PointLoad { nodes: [0; 3], weights: [1.0, 0.0, 0.0], pull }];
    assert!(body.deformer.apply(&AppliedLoads { points, ..AppliedLoads::default() }));
    body.frame(&poses);
    assert_eq!(body.deformer.doubt(), Some(Doubt::PathLost));
    (0..SECOND).for_each(|_| body.frame(&poses));
    assert_eq!(body.deformer.doubt(), Some(Doubt::Several));

    // Near rest there is one alone.
    for share in (0..=SECOND).map(|step| 1.0 - step as f64 / SECOND as f64) {
        let back = on_the_way(&body, &poses, share);
        body.frame(&back);
    }
    (0..SECOND).for_each(|_| body.frame(&[ControlPose::REST; 2]));
    assert_eq!(body.deformer.doubt(), None);
}

/// A million frames of one model: `HOME_MODEL=rod cargo test --release --test mechanics -- --ignored a_million_frames --nocapture`;
/// several processes share them with `HOME_FRAMES` and a `HOME_SEED` each.
#[test]
#[ignore = "minutes to hours, by the model"]
fn a_million_frames() {
    let name = std::env::var("HOME_MODEL").unwrap_or_else(|_| "rod".into());
    let number = |name: &str, usual: u64| std::env::var(name).map_or(usual, |text| text.parse().unwrap());
    let model = find_model(&name).unwrap();
    let [_, longest] = frames_of(model);
    play(model, number("HOME_FRAMES", 1_000_000) as usize, 4 * longest, number("HOME_SEED", SEED));
}
