//! A made-up report: no figure in it was measured.

use greenstage::deform::find_model;
use greenstage::measure::{
    Cost, EffectCost, Errors, Measurement, ModelError, ModelTrial, ModelTrials, Report, SCHEMA, Setting,
    SmoothError, Spread, Timing, TrialMotion,
};

const ELEMENTS: [&str; 3] = ["tet4", "tet4_anp", "tet10"];
const SOLVERS: [(&str, f64, f64); 5] = [
    ("cholesky", 3e-13, 1.0),
    ("pcg 1e-4", 2.1e-3, 0.55),
    ("pcg 1e-6", 1.8e-5, 0.71),
    ("pcg 1e-8", 2.3e-7, 0.86),
    ("pcg 1e-10", 1.9e-9, 1.02),
];
const STORAGES: [(&str, f64, f64, f64); 4] = [
    ("f64", 0.0, 2.0, 1.9),
    ("f32", 3e-8, 1.0, 1.0),
    ("f16", 2.6e-4, 0.5, 0.62),
    ("int16", 1.4e-5, 0.5, 0.6),
];
const MODELS: [(&str, f64, f64); 2] = [("linear", 4.2e-2, 1.0), ("rotation", 2.5e-3, 1.12)];

/// A number near 1 that depends on nothing but its key: timings scatter.
fn scatter(key: usize, width: f64) -> f64 {
    let hash = (key.wrapping_mul(2_654_435_761) >> 7) % 1000;
    1.0 + width * (hash as f64 / 500.0 - 1.0)
}

fn spread(median: f64) -> Spread {
    Spread { median, worst: 2.4 * median }
}

/// Every value of every parameter.
pub fn made_up() -> Report {
    let mut rows = Vec::new();
    for (e, element) in ELEMENTS.into_iter().enumerate() {
        for refine in 0..3 {
            for (s, solver) in SOLVERS.into_iter().enumerate() {
                for storage in STORAGES {
                    for model in MODELS {
                        let key = 1000 * e + 100 * refine as usize + 10 * s;
                        rows.push(row(e, element, refine, solver, storage, model, key));
                    }
                }
            }
        }
    }
    Report {
        schema: SCHEMA,
        program: "greenstage 0.1.0 (made up for a test)".into(),
        machine: "A made-up processor, 2 cores; one and the same task took 0.97 to 1.06 of its median".into(),
        scene: "configs/scenes/tube.toml".into(),
        command: "greenstage accuracy configs/scenes/tube.toml -o out/accuracy".into(),
        body: "tube".into(),
        about: vec![
            "2,769 nodes, 9,600 tetrahedra, surface of 1,480 nodes".into(),
            "Young's modulus 1 MPa, Poisson's ratio 0.3; control elements left (fixed) and right (dragger)"
                .into(),
        ],
        size: 0.6,
        references: vec![
            "Discretisation: tet10 on the mesh refined three times, f64".into(),
            "Solver: Cholesky with iterative refinement, f64, on the same mesh".into(),
            "Storage: the same columns in f64".into(),
            "Model: static equilibrium at large strain (St. Venant–Kirchhoff, Newton), on the same mesh"
                .into(),
        ],
        poses: ["bend 10°", "bend 30°", "bend 60°", "twist 45°", "stretch 20 %"].map(String::from).to_vec(),
        pose_source: "made by the program".into(),
        compared: ["bend 10°", "bend 30°", "bend 60°"].map(String::from).to_vec(),
        not_compared: vec!["twist 45°: tet10 has no equilibrium beyond 80 % of the way".into()],
        doubt: Some([2e-3, 8e-3]),
        quick: false,
        own: Setting {
            refine: 0,
            element: "tet4".into(),
            solver: "cholesky".parse().unwrap(),
            storage: "f32".into(),
            model: find_model("rotation").unwrap(),
        },
        rows,
        timing: Timing { scatter: 1.05, load: 1.0, processors: 2 },
        models: models(),
        trials: trials(),
        smooth: smooth(),
        effects: effects(),
        left_out: Vec::new(),
        shapes: None,
    }
}

