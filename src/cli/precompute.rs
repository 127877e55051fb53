//! `greenstage precompute`: the offline stage.

use super::check::model_line;
use super::opening::Guess;
use super::print::print;
use super::{expected, parsers};
use crate::base::diagnostic::is_verbose;
use crate::base::failure::Failure;
use crate::base::machine;
pub use crate::base::machine::peak_memory;
use crate::base::output::{self, Kind, OutputError};
use crate::base::progress::Bars;
use crate::base::table::{Table, bytes, seconds};
use crate::deform::ModelReach;
use crate::effect::{self, EFFECTS};
use crate::green::{self, FAMILIES, GreenFile, KEPT_AFTER, Precomputed, STIFFNESS};
use crate::prepare::{self, Resolved};
use crate::scene::{Method, Storage};
use crate::tuning;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Run the offline stage: mesh → stiffness matrix → factor → Green's functions → .green file
///
/// Does nothing if the file is there and still belongs to the scene (same mesh, materials, control elements, solver,
/// requirements of model and effects, program version). Prints the time of each step and, if an effect of the scene measures them,
/// the errors of force and shape to expect. A run that is killed leaves the columns that it has finished beside the .green file
/// (FILE.green.part); the next run takes them from there. The equilibria of a body with the model "reduced" or "reduced_neo_hookean", which
/// take most of its time, stay in the cache folder (~/.cache/greenstage or $XDG_CACHE_HOME/greenstage, at most 1 GB): with another
/// effect, load or storage the body is made in a fraction of the time. Overwrites a .green file or an empty file; never any other file, nor what the scene
/// reads, not even with --force.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML; `greenstage manual scene`); or a mesh or surface file, for which a scene is proposed
    pub scene: PathBuf,
    #[command(flatten)]
    pub guess: Guess,
    /// Where to write; default: beside the scene, with the extension .green
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Compute even if the file is fresh or damaged
    #[arg(long)]
    pub force: bool,
    /// Keep finished columns, for a run after one that is killed, once this one has taken so long [s; default: 2]
    #[arg(long, value_name = "SECONDS", value_parser = parsers::seconds)]
    pub keep_after: Option<f64>,
    /// Show no progress; the closing table is still printed
    #[arg(short, long)]
    pub quiet: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = Resolved::load(&args.scene)?;
    let path = args.output.clone().unwrap_or_else(|| prepare::green_path(&scene));
    let inputs = prepare::inputs(&scene);
    let will_compute = args.force || !path.exists();
    let ask = if will_compute { try_path } else { output::may_replace };
    ask(&path, &green::GREEN, &inputs)?;
    let scene = tuning::settle(scene, args.quiet, args.force)?;
    if !args.force && path.exists() && prepare::fresh(&scene, &path)?.is_ok() {
        green::drop_journal(&path, None);
        return print(&format!("{} is fresh; nothing to do (--force computes it anew)\n", path.display()));
    }
    try_path(&path, &green::GREEN, &inputs)?;
    if args.force {
        green::drop_journal(&path, Some("--force computes everything anew"));
    }
    let started = Instant::now();
    let kept_after = args.keep_after.map_or(KEPT_AFTER, Duration::from_secs_f64);
    let (bodies, size, written_s) = prepare::make(&scene, &path, (kept_after, args.force), &|name| {
        Box::new(Bars::new(name, args.quiet))
    })?;
    let file = Arc::new(GreenFile::open(&path)?);
    let stored = stored(&file) + &reaches(&scene, &file)?;
    tuning::forget_steps(&scene);
    let tables: String = bodies.iter().map(|body| report(body).text() + "\n").collect();
    let errors: String = bodies
        .iter()
        .filter_map(|body| Some(expected::lines(&body.name, &effect::expected::of_precomputed(body)?)))
        .collect();
    let planned = bytes(machine::planned_memory());
    let told = |peak| format!(", peak memory {}, where {planned} were planned", bytes(peak));
    let peak = peak_memory().map_or_else(String::new, told);
    print(&format!(
        "{tables}{errors}{}: {} written in {}\n{stored}whole offline stage {}{peak}\n",
        path.display(),
        bytes(size as f64),
        seconds(written_s),
        seconds(started.elapsed().as_secs_f64())
    ))
}

/// Storage of the columns of each body of the written file, with its error as the file states it; nothing for single precision.
fn stored(file: &GreenFile) -> String {
    let coarse = file.meta.bodies.iter().filter(|(_, body)| body.accuracy.storage != Storage::F32);
    coarse.map(|(name, body)| format!("{name} {}\n", body.accuracy.stored())).collect()
}

