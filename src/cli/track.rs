//! `greenstage track`: shows live what every sensor, button and valuator of a stage reports.

use super::parsers;
use super::print::{print, print_over};
use super::serve::{self, Service};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::table::Table;
use crate::session::trackers;
use crate::stage::Stage;
use crate::track::device::{Link, now_s};
use crate::track::doubts::{self, Doubt};
use crate::track::stand_in::device_names;
use crate::track::tracker_set::{SensorReport, TrackerReport, TrackerSet};
use crate::track::{Redirect, Signal};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::fmt::Write;
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::time::Duration;

/// Show live what the trackers of a stage report: pose, rate, age, jitter and drop-outs of every sensor
///
/// On a terminal the table stays in its place; into a file or a pipe it is written anew each time. Ctrl+C ends it. With --once
/// or --seconds the status is 1 if at the end a tracker is not there or a sensor of the stage was never heard. The columns:
/// `greenstage manual tracking`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A stage file, or the name of a built-in stage; with --script, whose workspace the script refers to
    #[arg(required_unless_present = "script")]
    pub stage: Option<String>,
    /// Quit after so many seconds
    #[arg(long, value_parser = parsers::positive)]
    pub seconds: Option<f64>,
    /// Seconds from one table to the next
    #[arg(long, default_value_t = 0.5, value_parser = parsers::positive)]
    pub interval: f64,
    /// Listen for --seconds (default: 1), then print the table once
    #[arg(long)]
    pub once: bool,
    /// Show poses as the trackers report them, before calibration, filter and prediction
    #[arg(long)]
    pub raw: bool,
    /// Print one JSON object per line
    #[arg(long)]
    pub json: bool,
    /// Serve the trackers by VRPN, each as the device of its VRPN address, others by their names; without a value at
    /// 127.0.0.1:3883, for this machine
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, value_parser = serve::place,
          default_missing_value = serve::DEFAULT_PLACE)]
    pub serve: Option<SocketAddr>,
    /// Serve a script in place of the stage's trackers, in their own frames and units, as the devices that the stage names
    /// (where it names none, as Tracker0): bend, or a .toml file
    #[arg(long, requires = "serve")]
    pub script: Option<String>,
    /// Readings of the script per second
    #[arg(long, default_value_t = 120.0, value_parser = parsers::positive, requires = "script")]
    pub rate: f64,
    #[command(flatten)]
    pub redirects: Redirects,
}

/// Other VRPN servers for trackers of a stage.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Redirects {
    /// Take a tracker's poses from another VRPN server than the stage file says: lab=127.0.0.1, or lab=Tracker1@host:3884;
    /// may be given again for another tracker
    #[arg(long = "tracker", value_name = "NAME=HOST")]
    pub redirects: Vec<Redirect>,
}

impl Redirects {
    pub fn apply(&self, stage: &mut Stage) -> Result<(), Failure> {
        Redirect::apply_all(&self.redirects, &mut stage.tracking)
            .map_err(|message| Failure::wrong(format!("--tracker: {message}")))
    }
}

/// Time between two polls of the sources, s, so short that no report between two frames of a display is missed.
const STEP_S: f64 = 0.005;

pub fn run(args: &Args) -> Result<(), Failure> {
    let named = args.stage.as_deref().unwrap_or("workbench");
    let mut stage = crate::track::find_stage(named).map_err(Failure::request)?;
    let devices = device_names(&stage.tracking);
    args.redirects.apply(&mut stage)?;
    if let (Some(script), Some(place)) = (&args.script, args.serve) {
        return serve::script(place, script, stage, args.rate, args.seconds);
    }
    let mut trackers = start_trackers(&stage)?;
    let service = args.serve.map(|place| Service::open(place, devices.iter().map(String::as_str)));
    let mut service = service.transpose()?;
    let step_s = if service.is_some() { serve::STEP_S } else { STEP_S };
    let started_s = now_s();
    let limit_s = if args.once { Some(args.seconds.unwrap_or(1.0)) } else { args.seconds };
    let interval_s = if args.once { f64::INFINITY } else { args.interval };
    let in_place = !args.json && !args.once && std::io::stdout().is_terminal();
    let mut next_s = started_s + interval_s;
    let mut missing = None;
    let mut height = 0;
    watch(&mut trackers, step_s, limit_s, |trackers, now_s, is_last| {
        let served = service.iter_mut().flat_map(|service| service.pass_on(trackers)).collect::<Vec<_>>();
        for notice in trackers.take_notices().into_iter().chain(served) {
            notice!("note: {notice}");
            // What was said stands above the table.
            height = 0;
        }
        if now_s < next_s && !is_last {
            return Ok(());
        }
        next_s = now_s + interval_s;
        let reports = trackers.report(now_s);
        missing = missing_parts(&reports);
        let doubts = doubts::doubts(&stage, &reports);
        if args.json {
            return print(&format!("{}\n", json(&reports, &doubts, now_s - started_s)));
        }
        let mut text = text(&reports, args.raw);
        text.extend(doubts.iter().map(|doubt| format!("warning: {}\n", doubt.text)));
        let above = if in_place { height } else { 0 };
        height = text.lines().count();
        print_over(above, &format!("{text}{}", if in_place { "" } else { "\n" }))
    })?;
    match missing {
        Some(missing) => Err(Failure::work(std::io::Error::other(missing))),
        None => Ok(()),
    }
}

