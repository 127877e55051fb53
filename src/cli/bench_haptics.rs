//! The table "haptic tick" of `greenstage bench`: measures the work of one tick of the force loop, alone and while the
//! renderer draws.

use crate::base::failure::Failure;
use crate::base::statistics::{median, quantile};
use crate::base::table::{Table, seconds};
use crate::deform::{ControlPose, ControlRest, CubicForm};
use crate::effect::haptics::{
    Control, Elastic, Grasp, Hand, Held, HoldConstraint, Loop, LoopTiming, Reading, SampleInfo, Simulated,
};
use crate::green::FIELDS;
use crate::stage::Haptic;
use nalgebra::{DMatrix, Isometry3, Matrix4, Similarity3, Vector3};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Control elements of the bodies that are measured.
pub const ELEMENTS: [usize; 3] = [2, 4, 8];
const TICKS: u32 = 20_000;

/// Ticks between two frames, as the loop hears of them.
const FRAME: u32 = 16;

/// Time of a tick for one body, s: half of the ticks, and 99 % of them, take no longer.
#[derive(serde::Serialize)]
pub struct Row {
    elements: usize,
    model: &'static str,
    work_p50_s: f64,
    work_p99_s: f64,
    /// Taking over what a frame of the display tells the loop, beside a tick.
    take_p50_s: f64,
    take_p99_s: f64,
    busy_p50_s: f64,
    busy_p99_s: f64,
    late_p50_s: f64,
    late_p99_s: f64,
}

/// `draw` draws a frame; it is called for some seconds beside a loop of each size.
pub fn measure(mut draw: impl FnMut() -> Result<(), Failure>) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for elements in ELEMENTS {
        for model in ["linear", "rotation"] {
            let Some((mut control, grasp)) = control(model, elements) else { continue };
            let [[work_p50_s, work_p99_s], [take_p50_s, take_p99_s]] = alone(&mut control, &grasp);
            let Some((control, grasp)) = self::control(model, elements) else { continue };
            let busy = beside(control, &grasp, &mut draw)?;
            rows.push(Row {
                elements,
                model,
                work_p50_s,
                work_p99_s,
                take_p50_s,
                take_p99_s,
                busy_p50_s: busy.work_p50_s,
                busy_p99_s: busy.work_p99_s,
                late_p50_s: busy.late_p50_s,
                late_p99_s: busy.late_p99_s,
            });
        }
    }
    Ok(rows)
}

pub fn table(rows: &[Row]) -> (String, Table) {
    let heading = [
        "control elements",
        "model",
        "work p50",
        "p99",
        "a frame's news p50",
        "p99",
        "beside the renderer p50",
        "p99",
        "begins late p50",
        "p99",
    ];
    let mut table = Table::new(&heading);
    for row in rows {
        let times = [
            row.work_p50_s,
            row.work_p99_s,
            row.take_p50_s,
            row.take_p99_s,
            row.busy_p50_s,
            row.busy_p99_s,
            row.late_p50_s,
            row.late_p99_s,
        ];
        let mut cells = vec![row.elements.to_string(), row.model.to_owned()];
        cells.extend(times.map(seconds));
        table.rows.push(cells);
    }
    ("Haptic tick at 1 kHz".to_owned(), table)
}

/// The pose of the handle: it moves by centimetres and turns by half a radian, so that the coupling is computed anew some
/// twenty times a second.
fn handle(time_s: f64) -> Isometry3<f64> {
    let phase = 6.0 * time_s;
    let motion = Vector3::new(phase.sin(), phase.cos() - 1.0, (2.0 * phase).sin());
    Isometry3::new(motion * 0.01, motion * 0.25)
}

/// A loop on a body of so many control elements, one of them held, S full and of the demo's size.
pub fn control(model: &str, elements: usize) -> Option<(Control, Grasp)> {
    let rest = |e: usize| ControlRest {
        name: e.to_string(),
        origin: Vector3::new((e as f64).cos(), (e as f64).sin(), 0.1 * e as f64) * 0.5,
        nodes: 10 + e,
    };
    let controls: Vec<ControlRest> = (0..elements).map(rest).collect();
    let n = FIELDS * elements;
    let root =
        DMatrix::from_fn(n, n, |i, j| ((3 * i + 7 * j) as f64).sin() + if i == j { 10.0 } else { 0.0 });
    let table = |name: &str| match name {
        "stiffness" => Some(&root * root.transpose()),
        "cubic" => Some(DMatrix::from_element(CubicForm::coefficients_of(n), 1, 0.01)),
        _ => None,
    };
    let body = Elastic::of_tables(model, &controls, &table).ok()?;
    let control = Control::new(Haptic::simulated("bench"), vec![body], 0.0);
    let held = Held {
        grip: 1,
        body: 0,
        element: 1,
        room_from_body: Similarity3::identity(),
        constraint: HoldConstraint::Rigid(Matrix4::new_translation(&controls[1].origin)),
    };
    let poses = vec![ControlPose::REST; elements];
    Some((control, Grasp { held: Some(held), poses, ..Grasp::default() }))
}

/// p50 and p99 of a tick, and of taking a frame's news.
fn alone(control: &mut Control, grasp: &Grasp) -> [[f64; 2]; 2] {
    let (mut ticks, mut takes) = (Vec::new(), Vec::new());
    for tick in 0..TICKS {
        let now_s = 1e-3 * f64::from(tick);
        if tick.is_multiple_of(FRAME) {
            let started = Instant::now();
            control.take(std::hint::black_box(grasp));
            takes.push(started.elapsed().as_secs_f64());
        }
        let reading = Reading {
            device_from_handle: handle(now_s),
            buttons: [true, false],
            arrived_s: now_s,
            measured_s: None,
            tracked: true,
            info: SampleInfo::default(),
        };
        let started = Instant::now();
        std::hint::black_box(control.tick(Some(&reading), now_s));
        ticks.push(started.elapsed().as_secs_f64());
    }
    [ticks, takes].map(|times| [median(times.iter().copied()), quantile(times, 0.99)])
}

/// The loop's thread for a second and a half of drawing; it hears of a frame sixty times a second, however long one takes.
fn beside(
    control: Control,
    grasp: &Grasp,
    draw: &mut impl FnMut() -> Result<(), Failure>,
) -> Result<LoopTiming, Failure> {
    let device = Simulated::scripted(&control.haptic, Hand::FINGERS, Box::new(handle));
    let mut running = Loop::start(control, Box::new(device)).map_err(Failure::work)?;
    let (started, is_over) = (Instant::now(), AtomicBool::new(false));
    let drawn = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                running.tell(|told| told.clone_from(grasp));
                std::thread::sleep(Duration::from_millis(u64::from(FRAME)));
            }
        });
        let mut drawn = Ok(());
        while drawn.is_ok() && started.elapsed().as_secs_f64() < 1.5 {
            drawn = draw();
        }
        is_over.store(true, Ordering::Relaxed);
        drawn
    });
    drawn?;
    Ok(running.report().timing)
}
