//! A deformer that is restored from a snapshot goes on with the same bits, whatever its scratch memory held before.

use crate::common::{scene, side_by_side};
use greenstage::deform::{
    AppliedLoads, Bearing, ControlPose, ControlPoses, Deformer, DeformerState, Kind, MODELS, ModelEntry,
    PointLoad, Pull,
};
use greenstage::green::{self, COMPLIANCE, GreenFile, LOADS, Requirements};
use greenstage::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::sync::Arc;
use std::time::Duration;

const FRAMES: usize = 60;
/// Frames for which a restored deformer goes on: among any 13 there is a jump.
const ONWARDS: usize = 16;

/// Whether it bears loads in its own equilibrium, and no springs at points.
fn is_solved(model: &ModelEntry) -> bool {
    model.takes_points()
}

/// A file of a bar; of a body that is solved anew for every pose, on few nodes.
fn file_of(model: &ModelEntry, with_loads: bool) -> Arc<GreenFile> {
    let (size, cells) = match (model.name, model.kind) {
        ("plate", _) => ("[0.6, 0.2, 0.02]", "[9, 3, 1]"),
        (_, Kind::Background(_)) => ("[1.0, 0.1, 0.1]", "[5, 1, 1]"),
        _ => ("[1.0, 0.1, 0.1]", "[8, 2, 2]"),
    };
    let loads = match (with_loads, is_solved(model)) {
        (false, _) => "",
        (true, true) => "gravity = true\n",
        (true, false) => "gravity = true\nsurface_compliance = { nodes = \"surface\" }\n",
    };
    let element = if model.name == "plate" { "element = \"tet10\"\n" } else { "" };
    let scene = scene(&format!(
        "[body.b]\ngenerate = {{ block = {{ size = {size}, cells = {cells} }} }}\n\
         material = {{ young = 1.0e6, poisson = 0.3, density = 1000.0 }}\n{element}{loads}\
         model = \"{}\"\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"dragger\" }}\n",
        model.name
    ));
    let needed =
        Requirements::new(model.requirements).and(Requirements::new(model.energy.unwrap_or_default()));
    let needed = match model.loads {
        Bearing::Columns if with_loads => needed.and(Requirements::new(&[LOADS, COMPLIANCE])),
        Bearing::Forces(families) if with_loads => needed.and(Requirements::new(families)),
        _ => needed,
    };
    green::opened(&[green::precompute(&scene, "b", &needed, &Silent).unwrap()]).unwrap()
}

fn patient(file: &Arc<GreenFile>, model: &'static ModelEntry) -> Deformer {
    let mut deformer = Deformer::new(file.clone(), "b", model).unwrap();
    deformer.be_patient(Duration::MAX);
    deformer
}

/// One end twisted on and on, beyond a whole turn, which has no mean with the other end; every thirteenth frame it is elsewhere.
fn poses(frame: usize, wildness: f64) -> ControlPoses {
    let t = frame as f64;
    let mut turn = Rotation3::new(Vector3::y() * (0.4 * wildness * (0.3 * t).sin()))
        * Rotation3::new(Vector3::x() * (wildness * 7.5 * t).to_radians());
    let mut shift = Vector3::new(-0.002 * t, 0.01 * (0.5 * t).sin(), 0.0);
    if frame % 13 == 6 {
        turn = Rotation3::new(Vector3::z() * (1.5 * wildness)) * turn;
        shift += Vector3::new(-0.3, 0.2, 0.0) * wildness;
    }
    let whole = Rotation3::new(Vector3::new(0.1, 0.02, -0.03) * (0.2 * t).sin());
    let stretch = 1.0 + 0.05 * (0.4 * t).sin();
    vec![
        ControlPose { translation: shift, matrix: turn.matrix() * stretch },
        ControlPose { translation: Vector3::new(0.0, 0.001 * t, 0.0), matrix: *whole.matrix() },
    ]
}