/// Trackers that are not there, and sensors of the stage that were never heard.
fn missing_parts(reports: &[TrackerReport]) -> Option<String> {
    let of = |report: &TrackerReport| {
        let unheard = report.sensors.iter().filter(|sensor| sensor.count == 0);
        let unheard =
            unheard.filter_map(|sensor| Some(format!("sensor {} was never heard", sensor.name.as_ref()?)));
        let absent = match report.link {
            Link::Up | Link::Quiet => None,
            Link::Waiting => Some(format!("nothing was heard from tracker {}", report.name)),
            Link::Down(_) => Some(format!("tracker {} is not there", report.name)),
        };
        absent.into_iter().chain(unheard).collect::<Vec<_>>()
    };
    let missing: Vec<String> = reports.iter().flat_map(of).collect();
    (!missing.is_empty()).then(|| missing.join("; "))
}

/// Starts the trackers of a stage.
fn start_trackers(stage: &Stage) -> Result<TrackerSet, Failure> {
    trackers::start(stage, &mut [])?.ok_or_else(|| {
        Failure::wrong(format!(
            "stage {} names no tracker: add a [tracker.NAME] table to its file (`greenstage manual tracking`)",
            stage.name
        ))
    })
}

/// Reads the trackers every `step_s` seconds, for `limit_s` or for ever. `each` gets the trackers, the time, and whether this
/// is the last call; it can pass poses on by [`TrackerSet::devices`] or [`TrackerSet::state`].
pub fn watch(
    trackers: &mut TrackerSet,
    step_s: f64,
    limit_s: Option<f64>,
    mut each: impl FnMut(&mut TrackerSet, f64, bool) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let started_s = now_s();
    loop {
        let time_s = now_s();
        let is_last = limit_s.is_some_and(|limit_s| time_s - started_s >= limit_s);
        trackers.state(time_s);
        each(trackers, time_s, is_last)?;
        if is_last {
            return Ok(());
        }
        std::thread::sleep(Duration::from_secs_f64(step_s));
    }
}

fn text(reports: &[TrackerReport], raw: bool) -> String {
    let mut text = String::new();
    let mut table = Table::new(&[
        "sensor",
        "id",
        "tracker",
        "position (m)",
        "rotation (°)",
        "Hz",
        "age (ms)",
        "jitter (ms)",
        "noise (mm)",
        "lost",
        "odd",
        "signal",
    ]);
    for report in reports {
        for sensor in &report.sensors {
            sensor_row(&mut table, report, sensor, raw);
        }
    }
    if table.rows.len() > 1 {
        text.push_str(&table.text());
    }
    for report in reports {
        let counters = &report.counters;
        let _ = writeln!(
            text,
            "{}: {}, {}; {} packets, {} messages, {} malformed, {} dropped, {} throttled, {} reconnects",
            report.name,
            report.source,
            link(&report.link),
            counters.packets,
            counters.messages,
            counters.malformed,
            counters.dropped,
            counters.throttled,
            counters.reconnects
        );
        let buttons: Vec<String> = report
            .buttons
            .iter()
            .map(|button| format!("{}{}", button.id, if button.value { " PRESSED" } else { "" }))
            .collect();
        if !buttons.is_empty() {
            let _ = writeln!(text, "  buttons {}", buttons.join(", "));
        }
        let valuators: Vec<String> = report
            .valuators
            .iter()
            .map(|valuator| format!("{}: {:+.3}", valuator.id, valuator.value))
            .collect();
        if !valuators.is_empty() {
            let _ = writeln!(text, "  valuators {}", valuators.join(", "));
        }
    }
    text
}

