//! Times of the graph of fields, of a snapshot of all state, of frames with hundreds of contacts, and of the online stage's two loops at the
//! paper's size: 10,000 nodes, two control elements of twelve columns.

use criterion::{Criterion, Throughput, criterion_group};
use greenstage::base::columns::{Storage, StoredColumns};
use greenstage::base::failure::Failure;
use greenstage::deform::{ControlPose, Superposition, vertex_normals};
use greenstage::field::{Each, Field, FieldError, Graph, Value};
use greenstage::green::FIELDS;
use greenstage::prepare::Resolved;
use greenstage::session::{Request, Session};
use greenstage::track::TrackerState;
use greenstage::world::World;
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::hint::black_box;

const NODES: usize = 10_000;

fn superposition(c: &mut Criterion) {
    let exact: Vec<Vec<f64>> =
        (0..FIELDS).map(|k| (0..3 * NODES).map(|i| ((i + k) as f64).sin()).collect()).collect();
    // A memory of its own for each of the two control elements.
    let all = Storage::ALL.map(|storage| [0, 1].map(|_| StoredColumns::new(storage, &exact)));
    let mut group = c.benchmark_group("superposition 10,000 nodes");
    for (stored, moved) in all.iter().flat_map(|stored| [(stored, 1), (stored, 2)]) {
        let groups = stored.each_ref().map(StoredColumns::group);
        let storage = groups[0].storage();
        let name = format!("{}, {} columns", storage.name(), 12 * moved);
        let mut sum = Superposition::new(&groups, NODES);
        let mut u = vec![[0.0; 3]; NODES];
        let mut step = 0.0;
        group.throughput(Throughput::Bytes((moved * FIELDS * 3 * storage.width() * NODES) as u64));
        group.bench_function(name, |b| {
            b.iter(|| {
                step += 1e-3;
                let coefficients = [0, 1].map(|e| [if e < moved { 0.1 + step } else { 0.0 }; FIELDS]);
                black_box(sum.update(&groups, coefficients.as_flattened(), &mut u));
            });
        });
    }
    group.finish();
}

