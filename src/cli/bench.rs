//! `greenstage bench`: measures the frame rate, and where a frame's time goes.

use super::opening::Guess;
use super::print::print;
use super::{bench_snapshot, marks, parsers, precompute};
use crate::base::columns::ColumnGroup;
use crate::base::diagnostic::{is_verbose, notice};
use crate::base::failure::Failure;
use crate::base::machine;
use crate::base::statistics::median;
use crate::base::table::{Table, bytes, seconds};
use crate::deform::{BYTES_PER_THREAD, Superposition, vertex_normals};
use crate::display::device::{self, Shadows};
use crate::display::offscreen::{DrawTimes, Pictures, Targets};
use crate::display::pictures;
use crate::green::{FIELDS, Precomputed, STIFFNESS};
use crate::prepare::{self, Resolved};
use crate::render::{DrawCounts, Samples};
use crate::scene::Storage;
use crate::session::{Playback, Request, Session};
use crate::solve::Silent;
use crate::stage::Stage;
use crate::tuning;
use crate::verify::haptic_tick::{self, Subject};
use crate::world::StepTimes;
use serde_json::{Value, json};
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

/// Measure the frame rate and where a frame's time goes, offline and online
///
/// Runs the offline stage anew; then the two online loops at the paper's 10,000 nodes, beside the memory bandwidth measured in the
/// same run; then the scene's script, offscreen on a stage; what a snapshot of the session takes; and, if a body lists the effect
/// haptics, the ticks of its force loop.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML); or a mesh or surface file, for which a scene is proposed
    #[arg(required_unless_present_any = ["sizes", "effects", "moved"])]
    pub scene: Option<PathBuf>,
    #[command(flatten)]
    pub guess: Guess,
    /// Measure generated bodies of so many surface nodes instead of a scene, deformed on the CPU and on the device
    #[arg(long, value_delimiter = ',', conflicts_with_all = ["scene", "readme"])]
    pub sizes: Vec<usize>,
    /// How the columns of --sizes are stored: f32, f16 or int16
    #[arg(long, default_value = "f32", value_parser = parsers::storage, conflicts_with_all = ["scene", "effects"])]
    pub storage: Storage,
    /// Stage: a built-in one (workbench, cyberstage, cave6, …; `greenstage manual stages`), or a stage file; default: the scene's
    #[arg(long)]
    pub stage: Option<String>,
    /// A session recorded by `greenstage view --record`, in place of the scene's script and on its stage
    #[arg(long)]
    pub replay: Option<PathBuf>,
    /// Frames for each figure [default: 24 to draw, 300 with --effects]
    #[arg(long, value_parser = parsers::frames)]
    pub frames: Option<usize>,
    /// Measure the force loop's ticks on all bodies, not only on those that list the effect haptics
    #[arg(long)]
    pub haptics: bool,
    /// Print the results as JSON
    #[arg(long)]
    pub json: bool,
    /// Write the tables between the marks of this Markdown file
    #[arg(long)]
    pub readme: Option<PathBuf>,
    /// Measure although this program was compiled for tests, whose times mean nothing
    #[arg(long, hide = true)]
    pub test_build: bool,
    #[command(flatten)]
    pub of_effects: effects::Args,
    #[command(flatten)]
    pub device: device::Args,
}

/// Frames to draw where nobody asks for a number.
const FRAMES: usize = 24;

/// The script by which a scene without one is moved: at rest nothing is deformed.
const MOVING: &str = "bend";

/// Size of the paper's largest model.
const PAPER_NODES: usize = 10_000;

pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(scene) = &args.of_effects.moved {
        return effects::run_moved(scene, args.frames);
    }
    if args.of_effects.effects.is_some() {
        let readme = args.readme.as_deref();
        let options =
            effects::Options { frames: args.frames, json: args.json, readme, test_build: args.test_build };
        return effects::run(&args.of_effects, &options);
    }
    let full_speed = machine::expect_full_speed(args.test_build);
    let Some(scene) = &args.scene else {
        full_speed.map_err(Failure::request)?;
        let stage = crate::track::find_stage(args.stage.as_deref().unwrap_or("cyberstage"))
            .map_err(Failure::request)?;
        let figures = (args.storage, args.frames.unwrap_or(FRAMES));
        return super::sizes::run(&args.sizes, figures, args.device, &stage, args.json);
    };
    let scene = Resolved::load(scene)?;
    args.readme.as_ref().map_or(Ok(()), |path| marks::try_between(path, "bench"))?;
    prepare::try_green(&scene, None)?;
    let mut scene = tuning::settle(scene, false, false)?;
    if scene.script.is_none() && args.replay.is_none() {
        notice!("the scene has no script: measured with the script {MOVING}");
        scene = scene.with_script(MOVING);
    }
    let (stage, replay) = (args.stage.as_deref(), args.replay.as_deref());
    let open = || Session::open(&Request { stage, replay, ..Request::new(&scene) });
    let stage = open()?.world.assets.stage.clone();
    full_speed.map_err(Failure::request)?;
    let offline = prepare::precompute(&scene, true)?;
    let peak_memory = precompute::peak_memory();
    let loops = loops();
    let mut drawn = Vec::new();
    for (samples, shadows) in columns(args.device.shadows) {
        let mut session = open()?;
        let device = device::Args { shadows, ..args.device };
        let many = Samples::Exactly(samples);
        let mut targets = Targets::new(&mut session.world, Pictures::Eyes, many, 1.0, device)?;
        let count = args.frames.unwrap_or(FRAMES).max(2);
        let mut playback = Playback::new(&session, count)?;
        let mut frames = Vec::new();
        let mut counts = Vec::new();
        for frame in 0..count {
            let step = playback.step_to(&mut session, frame)?;
            let draw = targets.draw(&session.world)?;
            let (_, read_s) = targets.read()?;
            frames.push((step, draw, read_s));
            counts.push(targets.draw_counts());
        }
        session.report()?;
        // The first frame also compiles and allocates.
        let mut measured =
            Drawn::new((samples, shadows), targets.images.gpu.describe(), &stage, &frames[1..]);
        let mean = |of: fn(&DrawCounts) -> usize| {
            counts[1..].iter().map(|c| of(c) as f64).sum::<f64>() / (count - 1) as f64
        };
        measured.shapes = [mean(|c| c.drawn), mean(|c| c.culled)];
        let names = session.world.bodies.iter().map(|body| body.deformer.body.clone());
        measured.bodies = names.zip(targets.bodies.choices).collect();
        drawn.push(measured);
    }
    let ticks = beside_frames(open()?, args)?;
    let snapshot = bench_snapshot::measure(&mut open()?)?;
    let mut tables =
        vec![offline_table(&offline, peak_memory), loops_table(&loops), frame_table(&stage.name, &drawn)];
    if is_verbose() || args.readme.is_some() {
        tables.push(bench_snapshot::table(&snapshot));
    }
    if !ticks.is_empty() {
        tables.push(haptic_tick::table(&ticks));
    }
    if let Some(path) = &args.readme {
        marks::write_between(path, "bench", &markdown(&tables))?;
        print(&format!("{}: tables written\n", path.display()))?;
    }
    if args.json {
        let mut all = as_json(&offline, peak_memory, &loops, &drawn, &ticks);
        all["snapshot"] = json!(snapshot);
        print(&format!("{all:#}\n"))
    } else {
        let text: String =
            tables.iter().map(|(title, table)| format!("{title}\n{}\n", table.text())).collect();
        print(&text)
    }
}

/// The session with every body felt. What forces need and the .green file does not hold is made for it alone.
fn felt(session: Session) -> Result<Session, Failure> {
    let (Some(scene), Some(file)) = (&session.scene, &session.file) else { return Ok(session) };
    let scene = scene.felt()?;
    let folder = tempfile::tempdir().map_err(Failure::work)?;
    let path = folder.path().join("felt.green");
    let known = std::slice::from_ref(file);
    Session::open_with(&Request::new(&scene), || prepare::changed_file(&scene, &path, known, &Silent))
}

/// Ticks of the force loop beside frames of a session: on the bodies that list the effect, or on all where that is asked for.
fn beside_frames(session: Session, args: &Args) -> Result<Vec<haptic_tick::Row>, Failure> {
    let mut session = if args.haptics { felt(session)? } else { session };
    // The script moves it, as often as there is time for.
    session.input.replay = None;
    let scene = session.scene.clone();
    let is_felt =
        |body: &str| scene.as_ref().is_some_and(|scene| scene.bodies[body].effects_require(STIFFNESS));
    let felt = session.world.bodies.iter().filter(|b| is_felt(&b.deformer.body));
    let subjects = felt.map(Subject::new).collect::<Result<Vec<_>, _>>().map_err(Failure::wrong)?;
    if subjects.is_empty() {
        return Ok(Vec::new());
    }
    let (eyes, samples) = (Pictures::Eyes, Samples::Exactly(1));
    let mut targets = Targets::new(&mut session.world, eyes, samples, 1.0, args.device)?;
    let started = Instant::now();
    let duration_s = session.input.script.as_ref().map(|script| script.duration_s);
    haptic_tick::measure(subjects, || {
        if let Some(duration_s) = duration_s {
            session.advance(started.elapsed().as_secs_f64() % duration_s)?;
        }
        targets.draw(&session.world)?;
        Ok(())
    })
}