fn sensor_row(table: &mut Table, report: &TrackerReport, sensor: &SensorReport, raw: bool) {
    let pose = if raw { sensor.raw } else { sensor.in_room };
    let three = |v: nalgebra::Vector3<f64>| format!("{:>7.3} {:>7.3} {:>7.3}", v.x, v.y, v.z);
    let degrees = |v: nalgebra::Vector3<f64>| v.map(|x| (x.to_degrees() * 10.0).round() / 10.0 + 0.0);
    let turn = |v| degrees(v).iter().map(|x| format!("{x:>6.1}")).collect::<Vec<_>>().join(" ");
    let [place, turn] = match pose {
        Some(pose) => [three(pose.translation.vector), turn(pose.rotation.scaled_axis())],
        None => [String::new(), String::new()],
    };
    let is_heard = sensor.count > 0;
    let figure = |text: String| if is_heard { text } else { String::new() };
    let faults = sensor.faults;
    table.row(&[
        sensor.name.as_deref().unwrap_or("–"),
        &sensor.id.to_string(),
        &report.name,
        &place,
        &turn,
        &figure(format!("{:.1}", sensor.rate_hz)),
        &figure(format!("{:.0}", sensor.age_s * 1e3)),
        &figure(format!("{:.2}", sensor.interval_jitter_s * 1e3)),
        &figure(format!("{:.3}", sensor.noise * 1e3)),
        &faults.drop_outs.to_string(),
        &(faults.invalid + faults.jumps + faults.clock).to_string(),
        signal(sensor),
    ]);
}

fn signal(sensor: &SensorReport) -> &'static str {
    match sensor.signal {
        _ if sensor.count == 0 => "never heard",
        _ if sensor.raw.is_none() => "not tracked",
        Signal::Lost { .. } => "LOST",
        Signal::Held { .. } => "held",
        Signal::Live if sensor.quality <= 0.0 => "not tracked",
        Signal::Live => "live",
    }
}

fn link(link: &Link) -> String {
    match link {
        Link::Waiting => "waiting".into(),
        Link::Up => "up".into(),
        Link::Quiet => "up, but silent".into(),
        Link::Down(why) => format!("DOWN: {why}"),
    }
}

fn json(reports: &[TrackerReport], doubts: &[Doubt], time_s: f64) -> Value {
    let trackers: Vec<Value> = reports
        .iter()
        .map(|report| {
            let counters = &report.counters;
            json!({
                "name": report.name,
                "source": report.source,
                "link": link(&report.link),
                "packets": counters.packets,
                "messages": counters.messages,
                "malformed": counters.malformed,
                "dropped": counters.dropped,
                "throttled": counters.throttled,
                "reconnects": counters.reconnects,
                "sensors": report.sensors.iter().map(sensor_json).collect::<Vec<_>>(),
                "buttons": report.buttons.iter().map(|button| json!({
                    "id": button.id, "pressed": button.value, "age_s": button.age_s, "count": button.count,
                })).collect::<Vec<_>>(),
                "valuators": report.valuators.iter().map(|valuator| json!({
                    "id": valuator.id, "value": valuator.value, "age_s": valuator.age_s, "count": valuator.count,
                })).collect::<Vec<_>>(),
            })
        })
        .collect();
    let doubts: Vec<&str> = doubts.iter().map(|doubt| doubt.text.as_str()).collect();
    json!({ "time_s": time_s, "trackers": trackers, "warnings": doubts })
}

fn sensor_json(sensor: &SensorReport) -> Value {
    let pose = |pose: Option<Isometry3<f64>>| {
        pose.map(|pose| {
            let q = pose.rotation.coords;
            json!({ "position": pose.translation.vector.as_slice(), "quaternion_xyzw": q.as_slice() })
        })
    };
    json!({
        "name": sensor.name,
        "id": sensor.id,
        "raw": pose(sensor.raw),
        "in_room": pose(sensor.in_room),
        "signal": signal(sensor),
        "quality": sensor.quality,
        "count": sensor.count,
        "rate_hz": sensor.rate_hz,
        "age_s": sensor.age_s,
        "noise_m": sensor.noise,
        "interval_jitter_s": sensor.interval_jitter_s,
        "drop_outs": sensor.faults.drop_outs,
        "invalid": sensor.faults.invalid,
        "jumps": sensor.faults.jumps,
        "clock_faults": sensor.faults.clock,
    })
}