/// A body that is solved bears forces alone at its points, and no springs.
fn loads(frame: usize, node: u32, is_solved: bool) -> AppliedLoads {
    let t = frame as f64;
    let pull = match frame % 2 {
        odd if odd == 0 || is_solved => Pull::Force(Vector3::new(0.3, t.sin(), 0.1)),
        _ => Pull::Towards { place: Vector3::new(0.0, 0.1 * t.cos(), 0.05), spring: Some(50.0) },
    };
    let point = PointLoad { nodes: [node; 3], weights: [1.0, 0.0, 0.0], pull };
    AppliedLoads { coefficients: vec![0.0, -9.8 * (0.1 * t).cos(), 0.5], points: vec![point] }
}

/// All bits that are drawn, felt or kept.
fn told(deformer: &Deformer) -> (String, Vec<u32>) {
    let (positions, normals) = (deformer.positions(), deformer.normals());
    let bits = positions.iter().chain(normals.iter()).flatten().map(|x| x.to_bits()).collect();
    (serde_json::to_string(&deformer.snapshot()).unwrap(), bits)
}

fn goes_on(model: &'static ModelEntry, with_loads: bool, wildness: f64) {
    let file = file_of(model, with_loads);
    let node = file.rest("b").len() as u32 / 2;
    let step = |deformer: &mut Deformer, frame: usize| {
        if with_loads {
            assert!(deformer.apply(&loads(frame, node, is_solved(model))));
        }
        deformer.evaluate(&poses(frame, wildness)).unwrap();
        told(deformer)
    };
    let mut first = patient(&file, model);
    let frames: Vec<(String, Vec<u32>)> = (1..=FRAMES).map(|frame| step(&mut first, frame)).collect();
    let (mut undefined, mut largest) = (0, 0.0_f64);
    for (text, _) in &frames {
        let state: DeformerState = serde_json::from_str(text).unwrap();
        undefined += usize::from(state.state.rotation_undefined);
        largest = largest.max(state.turns[0].against(&state.turns[1]));
    }
    assert!(largest > std::f64::consts::PI || wildness < 1.0, "{}: {largest} rad", model.name);
    println!("{} {with_loads}: {undefined} frames without a mean", model.name);
    // Frame 6 is a jump, as is every thirteenth after it; at 48 the ends are a turn apart.
    for start in [1, 20, 32, 48] {
        let mut other = patient(&file, model);
        for frame in 3..6 {
            other.evaluate(&poses(5 * frame, 0.5 * wildness)).unwrap();
        }
        other.restore(&serde_json::from_str(&frames[start - 1].0).unwrap()).unwrap();
        for frame in start..=FRAMES.min(start + ONWARDS) {
            let found = if frame == start { told(&other) } else { step(&mut other, frame) };
            let expected = &frames[frame - 1];
            let is_like = (found.0 == expected.0, found.1 == expected.1);
            assert_eq!(is_like, (true, true), "{} from {start}, frame {frame}", model.name);
        }
    }
}

/// A factor on the motions of a model: a body under this law gives way beyond.
fn wildness(model: &ModelEntry) -> f64 {
    if model.name == "neo_hookean" { 0.4 } else { 1.0 }
}

#[test]
fn every_model_goes_on_from_a_snapshot_with_the_same_bits() {
    side_by_side(MODELS, |model| goes_on(model, false, wildness(model)));
}

#[test]
fn loads_go_on_from_a_snapshot_with_the_same_bits() {
    side_by_side(MODELS, |model| goes_on(model, true, wildness(model)));
}

#[test]
fn a_snapshot_of_another_body_is_refused() {
    let rod = MODELS.iter().find(|model| model.name == "rod").unwrap();
    let rotation = MODELS.iter().find(|model| model.name == "rotation").unwrap();
    let (mut one, other) = (patient(&file_of(rod, false), rod), patient(&file_of(rotation, false), rotation));
    let before = told(&one);
    assert!(one.restore(&other.snapshot()).is_err());
    let mut short = one.snapshot();
    short.memory.unknowns.pop();
    let message = one.restore(&short).unwrap_err();
    assert!(message.contains("unknowns"), "{message}");
    assert!(told(&one) == before);
}
