//! The table "haptic tick" of `greenstage bench`: measures the work of one tick of the force loop, alone and while the
//! renderer draws.

use crate::base::failure::Failure;
use crate::base::machine::thread_s;
use crate::base::statistics::quantile;
use crate::base::table::{Table, seconds};
use crate::deform::ControlPose;
use crate::effect::haptics::{
    Control, Elastic, ElementHold, Grasp, Hand, HoldConstraint, Loop, LoopTiming, Reading, SampleInfo,
    Simulated,
};
use crate::scene::Grab;
use crate::stage::Haptic;
use crate::world::PlacedBody;
use nalgebra::{Isometry3, Matrix4, Similarity3, Vector3};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const TICKS: u32 = 20_000;

/// Ticks between two frames, as the loop hears of them.
const FRAME: u32 = 16;

/// Motion of the handle, as a part of the body's size, and its turn, rad: large enough that most ticks find a column of the
/// body's stiffness too.
const MOVES: f64 = 0.02;
const TURNS: f64 = 0.25;

/// Time of a tick for one body, s: half of the ticks, 99 % and 99.9 % of them, take no longer.
#[derive(serde::Serialize)]
pub struct Row {
    body: String,
    model: &'static str,
    elements: usize,
    work_p50_s: f64,
    work_p99_s: f64,
    work_p999_s: f64,
    /// Time to take over a frame of the display in the loop, in addition to a tick, s.
    take_p50_s: f64,
    take_p99_s: f64,
    busy_p50_s: f64,
    busy_p99_s: f64,
    late_p50_s: f64,
    late_p99_s: f64,
}

/// A body of the scene, of which a hand holds a control element.
pub struct Subject {
    body: String,
    model: &'static str,
    held: usize,
    /// The element's origin at rest, and the body's size, m.
    origin: Vector3<f64>,
    size: f64,
    elements: usize,
    /// One to be measured alone and one beside the renderer.
    elastic: [Elastic; 2],
}

impl Subject {
    /// The hand holds the first control element that a hand can take.
    pub fn new(body: &PlacedBody) -> Result<Subject, String> {
        let deformer = &body.deformer;
        let elastic = [Elastic::from_deformer(deformer)?, Elastic::from_deformer(deformer)?];
        let held = body.assets.controls.iter().position(|control| control.grab == Grab::Dragger).unwrap_or(0);
        Ok(Subject {
            body: deformer.body.clone(),
            model: body.assets.model.name,
            held,
            origin: deformer.controls[held].origin,
            size: body.assets.ball.1,
            elements: deformer.controls.len(),
            elastic,
        })
    }
}

/// `draw` draws a frame; it is called for some seconds beside a loop of each body.
pub fn measure(
    subjects: Vec<Subject>,
    mut draw: impl FnMut() -> Result<(), Failure>,
) -> Result<Vec<Row>, Failure> {
    let mut rows = Vec::new();
    for Subject { body, model, held, origin, size, elements, elastic: [first, second] } in subjects {
        let script = move |time_s: f64| handle(time_s, &origin, size);
        let grasp = grasp(held, elements);
        let haptic = Haptic::simulated("bench");
        let mut control = Control::new(haptic.clone(), vec![first], 0.0);
        let [[work_p50_s, work_p99_s, work_p999_s], [take_p50_s, take_p99_s, _]] =
            alone(&mut control, &grasp, &script);
        let device = Simulated::scripted(&haptic, Hand::FINGERS, Box::new(script));
        let busy = beside(Control::new(haptic, vec![second], 0.0), device, &grasp, &mut draw)?;
        rows.push(Row {
            body,
            model,
            elements,
            work_p50_s,
            work_p99_s,
            work_p999_s,
            take_p50_s,
            take_p99_s,
            busy_p50_s: busy.work_p50_s,
            busy_p99_s: busy.work_p99_s,
            late_p50_s: busy.late_p50_s,
            late_p99_s: busy.late_p99_s,
        });
    }
    Ok(rows)
}

pub fn table(rows: &[Row]) -> (String, Table) {
    let heading = [
        "body",
        "model",
        "control elements",
        "work p50",
        "p99",
        "p99.9",
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
            row.work_p999_s,
            row.take_p50_s,
            row.take_p99_s,
            row.busy_p50_s,
            row.busy_p99_s,
            row.late_p50_s,
            row.late_p99_s,
        ];
        let mut cells = vec![format!("body.{}", row.body), row.model.to_owned(), row.elements.to_string()];
        cells.extend(times.map(seconds));
        table.rows.push(cells);
    }
    ("Haptic tick at 1 kHz".to_owned(), table)
}

/// The pose of a handle at the origin of the held element, in a room that is the body's frame.
fn handle(time_s: f64, origin: &Vector3<f64>, size: f64) -> Isometry3<f64> {
    let phase = 6.0 * time_s;
    let motion = Vector3::new(phase.sin(), phase.cos() - 1.0, (2.0 * phase).sin());
    Isometry3::new(origin + motion * (MOVES * size), motion * TURNS)
}

/// A hold on an element at rest.
fn grasp(element: usize, elements: usize) -> Grasp {
    let held = ElementHold {
        grip: 1,
        body: 0,
        element,
        room_from_body: Similarity3::identity(),
        constraint: HoldConstraint::Rigid(Matrix4::identity()),
    };
    Grasp { held: Some(held), poses: vec![ControlPose::REST; elements], ..Grasp::default() }
}

/// p50, p99 and p99.9 of a tick's processor time, and of taking a frame's news.
fn alone(control: &mut Control, grasp: &Grasp, script: &impl Fn(f64) -> Isometry3<f64>) -> [[f64; 3]; 2] {
    let (mut ticks, mut takes) = (Vec::new(), Vec::new());
    for tick in 0..TICKS {
        let now_s = 1e-3 * f64::from(tick);
        if tick.is_multiple_of(FRAME) {
            let started_s = thread_s();
            control.take(std::hint::black_box(grasp));
            takes.push(thread_s() - started_s);
        }
        let reading = Reading {
            device_from_handle: script(now_s),
            buttons: [true, false],
            arrived_s: now_s,
            measured_s: None,
            tracked: true,
            info: SampleInfo::default(),
        };
        let started_s = thread_s();
        std::hint::black_box(control.tick(Some(&reading), now_s));
        ticks.push(thread_s() - started_s);
    }
    [ticks, takes].map(|times| {
        let of = |share| quantile(times.iter().copied(), share);
        [of(0.5), of(0.99), of(0.999)]
    })
}

/// The loop's thread for a second and a half of drawing; it hears of a frame sixty times a second, however long one takes.
fn beside(
    control: Control,
    device: Simulated,
    grasp: &Grasp,
    draw: &mut impl FnMut() -> Result<(), Failure>,
) -> Result<LoopTiming, Failure> {
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