/// Medians of the frames drawn with one number of samples, s.
struct Drawn {
    samples: u32,
    shadows: Shadows,
    device: String,
    /// The pictures of a frame: "2 stereo pairs".
    pictures: String,
    /// Name of the step and its median time.
    steps: Vec<(&'static str, f64)>,
    frame_s: f64,
    /// Bodies' patches and solids that a frame draws, and leaves out since no eye of the pass can see them: means.
    shapes: [f64; 2],
    /// The place where each body deforms: CPU or graphics device.
    bodies: Vec<(String, device::Choice)>,
}

/// Samples and shadows of what is drawn: shadows that are asked for stand beside none, so that their price is seen.
fn columns(asked: Shadows) -> Vec<(u32, Shadows)> {
    match asked {
        Shadows::Auto | Shadows::Off => vec![(4, asked), (1, asked)],
        Shadows::Contact | Shadows::Soft => {
            vec![(4, Shadows::Off), (4, asked), (1, Shadows::Off), (1, asked)]
        }
    }
}

impl Drawn {
    /// The column's heading.
    fn name(&self) -> String {
        let samples = if self.samples > 1 { format!("{}× MSAA", self.samples) } else { "no MSAA".into() };
        match self.shadows {
            Shadows::Auto | Shadows::Off => samples,
            Shadows::Contact => format!("{samples}, contact shadow"),
            Shadows::Soft => format!("{samples}, soft shadows"),
        }
    }

    fn new(
        (samples, shadows): (u32, Shadows),
        device: String,
        stage: &Stage,
        frames: &[(StepTimes, DrawTimes, f64)],
    ) -> Drawn {
        let of = |pick: fn(&(StepTimes, DrawTimes, f64)) -> f64| median(frames.iter().map(pick));
        // Where nothing moves nothing is summed: these count over the frames that move the body.
        let moving = |pick: fn(&(StepTimes, DrawTimes, f64)) -> f64| {
            median(frames.iter().filter(|f| f.0.deform_s > 0.0).map(pick))
        };
        let steps = vec![
            ("pick and drag", of(|f| f.0.interact_s)),
            ("deform", moving(|f| f.0.deform_s)),
            ("normals", moving(|f| f.0.normals_s)),
            ("upload", moving(|f| f.1.upload_s)),
            ("encode", of(|f| f.1.encode_s)),
            ("draw", of(|f| f.1.draw_s)),
        ];
        let whole = |f: &(StepTimes, DrawTimes, f64)| {
            f.0.interact_s + f.0.deform_s + f.0.normals_s + f.1.upload_s + f.1.encode_s + f.1.draw_s
        };
        let frame_s = median(frames.iter().map(whole));
        let read = ("read-back (offscreen only, not counted)", of(|f| f.2));
        let pictures = pictures::pictures_of_frame(stage, stage.screens.len());
        let steps = [steps, vec![read]].concat();
        let (shapes, bodies) = ([0.0; 2], Vec::new());
        Drawn { samples, shadows, device, pictures, steps, frame_s, shapes, bodies }
    }

    /// Rate at which all screens are drawn, for both eyes.
    fn frames_per_second(&self) -> f64 {
        1.0 / self.frame_s
    }
}

/// One online loop at the paper's size.
struct Loop {
    name: &'static str,
    time_s: f64,
    /// Columns read, bytes; 0 where none are.
    bytes: f64,
    /// Time in which as many threads read the same bytes and do nothing else, measured in turn with the loop.
    reading_s: f64,
}

impl Loop {
    /// Times the superposition of the columns `words`, and their reading on as many threads as that superposition takes.
    fn new(name: &'static str, words: &[u32], mut superpose: impl FnMut()) -> Loop {
        let threads = (size_of_val(words) / BYTES_PER_THREAD).clamp(1, rayon::current_num_threads());
        let read = || {
            black_box(reading::read(black_box(words), threads));
        };
        let [time_s, reading_s] = in_turn([&mut superpose, &mut { read }]);
        Loop { name, time_s, bytes: size_of_val(words) as f64, reading_s }
    }