fn normals(c: &mut Criterion) {
    let (around, along) = (100u32, NODES as u32 / 100);
    let positions: Vec<[f32; 3]> = (0..NODES as u32)
        .map(|i| {
            let (angle, z) = ((i % around) as f32 * 0.0628, (i / around) as f32 * 0.1);
            [angle.cos(), angle.sin(), z]
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..along - 1)
        .flat_map(|j| (0..around).map(move |i| (j, i)))
        .flat_map(|(j, i)| {
            let at = |j: u32, i: u32| j * around + i % around;
            [[at(j, i), at(j, i + 1), at(j + 1, i)], [at(j + 1, i), at(j, i + 1), at(j + 1, i + 1)]]
        })
        .collect();
    let (mut sums, mut normals) = (Vec::new(), vec![[0.0; 3]; NODES]);
    c.bench_function("normals 10,000 nodes, 19,800 triangles", |b| {
        b.iter(|| vertex_normals(black_box(&positions), &triangles, &mut sums, &mut normals));
    });
}

/// A pose, or twelve coefficients.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct Twelve([f64; 12]);

impl Value for Twelve {
    const TYPE: &'static str = "twelve numbers";
}

/// The fields and connections of the demo's graph, its functions left out: what the graph itself costs in a frame.
fn demo_graph() -> Result<(Graph<()>, Field<Twelve>), FieldError> {
    let mut graph = Graph::default();
    let zero = Twelve([0.0; 12]);
    let mut field = |name: &str| graph.field(name, zero.clone());
    let (tracked, head, stylus) = (field("tracker.head")?, field("head")?, field("stylus")?);
    let (hit, dragger) = (field("hit")?, field("dragger")?);
    let (left, right) = (field("pose.left")?, field("pose.right")?);
    let (coefficients, surface) = (field("coefficients")?, field("surface")?);
    let last = [head, dragger, right, surface].map(|of| graph.previous(of));
    let [head_was, dragger_was, right_was, surface_was] = last;
    graph.compute(head, "usable", (tracked, head_was?), |(), (now, _): (&Twelve, &Twelve)| now.clone())?;
    let (dragger_was, right_was) = (dragger_was?, right_was?);
    let seen = (stylus, dragger_was, vec![surface_was?]);
    graph.compute(hit, "pick", seen, |(), (stylus, ..): (&Twelve, &Twelve, Each<'_, Field<Twelve>>)| {
        stylus.clone()
    })?;
    graph.compute(
        dragger,
        "drag",
        (stylus, hit, dragger_was, vec![right_was]),
        |(), (stylus, ..): (&Twelve, &Twelve, &Twelve, Each<'_, Field<Twelve>>)| stylus.clone(),
    )?;
    let carried = (vec![dragger], right_was);
    graph.compute(right, "follow", carried, |(), (draggers, last): (Each<'_, Field<Twelve>>, &Twelve)| {
        draggers.get(0).unwrap_or(last).clone()
    })?;
    graph.compute(
        coefficients,
        "coefficients",
        vec![left, right],
        |(), poses: Each<'_, Field<Twelve>>| poses.get(1).map_or(Twelve([0.0; 12]), Twelve::clone),
    )?;
    graph.compute(surface, "sum", coefficients, |(), c: &Twelve| c.clone())?;
    Ok((graph, stylus))
}

fn graph(c: &mut Criterion) {
    let Ok((mut graph, stylus)) = demo_graph() else { return };
    c.bench_function("graph of the demo, nothing changes", |b| b.iter(|| graph.evaluate(&mut ())));
    let mut step = 0.0;
    c.bench_function("graph of the demo, the stylus moves", |b| {
        b.iter(|| {
            step += 1.0;
            let _ = black_box(graph.set(stylus, Twelve([step; 12])));
            graph.evaluate(&mut ());
        });
    });
}

/// A tube of 10,100 nodes with forces and stress, bent.
fn bent_tube() -> Result<World, Failure> {
    let text = "[body.tube]\n\
         generate = { tube = { inner_radius = 0.08, outer_radius = 0.1, length = 1.0, radial = 1, around = 50, along = 100, control_length = 0.1 } }\n\
         material = { young = 1.0e6, poisson = 0.3 }\nmodel = \"rotation\"\neffects = [\"haptics\", \"stress\"]\n\
         control.left = { nodes = { group = \"left\" }, grab = \"fixed\" }\n\
         control.right = { nodes = { group = \"right\" }, grab = \"dragger\" }\n";
    let folder = tempfile::tempdir().map_err(Failure::work)?;
    let scene = Resolved::parse(text, &folder.path().join("tube.toml"))?;
    let mut session = Session::open(&Request::new(&scene))?;
    let right = session.world.fields.bodies[0].poses[1];
    let turn = Rotation3::from_scaled_axis(Vector3::z() * 0.4);
    let pose = ControlPose { translation: Vector3::new(-0.02, 0.2, 0.0), matrix: *turn.matrix() };
    session.world.graph.restore(right, pose);
    session.advance(0.0)?;
    Ok(session.world)
}

fn state(c: &mut Criterion) {
    let mut world = match bent_tube() {
        Ok(world) => world,
        Err(error) => {
            eprintln!("no state is measured: {error}");
            return;
        }
    };
    let mut group = c.benchmark_group("state 10,100 nodes");
    group.bench_function("taken", |b| b.iter(|| black_box(world.state().ok())));
    if let Ok(taken) = world.state() {
        group.bench_function("restored", |b| b.iter(|| black_box(world.set_state(&taken).ok())));
    }
    group.finish();
}

/// A slab about `y`, held at one side by its hand.
fn slab(name: &str, y: f64, [size, cells]: [[f64; 3]; 2], held: &str) -> String {
    let cells = cells.map(|count| count as usize);
    format!(
        "[body.{name}]\ngenerate = {{ block = {{ size = {size:?}, cells = {cells:?} }} }}\n\
         material = {{ young = 1e5, poisson = 0.4, density = 1000.0 }}\n\
         effects = [\"contact\"]\neffect.contact = {{ friction = 0.3 }}\n\
         place = {{ position = [0.0, {y:?}, 0.0], scale = 1.0 }}\n\
         control.hand = {{ nodes = {{ group = \"{held}\" }}, grab = \"fixed\" }}\n"
    )
}

/// The hand of body `b` pressed by `down` towards what it touches, and drawn to and fro.
fn rubbed(text: &str, b: usize, down: f64) -> Result<impl FnMut(), Failure> {
    let folder = tempfile::tempdir().map_err(Failure::work)?;
    let scene = Resolved::parse(text, &folder.path().join("rubbed.toml"))?;
    let mut world = Session::open(&Request::new(&scene))?.world;
    let hand = world.fields.bodies[b].poses[0];
    let mut frame = 0;
    let mut step = move || {
        frame += 1;
        let (time_s, pressed) = (f64::from(frame) / 60.0, f64::from(frame).min(10.0) / 10.0);
        let translation = Vector3::new(3e-3 * (4.0 * time_s).sin(), -down * pressed, 0.0);
        world.graph.restore(hand, ControlPose { translation, ..ControlPose::REST });
        black_box(world.step(&TrackerState { time_s, ..TrackerState::default() }.into()));
    };
    (0..10).for_each(|_| step());
    Ok(step)
}

/// The scenes of the chapter `keys`, effect `contact`: 241 contacts with a ball, and 225 between two blocks.
fn contacts(c: &mut Criterion) {
    let ball = "[tool.ball]\nshape = { ball = { radius = 0.8 } }\nposition = [0.0, 0.8005, 0.0]\n".to_owned();
    let pressed = ball + &slab("low", -0.03, [[0.3, 0.06, 0.3], [30.0, 9.0, 30.0]], "ymin");
    let blocks = slab("low", -0.05, [[0.2, 0.1, 0.2], [12.0, 20.0, 12.0]], "ymin")
        + &slab("high", 0.0505, [[0.19, 0.1, 0.19], [14.0, 41.0, 14.0]], "ymax");
    let mut group = c.benchmark_group("frame with contacts, 9,600 nodes");
    group.sample_size(10);
    for (name, text, b, down) in [("ball", pressed, 0, -6e-3), ("two blocks", blocks, 1, 4e-3)] {
        match rubbed(&text, b, down) {
            Ok(mut step) => {
                group.bench_function(name, |bench| bench.iter(&mut step));
            }
            Err(error) => eprintln!("no contacts are measured: {error}"),
        }
    }
    group.finish();
}

criterion_group!(benches, superposition, normals, graph, state, contacts);

fn main() {
    // `cargo bench` passes --bench; `cargo test --bench online` runs each benchmark once and measures nothing.
    if std::env::args().any(|argument| argument == "--bench")
        && let Err(refused) = greenstage::base::machine::expect_full_speed(false)
    {
        eprintln!("online: {refused}");
        std::process::exit(2);
    }
    benches();
    Criterion::default().configure_from_args().final_summary();
}
