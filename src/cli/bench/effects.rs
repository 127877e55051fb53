//! `greenstage bench --effects`: what each effect costs on a generated body.
//!
//! In: effects and sizes. Out: for each effect alone, how much longer the same block takes to precompute and to move than without it,
//! and how much more of file and memory it has. The block without effects is measured twice: the second time shows which differences
//! mean nothing. Each block is precomputed in one process and moved in another, so that no row finds the memory of the row before,
//! and one that takes too long is ended.

use super::super::print::print;
use super::super::{marks, parsers};
use crate::base::failure::Failure;
use crate::base::machine;
use crate::base::progress::{Bars, Progress};
use crate::base::table::{Table, bytes, count, seconds};
use crate::deform::LINEAR;
use crate::effect::{EFFECTS, EffectEntry};
use crate::fem::TET4;
use crate::prepare::{self, Resolved};
use crate::session::{Request, Session};
use anyhow::Context;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Measure what each effect costs on generated blocks; with names, those alone: --effects=NAME,NAME
    #[arg(long, value_name = "NAME", num_args = 0.., require_equals = true, value_delimiter = ',', value_parser = parsers::effect, conflicts_with_all = ["scene", "sizes", "replay", "stage"])]
    pub effects: Option<Vec<String>>,
    /// Nodes of the blocks of --effects, about
    #[arg(long, value_delimiter = ',', default_values_t = [1000, 10_000, 100_000], requires = "effects", conflicts_with_all = ["scene", "sizes"])]
    pub nodes: Vec<usize>,
    /// Model of the blocks of --effects
    #[arg(long, default_value = LINEAR.name, value_parser = parsers::model, requires = "effects", conflicts_with_all = ["scene", "sizes"])]
    pub model: String,
    /// Leave out what takes longer than this for one block of --effects, s
    #[arg(long, default_value_t = 600.0, value_parser = parsers::positive, requires = "effects", conflicts_with_all = ["scene", "sizes"])]
    pub limit: f64,
    /// Move the body of this scene, and print what its frames take as JSON
    #[arg(long, hide = true)]
    pub moved: Option<PathBuf>,
}

/// Name of the body.
const BODY: &str = "block";

/// Frames of the script at 60 a second.
const FRAMES: usize = 300;
const FRAME: Duration = Duration::from_micros(16_667);
/// Smallest and largest block, nodes.
const SIZES: std::ops::RangeInclusive<usize> = 27..=2_000_000;

/// A hand twists and lifts the right end of a block and lets go of it; a ball presses its top and rubs along it; then a blade passes through
/// its upper part. Only effects take notice of ball and blade.
const SCRIPT: &str = r#"
frame = "room"
[[key]]
time = 0.0
stylus.ball = { position = [-0.06, 0.12, 0.0], direction = [0.0, -1.0, 0.0] }
stylus.blade = { position = [0.01, 0.02, 0.1], direction = [0.0, -1.0, 0.0] }
stylus.hand = { position = [0.3, 0.0, 0.0], direction = [-1.0, 0.0, 0.0], roll = 0.0 }
[[key]]
time = 0.2
stylus.hand = { pressed = true }
[[key]]
time = 1.2
stylus.ball = { position = [-0.06, 0.06, 0.0] }
stylus.hand = { position = [0.29, 0.03, 0.0], direction = [-1.0, 0.0, 0.0], roll = 0.3 }
[[key]]
time = 1.8
stylus.hand = { pressed = false }
[[key]]
time = 2.5
stylus.ball = { position = [0.03, 0.06, 0.0] }
stylus.blade = { position = [0.01, 0.02, 0.1] }
[[key]]
time = 4.0
stylus.blade = { position = [0.01, 0.02, -0.1] }
[[key]]
time = 4.5
stylus.ball = { position = [0.05, 0.12, 0.0] }
[[key]]
time = 5.0
"#;

/// Costs of one block.
#[derive(Clone, Serialize)]
struct Costs {
    precompute_s: f64,
    file_bytes: f64,
    #[serde(flatten)]
    moved: Moved,
}

/// Costs of a block while it is moved.
#[derive(Clone, Serialize, Deserialize)]
struct Moved {
    surface_nodes: usize,
    /// Mechanics of a frame, s.
    frame_mean_s: f64,
    frame_worst_s: f64,
    /// Largest resident memory of a process that opens the file and moves the block; `None` where the system does not report it.
    memory_bytes: Option<f64>,
}