    /// The share of the speed of reading alone that the loop reaches.
    fn share(&self) -> String {
        match self.reading_s / self.time_s {
            _ if self.bytes == 0.0 => String::new(),
            share if share <= 1.0 => format!("{share:.2}"),
            _ => "more: reading was slower".into(),
        }
    }
}

fn loops() -> Vec<Loop> {
    let numbers = 2 * FIELDS * 3 * PAPER_NODES;
    let data: Vec<f32> = (0..numbers).map(|i| (i as f32).sin()).collect();
    let groups: Vec<ColumnGroup> = data.chunks_exact(numbers / 2).map(ColumnGroup::F32).collect();
    let mut sum = Superposition::new(&groups, PAPER_NODES);
    let mut u = vec![[0.0; 3]; PAPER_NODES];
    let mut c = 0.0;
    let mut superpose = |moved: usize| {
        c += 1e-3;
        let coefficients = [0, 1].map(|e| [if e < moved { 0.1 + c } else { 0.0 }; FIELDS]);
        black_box(sum.update(&groups, coefficients.as_flattened(), &mut u));
    };
    let mut measure = |name: &'static str, moved: usize| {
        let words = bytemuck::cast_slice(&data[..moved * numbers / 2]);
        Loop::new(name, words, || superpose(moved))
    };
    // Called as a frame calls them: from outside the threads that share the work, whose waking is part of the price.
    let mut rows = vec![
        measure("superposition, 24 columns", 2),
        measure("superposition, 12 columns (one element moved)", 1),
    ];
    let integers: Vec<i16> = (0..numbers).map(|i| ((i % 65_521) as i32 - 32_760) as i16).collect();
    let scales = [1e-4; FIELDS];
    let half = |values| ColumnGroup::Int16 { values, scales: &scales };
    let groups: Vec<ColumnGroup> = integers.chunks_exact(numbers / 2).map(half).collect();
    let mut sum = Superposition::new(&groups, PAPER_NODES);
    rows.push(Loop::new("superposition, 24 columns of int16", bytemuck::cast_slice(&integers), || {
        c += 1e-3;
        black_box(sum.update(&groups, &[0.1 + c; 2 * FIELDS], &mut u));
    }));

    let (around, along) = (100u32, PAPER_NODES as u32 / 100);
    let positions: Vec<[f32; 3]> = (0..PAPER_NODES as u32)
        .map(|i| {
            let angle = (i % around) as f32 * std::f32::consts::TAU / around as f32;
            [angle.cos(), angle.sin(), (i / around) as f32 * 0.06]
        })
        .collect();
    let cell = |i: u32| {
        let next = i / around * around + (i + 1) % around;
        [[i, next, i + around], [i + around, next, next + around]]
    };
    let triangles: Vec<[u32; 3]> = (0..(along - 1) * around).flat_map(cell).collect();
    let (mut sums, mut normals) = (Vec::new(), vec![[0.0; 3]; PAPER_NODES]);
    let time = repeat(|| vertex_normals(black_box(&positions), &triangles, &mut sums, &mut normals));
    rows.push(Loop {
        name: "normals, 19,800 triangles, one thread",
        time_s: time,
        bytes: 0.0,
        reading_s: 0.0,
    });
    rows
}

/// Median time of one call over half a second, s.
fn repeat(mut work: impl FnMut()) -> f64 {
    let [time] = in_turn([&mut work]);
    time
}

/// Median times of calls, over half a second for each, s. The calls take turns, so that disturbances of the machine affect
/// them alike. A turn is a few calls, the first of which is not counted, so that each finds its own data in the caches.
fn in_turn<const N: usize>(mut works: [&mut dyn FnMut(); N]) -> [f64; N] {
    let began = Instant::now();
    let mut times = [const { Vec::new() }; N];
    while began.elapsed().as_secs_f64() < 0.5 * N as f64 || times[0].len() < 5 {
        for (work, times) in works.iter_mut().zip(&mut times) {
            work();
            for _ in 0..4 {
                let started = Instant::now();
                work();
                times.push(started.elapsed().as_secs_f64());
            }
        }
    }
    times.map(median)
}

