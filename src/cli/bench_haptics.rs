//! The table "haptic tick" of `greenstage bench`: work of one tick of the force loop, alone and beside the renderer.

use super::failure::Failure;
use crate::deform::{ControlPose, ControlRest};
use crate::effect::haptics::{Control, Elastic, Grasp, Hand, Held, Loop, News, Reading, Simulated, Way};
use crate::green::FIELDS;
use crate::report::table::{Table, seconds};
use crate::stage::Haptic;
use nalgebra::{DMatrix, Isometry3, Matrix4, Rotation3, Similarity3, Vector3};
use std::time::Instant;

/// Control elements of the bodies that are measured.
pub const ELEMENTS: [usize; 3] = [2, 4, 8];
const TICKS: u32 = 20_000;

/// `draw` draws a frame; it is called for some seconds beside a loop of each size.
pub fn table(mut draw: impl FnMut() -> Result<(), Failure>) -> Result<(String, Table), Failure> {
    let heading = [
        "control elements",
        "model",
        "work p50",
        "p99",
        "beside the renderer p50",
        "p99",
        "begins late p50",
        "p99",
    ];
    let mut table = Table::new(&heading);
    for elements in ELEMENTS {
        for model in ["linear", "rotation"] {
            let Some(mut control) = control(model, elements) else { continue };
            let [p50, p99] = alone(&mut control);
            let Some(control) = self::control(model, elements) else { continue };
            let busy = beside(control, &mut draw)?;
            let cells =
                [p50, p99, busy.work_p50_s, busy.work_p99_s, busy.late_p50_s, busy.late_p99_s].map(seconds);
            let mut row = vec![elements.to_string(), model.to_owned()];
            row.extend(cells);
            table.rows.push(row);
        }
    }
    Ok(("Haptic tick at 1 kHz".to_owned(), table))
}

/// A loop on a body of so many control elements, one of them held, S full and of the demo's size.
fn control(model: &str, elements: usize) -> Option<Control> {
    let rest = |e: usize| ControlRest {
        name: e.to_string(),
        origin: Vector3::new((e as f64).cos(), (e as f64).sin(), 0.1 * e as f64) * 0.5,
        nodes: 10 + e,
    };
    let controls: Vec<ControlRest> = (0..elements).map(rest).collect();
    let n = FIELDS * elements;
    let root =
        DMatrix::from_fn(n, n, |i, j| ((3 * i + 7 * j) as f64).sin() + if i == j { 10.0 } else { 0.0 });
    let body = Elastic::new(model, &(&root * root.transpose()), &controls).ok()?;
    let mut control = Control::new(Haptic::simulated("bench"), vec![body], 0.0);
    let held = Held {
        grip: 1,
        body: 0,
        element: 1,
        room_from_body: Similarity3::identity(),
        way: Way::Rigid(Matrix4::new_translation(&controls[1].origin)),
        mean: Rotation3::identity(),
    };
    let poses = vec![ControlPose::REST; elements];
    control.take(&Grasp { held: Some(held), poses, room_from_hand: None });
    Some(control)
}

/// Half and 99 % of the ticks take no longer than this, s.
fn alone(control: &mut Control) -> [f64; 2] {
    let mut times = Vec::with_capacity(TICKS as usize);
    for tick in 1..=TICKS {
        let now_s = 1e-3 * f64::from(tick);
        let phase = 6.0 * now_s;
        let motion = Vector3::new(phase.sin(), phase.cos() - 1.0, (2.0 * phase).sin());
        let device_from_handle = Isometry3::new(motion * 0.01, motion * 0.02);
        let (buttons, news) = ([true, false], News::default());
        let reading = Reading { device_from_handle, buttons, arrived_s: now_s, tracked: true, news };
        let started = Instant::now();
        std::hint::black_box(control.tick(Some(&reading), now_s));
        times.push(started.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    [times[times.len() / 2], times[times.len() * 99 / 100]]
}

/// The loop's thread for a second and a half of drawing.
fn beside(
    control: Control,
    draw: &mut impl FnMut() -> Result<(), Failure>,
) -> Result<crate::effect::haptics::Clockwork, Failure> {
    let device = Simulated::new(&control.haptic, Hand::FINGERS);
    let mut running = Loop::start(control, Box::new(device)).map_err(Failure::work)?;
    let started = Instant::now();
    while started.elapsed().as_secs_f64() < 1.5 {
        draw()?;
    }
    Ok(running.report().clockwork)
}