/// One effect.
struct Row {
    effect: &'static str,
    /// Effects that it needs beside it.
    beside: Vec<&'static str>,
    /// Costs without it and with it, or why there are none.
    found: Result<[Costs; 2], String>,
}

/// All effects on blocks of one size.
struct Size {
    nodes: usize,
    without: Costs,
    /// The first is no effect, measured again.
    rows: Vec<Row>,
}

/// Options of `bench` for all its measurements.
pub struct Options<'a> {
    pub frames: Option<usize>,
    pub json: bool,
    pub readme: Option<&'a Path>,
    pub test_build: bool,
}

/// Measures all sizes, and prints tables, or the same as JSON.
pub fn run(of: &Args, options: &Options<'_>) -> Result<(), Failure> {
    let names: Vec<&str> = of.effects.iter().flatten().map(String::as_str).collect();
    let resolved = Resolved::parse(&block(1, &of.model, &names), Path::new("block.toml"))?;
    let asked: Vec<_> = resolved.bodies[BODY].entries().collect();
    let effects = if asked.is_empty() { EFFECTS.iter().collect() } else { asked };
    if let Some(nodes) = of.nodes.iter().find(|nodes| !SIZES.contains(nodes)) {
        let (least, most) = (SIZES.start(), SIZES.end());
        return Err(Failure::wrong(format!(
            "--nodes {nodes}: from {least} to {most} nodes can be asked for"
        )));
    }
    options.readme.map_or(Ok(()), |path| marks::try_between(path, "effects"))?;
    machine::expect_full_speed(options.test_build).map_err(Failure::request)?;
    let bars = Bars::new("effects", false);
    let sizes = of.nodes.iter().map(|nodes| {
        let folder = tempfile::tempdir().map_err(Failure::work)?;
        let bench = Bench { of, options, cells: cells(*nodes), folder };
        bench.size(&effects, &bars)
    });
    let sizes = sizes.collect::<Result<Vec<_>, Failure>>()?;
    if let Some(path) = options.readme {
        let tables: String = sizes.iter().map(|size| size.told(Table::markdown)).collect();
        marks::write_between(
            path,
            "effects",
            &format!("{}, model `{}`.\n{tables}", machine::description(), of.model),
        )?;
    }
    if options.json {
        let sizes: Vec<Value> = sizes.iter().map(Size::json).collect();
        let all = json!({ "processor": machine::processor(), "version": env!("CARGO_PKG_VERSION"), "model": of.model, "sizes": sizes });
        return print(&format!("{all:#}\n"));
    }
    let tables: String = sizes.iter().map(|size| size.told(Table::text)).collect();
    print(&format!("{}, model {}\n{tables}", machine::description(), of.model))
}

/// Cells across a block twice as long as wide, with about so many nodes.
fn cells(nodes: usize) -> usize {
    let of = |cells: usize| (2 * cells + 1) * (cells + 1).pow(2);
    (1..)
        .find(|cells| of(cells + 1) > nodes)
        .map_or(1, |low| if nodes - of(low).min(nodes) < of(low + 1) - nodes { low } else { low + 1 })
}

/// The scene of a block that lists these effects; where it vibrates, its right end is released.
fn block(cells: usize, model: &str, listed: &[&str]) -> String {
    let vibrating = EFFECTS.iter().filter(|effect| effect.vibrates && listed.contains(&effect.name));
    let settings: String =
        vibrating.map(|effect| format!("effect.{}.free = [\"right\"]\n", effect.name)).collect();
    format!(
        "stage = \"desktop\"\nscript = \"script.toml\"\n\
         tool.ball = {{ shape = {{ ball = {{ radius = 0.02 }} }}, stylus = 1 }}\n\
         tool.blade = {{ shape = {{ blade = {{ length = 0.12, width = 0.02 }} }}, stylus = 2 }}\n\
         [body.{BODY}]\ngenerate = {{ block = {{ size = [0.2, 0.1, 0.1], cells = [{}, {cells}, {cells}] }} }}\n\
         material = {{ young = 1.0e5, poisson = 0.4, density = 1000.0 }}\nelement = \"{}\"\nmodel = {model:?}\n\
         place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\neffects = {listed:?}\n{settings}\
         control.left = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n",
        2 * cells,
        TET4.name,
    )
}

/// Blocks of one size.
struct Bench<'a> {
    of: &'a Args,
    options: &'a Options<'a>,
    cells: usize,
    folder: tempfile::TempDir,
}