fn offline_table(bodies: &[Precomputed], peak_memory: Option<f64>) -> (String, Table) {
    let mut table = Table::new(&["offline", "time", "what"]);
    for body in bodies {
        table.rows.extend(precompute::report(body).rows.into_iter().skip(1));
    }
    if let Some(peak) = peak_memory {
        table.row(&["peak memory", &bytes(peak), "resident, of the whole process"]);
    }
    let threads = rayon::current_num_threads();
    (
        format!(
            "Offline, {threads} threads, {}, greenstage {}",
            machine::processor(),
            env!("CARGO_PKG_VERSION")
        ),
        table,
    )
}

fn loops_table(loops: &[Loop]) -> (String, Table) {
    let heading = ["online, 10,000 nodes", "time", "reads", "reading alone", "of that bandwidth"];
    let mut table = Table::new(&heading);
    for row @ Loop { name, time_s, bytes, reading_s } in loops {
        let rate =
            |s: f64| if *bytes > 0.0 { format!("{:.1} GB/s", bytes / s * 1e-9) } else { String::new() };
        table.row(&[name, &seconds(*time_s), &rate(*time_s), &rate(*reading_s), &row.share()]);
    }
    (format!("Online loops, {}", machine::processor()), table)
}

fn frame_table(stage: &str, drawn: &[Drawn]) -> (String, Table) {
    let heading: Vec<String> =
        std::iter::once("median of a frame".to_owned()).chain(drawn.iter().map(Drawn::name)).collect();
    let mut table = Table { rows: vec![heading] };
    let Some(first) = drawn.first() else {
        return (String::new(), table);
    };
    for (i, (name, _)) in first.steps.iter().enumerate() {
        let cells = drawn.iter().map(|d| seconds(d.steps[i].1));
        table.rows.push(std::iter::once((*name).to_owned()).chain(cells).collect());
    }
    let whole = drawn.iter().map(|d| seconds(d.frame_s));
    table.rows.push(std::iter::once("frame".to_owned()).chain(whole).collect());
    let rates = drawn.iter().map(|d| format!("{:.1}", d.frames_per_second()));
    table.rows.push(std::iter::once("frames per second".to_owned()).chain(rates).collect());
    let shapes = drawn.iter().map(|d| format!("{:.1}, {:.1}", d.shapes[0], d.shapes[1]));
    table.rows.push(std::iter::once("shapes drawn, left out".to_owned()).chain(shapes).collect());
    for (i, (name, _)) in first.bodies.iter().enumerate() {
        let choices = drawn.iter().map(|d| d.bodies[i].1.brief());
        table.rows.push(std::iter::once(format!("body.{name}")).chain(choices).collect());
    }
    (format!("Frames: {stage}, each of {}, on {}", first.pictures, first.device), table)
}

fn as_json(
    offline: &[Precomputed],
    peak_memory: Option<f64>,
    loops: &[Loop],
    drawn: &[Drawn],
    ticks: &[haptic_tick::Row],
) -> Value {
    let bodies: Vec<Value> = offline
        .iter()
        .map(|body| {
            let s = &body.solution;
            json!({ "body": body.name, "nodes": s.mesh.nodes.len(), "tetrahedra": s.mesh.tets.len(),
                "steps": s.times, "solver": s.stats })
        })
        .collect();
    let rows: Vec<Value> = loops
        .iter()
        .map(|l| json!({ "loop": l.name, "time_s": l.time_s, "bytes_read": l.bytes, "reading_s": l.reading_s }))
        .collect();
    let frames: Vec<Value> = drawn
        .iter()
        .map(|d| {
            let steps: serde_json::Map<String, Value> =
                d.steps.iter().map(|(name, time)| ((*name).to_owned(), json!(time))).collect();
            let deformation: serde_json::Map<String, Value> =
                d.bodies.iter().map(|(name, choice)| (name.clone(), choice.json())).collect();
            json!({ "samples": d.samples, "drawn": d.name(), "device": d.device, "pictures": d.pictures, "steps_s": steps,
                "frame_s": d.frame_s, "frames_per_s": d.frames_per_second(),
                "shapes_drawn": d.shapes[0], "shapes_culled": d.shapes[1], "deformation": deformation })
        })
        .collect();
    json!({ "offline": bodies, "peak_memory_bytes": peak_memory, "loops": rows,
        "processor": machine::processor(), "version": env!("CARGO_PKG_VERSION"), "frames": frames, "haptic_ticks": ticks })
}

fn markdown(tables: &[(String, Table)]) -> String {
    tables.iter().map(|(title, table)| format!("{title}:\n\n{}\n", table.markdown())).collect()
}

mod effects;
mod reading;

#[cfg(test)]
mod tests;