/// The reach of each body's model, where its file has equilibria with which it can be compared.
fn reaches(scene: &Resolved, file: &Arc<GreenFile>) -> Result<String, Failure> {
    let mut lines = String::new();
    for (name, body) in &scene.bodies {
        let reach = ModelReach::measure(file, name, body.model).map_err(Failure::wrong)?;
        lines.extend(reach.iter().map(|reach| model_line(name, body.model, &reach.text())));
        lines.extend(reach.filter(|_| is_verbose()).map(|reach| reach.details()));
    }
    Ok(lines)
}

/// Makes the folder and looks whether the file can be written there, before the work.
fn try_path(path: &Path, kind: &Kind, inputs: &[PathBuf]) -> Result<(), OutputError> {
    output::make_folder_of(path)?;
    output::try_path(path, kind, inputs)
}

/// The closing table of one body: times, sizes, residual.
pub fn report(body: &Precomputed) -> Table {
    let solution = &body.solution;
    let (stats, times) = (&solution.stats, &solution.times);
    let mut table = Table::new(&[&body.name, "time", "what"]);
    let mut row = |name: &str, s: f64, what: String| table.row(&[name, &seconds(s), &what]);
    let mesh = &solution.mesh;
    row(
        "mesh",
        times.mesh_s,
        match solution.method {
            Method::Bem => {
                format!("surface {} nodes and {} triangles", mesh.nodes.len(), mesh.triangles.len())
            }
            Method::Fem => format!(
                "{} nodes, {} {}, surface {} nodes and {} triangles",
                mesh.nodes.len(),
                mesh.tets.len(),
                solution.element.name,
                solution.surface.nodes.len(),
                solution.surface.triangles.len()
            ),
        },
    );
    let entries = solution.matrix_entries as f64;
    let full = (3.0 * mesh.nodes.len() as f64).powi(2);
    row(
        "assembly",
        times.assembly_s,
        match solution.method {
            Method::Bem => format!("full matrices: {entries:.3e} entries, {}", bytes(8.0 * entries)),
            Method::Fem => format!("K: {entries:.3e} entries, {:.3} % of full", 100.0 * entries / full),
        },
    );
    if solution.method == Method::Bem {
        let fill = stats.factor_entries as f64;
        row(
            "factor",
            stats.factor_s,
            format!("{} unknowns, L: {fill:.3e} entries, in place", stats.unknowns),
        );
        row("solves", stats.solve_s, format!("{} columns, with their residuals", stats.columns));
    } else if stats.method.is_direct {
        row("ordering", stats.ordering_s, "nested dissection (METIS)".into());
        row("symbolic", stats.symbolic_s, format!("{} unknowns", stats.unknowns));
        let fill = stats.factor_entries as f64;
        // Only a factor in f32 is iterated with.
        let (number, iterations) = match stats.iterations {
            0 => (8.0, String::new()),
            count => (4.0, format!(", {count} iterations")),
        };
        row("factor", stats.factor_s, format!("L: {fill:.3e} entries, {}", bytes(number * fill)));
        let columns = stats.columns;
        row("solves", stats.solve_s, format!("{columns} columns, with their residuals{iterations}"));
    } else {
        row("multigrid", stats.factor_s, format!("{} unknowns", stats.unknowns));
        row(
            "solves",
            stats.solve_s,
            format!("{} columns together, {} iterations", stats.columns, stats.iterations),
        );
    }
    if let Some(conditioning) = stats.conditioning {
        let condition = conditioning
            .scaled_condition
            .map_or(String::new(), |k| format!("scaled condition number {k:.1e}, "));
        let bound = if stats.method.bounds_error { "at most" } else { "about" };
        let what = format!("{condition}forward error {bound} {:.1e}", conditioning.forward_error);
        row("conditioning", conditioning.seconds, what);
    }
    for entry in FAMILIES.iter().filter(|entry| times.families_s.contains_key(entry.family.name)) {
        let what = match solution.asymmetry.filter(|_| entry.family.name == STIFFNESS.name) {
            Some(asymmetry) => format!("S: {0} × {0}, asymmetry {asymmetry:.1e}", stats.columns),
            None => entry.holds.to_owned(),
        };
        row(entry.family.name, times.family_s(entry.family), what);
    }
    for effect in EFFECTS.iter().filter(|effect| effect.solve.is_some()) {
        if let Some(took) = times.families_s.get(effect.name) {
            row(effect.name, *took, "what the effect solves for".to_owned());
        }
    }
    let rigid = solution.rigid;
    let forces = rigid.shift_force.zip(rigid.turn_force).map_or(String::new(), |(shift, turn)| {
        format!(", of its forces {shift:.1e}, of the forces of a turn {turn:.1e}")
    });
    row(
        "all",
        solution.offline_s(),
        format!("worst relative residual {:.1e} ({})", stats.worst_residual(), stats.method.name),
    );
    if let Some(chosen) = &stats.chosen {
        table.row(&["solver", "", chosen]);
    }
    let shift = format!("error of a shift {:.1e}{forces}", rigid.shift);
    table.row(&["rigid motion", "", &shift]);
    table
}