fn row(
    e: usize,
    element: &str,
    refine: u32,
    (solver, solver_error, solver_time): (&str, f64, f64),
    (storage, storage_error, storage_bytes, storage_time): (&str, f64, f64, f64),
    (model, model_error, model_time): (&str, f64, f64),
    key: usize,
) -> Measurement {
    let n = f64::from(refine);
    let quadratic = e == 2;
    let mesh_nodes = 2769.0 * 7.4_f64.powf(n) * if quadratic { 7.3 } else { 1.0 };
    let surface = 1480.0 * 4.0_f64.powf(n) * if quadratic { 4.0 } else { 1.0 };
    let discretisation = [0.12, 0.09, 0.014][e] * [0.29_f64, 0.29, 0.17][e].powf(n);
    let factor = 1.1e-9 * mesh_nodes.powf(1.9) * [1.0, 2.3, 1.4][e];
    let iterative = if solver == "cholesky" { factor } else { solver_time * 4e-6 * mesh_nodes.powf(1.28) };
    let offline_s = (0.05 + iterative) * scatter(key, 0.04);
    let columns = surface * 24.0 * 12.0;
    let frame = columns * storage_time * model_time / 27e9 + 4e-6;
    let parts = [discretisation, solver_error, storage_error, model_error * scatter(key + 3, 0.02)];
    let total = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
    Measurement {
        setting: Setting {
            refine,
            element: element.into(),
            solver: solver.parse().unwrap(),
            storage: storage.into(),
            model: find_model(model).unwrap(),
        },
        mesh_nodes: mesh_nodes as usize,
        surface_nodes: surface as usize,
        forward_error: None,
        cost: Cost {
            offline_s,
            offline_bytes: 320.0 * mesh_nodes.powf(1.25),
            file_bytes: 4.0e4 + columns * storage_bytes,
            packed_bytes: Some(3.6e4 + 0.83 * columns * storage_bytes),
            frame_p50_s: frame,
            frame_p99_s: 1.7 * frame,
            frame_one_p50_s: 0.45 * frame,
            frame_bytes: Some(columns * storage_bytes),
        },
        error: Errors {
            discretisation: Some(spread(parts[0])),
            energy: Some(spread(2.7 * parts[0].sqrt() * 0.2)),
            solver: spread(parts[1]),
            storage: Some(spread(parts[2])),
            model: spread(parts[3]),
            total: spread(total),
            uncancelled: spread(total),
            displacement_m: spread(0.05 * total),
            force: spread(1.6 * parts[0]),
            torque: spread(1.9 * parts[0]),
            mesh_held: Some(spread(1.7 * parts[0])),
            model_held: spread(1.4 * parts[3]),
            uncancelled_held: spread(1.9 * parts[0]),
        },
    }
}

fn models() -> Vec<ModelError> {
    let angles = [2.0_f64, 8.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0];
    let of = |(model, factor, power): (&str, f64, f64)| {
        let model = model.to_owned();
        angles.map(|degrees| ModelError {
            model: model.clone(),
            pose: format!("bend {degrees}°"),
            rotation: degrees.to_radians(),
            error: factor * degrees.to_radians().powf(power),
            displacement_m: 0.3 * factor * degrees.to_radians().powf(power + 1.0),
        })
    };
    [("linear", 0.31, 1.1), ("rotation", 0.05, 1.6), ("corotational", 0.004, 1.3), ("stvk", 1e-9, 0.2)]
        .into_iter()
        .flat_map(of)
        .collect()
}

fn trials() -> ModelTrials {
    let of = |(model, factor, power, frame_s): (&'static str, f64, f64, f64)| {
        let motions = TrialMotion::ALL.into_iter().zip([1.0, 0.3]);
        motions.flat_map(move |(motion, part)| {
            [1.0, 10.0, 30.0, 90.0, 180.0, 360.0].map(|degrees: f64| {
                let error = part * factor * degrees.to_radians().powf(power);
                ModelTrial {
                    model: model.into(),
                    motion,
                    degrees,
                    displacement: 0.1 * error,
                    force: (degrees < 300.0).then_some(error),
                    torque: (degrees < 300.0).then_some(0.4 * error),
                    energy: (degrees < 300.0).then_some(1.0 - error),
                    frame_s,
                }
            })
        })
    };
    let rows = [("linear", 4.0, 1.0, 2e-5), ("rotation", 0.3, 2.0, 3e-5), ("reduced", 0.004, 3.0, 9e-4)];
    ModelTrials {
        about: vec!["Made up: the control element right against left.".into()],
        rows: rows.into_iter().flat_map(of).collect(),
    }
}

fn smooth() -> Vec<SmoothError> {
    let of = |(element, l2, energy, promised): (&'static str, f64, f64, [f64; 2])| {
        [0_u32, 1, 2].map(|refine| {
            let h = 0.021 / f64::from(1 << refine);
            SmoothError {
                element: element.into(),
                refine,
                h,
                l2: l2 * (h / 0.021).powf(promised[0] - 0.06),
                energy: energy * (h / 0.021).powf(promised[1] + 0.03),
                l2_rate: Some(promised[0] - 0.06),
                energy_rate: Some(promised[1] + 0.03),
                promised,
            }
        })
    };
    [
        ("tet4", 3.1e-2, 2.2e-1, [2.0, 1.0]),
        ("tet4_anp", 2.4e-2, 1.9e-1, [2.0, 1.0]),
        ("tet10", 1.3e-3, 2.1e-2, [3.0, 2.0]),
    ]
    .into_iter()
    .flat_map(of)
    .collect()
}

fn effects() -> Vec<EffectCost> {
    [("haptics", true), ("stress", false), ("contact", false)]
        .into_iter()
        .map(|(effect, listed)| {
            let cost = if listed { 1.0 } else { 0.0 };
            EffectCost {
                effect: effect.into(),
                listed,
                offline_s: 0.018 * cost,
                file_bytes: 4608.0 * cost,
                memory_bytes: 9216.0 * cost,
                frame_s: 4.1e-7 * cost,
            }
        })
        .collect()
}