impl Bench<'_> {
    fn size(&self, effects: &[&'static EffectEntry], progress: &dyn Progress) -> Result<Size, Failure> {
        let nodes = (2 * self.cells + 1) * (self.cells + 1).pow(2);
        progress.begin(&format!("{nodes} nodes"), effects.len() as u64 + 2);
        let mut known: Vec<(Vec<&'static str>, Result<Costs, String>)> = Vec::new();
        let mut costs_of = |listed: Vec<&'static str>| match known.iter().find(|(of, _)| *of == listed) {
            Some((_, costs)) => costs.clone(),
            None => {
                let costs = self.costs(&listed);
                known.push((listed, costs.clone()));
                costs
            }
        };
        // The first start of a program is slower.
        let warm = self.program(&["--version".to_owned()], Duration::MAX);
        warm.map_err(|why| Failure::work(anyhow::anyhow!("{why}")))?;
        let without = costs_of(Vec::new())
            .map_err(|why| Failure::wrong(format!("{nodes} nodes without any effect: {why}")))?;
        progress.advance(1);
        let again = self.costs(&[]).map(|again| [without.clone(), again]);
        progress.advance(1);
        let mut rows = vec![Row { effect: "none, again", beside: Vec::new(), found: again }];
        for effect in effects {
            // What is heard is measured beside what vibrates: this block has nothing else to hear.
            let vibrating = EFFECTS.iter().filter(|other| effect.is_heard && other.vibrates);
            let beside: Vec<_> = vibrating.map(|other| other.name).collect();
            let before = costs_of(beside.clone());
            let with = costs_of([beside.clone(), vec![effect.name]].concat());
            let found = before.and_then(|before| Ok([before, with?]));
            rows.push(Row { effect: effect.name, beside, found });
            progress.advance(1);
        }
        progress.end();
        Ok(Size { nodes, without, rows })
    }

    /// Precomputes and moves the block with these effects. The error says why it cannot.
    fn costs(&self, listed: &[&str]) -> Result<Costs, String> {
        let text = block(self.cells, &self.of.model, listed);
        let required =
            Resolved::parse(&text, Path::new("block.toml")).and_then(|scene| scene.requirements(BODY));
        required
            .map_err(|error| format!("refused: {}", error.to_string().trim_start_matches("block.toml: ")))?;
        let folder = self.folder.path();
        let [scene, script, green] =
            ["block.toml", "script.toml", "block.green"].map(|name| folder.join(name));
        let write = |path: &Path, text: &str| std::fs::write(path, text).map_err(|error| error.to_string());
        write(&scene, &text)?;
        write(&script, SCRIPT)?;
        let limit = Duration::from_secs_f64(self.of.limit.min(1e9));
        let precompute = ["precompute", "block.toml", "--quiet", "--force"].map(String::from);
        let (_, precompute_s) = self.program(&precompute, limit)?;
        let file_bytes = green.metadata().map_err(|error| error.to_string())?.len() as f64;
        let left = limit.saturating_sub(Duration::from_secs_f64(precompute_s));
        let frames = self.options.frames.unwrap_or(FRAMES).to_string();
        let mut arguments =
            ["bench", "--moved", "block.toml", "--frames", &frames].map(String::from).to_vec();
        arguments.extend(self.options.test_build.then(|| "--test-build".to_owned()));
        let (told, _) = self.program(&arguments, left)?;
        let moved = serde_json::from_str(&told).map_err(|error| error.to_string())?;
        Ok(Costs { precompute_s, file_bytes, moved })
    }

    /// Runs this program in the folder, for so long at most: what it prints, and the time that it takes, s.
    fn program(&self, arguments: &[String], limit: Duration) -> Result<(String, f64), String> {
        let run = || -> anyhow::Result<_> {
            let [told, said] = ["told", "said"].map(|name| self.folder.path().join(name));
            let mut command = Command::new(std::env::current_exe()?);
            command.current_dir(&self.folder).args(arguments).stdin(Stdio::null());
            command.stdout(File::create(&told)?).stderr(File::create(&said)?);
            let started = Instant::now();
            let mut child = command.spawn().context("this program cannot be started again")?;
            while child.try_wait()?.is_none() {
                if started.elapsed() > limit {
                    child.kill()?;
                    child.wait()?;
                    anyhow::bail!("not within {} s", self.of.limit);
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            let took_s = started.elapsed().as_secs_f64();
            if !child.wait()?.success() {
                let said = std::fs::read_to_string(said)?;
                let last = said.lines().last().unwrap_or("it ended without a word");
                anyhow::bail!("{}", last.trim_start_matches("error: "));
            }
            Ok((std::fs::read_to_string(told)?, took_s))
        };
        run().map_err(|error| format!("{error:#}"))
    }
}

impl Size {
    fn told(&self, table: fn(&Table) -> String) -> String {
        let Costs { precompute_s, file_bytes, moved } = &self.without;
        let memory = moved.memory_bytes.map_or("not reported".to_owned(), bytes);
        let mut text = format!(
            "\n{}, {} of them on the surface. Without any effect: precompute {}, file {}, memory {memory}, frame {} on average, {} at \
             worst. More than that with one effect:\n\n",
            count(self.nodes, "node"),
            moved.surface_nodes,
            seconds(*precompute_s),
            bytes(*file_bytes),
            seconds(moved.frame_mean_s),
            seconds(moved.frame_worst_s),
        );
        let mut rows = Table::new(&["effect", "precompute", "file", "memory", "mean frame", "worst frame"]);
        let mut missing = String::new();
        for Row { effect, beside, found } in &self.rows {
            let name = match beside.is_empty() {
                true => (*effect).to_owned(),
                false => format!("{effect} (beside {})", beside.join(", ")),
            };
            let [before, with] = match found {
                Ok(both) => both,
                Err(why) => {
                    missing += &format!("{effect}: {why}\n");
                    rows.row(&[&name, "", "", "", "", ""]);
                    continue;
                }
            };
            let [of_before, of_with] = [&before.moved, &with.moved];
            let memory = of_with.memory_bytes.zip(of_before.memory_bytes).map(|(with, before)| with - before);
            rows.row(&[
                &name,
                &signed(with.precompute_s - before.precompute_s, seconds),
                &signed(with.file_bytes - before.file_bytes, bytes),
                &memory.map_or(String::new(), |more| signed(more, bytes)),
                &signed(of_with.frame_mean_s - of_before.frame_mean_s, seconds),
                &signed(of_with.frame_worst_s - of_before.frame_worst_s, seconds),
            ]);
        }
        text += &table(&rows);
        if !missing.is_empty() {
            text += &format!("\n{missing}");
        }
        text
    }

    fn json(&self) -> Value {
        let row = |Row { effect, beside, found }: &Row| match found {
            Ok([without, with]) => {
                json!({ "effect": effect, "beside": beside, "without": without, "with": with })
            }
            Err(why) => json!({ "effect": effect, "beside": beside, "why_not": why }),
        };
        let [again, effects] =
            [&self.rows[..1], &self.rows[1..]].map(|rows| rows.iter().map(row).collect::<Vec<_>>());
        json!({ "nodes": self.nodes, "without": self.without, "again": again, "effects": effects })
    }
}

/// A difference in the unit that suits it.
fn signed(more: f64, in_unit: fn(f64) -> String) -> String {
    if more < 0.0 { format!("-{}", in_unit(-more)) } else { in_unit(more) }
}

/// Moves the body of a scene, whose .green file is there, by its script through so many frames, each when it is due, and prints what they
/// take.
pub fn run_moved(scene: &Path, frames: Option<usize>) -> Result<(), Failure> {
    let scene = Resolved::load(scene)?;
    let file = prepare::green_path(&scene);
    let mut session = Session::open(&Request { green: Some(&file), ..Request::new(&scene) })?;
    let surface_nodes = session.world.bodies.iter().map(|body| body.deformer.node_count()).sum();
    let duration_s = session.input.script.as_ref().map_or(0.0, |script| script.duration_s);
    let frames = frames.unwrap_or(FRAMES);
    let (began, mut times_s) = (Instant::now(), Vec::new());
    // The first frame also allocates.
    for frame in 0..=frames {
        std::thread::sleep((FRAME * frame as u32).saturating_sub(began.elapsed()));
        let started = Instant::now();
        session.advance(duration_s * frame as f64 / frames as f64)?;
        session.world.effects.iter_mut().for_each(|effect| {
            std::hint::black_box(effect.heard());
        });
        times_s.extend((frame > 0).then(|| started.elapsed().as_secs_f64()));
    }
    let moved = Moved {
        surface_nodes,
        frame_mean_s: times_s.iter().sum::<f64>() / frames as f64,
        frame_worst_s: times_s.iter().copied().fold(0.0, f64::max),
        memory_bytes: machine::peak_memory(),
    };
    print(&json!(moved).to_string())
}
